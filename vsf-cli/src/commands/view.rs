use crate::config::Sources;
use crate::console::{Console, Written, read_text, texts};
use crate::diagnosis::page_of_report;
use crate::exit::usage;
use crate::field_file::FieldFile;
use crate::file_kind::FileKind;
use crate::range::{ending, positive};
use crate::recording::{Recording, SplitPart, needs_recording};
use crate::settings::SceneSettings;
use crate::view::{Cloud, View, in_air, in_scene, page};
use std::path::PathBuf;
use vsf::core::nalgebra::Point3;
use vsf::data::parse_json;
use vsf::gap::Diagnosis;
use vsf::pipeline::motion_warnings;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  vsf view field.npz --out field.html
  vsf view DATASET --field field.npz --out touches.html
      with the robot and what it touches
  vsf view gap.json --out gap.html
      what `vsf diagnose --json=gap.json` found

The page needs no network, no graphics card and no other files. Drag to rotate, scroll or pinch to zoom, \
shift-drag to pan. It shows at most 200000 points, touched ones first. For a diagnosis, it is the page of `vsf \
diagnose --html` without the torques, which are in the recording.

JSON keys: written.")]
pub struct Args {
    /// Field (.npz or folder), folder of a recording, or diagnosis (.json)
    input: PathBuf,
    /// Field, if INPUT is a recording; default: the one stored in it, or else points without values
    #[arg(long)]
    field: Option<PathBuf>,
    /// File for the page, .html
    #[arg(long, value_name = "FILE", value_parser = ending("html"))]
    out: PathBuf,
    /// IDs of the sequences to show; default: all
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Stiffness at the end of the color bar [N/m]; default: the 99 % quantile
    #[arg(long, value_parser = positive)]
    full_scale: Option<f64>,
    #[command(flatten)]
    sources: Sources,
    #[command(flatten)]
    scene: SceneSettings,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    console
        .outputs
        .file("--out", &args.out, Some(FileKind::Page))?;
    args.sources.keep(console)?;
    console.outputs.keep(&args.input)?;
    let html = if (args.input.extension()).is_some_and(|e| e.eq_ignore_ascii_case("json")) {
        of_report(args)?
    } else if FieldFile::is_at(&args.input) {
        of_field(args, console)?
    } else {
        of_recording(args, console)?
    };
    let written = texts(std::slice::from_ref(&args.out));
    let line = format!("wrote {}\n", written.concat());
    console.json_and(&Written { written }, vec![(args.out.clone(), html)])?;
    console.report(line)
}

fn of_report(args: &Args) -> anyhow::Result<String> {
    let given = [
        ("--field", args.field.is_some()),
        ("--sequences", args.sequences.is_some()),
        ("--full-scale", args.full_scale.is_some()),
    ];
    if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
        return Err(usage(format!(
            "{flag} is for fields and recordings; a diagnosis shows none"
        )));
    }
    let text = read_text(&args.input)?;
    let path = args.input.display();
    let report = Diagnosis::from_json(&text).map_err(|e| anyhow::anyhow!("{path}: {e}"))?;
    let told: Told = parse_json(text.as_bytes()).map_err(|e| anyhow::anyhow!("{path}: {e}"))?;
    Ok(page_of_report(&report, &told.warnings))
}

/// What stands in a diagnosis beside it.
#[derive(serde::Deserialize)]
struct Told {
    #[serde(default)]
    warnings: Vec<String>,
}

fn of_field(args: &Args, console: &Console) -> anyhow::Result<String> {
    let given = [
        ("--field", args.field.is_some()),
        ("--sequences", args.sequences.is_some()),
    ];
    needs_recording(&args.input, &given)?;
    let file = FieldFile::open(&args.input, console)?;
    let cloud = Cloud::of_field(&file, args.full_scale)?;
    let title = args.input.file_stem().unwrap_or_default().to_string_lossy();
    page(&View {
        title: &title,
        cloud: &cloud,
        motion: None,
    })
}

fn of_recording(args: &Args, console: &Console) -> anyhow::Result<String> {
    let recording = Recording::open(&args.input, &args.scene, console)?;
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::All)?;
    let dataset = &recording.dataset;
    let found = if args.field.is_some() || dataset.field.is_some() {
        let field = recording.field(args.field.as_deref(), console)?;
        let scene = recording.scene_of(&field, None, console)?;
        field.compare_model(None, &scene, console);
        Some((scene, Cloud::of_field(&field, args.full_scale)?))
    } else if args.full_scale.is_some() {
        return Err(usage(
            "--full-scale needs --field: the recording stores no field",
        ));
    } else if recording.has_points() {
        let scene = recording.scene_to_learn(None, None, console)?;
        let cloud = Cloud::of_points(scene.rest().positions(), Point3::origin())?;
        Some((scene, cloud))
    } else {
        None
    };
    let warn = |robot| console.warn_all(motion_warnings(robot, &sequences));
    let (cloud, motion) = match found {
        Some((scene, cloud)) => {
            warn(scene.robot());
            let bar = console.bar(sequences.len(), "contact");
            let motion = in_scene(&scene, &sequences, &cloud, || bar.inc(1))?;
            bar.finish_and_clear();
            (cloud, motion)
        }
        None => {
            let robot = recording.robot()?;
            warn(&robot);
            let base_W = Point3::from(dataset.base_pose.translation.vector);
            let motion = in_air(&robot, &sequences, base_W)?;
            (Cloud::of_points(&[], base_W)?, motion)
        }
    };
    let (title, motion) = (&dataset.name, Some(&motion));
    page(&View {
        title,
        cloud: &cloud,
        motion,
    })
}

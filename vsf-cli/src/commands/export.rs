use crate::config::Sources;
use crate::console::{Console, Written, create_parent, texts, write_file, write_folder};
use crate::corrected::{CorrectedModel, ModelArgs, Modeled};
use crate::exit::usage;
use crate::field_file::{FieldFile, FieldFormat, claim, save};
use crate::file_kind::FileKind;
use crate::interrupt::writing;
use crate::pictures::{self, Surroundings, View};
use crate::range::positive;
use crate::recording::{Recording, SplitPart, needs_recording};
use crate::settings::SceneSettings;
use anyhow::Context;
use std::path::PathBuf;
use vsf::data::{EffortPrediction, McapExport, Sequence, Table, TorqueKind};
use vsf::pipeline::{Scene, SequencePrediction, Trace, predict};
use vsf::robots::RobotModel;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  vsf export field.npz --out field.ply --out field.png
  vsf export DATASET --field field.npz --out field.png
      with camera view and robot
  vsf export DATASET --field field.npz --torques plots/
      one SVG per test sequence
  vsf export DATASET --field field.npz --out touches.mcap
      for Foxglove, PlotJuggler, ros2 bag play

With a corrected model (--model), predicted torques include its effects; in free air, the model alone \
predicts.

An .mcap file holds ROS 2 messages:
  /joint_states   all sequences of a recording, with its torques as effort
  /tf             pose of the robot's root link in the frame world
                  (viewers that have the URDF show the arm there)

With a field, also:
  /stiffness_field
                  PointCloud2 in the frame world (x, y, z, stiffness, sd,
                  rgb), at the start of each sequence
  /predicted/joint_states
                  predicted torques as effort, to be compared with the
                  recorded ones (gravity and offsets as there)
  /predicted/joint_states_sd
                  their standard deviations as effort

Stamps start at 1 s, sequences are 2 s apart. `vsf import` restores the recording.

JSON keys: written.")]
pub struct Args {
    /// Field (.npz or folder) or folder of a recording
    input: PathBuf,
    /// Field, if INPUT is a recording; default: the one stored in it
    #[arg(long)]
    field: Option<PathBuf>,
    /// Output for the field, by ending: .ply, .png, .svg, .npz, .mcap, or none for a folder; may be repeated. An
    /// .mcap file can also hold a recording without a field
    #[arg(long)]
    out: Vec<PathBuf>,
    /// Folder for plots of measured and predicted torques, torques_<ID>.svg, with a band of one standard deviation
    /// and the samples in contact shaded; INPUT must be a recording
    #[arg(long, value_name = "DIR")]
    torques: Option<PathBuf>,
    /// IDs of the sequences to plot; default: the test split
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Show the standard deviation instead of the stiffness (pictures, .mcap)
    #[arg(long)]
    deviation: bool,
    /// Stiffness or standard deviation at the end of the color scale [N/m]; default: the largest (.ply, .mcap) or
    /// the 99 % quantile (pictures)
    #[arg(long, value_parser = positive)]
    full_scale: Option<f64>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    sources: Sources,
    #[command(flatten)]
    scene: SceneSettings,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    if args.out.is_empty() && args.torques.is_none() {
        return Err(usage("nothing to write: give --out FILE or --torques DIR"));
    }
    args.out.iter().try_for_each(|out| claim(out, console))?;
    if let Some(folder) = &args.torques {
        console
            .outputs
            .folder("--torques", folder, "plots", |_| None)?;
    }
    args.sources.keep(console)?;
    let is_ply = |out: &PathBuf| FieldFormat::of(out).is_ok_and(|f| f == FieldFormat::Ply);
    if args.deviation && args.out.iter().any(is_ply) {
        console.warn(
            "--deviation is of pictures and .mcap: a .ply file has stiffness as color, and deviations, where the field has \
             them, as numbers",
        );
    }
    let written = if FieldFile::is_at(&args.input) {
        let given = [
            ("--field", args.field.is_some()),
            ("--torques", args.torques.is_some()),
            ("--sequences", args.sequences.is_some()),
            ("--model", args.model.path().is_some()),
        ];
        needs_recording(&args.input, &given)?;
        let field = FieldFile::open(&args.input, console)?;
        write_field(
            args,
            &field,
            &Surroundings::default(),
            &McapExport::default(),
        )?
    } else {
        from_recording(args, console)?
    };
    let written = texts(&written);
    let lines: String = written.iter().map(|p| format!("wrote {p}\n")).collect();
    console.results(&Written { written }, lines)
}

fn from_recording(args: &Args, console: &Console) -> anyhow::Result<Vec<PathBuf>> {
    if args.sequences.is_some() && args.torques.is_none() {
        return Err(usage("--sequences are those to plot; give --torques DIR"));
    }
    let recording = Recording::open(&args.input, &args.scene, console)?;
    let dataset = &recording.dataset;
    let is_mcap = |out: &PathBuf| FieldFormat::of(out).is_ok_and(|f| f == FieldFormat::Mcap);
    let without_field = args.field.is_none() && dataset.field.is_none();
    let alone = without_field && args.model.path().is_none() && args.torques.is_none();
    if alone && args.out.iter().all(is_mcap) {
        if args.deviation || args.full_scale.is_some() {
            return Err(usage(
                "--deviation and --full-scale are of a field; give it by --field",
            ));
        }
        let robot = recording.robot()?;
        let joints = names(&robot);
        let export = McapExport {
            recording: Some(dataset),
            joints: &joints,
            base: base(&robot),
            ..McapExport::default()
        };
        for out in &args.out {
            create_parent(out)?;
            writing(|| export.save(out))?;
        }
        return Ok(args.out.clone());
    }
    let model = args.model.open(console)?;
    let given = args.field.as_deref();
    let (field, scene) = recording.field_and_scene(given, model.as_ref(), console)?;
    if let Some(out) = (args.out.iter()).find(|o| field.field.points.is_empty() && !is_mcap(o)) {
        return Err(usage(format!(
            "{}: a recording without points has no field to draw; --out takes .mcap, --torques a folder of \
             plots",
            out.display()
        )));
    }
    let mut around = Surroundings::default();
    if let Some(view) = &dataset.camera {
        around = around.camera(view, &field.field.points);
    }
    let shown = recording.sequences(None, SplitPart::All)?[0];
    around = around.robot(&scene, shown, &scene.trace(shown)?)?;
    let (joints, mut predictions) = (names(scene.robot()), Vec::new());
    if args.out.iter().any(is_mcap) {
        predictions = efforts(&recording, &field, &scene, model.as_ref(), console)?;
    }
    let export = McapExport {
        recording: Some(dataset),
        joints: &joints,
        base: base(scene.robot()),
        predictions: &predictions,
        ..McapExport::default()
    };
    let mut written = write_field(args, &field, &around, &export)?;
    let Some(folder) = &args.torques else {
        return Ok(written);
    };
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::Test)?;
    let plot_of = |id: &str| format!("torques_{id}.svg");
    (sequences.iter())
        .try_for_each(|s| FileKind::Svg.check("--torques", &folder.join(plot_of(&s.id))))?;
    let (modeled, predictions) = predicted(
        &recording,
        &field,
        &scene,
        model.as_ref(),
        &sequences,
        console,
    )?;
    let mut plots = Vec::new();
    for (trace, prediction) in modeled.traces.iter().zip(&predictions) {
        let title = format!("{}, sequence {}", dataset.name, trace.id);
        let svg = pictures::torques(&scene, trace, prediction, &title)
            .with_context(|| format!("sequence {}", trace.id))?;
        plots.push((plot_of(&trace.id), svg));
    }
    write_folder(folder, plots.iter().map(|(name, svg)| (name, svg)))?;
    written.extend(plots.iter().map(|(name, _)| folder.join(name)));
    Ok(written)
}

fn write_field(
    args: &Args,
    file: &FieldFile,
    around: &Surroundings,
    beside: &McapExport,
) -> anyhow::Result<Vec<PathBuf>> {
    let stem = file.path.file_stem().unwrap_or_default().to_string_lossy();
    let own = file.field.recording.as_deref().unwrap_or(&stem);
    let title = beside.recording.map_or(own, |dataset| &dataset.name);
    let view = View {
        title,
        deviation: args.deviation,
        limit: args.full_scale,
    };
    let field = &file.field;
    let picture_of = || file.path.display().to_string();
    for out in &args.out {
        create_parent(out)?;
        match FieldFormat::of(out)? {
            FieldFormat::Png => {
                let png = pictures::field(field, around, view, |v| v.png());
                write_file(out, &png.with_context(picture_of)?)?;
            }
            FieldFormat::Svg => {
                let svg = pictures::field(field, around, view, |v| v.svg());
                write_file(out, svg.with_context(picture_of)?.as_bytes())?;
            }
            FieldFormat::Ply => {
                writing(|| field.save_ply(out, args.full_scale))?;
            }
            FieldFormat::Mcap => {
                if args.deviation && field.sd.is_none() {
                    let problem = "the field has no standard deviation (K_std)";
                    return Err(anyhow::anyhow!("{}: {problem}", picture_of()));
                }
                let export = McapExport {
                    field: (!field.points.is_empty()).then_some(field),
                    deviation: args.deviation,
                    full_scale: args.full_scale,
                    ..*beside
                };
                writing(|| export.save(out))?;
            }
            FieldFormat::Npz | FieldFormat::Folder => save(field, out)?,
        }
    }
    Ok(args.out.clone())
}

fn base(robot: &RobotModel) -> Option<&str> {
    robot.links().first().map(|link| link.name())
}

fn names(robot: &RobotModel) -> Vec<String> {
    robot.joints().iter().map(|j| j.name().to_owned()).collect()
}

/// What field and model predict of some sequences.
fn predicted(
    recording: &Recording,
    field: &FieldFile,
    scene: &Scene,
    model: Option<&CorrectedModel>,
    sequences: &[&Sequence],
    console: &Console,
) -> anyhow::Result<(Modeled, Vec<SequencePrediction>)> {
    let belief = &field.stored.belief;
    let noise_sd = field.noise_sd(scene.robot().joint_count(), console)?;
    let modeled = Modeled::new(model, recording, scene, sequences, console)?;
    let predictions = modeled.predict(|trace| predict(scene, belief, &noise_sd, trace))?;
    Ok((modeled, predictions))
}

/// What they predict the torques of the whole recording to be, as they were recorded: with gravity and
/// offset where these have them.
fn efforts(
    recording: &Recording,
    field: &FieldFile,
    scene: &Scene,
    model: Option<&CorrectedModel>,
    console: &Console,
) -> anyhow::Result<Vec<EffortPrediction>> {
    // tau_meas = tau_rigid - tau_ext, see the format of recordings.
    let sign = match recording.dataset.torque_kind {
        TorqueKind::External => 1.0,
        TorqueKind::Measured => -1.0,
    };
    let sequences = recording.sequences(None, SplitPart::All)?;
    let (modeled, predictions) = predicted(recording, field, scene, model, &sequences, console)?;
    let traces = modeled.traces.iter().zip(&predictions);
    let of = |((trace, prediction), sequence): ((&Trace, &SequencePrediction), &&Sequence)| {
        let mut mean = sequence.torques.clone();
        let errors = prediction.mean.iter().zip(trace.readings());
        let errors =
            errors.flat_map(|(mean, reading)| mean.iter().zip(reading).map(|(m, r)| m - r));
        for (torque, error) in mean.data_mut().iter_mut().zip(errors) {
            *torque += sign * error;
        }
        let sd = if prediction.sd.is_empty() {
            None
        } else {
            Some(Table::new(mean.cols(), prediction.sd.concat())?)
        };
        Ok(EffortPrediction { mean, sd })
    };
    traces.zip(&sequences).map(of).collect()
}

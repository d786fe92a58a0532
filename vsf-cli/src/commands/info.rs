mod field;

use crate::console::{Console, in_line, number, sequence_table, table};
use crate::exit::message;
use crate::field_file::{FieldFile, FieldFormat};
use crate::recording::{Recording, RecordingArgs, SplitPart, untouched};
use serde::Serialize;
use vsf::core::nalgebra::Point3;
use vsf::data::{TorqueKind, listed};
use vsf::pipeline::{Scene, Trace, reading_unit, view_warnings};
use vsf::robots::RobotModel;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
JSON keys of a recording:
  name, description, robot, joints (name, unit), torque_kind, rate_hz,
  tare_samples, train, test, points, bounds ([lower, upper] in m)
  threshold (of contact, m)
  stored_field, camera
  sequences (sequence, samples, duration_s, touches, contact_samples,
      mean_contacts; the last two are null without points)
  grids (link, mesh, resolution_m, error_p99_m, reached, boundary_edges,
      edges, unsure_share, turned_share)
  links_without_inertia

<DATASET> may also be a field (.npz or folder); the options of recording and contact then have no effect.

JSON keys of a field, null for what it does not store:
  points, bounds, touched_points
  mean_stiffness, largest_stiffness (N/m, of the touched points, or of
      all points if the field does not store which were touched)
  recording, learned_from, prior_sd, noise_sd, contact_parameters,
  corrected_model")]
pub struct Args {
    #[command(flatten)]
    recording: RecordingArgs,
}

#[derive(Serialize)]
struct Report {
    name: String,
    description: String,
    robot: String,
    joints: Vec<Joint>,
    torque_kind: &'static str,
    rate_hz: Option<f64>,
    tare_samples: usize,
    train: Vec<String>,
    test: Vec<String>,
    points: usize,
    bounds: Option<[[f64; 3]; 2]>,
    threshold: Option<f64>,
    stored_field: bool,
    camera: bool,
    sequences: Vec<Entry>,
    grids: Vec<Grid>,
    links_without_inertia: Vec<String>,
}

#[derive(Serialize)]
struct Joint {
    name: String,
    unit: &'static str,
}

#[derive(Serialize)]
struct Entry {
    sequence: String,
    samples: usize,
    duration_s: f64,
    touches: usize,
    contact_samples: Option<usize>,
    mean_contacts: Option<f64>,
}

#[derive(Serialize)]
struct Grid {
    link: String,
    mesh: Option<String>,
    resolution_m: f64,
    error_p99_m: f64,
    reached: bool,
    boundary_edges: usize,
    edges: usize,
    unsure_share: f64,
    turned_share: f64,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let input = &args.recording.dataset;
    let format = FieldFormat::of(input);
    let may_be_field = matches!(format, Ok(FieldFormat::Npz | FieldFormat::Folder));
    if may_be_field && FieldFile::is_at(input) {
        let file = FieldFile::open(input, console)?;
        let report = field::describe(&file);
        return console.results(&report, field::text(&report));
    }
    let recording = args.recording.open(console)?;
    let sequences = recording.sequences(None, SplitPart::All)?;
    let scene = recording.scene_to_learn_or_air(console)?;
    recording.compare_contact(&scene, console);
    let traces = recording.traces(&scene, &sequences, console)?;
    console.warn_all(untouched(&scene, &traces, &sequences));
    // A recording of free motion has no points, and nothing can be said about contact.
    let report = if recording.has_points() {
        warn_of_extras(&recording, &scene, console);
        describe(&recording, scene.robot(), Some(&scene), &traces)
    } else {
        describe(&recording, scene.robot(), None, &[])
    };
    console.results(&report, text(&report))
}

/// Warns of a camera and a stored field that do not fit the points: they are needed by other commands.
fn warn_of_extras(recording: &Recording, scene: &Scene, console: &Console) {
    match recording.view() {
        Ok(view) => console.warn_all(view.iter().flat_map(|v| view_warnings(scene.rest(), v))),
        Err(error) => console.warn(message(&error)),
    }
    let checked = match recording.dataset.field {
        Some(_) => (recording.field(None, console))
            .and_then(|field| recording.check_field(&field, console)),
        None => Ok(()),
    };
    if let Err(error) = checked {
        console.warn(format!("the stored field: {}", message(&error)));
    }
}

fn describe(
    recording: &Recording,
    robot: &RobotModel,
    scene: Option<&Scene>,
    traces: &[Trace],
) -> Report {
    let dataset = recording.dataset.clone();
    let points = scene.map_or(&[][..], |s| s.rest().positions());
    let entry = |(k, s): (usize, &vsf::data::Sequence)| Entry {
        sequence: s.id.clone(),
        samples: s.len(),
        duration_s: s.time.last().unwrap_or(&0.0) - s.time.first().unwrap_or(&0.0),
        touches: s.touches().count(),
        contact_samples: traces.get(k).map(Trace::contact_samples),
        mean_contacts: traces.get(k).map(Trace::mean_contacts),
    };
    let grids = scene.map_or(&[][..], Scene::grids).iter().map(|g| Grid {
        link: robot.links()[g.link].name().to_owned(),
        mesh: g.source.clone(),
        resolution_m: g.report.resolution,
        error_p99_m: g.report.error.p99,
        reached: g.report.reached,
        boundary_edges: g.report.openness.boundary_edges,
        edges: g.report.openness.edges,
        unsure_share: 1.0 - g.report.error.sure_share,
        turned_share: g.report.error.turned_share,
    });
    let joint = |joint: &vsf::robots::Joint| Joint {
        name: joint.name().to_owned(),
        unit: reading_unit(joint),
    };
    let massless = robot.links_without_inertia();
    Report {
        robot: robot.name().to_owned(),
        joints: robot.joints().iter().map(joint).collect(),
        torque_kind: match dataset.torque_kind {
            TorqueKind::External => "external",
            TorqueKind::Measured => "measured",
        },
        points: points.len(),
        bounds: bounds(points),
        threshold: scene.map(|s| s.contact().threshold),
        sequences: dataset.sequences.iter().enumerate().map(entry).collect(),
        grids: grids.collect(),
        links_without_inertia: massless.map(|l| l.name().to_owned()).collect(),
        stored_field: dataset.field.is_some(),
        camera: dataset.camera.is_some(),
        rate_hz: dataset.rate_hz,
        tare_samples: dataset.tare_samples,
        train: dataset.splits.train,
        test: dataset.splits.test,
        name: dataset.name,
        description: dataset.description,
    }
}

fn bounds(points: &[Point3<f64>]) -> Option<[[f64; 3]; 2]> {
    let (lower, upper) = vsf::core::bounds(points);
    (!points.is_empty()).then(|| [lower.coords.into(), upper.coords.into()])
}

/// Bounds by axis.
fn place([a, b]: &[[f64; 3]; 2]) -> String {
    // Of a small object millimeters say nothing.
    let widest = (0..3).map(|k| b[k] - a[k]).fold(0.0, f64::max);
    let digits = if widest < 0.03 { 6 } else { 3 };
    let range = |k: usize| format!("{:.digits$}..{:.digits$}", a[k], b[k]);
    format!("x {}, y {}, z {} m", range(0), range(1), range(2))
}

fn text(report: &Report) -> String {
    let list = |ids: &[String]| {
        if ids.is_empty() {
            "none".to_owned()
        } else {
            listed(ids)
        }
    };
    let mut text = format!("{}\n", in_line(&report.name));
    for line in report.description.lines() {
        text += &format!("  {line}\n");
    }
    let joints: Vec<_> = report
        .joints
        .iter()
        .map(|j| format!("{} [{}]", j.name, j.unit))
        .collect();
    text += &format!("  robot     {}: {}\n", report.robot, list(&joints));
    text += &format!("  torques   {}", report.torque_kind);
    if report.tare_samples > 0 {
        text += &format!(", tared by the first {} samples", report.tare_samples);
    }
    text += &format!(
        "\n  train     {}\n  test      {}\n",
        list(&report.train),
        list(&report.test)
    );
    match report.bounds {
        Some(bounds) => text += &format!("  points    {}, {}\n", report.points, place(&bounds)),
        None if report.camera => {
            text += "  points    none: `vsf points` makes them of what camera/ sees; without, it is free motion\n";
        }
        None => text += "  points    none: free motion, no stiffness to estimate\n",
    }
    if let Some(threshold) = report.threshold {
        let millimeters = number(1e3 * threshold);
        text += &format!("  contact   threshold {millimeters} mm\n");
    }
    let yes = |b: bool| if b { "yes" } else { "no" };
    text += &format!(
        "  camera    {}\n  field     {}\n",
        yes(report.camera),
        yes(report.stored_field)
    );
    if !report.links_without_inertia.is_empty() {
        text += &format!("  no mass   {}\n", list(&report.links_without_inertia));
    }
    text.push('\n');
    let rows: Vec<_> = report
        .sequences
        .iter()
        .map(|s| {
            vec![
                s.sequence.clone(),
                s.samples.to_string(),
                number(s.duration_s),
                s.touches.to_string(),
                s.contact_samples.map_or("-".to_owned(), |n| n.to_string()),
                s.mean_contacts
                    .map_or("-".to_owned(), |n| format!("{n:.0}")),
            ]
        })
        .collect();
    let header = [
        "sequence",
        "samples",
        "seconds",
        "touches",
        "in contact",
        "mean contacts",
    ];
    text += &sequence_table(&header, &rows);
    if !report.grids.is_empty() {
        let rows: Vec<_> = report
            .grids
            .iter()
            .map(|g| {
                vec![
                    g.link.clone(),
                    format!("{:.2}", 1e3 * g.resolution_m),
                    format!("{:.3}", 1e3 * g.error_p99_m),
                    format!("{} of {}", g.boundary_edges, g.edges),
                    format!("{:.1} %", 100.0 * g.unsure_share),
                ]
            })
            .collect();
        text.push('\n');
        text += &table(
            &[
                "mesh of link",
                "grid mm",
                "p99 error mm",
                "open edges",
                "side unsure",
            ],
            &rows,
        );
    }
    text
}

use crate::config::Sources;
use crate::console::{Console, number, plural, sequence_table};
use crate::derived::{IMPORT, claim, keep_made, keep_robot, save};
use crate::exit::usage;
use crate::explain::{blame, explain};
use crate::range::{self, finite, positive};
use crate::settings::MetadataSettings;
use serde::Serialize;
use std::path::PathBuf;
use vsf::core::nalgebra::Point3;
use vsf::data::{
    Advice, Clock, DataError, DataWarning, Dataset, JointLog, Overrides, Sequence, Splits,
    TorqueKind, listed, read_points,
};
use vsf::pipeline::{PipelineError, check_readable, load_robot, motion_warnings, robot_of};

/// Most points of a box.
const MOST_POINTS: f64 = 1e7;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  vsf import bag/ --robot kinova_gen3 --torque-kind measured \\
      --out DATASET
  vsf import touch_*.mcap --robot arm.urdf --torque-kind external \\
      --points object.ply --out DATASET
  vsf import bag/ --robot kinova_gen3 --torque-kind measured \\
      --names joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,joint_7 \\
      --out DATASET
  vsf import exported.mcap --robot arm.urdf --out DATASET
      a file by `vsf export`; built-in robots need no --robot
  vsf import touch_*.csv --robot arm.urdf --torque-kind measured \\
      --out DATASET

Reads sensor_msgs/JointState messages of ROS 2 (CDR) or ROS 1: position, effort (as torques) and, if present, \
velocity. Joints are found by the robot's joint names (or --names), in any order; other joints are ignored, \
and so are messages without any of the robot's. A pause (--gap) begins a new sequence: 000, 001, ... Files by \
`vsf export` are restored with their metadata, points and sequences. They do not contain the camera and the \
URDF of a robot (--robot).

Reads CSV files (.csv, or .tsv with tabs) whose first line has the titles of the columns: time [s] (time, t, \
timestamp, time_s) and for each joint its position [rad or m] (position, pos, q), its torque or force [N m or \
N] (effort, torque, tau) and, optionally, its velocity (velocity, vel, dq, qd). Titles have the form q_NAME, \
NAME_position or NAME.position, or number the joints, q1, q2, ..., in the order of the robot, from 1 or from \
0. Other columns are ignored. Each file begins a new sequence.

Without points, the recording is one of free motion, for `vsf diagnose`.

JSON keys: out, robot, topic (null for CSV files), joints, points, sequences (sequence, samples, duration_s, \
split, file (only for CSV files)).")]
pub struct Args {
    /// MCAP files in the order of recording, the folder of a ROS 2 bag, or CSV files
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder to write: new, empty, or with a recording of the same sequences by `vsf import` to replace
    #[arg(long)]
    out: PathBuf,
    /// Topic of the joint states; required if there are several, except in files by `vsf export`
    #[arg(long)]
    topic: Option<String>,
    /// Names of the robot's joints in the files, in the robot's order, if they differ from the robot's own
    #[arg(long, value_delimiter = ',')]
    names: Option<Vec<String>>,
    /// Pause that ends a sequence [s]; default: 1, or none in files by `vsf export`
    #[arg(long, value_parser = positive)]
    gap: Option<f64>,
    /// Use the log times instead of the stamps in the messages
    #[arg(long)]
    log_time: bool,
    /// Leave out the velocities in the files, for instance because some samples lack them
    #[arg(long)]
    no_velocities: bool,
    /// Import planned motions that have not been made, for `vsf predict`: torques are set to zero, whatever the
    /// files have, and all sequences are test sequences unless --test says otherwise
    #[arg(long)]
    planned: bool,
    /// File with the rest points of the object in the world frame [m]: .ply, .pcd, .npy, or the .npz of a field
    #[arg(long, value_name = "FILE", conflicts_with = "box")]
    points: Option<PathBuf>,
    /// Fill a box with rest points: two opposite corners x,y,z,x,y,z in the world frame [m]
    #[arg(long = "box", id = "box", value_delimiter = ',', num_args = 1, allow_hyphen_values = true,
        value_name = "X,Y,Z,X,Y,Z", value_parser = finite)]
    corners: Option<Vec<f64>>,
    /// Spacing of the points in the box [m]; adjusted as little as possible along edges that are not a multiple of
    /// it
    #[arg(long, requires = "box", conflicts_with = "points", default_value_t = 0.01, value_parser = positive)]
    spacing: f64,
    #[command(flatten)]
    sources: Sources,
    #[command(flatten)]
    metadata: MetadataSettings,
}

#[derive(Serialize)]
struct Report {
    out: String,
    robot: String,
    /// None of CSV files.
    topic: Option<String>,
    joints: Vec<String>,
    points: usize,
    sequences: Vec<Entry>,
}

#[derive(Serialize)]
struct Entry {
    sequence: String,
    samples: usize,
    duration_s: f64,
    /// `train`, `test` or `neither`.
    split: &'static str,
    /// Of CSV files.
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<String>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    claim(&args.out, console)?;
    let mut inputs = args.files.iter().chain(&args.points);
    inputs.try_for_each(|f| console.outputs.keep(f))?;
    args.sources.keep(console)?;
    keep_made("--out", &args.out, &[IMPORT])?;
    let mut given = args.metadata.overrides()?;
    let learns = given.splits.as_ref().is_some_and(|s| !s.train.is_empty());
    if args.planned && learns {
        return Err(usage(
            "--train: motions that are planned have no torques to learn from",
        ));
    }
    let filled = args.corners.as_ref().map(|c| Filled::new(c, args.spacing));
    let filled = filled.transpose()?;
    let clock = if args.log_time {
        Clock::Log
    } else {
        Clock::Header
    };
    let spinner = console.spinner("reading joint states");
    let refused = |e| in_flags(args, e);
    let log = JointLog::open(&args.files, args.topic.as_deref(), clock);
    let mut log = log.map_err(refused)?;
    spinner.finish_and_clear();
    if args.no_velocities {
        log = log.without_velocities();
    }
    if args.planned {
        log = log.planned();
    }

    if args.files.len() > 1 {
        // None of them names the whole.
        let name = args
            .out
            .file_name()
            .map(|n| n.to_string_lossy().into_owned());
        given.name = given.name.or(name);
    }
    if let Some(path) = &args.points {
        let (points, warnings) = read_points(path)?;
        console.warn_all(warnings);
        log = log.with_points(points);
    }
    if let Some(Filled { points, corners }) = filled {
        log = log.with_points(points);
        given.object_bbox = Some(corners);
    }
    keep_robot(given.robot.as_ref(), console)?;
    let packages = args.metadata.packages();
    let known = log.metadata(&given).map_err(refused)?;
    given.made_by = Some(IMPORT.to_owned());
    if args.planned {
        // Of either kind they are zero.
        given.torque_kind = known.torque_kind.or(Some(TorqueKind::External));
    }
    let joints: Vec<String> = match &known.robot {
        Some(robot) => {
            let robot = load_robot(robot, known.joints.clone(), &packages)
                .map_err(|e| explain(&args.metadata, e))?;
            robot.joints().iter().map(|j| j.name().to_owned()).collect()
        }
        // Refused in what follows.
        None => Vec::new(),
    };
    if known.robot.is_some() && joints.is_empty() {
        anyhow::bail!("the robot has no joint that moves; check its URDF (--robot)");
    }
    let names = match &args.names {
        Some(names) => names.clone(),
        None => log.names_of(&joints),
    };
    if known.robot.is_some() && names.len() != joints.len() {
        let (count, joints) = (names.len(), listed(&joints));
        return Err(usage(format!(
            "--names takes a name for each of {joints}; {count} given"
        )));
    }
    console.warn_all(exchanged(&names, &joints));
    let (mut dataset, warnings) = (log.recording(&given, &names, args.gap)).map_err(|e| {
        if matches!(e, DataError::UnknownSequence { .. }) {
            // What is wrong may be how they were split.
            let whole = Overrides {
                splits: None,
                ..given.clone()
            };
            if let Ok((dataset, warnings)) = log.recording(&whole, &names, args.gap) {
                console.warn_all(warnings);
                let count = dataset.sequences.len();
                console.warn(format!(
                    "split at pauses (--gap) the files hold {count} sequence{}",
                    plural(count)
                ));
            }
        }
        refused(e)
    })?;
    if args.planned && given.splits.is_none() {
        dataset.splits = Splits {
            train: Vec::new(),
            test: dataset.sequences.iter().map(|s| s.id.clone()).collect(),
        };
    }
    let as_planned =
        |w: &&DataWarning| args.planned && matches!(w, DataWarning::ZeroTorques { .. });
    console.warn_all(warnings.iter().filter(|w| !as_planned(w)));
    let robot = robot_of(&dataset, &packages).map_err(|e| explain(&args.metadata, e))?;
    let sequences: Vec<&Sequence> = dataset.sequences.iter().collect();
    console.warn_all(motion_warnings(&robot, &sequences));
    let name = robot.name().to_owned();
    check_readable(&dataset, robot).map_err(|e| in_file(&log, &dataset, e))?;

    let report = report(args, &log, name, joints, &dataset);
    save(dataset, &packages, &args.out, Vec::new())?;
    console.results(&report, text(&report))
}

/// With the file of a reading that is not taken, where it is known.
fn in_file(log: &JointLog, dataset: &Dataset, error: PipelineError) -> anyhow::Error {
    let id = match &error {
        PipelineError::State { id, .. }
        | PipelineError::Torque { id, .. }
        | PipelineError::Motion { id, .. } => id,
        _ => return error.into(),
    };
    let place = dataset.sequences.iter().position(|s| s.id == *id);
    let file = place.and_then(|k| {
        log.files_of(dataset)
            .get(k)
            .map(|f| f.display().to_string())
    });
    match file {
        Some(file) => anyhow::Error::from(error).context(file),
        None => error.into(),
    }
}

/// A warning of names that are those of the robot in another order.
fn exchanged(names: &[String], joints: &[String]) -> Option<String> {
    let others = joints
        .iter()
        .zip(names)
        .filter(|(joint, name)| joint != name);
    let others: Vec<String> = others
        .map(|(joint, name)| format!("{joint} is read from {name}"))
        .collect();
    let are_own = joints.iter().all(|joint| names.contains(joint));
    (are_own && !others.is_empty()).then(|| {
        format!(
            "--names has the robot's own names in another order: {}; joints are found by name, so leave it out unless \
             the files exchange them",
            listed(&others)
        )
    })
}

/// What the recording needs besides joint states, and what may help, by the flags that give it.
fn in_flags(args: &Args, error: DataError) -> anyhow::Error {
    match &error {
        DataError::MissingKey { key: "robot", .. } => usage(
            "--robot is required: a built-in robot such as kinova_gen3, or the path of a URDF, which no recorded file holds",
        ),
        DataError::MissingKey {
            key: "torque_kind",
            hint,
            ..
        } => usage(format!("--torque-kind is required: {hint}")),
        DataError::UnknownSequence { id, .. } => usage(format!(
            "--train, --test: there is no sequence {id:?}; they are numbered in their order, 000, 001, ..., with as many digits as it takes, \
             but for files of `vsf export`, which name their own"
        )),
        DataError::Argument {
            what: what @ ("joints" | "topic" | "clock" | "gap"),
            problem,
        } => {
            let flag = match *what {
                "joints" => "--names",
                "topic" => "--topic",
                "gap" => "--gap",
                _ => "--log-time",
            };
            usage(format!("{flag}: {problem}"))
        }
        DataError::Advised { error, advice } => {
            let flag = match advice {
                Advice::Topic => "choose one by --topic",
                Advice::Names => {
                    "should these be the same, give their names in the files by --names"
                }
                Advice::Gap => "split it by its stamps with --gap",
                Advice::LogTime => {
                    "where stamps are of no use, take the times of logging by --log-time"
                }
                Advice::NoVelocities => "leave out all velocities by --no-velocities",
                Advice::Planned => "for motions that are planned and not made give --planned",
                other => return anyhow::anyhow!("{error}; {other}"),
            };
            anyhow::anyhow!("{error}; {flag}")
        }
        _ => blame(&args.metadata, error),
    }
}

/// Points that fill a box.
struct Filled {
    points: Vec<Point3<f64>>,
    corners: [Point3<f64>; 2],
}

impl Filled {
    /// Each point is the center of a cell; cells fill the box, and are as near to cubes of this size as that allows.
    fn new(corners: &[f64], spacing: f64) -> anyhow::Result<Self> {
        let corners = range::corners(corners)?;
        range::fits(spacing, &corners)?;
        let [lower, upper] = corners;
        let counts = (upper - lower).map(|size| (size / spacing).round().max(1.0));
        if counts.product() > MOST_POINTS {
            return Err(usage(format!(
                "--box with --spacing {spacing:?} has more than {MOST_POINTS} points"
            )));
        }
        let cell = (upper - lower).component_div(&counts);
        let at = move |k: usize, i: usize| lower[k] + (i as f64 + 0.5) * cell[k];
        let range = |k: usize| (0..counts[k] as usize).map(move |i| at(k, i));
        let points = range(0)
            .flat_map(|x| range(1).flat_map(move |y| range(2).map(move |z| Point3::new(x, y, z))));
        Ok(Self {
            points: points.collect(),
            corners: [lower, upper],
        })
    }
}

fn report(
    args: &Args,
    log: &JointLog,
    robot: String,
    joints: Vec<String>,
    dataset: &Dataset,
) -> Report {
    let files = log.files_of(dataset);
    let split = |id: &String| {
        if dataset.splits.train.contains(id) {
            "train"
        } else if dataset.splits.test.contains(id) {
            "test"
        } else {
            "neither"
        }
    };
    let entry = |(k, s): (usize, &Sequence)| Entry {
        sequence: s.id.clone(),
        samples: s.len(),
        duration_s: s.time.last().unwrap_or(&0.0) - s.time.first().unwrap_or(&0.0),
        split: split(&s.id),
        file: files.get(k).map(|f| f.to_string_lossy().into_owned()),
    };
    Report {
        out: args.out.to_string_lossy().into_owned(),
        robot,
        topic: log.topic().map(str::to_owned),
        joints,
        points: dataset.rest_points.as_ref().map_or(0, Vec::len),
        sequences: dataset.sequences.iter().enumerate().map(entry).collect(),
    }
}

fn text(report: &Report) -> String {
    let rows = report.sequences.iter().map(|s| {
        let (samples, seconds) = (s.samples.to_string(), number(s.duration_s));
        let file = s.file.clone();
        [s.sequence.clone(), samples, seconds, s.split.to_owned()]
            .into_iter()
            .chain(file)
            .collect()
    });
    let mut titles = vec!["sequence", "samples", "seconds", "split"];
    if report.topic.is_none() {
        titles.push("file");
    }
    let points = match report.points {
        0 => "no points: free motion (--points or --box for an object)".to_owned(),
        n => format!("{n} points"),
    };
    let joints = match report.joints.len() {
        1 => "1 joint".to_owned(),
        n => format!("{n} joints"),
    };
    // Of free motion, `vsf diagnose` holds a sequence out.
    let tests = report.sequences.iter().any(|s| s.split == "test");
    let untested = match report.sequences.len() {
        _ if tests || report.points == 0 => "",
        1 => {
            "\none sequence alone: nothing tests what it teaches (`vsf evaluate` needs a second one)\n"
        }
        _ => {
            "\nno sequence tests what the others teach (`vsf evaluate` needs one); --train and --test say which do\n"
        }
    };
    format!(
        "wrote {}: {} of {} from {}, {points}\n\n{}{untested}\nwhat it looks like, and what looks wrong: vsf info {}\n",
        report.out,
        joints,
        report.robot,
        report.topic.as_deref().unwrap_or("CSV"),
        sequence_table(&titles, &rows.collect::<Vec<_>>()),
        report.out
    )
}

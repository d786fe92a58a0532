use crate::commands::bench::Online;
use crate::console::{Console, complain};
use crate::exit::usage;
use crate::field_file::{FieldFile, claim, save};
use crate::interrupt;
use crate::range::{deviation, rate, replays, whole};
use crate::recording::{Recording, RecordingArgs, SplitPart};
use anyhow::Context;
use serde::Serialize;
use std::io::{BufReader, Cursor, IsTerminal, Write, sink, stdin, stdout};
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use vsf::core::{Belief, Noise, median};
use vsf::data::{Dataset, Sequence, StiffnessField, TorqueKind};
use vsf::pipeline::live::{
    Counts, Datagrams, Lines, LiveSession, Node, Options, Sample, Stiffness, Summary, WhenFull,
    run as feed,
};
use vsf::pipeline::{Estimate, Hyper, PipelineError, PriorShape, Scene, health_warnings};
use vsf::robots::JointTorques;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each sample is a line (or datagram) of JSON, {\"t\": 12.345, \"q\": [..], \"tau\": [..]}: time [s], joint positions [rad or m] in \
the order of the robot's joints, and torques of the kind that the recording has (torque_kind): those of the environment on the \
robot, or those at the actuators, from which the weight of the arm is taken off. Where the recording has tare_samples, the mean of so \
many in the beginning is zero. A number \"touch\" begins a new touch where it \
changes, as does a gap of more than 0.1 s, below 25 Hz of two missing samples. A line that is no sample is told on standard error \
and changes nothing.

Summaries are lines of JSON on standard output: t, contacts (points touched now), touched (so far), stiffness (mean, sd and max \
of those, N/m), residual (before the update, root mean square of its norm since the last summary, N m), nis_ratio (1 where the \
filter is as sure as it may be), slowest_ms (of a step), and counts of samples: received, refused, dropped (the estimation was \
too slow), repeated, late, tared, used, missing, gaps, restarts (the clock went back).

The stream ends with the pipe, with an empty datagram, after --idle, or by Ctrl-C; then the field is written.

JSON keys: points, touched, stiffness, nis_ratio, the counts, out.")]
pub struct Args {
    /// Take datagrams at an address of this machine, such as 127.0.0.1:9000, in place of lines on standard input
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = loopback)]
    udp: Option<SocketAddr>,
    /// Take the recording itself, one sequence after the other, as quickly as it goes: to see what comes out
    #[arg(long, conflicts_with_all = ["udp", "wait"])]
    play: bool,
    /// IDs of the sequences to play; the train split by default
    #[arg(long, value_delimiter = ',', requires = "play")]
    sequences: Option<Vec<String>>,
    /// End after so many seconds without a datagram; never by default
    #[arg(long, requires = "udp", value_name = "SECONDS", value_parser = whole(1_u32..=86_400))]
    idle: Option<u32>,
    /// Hold the sender of a pipe back instead of dropping samples, as for a recording that is played
    #[arg(long, conflicts_with = "udp")]
    wait: bool,
    /// Rate of the samples [Hz], by which missing ones are counted; by default that of the recording
    #[arg(long, value_parser = rate)]
    stream_hz: Option<f64>,
    /// Summaries a second
    #[arg(long, default_value_t = Options::default().publish_hz, value_parser = rate)]
    publish_hz: f64,
    /// Where to write the field in the end: .npz, .ply, .mcap, or a folder
    #[arg(long, default_value = "field.npz")]
    out: PathBuf,
    /// An earlier field of the recording's points, to go on from
    #[arg(long)]
    field: Option<PathBuf>,
    /// Standard deviation of every point's stiffness before it is touched [N/m], default 30 or that of --field
    #[arg(long, value_parser = deviation, conflicts_with = "field")]
    prior_sd: Option<f64>,
    /// Standard deviation of the readings [N m or N], model error included, default 0.05 or that of --field
    #[arg(long, value_parser = deviation)]
    noise_sd: Option<f64>,
    /// The estimator
    #[arg(long, value_enum, default_value = "replay")]
    estimator: Online,
    /// Past observations replayed after every update
    #[arg(long, default_value_t = 20, value_parser = replays)]
    replay: usize,
    #[command(flatten)]
    recording: RecordingArgs,
}

const PRIOR_SD: f64 = 30.0;
const NOISE_SD: f64 = 0.05;

/// What is known in the end.
#[derive(Serialize)]
struct Report {
    points: usize,
    touched: usize,
    stiffness: Stiffness,
    nis_ratio: Option<f64>,
    #[serde(flatten)]
    counts: Counts,
    out: String,
}

/// The stream is not protected: it stays on this machine.
fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr = text.parse().map_err(|_| "must be ADDRESS:PORT")?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("must be an address of this machine, such as 127.0.0.1:9000".to_owned())
    }
}

/// What the estimation begins with.
struct Start {
    belief: Belief<f64>,
    hyper: Hyper,
    touched: Vec<bool>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    claim(&args.out, console)?;
    if args.udp.is_none() && !args.play && stdin().is_terminal() {
        return Err(usage(
            "no samples: pipe lines of JSON into this command, or give --udp or --play; see --help",
        ));
    }
    let recording = args.recording.open(console)?;
    let (scene, start) = match &args.field {
        None => anew(args, &recording, console)?,
        Some(path) => go_on(path, args, &recording, console)?,
    };
    let dataset = &recording.dataset;
    let options = Options {
        rate_hz: (args.stream_hz.or_else(|| rate_of(dataset)))
            .unwrap_or(Options::default().rate_hz),
        publish_hz: args.publish_hz,
        when_full: if args.wait || args.play {
            WhenFull::Wait
        } else {
            WhenFull::DropOldest
        },
        weight: (dataset.torque_kind == TorqueKind::Measured).then_some(dataset.gravity),
        tare: dataset.tare_samples as u64,
        ..Options::default()
    };
    let mut node = node(&scene, &start, args, options)?;
    let played = if args.play {
        Some(recording.sequences(args.sequences.as_deref(), SplitPart::Train)?)
    } else {
        None
    };
    let ran = stream(&mut node, args, played.as_deref(), console);
    let used = node.counts().used;
    if used == 0 {
        ran?;
        return Err(anyhow::anyhow!(
            "the stream had no sample to learn from ({} lines, {} of them refused); no field is written",
            node.counts().received,
            node.counts().refused
        ));
    }
    // What was learned until then is not lost where the stream breaks.
    let estimate = estimate(&node, &start.touched)?;
    let field = estimate.to_field(&scene, &start.hyper, &dataset.name, &[])?;
    let field = StiffnessField {
        // Of a stream, not of its sequences.
        learned_from: None,
        ..field
    };
    save(&field, &args.out)?;
    let Summary {
        stiffness,
        nis_ratio,
        counts,
        ..
    } = node.summary();
    let report = Report {
        points: scene.rest().len(),
        touched: estimate.touched.iter().filter(|t| **t).count(),
        stiffness,
        nis_ratio,
        counts,
        out: args.out.to_string_lossy().into_owned(),
    };
    console.remark(format_args!(
        "{} of {} samples used, {} of {} points touched: wrote {}",
        counts.used, counts.received, report.touched, report.points, report.out
    ));
    if counts.dropped > 0 {
        console.warn(format_args!(
            "{} samples were dropped, since the estimation was too slow for them; give --wait where a recording is played, or a \
             lower --replay",
            counts.dropped
        ));
    }
    console.warn_all(health_warnings(&estimate.health));
    ran?;
    console.json_and(&report, Vec::new())
}

/// Samples a second, by `dataset.json` or its first sequence.
fn rate_of(dataset: &Dataset) -> Option<f64> {
    let time = &dataset.sequences.first()?.time;
    let steps = time.windows(2).map(|w| w[1] - w[0]).collect();
    (dataset.rate_hz).or_else(|| median(steps).map(f64::recip))
}

/// From the prior of the flags.
fn anew(args: &Args, recording: &Recording, console: &Console) -> anyhow::Result<(Scene, Start)> {
    let scene = recording.scene_to_learn(None, None, console)?;
    let prior_sd = args.prior_sd.unwrap_or(PRIOR_SD);
    let noise_sd = vec![args.noise_sd.unwrap_or(NOISE_SD); scene.robot().joint_count()];
    let start = Start {
        belief: Belief::uniform(scene.rest().len(), 0.0, prior_sd)?,
        hyper: hyper(prior_sd, noise_sd),
        touched: vec![false; scene.rest().len()],
    };
    Ok((scene, start))
}

/// From an earlier field.
fn go_on(
    path: &Path,
    args: &Args,
    recording: &Recording,
    console: &Console,
) -> anyhow::Result<(Scene, Start)> {
    let (FieldFile { stored, .. }, scene) = recording.field_and_scene(Some(path), None, console)?;
    let joints = scene.robot().joint_count();
    let known = (
        stored.noise_sd(joints)?,
        stored.prior_sd,
        stored.has_deviations(),
    );
    let (Some(noise_sd), Some(prior_sd), true) = known else {
        let path = path.display();
        anyhow::bail!(
            "{path}: the field does not say how sure it is (K_std, prior_sd and noise_sd); give one that `vsf estimate` or \
             `vsf live` wrote"
        );
    };
    let start = Start {
        hyper: hyper(
            prior_sd,
            args.noise_sd.map_or(noise_sd, |sd| vec![sd; joints]),
        ),
        touched: match stored.touched {
            none if none.is_empty() => vec![false; scene.rest().len()],
            touched => touched,
        },
        belief: stored.belief,
    };
    Ok((scene, start))
}

/// What a node knows of points that were touched now or before.
fn estimate(node: &Node, before: &[bool]) -> Result<Estimate, PipelineError> {
    let belief = node.session().belief();
    let widen = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect();
    let pairs = node.touched().iter().zip(before);
    Ok(Estimate {
        belief: Belief::new(widen(belief.mean()), widen(belief.variance()))?,
        touched: pairs.map(|(now, before)| *now || *before).collect(),
        health: *node.session().health(),
    })
}

fn hyper(prior_sd: f64, noise_sd: Vec<f64>) -> Hyper {
    Hyper {
        prior_sd,
        shape: PriorShape::independent(),
        noise_sd,
    }
}

fn node(scene: &Scene, start: &Start, args: &Args, options: Options) -> anyhow::Result<Node> {
    let robot = scene.robot();
    let sensor = JointTorques::new(Noise::per_channel(&start.hyper.noise_sd)?);
    let filter = args.estimator.filter(args.replay);
    let filter = filter.build(start.belief.clone().into(), None)?;
    let (chains, rest) = (robot.chains().clone(), scene.rest().clone());
    let session = LiveSession::new(chains, rest, scene.contact_model()?, sensor, filter)?;
    Ok(Node::new(robot.clone(), session, options)?)
}

/// Sequences as lines, a second apart.
fn lines(sequences: &[&Sequence]) -> anyhow::Result<String> {
    let (mut text, mut begin, mut touch) = (String::new(), 0.0, 0);
    for sequence in sequences {
        let (first, mut last) = (sequence.time.first().copied().unwrap_or_default(), begin);
        let rows = sequence.angles.iter().zip(sequence.torques.iter());
        for (row, (time, (q, tau))) in sequence.time.iter().zip(rows).enumerate() {
            touch += u64::from(sequence.touch_starts.contains(&row));
            last = begin + (time - first);
            let sample = Sample {
                t: last,
                q: q.to_vec(),
                tau: tau.to_vec(),
                touch,
            };
            text += &serde_json::to_string(&sample)?;
            text.push('\n');
        }
        begin = last + 1.0;
    }
    Ok(text)
}

/// Runs until the stream ends, by itself or by Ctrl-C.
fn stream(
    node: &mut Node,
    args: &Args,
    played: Option<&[&Sequence]>,
    console: &Console,
) -> anyhow::Result<()> {
    let queue = node.queue();
    let end = Arc::clone(&queue);
    interrupt::first(move || end.close());
    let mut out: Box<dyn Write> = if console.reports() {
        Box::new(stdout())
    } else {
        Box::new(sink())
    };
    let refuse = |line: u64, why: &str| complain(format_args!("line {line}: {why}"));
    match (args.udp, played) {
        (_, Some(sequences)) => {
            let lines = Lines(Cursor::new(lines(sequences)?));
            feed(node, &queue, lines, &mut out, refuse)
        }
        (None, _) => feed(
            node,
            &queue,
            Lines(BufReader::new(stdin())),
            &mut out,
            refuse,
        ),
        (Some(address), _) => {
            let socket = UdpSocket::bind(address)
                .with_context(|| format!("--udp {address}: cannot listen there"))?;
            socket.set_read_timeout(args.idle.map(|s| Duration::from_secs(s.into())))?;
            feed(node, &queue, Datagrams(socket), &mut out, refuse)
        }
    }
    .context("the stream broke")
}

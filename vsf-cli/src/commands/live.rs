mod kept;
mod played;
mod printer;
mod start;

use crate::console::{Console, complain, number, plural};
use crate::corrected::{CorrectedModel, ModelArgs};
use crate::exit::{message, usage};
use crate::field_file::{FieldFormat, claim, save};
use crate::interrupt;
use crate::range::{minutes, rate, whole};
use crate::recording::{RecordingArgs, SplitPart};
use crate::settings::EstimatorSettings;
use anyhow::Context;
use kept::Kept;
use played::Played;
use printer::Printer;
use serde::Serialize;
use start::Start;
use std::io::{BufReader, IsTerminal, stdin};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};
use vsf::core::{Noise, Session};
use vsf::data::{Dataset, Sequence, StiffnessField, TorqueKind, listed};
use vsf::gap::LiveCorrector;
use vsf::pipeline::live::{
    Counts, Datagrams, Learner, Lines, LiveSession, Node, Options, Source, Stiffness, Summary,
    WhenFull, run as feed,
};
use vsf::pipeline::{EstimatorSpec, Scene, health_warnings};
use vsf::robots::JointTorques;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each sample is a line, or a datagram, of JSON:

  {\"t\": 12.345, \"q\": [0.1, 0.2], \"tau\": [0.3, 0.4]}

  t           time [s]
  q           joint positions [rad or m], in the order of the robot's
              joints
  tau         torques [N m or N] of the recording's torque_kind: external
              (of the environment on the robot) or measured (at the
              actuators; what the arm itself needs is removed)

Optional keys:

  qd          joint velocities, used with measured torques and with
              --model; if missing, estimated from the slope of the
              positions over the last 25 ms, at least five samples; it
              lags by half of that time
  touch       a number that changes where a touch begins
  sequence    a number that grows where the clock or the sensors start
              anew

The robot, its points and contact come from a recording. One sequence is enough, or a planned motion (`vsf \
import --planned`).

A gap in which the arm moved ends a touch if it is longer than 0.1 s and at least two samples are missing. If \
the beginning of a touch was not seen (the arm is already inside the object), samples are skipped, and nothing is learned, until the arm has been in free air.

Prior and noise that are not given are chosen from the recording's train sequences, as in `vsf estimate`. Each \
reading then counts as independent of the others. Give a larger --noise-sd if the stream is much faster than \
the recording (a warning at the end says so), or touches one place over and over; otherwise the field is \
overconfident.

Summaries are lines of JSON on standard output:

  t           time of the last sample [s]
  contacts    points touched now
  touched     points touched so far, those of --field included
  stiffness   mean, sd and max of the touched points [N/m]
  residual    root mean square, since the last summary, of the norm of
              the residual before the update; null without a sample
  nis_ratio   of the samples in contact since the start; 1 if the filter's
              uncertainty is right
  slowest_ms  longest step
  received, refused, dropped, repeated, late, stray, tared, skipped,
  used, missing, gaps, restarts
              counts of samples: dropped ones came faster than they were
              learned, stray ones have a time that fits no other, and at
              a restart the clock went back

Summaries follow the clock of the samples. Those that nobody reads are left out, except with --wait, --play or \
a file as input, which wait for their reader.

The stream ends with the pipe, with an empty datagram, after --idle, or by Ctrl-C. Then the field is written \
(exit code 0; if nothing was learned or touched, there is no field, and the code is 1), and warnings tell what \
looks wrong with the samples (of a long stream, with parts from all over it).

JSON keys: points, touched, stiffness, nis_ratio, the counts, out.")]
pub struct Args {
    /// Read samples as UDP datagrams at an address of this machine, such as 127.0.0.1:9000, instead of lines on
    /// standard input
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = loopback)]
    udp: Option<SocketAddr>,
    /// Play the sequences of the recording itself, one after the other, as fast as possible: a test without a
    /// stream
    #[arg(long, conflicts_with_all = ["udp", "wait"])]
    play: bool,
    /// IDs of the sequences to play; default: the train split
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// End after this time without a datagram [s]; default: never
    #[arg(long, value_name = "SECONDS", value_parser = whole(1_u32..=86_400))]
    idle: Option<u32>,
    /// Make the sender of a pipe wait instead of dropping samples; files always wait
    #[arg(long, conflicts_with = "udp")]
    wait: bool,
    /// Rate of the summaries [Hz]
    #[arg(long, default_value_t = Options::default().publish_hz, value_parser = rate)]
    publish_hz: f64,
    /// Number of contact-free samples at the start of each sequence whose mean reading is taken as zero; default:
    /// the recording's tare_samples
    #[arg(long, value_name = "SAMPLES", conflicts_with = "play", value_parser = whole(0_u64..=1_000_000))]
    tare: Option<u64>,
    /// Output for the field at the end, by ending: .npz, .ply, .mcap, or none for a folder (new, empty, or with a
    /// field to replace)
    #[arg(long, required_unless_present = "play")]
    out: Option<PathBuf>,
    /// Also write the field at this interval [min], with the next summary; samples wait meanwhile
    #[arg(long, value_name = "MINUTES", requires = "out", value_parser = minutes)]
    save_every: Option<f64>,
    /// Earlier field of the recording's points to continue from, with its prior and noise
    #[arg(long)]
    field: Option<PathBuf>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    recording: RecordingArgs,
    #[command(flatten)]
    estimator: EstimatorSettings,
}

/// Bad lines are told so often; their count is in the summaries.
const MOST_TOLD: u32 = 10;
/// Share of the samples from which on it is told that they are left out.
const MANY: f64 = 0.05;
/// A stream is much quicker than a recording with so many times its samples a second.
const MUCH_QUICKER: f64 = 2.0;

/// What is known in the end.
#[derive(Serialize)]
struct Report {
    points: usize,
    touched: usize,
    stiffness: Stiffness,
    nis_ratio: Option<f64>,
    #[serde(flatten)]
    counts: Counts,
    out: Option<String>,
}

/// The stream is not protected: it stays on this machine.
fn loopback(text: &str) -> Result<SocketAddr, String> {
    let found = text.to_socket_addrs().ok().and_then(|mut all| all.next());
    let address = found.ok_or("must be ADDRESS:PORT")?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("must be an address of this machine, such as 127.0.0.1:9000".to_owned())
    }
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    // The parser's `requires` does not ask for what conflicts with --wait.
    for (flag, given, other, taken) in [
        ("--sequences", args.sequences.is_some(), "--play", args.play),
        ("--idle", args.idle.is_some(), "--udp", args.udp.is_some()),
    ] {
        if given && !taken {
            return Err(usage(format!("{flag} is for {other}, which is missing")));
        }
    }
    if let Some(out) = &args.out {
        FieldFormat::check_estimate(out)?;
        claim(out, console)?;
    }
    if args.udp.is_none() && !args.play && stdin().is_terminal() {
        return Err(usage(
            "no samples: pipe lines of JSON into this command, or give --udp or --play; see --help",
        ));
    }
    let settings = args.estimator.online();
    let EstimatorSpec::Online { filter, robust } = settings.spec()? else {
        return Err(usage(
            "--estimator: `batch` takes all readings at once; choose one that learns sample by sample, such as `replay`",
        ));
    };
    if settings.vision()?.is_some() {
        return Err(usage(
            "--vision: untouched points are guessed by `vsf estimate`, whose field --field takes",
        ));
    }
    let model = args.model.open(console)?;
    let recording = args.recording.open_to_stream(console)?;
    let dataset = &recording.dataset;
    let (scene, start) = match &args.field {
        None => Start::anew(&settings, &recording, model.as_ref(), console)?,
        Some(path) => Start::go_on(path, &settings, &recording, model.as_ref(), console)?,
    };
    let played = if args.play {
        Some(recording.sequences(args.sequences.as_deref(), SplitPart::Train)?)
    } else {
        None
    };
    let learned = start.learned_from.iter().flatten();
    let again: Vec<&str> = (learned.map(String::as_str))
        .filter(|id| played.iter().flatten().any(|s| s.id == *id))
        .collect();
    if !again.is_empty() {
        console.warn(format!(
            "the field has learned from sequences that are played to it again ({}): their readings count twice, and its standard \
             deviations come out too small",
            listed(&again)
        ));
    }
    let noise = Noise::per_channel(&start.hyper.noise_sd)?;
    let prior = start.prior.clone();
    let place = || match &args.field {
        Some(path) => path.display().to_string(),
        None => "--prior-sd".to_owned(),
    };
    let live = Live {
        args,
        dataset,
        played,
        scene: &scene,
        start: &start,
        model: model.as_ref(),
        console,
    };
    match &model {
        Some(model) => {
            let corrector = model.corrector(dataset, &scene, console)?;
            let filter = filter.build::<f64>(prior, robust).with_context(place)?;
            live.run(LiveCorrector::new(corrector, filter, noise)?)
        }
        None => {
            let robot = scene.robot();
            let filter = filter.build::<f32>(prior, robust).with_context(place)?;
            let contact = scene.contact_model()?;
            let (chains, rest) = (robot.chains().clone(), scene.rest().clone());
            let sensor = JointTorques::new(noise);
            let session = Session::new(chains, rest, contact, sensor, filter)?;
            let gravity = (dataset.torque_kind == TorqueKind::Measured).then_some(dataset.gravity);
            live.run(LiveSession::new(robot.clone(), session, gravity)?)
        }
    }
}

/// What is to be done, whatever learns.
struct Live<'a> {
    args: &'a Args,
    dataset: &'a Dataset,
    played: Option<Vec<&'a Sequence>>,
    scene: &'a Scene,
    start: &'a Start,
    model: Option<&'a CorrectedModel>,
    console: &'a Console,
}

impl Live<'_> {
    /// Learns until the stream ends, and writes the field.
    fn run<L: Learner>(&self, learner: L) -> anyhow::Result<()> {
        let options = Options {
            publish_hz: self.args.publish_hz,
            when_full: if self.waits() {
                WhenFull::Wait
            } else {
                WhenFull::DropOldest
            },
            tare: (self.args.tare).unwrap_or(self.dataset.tare_samples as u64),
            ..Options::default()
        };
        let mut node = Node::new(Kept::new(learner), self.start.touched.clone(), options)?;
        let ran = self.stream(&mut node);
        let counts = *node.counts();
        self.warn_of_losses(&counts);
        if counts.used == 0 {
            ran?;
            let tared = match counts.tared {
                0 => "",
                _ => {
                    "; it begins with fewer samples in free air than --tare (or tare_samples of the recording) takes"
                }
            };
            anyhow::bail!(
                "the stream had no sample to learn from ({}){tared}; no field is written",
                told(&counts)
            );
        }
        if node.health().updates() == 0 {
            ran?;
            // Why they do may be told by their motions.
            self.check(node.learner())?;
            anyhow::bail!(
                "the stream touched none of the {} points ({}); no field is written: check the order and units of q, base_pose and the robot",
                self.scene.rest().len(),
                told(&counts)
            );
        }
        // What was learned until then is not lost where the stream breaks.
        let saved = self.save(&node);
        if let Err(error) = self.check(node.learner()) {
            let error = message(&error);
            (self.console).warn(format_args!("the samples cannot be checked: {error}"));
        }
        self.warn_of_rate(node.learner());
        self.conclude(&mut node, ran, saved)
    }

    /// Warns of samples that nothing was learned from.
    fn warn_of_losses(&self, counts: &Counts) {
        let untimely = counts.repeated + counts.late + counts.stray;
        if untimely as f64 > MANY * counts.received as f64 {
            self.console.warn(format_args!(
                "{untimely} of {} samples were left out for their time: {} with that of the one before, {} late, {} of a time that \
                 fits no other; t is in seconds, as fine as the samples, grows from one to the next, and has one clock",
                counts.received, counts.repeated, counts.late, counts.stray
            ));
        }
        if counts.dropped > 0 {
            self.console.warn(format_args!(
                "{} samples were dropped, since they came more quickly than they were learned; give --wait where their sender can \
                 wait, or a lower --replay",
                counts.dropped
            ));
        }
        if counts.skipped > 0 {
            self.console.warn(format_args!(
                "nothing was learned from {} samples in touches whose beginning was not seen: the stream, or a sequence of it, \
                 began in contact, or samples were missing in a touch ({} gap{})",
                counts.skipped,
                counts.gaps,
                plural(counts.gaps as usize)
            ));
        }
    }

    /// Warns of what looks wrong with the samples.
    fn check<L: Learner>(&self, kept: &Kept<L>) -> anyhow::Result<()> {
        let spinner = self.console.spinner("checking the samples");
        let warnings = kept.warnings(self.dataset, self.scene, self.model);
        spinner.finish_and_clear();
        self.console.warn_all(warnings?);
        Ok(())
    }

    /// Warns where the noise was chosen by samples that were much further apart.
    fn warn_of_rate<L: Learner>(&self, kept: &Kept<L>) {
        let steps = self.start.step_of_noise.zip(kept.step());
        let Some((chosen, step)) = steps.filter(|(chosen, step)| *chosen > MUCH_QUICKER * step)
        else {
            return;
        };
        let times = (chosen / step).sqrt();
        let noise = self.start.hyper.noise_sd.iter();
        let noise: Vec<String> = noise.map(|sd| number(times * sd)).collect();
        self.console.warn(format_args!(
            "the stream has {} samples a second, the train sequences that its noise was chosen by have {}: readings so close to each \
             other share their errors, so that the field may be up to {times:.1} times too sure; --noise-sd {} has a second of them \
             tell as much",
            (10.0 / step).round() / 10.0,
            (10.0 / chosen).round() / 10.0,
            noise.join(",")
        ));
    }

    /// Tells what is known in the end.
    fn conclude<L: Learner>(
        &self,
        node: &mut Node<Kept<L>>,
        ran: anyhow::Result<()>,
        saved: anyhow::Result<()>,
    ) -> anyhow::Result<()> {
        let Self {
            args,
            scene,
            console,
            ..
        } = self;
        let counts = *node.counts();
        let Summary {
            touched,
            stiffness,
            nis_ratio,
            ..
        } = node.summary();
        let report = Report {
            points: scene.rest().len(),
            touched,
            stiffness,
            nis_ratio,
            counts,
            out: (args.out.as_ref()).map(|out| out.to_string_lossy().into_owned()),
        };
        let wrote = report.out.as_ref().filter(|_| saved.is_ok());
        let wrote = wrote.map(|out| format!(": wrote {out}"));
        console.remark(format_args!(
            "{}; {touched} of {} points touched{}",
            told(&counts),
            report.points,
            wrote.unwrap_or_default()
        ));
        console.warn_all(health_warnings(node.health()));
        saved?;
        ran?;
        console.json_and(&report, Vec::new())
    }

    /// Sequences that the field has learned from, where that is known.
    fn learned_from(&self) -> Option<Vec<String>> {
        let played = self.played.iter().flatten().map(|s| s.id.clone());
        let mut all = self.start.learned_from.clone().unwrap_or_default();
        for id in played {
            if !all.contains(&id) {
                all.push(id);
            }
        }
        (!all.is_empty()).then_some(all)
    }

    /// Whether samples wait for the estimation, not it for them.
    fn waits(&self) -> bool {
        self.args.wait || self.args.play || self.args.udp.is_none() && is_file()
    }

    /// Runs until the stream ends, by itself or by Ctrl-C.
    fn stream<L: Learner>(&self, node: &mut Node<Kept<L>>) -> anyhow::Result<()> {
        if let Some(sequences) = &self.played {
            let ids: Vec<&str> = sequences.iter().map(|s| s.id.as_str()).collect();
            let from = format!("playing {}", listed(&ids));
            return self.take(node, Played::new(sequences), [&from, "sample"]);
        }
        let Some(address) = self.args.udp else {
            let lines = Lines(BufReader::new(stdin()));
            return self.take(node, lines, ["reading standard input", "line"]);
        };
        let bound = UdpSocket::bind(address);
        let socket = bound.with_context(|| format!("--udp {address}: cannot listen there"))?;
        let from = format!("listening at {}", socket.local_addr()?);
        let idle = self.args.idle.map(|s| Duration::from_secs(s.into()));
        let source = Datagrams::new(socket, idle)?;
        self.take(node, source, [&from, "datagram"])
    }

    fn take<L: Learner>(
        &self,
        node: &mut Node<Kept<L>>,
        source: impl Source + Send + 'static,
        [from, part]: [&str; 2],
    ) -> anyhow::Result<()> {
        self.console.remark(self.introduction(from));
        let queue = node.new_queue();
        let end = Arc::clone(&queue);
        let interrupted = Arc::new(AtomicBool::new(false));
        let flag = Arc::clone(&interrupted);
        interrupt::first(move || {
            complain("ending; a second Ctrl-C ends at once, without the field");
            flag.store(true, Ordering::Relaxed);
            end.close();
        });
        let interrupted = || interrupted.load(Ordering::Relaxed);
        let mut printer = Printer::new(self.console.reports(), self.waits());
        let mut saved = Instant::now();
        let publish = |node: &Node<Kept<L>>, summary: &Summary| {
            printer.print(serde_json::to_string(summary)?, interrupted);
            if let Some(minutes) = self.args.save_every
                && saved.elapsed() >= Duration::from_secs_f64(60.0 * minutes)
            {
                saved = Instant::now();
                // It may succeed the next time.
                if let Err(error) = self.save(node) {
                    complain(format_args!("warning: not saved: {}", message(&error)));
                }
            }
            Ok(())
        };
        let (count, part) = (AtomicU32::new(0), part.to_owned());
        let refuse = move |number: u64, why: &str| {
            match count.fetch_add(1, Ordering::Relaxed) {
                k if k < MOST_TOLD => complain(format_args!("warning: {part} {number}: {why}")),
                MOST_TOLD => complain(format_args!(
                    "warning: further {part}s are refused; summaries count them"
                )),
                _ => {}
            };
        };
        let done = feed(node, &queue, source, publish, refuse);
        printer.finish(interrupted);
        done.context("the stream broke")
    }

    /// Writes what is known, if it is to be.
    fn save<L: Learner>(&self, node: &Node<L>) -> anyhow::Result<()> {
        let Some(out) = &self.args.out else {
            return Ok(());
        };
        // Something else may have come there meanwhile.
        let is_ours = FieldFormat::check(out);
        let (hyper, name) = (&self.start.hyper, &self.dataset.name);
        let field = node.estimate()?.to_field(self.scene, hyper, name, &[])?;
        let field = StiffnessField {
            // A model without effects is the nominal one.
            model: (self.model.map(CorrectedModel::text)).filter(|text| !text.is_empty()),
            learned_from: self.learned_from(),
            ..field
        };
        let Err(error) = is_ours.and_then(|()| save(&field, out)) else {
            return Ok(());
        };
        // Hours may be in it.
        let elsewhere = std::env::temp_dir().join(format!("vsf-live-{}.npz", std::process::id()));
        match save(&field, &elsewhere) {
            Ok(()) => Err(error.context(format!("the field is in {}", elsewhere.display()))),
            Err(_) => Err(error),
        }
    }

    /// What is about to happen, in a line.
    fn introduction(&self, from: &str) -> String {
        let Self {
            dataset,
            scene,
            start,
            ..
        } = self;
        let names: Vec<&str> = scene.robot().joints().iter().map(|j| j.name()).collect();
        let torques = match dataset.torque_kind {
            TorqueKind::Measured => "at the actuators (measured)",
            _ => "of the environment on the robot (external)",
        };
        let noise: Vec<String> = start.hyper.noise_sd.iter().map(|&sd| number(sd)).collect();
        format!(
            "{from}: torques {torques} of joint{} {}; {} points, prior sd {} N/m, noise sd {} {}",
            plural(names.len()),
            names.join(", "),
            scene.rest().len(),
            number(start.hyper.prior_sd),
            noise.join(", "),
            scene.error_unit()
        )
    }
}

/// Counts in words, those that are zero left out.
fn told(counts: &Counts) -> String {
    let kinds = [
        ("refused", counts.refused),
        ("dropped", counts.dropped),
        ("repeated", counts.repeated),
        ("late", counts.late),
        ("stray", counts.stray),
        ("tared", counts.tared),
        ("skipped", counts.skipped),
        ("missing", counts.missing),
        ("restarts of the clock", counts.restarts),
    ];
    let others = kinds.iter().filter(|(_, count)| *count > 0);
    let others: String = others
        .map(|(kind, count)| format!(", {count} {kind}"))
        .collect();
    format!(
        "{} of {} samples used{others}",
        counts.used, counts.received
    )
}

/// Whether standard input is a file, which can wait.
fn is_file() -> bool {
    #[cfg(unix)]
    {
        use std::os::fd::AsFd;
        let input = stdin().as_fd().try_clone_to_owned();
        let file = input.map(std::fs::File::from);
        file.and_then(|f| f.metadata()).is_ok_and(|m| m.is_file())
    }
    #[cfg(not(unix))]
    false
}

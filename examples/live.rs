//! Question: can a field be learned from a stream of 1 kHz that is not perfect?
//!
//! A node takes lines of JSON, `{"t": 12.345, "q": [..], "tau": [..]}`, from standard input or from
//! datagrams on this machine, feeds a session, and writes what it knows of the field as lines of JSON.
//! Torques are those of the environment on the robot, gravity removed; where the number `"touch"` changes, a new
//! touch begins. Without a source the node feeds itself: a Kinova Gen3 pushes into a block of foam twice, sent
//! as datagrams at 1 kHz, some of them twice, late, missing or broken.
//!
//! ```sh
//! cargo run --release -p vsf-examples --example live -- out/live.jsonl
//! cargo run --release -p vsf-examples --example live -- --recording my_recording --udp 127.0.0.1:9000
//! my_driver | cargo run --release -p vsf-examples --example live -- --recording my_recording --stdin
//! ```
//!
//! Answer: yes. 1978 of 1981 lines are used, none is dropped, and the line with NaN, the repeated and the late one
//! are counted and change nothing. The slowest steps of three runs take 0.3, 0.3 and 0.8 ms of the millisecond there
//! is. The residual in the last tenth of a second of a push falls from 0.34 N m in the first to 0.16 N m in the
//! second, of which 0.13 N m are the noise of the sensors. The end of each push says that the filter is too sure
//! (`nis_ratio` 1.45), as in `online_session`.
//!
//! How it works is in `examples/src/live.rs`.

use clap::Parser;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use std::error::Error;
use std::fs::File;
use std::io::{self, BufReader, Write};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use vsf::contact::link_sdfs;
use vsf::core::nalgebra::Point3;
use vsf::data::{Dataset, Overrides, TorqueKind};
use vsf::pipeline::{Estimate, Hyper, PriorShape, Scene, SceneContact, SceneOptions};
use vsf::plot::{Curve, CurvePlot};
use vsf::prelude::*;
use vsf::robots::kinova_gen3;
use vsf_examples::live::{Datagrams, Lines, LiveSession, Node, Options, WhenFull, run};
use vsf_examples::write_picture;

/// A node that estimates a field from a stream of samples.
#[derive(Parser)]
struct Args {
    /// Where summaries go, such as live.jsonl; standard output by default. Of the node that feeds itself, a picture of
    /// the residuals comes beside them, in a .png of the same name
    #[arg(value_parser = no_picture)]
    out: Option<PathBuf>,
    /// Recording whose robot and points are taken; a block before a Kinova Gen3 by default
    #[arg(long)]
    recording: Option<PathBuf>,
    /// Where the field goes when the stream ends, with --recording: a .npz for `vsf evaluate`, `vsf predict` and others. A
    /// stream of datagrams ends by --idle or an empty one; what is stopped by Ctrl-C writes no field
    #[arg(long, requires = "recording", value_name = "NPZ", value_parser = archive)]
    field: Option<PathBuf>,
    /// Take lines from standard input
    #[arg(long, conflicts_with = "udp")]
    stdin: bool,
    /// Take datagrams at an address of this machine, such as 127.0.0.1:9000
    #[arg(long, value_parser = loopback)]
    udp: Option<SocketAddr>,
    /// End after so many seconds without a datagram; never by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
    idle: Option<u32>,
    /// Hold the sender of a pipe back instead of dropping samples
    #[arg(long)]
    wait: bool,
    /// Rate of the samples [Hz]
    #[arg(long, default_value_t = 1000.0)]
    rate_hz: f64,
    /// Summaries a second
    #[arg(long, default_value_t = 10.0)]
    publish_hz: f64,
    /// Prior standard deviation of the stiffness [N/m]
    #[arg(long, default_value_t = 30.0)]
    prior_sd: f64,
    /// Standard deviation of the readings [N m or N], model error included
    #[arg(long, default_value_t = 0.05)]
    noise_sd: f64,
}

/// A place that can be written to, before there is anything to write.
fn archive(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let above = path.parent().filter(|p| !p.as_os_str().is_empty());
    if path.extension().is_none_or(|e| e != "npz") {
        Err("must be a .npz".to_owned())
    } else if above.is_some_and(|folder| !folder.is_dir()) {
        Err("must be in a folder that is there".to_owned())
    } else {
        Ok(path)
    }
}

/// The picture would replace the summaries.
fn no_picture(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    if path.extension().is_some_and(|e| e == "png") {
        Err("must be a file of lines, such as live.jsonl".to_owned())
    } else {
        Ok(path)
    }
}

/// The stream is not protected: it stays on this machine.
fn loopback(text: &str) -> Result<SocketAddr, String> {
    let address: SocketAddr = text.parse().map_err(|_| "must be ADDRESS:PORT")?;
    if address.ip().is_loopback() {
        Ok(address)
    } else {
        Err("must be an address of this machine, such as 127.0.0.1".to_owned())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let scene = args.recording.as_deref().map(scene_of).transpose()?;
    let (robot, rest, contact) = match &scene {
        Some((_, scene)) => (
            scene.robot().clone(),
            scene.rest().clone(),
            scene.contact_model()?,
        ),
        None => block_and_arm()?,
    };
    let sensor = JointTorques::new(Noise::uniform(robot.joint_count(), args.noise_sd)?);
    let prior = Belief::uniform(rest.len(), 0.0, args.prior_sd)?;
    let filter = MemoryReplay::new(DiagonalKalman::new(prior), Default::default())?;
    let session = LiveSession::new(robot.chains().clone(), rest, contact, sensor, filter)?;
    let options = Options {
        rate_hz: args.rate_hz,
        publish_hz: args.publish_hz,
        when_full: if args.wait {
            WhenFull::Wait
        } else {
            WhenFull::DropOldest
        },
        ..Options::default()
    };
    let node = Node::new(robot, session, options)?;
    let mut out: Box<dyn Write> = match &args.out {
        Some(path) => {
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            Box::new(File::create(path)?)
        }
        None => Box::new(io::stdout()),
    };
    let refuse = |number: u64, why: &str| eprintln!("line {number}: {why}");
    let save = |node: &Node| match (&args.field, &scene) {
        (Some(path), Some((name, scene))) => save_field(path, node, name, scene, &args),
        _ => Ok(()),
    };
    if args.stdin {
        let mut lines = Lines(BufReader::new(io::stdin()));
        return save(&run(node, &mut lines, &mut out, &refuse)?);
    }
    let socket = UdpSocket::bind(args.udp.unwrap_or((Ipv4Addr::LOCALHOST, 0).into()))?;
    let idle = args.idle.map(|s| Duration::from_secs(s.into()));
    socket.set_read_timeout(idle)?;
    if args.udp.is_some() {
        return save(&run(node, &mut Datagrams(socket), &mut out, &refuse)?);
    }
    if args.recording.is_some() {
        return Err("a recording says nothing of the stream: give --stdin or --udp".into());
    }
    let address = socket.local_addr()?;
    let lines = demonstration()?;
    let sender = std::thread::spawn(move || send(&lines, address));
    run(node, &mut Datagrams(socket), &mut out, &refuse)?;
    sender.join().map_err(|_| "the sender crashed")??;
    drop(out);
    match &args.out {
        Some(path) => draw(path),
        None => Ok(()),
    }
}

/// Name of a recording, and its robot, points and contact.
fn scene_of(folder: &Path) -> Result<(String, Scene), Box<dyn Error>> {
    let (dataset, warnings) = Dataset::open(folder, &Overrides::default())?;
    warnings.iter().for_each(|w| eprintln!("warning: {w}"));
    if dataset.torque_kind == TorqueKind::Measured {
        eprintln!(
            "warning: torques of the recording are those at the actuators; those of the stream are taken to be of the \
             environment on the robot, gravity removed"
        );
    }
    let scene = Scene::open(&dataset, &SceneOptions::default())?.with_suited_threshold()?;
    Ok((dataset.name, scene))
}

/// Writes what a node knows of the field.
fn save_field(
    path: &Path,
    node: &Node,
    recording: &str,
    scene: &Scene,
    args: &Args,
) -> Result<(), Box<dyn Error>> {
    let belief = node.session().belief();
    let widen = |values: &[f32]| values.iter().map(|v| f64::from(*v)).collect();
    let estimate = Estimate {
        belief: Belief::new(widen(belief.mean()), widen(belief.variance()))?,
        touched: node.touched().to_vec(),
        health: *node.session().health(),
    };
    let hyper = Hyper {
        prior_sd: args.prior_sd,
        shape: PriorShape::independent(),
        noise_sd: vec![args.noise_sd; node.joints()],
    };
    let mut field = estimate.to_field(scene, &hyper, recording, &[])?;
    // Of a stream, not of its sequences.
    field.learned_from = None;
    field.save_npz(path)?;
    eprintln!("wrote {}", path.display());
    Ok(())
}

/// Draws the residuals of summaries.
fn draw(summaries: &Path) -> Result<(), Box<dyn Error>> {
    let (mut time, mut residual) = (Vec::new(), Vec::new());
    for line in std::fs::read_to_string(summaries)?.lines() {
        let summary: Value = serde_json::from_str(line)?;
        if let (Some(t), Some(r)) = (summary["t"].as_f64(), summary["residual"].as_f64()) {
            time.push(t);
            residual.push(r);
        }
    }
    let picture = summaries.with_extension("png");
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    write_picture(picture.parent(), &name, || {
        let curve = Curve {
            name: "what the node publishes",
            x: &time,
            y: &residual,
            ..Curve::default()
        };
        let plot = CurvePlot {
            curves: &[curve],
            title: "Two pushes in a stream of 1 kHz",
            x_label: "time [s]",
            y_label: "residual before the update, rms over 0.1 s [N m]",
            log_y: false,
        };
        plot.png()
    })
}

/// Sends a line every millisecond, then the end.
fn send(lines: &[String], to: SocketAddr) -> io::Result<()> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let begin = Instant::now();
    for (k, line) in lines.iter().enumerate() {
        let due = begin + Duration::from_millis(k as u64);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        socket.send_to(line.as_bytes(), to)?;
    }
    socket.send_to(b"", to)?;
    Ok(())
}

type Parts = (Arc<RobotModel>, Arc<RestPoints>, SceneContact);

/// A Kinova Gen3 before a cube of 40 cm with 2744 points.
fn block_and_arm() -> Result<Parts, Box<dyn Error>> {
    let at = |from: f64, i: usize| from + 0.4 * (i as f64 + 0.5) / 14.0;
    let block = (0..14 * 14 * 14)
        .map(|i| Point3::new(at(0.43, i / 196), at(-0.2, i / 14 % 14), at(0.08, i % 14)));
    let robot = Arc::new(kinova_gen3()?);
    let links = link_sdfs(robot.colliders(), &Default::default())?.links;
    let contact = StickSlip::new(links, Default::default())?;
    Ok((
        robot,
        Arc::new(RestPoints::new(block.collect())?),
        SceneContact::Points(contact),
    ))
}

/// Two pushes of a second each as lines, with all that can go wrong on the way.
fn demonstration() -> Result<Vec<String>, Box<dyn Error>> {
    const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
    const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
    let (robot, rest, contact) = block_and_arm()?;
    let truth = (rest.positions().iter()).map(|p| if p.y < 0.0 { 10.0 } else { 30.0 });
    let truth = Belief::<f64>::new(truth.collect(), vec![1e-6; rest.len()])?;
    let sensor = JointTorques::new(Noise::uniform(7, 0.05)?);
    let (chains, known) = (robot.chains().clone(), DiagonalKalman::new(truth));
    let mut block = Session::new(chains, rest, contact, sensor, known)?;
    let (noise, mut rng) = (Normal::new(0.0, 0.05)?, Pcg64Mcg::seed_from_u64(1));
    let (mut posture, mut reading) = (robot.posture(), Prediction::default());
    let mut lines = Vec::new();
    for k in 0..2000 {
        let s = (k % 1000) as f64 / 999.0;
        let q: Vec<f64> = START
            .iter()
            .zip(END)
            .map(|(a, b)| a + s * (b - a))
            .collect();
        if k % 1000 == 0 {
            block.begin_touch();
        }
        robot.update_posture(&q, &mut posture)?;
        block.predict(&posture, &mut reading)?;
        let tau: Vec<f64> = (reading.mean.iter())
            .map(|t| t + noise.sample(&mut rng))
            .collect();
        let (t, touch) = (0.001 * f64::from(k), k / 1000);
        let line = format!("{{\"t\": {t}, \"q\": {q:?}, \"tau\": {tau:?}, \"touch\": {touch}}}");
        match k {
            300..320 => {}
            400 => lines.push(line.replacen("\"tau\": [", "\"tau\": [NaN, ", 1)),
            500 => lines.extend([line.clone(), line]),
            _ => lines.push(line),
        }
    }
    lines.swap(600, 601);
    Ok(lines)
}

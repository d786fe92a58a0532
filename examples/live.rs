//! Question: can a field be learned from a stream of 1 kHz that is not perfect?
//!
//! A Kinova Gen3 pushes into a block of foam twice. Its samples, lines of JSON `{"t": 12.345, "q": [..], "tau": [..]}`,
//! are sent as datagrams at 1 kHz, some of them twice, late, missing or broken; a node takes them and
//! publishes what it knows of the field.
//!
//! ```sh
//! cargo run --release -p vsf-examples --example live -- out/live.jsonl
//! ```
//!
//! Answer: yes. 1978 of 1981 lines are used, none is dropped, and the line with NaN, the repeated and the late one
//! are counted and change nothing. The slowest steps of three runs take 0.3, 0.3 and 0.8 ms of the millisecond there
//! is. The residual in the last tenth of a second of a push falls from 0.34 N m in the first to 0.16 N m in the
//! second, of which 0.13 N m are the noise of the sensors. The end of each push says that the filter is too sure
//! (`nis_ratio` 1.49), as in `online_session`.
//!
//! A robot and a recording of your own: `vsf live`.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use std::error::Error;
use std::fs::File;
use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use vsf::contact::link_sdfs;
use vsf::core::nalgebra::Point3;
use vsf::pipeline::live::{Datagrams, LiveSession, Node, Summary, run};
use vsf::pipeline::{FilterSpec, SceneContact};
use vsf::plot::{Curve, CurvePlot};
use vsf::prelude::*;
use vsf::robots::kinova_gen3;
use vsf_examples::write_picture;

/// With an argument, summaries go there, and a picture of their residuals beside them.
fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os().nth(1).map(PathBuf::from);
    let mut out: Box<dyn Write> = match &path {
        Some(path) => {
            path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
            Box::new(File::create(path)?)
        }
        None => Box::new(io::stdout()),
    };
    let (robot, rest, contact) = block_and_arm()?;
    let sensor = JointTorques::new(Noise::uniform(robot.joint_count(), 0.05)?);
    let prior = Belief::<f64>::uniform(rest.len(), 0.0, 30.0)?;
    let filter = FilterSpec::replay().build::<f32>(prior.into(), None)?;
    let session = Session::new(robot.chains().clone(), rest, contact, sensor, filter)?;
    let session = LiveSession::new(robot, session, None)?;
    let mut node = Node::new(session, Vec::new(), Default::default())?;

    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    let (address, lines) = (socket.local_addr()?, demonstration()?);
    let sender = std::thread::spawn(move || send(&lines, address));
    let (queue, source) = (node.new_queue(), Datagrams::new(socket, None)?);
    let (mut time, mut residual) = (Vec::new(), Vec::new());
    let publish = |_: &Node<_>, summary: &Summary| {
        time.push(summary.t);
        residual.push(summary.residual.unwrap_or(f64::NAN));
        writeln!(out, "{}", serde_json::to_string(summary)?)
    };
    run(&mut node, &queue, source, publish, |line, why| {
        eprintln!("line {line}: {why}");
    })?;
    sender.join().map_err(|_| "the sender crashed")??;
    let picture = path.map(|path| path.with_extension("png"));
    picture.map_or(Ok(()), |picture| draw(&picture, &time, &residual))
}

/// Draws the residuals of summaries.
fn draw(picture: &Path, time: &[f64], residual: &[f64]) -> Result<(), Box<dyn Error>> {
    let name = picture.file_name().unwrap_or_default().to_string_lossy();
    write_picture(picture.parent(), &name, || {
        let curve = Curve {
            name: "what the node publishes",
            x: time,
            y: residual,
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

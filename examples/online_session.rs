//! Question: how fast do the residuals of a push fall while the field is being learned?
//!
//! A Kinova Gen3 pushes its wrist into a block of foam, twice at the same place. The block's
//! torques are simulated with noise of 0.05 N m; a session takes in one reading after the other, as
//! a control loop would.
//!
//! ```sh
//! cargo run --release -p vsf-examples --example online_session -- out
//! ```
//!
//! The folder is created; `residuals.png` in it shows the whole pushes. Without an argument no picture is written.
//!
//! Answer: the second push is predicted from the first. The residual before the update, with the hand at its
//! deepest (mean of the last six readings, of 3.1 N m), falls from 0.32 N m to 0.17 N m, of which 0.13 N m are the
//! noise of the sensors. The ratio of 1.38 between the found and the expected squared residuals says that the filter
//! is overconfident: it ignores that points touched together are correlated.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use vsf::contact::link_sdfs;
use vsf::core::nalgebra::Point3;
use vsf::plot::{Curve, CurvePlot};
use vsf::prelude::*;
use vsf::robots::kinova_gen3;
use vsf_examples::write_picture;

/// The tool points down and moves 16 cm forward, into the block.
const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
const STEPS: usize = 120;
/// Readings whose mean is a point of the picture.
const BLOCK: usize = 6;
const NOISE_SD: f64 = 0.05;

fn main() -> Result<(), Box<dyn Error>> {
    let rest = Arc::new(RestPoints::new(block())?);
    let truth = rest
        .positions()
        .iter()
        .map(|p| if p.y < 0.0 { 10.0 } else { 30.0 });
    let truth: Vec<f32> = truth.collect();

    let robot = kinova_gen3()?;
    let chains = robot.chains().clone();
    let links = link_sdfs(robot.colliders(), &Default::default())?.links;
    let contact = StickSlip::new(links, Default::default())?;
    let sensor = JointTorques::new(Noise::uniform(7, NOISE_SD)?);

    // The block itself is a session that knows the truth and is only asked for readings.
    let known = DiagonalKalman::new(Belief::new(truth, vec![1e-6; rest.len()])?);
    let mut block = Session::new(
        chains.clone(),
        rest.clone(),
        contact.clone(),
        sensor.clone(),
        known,
    )?;
    let prior = Belief::<f32>::uniform(rest.len(), 0.0, 30.0)?;
    let filter = MemoryReplay::new(DiagonalKalman::new(prior), Default::default())?;
    let mut session = Session::new(chains, rest, contact, sensor, filter)?;

    let noise = Normal::new(0.0, NOISE_SD)?;
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut posture = robot.posture();
    let mut reading = Prediction::default();
    let mut before = [Vec::new(), Vec::new()];
    println!("push  reading  contacts  torque N m  before N m  after N m");
    for push in 1..=2 {
        block.begin_touch();
        session.begin_touch();
        for step in 0..STEPS {
            let s = step as f64 / (STEPS - 1) as f64;
            let q: Vec<f64> = START
                .iter()
                .zip(END)
                .map(|(a, b)| a + s * (b - a))
                .collect();
            robot.update_posture(&q, &mut posture)?;
            block.predict(&posture, &mut reading)?;
            let tau: Vec<f64> = reading
                .mean
                .iter()
                .map(|t| t + noise.sample(&mut rng))
                .collect();

            let report = session.step(&posture, &tau)?;
            before[push - 1].push(report.prefit);
            if step % 20 == 19 {
                let size = tau.iter().map(|t| t * t).sum::<f64>().sqrt();
                println!(
                    "{push:4} {:8} {:9} {size:11.2} {:11.3} {:10.3}",
                    step + 1,
                    report.contacts,
                    report.prefit,
                    report.postfit
                );
            }
        }
    }
    let health = session.health();
    if let (Some(ratio), Some((low, high))) = (health.nis_ratio(), health.nis_ratio_interval()) {
        println!("NIS per channel {ratio:.2}; a consistent filter has {low:.2} to {high:.2}");
    }
    let means = before.map(|residuals| -> Vec<f64> {
        let blocks = residuals.chunks(BLOCK);
        blocks
            .map(|b| b.iter().sum::<f64>() / b.len() as f64)
            .collect()
    });
    for (push, means) in means.iter().enumerate() {
        let last = means.last().copied().unwrap_or_default();
        println!(
            "push {}: before N m {last:.3}, mean of the last {BLOCK} readings",
            push + 1
        );
    }
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    write_picture(folder.as_deref(), "residuals.png", || {
        let x: Vec<f64> = (1..=STEPS / BLOCK).map(|k| (k * BLOCK) as f64).collect();
        let noise = vec![NOISE_SD * 7f64.sqrt(); x.len()];
        let curve = |name, y| Curve {
            name,
            x: &x,
            y,
            ..Curve::default()
        };
        let plot = CurvePlot {
            curves: &[
                curve("first push", &means[0]),
                curve("second push", &means[1]),
                curve("noise of the seven sensors", &noise),
            ],
            title: "What is not foreseen of a push, while the field is being learned",
            x_label: "reading",
            y_label: "residual before the update [N m]",
            log_y: false,
        };
        plot.png()
    })
}

/// 2744 points in a cube of 40 cm.
fn block() -> Vec<Point3<f64>> {
    let at = |from: f64, i: usize| from + 0.4 * (i as f64 + 0.5) / 14.0;
    (0..14 * 14 * 14)
        .map(|i| Point3::new(at(0.43, i / 196), at(-0.2, i / 14 % 14), at(0.08, i % 14)))
        .collect()
}

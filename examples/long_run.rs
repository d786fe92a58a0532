//! Question: what becomes of a field that is touched for minutes, when readings are remembered, forgotten and
//! seen again many times?
//!
//! A Kinova Gen3 pushes into a block to and fro, at places that change, and reads its torques with little noise.
//! Memory replay (Alg. 1 of the paper) counts a reading as often as it is drawn; dual replay counts it once.
//!
//! ```sh
//! cargo run --release -p vsf-examples --example long_run -- out
//! ```
//!
//! The folder is created; `long_run.png` in it shows how well a push at another place is predicted, reading by
//! reading. Without an argument no picture is written.
//!
//! Answer: after 1000 readings memory replay predicts that push to 6.2 % of its torques, dual replay to 2.2 %; after
//! 6000 to 3.1 % and 0.4 %. At first, after 250, the order is the other way round: 31 and 36 %.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use std::error::Error;
use std::f64::consts::TAU;
use std::path::PathBuf;
use vsf::contact::link_sdfs;
use vsf::core::nalgebra::Point3;
use vsf::core::{Contacts, Observation};
use vsf::plot::{Curve, CurvePlot};
use vsf::prelude::*;
use vsf::robots::{RobotError, kinova_gen3};
use vsf_examples::write_picture;

const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
/// Points along each edge of the block, 0.33 m long.
const SIDE: usize = 20;
const STEPS: usize = 6000;
const PUSHES: f64 = 6.0;
const NOISE_SD: f64 = 0.05;
const PRIOR_SD: f64 = 365.0;
/// Room for some 400 of the readings.
const BYTES: usize = 4 << 20;

/// The hand at a share of the way into the block, turned sideways by an angle (rad) at its end.
fn joints(share: f64, aside: f64) -> [f64; 7] {
    let mut q: [f64; 7] = std::array::from_fn(|j| START[j] + share * (END[j] - START[j]));
    q[0] += share * aside;
    q
}

/// Soft on one side and stiff on the other, in layers.
fn truth(p: &Point3<f64>) -> f64 {
    let side = if p.y > 0.0 { 120.0 } else { 360.0 };
    side * (1.0 + 0.5 * (40.0 * p.z).sin())
}

fn main() -> Result<(), Box<dyn Error>> {
    let at = |from: f64, i: usize| from + 0.33 * (i as f64 + 0.5) / SIDE as f64;
    let points = (0..SIDE.pow(3)).map(|i| {
        let (x, y, z) = (i / SIDE / SIDE, i / SIDE % SIDE, i % SIDE);
        Point3::new(at(0.43, x), at(-0.165, y), at(0.08, z))
    });
    let rest = RestPoints::new(points.collect())?;
    let stiffness: Vec<f64> = rest.positions().iter().map(truth).collect();
    let robot = kinova_gen3()?;
    let links = link_sdfs(robot.colliders(), &Default::default())?.links;
    let mut contact = StickSlip::new(links, Default::default())?;
    let sensor = JointTorques::new(Noise::uniform(7, NOISE_SD)?);
    let (mut posture, mut contacts) = (robot.posture(), Contacts::new());
    // What the robot feels there.
    let mut touch = |q: [f64; 7], noise: &mut dyn FnMut() -> f64, obs: &mut Observation<f64>| {
        robot.update_posture(&q, &mut posture)?;
        contact.step(&rest, &posture, &mut contacts)?;
        sensor.observe(&rest, &posture, &contacts, &[0.0; 7], obs)?;
        let mut torques = [0.0; 7];
        obs.apply(&stiffness, &mut torques);
        let felt = torques.map(|tau| tau + noise());
        sensor.observe(&rest, &posture, &contacts, &felt, obs)?;
        Ok::<(), RobotError>(())
    };

    // A push at another place, to be predicted.
    let mut asked = Vec::new();
    let mut obs = Observation::new(Noise::uniform(7, NOISE_SD)?);
    for k in 0..100 {
        touch(joints(f64::from(k) / 99.0, 0.06), &mut || 0.0, &mut obs)?;
        asked.push(obs.clone());
    }
    let error = |mean: &[f64]| {
        let (mut left, mut all) = (0.0, 0.0);
        for obs in &asked {
            let mut predicted = [0.0; 7];
            obs.apply(mean, &mut predicted);
            let pairs = obs.reading().iter().zip(predicted);
            left += pairs.map(|(t, p)| (t - p).powi(2)).sum::<f64>().sqrt();
            all += obs.reading().iter().map(|t| t * t).sum::<f64>().sqrt();
        }
        100.0 * left / all
    };

    let prior = Belief::<f64>::uniform(rest.len(), 0.0, PRIOR_SD)?;
    let replay = ReplayConfig {
        byte_budget: BYTES,
        ..ReplayConfig::default()
    };
    let dual = DualConfig {
        byte_budget: BYTES,
        ..DualConfig::default()
    };
    let mut replay = MemoryReplay::new(DiagonalKalman::new(prior.clone()), replay)?;
    let mut dual = DualReplay::new(prior, dual)?;
    let noise = Normal::new(0.0, NOISE_SD)?;
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (mut x, mut replayed, mut dually) = (Vec::new(), Vec::new(), Vec::new());
    println!("readings   error of a push elsewhere [% of its torques]: memory replay, dual replay");
    for t in 1..=STEPS {
        let phase = PUSHES * TAU * t as f64 / STEPS as f64;
        let q = joints(0.5 - 0.5 * phase.cos(), 0.08 * (0.29 * phase).sin());
        touch(q, &mut || noise.sample(&mut rng), &mut obs)?;
        replay.update(&obs)?;
        dual.update(&obs)?;
        if t % 250 == 0 {
            let (a, b) = (error(replay.belief().mean()), error(dual.belief().mean()));
            if t == 250 || t % 1000 == 0 {
                println!("{t:8} {a:54.1} {b:12.1}");
            }
            x.push(t as f64);
            replayed.push(a);
            dually.push(b);
        }
    }
    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    write_picture(folder.as_deref(), "long_run.png", || {
        let curve = |name, y| Curve {
            name,
            x: &x,
            y,
            ..Curve::default()
        };
        let plot = CurvePlot {
            curves: &[
                curve("memory replay", &replayed),
                curve("dual replay", &dually),
            ],
            title: "A push elsewhere, predicted again and again",
            x_label: "readings",
            y_label: "error [% of the torques]",
            log_y: true,
        };
        plot.png()
    })
}

//! Question: does poking a soft block show a stiff inclusion that cannot be seen?
//!
//! A ball of 6 mm radius on three linear axes pokes a block of 60 x 60 x 20 mm, 8 mm deep, at 121
//! places. A stiff ball is hidden under the surface. Forces are simulated with noise of 0.02 N.
//!
//! ```sh
//! cargo run --release -p vsf-examples --example palpation_stage -- out
//! ```
//!
//! The folder is created; `field.png` in it shows the estimated field. Without an argument no
//! picture is written.
//!
//! Answer: yes. Inside the ball 34.7 N/m are estimated (in truth 40), around it 5.4 N/m (in truth
//! 5). Between the poked places forces are predicted to 0.016 N of 0.35 N. Single points at the
//! depth that the tip just reaches are far too stiff: little is read there. As one region of points that
//! are four times as stiff as the rest, the ball is found 3.8 mm off: the tip feels its upper part.

use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use std::error::Error;
use std::path::PathBuf;
use std::sync::Arc;
use vsf::contact::link_sdfs;
use vsf::core::nalgebra::Point3;
use vsf::pipeline::{RegionOptions, stiff_regions};
use vsf::plot::FieldView;
use vsf::prelude::*;
use vsf::robots::cartesian_stage;
use vsf_examples::write_picture;

const SOFT: f64 = 5.0;
const STIFF: f64 = 40.0;
/// Center of the stiff ball (m).
const INCLUSION: Point3<f64> = Point3::new(0.038, 0.026, -0.010);
const NOISE_SD: f64 = 0.02;

fn main() -> Result<(), Box<dyn Error>> {
    let rest = Arc::new(RestPoints::new(block())?);
    let stiff: Vec<bool> = rest.positions().iter().map(is_inclusion).collect();
    let truth = stiff
        .iter()
        .map(|&s| if s { STIFF } else { SOFT })
        .collect();

    let robot = cartesian_stage(0.006)?;
    let chains = robot.chains().clone();
    let links = link_sdfs(robot.colliders(), &Default::default())?.links;
    let contact = StickSlip::new(links, Default::default())?;
    let sensor = JointTorques::new(Noise::uniform(3, NOISE_SD)?);

    // The block itself is a session that knows the truth and is only asked for readings.
    let known = DiagonalKalman::new(Belief::new(truth, vec![1e-6; rest.len()])?);
    let mut block = Session::new(
        chains.clone(),
        rest.clone(),
        contact.clone(),
        sensor.clone(),
        known,
    )?;
    let prior = Belief::<f64>::uniform(rest.len(), 0.0, 20.0)?;
    let filter = MemoryReplay::new(DiagonalKalman::new(prior), Default::default())?;
    let mut session = Session::new(chains, rest.clone(), contact, sensor, filter)?;

    let noise = Normal::new(0.0, NOISE_SD)?;
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let mut posture = robot.posture();
    let mut reading = Prediction::default();
    let mut touched = vec![false; rest.len()];
    for (i, j) in (0..11).flat_map(|i| (0..11).map(move |j| (i, j))) {
        block.begin_touch();
        session.begin_touch();
        for depth in depths() {
            let q = [0.005 * f64::from(i + 1), 0.005 * f64::from(j + 1), -depth];
            robot.update_posture(&q, &mut posture)?;
            block.predict(&posture, &mut reading)?;
            let force: Vec<f64> = reading
                .mean
                .iter()
                .map(|f| f + noise.sample(&mut rng))
                .collect();
            session.step(&posture, &force)?;
            session
                .contacts()
                .points()
                .iter()
                .for_each(|&p| touched[p as usize] = true);
        }
    }

    for (name, inside) in [("inclusion", true), ("soft part", false)] {
        let chosen = |i: &usize| touched[*i] && stiff[*i] == inside;
        let values = (0..rest.len())
            .filter(chosen)
            .map(|i| session.belief().mean()[i]);
        let (count, sum) = values.fold((0, 0.0), |(n, s), k| (n + 1, s + k));
        let expected = if inside { STIFF } else { SOFT };
        let mean = sum / f64::from(count);
        println!("{name}: mean {mean:4.1} N/m over {count} touched points, in truth {expected}");
    }

    // The diagonal filter is surer than it should be: a higher contrast makes up for it.
    let options = RegionOptions {
        contrast: 4.0,
        ..RegionOptions::default()
    };
    for region in stiff_regions(&rest, session.belief(), &touched, &options)?.regions {
        let off = 1e3 * (region.center - INCLUSION).norm();
        let (points, mean) = (region.points.len(), region.mean);
        println!(
            "stiff region: {points} points of {mean:.1} N/m, its center {off:.1} mm off that of the ball"
        );
    }

    // Pokes half way between those that were made.
    let (mut error, mut size, mut count) = (0.0, 0.0, 0.0);
    let mut predicted = Prediction::default();
    for (i, j) in (0..10).flat_map(|i| (0..10).map(move |j| (i, j))) {
        block.begin_touch();
        session.begin_touch();
        for depth in depths() {
            let at = |k: i32| 0.005 * f64::from(k) + 0.0075;
            robot.update_posture(&[at(i), at(j), -depth], &mut posture)?;
            block.predict(&posture, &mut reading)?;
            session.predict(&posture, &mut predicted)?;
            let gap = predicted
                .mean
                .iter()
                .zip(&reading.mean)
                .map(|(a, b)| (a - b).powi(2));
            error += gap.sum::<f64>().sqrt();
            size += reading.mean.iter().map(|f| f * f).sum::<f64>().sqrt();
            count += 1.0;
        }
    }
    println!(
        "places not touched: mean error {:.3} N of {:.2} N",
        error / count,
        size / count
    );

    let folder = std::env::args_os().nth(1).map(PathBuf::from);
    write_picture(folder.as_deref(), "field.png", || {
        let picture = FieldView {
            points_W: rest.positions(),
            stiffness: session.belief().mean(),
            touched: &touched,
            title: "A stiff ball in a soft block, found by poking",
            ..FieldView::default()
        };
        picture.png()
    })
}

/// Tip depths of one poke (m).
fn depths() -> impl Iterator<Item = f64> {
    (0..16).map(|k| 0.0005 * f64::from(k + 1))
}

/// Points 2.5 mm apart under the plane z = 0.
fn block() -> Vec<Point3<f64>> {
    let step = |i: usize| 0.0025 * (i as f64 + 0.5);
    (0..24 * 24 * 8)
        .map(|i| Point3::new(step(i / 192), step(i / 8 % 24), -step(i % 8)))
        .collect()
}

/// A ball of 8 mm radius, its top 2 mm under the surface.
fn is_inclusion(p: &Point3<f64>) -> bool {
    (p - INCLUSION).norm() < 0.008
}

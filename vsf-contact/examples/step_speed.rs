//! Time of a contact step while a Kinova Gen3 pushes 16 cm into a lattice of points.
//!
//! `cargo run --release -p vsf-contact --example step_speed` uses the built-in collision shapes;
//! the path of a URDF file as argument uses its meshes, as grids. The four last links touch, up to
//! about 4100 points at once, and most points slide. Larger clouds have the same spacing, so that
//! the contacts are nearly the same ones.

use nalgebra::Point3;
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;
use vsf_contact::{ContactConfig, GridOptions, LinkSdf, StickSlip, link_sdfs};
use vsf_core::{ContactModel, Contacts, RestPoints};
use vsf_robots::{RobotModel, UrdfOptions, kinova_gen3};

/// The tool at x = 0.38 m and 0.54 m, 12 cm above ground, pointing down.
const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
const LINKS: [&str; 4] = [
    "ForeArm_Link",
    "SphericalWrist1_Link",
    "SphericalWrist2_Link",
    "Bracelet_Link",
];
/// Distance of neighboring points (m).
const SPACING: f64 = 7.15e-3;
/// Every step counts with its least time in so many runs: the machine may be busy.
const RUNS: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let robot = match std::env::args().nth(1) {
        None => kinova_gen3()?,
        Some(path) => RobotModel::from_urdf_file(path, &UrdfOptions::default())?,
    };
    let mut colliders = robot.colliders().to_vec();
    colliders.retain(|c| LINKS.contains(&robot.links()[c.link].name()));
    let links: Arc<[LinkSdf]> = link_sdfs(&colliders, &GridOptions::default())?.links.into();
    println!(
        "{:>9} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "points", "mm a step", "median ms", "p99 ms", "max ms", "last ms", "contacts"
    );
    for (side, steps) in [(46, 150), (46, 1000), (46, 5000), (100, 150), (216, 150)] {
        let rest = lattice(side)?;
        let mut model = StickSlip::new(links.clone(), ContactConfig::default())?;
        // A first run warms the buffers up.
        run(&robot, &mut model, &rest, steps)?;
        let mut least = run(&robot, &mut model, &rest, steps)?;
        for _ in 1..RUNS {
            let times = run(&robot, &mut model, &rest, steps)?;
            for (least, ms) in least.ms.iter_mut().zip(times.ms) {
                *least = least.min(ms);
            }
        }
        least.print(&rest, steps);
    }
    Ok(())
}

struct Times {
    ms: Vec<f64>,
    contacts: usize,
}

impl Times {
    /// "Last" is the median of the last eighth of the way, with the most contacts.
    fn print(self, rest: &RestPoints, steps: usize) {
        let quantile = |ms: &[f64], q: f64| {
            let mut sorted = ms.to_vec();
            sorted.sort_by(f64::total_cmp);
            sorted[(q * (sorted.len() - 1) as f64) as usize]
        };
        println!(
            "{:>9} {:>9.2} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9}",
            rest.len(),
            160.0 / steps as f64,
            quantile(&self.ms, 0.5),
            quantile(&self.ms, 0.99),
            quantile(&self.ms, 1.0),
            quantile(&self.ms[7 * steps / 8..], 0.5),
            self.contacts,
        );
    }
}

fn run(
    robot: &RobotModel,
    model: &mut StickSlip,
    rest: &RestPoints,
    steps: usize,
) -> Result<Times, Box<dyn Error>> {
    let (mut posture, mut contacts) = (robot.posture(), Contacts::new());
    let mut ms = Vec::with_capacity(steps);
    model.reset();
    for step in 0..steps {
        let s = step as f64 / (steps - 1) as f64;
        let q: [f64; 7] = std::array::from_fn(|j| START[j] + s * (END[j] - START[j]));
        robot.update_posture(&q, &mut posture)?;
        let started = Instant::now();
        model.step(rest, &posture, &mut contacts)?;
        ms.push(1e3 * started.elapsed().as_secs_f64());
    }
    Ok(Times {
        ms,
        contacts: contacts.len(),
    })
}

/// `n`³ points that fill a cube in front of the robot, with its top at 0.41 m.
fn lattice(n: usize) -> Result<RestPoints, Box<dyn Error>> {
    let edge = SPACING * (n - 1) as f64;
    let at = |lower: f64, i: usize| lower + SPACING * i as f64;
    let (y, z) = (-0.5 * edge, 0.41 - edge);
    let point = |i| Point3::new(at(0.43, i / n / n), at(y, i / n % n), at(z, i % n));
    Ok(RestPoints::new((0..n * n * n).map(point).collect())?)
}

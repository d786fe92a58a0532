//! Wall time of the online step, on one thread, in `f32`, with 20 replays per update.
//!
//! A Kinova Gen3 pushes 16 cm into a cube of points, 150 steps. `push` times the whole push
//! (kinematics, contact, columns, update); its throughput is steps per second. `stage` times each
//! part alone at the deepest posture, at 1e5 points.
//!
//! `cargo bench -p vsf-benches`; with `-- --test` everything runs once, to see that it still does.
//!
//! `push/recorded` runs the points and the trajectory of a recorded comparison case when the folder
//! `shared/peer/openvsf_case` lies beside the repository, and says so when it does not.

#![allow(missing_docs)] // of the function that criterion's macro makes

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;
use vsf::contact::{LinkSdf, link_sdfs};
use vsf::core::nalgebra::Point3;
use vsf::core::{Contacts, CoreError, Observation, Posture};
use vsf::filter::ReplayConfig;
use vsf::prelude::*;
use vsf::robots::{RobotError, kinova_gen3};

type Replay = MemoryReplay<DiagonalKalman<f32>>;
type Outcome<T> = Result<T, Box<dyn Error>>;

const CASE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../shared/peer/openvsf_case"
);
const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
const STEPS: usize = 150;

/// All that a push needs; contact and estimator keep their state between steps.
struct Scene {
    robot: RobotModel,
    rest: RestPoints,
    contact: StickSlip,
    sensor: JointTorques,
    estimator: Replay,
    trajectory: Vec<Vec<f64>>,
    posture: Posture,
    contacts: Contacts,
    observation: Observation<f32>,
}

impl Scene {
    fn new(points: Vec<Point3<f64>>, trajectory: Vec<Vec<f64>>, replays: usize) -> Outcome<Self> {
        let robot = kinova_gen3()?;
        let links: Vec<LinkSdf> = link_sdfs(robot.colliders(), &Default::default())?.links;
        let rest = RestPoints::new(points)?;
        let sensor = JointTorques::new(Noise::uniform(7, 1.0)?);
        let prior = Belief::uniform(rest.len(), 0.0, 0.1)?;
        let config = ReplayConfig {
            replays,
            ..ReplayConfig::default()
        };
        Ok(Self {
            contact: StickSlip::new(links, Default::default())?,
            estimator: MemoryReplay::new(DiagonalKalman::new(prior), config)?,
            posture: robot.posture(),
            contacts: Contacts::new(),
            observation: sensor.blank(),
            robot,
            rest,
            sensor,
            trajectory,
        })
    }

    fn cube(points: usize, replays: usize) -> Outcome<Self> {
        let side = (points as f64).cbrt().round() as usize;
        let at = |from: f64, i: usize| from + 0.4 * (i as f64 + 0.5) / side as f64;
        let cube = (0..side.pow(3)).map(|i| {
            Point3::new(
                at(0.43, i / side / side),
                at(-0.2, i / side % side),
                at(0.08, i % side),
            )
        });
        let line = (0..STEPS).map(|k| {
            let s = k as f64 / (STEPS - 1) as f64;
            START
                .iter()
                .zip(END)
                .map(|(a, b)| a + s * (b - a))
                .collect()
        });
        Self::new(cube.collect(), line.collect(), replays)
    }

    fn place(&mut self, k: usize) -> Result<(), CoreError> {
        self.robot
            .update_posture(&self.trajectory[k], &mut self.posture)
    }

    fn touch(&mut self) -> Result<(), CoreError> {
        self.contact
            .step(&self.rest, &self.posture, &mut self.contacts)
    }

    fn columns(&mut self) -> Result<(), CoreError> {
        let (reading, out) = ([1.0; 7], &mut self.observation);
        self.sensor
            .observe(&self.rest, &self.posture, &self.contacts, &reading, out)
    }

    fn push(&mut self) -> Result<(), RobotError> {
        self.contact.reset();
        for k in 0..self.trajectory.len() {
            self.place(k)?;
            self.touch()?;
            self.columns()?;
            black_box(self.estimator.update(&self.observation)?);
        }
        Ok(())
    }
}

/// The recorded case: 97,336 points, 150 postures.
fn recorded() -> Outcome<Scene> {
    let points = array(&Path::new(CASE).join("points.npy"))?;
    let trajectory = array(&Path::new(CASE).join("q_traj.npy"))?;
    let points = points
        .chunks_exact(3)
        .map(|p| Point3::new(p[0], p[1], p[2]));
    let rows = trajectory.chunks_exact(7).map(<[f64]>::to_vec);
    Scene::new(points.collect(), rows.collect(), 20)
}

/// The numbers of a `.npy` of version 1 with little-endian floats in C order.
fn array(path: &Path) -> Outcome<Vec<f64>> {
    let bytes = std::fs::read(path)?;
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let single = bytes[..start].windows(3).any(|w| w == b"<f4");
    let data = &bytes[start..];
    Ok(if single {
        let (chunks, _) = data.as_chunks::<4>();
        chunks
            .iter()
            .map(|b| f64::from(f32::from_le_bytes(*b)))
            .collect()
    } else {
        let (chunks, _) = data.as_chunks::<8>();
        chunks.iter().map(|b| f64::from_le_bytes(*b)).collect()
    })
}

/// A bench has no caller to hand an error to.
#[allow(clippy::panic)]
fn must<T, E: std::fmt::Display>(result: Result<T, E>) -> T {
    result.unwrap_or_else(|error| panic!("{error}"))
}

fn whole(c: &mut Criterion) {
    let mut group = c.benchmark_group("push");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    group.throughput(Throughput::Elements(STEPS as u64));
    for points in [10_000, 100_000, 1_000_000] {
        let mut scene = must(Scene::cube(points, 20));
        group.bench_function(BenchmarkId::from_parameter(points), |b| {
            b.iter(|| must(scene.push()));
        });
    }
    if Path::new(CASE).is_dir() {
        let mut scene = must(recorded());
        group.bench_function("recorded", |b| b.iter(|| must(scene.push())));
    } else {
        eprintln!("SKIPPED push/recorded: there is no folder {CASE}");
    }
    group.finish();
}

fn stages(c: &mut Criterion) {
    let mut group = c.benchmark_group("stage");
    let mut scene = must(Scene::cube(100_000, 20));
    must(scene.push());
    let contacts = scene.contacts.len();

    group.bench_function("kinematics", |b| b.iter(|| must(scene.place(STEPS - 1))));
    let mut turn = 0;
    group.bench_function(format!("contact/{contacts}"), |b| {
        b.iter(|| {
            // Two neighboring postures in turn, so that points move.
            turn = 1 - turn;
            must(scene.place(STEPS - 2 + turn));
            must(scene.touch());
        });
    });
    group.bench_function(format!("columns/{contacts}"), |b| {
        b.iter(|| must(scene.columns()));
    });
    for replays in [0, 20] {
        let mut scene = must(Scene::cube(100_000, replays));
        must(scene.push());
        group.bench_function(format!("update/{contacts}/replay_{replays}"), |b| {
            b.iter(|| black_box(must(scene.estimator.update(&scene.observation))));
        });
    }
    group.finish();
}

criterion_group!(benches, whole, stages);
criterion_main!(benches);

use crate::PipelineError;
use nalgebra::Point3;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;
use vsf_contact::{ContactConfig, GridOptions, StickSlip, link_sdfs};
use vsf_core::{Belief, ContactModel, Contacts, Estimator, Noise, RestPoints, Sensor};
use vsf_filter::{DiagonalKalman, MemoryReplay, ReplayConfig};
use vsf_robots::{JointTorques, RobotModel, kinova_gen3};

/// What [`bench()`] runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BenchOptions {
    /// Number of rest points in a cube of 0.4 m, default 100,000. It is rounded to a cube number.
    pub points: usize,
    /// Steps of the push, default 150; at least 2.
    pub steps: usize,
    /// Replays per update, default 20.
    pub replays: usize,
}

impl Default for BenchOptions {
    fn default() -> Self {
        Self {
            points: 100_000,
            steps: 150,
            replays: 20,
        }
    }
}

/// Times of one stage over the steps in contact (ms).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StageTimes {
    /// Median.
    pub median_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
}

/// Times of a whole online step, in `f32`, on one thread.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// Rest points.
    pub points: usize,
    /// Contacts at the last step.
    pub contacts: usize,
    /// Steps per second, from the mean over the steps in contact.
    pub steps_per_second: f64,
    /// Median of the whole step.
    pub median_ms: f64,
    /// 99th percentile of the whole step.
    pub p99_ms: f64,
    /// Forward kinematics.
    pub kinematics: StageTimes,
    /// Contact model.
    pub contact: StageTimes,
    /// Columns of the observation matrix.
    pub columns: StageTimes,
    /// Estimator, with replays.
    pub update: StageTimes,
}

/// Postures at the start and the end of the push: the tool of a Gen3, pointing down, moves 16 cm
/// forward into the cube.
const START: [f64; 7] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; 7] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
const CORNER: [f64; 3] = [0.43, -0.2, 0.08];
const EDGE: f64 = 0.4;

/// Times the whole step, contact to belief, on a push of a Kinova Gen3 into a cube of points, the
/// points moved alone ([`crate::SceneOptions::subdivision`] 1). It needs no data.
///
/// # Errors
/// Fewer than 2 steps or no points.
pub fn bench(options: &BenchOptions) -> Result<BenchReport, PipelineError> {
    let side = (options.points as f64).cbrt().round() as usize;
    if side == 0 {
        return Err(PipelineError::NoPoints);
    }
    if options.steps < 2 {
        return Err(PipelineError::NoSequences {
            what: "bench",
            hint: "take at least 2 steps",
        });
    }
    let robot = kinova_gen3()?;
    let rest = cube(side)?;
    let links = link_sdfs(robot.colliders(), &GridOptions::default())?.links;
    let mut contact = StickSlip::new(links, ContactConfig::default())?;
    let sensor = JointTorques::new(Noise::uniform(7, 1.0)?);
    let prior = Belief::<f32>::uniform(rest.len(), 0.0, 0.1)?;
    let config = ReplayConfig {
        replays: options.replays,
        ..ReplayConfig::default()
    };
    let mut estimator = MemoryReplay::new(DiagonalKalman::new(prior), config)?;

    // The first push warms up buffers and caches, the second is timed.
    push(
        &robot,
        &rest,
        &mut contact,
        &sensor,
        &mut estimator,
        options.steps,
    )?;
    estimator.begin_sequence();
    let times = push(
        &robot,
        &rest,
        &mut contact,
        &sensor,
        &mut estimator,
        options.steps,
    )?;

    let total: Vec<f64> = times.steps.iter().map(|s| s.iter().sum()).collect();
    let whole = quantiles(total.clone());
    let stage = |k: usize| quantiles(times.steps.iter().map(|s| s[k]).collect());
    Ok(BenchReport {
        points: rest.len(),
        contacts: times.contacts,
        steps_per_second: 1e3 * total.len() as f64 / total.iter().sum::<f64>().max(1e-9),
        median_ms: whole.median_ms,
        p99_ms: whole.p99_ms,
        kinematics: stage(0),
        contact: stage(1),
        columns: stage(2),
        update: stage(3),
    })
}

fn cube(side: usize) -> Result<Arc<RestPoints>, PipelineError> {
    let at = |k: usize, i: usize| CORNER[k] + EDGE * (i as f64 + 0.5) / side as f64;
    let points = (0..side * side * side).map(|i| {
        Point3::new(
            at(0, i / side / side),
            at(1, i / side % side),
            at(2, i % side),
        )
    });
    Ok(Arc::new(RestPoints::new(points.collect())?))
}

/// Times of the steps in contact (ms): kinematics, contact, columns, update.
struct Times {
    steps: Vec<[f64; 4]>,
    contacts: usize,
}

fn push(
    robot: &RobotModel,
    rest: &RestPoints,
    contact: &mut StickSlip,
    sensor: &JointTorques,
    estimator: &mut MemoryReplay<DiagonalKalman<f32>>,
    steps: usize,
) -> Result<Times, PipelineError> {
    let mut posture = robot.posture();
    let mut contacts = Contacts::new();
    let mut obs = Sensor::<f32>::blank(sensor);
    let mut times = Times {
        steps: Vec::with_capacity(steps),
        contacts: 0,
    };
    contact.reset();
    for i in 0..steps {
        let s = i as f64 / (steps - 1) as f64;
        let q: [f64; 7] = std::array::from_fn(|j| START[j] + s * (END[j] - START[j]));
        let clock = Instant::now();
        let mut lap = 0.0;
        let mut split = || {
            let now = clock.elapsed().as_secs_f64() * 1e3;
            let took = now - lap;
            lap = now;
            took
        };
        robot.update_posture(&q, &mut posture)?;
        let kinematics = split();
        contact.step(rest, &posture, &mut contacts)?;
        let touch = split();
        sensor.observe(rest, &posture, &contacts, &[1.0; 7], &mut obs)?;
        let columns = split();
        estimator.update(&obs)?;
        let update = split();
        if !contacts.is_empty() {
            times.steps.push([kinematics, touch, columns, update]);
        }
        times.contacts = contacts.len();
    }
    Ok(times)
}

fn quantiles(mut values: Vec<f64>) -> StageTimes {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let last = values.len().saturating_sub(1) as f64;
        values
            .get((share * last).round() as usize)
            .copied()
            .unwrap_or(0.0)
    };
    StageTimes {
        median_ms: at(0.5),
        p99_ms: at(0.99),
    }
}

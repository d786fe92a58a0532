use crate::{FilterSpec, PipelineError};
use nalgebra::Point3;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;
use vsf_contact::{ContactConfig, GridOptions, StickSlip, link_sdfs};
use vsf_core::{
    Belief, ContactModel, Contacts, CoreError, Estimator, Noise, Observation, Posture, RestPoints,
    Scalar, Sensor,
};
use vsf_robots::{JointTorques, RobotModel, kinova_gen3};

/// Options of [`bench()`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BenchOptions {
    /// Number of rest points in a cube of 0.33 m, default 100,000. It is rounded to a cube number.
    pub points: usize,
    /// Steps of the push, default 150; at least 2.
    pub steps: usize,
    /// The estimator, default [`FilterSpec::replay`].
    pub estimator: FilterSpec,
}

impl Default for BenchOptions {
    fn default() -> Self {
        Self {
            points: 100_000,
            steps: 150,
            estimator: FilterSpec::replay(),
        }
    }
}

/// Times of one stage over the steps in contact (ms).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct StageTimes {
    /// Median.
    pub median_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
}

/// Times of the last [`LOADED_STEPS`] steps of the push, which have the most contacts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Loaded {
    /// Mean number of contacts.
    pub contacts: f64,
    /// Steps per second, from the mean time.
    pub steps_per_second: f64,
    /// Median of the whole step (ms).
    pub median_ms: f64,
    /// Median of the contact model (ms).
    pub contact_ms: f64,
    /// Median of the update with its replays (ms).
    pub update_ms: f64,
    /// Minimum number of bytes that an update has to read: indices and weights of the observation and of
    /// its replays, and mean and variance of their points.
    pub update_bytes: f64,
    /// Time of the update divided by the time to read that many bytes once, in sequence.
    pub update_over_read: f64,
}

/// Times of an entire online step, in `f32`, on one thread.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct BenchReport {
    /// Rest points.
    pub points: usize,
    /// Contacts at the last step.
    pub contacts: usize,
    /// Rate at which one thread of this machine reads memory (GB/s).
    pub bandwidth_gb_per_s: f64,
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
    /// Computation of the columns of the observation matrix.
    pub columns: StageTimes,
    /// Estimator, with replays.
    pub update: StageTimes,
    /// The end of the push.
    pub loaded: Loaded,
}

/// Postures at the start and the end of the push: the tool of a Gen3, pointing down, moves 16 cm
/// forward into the cube.
pub(crate) const JOINTS: usize = 7;
const START: [f64; JOINTS] = [-0.1722, 0.7707, 3.3871, -2.0982, -0.5440, -0.3332, 0.5249];
const END: [f64; JOINTS] = [-0.2159, 0.9687, 3.5203, -1.5222, -0.4679, -0.7417, 0.3624];
/// The cube is of such a size that the end of the push has about 4100 contacts at 100,000 points.
const CORNER: [f64; 3] = [0.43, -0.165, 0.08];
const EDGE: f64 = 0.33;
/// Number of steps in [`Loaded`].
pub const LOADED_STEPS: usize = 20;
/// Pushes that are timed, and most of those that come before: until the memory for past observations is full, as
/// it is after a while of touching.
const PUSHES: usize = 3;
const MOST_WARMING: usize = 40;

/// Times an entire online step, from contact to belief, while a Kinova Gen3 pushes into a cube of points.
///
/// The points are moved without sub-points ([`crate::SceneOptions::subdivision`] 1). Needs no data.
///
/// # Errors
/// Fewer than 2 steps or no points.
pub fn bench(options: &BenchOptions) -> Result<BenchReport, PipelineError> {
    let side = (options.points as f64).cbrt().round() as usize;
    if side == 0 {
        return Err(PipelineError::NoPoints);
    }
    if options.steps < 2 {
        return Err(CoreError::TooFew {
            what: "steps",
            got: options.steps,
            least: 2,
        }
        .into());
    }
    let mut bench = Push::new(side, options.steps)?;
    let prior = Belief::<f64>::uniform(bench.rest.len(), 0.0, 0.1)?;
    let mut estimator = options.estimator.build::<f32>(prior.into(), None)?;
    // The first push warms up caches, all of them the buffer of past observations.
    for _ in 0..MOST_WARMING {
        let held = estimator.buffered_bytes();
        bench.run(&mut *estimator)?;
        if estimator.buffered_bytes() <= held {
            break;
        }
    }
    let mut push = || bench.run(&mut *estimator);
    let pushes: Vec<Vec<Step>> = (0..PUSHES).map(|_| push()).collect::<Result<_, _>>()?;

    let all = || pushes.iter().flatten().filter(|s| s.contacts > 0);
    let whole = quantiles(all().map(Step::total));
    let stage = |k: usize| quantiles(all().map(|s| s.ms[k]));
    let bandwidth = read_bandwidth();
    Ok(BenchReport {
        points: bench.rest.len(),
        contacts: pushes.iter().flatten().last().map_or(0, |s| s.contacts),
        bandwidth_gb_per_s: bandwidth,
        steps_per_second: 1e3 / mean(all().map(Step::total)).max(1e-9),
        median_ms: whole.median_ms,
        p99_ms: whole.p99_ms,
        kinematics: stage(0),
        contact: stage(1),
        columns: stage(2),
        update: stage(3),
        loaded: loaded(&pushes, options.estimator.replays(), bandwidth),
    })
}

fn loaded(pushes: &[Vec<Step>], replays: usize, bandwidth: f64) -> Loaded {
    let from = |push: &Vec<Step>| push.len().saturating_sub(LOADED_STEPS);
    let last = || pushes.iter().flat_map(|p| &p[from(p)..]);
    let contacts = |s: &Step| s.contacts as f64;
    // Replays are drawn from all observations so far, here from about those of a push.
    let drawn = mean(
        pushes
            .iter()
            .flatten()
            .filter(|s| s.contacts > 0)
            .map(contacts),
    );
    let now = mean(last().map(contacts));
    // Of each contact an index, a weight per joint, mean and variance.
    let per_contact = (1 + JOINTS + 2) * size_of::<f32>();
    let update_bytes = (now + replays as f64 * drawn) * per_contact as f64;
    let update = quantiles(last().map(|s| s.ms[3])).median_ms;
    Loaded {
        contacts: now,
        steps_per_second: 1e3 / mean(last().map(Step::total)).max(1e-9),
        median_ms: quantiles(last().map(Step::total)).median_ms,
        contact_ms: quantiles(last().map(|s| s.ms[1])).median_ms,
        update_ms: update,
        update_bytes,
        update_over_read: update / (update_bytes / bandwidth * 1e-6),
    }
}

/// Rate of reading an array larger than the caches from end to end (GB/s), the best of a few times.
fn read_bandwidth() -> f64 {
    const LANES: usize = 32;
    let array = vec![1.0f32; 1 << 25];
    let mut best = f64::INFINITY;
    for _ in 0..3 {
        let clock = Instant::now();
        let mut sums = [0.0f32; LANES];
        for chunk in std::hint::black_box(&array).chunks_exact(LANES) {
            sums.iter_mut().zip(chunk).for_each(|(sum, x)| *sum += x);
        }
        std::hint::black_box(sums);
        best = best.min(clock.elapsed().as_secs_f64());
    }
    (array.len() * size_of::<f32>()) as f64 / best * 1e-9
}

fn cube(side: usize) -> Result<Arc<RestPoints>, PipelineError> {
    RestPoints::check_count(side.saturating_pow(3))?;
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

/// Times of one step (ms): kinematics, contact, columns, update.
pub(crate) struct Step {
    pub(crate) ms: [f64; 4],
    pub(crate) contacts: usize,
}

impl Step {
    pub(crate) fn total(&self) -> f64 {
        self.ms.iter().sum()
    }
}

/// What a step reads and writes.
pub(crate) struct Buffers<T: Scalar> {
    posture: Posture,
    contacts: Contacts,
    pub(crate) obs: Observation<T>,
}

/// The push of a Gen3 into a cube of points, which any estimator can follow.
pub(crate) struct Push {
    pub(crate) rest: Arc<RestPoints>,
    robot: RobotModel,
    contact: StickSlip,
    sensor: JointTorques,
    steps: usize,
}

impl Push {
    /// A cube of `side` points along each edge.
    pub(crate) fn new(side: usize, steps: usize) -> Result<Self, PipelineError> {
        let robot = kinova_gen3()?;
        let links = link_sdfs(robot.colliders(), &GridOptions::default())?.links;
        Ok(Self {
            rest: cube(side)?,
            contact: StickSlip::new(links, ContactConfig::default())?,
            sensor: JointTorques::new(Noise::uniform(JOINTS, 1.0)?),
            robot,
            steps,
        })
    }

    /// What a step of any estimator with this number works in.
    pub(crate) fn buffers<T: Scalar>(&self) -> Buffers<T> {
        Buffers {
            posture: self.robot.posture(),
            contacts: Contacts::new(),
            obs: self.sensor.blank(),
        }
    }

    /// Runs the whole push as a new sequence, with constant readings.
    pub(crate) fn run<T: Scalar>(
        &mut self,
        estimator: &mut dyn Estimator<Scalar = T>,
    ) -> Result<Vec<Step>, PipelineError> {
        let mut buffers = self.buffers();
        self.contact.reset();
        estimator.begin_sequence();
        (0..self.steps)
            .map(|i| {
                let share = i as f64 / (self.steps - 1) as f64;
                self.step(share, &[1.0; JOINTS], estimator, &mut buffers)
            })
            .collect()
    }

    /// Moves on to this share of the push, 0 to 1.
    pub(crate) fn step<T: Scalar>(
        &mut self,
        share: f64,
        reading: &[f64; JOINTS],
        estimator: &mut dyn Estimator<Scalar = T>,
        buffers: &mut Buffers<T>,
    ) -> Result<Step, PipelineError> {
        let Buffers {
            posture,
            contacts,
            obs,
        } = buffers;
        let q: [f64; JOINTS] = std::array::from_fn(|j| START[j] + share * (END[j] - START[j]));
        let clock = Instant::now();
        let mut lap = 0.0;
        let mut split = || {
            let now = clock.elapsed().as_secs_f64() * 1e3;
            let took = now - lap;
            lap = now;
            took
        };
        self.robot.update_posture(&q, posture)?;
        let kinematics = split();
        self.contact.step(&self.rest, posture, contacts)?;
        let touch = split();
        self.sensor
            .observe(&self.rest, posture, contacts, reading, obs)?;
        let columns = split();
        estimator.update(obs)?;
        Ok(Step {
            ms: [kinematics, touch, columns, split()],
            contacts: contacts.len(),
        })
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0usize, 0.0), |(n, sum), v| (n + 1, sum + v));
    sum / count.max(1) as f64
}

pub(crate) fn quantiles(values: impl Iterator<Item = f64>) -> StageTimes {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let last = values.len().saturating_sub(1) as f64;
        let index = (share * last).round() as usize;
        values.get(index).copied().unwrap_or(0.0)
    };
    StageTimes {
        median_ms: at(0.5),
        p99_ms: at(0.99),
    }
}

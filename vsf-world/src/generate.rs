//! From a specification to a recording and its label.

use crate::WorldError;
use crate::arm::{JOINTS, JointVector};
use crate::case::{CaseSpec, Kind};
use crate::effect::Effect;
use crate::gen3;
use crate::label::{
    AppliedEffect, Label, difference, energy, rms_test, schedule, sequence_id, truth_share,
    where_it_acts,
};
use crate::motion::{FIRST_TEST, RATE_HZ, SEQUENCES, Trajectory, plan};
use crate::nodes::triples;
use crate::object::{Object, Physics};
use crate::plant::Plant;
use crate::sensor::{GRAVITY, Rows, rates, sense};
use crate::session::touch_torques;
use crate::springs::Springs;
use crate::strength::{Trial, find_strength};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use std::path::{Path, PathBuf};
use vsf_data::{Dataset, RobotRef, Sequence, Splits, Table};

/// Standard deviation of the torque noise of a joint \[N m\].
const NOISE_NM: f64 = 0.05;

/// Step to which recorded angles are rounded \[rad\].
const ANGLE_STEP: f64 = 1e-4;

/// Spacing of the points of a recording \[m\].
const GRID: f64 = 0.012;

/// Stride of samples in a trial.
const TRIAL_STRIDE: usize = 4;

/// An object, an arm in front of it, and a session of touches, all drawn from a seed.
pub(crate) struct World {
    object: Box<dyn Object>,
    base: Isometry3<f64>,
    friction: f64,
    plan: Vec<Trajectory>,
}

impl World {
    /// Draws a world. Its stiffness makes the torques peak at 7 to 13 N m, averaged over the sequences, with neither site
    /// far off.
    ///
    /// # Errors
    /// [`WorldError::OutOfReach`].
    pub fn draw(spec: &CaseSpec) -> Result<Self, WorldError> {
        const TRIES: u64 = 12;
        let mut last = WorldError::OutOfReach { seed: spec.seed };
        for attempt in 0..TRIES {
            match Self::try_draw(spec, attempt) {
                Err(e @ WorldError::OutOfReach { .. }) => last = e,
                done => return done,
            }
        }
        Err(last)
    }

    fn try_draw(spec: &CaseSpec, attempt: u64) -> Result<Self, WorldError> {
        let mut rng = stream(spec.seed, 0x10 + attempt);
        let mut draw = |range: f64| rng.random_range(-range..range);
        let base = Isometry3::from_parts(
            Translation3::new(draw(0.03), draw(0.03), 0.02 + draw(0.02)),
            UnitQuaternion::from_scaled_axis(Vector3::z() * draw(0.1)),
        );
        let friction = rng.random_range(0.13..0.18);
        let physics = Physics::new(friction, &[]);
        let from = Point3::from(base.translation.vector);
        let object: Box<dyn Object> = match spec.kind {
            Kind::Springs => Box::new(Springs::draw(&from, &physics, &mut rng)?),
            Kind::Plant => Box::new(Plant::draw(&from, &physics, &mut rng)),
        };
        let plan = plan(object.as_ref(), &base, spec.protocol, &mut rng, spec.seed)?;
        let mut world = Self {
            object,
            base,
            friction,
            plan,
        };
        let peaks = peaks(&world.touch(&[], TRIAL_STRIDE));
        let mean = peaks.iter().sum::<f64>() / peaks.len() as f64;
        if !peaks.iter().all(|p| (0.3 * mean..2.5 * mean).contains(p)) || !alike(&peaks) {
            return Err(WorldError::OutOfReach { seed: spec.seed });
        }
        world
            .object
            .scale_stiffness(rng.random_range(7.0..13.0) / mean);
        Ok(world)
    }

    /// Joint torques of the touch.
    pub fn touch(&mut self, effects: &[Effect], stride: usize) -> Vec<Rows> {
        let object = self.object.as_mut();
        touch_torques(
            object,
            &self.base,
            self.friction,
            &self.plan,
            effects,
            stride,
        )
    }

    /// The torques of the sensors without noise, and those of the world without effects at the recorded angles. Every
    /// `stride`-th sample.
    pub fn with_and_without(
        &mut self,
        effects: &[Effect],
        nominal: &[Rows],
        stride: usize,
    ) -> (Vec<Rows>, Vec<Rows>) {
        let of_the_touch = effects
            .iter()
            .any(|e| !e.is_of_the_sensor() && !e.is_what_if());
        let touched = if of_the_touch {
            self.touch(effects, stride)
        } else {
            nominal.to_vec()
        };
        let q: Vec<Rows> = (self.plan.iter())
            .map(|t| t.q.iter().step_by(stride).copied().collect())
            .collect();
        let with = sense(effects, &self.base, &q, &touched, stride);
        if !effects.iter().any(Effect::is_what_if) {
            return (with, nominal.to_vec());
        }
        let recorded = self.recorded_angles(effects);
        let commanded: Vec<Rows> = (self.plan.iter_mut().zip(recorded))
            .map(|(t, recorded)| std::mem::replace(&mut t.q, recorded))
            .collect();
        let without = self.touch(&[], stride);
        for (t, q) in self.plan.iter_mut().zip(commanded) {
            t.q = q;
        }
        (with, without)
    }

    /// The encoder angles before rounding.
    fn recorded_angles(&self, effects: &[Effect]) -> Vec<Rows> {
        let mut recorded: Vec<Rows> = self.plan.iter().map(|t| t.q.clone()).collect();
        for effect in effects {
            if let Effect::EncoderOffset {
                offset,
                eccentricity,
            } = effect
            {
                for q in recorded.iter_mut().flatten() {
                    for (q, o) in q.iter_mut().zip(offset) {
                        *q += o * (1.0 + eccentricity * q.sin());
                    }
                }
            }
        }
        recorded
    }
}

/// The maker that the recordings name ([`Dataset::made_by`]).
pub const MAKER: &str = "vsf-world";

/// Generates the case `spec` and writes its recording into the folder `dir`, which is created.
///
/// The folder contains no hint of the case: it states nothing but its own name. The recording has the usual form:
/// `dataset.json`, `points.npy` (a regular grid of 12 mm over the object and 1 cm around it), `robot/robot.urdf`, and
/// `angles`, `velocities` and `torques` of six sequences with 700 samples at 70 Hz, four for training and two for test.
///
/// # Errors
/// [`WorldError`]. Names are checked before anything is simulated. Nothing is written before the case is complete.
///
/// ```no_run
/// use vsf_world::{CaseSpec, Kind, Level, Protocol, generate};
/// let spec = CaseSpec {
///     kind: Kind::Springs,
///     protocol: Protocol::Rich,
///     effects: vec!["stress_relaxation".into()],
///     level: Level::Clear,
///     seed: 4,
/// };
/// let label = generate(&spec, "case_0004".as_ref())?;
/// assert!((0.18..0.44).contains(&label.ratio_test));
/// # Ok::<(), vsf_world::WorldError>(())
/// ```
pub fn generate(spec: &CaseSpec, dir: &Path) -> Result<Label, WorldError> {
    check(spec)?;
    let mut world = World::draw(spec)?;
    let nominal = world.touch(&[], 1);
    let coarse = world.touch(&[], TRIAL_STRIDE);
    let mut rng = stream(spec.seed, 2);
    let (low, high) = spec.level.band();
    let mut applied = Vec::new();
    for name in &spec.effects {
        // Away from the edges of the band: trials are coarse.
        let target = rng.random_range(low * 1.1..high * 0.92);
        let mut trial = Trial {
            world: &mut world,
            fine: (&nominal, 1),
            coarse: (&coarse, TRIAL_STRIDE),
        };
        let found = find_strength(&mut trial, name, target, (low, high), spec.seed, &mut rng)?;
        let (phases, sequences) = where_it_acts(&found.diff, &world.plan);
        applied.push(AppliedEffect {
            joints: found.effect.joints(),
            level: spec.level,
            strength: found.strength,
            ratio_alone: found.ratio,
            phases,
            sequences,
            effect: found.effect,
        });
    }
    let effects: Vec<Effect> = applied.iter().map(|a| a.effect.clone()).collect();
    let (with, oracle) = world.with_and_without(&effects, &nominal, 1);
    let noise_ar1 = rng.random_range(0.2..0.4);
    let dataset = recording(&world, &effects, &with, noise_ar1, &mut rng, dir)?;
    dataset.save_with(dir, &[(urdf(), gen3::urdf().into())], &[])?;

    let diff = difference(&with, &oracle);
    let (rms_tau_test, rms_diff_test) = (rms_test(&oracle), rms_test(&diff));
    Ok(Label {
        spec: spec.clone(),
        class: spec.class(),
        effects: applied,
        what_if: effects.iter().any(Effect::is_what_if),
        rms_tau_test,
        rms_diff_test,
        ratio_test: rms_diff_test / rms_tau_test,
        diff_energy_train: energy(&diff[..FIRST_TEST]),
        diff_energy_test: energy(&diff[FIRST_TEST..]),
        truth_share: truth_share(&diff, &world.plan),
        peak_tau: peaks(&oracle),
        push_depth_m: world.plan.iter().map(|t| t.depth_m).collect(),
        schedule: world.plan.iter().map(|t| schedule(&t.phases)).collect(),
        noise_nm: NOISE_NM,
        noise_ar1,
        friction: world.friction,
        oracle,
    })
}

fn check(spec: &CaseSpec) -> Result<(), WorldError> {
    for name in &spec.effects {
        Effect::draw(name, &mut stream(0, 0), SEQUENCES)?;
        if spec.kind == Kind::Plant && name == "spatial_coupling" {
            return Err(WorldError::NotInThisWorld {
                effect: name.clone(),
                kind: "plant",
            });
        }
    }
    Ok(())
}

/// A separate random number stream for each purpose.
fn stream(seed: u64, purpose: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed.rotate_left(17) ^ purpose.wrapping_mul(0x9E37_79B9_7F4A_7C15))
}

/// Largest torque of each sequence.
fn peaks(tau: &[Rows]) -> Vec<f64> {
    let length = |t: &JointVector| t.iter().map(|x| x * x).sum::<f64>().sqrt();
    let peak = |rows: &Rows| rows.iter().map(length).fold(0.0, f64::max);
    tau.iter().map(peak).collect()
}

/// Whether touches of the same site, every other sequence, meet similar resistance. A shoot that is pushed along its axis
/// jams.
fn alike(peaks: &[f64]) -> bool {
    let site = |first: usize| peaks.iter().skip(first).step_by(2).copied();
    (0..2).all(|s| site(s).fold(0.0, f64::max) < 1.9 * site(s).fold(f64::INFINITY, f64::min))
}

/// The robot's path in a recording.
fn urdf() -> PathBuf {
    Path::new(Dataset::ROBOT).join("robot.urdf")
}

fn recording(
    world: &World,
    effects: &[Effect],
    tau: &[Rows],
    noise_ar1: f64,
    rng: &mut Pcg64Mcg,
    dir: &Path,
) -> Result<Dataset, WorldError> {
    let table = |rows: Rows| Table::new(JOINTS, rows.into_iter().flatten().collect());
    let mut sequences = Vec::new();
    for (s, q) in world.recorded_angles(effects).into_iter().enumerate() {
        let velocities = rates(&q, RATE_HZ);
        let rounded = |row: JointVector| row.map(|x| (x / ANGLE_STEP).round() * ANGLE_STEP);
        let time = (0..q.len()).map(|k| k as f64 / RATE_HZ).collect();
        let angles = table(q.into_iter().map(rounded).collect())?;
        let torques = table(noisy(&tau[s], noise_ar1, rng))?;
        sequences.push(Sequence {
            velocities: Some(table(velocities)?),
            ..Sequence::new(sequence_id(s), time, angles, torques)
        });
    }
    let points = grid(world.object.as_ref());
    let low = points.iter().fold(points[0], |a, b| a.inf(b));
    let high = points.iter().fold(points[0], |a, b| a.sup(b));
    let ids = |range: std::ops::Range<usize>| range.map(sequence_id).collect();
    let name = dir.file_name().map(|n| n.to_string_lossy().into_owned());
    let robot = RobotRef {
        given: urdf().to_string_lossy().into_owned(),
        path: Some(dir.join(urdf())),
    };
    Ok(Dataset {
        name: name.unwrap_or_default(),
        description: "Pushes of a Kinova Gen3 into a soft object; joint angles, velocities and \
                      external joint torques."
            .to_owned(),
        rate_hz: Some(RATE_HZ),
        gravity: GRAVITY,
        base_pose: world.base,
        object_bbox: Some([low, high]),
        splits: Splits {
            train: ids(0..FIRST_TEST),
            test: ids(FIRST_TEST..SEQUENCES),
        },
        rest_points: Some(points),
        made_by: Some(MAKER.to_owned()),
        ..Dataset::new(robot, sequences)
    })
}

/// Adds first-order autoregressive noise to torques.
fn noisy(tau: &[JointVector], ar1: f64, rng: &mut Pcg64Mcg) -> Rows {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let fresh = NOISE_NM * (1.0 - ar1 * ar1).sqrt();
    let mut noise: JointVector = std::array::from_fn(|_| NOISE_NM * normal());
    tau.iter()
        .map(|t| {
            let row = std::array::from_fn(|j| t[j] + noise[j]);
            noise = noise.map(|n| ar1 * n + fresh * normal());
            row
        })
        .collect()
}

/// The points of a recording: a regular grid over the object and a little beyond.
fn grid(object: &dyn Object) -> Vec<Point3<f64>> {
    let [low, high] = object.bounds();
    let low = low - Vector3::repeat(0.012);
    let count = (high - low).map(|x| (x / GRID).ceil() as usize + 1);
    triples(count.into())
        .map(|(i, j, k)| low + Vector3::new(i as f64, j as f64, k as f64) * GRID)
        .filter(|p| object.covers(p))
        .collect()
}

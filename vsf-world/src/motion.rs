//! Motion of the arm in a session.

use crate::WorldError;
use crate::arm::{Arm, JOINTS, JointVector, WorldCapsule};
use crate::object::{Object, Site};
use crate::reach::{Goal, reach};
use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use rand::RngExt;
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

/// Samples per sequence.
pub const SAMPLES: usize = 700;

/// Sample rate \[Hz\].
pub const RATE_HZ: f64 = 70.0;

/// Sequences per session; the last two are for test.
pub const SEQUENCES: usize = 6;

/// Index of the first test sequence.
pub const FIRST_TEST: usize = 4;

/// Time between the starts of two sequences \[s\].
pub const SESSION_STEP_S: f64 = 20.0;

/// What the arm does in a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// Free, approach, load, hold, unload, free; then a deeper touch at another speed with hold and unload, and free again.
    Rich,
    /// Approach, load, unload.
    PushOnly,
}

/// Phase of the arm's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Away from the object.
    Free,
    /// Moving toward the object.
    Approach,
    /// Pushing deeper into the object.
    Load,
    /// At rest in the object.
    Hold,
    /// Moving out of the object.
    Unload,
}

/// The commanded motion of one sequence.
#[derive(Debug, Clone)]
pub(crate) struct Trajectory {
    pub q: Vec<JointVector>,
    pub phases: Vec<Phase>,
    /// Largest commanded depth of the tip \[m\].
    pub depth_m: f64,
}

/// Distance from the object at which tip paths begin \[m\].
const STANDOFF: f64 = 0.055;

/// Distance from the object at which free motion reverses \[m\].
const PULLED_BACK: f64 = 0.09;

/// Distance before the tip's site at which the object is assumed to begin \[m\].
const SKIN: f64 = 0.006;

/// A motion between two depths; negative depths are outside the object.
struct Leg {
    phase: Phase,
    to: f64,
    seconds: f64,
}

/// The sequences of a session: two sites, each touched from three postures.
pub(crate) fn plan(
    object: &dyn Object,
    base: &Isometry3<f64>,
    protocol: Protocol,
    rng: &mut Pcg64Mcg,
    seed: u64,
) -> Result<Vec<Trajectory>, WorldError> {
    const TRIES: usize = 150;
    let from = base.translation.vector.into();
    for _ in 0..TRIES {
        let sites = [object.site(&from, rng), object.site(&from, rng)];
        let [Some(a), Some(b)] = sites else { continue };
        if (a.point - b.point).norm() < 0.08 {
            continue;
        }
        let styles = [Style::draw(&a, rng), Style::draw(&b, rng)];
        let mut planned = Vec::new();
        for s in 0..SEQUENCES {
            let style = &styles[s % 2];
            match (0..6).find_map(|_| touch(object, base, style, protocol, rng)) {
                Some(t) => planned.push(t),
                None => break,
            }
        }
        if planned.len() == SEQUENCES {
            return Ok(planned);
        }
    }
    Err(WorldError::OutOfReach { seed })
}

/// What the touches of one site have in common.
struct Style {
    site: Site,
    /// Pointing direction of the hand.
    pointing: Vector3<f64>,
    /// Angles from which the inverse kinematics start.
    start: JointVector,
}

impl Style {
    fn draw(site: &Site, rng: &mut Pcg64Mcg) -> Self {
        let home: JointVector = [0.0, 0.6, 3.1, -1.9, 0.0, 1.0, 1.5];
        let spread: JointVector = [0.8, 0.5, 1.0, 0.5, 1.0, 0.6, 3.0];
        Self {
            site: *site,
            pointing: turned(&site.inward, 0.3, rng),
            start: std::array::from_fn(|j| home[j] + rng.random_range(-spread[j]..spread[j])),
        }
    }
}

/// The direction turned by up to about `angle` \[rad\].
fn turned(v: &Vector3<f64>, angle: f64, rng: &mut Pcg64Mcg) -> Vector3<f64> {
    let axis = Vector3::from_fn(|_, _| rng.random_range(-angle..angle));
    UnitQuaternion::from_scaled_axis(axis) * v
}

/// A push at a site, from a random posture.
fn touch(
    object: &dyn Object,
    base: &Isometry3<f64>,
    style: &Style,
    protocol: Protocol,
    rng: &mut Pcg64Mcg,
) -> Option<Trajectory> {
    let mut arm = Arm::new(*base);
    let inward = Unit::new_normalize(turned(&style.site.inward, 0.07, rng));
    let pointing = Unit::new_normalize(turned(&style.pointing, 0.09, rng));
    let later = Unit::new_normalize(turned(&pointing, 0.08, rng));
    let aside = turned(&Vector3::x(), 3.0, rng).cross(&inward);
    let place = style.site.point + Vector3::from_fn(|_, _| rng.random_range(-0.003..0.003));
    let start = style.start.map(|q| q + rng.random_range(-0.3..0.3));
    let first = style.site.depth * rng.random_range(0.92..1.08);
    let second = first + rng.random_range(0.008..0.012);
    let deepest = if protocol == Protocol::Rich {
        second
    } else {
        first
    };
    let slide = rng.random_range(0.0..0.012);

    let from = -PULLED_BACK;
    let span = second - from;
    let goal = |share: f64| {
        let depth = from + span * share;
        let within = (depth / second).max(0.0);
        Goal {
            tip: place + inward.into_inner() * depth + aside * (slide * within * within),
            pointing: Unit::new_normalize(pointing.lerp(&later, share)),
        }
    };
    let mut knots = vec![reach(&mut arm, &start, &goal(0.0))?];
    // Angles of endless joints near those at which the arm stands.
    for k in 1..=KNOTS {
        let last = knots[k - 1];
        let q = reach(&mut arm, &last, &goal(k as f64 / KNOTS as f64))?;
        let smooth = q.iter().zip(&last).all(|(a, b)| (a - b).abs() < 0.16);
        knots.push(smooth.then_some(q)?);
    }
    let path = Spline(&knots);
    let at = |depth: f64| path.at((depth - from) / span);
    if !is_clear(object, &mut arm, &at(-STANDOFF), &at(deepest)) {
        return None;
    }
    let mut depth = -STANDOFF;
    let mut q = Vec::with_capacity(SAMPLES);
    let mut phases = Vec::with_capacity(SAMPLES);
    for leg in legs(protocol, first, second, rng) {
        let steps = (leg.seconds * RATE_HZ).round().max(1.0) as usize;
        for k in 1..=steps {
            let x = k as f64 / steps as f64;
            let share = x * x * x * (10.0 - 15.0 * x + 6.0 * x * x);
            let now = depth + (leg.to - depth) * share;
            q.push(at(now));
            phases.push(match leg.phase {
                Phase::Load if now < -SKIN => Phase::Approach,
                // What sticks lets go later.
                Phase::Unload if now < -5.0 * SKIN => Phase::Free,
                phase => phase,
            });
        }
        depth = leg.to;
    }
    let rest = *q.last()?;
    q.resize(SAMPLES, rest);
    phases.resize(SAMPLES, Phase::Free);
    Some(Trajectory {
        q,
        phases,
        depth_m: deepest,
    })
}

/// The parts of a sequence. A load is one sweep from outside.
fn legs(protocol: Protocol, first: f64, second: f64, rng: &mut Pcg64Mcg) -> Vec<Leg> {
    let mut leg = |phase, to, seconds: f64| Leg {
        phase,
        to,
        seconds: seconds * rng.random_range(0.85..1.15),
    };
    let quick = leg(Phase::Free, 0.0, 1.0).seconds < 1.0;
    let (one, two) = if quick { (1.7, 2.5) } else { (2.5, 1.7) };
    match protocol {
        Protocol::Rich => vec![
            leg(Phase::Free, -STANDOFF, 0.3),
            leg(Phase::Load, first, one),
            leg(Phase::Hold, first, 0.9),
            leg(Phase::Unload, -STANDOFF, 1.2),
            leg(Phase::Free, -PULLED_BACK, 0.5),
            leg(Phase::Load, second, two),
            leg(Phase::Hold, second, 0.9),
            leg(Phase::Unload, -STANDOFF, 0.9),
        ],
        Protocol::PushOnly => vec![
            leg(Phase::Load, first, 3.6),
            leg(Phase::Unload, -STANDOFF, 3.0),
        ],
    }
}

/// Whether the arm is free at standoff, and at depth only the hand and the wrist are in the object.
fn is_clear(object: &dyn Object, arm: &mut Arm, out: &JointVector, deep: &JointVector) -> bool {
    let mut capsules: Vec<WorldCapsule> = Vec::new();
    arm.set(out);
    arm.capsules(&mut capsules);
    if capsules.iter().any(|c| object.overlap(c) > 0) {
        return false;
    }
    let lowest = capsules[2..].iter().map(|c| c.a.z.min(c.b.z) - c.radius);
    if lowest.fold(f64::INFINITY, f64::min) < 0.0 {
        return false;
    }
    arm.set(deep);
    arm.capsules(&mut capsules);
    let in_object = |arm_part: bool| -> usize {
        let parts = capsules
            .iter()
            .filter(|c| (c.link < JOINTS - 1) == arm_part);
        parts.map(|c| object.overlap(c)).sum()
    };
    in_object(true) == 0 && in_object(false) > 0
}

const KNOTS: usize = 12;

/// A Catmull-Rom curve through equidistant knots.
struct Spline<'a>(&'a [JointVector]);

impl Spline<'_> {
    fn at(&self, share: f64) -> JointVector {
        let last = self.0.len() - 1;
        let x = share.clamp(0.0, 1.0) * last as f64;
        let k = (x.floor() as usize).min(last - 1);
        let t = x - k as f64;
        let [p0, p1, p2, p3] =
            [k.saturating_sub(1), k, k + 1, (k + 2).min(last)].map(|i| &self.0[i]);
        std::array::from_fn(|j| {
            let (a, b, c, d) = (p0[j], p1[j], p2[j], p3[j]);
            b + 0.5
                * t
                * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)))
        })
    }
}

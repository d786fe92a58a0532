use super::PipelineWarning;
use super::saturation::{Saturation, saturated};
use super::springs::Springs;
use crate::{Scene, Trace, reading_unit};
use std::ops::Range;
use vsf_data::{Sequence, TorqueKind};
use vsf_robots::Joint;

/// Samples in contact that say something.
pub(super) const LEAST_ROWS: usize = 6;
/// Samples in a row that stay at one value.
const LEAST_RUN: usize = 3;
/// Share of the largest torques of springs, or of a joint's own of the arm, by which those of a joint change where touch,
/// or the arm, does.
pub(super) const LEAST_CHANGE: f64 = 0.2;
/// Rounded readings stay at a value as well: of a joint that feels less than so many steps nothing can be said, nor
/// of its largest reading where one step is more than this share of their range.
pub(super) const LEAST_STEPS: f64 = 4.0;
const MOST_STEP: f64 = 0.02;
/// A sensor that goes on again jumps by more than so many steps; readings that are rounded go on by one.
const LEAST_JUMP: f64 = 2.5;
/// What a tare leaves of zero is less than this share of the range of the readings.
const ROUNDING: f64 = 1e-9;
/// Share of its largest reading from which a sensor does not come down to zero in one sample.
pub(super) const LEAST_DROP: f64 = 0.3;

/// A sequence beside the torques of springs of one stiffness, zero where nothing is touched.
struct Touched<'a> {
    sequence: &'a Sequence,
    springs: &'a Springs,
    contact: Vec<bool>,
}

/// Rows of a sequence in which a joint reads one value.
type Run<'a> = (&'a Sequence, Range<usize>, f64);

/// Reports joints whose readings stay at one value while touch changes: over a sequence, or at the end of
/// their range.
pub fn warnings(
    scene: &Scene,
    sequences: &[&Sequence],
    traces: &[Trace],
    springs: &[Springs],
) -> Vec<PipelineWarning> {
    let pairs = sequences.iter().zip(traces).zip(springs);
    let touched: Vec<Touched> = pairs
        .map(|((sequence, trace), springs)| Touched {
            sequence,
            springs,
            contact: trace.observations.iter().map(|o| !o.is_empty()).collect(),
        })
        .collect();
    let joints = 0..scene.robot().joint_count();
    let still = joints
        .clone()
        .filter_map(|j| stuck(scene, &touched, j).or_else(|| zero(scene, &touched, j)));
    let sides = joints.flat_map(|j| [1.0, -1.0].map(|side| (j, side)));
    // Beside the weight of the arm, a light touch may be less than a step of the rounding of actuators' readings.
    let clipped: Vec<PipelineWarning> = if scene.torque_kind() == TorqueKind::Measured {
        Vec::new()
    } else {
        let beneath_noise = saturated(traces, springs);
        let of = |(j, side): (usize, f64)| {
            let own = |s: &&Saturation| s.joint == j && s.level * side > 0.0;
            let found = || beneath_noise.iter().find(own);
            clipped(scene, &touched, j, side).or_else(|| Some(found()?.warning(scene, traces)))
        };
        sides.filter_map(of).collect()
    };
    let frozen = frozen(scene, &touched);
    still.chain(clipped).chain(frozen).collect()
}

fn stuck(scene: &Scene, touched: &[Touched], j: usize) -> Option<PipelineWarning> {
    let still = |t| Some((t, Touched::still_at(t, j).filter(|value| *value != 0.0)?));
    let mut found = touched.iter().filter_map(still);
    let (first, value) = found.next()?;
    let joint = &scene.robot().joints()[j];
    Some(PipelineWarning::StuckReadings {
        joint: joint.name().to_owned(),
        sequence: first.sequence.id.clone(),
        value,
        unit: reading_unit(joint),
        others: found.count(),
    })
}

/// A joint that reads zero throughout, beside others that read something.
fn zero(scene: &Scene, touched: &[Touched], j: usize) -> Option<PipelineWarning> {
    let all = |k: usize| touched.iter().all(|t| t.readings(k).all(|v| v == 0.0));
    let is_zero = all(j) && !(0..scene.robot().joint_count()).all(all);
    (is_zero && touched.iter().any(|t| t.still_at(j).is_some())).then(|| {
        PipelineWarning::ZeroReadings {
            joint: scene.robot().joints()[j].name().to_owned(),
        }
    })
}

impl Touched<'_> {
    fn readings(&self, j: usize) -> impl Iterator<Item = f64> + Clone {
        self.sequence.torques.column(j)
    }

    /// What a joint reads throughout, though touch would change that.
    fn still_at(&self, j: usize) -> Option<f64> {
        let value = self.readings(j).next()?;
        let is_still = self.readings(j).all(|v| v == value);
        if !is_still || self.contact.iter().filter(|c| **c).count() < LEAST_ROWS {
            return None;
        }
        let spread = |j: usize| range(self.springs.iter().map(|s| s[j]));
        let joints = || (0..self.sequence.width()).map(|k| (k, spread(k)));
        let moves = |(k, _): &(usize, f64)| range(self.readings(*k)) > 0.0;
        let most = |a: &(usize, f64), b: &(usize, f64)| a.1.total_cmp(&b.1);
        let Some((other, widest)) = joints().filter(moves).max_by(most) else {
            // No reading moves at all: none tells of rounding.
            let widest = joints().max_by(most)?.1;
            return (spread(j) > LEAST_CHANGE * widest).then_some(value);
        };
        // What its readings would change by, were the object of one stiffness, in steps of rounding.
        let expected = range(self.readings(other)) * spread(j) / widest;
        let steps = expected > LEAST_STEPS * step(self.readings(other));
        (steps && spread(j) > LEAST_CHANGE * widest).then_some(value)
    }

    /// Where all joints read zero from one sample to the next in the middle of a touch, and the joint that loses most.
    fn lost(&self) -> Option<(usize, Run<'_>)> {
        let torques = &self.sequence.torques;
        let norm = |row: &[f64]| row.iter().map(|t| t * t).sum::<f64>().sqrt();
        let largest = torques.iter().map(norm).fold(0.0, f64::max);
        let silent: Vec<bool> = torques.iter().map(|row| norm(row) == 0.0).collect();
        let (rows, _) = runs(&silent).find(|(rows, is_silent)| {
            let touches = || self.contact[rows.start..].iter().take(LEAST_ROWS);
            *is_silent
                && rows.len() >= LEAST_ROWS
                && rows.start > 0
                && norm(&torques[rows.start - 1]) >= LEAST_DROP * largest
                && touches().all(|c| *c)
        })?;
        let before = &torques[rows.start - 1];
        let most =
            (0..before.len()).max_by(|a, b| before[*a].abs().total_cmp(&before[*b].abs()))?;
        Some((most, (self.sequence, rows, 0.0)))
    }
}

/// Joints that stay at one value for a while, inside of their range and while touch would change them. Of readings of the
/// actuators nothing is said, as of saturated ones.
fn frozen(scene: &Scene, touched: &[Touched]) -> Option<PipelineWarning> {
    if scene.torque_kind() == TorqueKind::Measured {
        return None;
    }
    let of_joint = |j: usize| {
        let all = touched.iter().flat_map(|t| t.readings(j));
        let (low, high) = all.fold((0.0_f64, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        touched.iter().find_map(|t| {
            let readings: Vec<f64> = t.readings(j).collect();
            let springs = range(t.springs.iter().map(|s| s[j]));
            let step = step(readings.iter().copied());
            runs(&readings).find_map(|(rows, value)| {
                let change = range(t.springs[rows.clone()].iter().map(|s| s[j])) / springs;
                let steps = change * (high - low) / step;
                let is_zero = value.abs() <= ROUNDING * (high - low);
                let inside = low < value && value < high && !is_zero;
                let next = readings.get(rows.end);
                let jumps = next.is_none_or(|next| (next - value).abs() > LEAST_JUMP * step);
                (inside
                    && jumps
                    && rows.len() >= LEAST_ROWS
                    && change > LEAST_CHANGE
                    && steps > LEAST_STEPS)
                    .then_some((t.sequence, rows, value))
            })
        })
    };
    let joints = scene.robot().joints().iter().enumerate();
    let mut found = joints.filter_map(|(j, joint)| Some((joint, of_joint(j)?)));
    let warning =
        |joint: &Joint, (sequence, rows, value): Run, others| PipelineWarning::FrozenReadings {
            joint: joint.name().to_owned(),
            sequence: sequence.id.clone(),
            row: rows.start,
            count: rows.len(),
            value,
            unit: reading_unit(joint),
            others,
        };
    match found.next() {
        Some((joint, run)) => Some(warning(joint, run, found.count())),
        None => {
            let (j, run) = touched.iter().find_map(Touched::lost)?;
            let all = scene.robot().joints();
            Some(warning(&all[j], run, all.len() - 1))
        }
    }
}

/// Flat tops of the readings, or flat bottoms, where touch goes on to change.
fn clipped(scene: &Scene, touched: &[Touched], j: usize, side: f64) -> Option<PipelineWarning> {
    let readings = || touched.iter().flat_map(|t| t.readings(j).map(|v| side * v));
    let end = readings().fold(0.0, f64::max);
    let steps = touched.iter().map(|t| step(t.readings(j)));
    let step = steps.fold(f64::INFINITY, f64::min);
    let all = range(readings());
    if end <= ROUNDING * all || step > MOST_STEP * all {
        return None;
    }
    let springs = touched.iter().flat_map(|t| t.springs).map(|s| s[j]);
    let least = LEAST_CHANGE * range(springs);
    let (mut count, mut first) = (0, None);
    for t in touched {
        let readings: Vec<f64> = t.readings(j).map(|v| side * v).collect();
        for (rows, value) in runs(&readings) {
            let changes = || range(t.springs[rows.clone()].iter().map(|s| s[j])) > least;
            if value == end && rows.len() >= LEAST_RUN && changes() {
                count += rows.len();
                first = first.or(Some((t.sequence, rows.start)));
            }
        }
    }
    let (sequence, row) = first.filter(|_| count >= LEAST_ROWS)?;
    let joint = &scene.robot().joints()[j];
    Some(PipelineWarning::ClippedReadings {
        joint: joint.name().to_owned(),
        count,
        value: side * end,
        unit: reading_unit(joint),
        sequence: sequence.id.clone(),
        row,
    })
}

/// Runs of equal values, as readings: their rows, and which they are.
pub(super) fn runs<T: Copy + PartialEq>(values: &[T]) -> impl Iterator<Item = (Range<usize>, T)> {
    values.chunk_by(|a, b| a == b).scan(0, |end, run| {
        let start = *end;
        *end += run.len();
        Some((start..*end, run[0]))
    })
}

/// Largest less smallest, 0 without any.
pub(super) fn range(values: impl Iterator<Item = f64>) -> f64 {
    let ends = values.fold(None, |ends: Option<(f64, f64)>, v| {
        Some(ends.map_or((v, v), |(lo, hi)| (lo.min(v), hi.max(v))))
    });
    ends.map_or(0.0, |(lo, hi)| hi - lo)
}

/// Smallest change from one reading to the next: the step of those that are rounded.
pub(super) fn step(readings: impl Iterator<Item = f64> + Clone) -> f64 {
    let changes = readings.clone().zip(readings.skip(1));
    let sizes = changes.map(|(a, b)| (b - a).abs()).filter(|d| *d > 0.0);
    sizes.fold(f64::INFINITY, f64::min)
}

use super::{PipelineWarning, unit};
use std::ops::Range;
use vsf_core::median;
use vsf_data::Sequence;
use vsf_robots::{Joint, RobotModel};

/// Times a joint's velocity limit beyond which a change of position is none that the robot made.
const MOST_SPEED: f64 = 3.0;
/// Changes count from this on (rad or m): encoders of fast controllers count in steps.
const LEAST_JUMP: f64 = 0.01;

/// The change of one joint's position that leads to a row of a touch, from the row before.
struct Step<'a> {
    joint: &'a Joint,
    j: usize,
    sequence: &'a Sequence,
    /// Index of the sequence.
    index: usize,
    touch: Range<usize>,
    row: usize,
}

impl Step<'_> {
    /// The change that leads to a row, of the same joint (rad or m).
    fn way(&self, row: usize) -> f64 {
        let angles = &self.sequence.angles;
        let (before, after) = (angles[row - 1][self.j], angles[row][self.j]);
        self.joint.change(before, after).abs()
    }

    /// The time that it takes (s).
    fn time(&self, row: usize) -> f64 {
        self.sequence.time[row] - self.sequence.time[row - 1]
    }

    /// Position before and after.
    fn ends(&self) -> [f64; 2] {
        [self.row - 1, self.row].map(|row| self.sequence.angles[row][self.j])
    }
}

/// The first odd step, and how many other joints have one.
fn first<'a>(
    robot: &'a RobotModel,
    sequences: &[&'a Sequence],
    is_odd: impl Fn(&Step<'_>) -> bool,
) -> Option<(Step<'a>, usize)> {
    let of_joint = |(j, joint): (usize, &'a Joint)| {
        let sequences = sequences.iter().enumerate();
        let touches = sequences.flat_map(|(i, s)| s.touches().map(move |touch| (i, *s, touch)));
        let steps = touches.flat_map(|(index, sequence, touch)| {
            let rows = touch.start + 1..touch.end;
            let step = move |row| Step {
                joint,
                j,
                sequence,
                index,
                touch: touch.clone(),
                row,
            };
            rows.map(step)
        });
        steps.into_iter().find(|step| is_odd(step))
    };
    let mut found = robot.joints().iter().enumerate().filter_map(of_joint);
    let step = found.next()?;
    Some((step, found.count()))
}

/// Reports positions that change, within a touch, faster than the robot can move.
pub fn warning(robot: &RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    // Median time between samples (s).
    let tick = |s: &&Sequence| {
        let steps = s.time.windows(2).map(|t| t[1] - t[0]);
        median(steps.collect()).unwrap_or(0.0)
    };
    let ticks: Vec<f64> = sequences.iter().map(tick).collect();
    let (step, others) = first(robot, sequences, |step| {
        let way = step.way(step.row);
        // Stamps of single samples jitter.
        let dt = step.time(step.row).max(ticks[step.index]);
        way > LEAST_JUMP && way > MOST_SPEED * step.joint.limits().velocity * dt
    })?;
    let [from, to] = step.ends();
    Some(PipelineWarning::Jumps {
        joint: step.joint.name().to_owned(),
        limit: step.joint.limits().velocity,
        unit: unit(step.joint),
        sequence: step.sequence.id.clone(),
        row: step.row,
        from,
        to,
        others,
    })
}

/// A change of position that is so many times as fast as all of so many before and after it, but for the next ones, is a leap;
/// unless these move by less than a share of it altogether, as where an arm rests in one pose and then in another.
const MOST_TIMES: f64 = 8.0;
const BESIDE: usize = 10;
const FEWEST_BESIDE: usize = 5;
const LEAST_MOVED: f64 = 0.1;

/// Reports positions that change, from one row to the next, far more than beside it: rows that are missing, exchanged or
/// repeated.
pub fn leaps(robot: &RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let (step, others) = first(robot, sequences, |step| {
        let (row, touch) = (step.row, &step.touch);
        let before = (touch.start + 1).max(row.saturating_sub(BESIDE + 1))..row.saturating_sub(1);
        let after = row + 2..touch.end.min(row + 2 + BESIDE);
        if before.len().min(after.len()) < FEWEST_BESIDE {
            return false;
        }
        let way = step.way(row);
        let moved = |rows: &Range<usize>| rows.clone().map(|r| step.way(r)).sum::<f64>();
        let is_far = |other| {
            let (beside, times) = (step.way(other), step.time(row) / step.time(other));
            way > MOST_TIMES * beside && way > MOST_TIMES * beside * times
        };
        way > LEAST_JUMP
            && moved(&before).max(moved(&after)) > LEAST_MOVED * way
            && before.chain(after).all(is_far)
    })?;
    let [from, to] = step.ends();
    Some(PipelineWarning::Leaps {
        joint: step.joint.name().to_owned(),
        unit: unit(step.joint),
        sequence: step.sequence.id.clone(),
        row: step.row,
        from,
        to,
        others,
    })
}

/// Reports velocities that the robot cannot reach, where positions do not change as fast.
pub fn speeds(robot: &RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let fast = |(j, joint): (usize, &Joint)| {
        let limit = joint.limits().velocity;
        let (sequence, row, value) = sequences.iter().find_map(|s| {
            let way = |k: usize| joint.change(s.angles[k - 1][j], s.angles[k][j]).abs();
            let dt = |k: usize| s.time[k] - s.time[k - 1];
            let fast = |(row, v): &(usize, f64)| {
                let steps = (*row).max(1)..(row + 2).min(s.len());
                v.abs() > MOST_SPEED * limit
                    && steps.into_iter().all(|k| way(k) < 0.5 * v.abs() * dt(k))
            };
            let mut column = s.velocities.as_ref()?.column(j).enumerate();
            let (row, v) = column.find(fast)?;
            Some((s.id.clone(), row, v))
        })?;
        Some((
            joint.name().to_owned(),
            limit,
            unit(joint),
            sequence,
            row,
            value,
        ))
    };
    let mut found = robot.joints().iter().enumerate().filter_map(fast);
    let (joint, limit, unit, sequence, row, value) = found.next()?;
    Some(PipelineWarning::TooFast {
        joint,
        limit,
        unit,
        sequence,
        row,
        value,
        others: found.count(),
    })
}

/// The rows of a sequence that continue the row before them.
pub fn moves(sequence: &Sequence) -> impl Iterator<Item = usize> {
    sequence.touches().flat_map(|touch| touch.skip(1))
}

use super::{PipelineWarning, unit};
use std::ops::Range;
use vsf_core::median;
use vsf_data::Sequence;
use vsf_robots::{Joint, RobotModel};

/// Times a joint's velocity limit beyond which a change of position is none that the robot made.
const MOST_SPEED: f64 = 3.0;
/// Changes count from this on (rad or m): encoders of fast controllers count in steps.
const LEAST_JUMP: f64 = 0.01;

/// Reports positions that change, within a touch, faster than the robot can move.
pub fn warning<'r>(robot: &'r RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    // Median time between samples (s).
    let tick = |s: &&Sequence| {
        let steps = s.time.windows(2).map(|t| t[1] - t[0]);
        median(steps.collect()).unwrap_or(0.0)
    };
    let ticks: Vec<f64> = sequences.iter().map(tick).collect();
    let jump = |(j, joint): (usize, &'r Joint)| {
        let limit = joint.limits().velocity;
        let (sequence, row) = (sequences.iter().zip(&ticks)).find_map(|(s, tick)| {
            let far = |row: &usize| {
                let way = joint.change(s.angles[row - 1][j], s.angles[*row][j]).abs();
                // Stamps of single samples jitter.
                let dt = (s.time[*row] - s.time[row - 1]).max(*tick);
                way > LEAST_JUMP && way > MOST_SPEED * limit * dt
            };
            moves(s).find(far).map(|row| (*s, row))
        })?;
        Some((joint, j, sequence, row))
    };
    let mut found = robot.joints().iter().enumerate().filter_map(jump);
    let (joint, j, sequence, row) = found.next()?;
    Some(PipelineWarning::Jumps {
        joint: joint.name().to_owned(),
        limit: joint.limits().velocity,
        unit: unit(joint),
        sequence: sequence.id.clone(),
        row,
        from: sequence.angles[row - 1][j],
        to: sequence.angles[row][j],
        others: found.count(),
    })
}

/// A change of position that is so many times as fast as all of so many before and after it, but for the next ones, is a leap;
/// unless these move by less than a share of it altogether, as where an arm rests in one pose and then in another.
const MOST_TIMES: f64 = 8.0;
const BESIDE: usize = 10;
const FEWEST_BESIDE: usize = 5;
const LEAST_MOVED: f64 = 0.1;

/// Positions that change, from one row to the next, far more than beside it: rows that are missing, exchanged or repeated.
pub fn leaps<'r>(robot: &'r RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let leap = |(j, joint): (usize, &'r Joint)| {
        sequences.iter().find_map(|s| {
            let way = |row: usize| joint.change(s.angles[row - 1][j], s.angles[row][j]).abs();
            let speed = |row: usize| way(row) / (s.time[row] - s.time[row - 1]);
            s.touches().find_map(|touch| {
                let leap = |row: &usize| {
                    let before = (touch.start + 1).max(row.saturating_sub(BESIDE + 1))
                        ..row.saturating_sub(1);
                    let after = row + 2..touch.end.min(row + 2 + BESIDE);
                    let is_amid = before.len().min(after.len()) >= FEWEST_BESIDE;
                    let beside = || before.clone().chain(after.clone());
                    let moves = |rows: Range<usize>| rows.map(way).sum::<f64>();
                    is_amid
                        && way(*row) > LEAST_JUMP
                        && moves(before.clone()).max(moves(after.clone())) > LEAST_MOVED * way(*row)
                        && beside().all(|other| {
                            speed(*row) > MOST_TIMES * speed(other)
                                && way(*row) > MOST_TIMES * way(other)
                        })
                };
                let row = touch.clone().skip(1).find(leap)?;
                Some((joint, j, *s, row))
            })
        })
    };
    let mut found = robot.joints().iter().enumerate().filter_map(leap);
    let (joint, j, sequence, row) = found.next()?;
    Some(PipelineWarning::Leaps {
        joint: joint.name().to_owned(),
        unit: unit(joint),
        sequence: sequence.id.clone(),
        row,
        from: sequence.angles[row - 1][j],
        to: sequence.angles[row][j],
        others: found.count(),
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

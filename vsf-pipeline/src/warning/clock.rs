use super::jumps::moves;
use super::{PipelineWarning, unit as unit_of};
use vsf_core::median;
use vsf_data::Sequence;
use vsf_robots::{JointKind, RobotModel};

/// Samples of a recording come less than so many seconds apart, as a rule.
const MOST_STEP: f64 = 1.0;
/// No touch is as slow as this (rad/s and m/s).
const LEAST_SPEED: (f64, f64) = (2e-3, 1e-4);
/// Joints that move by less (rad or m) stand still.
const LEAST_WAY: f64 = 1e-3;

/// Times a joint's velocity limit that no joint moves at on average.
const MOST_SPEED: f64 = 3.0;

/// The unit that a step between samples, which should be in seconds, seems to have.
pub fn unit(step: f64) -> &'static str {
    match step {
        step if step < 1e3 => "milliseconds",
        step if step < 1e6 => "microseconds",
        _ => "nanoseconds",
    }
}

/// Reports time stamps that advance far too fast.
pub fn warning(robot: &RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let slow = |s: &&Sequence| {
        let dt = |row: usize| s.time[row] - s.time[row - 1];
        let step = median(moves(s).map(dt).collect()).filter(|step| *step >= MOST_STEP)?;
        let (mut fastest, mut is_slow, mut moved) = (0.0_f64, true, false);
        for (j, joint) in robot.joints().iter().enumerate() {
            let least = match joint.kind() {
                JointKind::Prismatic => LEAST_SPEED.1,
                _ => LEAST_SPEED.0,
            };
            let way = |row: usize| joint.change(s.angles[row - 1][j], s.angles[row][j]).abs();
            let all: f64 = moves(s).map(way).sum();
            // By way: neither rest nor one brisk step counts for much.
            let speed = moves(s)
                .map(|row| way(row) * way(row) / dt(row))
                .sum::<f64>()
                / all.max(f64::MIN_POSITIVE);
            moved |= all > LEAST_WAY;
            is_slow &= speed < least;
            fastest = fastest.max(speed);
        }
        (is_slow && moved).then(|| (s.id.clone(), step, fastest))
    };
    let mut found = sequences.iter().filter_map(slow);
    let (sequence, step, fastest) = found.next()?;
    Some(PipelineWarning::SlowClock {
        sequence,
        step,
        fastest,
        others: found.count(),
    })
}

/// Reports time stamps that advance far too slowly: joints move faster than they can, all the way of a
/// sequence.
pub fn fast(robot: &RobotModel, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let fast = |s: &&Sequence| {
        let all: f64 = moves(s).map(|row| s.time[row] - s.time[row - 1]).sum();
        robot.joints().iter().enumerate().find_map(|(j, joint)| {
            let way = |row: usize| joint.change(s.angles[row - 1][j], s.angles[row][j]).abs();
            let speed = moves(s).map(way).sum::<f64>() / all.max(f64::MIN_POSITIVE);
            let limit = joint.limits().velocity;
            (speed > MOST_SPEED * limit).then(|| (s.id.clone(), joint, speed, limit))
        })
    };
    let mut found = sequences.iter().filter_map(fast);
    let (sequence, joint, speed, limit) = found.next()?;
    Some(PipelineWarning::FastClock {
        sequence,
        joint: joint.name().to_owned(),
        speed,
        limit,
        unit: unit_of(joint),
        others: found.count(),
    })
}

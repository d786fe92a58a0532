use super::{PipelineWarning, Rows, clock, gaps, jumps, malformed, outliers, unit, velocities};
use crate::readings::check_sequence;
use crate::unwound;
use std::f64::consts::PI;
use vsf_data::Sequence;
use vsf_robots::{Joint, JointKind, RobotModel};

/// Joint limits are rounded in URDFs and met by controllers with a little overshoot (rad or m).
const LIMIT_SLACK: f64 = 1e-3;
/// Joints of arms turn no faster than this (rad/s).
const MOST_TURNING: f64 = 15.0;
/// No joint that counts in radians turns further than this from zero, or from its limits.
const MOST_TURNS: f64 = 4.0 * PI;
const MOST_BEYOND: f64 = PI;

/// Checks the joint positions and velocities.
///
/// Reports degrees, positions outside the robot's limits, jumps, missing samples, and velocities that
/// contradict the change of positions. If [`Sequence::check`] refuses a sequence, or if it has other joints
/// than the robot, only that is reported.
pub fn motion_warnings(robot: &RobotModel, sequences: &[&Sequence]) -> Vec<PipelineWarning> {
    let checked = |s: &&Sequence| (s.id.clone(), check_sequence(robot, s));
    let malformed = malformed(sequences.iter().map(checked));
    if !malformed.is_empty() {
        return malformed;
    }
    let rows: Vec<Rows> = (sequences.iter())
        .map(|s| (s.id.as_str(), s.angles.iter().collect()))
        .collect();
    let beyond = |joint: &Joint, slack: f64| {
        let (lower, upper) = (joint.limits().lower - slack, joint.limits().upper + slack);
        move |q: f64| !(lower..=upper).contains(&q)
    };
    let of_joint = |(j, joint): (usize, &Joint)| {
        let turns = match joint.kind() {
            JointKind::Prismatic => false,
            JointKind::Revolute => true,
            // Goes on and on, if no faster than joints turn.
            JointKind::Continuous => sequences.iter().any(|s| top_speed(s, j) > MOST_TURNING),
        };
        let far = beyond(joint, MOST_BEYOND);
        if turns && let Some(found) = outliers(joint, j, &rows, |q| q.abs() > MOST_TURNS || far(q))
        {
            return Some(PipelineWarning::Degrees(found));
        }
        Some(PipelineWarning::OutsideLimits {
            lower: joint.limits().lower,
            upper: joint.limits().upper,
            unit: unit(joint),
            outliers: outliers(joint, j, &rows, beyond(joint, LIMIT_SLACK))?,
        })
    };
    let joints = robot.joints().iter().enumerate();
    let mut found: Vec<PipelineWarning> = joints.filter_map(of_joint).collect();
    if !(found.iter()).any(|w| matches!(w, PipelineWarning::Degrees(_))) {
        let jumps = || jumps::warning(robot, sequences);
        let leaps = || jumps::leaps(robot, sequences);
        found.extend(clock::fast(robot, sequences).or_else(jumps).or_else(leaps));
    }
    found.extend(gaps::warning(sequences));
    let unwound: Vec<_> = sequences.iter().map(|s| unwound(robot, s)).collect();
    let clock = || clock::warning(robot, sequences);
    let still = || velocities::still(robot, &unwound);
    let frozen = || velocities::frozen(robot, &unwound);
    let fast = || jumps::speeds(robot, sequences);
    found.extend(
        velocities::warning(robot, &unwound)
            .or_else(still)
            .or_else(frozen)
            .or_else(fast)
            .or_else(clock),
    );
    found
}

/// Most that a position changes from sample to sample, per time between them.
fn top_speed(sequence: &Sequence, j: usize) -> f64 {
    let speed = |k: usize| {
        let way = sequence.angles[k][j] - sequence.angles[k - 1][j];
        way.abs() / (sequence.time[k] - sequence.time[k - 1])
    };
    (1..sequence.len()).map(speed).fold(0.0, f64::max)
}

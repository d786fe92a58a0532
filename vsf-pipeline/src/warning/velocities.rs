use super::PipelineWarning;
use std::borrow::Cow;
use std::ops::Range;
use vsf_core::median;
use vsf_data::Sequence;
use vsf_robots::RobotModel;

/// Parts that a touch is cut into to compare them.
const PARTS: usize = 20;
/// Moves count from half of the longest one of their joint on, and from this on (rad or m).
const LEAST_MOVE: f64 = 1e-3;
/// Fewer moves say nothing.
const LEAST_MOVES: usize = 3;
/// Moves by velocities alone count from this on (rad or m), and from this share of the longer ones on.
const LEAST_STILL: f64 = 0.01;
const STILL_SHARE: f64 = 0.1;
/// Positions that follow so closely, with this correlation, do move.
const FOLLOWS: f64 = 0.9;
/// Most that velocities may be of what they should be, or that of them; those of one sequence alone, of few moves.
const MOST: f64 = 1.5;
const MOST_ALONE: f64 = 3.0;

/// Reports velocities that contradict the change of positions, in all sequences or in one.
pub fn warning(robot: &RobotModel, sequences: &[Cow<'_, Sequence>]) -> Option<PipelineWarning> {
    let alone = |s: &Cow<'_, Sequence>| {
        let found = odd(robot, std::slice::from_ref(s), MOST_ALONE)?;
        Some(found.in_sequence(&s.id))
    };
    odd(robot, sequences, MOST).or_else(|| sequences.iter().find_map(alone))
}

fn odd(robot: &RobotModel, sequences: &[Cow<'_, Sequence>], most: f64) -> Option<PipelineWarning> {
    let odd = |(j, joint): (usize, &vsf_robots::Joint)| {
        let factor = factor(sequences, j)?;
        let is_odd = !(1.0 / most..=most).contains(&factor);
        is_odd.then(|| (joint.name().to_owned(), factor))
    };
    let mut found = robot.joints().iter().enumerate().filter_map(odd);
    let (joint, factor) = found.next()?;
    Some(PipelineWarning::Velocities {
        joint,
        factor,
        others: found.count(),
    })
}

/// Reports joints whose positions stay constant while their velocities say that they move.
pub fn still(robot: &RobotModel, sequences: &[Cow<'_, Sequence>]) -> Option<PipelineWarning> {
    let is_still = |(j, _): &(usize, &vsf_robots::Joint)| {
        let moves: Vec<_> = sequences.iter().flat_map(|s| moves(s, *j)).collect();
        let longest = (moves.iter()).fold(0.0, |most: f64, (_, integral)| most.max(integral.abs()));
        let least = LEAST_STILL.max(0.5 * longest);
        let long = || moves.iter().filter(|(_, integral)| integral.abs() >= least);
        let still = long().filter(|(way, integral)| way.abs() < 0.01 * integral.abs());
        let still = still.count();
        let is_often = still >= LEAST_MOVES && still as f64 > STILL_SHARE * long().count() as f64;
        is_often && !follows(&moves)
    };
    let mut found = robot.joints().iter().enumerate().filter(is_still);
    let (_, joint) = found.next()?;
    Some(PipelineWarning::StillPositions {
        joint: joint.name().to_owned(),
        others: found.count(),
    })
}

/// Positions that stay for so many rows are frozen, if by their velocities they go on meanwhile: by so much (rad or m), and so
/// many times what they change by at least where they change.
const LEAST_FROZEN: usize = 8;
const MOST_STEPS: f64 = 5.0;

/// Positions that stay for a while at one value, to the last digit, while their velocities go on.
pub fn frozen<'r>(
    robot: &'r RobotModel,
    sequences: &[Cow<'_, Sequence>],
) -> Option<PipelineWarning> {
    let of_joint = |(j, joint): (usize, &'r vsf_robots::Joint)| {
        let stay = sequences
            .iter()
            .find_map(|s| Some((s, longest_stay(s, j)?)))?;
        Some((j, joint, stay))
    };
    let mut found = robot.joints().iter().enumerate().filter_map(of_joint);
    let (j, joint, (s, (rows, way))) = found.next()?;
    Some(PipelineWarning::FrozenPositions {
        joint: joint.name().to_owned(),
        sequence: s.id.clone(),
        row: rows.start,
        count: rows.len(),
        value: s.angles[rows.start][j],
        way,
        unit: super::unit(joint),
        others: found.count(),
    })
}

/// The rows of the stay in which velocities go the furthest, and how far (rad or m), if that is far.
fn longest_stay(s: &Sequence, j: usize) -> Option<(Range<usize>, f64)> {
    let velocities = s.velocities.as_ref()?;
    let mut finest = f64::INFINITY;
    let mut most: Option<(Range<usize>, f64)> = None;
    for touch in s.touches() {
        let (mut start, mut way) = (touch.start, 0.0_f64);
        for row in touch.skip(1) {
            let step = (s.angles[row][j] - s.angles[row - 1][j]).abs();
            if step > 0.0 {
                finest = finest.min(step);
                (start, way) = (row, 0.0);
                continue;
            }
            let mean = 0.5 * (velocities[row][j] + velocities[row - 1][j]);
            way += mean * (s.time[row] - s.time[row - 1]);
            let is_longest = most.as_ref().is_none_or(|(_, most)| way.abs() > most.abs());
            if row + 1 - start >= LEAST_FROZEN && is_longest {
                most = Some((start..row + 1, way));
            }
        }
    }
    // A joint that never moves is another's case.
    let far = |way: f64| way.abs() >= LEAST_STILL && way.abs() > MOST_STEPS * finest;
    most.filter(|(_, way)| far(*way))
}

/// Whether positions do change as velocities say, if by another measure.
fn follows(moves: &[(f64, f64)]) -> bool {
    let sum = |of: fn(&(f64, f64)) -> f64| moves.iter().map(of).sum::<f64>();
    let [ways, both, integrals] = [sum(|m| m.0 * m.0), sum(|m| m.0 * m.1), sum(|m| m.1 * m.1)];
    both > FOLLOWS * (ways * integrals).sqrt()
}

/// The likely cause of such a factor.
pub fn cause(factor: f64) -> &'static str {
    let is = |other: f64| (factor / other - 1.0).abs() < 0.1;
    let degree = 1f64.to_radians();
    match () {
        () if is(degree.recip()) => "they look like degrees a second and must be in rad/s",
        () if is(degree) => "positions look like degrees and must be in radians",
        () if is(1e3) => {
            "time stamps look like milliseconds and must be in seconds (or sliding joints are in mm/s)"
        }
        () if is(1e-3) => {
            "they look like those of a millisecond (or the sample rate is 1000 times too high)"
        }
        () if is(-1.0) => "their sign is that of the way back",
        () => "check their unit and order, the time stamps and the sample rate",
    }
}

/// Median over the longer moves of joint `j` of the integral of its velocity per change of its position.
fn factor(sequences: &[Cow<'_, Sequence>], j: usize) -> Option<f64> {
    let moves: Vec<_> = sequences.iter().flat_map(|s| moves(s, j)).collect();
    let most = |of: fn(&(f64, f64)) -> f64| moves.iter().map(of).fold(0.0, f64::max);
    let [longest, by_velocities] = [most(|m| m.0.abs()), most(|m| m.1.abs())];
    // Short ones tell, too, where velocities make long ones of them and they are alike.
    let least = if by_velocities >= LEAST_STILL && follows(&moves) {
        0.5 * longest
    } else {
        LEAST_MOVE.max(0.5 * longest)
    };
    let long = moves.iter().filter(|(way, _)| way.abs() >= least);
    let factors: Vec<f64> = long.map(|(way, integral)| integral / way).collect();
    if factors.len() >= LEAST_MOVES {
        median(factors)
    } else {
        None
    }
}

/// Changes of the position of joint `j` in the parts of all touches, and the integrals of its velocity. Parts
/// of several samples, where there are many, are above the rounding of encoders.
fn moves(sequence: &Sequence, j: usize) -> Vec<(f64, f64)> {
    let Some(velocities) = &sequence.velocities else {
        return Vec::new();
    };
    let (angles, time) = (&sequence.angles, &sequence.time);
    let of_touch = |touch: Range<usize>| {
        let rows = (touch.len() / PARTS).max(1);
        let starts = touch.clone().step_by(rows);
        starts
            .take_while(move |start| start + rows < touch.end)
            .map(move |start| {
                let end = start + rows;
                let step = |k: usize| {
                    let mean = 0.5 * (velocities[k][j] + velocities[k + 1][j]);
                    mean * (time[k + 1] - time[k])
                };
                (
                    angles[end][j] - angles[start][j],
                    (start..end).map(step).sum(),
                )
            })
    };
    sequence.touches().flat_map(of_touch).collect()
}

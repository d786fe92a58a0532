use super::weight::Weighed;
use super::{
    Likeness, PipelineWarning, Rows, actuators, conventions, gravity, lag, malformed, outliers,
    scale, sensors, spikes, uncovered,
};
use crate::readings::check_sequence;
use crate::{Scene, Trace, derivatives_of, reading_unit, rigid_body_torques};
use nalgebra::DMatrix;
use vsf_core::{CoreError, Observation};
use vsf_data::{Derivatives, Sequence, Table, TorqueKind, tare};
use vsf_robots::{Joint, Link};

/// Readings above so many times what the joint can bear are of another unit.
const MOST_EFFORT: f64 = 10.0;
/// The finest joint torque sensors resolve a thousand times this (N m or N).
const LEAST_READING: f64 = 1e-6;
/// Tare samples that spread by more than this share of the touch itself are no rest.
const MOST_SPREAD: f64 = 0.25;
/// Readings in the air that are on average more than this share of those in contact are no noise; and how many of them
/// tell.
const MOST_OFFSET: f64 = 0.3;
const LEAST_FREE: usize = 16;
/// Readings in the air that are at least so much like the torques of gravity, and within a factor of their
/// size, are these. A payload is like them too, but smaller.
pub(super) const GRAVITY_CORRELATION: f64 = 0.95;
pub(super) const GRAVITY_SIZE: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Readings of the actuators of the other sign leave twice the torques of gravity.
const TWICE: std::ops::RangeInclusive<f64> = 1.6..=2.5;

/// What looks wrong with the readings: torques of another unit, of the other sign, in another order, of another gravity,
/// with gravity or offsets left in them, single ones that are far off, sensors that are stuck, dead, frozen or
/// saturated, tare samples that are no rest. Where all are zero, as of planned motions, only what does not depend on
/// them. `traces` are those of `sequences`, in their order. Of sequences that [`Sequence::check`] refuses, with other
/// joints than the robot's, and of traces that [`Trace::check`] refuses, only that.
pub fn reading_warnings(
    scene: &Scene,
    sequences: &[&Sequence],
    traces: &[Trace],
) -> Vec<PipelineWarning> {
    let (points, channels) = (scene.rest().len(), scene.robot().joint_count());
    let of_sequence = |(k, s): (usize, &&Sequence)| {
        let observed = traces.get(k).map_or(0, |t| t.observations.len());
        let paired = CoreError::check_len("trace", observed, s.len());
        let checked = check_sequence(scene.robot(), s);
        (s.id.clone(), checked.and(paired.map_err(Into::into)))
    };
    let of_trace = |t: &Trace| (t.id.clone(), t.check(points, channels));
    let checked = sequences.iter().enumerate().map(of_sequence);
    let checked = checked.chain(traces.iter().map(of_trace));
    let malformed = malformed(checked);
    if !malformed.is_empty() {
        return malformed;
    }
    let motions: Vec<Option<Derivatives>> = (sequences.iter())
        .map(|s| derivatives_of(scene.robot(), s).ok())
        .collect();
    // Angles that traces were made of can be taken.
    let pairs = sequences.iter().zip(&motions);
    let rigid = pairs.map(|(s, motion)| rigid(scene, s, motion.as_ref()));
    let rigid: Option<Vec<Table>> = rigid.collect();
    let rigid = rigid.unwrap_or_default();
    let mut warnings = beyond_effort(scene, sequences, &rigid);
    warnings.extend(weightless(scene));
    warnings.extend(impossible_inertia(scene));
    let tares = |of: &dyn Fn(&Trace) -> Option<PipelineWarning>| {
        let mut found = traces.iter().filter_map(of);
        let first = found.next();
        first.map(|w| w.and_others(found.count()))
    };
    warnings.extend(tares(&|t| tare_in_contact(t, scene.tare_samples())));
    warnings.extend(tares(&|t| tare_spread(t, scene)));
    let readings = sequences.iter().flat_map(|s| s.torques.data());
    let largest = readings.fold(0.0, |largest: f64, v| largest.max(v.abs()));
    // Of planned motions, and of motors that are off.
    if largest == 0.0 {
        return warnings;
    }
    if largest < LEAST_READING {
        let unit = scene.error_unit();
        warnings.push(PipelineWarning::TinyReadings { largest, unit });
        return warnings;
    }
    let spike = spikes::warning(scene, sequences, traces);
    let spiked = spike.is_some();
    warnings.extend(spike);
    let sensors = sensors::warnings(scene, sequences, traces);
    let told = |w: &PipelineWarning| {
        use PipelineWarning::{StuckReadings, ZeroReadings};
        matches!(w, StuckReadings { .. } | ZeroReadings { .. })
    };
    if !sensors.iter().any(told) {
        warnings.extend(actuators::warning(scene, sequences, &rigid));
    }
    let sick = spiked || !sensors.is_empty();
    warnings.extend(sensors);
    // Gravity that is left, and other offsets, may turn readings round; without one joint's, columns mean little.
    let turned = gravity::warning(scene, sequences, &motions, &rigid, traces, LEAST_FREE);
    let rigid = tared(scene, rigid).unwrap_or_default();
    let all_misread = (!sick).then(|| misread(scene, &rigid, traces)).flatten();
    let late = (!sick).then(|| lag::warning(traces)).flatten();
    // What leaves less.
    let (first, second) = less_left(all_misread, turned);
    let offset = first
        .or_else(|| gravity_left(scene, &rigid, traces))
        .or(second)
        .or_else(|| {
            (!sick)
                .then(|| one_misread(scene, &rigid, traces))
                .flatten()
        })
        .or_else(|| not_tared(scene, traces))
        // What comes late is read where nothing is touched any more.
        .or_else(|| {
            (late.is_none())
                .then(|| felt_in_air(scene, traces))
                .flatten()
        });
    warnings.extend(late);
    if sick || offset.is_some() {
        warnings.extend(offset);
        return warnings;
    }
    // Points that are missing turn columns round.
    let uncovered = uncovered::warning(scene, traces);
    warnings.extend(
        uncovered
            .or_else(|| scale::warning(traces))
            .or_else(|| conventions::warning(scene, traces)),
    );
    warnings
}

/// Torques far beyond what joints can bear: that were read, or, of actuators, that the arm itself would take.
fn beyond_effort(scene: &Scene, sequences: &[&Sequence], rigid: &[Table]) -> Vec<PipelineWarning> {
    let ids = || sequences.iter().map(|s| s.id.as_str());
    let read: Vec<Rows> = ids()
        .zip(sequences.iter().map(|s| s.torques.iter().collect()))
        .collect();
    let own: Vec<Rows> = match scene.torque_kind() {
        TorqueKind::Measured => ids()
            .zip(rigid.iter().map(|r| r.iter().collect()))
            .collect(),
        _ => Vec::new(),
    };
    let of_joint = |(j, joint): (usize, &Joint)| {
        let (effort, unit) = (joint.limits().effort, reading_unit(joint));
        let strong = |tau: f64| tau.abs() > MOST_EFFORT * effort;
        let read =
            outliers(joint, j, &read, strong).map(|outliers| PipelineWarning::BeyondEffort {
                effort,
                unit,
                outliers,
            });
        read.or_else(|| {
            Some(PipelineWarning::HeavyArm {
                effort,
                unit,
                outliers: outliers(joint, j, &own, strong)?,
            })
        })
    };
    let joints = scene.robot().joints().iter().enumerate();
    joints.filter_map(of_joint).collect()
}

/// Bodies without mass, where their weight is needed; frames have no shape. Of an arm without any shapes, all where none has a mass.
fn weightless(scene: &Scene) -> Option<PipelineWarning> {
    let robot = scene.robot();
    let colliders = robot.colliders();
    let weighs =
        |(l, link): (usize, &Link)| link.mass() > 0.0 && !robot.chains().chain(l).is_empty();
    let is_light = !robot.links().iter().enumerate().any(weighs);
    let has_shape = |name: &str| (colliders.iter()).any(|c| robot.links()[c.link].name() == name);
    let links: Vec<&str> = (robot.links_without_inertia())
        .map(|link| link.name())
        .filter(|name| is_light && colliders.is_empty() || has_shape(name))
        .collect();
    let needed = scene.torque_kind() == TorqueKind::Measured && !links.is_empty();
    needed.then(|| PipelineWarning::Weightless {
        links: links.join(", "),
    })
}

fn impossible_inertia(scene: &Scene) -> Option<PipelineWarning> {
    let links: Vec<&str> = (scene.robot().links_with_impossible_inertia())
        .map(|link| link.name())
        .collect();
    let needed = scene.torque_kind() == TorqueKind::Measured && !links.is_empty();
    needed.then(|| PipelineWarning::ImpossibleInertia {
        links: links.join(", "),
    })
}

fn tare_in_contact(trace: &Trace, tare_samples: usize) -> Option<PipelineWarning> {
    let tare = trace.observations.iter().take(tare_samples);
    let mut touching = tare.enumerate().filter(|(_, o)| !o.is_empty());
    let (row, _) = touching.next()?;
    Some(PipelineWarning::TareInContact {
        sequence: trace.id.clone(),
        count: 1 + touching.count(),
        tare_samples,
        row,
        others: 0,
    })
}

/// Squared reading, over all joints.
fn energy(observation: &Observation<f64>) -> f64 {
    observation.reading().iter().map(|t| t * t).sum()
}

fn tare_spread(trace: &Trace, scene: &Scene) -> Option<PipelineWarning> {
    // Readings are tared: their mean over these samples is zero.
    let rms = |squares: f64, count: usize| (squares / count.max(1) as f64).sqrt();
    let tare = || trace.observations.iter().take(scene.tare_samples());
    let touch = || trace.observations.iter().filter(|o| !o.is_empty());
    let spread = rms(tare().map(energy).sum(), tare().count());
    let touch = rms(touch().map(energy).sum(), touch().count());
    (touch > 0.0 && spread > MOST_SPREAD * touch).then(|| PipelineWarning::TareSpread {
        sequence: trace.id.clone(),
        spread,
        touch,
        unit: scene.error_unit(),
        others: 0,
    })
}

/// Readings that are something where nothing is touched.
fn not_tared(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    let observations = || traces.iter().flat_map(|t| &t.observations);
    let free = || observations().filter(|o| o.is_empty());
    let touching = || observations().filter(|o| !o.is_empty());
    let (count, touches) = (free().count(), touching().count());
    if count < LEAST_FREE || touches == 0 {
        return None;
    }
    let joints = scene.robot().joints();
    let mean = |j: usize| free().map(|o| o.reading()[j]).sum::<f64>() / count as f64;
    let means: Vec<f64> = (0..joints.len()).map(mean).collect();
    let square = |o: &Observation<f64>| {
        let beyond = o.reading().iter().zip(&means).map(|(t, m)| t - m);
        beyond.map(|t| t * t).sum::<f64>()
    };
    let touch = (touching().map(square).sum::<f64>() / touches as f64).sqrt();
    let offset = means.iter().map(|m| m * m).sum::<f64>().sqrt();
    if offset <= MOST_OFFSET * touch {
        return None;
    }
    let largest = (0..joints.len()).max_by(|a, b| means[*a].abs().total_cmp(&means[*b].abs()))?;
    Some(PipelineWarning::NotTared {
        joint: joints[largest].name().to_owned(),
        mean: means[largest],
        offset,
        touch,
        unit: scene.error_unit(),
    })
}

/// Readings that last where nothing is touched, but change their sign, so that their mean tells nothing.
fn felt_in_air(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    let joints = scene.robot().joints();
    let (mut touch, mut touches) = (0.0, 0_usize);
    let (mut of_joints, mut blocks) = (vec![0.0; joints.len()], 0_usize);
    for trace in traces {
        let parts = (trace.observations).chunk_by(|a, b| a.is_empty() == b.is_empty());
        for part in parts {
            if !part[0].is_empty() {
                touch += part.iter().map(energy).sum::<f64>();
                touches += part.len();
                continue;
            }
            // Noise shrinks in their means.
            for block in part.chunks_exact(LEAST_FREE) {
                blocks += 1;
                for (j, sum) in of_joints.iter_mut().enumerate() {
                    let mean =
                        block.iter().map(|o| o.reading()[j]).sum::<f64>() / block.len() as f64;
                    *sum += mean * mean;
                }
            }
        }
    }
    if blocks == 0 || touches == 0 {
        return None;
    }
    let size = (of_joints.iter().sum::<f64>() / blocks as f64).sqrt();
    let touch = (touch / touches as f64).sqrt();
    let largest = (0..joints.len()).max_by(|a, b| of_joints[*a].total_cmp(&of_joints[*b]))?;
    (size > MOST_OFFSET * touch).then(|| PipelineWarning::FeltInAir {
        joint: joints[largest].name().to_owned(),
        size,
        touch,
        unit: scene.error_unit(),
    })
}

/// The torques of the arm alone; where its motion is not known, its weight, which is nearly all.
fn rigid(scene: &Scene, sequence: &Sequence, motion: Option<&Derivatives>) -> Option<Table> {
    let torques = |motion: &Derivatives| {
        rigid_body_torques(scene.robot(), &scene.gravity(), sequence, motion).ok()
    };
    let Some(motion) = motion else {
        let mut still = sequence.angles.clone();
        still.data_mut().fill(0.0);
        return torques(&Derivatives {
            velocities: still.clone(),
            accelerations: still,
        });
    };
    torques(motion)
}

/// Torques of the arm alone, tared as readings are; `None` of sequences with too few samples.
fn tared(scene: &Scene, rigid: Vec<Table>) -> Option<Vec<Table>> {
    match scene.tare_samples() {
        0 => Some(rigid),
        samples => rigid.iter().map(|r| tare(r, samples).ok()).collect(),
    }
}

/// What is read where nothing is touched, of actuators what is left of the torques of the arm alone when it is taken off
/// ([`crate::external_torques`]); beside these torques, which are tared as readings are.
fn in_air<'a>(rigid: &'a Table, trace: &'a Trace) -> impl Iterator<Item = (&'a [f64], &'a [f64])> {
    let rows = trace.observations.iter().zip(rigid.iter());
    rows.filter(|(o, _)| o.is_empty())
        .map(|(o, rigid)| (o.reading(), rigid))
}

fn gravity_left(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
    let mut likeness = Likeness::default();
    let sequences = rigid.iter().zip(traces);
    for (readings, rigid) in sequences.flat_map(|(rigid, trace)| in_air(rigid, trace)) {
        let pairs = readings.iter().zip(rigid);
        pairs.for_each(|(tau, r)| likeness.add(*tau, *r));
    }
    let (size, correlation) = (likeness.slope(), likeness.correlation());
    let given = scene.torque_kind();
    let alike = correlation > GRAVITY_CORRELATION;
    if alike && GRAVITY_SIZE.contains(&size) {
        Some(PipelineWarning::GravityLeft {
            given,
            size,
            correlation,
        })
    } else if alike && given == TorqueKind::Measured && TWICE.contains(&size) {
        Some(PipelineWarning::GravityTwice { size })
    } else {
        None
    }
}

/// A sequence whose readings, alone, have other signs or another scale than weight and motion of the arm ask for, or hold
/// its weight. Of a robot with one joint any offset may look so.
fn one_misread(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
    if scene.robot().joint_count() < 2 {
        return None;
    }
    let told = |(rigid, trace): (&Table, &Trace)| {
        let (rigid, traces) = (std::slice::from_ref(rigid), std::slice::from_ref(trace));
        if in_air(&rigid[0], trace).count() < LEAST_FREE {
            return None;
        }
        let found = misread(scene, rigid, traces).or_else(|| gravity_left(scene, rigid, traces));
        Some(found?.in_sequence(&trace.id))
    };
    rigid.iter().zip(traces).find_map(told)
}

/// Two warnings, the one first whose convention leaves less.
fn less_left(
    a: Option<PipelineWarning>,
    b: Option<PipelineWarning>,
) -> (Option<PipelineWarning>, Option<PipelineWarning>) {
    if share_left(a.as_ref()) <= share_left(b.as_ref()) {
        (a, b)
    } else {
        (b, a)
    }
}

/// What another convention leaves of what the given one does, if there is one.
fn share_left(warning: Option<&PipelineWarning>) -> f64 {
    use PipelineWarning::{
        GravityLeft, MixedActuators, OppositeActuators, OtherGravity, ScaledActuators,
    };
    match warning {
        Some(
            OppositeActuators { left, .. }
            | MixedActuators { left, .. }
            | ScaledActuators { left, .. }
            | OtherGravity { left, .. },
        ) => *left,
        Some(GravityLeft { correlation, .. }) => 1.0 - correlation * correlation,
        _ => f64::INFINITY,
    }
}

/// Readings of the actuators with other signs, in another order, or of another scale, than weight and motion of the arm ask for.
fn misread(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
    if scene.torque_kind() != TorqueKind::Measured {
        return None;
    }
    let joints = scene.robot().joints();
    let mut weighed = Weighed::new(joints.len());
    for (rigid, trace) in rigid.iter().zip(traces) {
        let rows: Vec<_> = in_air(rigid, trace).collect();
        let rigid = DMatrix::from_fn(rows.len(), joints.len(), |i, j| rows[i].1[j]);
        let left = DMatrix::from_fn(rows.len(), joints.len(), |i, j| rows[i].0[j]);
        weighed.add(&(&rigid - left), &rigid);
    }
    if weighed.count() >= LEAST_FREE {
        less_left(weighed.warning(joints), weighed.scaled(joints)).0
    } else {
        None
    }
}

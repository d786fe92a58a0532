//! Compares readings where nothing is touched with the rigid-body torques of the arm: actuator readings
//! with other signs, in another order, or of another scale, and gravity that was left in readings or
//! removed twice.

use super::PipelineWarning;
use super::air::LEAST_FREE;
use super::springs::Likeness;
use super::weight::Weighed;
use crate::{Scene, Trace};
use nalgebra::DMatrix;
use vsf_data::{Table, TorqueKind};

/// Correlation from which readings in the air count as torques of gravity, if their size agrees within a
/// factor. A payload correlates too, but is smaller.
pub const GRAVITY_CORRELATION: f64 = 0.95;
pub const GRAVITY_SIZE: std::ops::RangeInclusive<f64> = 0.8..=1.25;
/// Readings of the actuators of the other sign leave twice the torques of gravity.
const TWICE: std::ops::RangeInclusive<f64> = 1.6..=2.5;

/// What is read where nothing is touched, of actuators what is left of the torques of the arm alone when it is taken off
/// ([`crate::external_torques`]); beside these torques, which are tared as readings are.
fn in_air<'a>(rigid: &'a Table, trace: &'a Trace) -> impl Iterator<Item = (&'a [f64], &'a [f64])> {
    let rows = trace.observations.iter().zip(rigid.iter());
    rows.filter(|(o, _)| o.is_empty())
        .map(|(o, rigid)| (o.reading(), rigid))
}

/// Reports readings that contain the weight of the arm, or contain it twice.
pub fn gravity_left(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
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

/// Reports a single sequence whose readings have other signs or another scale than weight and motion of the
/// arm require, or contain its weight. For a robot with one joint any offset may look like this.
pub fn one(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
    if scene.robot().joint_count() < 2 {
        return None;
    }
    let told = |(rigid, trace): (&Table, &Trace)| {
        let (rigid, traces) = (std::slice::from_ref(rigid), std::slice::from_ref(trace));
        if in_air(&rigid[0], trace).count() < LEAST_FREE {
            return None;
        }
        let found = all(scene, rigid, traces).or_else(|| gravity_left(scene, rigid, traces));
        Some(found?.in_sequence(&trace.id))
    };
    rigid.iter().zip(traces).find_map(told)
}

/// Orders two warnings: first the one whose convention leaves less unexplained.
pub fn less_left(
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

/// Reports actuator readings with other signs, in another order, or of another scale than weight and motion
/// of the arm require.
pub fn all(scene: &Scene, rigid: &[Table], traces: &[Trace]) -> Option<PipelineWarning> {
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

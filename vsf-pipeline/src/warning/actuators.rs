use super::PipelineWarning;
use super::sensors::{LEAST_CHANGE, LEAST_ROWS, LEAST_STEPS, range, runs, step};
use crate::{Scene, reading_unit};
use vsf_data::{Sequence, Table, TorqueKind};

/// Joints whose weight changes by less than this share of what it changes by at another joint say nothing.
const LEAST_WEIGHT: f64 = 0.05;

/// Reports the first actuator whose reading stays at one value for a while, although the torque needed to
/// hold and move the arm changes. `rigid` are the rigid-body torques of the arm, sequence by sequence.
pub fn warning(scene: &Scene, sequences: &[&Sequence], rigid: &[Table]) -> Option<PipelineWarning> {
    if scene.torque_kind() != TorqueKind::Measured {
        return None;
    }
    let joints = scene.robot().joints();
    let changes = |j: usize| range(rigid.iter().flat_map(move |r| r.column(j)));
    let widest = (0..joints.len()).map(changes).fold(0.0, f64::max);
    let of_joint = |j: usize| {
        let steps = sequences.iter().map(|s| step(s.torques.column(j)));
        // Of one that never moves, nothing is known of rounding.
        let step = steps.fold(f64::INFINITY, f64::min);
        let rounding = if step.is_finite() { step } else { 0.0 };
        let all = changes(j);
        let least = (LEAST_CHANGE * all).max(LEAST_STEPS * rounding);
        let mut found = sequences.iter().zip(rigid).flat_map(|(sequence, rigid)| {
            let readings: Vec<f64> = sequence.torques.column(j).collect();
            let weight: Vec<f64> = rigid.column(j).collect();
            let still = runs(&readings).filter_map(|(rows, value)| {
                let change = range(weight[rows.clone()].iter().copied());
                let long = rows.len() >= LEAST_ROWS && change > least;
                long.then(|| (sequence.id.clone(), rows, value, change))
            });
            still.collect::<Vec<_>>()
        });
        let first = found.next().filter(|_| all > LEAST_WEIGHT * widest)?;
        Some((first, found.count()))
    };
    let mut still = joints
        .iter()
        .enumerate()
        .filter_map(|(j, joint)| Some((joint, of_joint(j)?)));
    let (joint, ((sequence, rows, value, change), again)) = still.next()?;
    Some(PipelineWarning::StillActuator {
        joint: joint.name().to_owned(),
        sequence,
        row: rows.start,
        count: rows.len(),
        value,
        change,
        unit: reading_unit(joint),
        again,
        others: still.count(),
    })
}

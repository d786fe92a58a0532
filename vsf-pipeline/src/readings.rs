use crate::{PipelineError, Scene};
use vsf_data::{Sequence, Table, TorqueKind, tare};

/// Largest torque that is taken (N m or N): beyond any robot, and far from where squares overflow.
const MOST: f64 = 1e12;

/// The external joint torques of a sequence: what touch adds, with gravity removed and tared.
///
/// Measured torques become `tau_ext = g(q) - tau_meas` (quasi-static motion). Taring subtracts
/// the mean of the first [`Scene::tare_samples`] external torques, where nothing is touched.
///
/// # Errors
/// Torques beyond 1e12 N m, angles that the robot cannot take, or more tare samples than rows.
pub fn external_torques(scene: &Scene, sequence: &Sequence) -> Result<Table, PipelineError> {
    let mut torques = sequence.torques.clone();
    if let Some(k) = torques.data().iter().position(|v| v.abs() > MOST) {
        return Err(PipelineError::Torque {
            id: sequence.id.clone(),
            row: k / torques.cols(),
            joint: k % torques.cols() + 1,
            value: torques.data()[k],
            unit: scene.unit(k % torques.cols()),
            most: MOST,
        });
    }
    if scene.torque_kind == TorqueKind::Measured {
        let gravity = gravity_torques(scene, sequence)?;
        let pairs = torques.data_mut().iter_mut().zip(gravity.data());
        pairs.for_each(|(tau, g)| *tau = g - *tau);
    }
    if scene.tare_samples > 0 {
        torques = tare(&torques, scene.tare_samples)?;
    }
    Ok(torques)
}

/// Torques that hold the arm against gravity, for every sample of a sequence.
///
/// # Errors
/// Angles that the robot cannot take.
pub(crate) fn gravity_torques(scene: &Scene, sequence: &Sequence) -> Result<Table, PipelineError> {
    let mut workspace = scene.robot.dynamics_workspace();
    let mut torques = sequence.angles.clone();
    let cols = torques.cols();
    let rows = torques.data_mut().chunks_mut(cols);
    for (row, q) in rows.zip(sequence.angles.iter()) {
        let gravity = (scene.robot).gravity_torques(q, &scene.gravity, &mut workspace)?;
        row.copy_from_slice(gravity);
    }
    Ok(torques)
}

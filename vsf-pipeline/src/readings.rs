use crate::{PipelineError, Scene};
use nalgebra::Vector3;
use std::borrow::Cow;
use std::f64::consts::TAU;
use vsf_core::{CoreError, MOST_READING, RestPoints, median};
use vsf_data::{Dataset, Derivatives, Sequence, Table, TorqueKind, tare};
use vsf_robots::{JointKind, RobotModel};

/// Largest position and velocity (rad, m and each second): far beyond what their numbers still tell apart.
const MOST_STATE: f64 = 1e9;
/// Half the window over which velocities and accelerations are estimated: this long (s), and at least
/// so many samples. Shorter ones would make noise of rounded angles, longer ones blunt the motion.
const HALF_WINDOW: f64 = 0.0125;
const LEAST_HALF_WINDOW: usize = 4;
/// Samples come in bursts where the mean time between them is so many times the median.
const BURSTS: f64 = 2.0;

/// Checks that a sequence is as [`Sequence::check`] asks, with a column for every joint of the robot.
pub(crate) fn check_sequence(robot: &RobotModel, sequence: &Sequence) -> Result<(), PipelineError> {
    sequence.check()?;
    let columns = CoreError::check_len("joint angles", sequence.width(), robot.joint_count());
    columns.map_err(|source| PipelineError::Sequence {
        id: sequence.id.clone(),
        row: 0,
        source,
    })
}

/// Refuses positions and velocities of more than [`MOST_STATE`].
fn check_states(robot: &RobotModel, sequence: &Sequence) -> Result<(), PipelineError> {
    let velocities = sequence.velocities.as_ref();
    let tables = [
        ("a position", ["rad", "m"], Some(&sequence.angles)),
        ("a velocity", ["rad/s", "m/s"], velocities),
    ];
    for (what, [turning, sliding], table) in tables {
        let values = table.map_or(&[][..], Table::data);
        if let Some(k) = values.iter().position(|v| v.abs() > MOST_STATE) {
            let column = k % sequence.width();
            return Err(PipelineError::State {
                id: sequence.id.clone(),
                row: k / sequence.width(),
                joint: column + 1,
                what,
                value: values[k],
                unit: match robot.joints()[column].kind() {
                    JointKind::Prismatic => sliding,
                    _ => turning,
                },
                most: MOST_STATE,
            });
        }
    }
    Ok(())
}

/// Checks torques or their deviations, read or computed, of sequence `id`: refuses those of more than 1e12
/// N m (or N), and NaN.
///
/// # Errors
/// [`PipelineError::Torque`] with the first such value.
pub fn check_torques(scene: &Scene, id: &str, torques: &Table) -> Result<(), PipelineError> {
    let is_taken = |v: &f64| v.abs() <= MOST_READING;
    match torques.data().iter().position(|v| !is_taken(v)) {
        None => Ok(()),
        Some(k) => Err(PipelineError::Torque {
            id: id.to_owned(),
            row: k / torques.cols(),
            joint: k % torques.cols() + 1,
            value: torques.data()[k],
            unit: scene.unit(k % torques.cols()),
            most: MOST_READING,
        }),
    }
}

/// Checks that a recording can be used: that its points are valid rest points and its readings are
/// accepted.
///
/// # Errors
/// What [`Dataset::check`] refuses, points that [`RestPoints::new`] refuses, what [`external_torques`] refuses.
pub fn check_readable(dataset: &Dataset, robot: RobotModel) -> Result<(), PipelineError> {
    RestPoints::new(dataset.rest_points.clone().unwrap_or_default())?;
    let scene = Scene::in_air(dataset, robot)?;
    let mut sequences = dataset.sequences.iter();
    sequences.try_for_each(|s| external_torques(&scene, s).map(drop))
}

/// The external joint torques of a sequence: the torques caused by touch, with the rigid-body torques
/// removed and tared.
///
/// Measured torques become `tau_ext = M(q) qdd + C(q, qd) qd + g(q) - tau_meas`, with velocities and
/// accelerations by [`derivatives_of`]. Taring subtracts the mean of the first [`Scene::tare_samples`]
/// external torques, where nothing is touched.
///
/// # Errors
/// A sequence that [`Sequence::check`] refuses, torques beyond 1e12 N m, angles and velocities beyond 1e9,
/// angles that the robot cannot take, or more tare samples than rows. For measured torques without recorded
/// velocities, also a touch of a single sample, whose velocity is unknown.
pub fn external_torques(scene: &Scene, sequence: &Sequence) -> Result<Table, PipelineError> {
    check_sequence(scene.robot(), sequence)?;
    check_states(scene.robot(), sequence)?;
    check_torques(scene, &sequence.id, &sequence.torques)?;
    let mut torques = sequence.torques.clone();
    if scene.torque_kind() == TorqueKind::Measured {
        let derivatives = derivatives_of(scene.robot(), sequence)?;
        let rigid = rigid_body_torques(scene.robot(), &scene.gravity(), sequence, &derivatives)?;
        let pairs = torques.data_mut().iter_mut().zip(rigid.data());
        pairs.for_each(|(tau, r)| *tau = r - *tau);
    }
    if scene.tare_samples() > 0 {
        torques = tare(&torques, scene.tare_samples())?;
    }
    Ok(torques)
}

/// The sequence with continuous joints unwrapped: no position is further than half a turn from the one
/// before it. The posture of the robot is the same as in the sequence.
pub fn unwound<'s>(robot: &RobotModel, sequence: &'s Sequence) -> Cow<'s, Sequence> {
    let mut unwound = Cow::Borrowed(sequence);
    for (j, joint) in robot.joints().iter().enumerate().take(sequence.width()) {
        let mut turns = 0.0;
        for row in 1..sequence.len() {
            let [from, to] = [row - 1, row].map(|row| sequence.angles[row][j]);
            turns += (joint.change(from, to) - (to - from)) / TAU;
            let turned = TAU * f64::round(turns);
            if turned != 0.0 {
                let width = sequence.width();
                unwound.to_mut().angles.data_mut()[row * width + j] += turned;
            }
        }
    }
    unwound
}

/// Velocities (recorded, or else estimated from the angles) and accelerations of a sequence.
///
/// Slopes are taken over windows of 0.025 s or of nine samples, whichever is longer. Angles are [`unwound`]
/// first.
///
/// # Errors
/// As [`Sequence::derivatives`]; also angles and velocities beyond 1e9, or another number of joints than
/// the robot's.
pub fn derivatives_of(
    robot: &RobotModel,
    sequence: &Sequence,
) -> Result<Derivatives, PipelineError> {
    check_sequence(robot, sequence)?;
    check_states(robot, sequence)?;
    let samples = step(sequence).map_or(0.0, |step| (HALF_WINDOW / step).round());
    let derivatives =
        unwound(robot, sequence).derivatives((samples as usize).max(LEAST_HALF_WINDOW));
    derivatives.map_err(|source| PipelineError::Motion {
        id: sequence.id.clone(),
        source,
    })
}

/// Time from one sample to the next (s): the median, since touches may be far apart; the mean within touches, where samples
/// come in bursts.
fn step(sequence: &Sequence) -> Option<f64> {
    let median = median(sequence.time.windows(2).map(|t| t[1] - t[0]).collect())?;
    let spans = || sequence.touches().map(|touch| &sequence.time[touch]);
    let steps: usize = spans().map(|t| t.len().saturating_sub(1)).sum();
    let time: f64 = spans().filter_map(|t| Some(t.last()? - t.first()?)).sum();
    let mean = time / steps.max(1) as f64;
    Some(if mean > BURSTS * median { mean } else { median })
}

/// The rigid-body torques of a sequence, `M(q) qdd + C(q, qd) qd + g(q)` (N m or N): what the arm itself
/// needs to move. One row per sample. `gravity` is in the world frame (m/s²).
///
/// # Errors
/// Angles or velocities that the robot cannot take, or derivatives whose length is not that of the
/// sequence.
pub fn rigid_body_torques(
    robot: &RobotModel,
    gravity: &Vector3<f64>,
    sequence: &Sequence,
    derivatives: &Derivatives,
) -> Result<Table, PipelineError> {
    for table in [&derivatives.velocities, &derivatives.accelerations] {
        CoreError::check_len("rows of the derivatives", table.rows(), sequence.len())?;
    }
    let mut workspace = robot.dynamics_workspace();
    let mut torques = Vec::with_capacity(sequence.angles.data().len());
    for (row, q) in sequence.angles.iter().enumerate() {
        let (qd, qdd) = (
            &derivatives.velocities[row],
            &derivatives.accelerations[row],
        );
        let rigid = robot.inverse_dynamics(q, qd, qdd, gravity, &mut workspace)?;
        torques.extend_from_slice(rigid);
    }
    Ok(Table::new(sequence.angles.cols(), torques)?)
}

//! Estimates gravity from actuator readings where nothing is touched: weight is linear in the gravity
//! vector.

use super::PipelineWarning;
use super::air::LEAST_FREE;
use super::misread::{GRAVITY_CORRELATION, GRAVITY_SIZE};
use crate::{PipelineError, Scene, Trace};
use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};
use vsf_data::{Derivatives, Sequence, Table, TorqueKind};

/// Another gravity has to leave less than this share of the squared residuals, and to differ by so much (m/s²): less is
/// an arm that was set up askew. It has to be about as strong as it is on earth (m/s²): a load at the hand is weight, too.
const MOST_LEFT: f64 = 0.25;
const LEAST_CHANGE: f64 = 2.5;
const STRENGTH: std::ops::RangeInclusive<f64> = 8.0..=11.5;
/// Directions along which weight tells less than this share of what it does along others are left as they are.
const UNTOLD: f64 = 1e-4;
/// Dry friction is nearly full from twice this speed on (rad/s or m/s).
const SLOW: f64 = 0.01;
/// The same of offsets, friction and motion.
const ROUNDING: f64 = 1e-12;

/// Reports that another gravity explains most of what the rigid-body torques leave of the readings, or that
/// weight was removed from readings that should contain it, or the reverse.
///
/// Offsets of a sequence are ignored, and so is friction, constant or proportional to the speed, and in
/// external readings the torques of motion. `motions` are the velocities and accelerations of the arm where
/// known, `rigid` its rigid-body torques.
pub fn warning(
    scene: &Scene,
    sequences: &[&Sequence],
    motions: &[Option<Derivatives>],
    rigid: &[Table],
    traces: &[Trace],
) -> Option<PipelineWarning> {
    // Of the weight along every axis, per unit of gravity, and of what is left.
    let mut products = Matrix4::zeros();
    let mut samples = 0;
    let states = sequences.iter().zip(motions).zip(rigid);
    for (((sequence, motion), rigid), trace) in states.zip(traces) {
        // Where the motion is not known, nothing is known of friction.
        let free = |motion| free(scene, sequence, motion, rigid, trace).ok();
        let Some(joints) = motion.as_ref().and_then(free) else {
            continue;
        };
        // Each takes four to tell what is beside weight.
        samples += (joints.first()).map_or(0, |joint| joint.rows.len().saturating_sub(4));
        products += joints.iter().map(Free::products).sum::<Matrix4<f64>>();
    }
    let weight: Matrix3<f64> = products.fixed_view::<3, 3>(0, 0).into();
    let both: Vector3<f64> = products.fixed_view::<3, 1>(0, 3).into();
    let told = weight.symmetric_eigen();
    let tells = UNTOLD * told.eigenvalues.max();
    let change: Vector3<f64> = (told.eigenvalues.iter().zip(told.eigenvectors.column_iter()))
        .filter(|(told, _)| **told > tells)
        .map(|(told, direction)| direction * (direction.dot(&both) / told))
        .sum();
    let left = 1.0 - change.dot(&both) / products[(3, 3)];
    if samples < LEAST_FREE {
        return None;
    }
    let given = scene.gravity();
    let gravity = given + change;
    let kind = scene.torque_kind();
    // How many times the weight would have to be taken off.
    let size = -change.dot(&given) / given.norm_squared();
    let aside = (change + given * size).norm();
    let correlation = (1.0 - left).max(0.0).sqrt();
    if correlation > GRAVITY_CORRELATION && aside < LEAST_CHANGE && GRAVITY_SIZE.contains(&size) {
        return Some(PipelineWarning::GravityLeft {
            given: kind,
            size,
            correlation,
        });
    }
    let other = change.norm() > LEAST_CHANGE && STRENGTH.contains(&gravity.norm());
    let found = kind == TorqueKind::Measured && left < MOST_LEFT && other;
    found.then(|| PipelineWarning::OtherGravity {
        gravity: gravity.into(),
        given: given.into(),
        left,
    })
}

/// The samples of a joint in a sequence in which nothing is touched.
#[derive(Clone, Default)]
struct Free {
    /// Its torques of gravity along the axes of the world, of unit strength, and what is read beyond weight and motion of
    /// the arm.
    rows: Vec<Vector4<f64>>,
    /// What offsets, friction and motion are made of.
    beside: Vec<Vector4<f64>>,
}

impl Free {
    /// Sums of products of the rows, without what offsets, friction and motion explain.
    fn products(&self) -> Matrix4<f64> {
        let pairs = || self.rows.iter().zip(&self.beside);
        let whole: Matrix4<f64> = self.rows.iter().map(|r| r * r.transpose()).sum();
        let own: Matrix4<f64> = self.beside.iter().map(|b| b * b.transpose()).sum();
        let both: Matrix4<f64> = pairs().map(|(r, b)| r * b.transpose()).sum();
        let rounding = ROUNDING * own.max();
        match own.pseudo_inverse(rounding) {
            Ok(inverse) => whole - both * inverse * both.transpose(),
            Err(_) => whole,
        }
    }
}

/// These samples of every joint.
fn free(
    scene: &Scene,
    sequence: &Sequence,
    motion: &Derivatives,
    rigid: &Table,
    trace: &Trace,
) -> Result<Vec<Free>, PipelineError> {
    let robot = scene.robot();
    let mut workspace = robot.dynamics_workspace();
    let mut joints = vec![Free::default(); robot.joint_count()];
    let states = (sequence.angles.iter().zip(motion.velocities.iter())).zip(rigid.iter());
    for (((q, qd), rigid), observation) in states.zip(&trace.observations) {
        if !observation.is_empty() {
            continue;
        }
        let mut rows: Vec<Vector4<f64>> = (observation.reading().iter())
            .map(|external| Vector4::new(0.0, 0.0, 0.0, -external))
            .collect();
        for (k, axis) in [Vector3::x(), Vector3::y(), Vector3::z()]
            .iter()
            .enumerate()
        {
            let weight = robot.gravity_torques(q, axis, &mut workspace)?;
            rows.iter_mut().zip(weight).for_each(|(row, w)| row[k] = *w);
        }
        let moves = qd.iter().zip(rigid);
        for ((joint, row), (qd, rigid)) in joints.iter_mut().zip(rows).zip(moves) {
            let inertial = match scene.torque_kind() {
                TorqueKind::External => rigid - row.xyz().dot(&scene.gravity()),
                // Taken off the readings already.
                TorqueKind::Measured => 0.0,
            };
            joint.rows.push(row);
            let friction = (qd / SLOW).tanh();
            joint
                .beside
                .push(Vector4::new(1.0, friction, *qd, inertial));
        }
    }
    Ok(joints)
}

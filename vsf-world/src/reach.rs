//! Inverse kinematics by damped least squares.

use crate::arm::{Arm, JOINTS, JointVector};
use crate::gen3::LIMITS;
use nalgebra::{Point3, SMatrix, SVector, Unit, Vector3};

/// Tip of the hand in the frame of the last link \[m\].
pub(crate) const TIP: Point3<f64> = Point3::new(0.0, 0.0, -0.0665);

/// Goal for the position of the tip and the pointing direction of the hand.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Goal {
    pub tip: Point3<f64>,
    pub pointing: Unit<Vector3<f64>>,
}

/// Weight of the direction relative to the position: m per rad.
const LEVER: f64 = 0.15;

/// Angles near `start` that reach the goal to within 0.1 mm and 1e-3 rad. The rotation about the axis of the hand is free.
/// `None` if there are none within the limits.
pub(crate) fn reach(arm: &mut Arm, start: &JointVector, goal: &Goal) -> Option<JointVector> {
    let mut q = *start;
    for _ in 0..60 {
        arm.set(&q);
        let (error, jacobian) = linearize(arm, goal);
        if error.fixed_rows::<3>(0).norm() < 1e-4 && error.fixed_rows::<3>(3).norm() < 1e-3 * LEVER
        {
            let allowed = q
                .iter()
                .zip(LIMITS)
                .all(|(q, limit)| q.abs() < limit - 0.03);
            return allowed.then_some(q);
        }
        let damping = 1e-6 + 1e-2 * error.norm_squared();
        let square = jacobian * jacobian.transpose() + SMatrix::<f64, 6, 6>::identity() * damping;
        let mut step: SVector<f64, JOINTS> =
            jacobian.transpose() * square.cholesky()?.solve(&error);
        let largest = step.amax();
        if largest > 0.25 {
            step *= 0.25 / largest;
        }
        for (q, step) in q.iter_mut().zip(&step) {
            *q += step;
        }
    }
    None
}

/// The remaining error, and its derivative with respect to the joints.
fn linearize(arm: &Arm, goal: &Goal) -> (SVector<f64, 6>, SMatrix<f64, 6, JOINTS>) {
    let hand = &arm.poses()[JOINTS];
    let tip = hand * TIP;
    let pointing = hand * -Vector3::z();
    let mut error: SVector<f64, 6> = SVector::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&(goal.tip - tip));
    let turn = pointing.cross(&goal.pointing);
    // Beyond a right angle the sine falls again; its direction is what counts.
    let angle = pointing.angle(&goal.pointing);
    let turn = if turn.norm() > 1e-12 {
        turn.normalize() * angle
    } else {
        turn
    };
    error.fixed_rows_mut::<3>(3).copy_from(&(turn * LEVER));
    let mut jacobian: SMatrix<f64, 6, JOINTS> = SMatrix::zeros();
    for j in 0..JOINTS {
        let pose = &arm.poses()[j + 1];
        let axis = pose.rotation * Vector3::z();
        let place = axis.cross(&(tip.coords - pose.translation.vector));
        // Turns about the pointing itself change nothing.
        let turn = axis - pointing * axis.dot(&pointing);
        jacobian.fixed_view_mut::<3, 1>(0, j).copy_from(&place);
        jacobian
            .fixed_view_mut::<3, 1>(3, j)
            .copy_from(&(turn * LEVER));
    }
    (error, jacobian)
}

//! Rigid motion of links, and the weight and inertia of what moves with them.

use crate::{Campaign, Need, Sample};
use nalgebra::{Point3, Vector3};
use vsf_core::Posture;
use vsf_data::TorqueKind;

/// Why masses do not show: readings that are freed of motion hold weight alone.
pub(super) fn masses_untestable(campaign: &Campaign) -> Option<String> {
    match campaign.site().torque_kind {
        TorqueKind::Measured => None,
        TorqueKind::External => campaign.lacks(Need::Weight),
    }
}

/// Spatial velocity and acceleration of a link, at the world origin.
#[derive(Clone)]
pub(super) struct RigidMotion {
    /// Angular velocity (rad/s).
    w: Vector3<f64>,
    /// Velocity (m/s) of the link's point at the origin.
    v: Vector3<f64>,
    /// Angular acceleration (rad/s²).
    dw: Vector3<f64>,
    /// Spatial acceleration (m/s²): the point at the origin accelerates by `dv + w x v`.
    dv: Vector3<f64>,
}

impl RigidMotion {
    /// Of a link that stands still.
    fn rest() -> Self {
        let zero = Vector3::zeros();
        Self {
            w: zero,
            v: zero,
            dw: zero,
            dv: zero,
        }
    }

    /// Of `link` as far as readings of this kind have it in them: external ones are freed of motion.
    pub(super) fn in_readings(
        kind: TorqueKind,
        posture: &Posture,
        link: usize,
        sample: &Sample<'_>,
    ) -> Self {
        match kind {
            TorqueKind::Measured => Self::of(posture, link, sample.qd, sample.qdd),
            TorqueKind::External => Self::rest(),
        }
    }

    /// Of `link`, where joints move with `qd` and `qdd`.
    pub(super) fn of(posture: &Posture, link: usize, qd: &[f64], qdd: &[f64]) -> Self {
        let mut m = Self::rest();
        for &j in posture.chains().chain(link) {
            let j = j as usize;
            let s = &posture.screws()[j];
            // The axis itself moves with the links before it.
            m.dw += s.angular * qdd[j] + m.w.cross(&s.angular) * qd[j];
            m.dv += s.linear * qdd[j] + (m.v.cross(&s.angular) + m.w.cross(&s.linear)) * qd[j];
            m.w += s.angular * qd[j];
            m.v += s.linear * qd[j];
        }
        m
    }

    /// Velocity (m/s) of the link's point at `p`.
    pub(super) fn velocity(&self, p: &Point3<f64>) -> Vector3<f64> {
        self.v + self.w.cross(&p.coords)
    }

    /// Acceleration (m/s²) of the link's point at `p`.
    pub(super) fn acceleration(&self, p: &Point3<f64>) -> Vector3<f64> {
        self.dv + self.dw.cross(&p.coords) + self.w.cross(&self.velocity(p))
    }
}

/// Mass that moves with a link.
#[derive(Clone)]
pub(super) struct Body {
    /// Mass (kg).
    pub m: f64,
    /// Mass times place of its center in the frame of the link (kg m).
    pub h_L: Vector3<f64>,
}

impl Body {
    /// From mass and first moments.
    pub(super) fn new(theta: &[f64]) -> Self {
        Self {
            m: theta[0],
            h_L: Vector3::new(theta[1], theta[2], theta[3]),
        }
    }

    /// Adds to `tau` the torques with which weight and inertia of the body load the joints. Its moment of inertia about the origin of the link is left out.
    pub(super) fn load(
        &self,
        posture: &Posture,
        link: usize,
        gravity: &Vector3<f64>,
        motion: &RigidMotion,
        tau: &mut [f64],
    ) {
        let X_WL = &posture.link_poses()[link];
        let o = Point3::from(X_WL.translation.vector);
        let h = X_WL.rotation * self.h_L;
        let felt = gravity - motion.acceleration(&o);
        let force = felt * self.m - motion.dw.cross(&h) - motion.w.cross(&motion.w.cross(&h));
        let moment = o.coords.cross(&force) + h.cross(&felt);
        posture.add_torques(link, &moment, &force, tau);
    }
}

/// Adds to `tau` the joint torques of a force `f_W` (N) on `link` at the world point `p_W`.
pub(super) fn add_force(
    posture: &Posture,
    link: usize,
    p_W: &Point3<f64>,
    f_W: &Vector3<f64>,
    tau: &mut [f64],
) {
    posture.add_torques(link, &p_W.coords.cross(f_W), f_W, tau);
}

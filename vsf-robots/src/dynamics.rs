//! Recursive Newton-Euler algorithm in world coordinates. Every spatial vector refers to the world
//! origin, like [`vsf_core::JointScrew`], so that no transform is needed from link to link.

use crate::{RobotError, RobotModel};
use nalgebra::{Point3, Vector3};
use vsf_core::{CoreError, JointScrew, Posture};

/// Buffers for the dynamics of one robot, created by [`RobotModel::dynamics_workspace`].
#[derive(Debug, Clone)]
pub struct DynamicsWorkspace {
    posture: Posture,
    twists: Vec<Twist>,
    accelerations: Vec<Twist>,
    wrenches: Vec<Wrench>,
    torques: Vec<f64>,
    mass: Vec<f64>,
}

impl DynamicsWorkspace {
    /// The posture of the last dynamics call.
    pub fn posture(&self) -> &Posture {
        &self.posture
    }
}

/// Motion of a body: angular part, and linear part of the body's point at the world origin.
#[derive(Debug, Clone, Copy)]
struct Twist {
    angular: Vector3<f64>,
    linear: Vector3<f64>,
}

/// Moment about the world origin, and force.
#[derive(Debug, Clone, Copy)]
struct Wrench {
    moment: Vector3<f64>,
    force: Vector3<f64>,
}

impl Twist {
    fn zero() -> Self {
        Self {
            angular: Vector3::zeros(),
            linear: Vector3::zeros(),
        }
    }

    fn plus(self, s: &JointScrew, rate: f64) -> Self {
        Self {
            angular: self.angular + s.angular * rate,
            linear: self.linear + s.linear * rate,
        }
    }

    /// Rate of change of the screw `s` that moves with this twist.
    fn cross(&self, s: &JointScrew) -> JointScrew {
        JointScrew {
            angular: self.angular.cross(&s.angular),
            linear: self.linear.cross(&s.angular) + self.angular.cross(&s.linear),
        }
    }

    /// Rate of change of the momentum `h` that moves with this twist.
    fn cross_momentum(&self, h: &Wrench) -> Wrench {
        Wrench {
            moment: self.angular.cross(&h.moment) + self.linear.cross(&h.force),
            force: self.angular.cross(&h.force),
        }
    }
}

impl RobotModel {
    /// Creates the buffers for the dynamics of this robot.
    pub fn dynamics_workspace(&self) -> DynamicsWorkspace {
        let (n, d) = (self.link_count(), self.joint_count());
        DynamicsWorkspace {
            posture: self.posture(),
            twists: vec![Twist::zero(); n],
            accelerations: vec![Twist::zero(); n],
            wrenches: vec![
                Wrench {
                    moment: Vector3::zeros(),
                    force: Vector3::zeros(),
                };
                n
            ],
            torques: vec![0.0; d],
            mass: vec![0.0; d * d],
        }
    }

    /// Actuator torques that hold the arm still at `q` against gravity: `+dU/dq`, `d` values (N m or N).
    ///
    /// `gravity` is the acceleration of free fall in the world frame (m/s^2), for example
    /// `(0, 0, -9.81)`. Takes time proportional to the number of links; never allocates.
    ///
    /// # Errors
    /// `q` of the wrong length; `q`, `gravity` or a result not finite;
    /// [`RobotError::ForeignWorkspace`].
    pub fn gravity_torques<'w>(
        &self,
        q: &[f64],
        gravity: &Vector3<f64>,
        workspace: &'w mut DynamicsWorkspace,
    ) -> Result<&'w [f64], RobotError> {
        self.prepare(q, gravity, workspace)?;
        self.recurse(|_| 0.0, |_| 0.0, gravity, workspace)?;
        Ok(&workspace.torques)
    }

    /// Inverse dynamics: actuator torques of the motion `q, qd, qdd` without contact.
    ///
    /// These are `M(q) qdd + C(q, qd) qd + g(q)`, `d` values (N m or N). Friction is not included. A
    /// force of the environment reduces them by `tau_ext = J^T f`. `gravity` is as in
    /// [`RobotModel::gravity_torques`]. Takes time proportional to the number of links; never allocates.
    ///
    /// # Reference
    /// J. Y. S. Luh, M. W. Walker, R. P. C. Paul, "On-line computational scheme for mechanical
    /// manipulators", 1980, doi:10.1115/1.3149599; spatial form after R. Featherstone, *Rigid Body
    /// Dynamics Algorithms*, 2008, table 5.1, doi:10.1007/978-1-4899-7560-7.
    ///
    /// # Errors
    /// Arrays of the wrong length; inputs or a result not finite; [`RobotError::ForeignWorkspace`].
    pub fn inverse_dynamics<'w>(
        &self,
        q: &[f64],
        qd: &[f64],
        qdd: &[f64],
        gravity: &Vector3<f64>,
        workspace: &'w mut DynamicsWorkspace,
    ) -> Result<&'w [f64], RobotError> {
        CoreError::check_len("joint velocities", qd.len(), self.joint_count())?;
        CoreError::check_finite("joint velocities", qd)?;
        CoreError::check_len("joint accelerations", qdd.len(), self.joint_count())?;
        CoreError::check_finite("joint accelerations", qdd)?;
        self.prepare(q, gravity, workspace)?;
        self.recurse(|j| qd[j], |j| qdd[j], gravity, workspace)?;
        Ok(&workspace.torques)
    }

    /// Joint-space mass matrix `M(q)`, row-major `d x d` (kg m^2, kg m or kg), symmetric.
    ///
    /// Column `j` holds the torques of a unit acceleration of joint `j` without gravity. Takes time
    /// proportional to `d` times the number of links (`d` recursions); never allocates.
    ///
    /// # Errors
    /// As [`RobotModel::gravity_torques`].
    pub fn mass_matrix<'w>(
        &self,
        q: &[f64],
        workspace: &'w mut DynamicsWorkspace,
    ) -> Result<&'w [f64], RobotError> {
        let (d, weightless) = (self.joint_count(), Vector3::zeros());
        self.prepare(q, &weightless, workspace)?;
        for j in 0..d {
            let unit = |i| if i == j { 1.0 } else { 0.0 };
            self.recurse(|_| 0.0, unit, &weightless, workspace)?;
            // The lower triangle of each column, mirrored, makes the matrix symmetric to the bit.
            for i in j..d {
                workspace.mass[i * d + j] = workspace.torques[i];
                workspace.mass[j * d + i] = workspace.torques[i];
            }
        }
        Ok(&workspace.mass)
    }

    fn prepare(
        &self,
        q: &[f64],
        gravity: &Vector3<f64>,
        workspace: &mut DynamicsWorkspace,
    ) -> Result<(), RobotError> {
        CoreError::check_finite("gravity", gravity.as_slice())?;
        match self.update_posture(q, &mut workspace.posture) {
            Err(CoreError::ForeignPosture { .. }) => Err(RobotError::ForeignWorkspace),
            result => Ok(result?),
        }
    }

    fn recurse(
        &self,
        qd: impl Fn(usize) -> f64,
        qdd: impl Fn(usize) -> f64,
        gravity: &Vector3<f64>,
        workspace: &mut DynamicsWorkspace,
    ) -> Result<(), RobotError> {
        let DynamicsWorkspace {
            posture,
            twists,
            accelerations,
            wrenches,
            torques,
            ..
        } = workspace;
        let screws = posture.screws();

        // Outward: motion of every link and the wrench that it takes. Gravity enters as an upward
        // acceleration of the base.
        let base = Twist {
            angular: Vector3::zeros(),
            linear: -gravity,
        };
        for (l, link) in self.links.iter().enumerate() {
            let (mut v, mut a) = match link.parent {
                Some(p) => (twists[p], accelerations[p]),
                None => (Twist::zero(), base),
            };
            if let Some(j) = link.motion.joint() {
                let s = &screws[j];
                v = v.plus(s, qd(j));
                a = a.plus(s, qdd(j)).plus(&v.cross(s), qd(j));
            }
            (twists[l], accelerations[l]) = (v, a);
            let X_WL = &posture.link_poses()[l];
            let com_W = X_WL * link.com_L;
            let inertia = |angular: &Vector3<f64>| {
                X_WL.rotation * (link.inertia_L * (X_WL.rotation.inverse() * angular))
            };
            let apply = |m: &Twist| momentum(link.mass, &com_W, inertia, m);
            let (h, f) = (apply(&v), apply(&a));
            let turning = v.cross_momentum(&h);
            wrenches[l] = Wrench {
                moment: f.moment + turning.moment,
                force: f.force + turning.force,
            };
        }

        // Inward: each joint carries everything beyond it.
        for (l, link) in self.links.iter().enumerate().rev() {
            let w = wrenches[l];
            if let Some(j) = link.motion.joint() {
                let s = &screws[j];
                torques[j] = s.angular.dot(&w.moment) + s.linear.dot(&w.force);
            }
            if let Some(p) = link.parent {
                wrenches[p].moment += w.moment;
                wrenches[p].force += w.force;
            }
        }
        Ok(CoreError::check_finite("joint torques", torques)?)
    }
}

/// Spatial inertia about the world origin times a motion.
fn momentum(
    mass: f64,
    com_W: &Point3<f64>,
    inertia: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    motion: &Twist,
) -> Wrench {
    let force = (motion.linear + motion.angular.cross(&com_W.coords)) * mass;
    Wrench {
        moment: inertia(&motion.angular) + com_W.coords.cross(&force),
        force,
    }
}

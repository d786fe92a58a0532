use dyn_clone::DynClone;
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_contact::ContactConfig;
use vsf_core::{Contacts, Posture, RestPoints};
use vsf_data::TorqueKind;
use vsf_robots::{JointKind, RobotModel};

/// The robot and the object that an effect acts on.
#[derive(Debug, Clone)]
pub struct Site {
    /// The robot, placed in the world.
    pub robot: Arc<RobotModel>,
    /// Rest points; none for an arm in free air.
    pub rest: Arc<RestPoints>,
    /// Gravity (m/s²), world frame.
    pub gravity: Vector3<f64>,
    /// What the readings are.
    pub torque_kind: TorqueKind,
    /// Nominal friction coefficient between robot and object, >= 0.
    pub friction: f64,
    /// IDs of the sequences for which the effect may have parameters of their own, in session order.
    pub sequences: Vec<String>,
    /// Length of the session (s), at least 1.
    pub duration: f64,
    /// Mean length of its sequences (s), above 0.
    pub sequence_duration: f64,
}

impl Site {
    /// Number of joints.
    pub fn joints(&self) -> usize {
        self.robot.joint_count()
    }

    /// How an error of 1 of a torque sensor changes [`Sample::reading`]: actuator readings are subtracted from the torque
    /// that the rigid body needs.
    pub(crate) fn sensor_sign(&self) -> f64 {
        match self.torque_kind {
            TorqueKind::External => 1.0,
            TorqueKind::Measured => -1.0,
        }
    }
}

/// Whether joint `j` is prismatic.
pub(crate) fn slides(site: &Site, j: usize) -> bool {
    site.robot.joints()[j].kind() == JointKind::Prismatic
}

/// One sample of a recording, as compensators see it. Samples come in time order.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Time since the session began (s).
    pub clock: f64,
    /// Time since the previous sample of the touch (s), 0 at its first.
    pub dt: f64,
    /// Joint positions (rad or m).
    ///
    /// As recorded; for springs, gains and torques, those of the links, that is, after [`Compensator::joints`] and
    /// [`Compensator::motion`] of all effects (for example those a latency ago).
    pub q: &'a [f64],
    /// Joint velocities (rad/s or m/s), likewise.
    pub qd: &'a [f64],
    /// Joint accelerations (rad/s² or m/s²), likewise.
    pub qdd: &'a [f64],
    /// The reading as load of the environment on the joints (N m or N).
    ///
    /// For `measured` readings it is the rigid-body torque of the model minus the reading. In a recording it is the mean
    /// over a few samples around this one; in a control loop, over the latest samples so far.
    pub reading: &'a [f64],
    /// The load that the gears of the joints carry (N m or N): the reading or, for `measured` readings, the rigid-body
    /// torque of the model.
    pub load: &'a [f64],
    /// Force of the environment on the robot (N, world) that explains the reading best if it acts at the center of the
    /// contact.
    ///
    /// Zero while nothing is touched. Where an effect moves the robot or the object, it is the force of the previous
    /// sample, since contact follows from it.
    pub force_W: Vector3<f64>,
}

/// Robot and contacts at one sample, in the frame of the object.
///
/// If an effect moves the object, the robot has moved the opposite way.
#[derive(Debug, Clone, Copy)]
pub struct Touch<'a> {
    /// Rest points.
    pub rest: &'a RestPoints,
    /// Posture of the robot.
    pub posture: &'a Posture,
    /// Touched points.
    pub contacts: &'a Contacts,
}

/// An effect with fixed parameters, applied sample by sample: its changes to the prediction `tau = G W K + a` of a reading,
/// with gains `G`, columns `W` and torques `a`.
///
/// It has state. Every method does nothing by default. Samples come in time order, so a compensator also runs in a control
/// loop. No method may allocate after its first samples. A copy of a compensator ([`Clone`], also of its box) continues
/// from the same state on its own.
pub trait Compensator: DynClone + Send + Sync {
    /// A sequence begins. The object has had time to recover; the clock goes on.
    fn begin_sequence(&mut self, sequence: &str) {
        let _ = sequence;
    }

    /// A touch begins after a gap of unknown length. The motion before it is unknown.
    fn begin_touch(&mut self) {}

    /// Replaces the recorded joint positions by those of the links.
    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        let _ = (sample, q);
    }

    /// Replaces the joint velocities and accelerations by those of the links. Called after [`Compensator::joints`].
    ///
    /// The weight and inertia of the arm in `measured` readings follow them, and so do all effects on springs and torques.
    fn motion(&mut self, sample: &Sample<'_>, qd: &mut [f64], qdd: &mut [f64]) {
        let _ = (sample, qd, qdd);
    }

    /// Changes the contact parameters, once; they must stay within their ranges.
    fn contact(&self, config: &mut ContactConfig) {
        let _ = config;
    }

    /// Displacement of the object from its recorded place (m, world).
    fn object_shift(&mut self, sample: &Sample<'_>) -> Vector3<f64> {
        let _ = sample;
        Vector3::zeros()
    }

    /// Turns the displacements of the touched points into those that the stiffness multiplies: the force of point i on the
    /// robot is `-K_i springs[i]`.
    ///
    /// On entry, `springs` holds what the previous effects made of them.
    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let _ = (sample, touch, springs);
    }

    /// Scales the field's torque per joint: multiplies `gains`, which are 1 before the first effect.
    fn gains(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, gains: &mut [f64]) {
        let _ = (sample, touch, gains);
    }

    /// Adds torques that do not depend on the stiffness (N m or N) to those of the previous effects, as load of the
    /// environment.
    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let _ = (sample, touch, tau);
    }
}

dyn_clone::clone_trait_object!(Compensator);

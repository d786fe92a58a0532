use dyn_clone::DynClone;
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_contact::ContactConfig;
use vsf_core::{Contacts, Posture, RestPoints};
use vsf_data::TorqueKind;
use vsf_robots::{JointKind, RobotModel};

/// The robot and the object that an effect lives in.
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
    /// IDs of the sequences that the effect may speak of by name, in session order.
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

    /// What an error of a torque sensor by 1 does to [`Sample::reading`]: readings of the actuators are taken off what
    /// the rigid body needs.
    pub(crate) fn sensor_sign(&self) -> f64 {
        match self.torque_kind {
            TorqueKind::External => 1.0,
            TorqueKind::Measured => -1.0,
        }
    }
}

/// Whether joint `j` slides.
pub(crate) fn slides(site: &Site, j: usize) -> bool {
    site.robot.joints()[j].kind() == JointKind::Prismatic
}

/// One sample of a recording, as compensators see it, in time order.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Time since the session began (s).
    pub clock: f64,
    /// Time since the previous sample of the touch (s), 0 at its first.
    pub dt: f64,
    /// Joint positions (rad or m): as recorded, for springs, gains and torques those of the links, that is, as
    /// [`Compensator::joints`] and [`Compensator::motion`] of all effects have them, such as those a latency ago.
    pub q: &'a [f64],
    /// Joint velocities (rad/s or m/s), likewise.
    pub qd: &'a [f64],
    /// Joint accelerations (rad/s² or m/s²), likewise.
    pub qdd: &'a [f64],
    /// The reading as load of the environment on the joints (N m or N); for `measured` readings
    /// the rigid-body torque of the model less the reading. Of a recording, the mean over a few
    /// samples around; of a control loop, over those of them that it has had.
    pub reading: &'a [f64],
    /// The load that the joints' gears carry (N m or N): the reading, or for `measured` readings
    /// the rigid-body torque of the model.
    pub load: &'a [f64],
    /// Force of the environment on the robot (N, world) that explains the reading best if it acts
    /// at the middle of the contact; zero while nothing is touched. Where an effect moves robot or object, it is that of the
    /// sample before, since contact follows from it.
    pub force_W: Vector3<f64>,
}

/// Robot and contacts at one sample. Contacts and posture are in the frame of the object: where an
/// effect moves the object, the robot has moved the other way.
#[derive(Debug, Clone, Copy)]
pub struct Touch<'a> {
    /// Rest points.
    pub rest: &'a RestPoints,
    /// Posture of the robot.
    pub posture: &'a Posture,
    /// Touched points.
    pub contacts: &'a Contacts,
}

/// An effect with its parameters fixed, applied sample by sample: what it does to the prediction
/// `tau = G W K + a` of a reading, with gains `G`, columns `W` and torques `a`.
///
/// Stateful; every method does nothing by default. Samples come in time order, so that a
/// compensator also runs in a control loop; none may allocate after its first samples. Compensators are [`Clone`], and
/// so are their boxes: a copy goes on from the same state on its own.
pub trait Compensator: DynClone + Send + Sync {
    /// A sequence begins: the object has had time to recover, the clock goes on.
    fn begin_sequence(&mut self, sequence: &str) {
        let _ = sequence;
    }

    /// A touch begins after a gap of unknown length: motion before it is unknown.
    fn begin_touch(&mut self) {}

    /// Replaces recorded joint positions by those of the links.
    fn joints(&mut self, sample: &Sample<'_>, q: &mut [f64]) {
        let _ = (sample, q);
    }

    /// Replaces joint velocities and accelerations by those of the links, which weight and inertia of the arm in
    /// `measured` readings and all effects on springs and torques follow; called after [`Compensator::joints`].
    fn motion(&mut self, sample: &Sample<'_>, qd: &mut [f64], qdd: &mut [f64]) {
        let _ = (sample, qd, qdd);
    }

    /// Changes the parameters of contact, once; they stay in their ranges.
    fn contact(&self, config: &mut ContactConfig) {
        let _ = config;
    }

    /// Where the object is, relative to its recorded place (m, world).
    fn object_shift(&mut self, sample: &Sample<'_>) -> Vector3<f64> {
        let _ = sample;
        Vector3::zeros()
    }

    /// Turns the displacements of the touched points, which `springs` holds as the effects before left them, into
    /// those that the stiffness multiplies: the force of point i on the robot is `-K_i springs[i]`.
    fn springs(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        let _ = (sample, touch, springs);
    }

    /// Scales the torque of the field per joint: multiplies `gains`, which are 1 before the first effect.
    fn gains(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, gains: &mut [f64]) {
        let _ = (sample, touch, gains);
    }

    /// Adds torques that do not depend on the stiffness (N m or N), as load of the environment, to those of the
    /// effects before.
    fn torques(&mut self, sample: &Sample<'_>, touch: &Touch<'_>, tau: &mut [f64]) {
        let _ = (sample, touch, tau);
    }
}

dyn_clone::clone_trait_object!(Compensator);

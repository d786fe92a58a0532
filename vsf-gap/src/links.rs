use crate::{Compensator, GapError, Sample, Site};
use nalgebra::Vector3;
use vsf_core::{JointScrew, Posture};
use vsf_robots::DynamicsWorkspace;

/// Motion of the links, which may differ from the recorded motion.
#[derive(Clone)]
pub(crate) struct Links {
    q: Vec<f64>,
    qd: Vec<f64>,
    qdd: Vec<f64>,
}

impl Links {
    /// For a robot with this many joints.
    pub(crate) fn new(joints: usize) -> Self {
        Self {
            q: vec![0.0; joints],
            qd: vec![0.0; joints],
            qdd: vec![0.0; joints],
        }
    }

    /// Moves the links as the effects say, in the frame of the object.
    ///
    /// # Errors
    /// Positions that the robot cannot take.
    pub(crate) fn place(
        &mut self,
        site: &Site,
        effects: &mut dyn Compensator,
        sample: &Sample<'_>,
        posture: &mut Posture,
    ) -> Result<(), GapError> {
        self.q.copy_from_slice(sample.q);
        self.qd.copy_from_slice(sample.qd);
        self.qdd.copy_from_slice(sample.qdd);
        effects.joints(sample, &mut self.q);
        effects.motion(sample, &mut self.qd, &mut self.qdd);
        site.robot.update_posture(&self.q, posture)?;
        let shift = effects.object_shift(sample);
        if shift != Vector3::zeros() {
            translate(posture, &-shift);
        }
        Ok(())
    }

    /// A sample with the motion of the links.
    pub(crate) fn felt<'a>(&'a self, sample: &Sample<'a>) -> Sample<'a> {
        Sample {
            q: &self.q,
            qd: &self.qd,
            qdd: &self.qdd,
            ..*sample
        }
    }

    /// Positions, then velocities, then accelerations.
    pub(crate) fn all(&self) -> impl Iterator<Item = f64> + '_ {
        self.q.iter().chain(&self.qd).chain(&self.qdd).copied()
    }

    /// Change of the actuator reading (N m or N) because the links do not move as recorded.
    ///
    /// # Errors
    /// Motions that the robot cannot take.
    pub(crate) fn rigid_change<'a>(
        &self,
        site: &Site,
        sample: &Sample<'a>,
        workspace: &'a mut DynamicsWorkspace,
    ) -> Result<impl Iterator<Item = f64> + 'a, GapError> {
        let (q, qd, qdd) = (&self.q, &self.qd, &self.qdd);
        let of_links = (site.robot).inverse_dynamics(q, qd, qdd, &site.gravity, workspace)?;
        Ok(sample.load.iter().zip(of_links).map(|(r, l)| r - l))
    }
}

/// Moves a robot as a whole.
fn translate(posture: &mut Posture, by: &Vector3<f64>) {
    let (_, poses, screws) = posture.parts_mut();
    for pose in poses {
        pose.translation.vector += by;
    }
    for screw in screws {
        *screw = JointScrew {
            angular: screw.angular,
            linear: screw.linear + by.cross(&screw.angular),
        };
    }
}

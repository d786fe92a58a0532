use crate::RobotModel;
use crate::model::Motion;
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};
use vsf_core::{CoreError, JointScrew, Posture};

impl RobotModel {
    /// Creates a posture for this robot, to be written by [`RobotModel::update_posture`].
    pub fn posture(&self) -> Posture {
        Posture::new(self.chains.clone())
    }

    /// Forward kinematics: writes the pose of every link and the axis of every joint.
    ///
    /// `q` holds the joint positions (`d` values, rad or m). Limits are not enforced. Never allocates;
    /// takes time proportional to the number of links.
    ///
    /// # Errors
    /// `q` of the wrong length or not finite, or [`CoreError::ForeignPosture`]; the posture is then
    /// unchanged. Also poses that overflow; the posture is then overwritten.
    pub fn update_posture(&self, q: &[f64], posture: &mut Posture) -> Result<(), CoreError> {
        CoreError::check_len("joint positions", q.len(), self.joint_count())?;
        CoreError::check_finite("joint positions", q)?;
        posture.check_robot(&self.chains)?;
        let (q_out, poses, screws) = posture.parts_mut();
        q_out.copy_from_slice(q);
        for (l, link) in self.links.iter().enumerate() {
            let X_WP = link.parent.map_or(self.X_WB, |p| poses[p]);
            let mut X = X_WP * link.X_PJ;
            match &link.motion {
                Motion::Fixed => {}
                Motion::Revolute { joint, axis_J } => {
                    let axis_W = X.rotation * axis_J.into_inner();
                    screws[*joint] =
                        JointScrew::revolute(axis_W, Point3::from(X.translation.vector));
                    X.rotation *= UnitQuaternion::from_axis_angle(axis_J, q[*joint]);
                }
                Motion::Prismatic { joint, axis_J } => {
                    let axis_W = X.rotation * axis_J.into_inner();
                    screws[*joint] = JointScrew::prismatic(axis_W);
                    X.append_translation_mut(&Translation3::from(axis_W * q[*joint]));
                }
            }
            poses[l] = X;
        }
        posture.check()
    }
}

/// Computes the Jacobian of the point of `link` that is at `p_W` (m).
///
/// `columns[j]` becomes the velocity of that point per unit velocity of joint `j`, zero for joints
/// that do not move the link. This is for users and tests; the real-time path multiplies by `J^T` with
/// [`vsf_core::Posture::joint_torques`] and never forms a Jacobian.
///
/// ```
/// use vsf_core::nalgebra::{Point3, Vector3};
/// let robot = vsf_robots::planar_arm(2, 0.5, 0.05)?;
/// let mut posture = robot.posture();
/// robot.update_posture(&[0.0, 0.0], &mut posture)?;
/// let mut columns = [Vector3::zeros(); 2];
/// let tip = robot.link_index("tip")?;
/// vsf_robots::jacobian(&posture, tip, &Point3::new(1.0, 0.0, 0.0), &mut columns)?;
/// assert_eq!(columns, [Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.0, 0.0, 0.5)]);
/// # Ok::<(), vsf_robots::RobotError>(())
/// ```
///
/// # Errors
/// A link out of range, or `columns` whose length is not `d`.
pub fn jacobian(
    posture: &Posture,
    link: usize,
    p_W: &Point3<f64>,
    columns: &mut [Vector3<f64>],
) -> Result<(), CoreError> {
    let chains = posture.chains();
    CoreError::check_len("Jacobian columns", columns.len(), chains.joint_count())?;
    if link >= chains.link_count() {
        return Err(CoreError::OutOfRange {
            what: "link",
            index: link,
            len: chains.link_count(),
        });
    }
    columns.fill(Vector3::zeros());
    for &j in chains.chain(link) {
        columns[j as usize] = posture.screws()[j as usize].velocity_at(p_W);
    }
    Ok(())
}

use vsf_core::{Contacts, CoreError, Noise, Observation, Posture, RestPoints, Scalar, Sensor};

/// External joint torques as a linear observation of the stiffness: the column of a touched point
/// is `w_i = -J(q, p_i + u_i)^T u_i` (Yao & Hauser, eq. 2-4), the Jacobian being that of the link
/// that touches it.
///
/// The reading has one value per joint, in the robot's order: the load of the environment on the
/// robot, with gravity already removed [N m, N for prismatic joints].
///
/// Its noise may be one deviation for all joints, one each, or a full covariance (joints that share
/// an amplifier, a base that shakes), and may change from reading to reading:
/// [`JointTorques::set_noise`].
///
/// ```
/// use vsf_core::nalgebra::{Point3, Vector3};
/// use vsf_core::{Contacts, Noise, Observation, RestPoints, Sensor};
/// use vsf_robots::JointTorques;
///
/// let robot = vsf_robots::planar_arm(1, 1.0, 0.05)?;
/// let mut posture = robot.posture();
/// robot.update_posture(&[0.0], &mut posture)?;
/// // The arm along x has pushed a point at x = 0.5 down by 1 cm: the point pushes back up.
/// let rest = RestPoints::new(vec![Point3::new(0.5, 0.0, 0.0)])?;
/// let mut contacts = Contacts::new();
/// contacts.push(0, robot.link_index("link_1")? as u32, Vector3::new(0.0, 0.0, -0.01), -Vector3::z())?;
///
/// let sensor = JointTorques::new(Noise::uniform(1, 0.1)?);
/// let mut observation: Observation<f64> = sensor.blank();
/// sensor.observe(&rest, &posture, &contacts, &[0.4], &mut observation)?;
/// assert!((observation.row(0)[0] - 0.005).abs() < 1e-15);
/// # Ok::<(), vsf_robots::RobotError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointTorques {
    noise: Noise,
}

impl JointTorques {
    /// A sensor with `noise.dim()` joints and that noise on every reading.
    pub fn new(noise: Noise) -> Self {
        Self { noise }
    }

    /// Replaces the noise, from the next observation on, keeping the memory. In a session:
    /// `session.sensor_mut().set_noise(&noise)`.
    ///
    /// # Errors
    /// Noise of another number of joints; the noise is then unchanged.
    pub fn set_noise(&mut self, noise: &Noise) -> Result<(), CoreError> {
        CoreError::check_len("noise", noise.dim(), self.noise.dim())?;
        self.noise.clone_from(noise);
        Ok(())
    }

    /// Noise of a reading.
    pub fn noise(&self) -> &Noise {
        &self.noise
    }
}

impl<T: Scalar> Sensor<T> for JointTorques {
    fn dim(&self) -> usize {
        self.noise.dim()
    }

    fn blank(&self) -> Observation<T> {
        Observation::new(self.noise.clone())
    }

    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError> {
        let (d, chains) = (self.noise.dim(), posture.chains());
        CoreError::check_len("joints of the posture", chains.joint_count(), d)?;
        CoreError::check_len("observation", out.dim(), d)?;
        out.set_noise(&self.noise)?;
        if let Some(&link) = contacts
            .links()
            .iter()
            .find(|&&l| l as usize >= chains.link_count())
        {
            return Err(CoreError::OutOfRange {
                what: "touching link",
                index: link as usize,
                len: chains.link_count(),
            });
        }
        // `rebuild` checks the touched points before it asks for columns.
        out.rebuild(rest.len(), contacts.points(), reading, |k, w| {
            let p = rest.positions()[contacts.points()[k] as usize];
            let u = contacts.displacements()[k];
            posture.joint_torques(contacts.links()[k] as usize, &(p + u), &-u, w);
        })
    }
}

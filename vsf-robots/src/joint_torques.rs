use std::ops::Range;
use vsf_core::{
    Contacts, CoreError, LinkChains, Noise, Observation, Posture, RestPoints, Scalar, Sensor,
};

/// Sensor of external joint torques, a linear observation of the stiffness.
///
/// The column of a touched point is `w_i = -J(q, p_i + u_i)^T u_i` (Yao & Hauser, eq. 2-4), with the
/// Jacobian of the link that touches it.
///
/// The reading has one value per joint, in the robot's order: the load of the environment on the
/// robot, with gravity already removed (N m, or N for prismatic joints).
///
/// The noise is one standard deviation for all joints, one per joint, or a full covariance (joints that
/// share an amplifier, a base that shakes). [`JointTorques::set_noise`] changes it between readings.
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
    /// Creates a sensor of `noise.dim()` joints with this noise on every reading.
    pub fn new(noise: Noise) -> Self {
        Self { noise }
    }

    /// Replaces the noise from the next observation on, reusing the memory. In a session, call
    /// `session.sensor_mut().set_noise(&noise)`.
    ///
    /// # Errors
    /// Noise for another number of joints. The noise is then unchanged.
    pub fn set_noise(&mut self, noise: &Noise) -> Result<(), CoreError> {
        CoreError::check_len("noise", noise.dim(), self.noise.dim())?;
        self.noise.clone_from(noise);
        Ok(())
    }

    /// Noise of a reading.
    pub fn noise(&self) -> &Noise {
        &self.noise
    }

    /// Number of joints, which are the channels. Unlike [`Sensor::dim`] this needs no number type.
    pub fn dim(&self) -> usize {
        self.noise.dim()
    }

    /// Checks that the sensor has one channel per joint of a robot, like [`Sensor::check_robot`].
    ///
    /// # Errors
    /// The robot has another number of joints.
    pub fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        CoreError::check_len(
            "noise of the joint torques",
            self.dim(),
            chains.joint_count(),
        )
    }
}

impl<T: Scalar> Sensor<T> for JointTorques {
    fn dim(&self) -> usize {
        self.dim()
    }

    fn blank(&self) -> Observation<T> {
        Observation::new(self.noise.clone())
    }

    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        self.check_robot(chains)
    }

    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError> {
        let d = self.noise.dim();
        CoreError::check_len("joints of the posture", posture.screws().len(), d)?;
        CoreError::check_len("observation", out.dim(), d)?;
        // The new noise must not be checked against the previous reading.
        out.clear();
        out.set_noise(&self.noise)?;
        contacts.check_fits(rest, posture)?;
        out.rebuild_rows(rest.len(), contacts.points(), reading, |rows| {
            for start in (0..contacts.len()).step_by(BLOCK) {
                let end = (start + BLOCK).min(contacts.len());
                write_rows(rest, posture, contacts, start..end, rows);
            }
        })
    }
}

/// Number of contacts whose wrenches are kept between the two passes.
const BLOCK: usize = 256;

/// The entries of some contacts in all rows: `angular . (p x f) + linear . f` with the force
/// `f = -u` at `p + u`, as [`Posture::joint_torques`] has it, one joint after the other.
fn write_rows<T: Scalar>(
    rest: &RestPoints,
    posture: &Posture,
    contacts: &Contacts,
    range: Range<usize>,
    rows: &mut [T],
) {
    let points = &contacts.points()[range.clone()];
    let displacements = &contacts.displacements()[range.clone()];
    let links = &contacts.links()[range.clone()];
    let mut wrenches = [[0.0; BLOCK]; 6];
    for (k, (&point, u)) in points.iter().zip(displacements).enumerate() {
        let f = -u;
        let moment = (rest.positions()[point as usize] + u).coords.cross(&f);
        for i in 0..3 {
            wrenches[i][k] = moment[i];
            wrenches[3 + i][k] = f[i];
        }
    }
    let n = contacts.len();
    for (row, screw) in rows.chunks_exact_mut(n).zip(posture.screws()) {
        let (a, l) = (screw.angular, screw.linear);
        let [mx, my, mz, fx, fy, fz] = &wrenches;
        for (k, w) in row[range.clone()].iter_mut().enumerate() {
            let turning = a.x * mx[k] + a.y * my[k] + a.z * mz[k];
            let sliding = l.x * fx[k] + l.y * fy[k] + l.z * fz[k];
            *w = T::from_f64(turning + sliding);
        }
    }
    for (k, &link) in range.zip(links) {
        for &joint in posture.chains().still(link as usize) {
            rows[joint as usize * n + k] = T::ZERO;
        }
    }
}

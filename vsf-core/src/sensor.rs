use crate::{Contacts, CoreError, LinkChains, Observation, Posture, RestPoints, Scalar};
use dyn_clone::DynClone;

/// Turns contacts into a linear observation of the stiffness: joint torques, a wrist wrench, a
/// force gauge.
///
/// Sensors are [`Clone`]. `Box<dyn Sensor<T>>` is itself a sensor and can be cloned.
pub trait Sensor<T: Scalar>: DynClone + Send + Sync {
    /// Number of channels `d` of a reading.
    fn dim(&self) -> usize;

    /// An empty observation with this sensor's noise, to be filled by [`Sensor::observe`].
    fn blank(&self) -> Observation<T>;

    /// Checks that the sensor fits the robot with these chains, for example that it has one channel per joint.
    ///
    /// [`Session::new`](crate::Session::new) calls this once. The default accepts every robot.
    ///
    /// # Errors
    /// The sensor does not fit the robot; the error says why.
    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        let _ = chains;
        Ok(())
    }

    /// Writes the columns `w_i` of the touched points and the `reading` into `out`, replacing its content.
    ///
    /// Also writes the noise if it may have changed since [`Sensor::blank`]. The column of a point depends only on
    /// the point's own contact, and is zero if its displacement is zero.
    ///
    /// # Errors
    /// A reading of the wrong length, contacts that do not fit the posture or the points
    /// ([`Contacts::check_fits`]), or values that are not finite.
    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError>;
}

dyn_clone::clone_trait_object!(<T: Scalar> Sensor<T>);

impl<T: Scalar> std::fmt::Debug for dyn Sensor<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Sensor")
            .field("channels", &self.dim())
            .finish_non_exhaustive()
    }
}

impl<T: Scalar, S: Sensor<T> + ?Sized> Sensor<T> for Box<S>
where
    Self: Clone,
{
    fn dim(&self) -> usize {
        (**self).dim()
    }
    fn blank(&self) -> Observation<T> {
        (**self).blank()
    }
    fn check_robot(&self, chains: &LinkChains) -> Result<(), CoreError> {
        (**self).check_robot(chains)
    }
    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError> {
        (**self).observe(rest, posture, contacts, reading, out)
    }
}

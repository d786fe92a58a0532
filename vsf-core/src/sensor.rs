use crate::{Contacts, CoreError, Observation, Posture, RestPoints, Scalar};

/// Turns contacts into a linear observation of the stiffness: joint torques, a wrist wrench, a
/// force gauge.
pub trait Sensor<T: Scalar>: Send {
    /// Number of channels `d` of a reading.
    fn dim(&self) -> usize;

    /// An empty observation with this sensor's noise, for [`Sensor::observe`] to write.
    fn blank(&self) -> Observation<T>;

    /// Writes the columns `w_i` of the touched points and the `reading` into `out`, and its noise if
    /// that may have changed since [`Sensor::blank`].
    ///
    /// # Errors
    /// A reading of the wrong length, contacts that do not fit posture or points, values that are
    /// not finite.
    fn observe(
        &self,
        rest: &RestPoints,
        posture: &Posture,
        contacts: &Contacts,
        reading: &[f64],
        out: &mut Observation<T>,
    ) -> Result<(), CoreError>;
}

impl<T: Scalar, S: Sensor<T> + ?Sized> Sensor<T> for Box<S> {
    fn dim(&self) -> usize {
        (**self).dim()
    }
    fn blank(&self) -> Observation<T> {
        (**self).blank()
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

use crate::{
    Belief, ContactModel, Contacts, CoreError, Estimator, FilterHealth, Observation, Posture,
    Prediction, RestPoints, Sensor, UpdateReport,
};
use std::sync::Arc;

/// What one step of a [`Session`] did.
pub type StepReport = UpdateReport;

/// An online estimation: a contact model, a sensor and an estimator, with the buffers between
/// them. After warm-up a step allocates nothing of its own.
///
/// To go on after a restart, build a session anew around the restored estimator, between two touches: contacts and
/// [`FilterHealth`] are not saved.
///
/// ```no_run
/// # use vsf_core::*;
/// # fn demo<C: ContactModel, S: Sensor<f32>, E: Estimator<Scalar = f32>>(
/// #     mut session: Session<C, S, E>, stream: Vec<(Posture, Vec<f64>)>) -> Result<(), CoreError> {
/// session.begin_sequence();
/// for (posture, tau) in &stream {
///     let report = session.step(posture, tau)?;
///     println!("{} contacts, residual {:.3} N m", report.contacts, report.prefit);
/// }
/// # Ok(()) }
/// ```
pub struct Session<C, S, E: Estimator> {
    rest: Arc<RestPoints>,
    contact: C,
    sensor: S,
    estimator: E,
    contacts: Contacts,
    observation: Observation<E::Scalar>,
    zero: Vec<f64>,
    health: FilterHealth,
}

impl<C, S, E: Estimator> std::fmt::Debug for Session<C, S, E> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session")
            .field("points", &self.rest.len())
            .field("contacts", &self.contacts.len())
            .field("health", &self.health)
            .finish_non_exhaustive()
    }
}

impl<C, S, E> Session<C, S, E>
where
    C: ContactModel,
    S: Sensor<E::Scalar>,
    E: Estimator,
{
    /// Puts the parts together.
    ///
    /// # Errors
    /// A belief of another size than the field.
    pub fn new(
        rest: Arc<RestPoints>,
        contact: C,
        sensor: S,
        estimator: E,
    ) -> Result<Self, CoreError> {
        CoreError::check_len("belief", estimator.belief().len(), rest.len())?;
        Ok(Self {
            contacts: Contacts::new(),
            observation: sensor.blank(),
            zero: vec![0.0; sensor.dim()],
            health: FilterHealth::default(),
            rest,
            contact,
            sensor,
            estimator,
        })
    }

    /// A new touch sequence begins: contacts are forgotten, and the estimator drops what is bound
    /// to a sequence. The belief is kept.
    pub fn begin_sequence(&mut self) {
        self.begin_touch();
        self.estimator.begin_sequence();
    }

    /// A new touch begins within the sequence: contacts are forgotten.
    pub fn begin_touch(&mut self) {
        self.contact.reset();
        self.contacts.clear();
    }

    /// Moves the robot to `posture`, takes in the `reading` there and updates the belief.
    ///
    /// # Errors
    /// A posture or reading that is not finite or does not fit. The belief is unchanged; the
    /// contact state has followed the posture if the posture itself was good and the reading
    /// had the right length and finite values.
    pub fn step(&mut self, posture: &Posture, reading: &[f64]) -> Result<StepReport, CoreError> {
        CoreError::check_len("reading", reading.len(), self.sensor.dim())?;
        CoreError::check_finite("reading", reading)?;
        self.observe(posture, Some(reading))?;
        let report = self.estimator.update(&self.observation)?;
        self.health.record(&report);
        Ok(report)
    }

    /// Moves the robot to `posture` and predicts the reading there. Learns nothing, but contacts follow as in
    /// [`step`](Self::step): it is for motions whose readings are not known, not for a glance aside in the middle of
    /// a touch.
    ///
    /// # Errors
    /// A posture that is not finite or does not fit.
    pub fn predict(&mut self, posture: &Posture, out: &mut Prediction) -> Result<(), CoreError> {
        self.observe(posture, None)?;
        self.estimator.predict(&self.observation, out)
    }

    fn observe(&mut self, posture: &Posture, reading: Option<&[f64]>) -> Result<(), CoreError> {
        self.contact.step(&self.rest, posture, &mut self.contacts)?;
        let reading = reading.unwrap_or(&self.zero);
        let out = &mut self.observation;
        self.sensor
            .observe(&self.rest, posture, &self.contacts, reading, out)
    }

    /// The rest points.
    pub fn rest(&self) -> &Arc<RestPoints> {
        &self.rest
    }

    /// The current belief.
    pub fn belief(&self) -> &Belief<E::Scalar> {
        self.estimator.belief()
    }

    /// The contacts of the last step.
    pub fn contacts(&self) -> &Contacts {
        &self.contacts
    }

    /// The observation of the last step.
    pub fn observation(&self) -> &Observation<E::Scalar> {
        &self.observation
    }

    /// Innovation statistics since the session began.
    pub fn health(&self) -> &FilterHealth {
        &self.health
    }

    /// The sensor.
    pub fn sensor(&self) -> &S {
        &self.sensor
    }

    /// The sensor, to change its noise while the session runs. It must keep its number of
    /// channels.
    pub fn sensor_mut(&mut self) -> &mut S {
        &mut self.sensor
    }

    /// The estimator.
    pub fn estimator(&self) -> &E {
        &self.estimator
    }

    /// The estimator, to reset or reconfigure it.
    pub fn estimator_mut(&mut self) -> &mut E {
        &mut self.estimator
    }

    /// Takes the estimator out.
    pub fn into_estimator(self) -> E {
        self.estimator
    }
}

use crate::{
    Belief, ContactModel, Contacts, CoreError, Estimator, FilterHealth, LinkChains, Observation,
    Posture, Prediction, RestPoints, Sensor, UpdateReport,
};
use std::sync::Arc;

/// Largest accepted reading (N m or N): beyond any robot, and far below where squares overflow.
pub const MOST_READING: f64 = 1e12;

/// An online estimation: a contact model, a sensor and an estimator of one robot, with the buffers between
/// them.
///
/// After warm-up a step allocates nothing of its own. A clone continues independently from the current state, for
/// example to try out a motion; for a single posture there is [`predict_at`](Self::predict_at).
///
/// To continue after a restart, build a new session around the restored estimator and pass it the saved [`FilterHealth`]
/// ([`with_health`](Self::with_health)). Contacts are not saved, so do this between two touches.
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
#[derive(Clone)]
pub struct Session<C, S, E: Estimator> {
    chains: Arc<LinkChains>,
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
    /// Creates a session from its parts.
    ///
    /// `chains` are those of the robot whose postures the session will get, `RobotModel::chains` of `vsf-robots`. `rest` may
    /// be shared.
    ///
    /// # Errors
    /// A belief whose size differs from the field's, a contact model or sensor that does not fit the robot, or a sensor whose
    /// blank observation does not have [`Sensor::dim`] channels.
    pub fn new(
        chains: Arc<LinkChains>,
        rest: impl Into<Arc<RestPoints>>,
        contact: C,
        sensor: S,
        estimator: E,
    ) -> Result<Self, CoreError> {
        let rest = rest.into();
        CoreError::check_len("belief", estimator.belief().len(), rest.len())?;
        contact.check_robot(&chains)?;
        sensor.check_robot(&chains)?;
        let observation = sensor.blank();
        CoreError::check_len("blank observation", observation.dim(), sensor.dim())?;
        Ok(Self {
            chains,
            contacts: Contacts::new(),
            observation,
            zero: vec![0.0; sensor.dim()],
            health: FilterHealth::default(),
            rest,
            contact,
            sensor,
            estimator,
        })
    }

    /// Sets the statistics to continue from, for example those saved before a restart.
    #[must_use]
    pub fn with_health(self, health: FilterHealth) -> Self {
        Self { health, ..self }
    }

    /// Begins a new touch sequence: forgets contacts, and calls [`Estimator::begin_sequence`]. The
    /// belief is kept.
    pub fn begin_sequence(&mut self) {
        self.begin_touch();
        self.estimator.begin_sequence();
    }

    /// Starts over from `prior`, for example with another object in the same place. Also resets the statistics of
    /// [`health`](Self::health).
    ///
    /// # Errors
    /// A prior whose size differs from the field's, or that the estimator rejects. Nothing is changed then.
    pub fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        CoreError::check_len("belief", prior.len(), self.rest.len())?;
        self.estimator.reset(prior)?;
        self.begin_touch();
        self.health = FilterHealth::default();
        Ok(())
    }

    /// Begins a new touch within the sequence: forgets contacts.
    ///
    /// Call this after a motion that the session has not seen, for example where samples are missing. It is not needed when
    /// the robot leaves the object and returns step by step.
    pub fn begin_touch(&mut self) {
        self.contact.reset();
        self.contacts.clear();
    }

    /// Moves the robot to `posture` and updates the belief with the `reading` taken there.
    ///
    /// The sensor defines what a reading is. The sensor of joint torques expects the load of the environment on the robot,
    /// one number per joint (N m or N), without gravity. Actuator torques have the opposite sign and include the arm's weight.
    ///
    /// # Errors
    /// A posture or reading of the wrong size or not finite; a reading beyond [`MOST_READING`]; a posture of another robot
    /// or never written; a sensor or an estimator whose size was changed. The belief is then unchanged. Contact has
    /// advanced if posture and reading passed these checks. An error is also returned if the estimator reports a NIS that is
    /// not finite, which violates its contract; its belief is then unspecified.
    pub fn step(&mut self, posture: &Posture, reading: &[f64]) -> Result<UpdateReport, CoreError> {
        CoreError::check_len("reading", reading.len(), self.sensor.dim())?;
        CoreError::check_finite("reading", reading)?;
        if let Some(&value) = reading.iter().find(|v| v.abs() > MOST_READING) {
            return Err(CoreError::Parameter {
                name: "reading",
                value,
                range: "within 1e12 N m (or N), beyond any robot",
            });
        }
        self.observe(posture, Some(reading))?;
        let report = self.estimator.update(&self.observation)?;
        CoreError::check_finite("NIS that the estimator reports", &[report.nis])?;
        self.health.record(&report);
        Ok(report)
    }

    /// Moves the robot to `posture` and predicts the reading there, without learning.
    ///
    /// Contacts advance as in [`step`](Self::step), so this is for motions whose readings are unknown. The standard
    /// deviations are those of the estimator. With independent points ([`Belief::uniform`]) they are too small beside
    /// touched places.
    ///
    /// # Errors
    /// A posture that is not finite, does not fit, belongs to another robot or was never written.
    pub fn predict(&mut self, posture: &Posture, out: &mut Prediction) -> Result<(), CoreError> {
        self.observe(posture, None)?;
        self.estimator.predict(&self.observation, out)
    }

    /// Predicts the reading at `posture` like [`predict`](Self::predict), but leaves the session unchanged.
    ///
    /// It can be used in the middle of a touch. The robot is assumed to move there in one step. This clones the
    /// contact model with its state, which allocates and, with many points, takes as long as a step.
    ///
    /// # Errors
    /// As [`predict`](Self::predict).
    pub fn predict_at(&self, posture: &Posture, out: &mut Prediction) -> Result<(), CoreError> {
        self.check(posture)?;
        let (mut contacts, mut observation) = (Contacts::new(), self.sensor.blank());
        let mut contact = dyn_clone::clone(&self.contact);
        contact.step(&self.rest, posture, &mut contacts)?;
        let (rest, zero) = (&self.rest, &self.zero);
        self.sensor
            .observe(rest, posture, &contacts, zero, &mut observation)?;
        self.estimator.predict(&observation, out)
    }

    /// Checks the whole posture, since contact models read link poses only and sensors only what they need. Also checks the
    /// sizes of sensor and estimator, which the caller may have changed.
    fn check(&self, posture: &Posture) -> Result<(), CoreError> {
        CoreError::check_len("channels", self.sensor.dim(), self.zero.len())?;
        CoreError::check_len("belief", self.belief().len(), self.rest.len())?;
        posture.check_robot(&self.chains)?;
        posture.check()
    }

    fn observe(&mut self, posture: &Posture, reading: Option<&[f64]>) -> Result<(), CoreError> {
        self.check(posture)?;
        self.contact.step(&self.rest, posture, &mut self.contacts)?;
        let reading = reading.unwrap_or(&self.zero);
        let out = &mut self.observation;
        self.sensor
            .observe(&self.rest, posture, &self.contacts, reading, out)
    }

    /// Which joints of the robot move which link.
    pub fn chains(&self) -> &Arc<LinkChains> {
        &self.chains
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

    /// Innovation statistics since the session was created or last [reset](Self::reset).
    pub fn health(&self) -> &FilterHealth {
        &self.health
    }

    /// The contact model.
    pub fn contact(&self) -> &C {
        &self.contact
    }

    /// The contact model, to change its knowledge of the world during the session, such as where the object is.
    pub fn contact_mut(&mut self) -> &mut C {
        &mut self.contact
    }

    /// The sensor.
    pub fn sensor(&self) -> &S {
        &self.sensor
    }

    /// The sensor, to change its noise during the session. If its number of channels changes, all further steps
    /// fail.
    pub fn sensor_mut(&mut self) -> &mut S {
        &mut self.sensor
    }

    /// The estimator.
    pub fn estimator(&self) -> &E {
        &self.estimator
    }

    /// The estimator, to reconfigure it. If the size of its belief changes, all further steps fail.
    pub fn estimator_mut(&mut self) -> &mut E {
        &mut self.estimator
    }

    /// Consumes the session and returns the estimator.
    pub fn into_estimator(self) -> E {
        self.estimator
    }
}

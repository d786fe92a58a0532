use crate::{
    Belief, ContactModel, Contacts, CoreError, Estimator, FilterHealth, LinkChains, Observation,
    Posture, Prediction, RestPoints, Sensor, UpdateReport,
};
use std::sync::Arc;

/// Largest reading that is taken (N m or N): beyond any robot, and far from where squares overflow.
pub const MOST_READING: f64 = 1e12;

/// An online estimation: a contact model, a sensor and an estimator of one robot, with the buffers between
/// them. After warm-up a step allocates nothing of its own. A clone goes its own way from where the session stands:
/// for a motion tried out, while [`predict_at`](Self::predict_at) is for a single posture.
///
/// To go on after a restart, build a session anew around the restored estimator, between two touches, as contacts are not
/// saved, and hand it the [`FilterHealth`] that was kept ([`with_health`](Self::with_health)).
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
    /// Puts the parts together. `chains` are those of the robot whose postures the session will be given,
    /// `RobotModel::chains` of `vsf-robots`; `rest` may be shared.
    ///
    /// # Errors
    /// A belief of another size than the field, a sensor or contact that is not of this robot, a sensor whose blank observation
    /// has other channels than it says.
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

    /// The session with statistics that go on from others, such as those before a restart.
    #[must_use]
    pub fn with_health(self, health: FilterHealth) -> Self {
        Self { health, ..self }
    }

    /// A new touch sequence begins: contacts are forgotten, and the estimator drops what is bound
    /// to a sequence. The belief is kept.
    pub fn begin_sequence(&mut self) {
        self.begin_touch();
        self.estimator.begin_sequence();
    }

    /// Starts over from `prior`: with another object in the same place, say. The statistics of
    /// [`health`](Self::health) begin anew as well.
    ///
    /// # Errors
    /// A prior of another size than the field, or that the estimator refuses; nothing has changed then.
    pub fn reset(&mut self, prior: Belief<E::Scalar>) -> Result<(), CoreError> {
        CoreError::check_len("belief", prior.len(), self.rest.len())?;
        self.estimator.reset(prior)?;
        self.begin_touch();
        self.health = FilterHealth::default();
        Ok(())
    }

    /// A new touch begins within the sequence: contacts are forgotten. To be called after motion that the session has not seen,
    /// as where samples are missing; not where the robot leaves the object and comes back step by step.
    pub fn begin_touch(&mut self) {
        self.contact.reset();
        self.contacts.clear();
    }

    /// Moves the robot to `posture`, takes in the `reading` there and updates the belief.
    ///
    /// What a reading is, its sensor says. That of joint torques takes the load of the environment on the robot, one number per
    /// joint (N m or N), without gravity; what actuators read has the other sign and the weight of the arm in it.
    ///
    /// # Errors
    /// A posture or reading of the wrong size or not finite, a reading beyond [`MOST_READING`], a posture of another robot
    /// or never written, a sensor or an estimator whose size was changed. The belief is then unchanged; contact has
    /// advanced if posture and reading passed these checks. An estimator whose report is not finite breaks its promise, and
    /// what it believes then is its own.
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

    /// Moves the robot to `posture` and predicts the reading there. Learns nothing, but contacts follow as in
    /// [`step`](Self::step): it is for motions whose readings are not known. Its deviations are those of the estimator: with
    /// independent points ([`Belief::uniform`]) too small beside touched places.
    ///
    /// # Errors
    /// A posture that is not finite or does not fit, is of another robot or never written.
    pub fn predict(&mut self, posture: &Posture, out: &mut Prediction) -> Result<(), CoreError> {
        self.observe(posture, None)?;
        self.estimator.predict(&self.observation, out)
    }

    /// What [`predict`](Self::predict) would say of `posture`, with nothing changed: a glance aside in the middle of
    /// a touch. The robot is taken to go there in one step. Copies the contact model with all that it remembers,
    /// which allocates and, with many points, takes as long as a step.
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

    /// Contact models look at link poses alone, sensors at what they need of the rest; and sensor and estimator may
    /// have been changed from outside.
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

    /// Which joints of its robot move which link.
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

    /// Innovation statistics since the session began or was last [reset](Self::reset).
    pub fn health(&self) -> &FilterHealth {
        &self.health
    }

    /// The contact model.
    pub fn contact(&self) -> &C {
        &self.contact
    }

    /// The contact model, to change what it knows of the world while the session runs, such as where the object is.
    pub fn contact_mut(&mut self) -> &mut C {
        &mut self.contact
    }

    /// The sensor.
    pub fn sensor(&self) -> &S {
        &self.sensor
    }

    /// The sensor, to change its noise while the session runs. Steps fail from then on if it gets other
    /// channels.
    pub fn sensor_mut(&mut self) -> &mut S {
        &mut self.sensor
    }

    /// The estimator.
    pub fn estimator(&self) -> &E {
        &self.estimator
    }

    /// The estimator, to reconfigure it. Steps fail from then on if its belief gets another size.
    pub fn estimator_mut(&mut self) -> &mut E {
        &mut self.estimator
    }

    /// Takes the estimator out.
    pub fn into_estimator(self) -> E {
        self.estimator
    }
}

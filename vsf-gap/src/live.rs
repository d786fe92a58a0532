use crate::{Corrector, GapError, JointState};
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, UpdateReport};
use vsf_pipeline::live::{Begins, Guard, Learner, Motion, Sample, check_free};

/// ID of the sequences of a stream; no model knows it.
const STREAM: &str = "";

/// A corrected model that learns from a stream: a [`Corrector`] in front of an estimator.
///
/// Torques of the samples are of the kind of its site. Accelerations are estimated, and so are velocities that the samples
/// lack ([`Motion`]). Effects that change with time use the time since the first sample; a single time stamp far ahead
/// shifts that time for good.
#[derive(Debug)]
pub struct LiveCorrector<E> {
    corrector: Corrector,
    estimator: E,
    observation: Observation<f64>,
    motion: Motion,
    guard: Guard,
    /// Time at which the session began, by the clock of the sequence (s), and time since then (s).
    origin: Option<f64>,
    clock: f64,
    /// Whether contact is in the state that the last sample left.
    stands: bool,
}

impl<E: Estimator<Scalar = f64>> LiveCorrector<E> {
    /// Starts a stream; `noise` is that of its readings.
    ///
    /// # Errors
    /// Noise of another number of joints; a belief of another number of points.
    pub fn new(mut corrector: Corrector, estimator: E, noise: Noise) -> Result<Self, GapError> {
        let site = corrector.site();
        CoreError::check_len("noise", noise.dim(), site.joints())?;
        CoreError::check_len("belief", estimator.belief().len(), site.rest.len())?;
        let motion = Motion::new(site.robot.clone());
        let guard = Guard::new(corrector.deepest_starts().to_vec());
        corrector.begin_sequence(STREAM);
        Ok(Self {
            corrector,
            estimator,
            observation: Observation::new(noise),
            motion,
            guard,
            origin: None,
            clock: 0.0,
            stands: false,
        })
    }

    /// The estimator.
    pub fn estimator(&self) -> &E {
        &self.estimator
    }

    /// The estimator, for reconfiguration.
    pub fn estimator_mut(&mut self) -> &mut E {
        &mut self.estimator
    }

    /// Returns the estimator.
    pub fn into_estimator(self) -> E {
        self.estimator
    }

    /// The corrector.
    pub fn corrector(&self) -> &Corrector {
        &self.corrector
    }

    /// Computes contact, columns and the reading minus the model's torques.
    fn observe(&mut self, sample: &Sample, begins: Begins) -> Result<(), GapError> {
        // After a step that failed a touch begins.
        let begins = match begins {
            Begins::Nothing if !self.stands => Begins::Touch,
            begins => begins,
        };
        CoreError::check_len("torques", sample.tau.len(), self.joints())?;
        CoreError::check_finite("torques", &sample.tau)?;
        self.motion.follow(sample, begins)?;
        self.guard.begin(begins);
        match begins {
            Begins::Nothing => {}
            Begins::Touch => self.corrector.begin_touch(),
            Begins::Sequence => {
                self.corrector.begin_sequence(STREAM);
                self.estimator.begin_sequence();
                // A clock that began anew goes on from here.
                self.origin = self.origin.map(|o| o.min(sample.t - self.clock));
            }
        }
        self.stands = false;
        self.clock = sample.t - *self.origin.get_or_insert(sample.t);
        let state = JointState {
            clock: self.clock,
            q: self.motion.q(),
            qd: self.motion.qd(),
            qdd: self.motion.qdd(),
            torques: &sample.tau,
        };
        self.corrector.step(&state, &mut self.observation)?;
        self.stands = true;
        Ok(())
    }
}

impl<E: Estimator<Scalar = f64>> Learner for LiveCorrector<E> {
    type Error = GapError;

    fn joints(&self) -> usize {
        self.corrector.site().joints()
    }

    fn zero(&self) -> &[f64] {
        self.corrector.zero()
    }

    fn tare(&mut self, sample: &Sample, begins: Begins, last: bool) -> Result<(), GapError> {
        let read = self
            .observe(sample, begins)
            .and_then(|()| Ok(check_free(self.observation.points().len())?));
        if let Err(error) = read {
            // Its reading is not to be among those that tare: they are taken anew.
            self.corrector.begin_sequence(STREAM);
            return Err(error);
        }
        if last {
            self.corrector.tare();
        }
        Ok(())
    }

    fn learn(&mut self, sample: &Sample, begins: Begins) -> Result<Option<UpdateReport>, GapError> {
        self.observe(sample, begins)?;
        if self.guard.is_alert() && self.guard.skips(self.corrector.moved()) {
            return Ok(None);
        }
        Ok(Some(self.estimator.update(&self.observation)?))
    }

    fn touching(&self) -> &[u32] {
        self.observation.points()
    }

    fn stiffness(&self, point: usize) -> [f64; 2] {
        let belief = self.estimator.belief();
        [belief.mean()[point], belief.variance()[point]]
    }

    fn field(&self) -> Result<Belief<f64>, CoreError> {
        self.estimator.field()
    }

    fn points(&self) -> usize {
        self.corrector.site().rest.len()
    }
}

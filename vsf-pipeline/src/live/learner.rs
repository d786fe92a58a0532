use super::{Motion, Sample, Tare};
use crate::{PipelineError, SceneContact};
use nalgebra::Vector3;
use std::sync::Arc;
use vsf_core::{
    Belief, Contacts, CoreError, Estimator, Posture, Prediction, Scalar, Session, UpdateReport,
};
use vsf_robots::{DynamicsWorkspace, JointTorques, RobotModel};

/// What starts with a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begins {
    /// Nothing: the arm moved here from the previous sample.
    Nothing,
    /// A touch, after motion that was not observed.
    Touch,
    /// A sequence, which may have another clock.
    Sequence,
}

/// What a [`Node`](super::Node) learns with: contact, sensors and an estimator. A refused sample leaves the
/// belief unchanged. `Box<dyn Learner<Error = E>>` implements the trait too.
pub trait Learner: Send {
    /// Error of a sample.
    type Error: std::error::Error + From<CoreError> + Send + Sync + 'static;

    /// Number of joints of the robot.
    fn joints(&self) -> usize;

    /// The tare offset of each joint (N m or N), which is subtracted from its load: the mean over the
    /// samples that tared the sequence, minus what a model predicts there.
    fn zero(&self) -> &[f64];

    /// Takes one of the first samples of a sequence, in free air. From the `last` of them on, their mean
    /// reading counts as zero.
    ///
    /// # Errors
    /// A sample that is impossible for the robot, or that is in contact. The learner then starts taring
    /// anew, with the next sample as the first.
    fn tare(&mut self, sample: &Sample, begins: Begins, last: bool) -> Result<(), Self::Error>;

    /// Learns from a sample. `None` if nothing was learned, because the beginning of the touch was not seen
    /// ([`Guard`]).
    ///
    /// # Errors
    /// A sample that is impossible for the robot, or that contact or estimator cannot take.
    fn learn(
        &mut self,
        sample: &Sample,
        begins: Begins,
    ) -> Result<Option<UpdateReport>, Self::Error>;

    /// Points that are in contact now.
    fn touching(&self) -> &[u32];

    /// Mean (N/m) and variance (N²/m²) of the stiffness of a point.
    fn stiffness(&self, point: usize) -> [f64; 2];

    /// The whole field.
    ///
    /// # Errors
    /// As [`Estimator::field`].
    fn field(&self) -> Result<Belief<f64>, CoreError>;

    /// Number of rest points.
    fn points(&self) -> usize;
}

impl<E> std::fmt::Debug for dyn Learner<Error = E> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Learner").finish_non_exhaustive()
    }
}

impl<L: Learner + ?Sized> Learner for Box<L> {
    type Error = L::Error;

    fn joints(&self) -> usize {
        (**self).joints()
    }
    fn zero(&self) -> &[f64] {
        (**self).zero()
    }
    fn tare(&mut self, sample: &Sample, begins: Begins, last: bool) -> Result<(), L::Error> {
        (**self).tare(sample, begins, last)
    }
    fn learn(&mut self, sample: &Sample, begins: Begins) -> Result<Option<UpdateReport>, L::Error> {
        (**self).learn(sample, begins)
    }
    fn touching(&self) -> &[u32] {
        (**self).touching()
    }
    fn stiffness(&self, point: usize) -> [f64; 2] {
        (**self).stiffness(point)
    }
    fn field(&self) -> Result<Belief<f64>, CoreError> {
        (**self).field()
    }
    fn points(&self) -> usize {
        (**self).points()
    }
}

/// A session that takes samples of the nominal model, with any estimator, such as those of
/// [`FilterSpec::build`](crate::FilterSpec::build).
#[derive(Debug)]
pub struct LiveSession<E: Estimator> {
    robot: Arc<RobotModel>,
    session: Session<SceneContact, JointTorques, E>,
    gravity: Option<Vector3<f64>>,
    motion: Motion,
    posture: Posture,
    workspace: DynamicsWorkspace,
    guard: Guard,
    reading: Vec<f64>,
    prediction: Prediction,
    tare: Tare,
}

impl<E: Estimator> LiveSession<E> {
    /// Wraps a session of the joint torques of a robot.
    ///
    /// Without `gravity`, samples have the torques of the environment on the robot. With `gravity`, the
    /// acceleration of free fall in the world frame (m/s²), they have the torques at the actuators. These
    /// are then subtracted from the torques that the arm itself needs to move ([`Motion`]).
    ///
    /// # Errors
    /// A session of another robot, or an impossible gravity.
    pub fn new(
        robot: impl Into<Arc<RobotModel>>,
        session: Session<SceneContact, JointTorques, E>,
        gravity: Option<Vector3<f64>>,
    ) -> Result<Self, PipelineError> {
        let robot: Arc<RobotModel> = robot.into();
        session.sensor().check_robot(robot.chains())?;
        let (joints, mut workspace) = (robot.joint_count(), robot.dynamics_workspace());
        if let Some(gravity) = &gravity {
            robot.gravity_torques(&vec![0.0; joints], gravity, &mut workspace)?;
        }
        Ok(Self {
            guard: Guard::new((session.contact()).deepest_starts(session.rest().spacing())),
            motion: Motion::new(Arc::clone(&robot)),
            posture: robot.posture(),
            workspace,
            reading: vec![0.0; joints],
            prediction: Prediction::default(),
            tare: Tare::new(joints),
            robot,
            session,
            gravity,
        })
    }

    /// The session.
    pub fn session(&self) -> &Session<SceneContact, JointTorques, E> {
        &self.session
    }

    /// The session, to change what its parts know of the world.
    pub fn session_mut(&mut self) -> &mut Session<SceneContact, JointTorques, E> {
        &mut self.session
    }

    /// Returns the session.
    pub fn into_session(self) -> Session<SceneContact, JointTorques, E> {
        self.session
    }

    fn begin(&mut self, begins: Begins) {
        self.guard.begin(begins);
        match begins {
            Begins::Nothing => {}
            Begins::Touch => self.session.begin_touch(),
            Begins::Sequence => {
                self.session.begin_sequence();
                self.tare.begin();
            }
        }
    }

    /// Posture and torques of the environment.
    fn read(&mut self, sample: &Sample, begins: Begins) -> Result<(), PipelineError> {
        self.robot.update_posture(&sample.q, &mut self.posture)?;
        CoreError::check_len("reading", sample.tau.len(), self.reading.len())?;
        CoreError::check_finite("reading", &sample.tau)?;
        self.reading.copy_from_slice(&sample.tau);
        if let Some(gravity) = &self.gravity {
            self.motion.follow(sample, begins)?;
            let (q, qd, qdd) = (self.motion.q(), self.motion.qd(), self.motion.qdd());
            let needed = (self.robot).inverse_dynamics(q, qd, qdd, gravity, &mut self.workspace)?;
            let pairs = self.reading.iter_mut().zip(needed);
            pairs.for_each(|(tau, needed)| *tau = needed - *tau);
        }
        Ok(())
    }
}

impl<E: Estimator> LiveSession<E> {
    /// The same of a sample in free air.
    fn read_free(&mut self, sample: &Sample, begins: Begins) -> Result<(), PipelineError> {
        self.read(sample, begins)?;
        self.begin(begins);
        self.session.predict(&self.posture, &mut self.prediction)?;
        Ok(check_free(self.session.contacts().len())?)
    }
}

impl<E: Estimator> Learner for LiveSession<E> {
    type Error = PipelineError;

    fn joints(&self) -> usize {
        self.robot.joint_count()
    }

    fn zero(&self) -> &[f64] {
        self.tare.zero()
    }

    fn tare(&mut self, sample: &Sample, begins: Begins, last: bool) -> Result<(), PipelineError> {
        if let Err(error) = self.read_free(sample, begins) {
            self.tare.begin();
            return Err(error);
        }
        self.tare.add(&self.reading);
        if last {
            self.tare.take();
        }
        Ok(())
    }

    fn learn(
        &mut self,
        sample: &Sample,
        begins: Begins,
    ) -> Result<Option<UpdateReport>, PipelineError> {
        self.read(sample, begins)?;
        self.begin(begins);
        if self.guard.is_alert() {
            self.session.predict(&self.posture, &mut self.prediction)?;
            let begins = self.guard.at_beginning();
            if self
                .guard
                .skips(self.session.contact().moved(self.session.contacts()))
            {
                return Ok(None);
            }
            if begins {
                // The step is made anew, with its reading.
                self.session.begin_touch();
            }
        }
        self.tare.apply(&mut self.reading);
        Ok(Some(self.session.step(&self.posture, &self.reading)?))
    }

    fn touching(&self) -> &[u32] {
        self.session.contacts().points()
    }

    fn stiffness(&self, point: usize) -> [f64; 2] {
        let belief = self.session.belief();
        [belief.mean()[point], belief.variance()[point]].map(Scalar::to_f64)
    }

    fn field(&self) -> Result<Belief<f64>, CoreError> {
        self.session.estimator().field()?.cast()
    }

    fn points(&self) -> usize {
        self.session.rest().len()
    }
}

/// Detects touches whose beginning was not seen, as when samples are missing or a stream begins in contact.
///
/// If the arm is already inside of the object, it is unknown how the points got to where they are. Then
/// nothing may be learned until the arm has been in free air.
#[derive(Debug, Clone)]
pub struct Guard {
    /// How far each link may displace points where a touch begins (m).
    most: Vec<f64>,
    begins: bool,
    blind: bool,
}

impl Guard {
    /// Creates a guard for the beginning of a stream. `most` is the largest displacement (m) by each link
    /// where a touch begins: [`SceneContact::deepest_starts`].
    pub fn new(most: Vec<f64>) -> Self {
        Self {
            most,
            begins: true,
            blind: false,
        }
    }

    /// Notes what begins with the next sample.
    pub fn begin(&mut self, begins: Begins) {
        self.begins |= begins != Begins::Nothing;
    }

    /// Whether a touch begins, or its beginning was not seen. Contacts must then be checked before anything
    /// is learned.
    pub fn is_alert(&self) -> bool {
        self.begins || self.blind
    }

    /// Whether a touch begins with this sample.
    pub fn at_beginning(&self) -> bool {
        self.begins
    }

    /// Whether a sample that moved these points ([`SceneContact::moved`]) must not be learned from.
    pub fn skips(&mut self, moved: &Contacts) -> bool {
        if std::mem::take(&mut self.begins) {
            self.blind = deepest_start(moved, &self.most).is_some();
        } else if moved.is_empty() {
            self.blind = false;
        }
        self.blind
    }
}

/// The link that displaces what it moves the furthest beyond what one may where a touch begins, and how far (m).
pub(crate) fn deepest_start(moved: &Contacts, most: &[f64]) -> Option<(usize, f64)> {
    let pairs = moved.displacements().iter().zip(moved.normals());
    let depths = pairs.map(|(u, n)| u.dot(n));
    let links = moved.links().iter().map(|l| *l as usize);
    let too_deep = |(link, depth): &(usize, f64)| most.get(*link).is_none_or(|most| depth > most);
    let found = links.zip(depths).filter(too_deep);
    found.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// Checks that a tare sample touches no point.
///
/// # Errors
/// If `touching`, the number of touched points, is not 0.
pub fn check_free(touching: usize) -> Result<(), CoreError> {
    if touching == 0 {
        return Ok(());
    }
    Err(CoreError::Parameter {
        name: "points touched in a sample that tares the sensors",
        value: touching as f64,
        range: "0: begin in free air, or take fewer tare samples",
    })
}

use crate::contact::ContactDriver;
use crate::motion::HALF_MEAN;
use crate::{Compensator, GapError, Model, ModelTerms, Sample, Site, Touch};
use vsf_core::{Contacts, CoreError, Observation, Posture};
use vsf_data::TorqueKind;
use vsf_pipeline::Scene;
use vsf_pipeline::live::Tare;
use vsf_robots::{DynamicsWorkspace, RobotModel};

/// Readings of a robot's joint sensors at one moment of a control loop.
#[derive(Debug, Clone, Copy)]
pub struct JointState<'a> {
    /// Time since the session began (s), later than that of the previous state in the same touch.
    pub clock: f64,
    /// Joint positions (rad or m); continuous joints are unwrapped.
    pub q: &'a [f64],
    /// Joint velocities (rad/s or m/s).
    pub qd: &'a [f64],
    /// Joint accelerations (rad/s² or m/s²).
    pub qdd: &'a [f64],
    /// Torques as the sensors give them (N m or N), of the kind [`Site::torque_kind`]. Not tared, see [`Corrector::tare`].
    pub torques: &'a [f64],
}

/// A corrected model in a control loop: contact, columns and torques, state by state. After warm-up, a step allocates
/// nothing.
///
/// From the states of a recording, it computes the observations of [`Campaign::corrected`](crate::Campaign::corrected),
/// which any [`Estimator`](vsf_core::Estimator) takes. For a tared recording, call [`Corrector::tare`]. One difference
/// remains for effects that depend on the reading ([`Sample::reading`]): a recording averages it over the samples around, a
/// loop over the latest ones.
///
/// A clone continues on its own, with the memory of effects and contact. To look ahead, clone it and step the planned
/// states.
///
/// It stands in front of the estimator in place of a [`Session`](vsf_core::Session), whose contact knows no effects:
///
/// ```no_run
/// # use vsf_core::{Estimator, Noise, Observation};
/// # use vsf_gap::{Campaign, Corrector, GapError, JointState, Model};
/// # struct Row { clock: f64, q: Vec<f64>, qd: Vec<f64>, qdd: Vec<f64>, torques: Vec<f64> }
/// # fn demo<E: Estimator<Scalar = f64>>(
/// #     campaign: &Campaign, model: &Model, mut filter: E, stream: impl Iterator<Item = Row>,
/// # ) -> Result<(), GapError> {
/// let mut corrector = Corrector::new(campaign.site(), campaign.scene(), model)?;
/// let mut obs = Observation::new(Noise::uniform(campaign.site().joints(), 0.3)?);
/// corrector.begin_sequence("live");
/// for row in stream {
///     let state = JointState {
///         clock: row.clock,
///         q: &row.q,
///         qd: &row.qd,
///         qdd: &row.qdd,
///         torques: &row.torques,
///     };
///     corrector.step(&state, &mut obs)?;
///     filter.update(&obs)?;
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Clone)]
pub struct Corrector {
    site: Site,
    effects: Box<dyn Compensator>,
    driver: ContactDriver,
    posture: Posture,
    deepest_starts: Vec<f64>,
    contacts: Contacts,
    terms: ModelTerms,
    workspace: DynamicsWorkspace,
    /// Clock of the last state in this touch.
    clock: Option<f64>,
    /// Load of the gears.
    load: Vec<f64>,
    /// Three vectors: the reading as load of the environment, not tared; the readings of the latest states of the touch,
    /// oldest first; and their mean, tared.
    felt: Vec<f64>,
    recent: Vec<f64>,
    smooth: Vec<f64>,
    readings: Tare,
    torques: Tare,
    zero: Vec<f64>,
    /// Torques of the model, tared, and the reading minus them.
    modeled: Vec<f64>,
    left: Vec<f64>,
}

impl std::fmt::Debug for Corrector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Corrector")
            .field("samples", &self.readings.samples())
            .field("zero", &self.zero)
            .finish_non_exhaustive()
    }
}

/// Checks that a scene has the robot and the points of a site.
fn check_scene(site: &Site, scene: &Scene) -> Result<(), GapError> {
    let names = |robot: &RobotModel| -> Vec<String> {
        robot.joints().iter().map(|j| j.name().to_owned()).collect()
    };
    let others = [
        ("joints", names(&site.robot) != names(scene.robot())),
        (
            "rest points",
            site.rest.positions() != scene.rest().positions(),
        ),
    ];
    match others.iter().find(|(_, differs)| *differs) {
        None => Ok(()),
        Some((what, _)) => Err(GapError::OtherScene { what }),
    }
}

impl Corrector {
    /// A model at a site, with the scene of its contacts; both belong to one campaign.
    ///
    /// Whether the parameters are plausible is not checked; [`ModelFile`](crate::ModelFile) does that for models that it
    /// reads.
    ///
    /// # Errors
    /// [`GapError::OtherScene`]; parameters that an effect or contact cannot take.
    pub fn new(site: &Site, scene: &Scene, model: &Model) -> Result<Self, GapError> {
        check_scene(site, scene)?;
        let effects = model.compensator(site)?;
        let d = site.joints();
        Ok(Self {
            driver: ContactDriver::new(site, scene, &*effects)?,
            effects,
            posture: site.robot.posture(),
            deepest_starts: (scene.contact_model()?).deepest_starts(site.rest.spacing()),
            contacts: Contacts::new(),
            terms: ModelTerms::new(d),
            workspace: site.robot.dynamics_workspace(),
            clock: None,
            load: vec![0.0; d],
            felt: vec![0.0; d],
            recent: Vec::with_capacity(HALF_MEAN * d),
            smooth: vec![0.0; d],
            readings: Tare::new(d),
            torques: Tare::new(d),
            zero: vec![0.0; d],
            modeled: vec![0.0; d],
            left: vec![0.0; d],
            site: site.clone(),
        })
    }

    /// Its site.
    pub fn site(&self) -> &Site {
        &self.site
    }

    /// Contacts of the last step.
    pub fn contacts(&self) -> &Contacts {
        &self.contacts
    }

    /// What was moved in the last step: [`SceneContact::moved`](vsf_pipeline::SceneContact::moved).
    pub fn moved(&self) -> &Contacts {
        self.driver.moved(&self.contacts)
    }

    /// Zero offset that is subtracted from the reading of each joint, as load of the environment (N m or N).
    ///
    /// It is the mean of the reading over the states of the tare, minus that of the model's torques.
    pub fn zero(&self) -> &[f64] {
        &self.zero
    }

    /// How far each link may displace points at the start of a touch (m):
    /// [`SceneContact::deepest_starts`](vsf_pipeline::SceneContact::deepest_starts).
    pub fn deepest_starts(&self) -> &[f64] {
        &self.deepest_starts
    }

    /// Begins a sequence with its first touch; the tare is cleared.
    pub fn begin_sequence(&mut self, id: &str) {
        self.effects.begin_sequence(id);
        self.readings.begin();
        self.torques.begin();
        self.zero.fill(0.0);
        self.begin_touch();
    }

    /// Tares: from now on, readings and model torques are relative to their means over the steps since the sequence began.
    /// For a recording with `tare_samples`, call it after that many steps.
    ///
    /// Pass [`JointState::torques`] as the sensors give them, without subtracting a tare. If the sensors zero themselves, let
    /// them do so before the sequence begins, take some steps at rest, and call this too, so that the model's torques are
    /// tared as well.
    pub fn tare(&mut self) {
        self.readings.take();
        self.torques.take();
        self.zero.copy_from_slice(self.readings.zero());
        let pairs = self.zero.iter_mut().zip(self.torques.zero());
        pairs.for_each(|(zero, model)| *zero -= model);
    }

    /// Begins a touch after unobserved motion. Its clock may have any value.
    pub fn begin_touch(&mut self) {
        self.driver.reset();
        self.effects.begin_touch();
        self.clock = None;
        self.recent.clear();
    }

    /// Processes one state: writes the columns `G W` and the reading minus the model's torques to `obs`, and returns those
    /// torques (N m or N).
    ///
    /// The reading is the load of the environment on the joints: `external` torques themselves, or the torque that the
    /// rigid body needs minus `measured` ones.
    ///
    /// # Errors
    /// - Numbers that are not finite or not one per joint; [`GapError::TimeBackwards`] for a clock that does not increase
    ///   within a touch. Nothing has changed then.
    /// - Effects whose results are not finite; a row that robot or contact cannot take. The observation is then empty or
    ///   unchanged; begin a touch to continue.
    pub fn step(
        &mut self,
        state: &JointState<'_>,
        obs: &mut Observation<f64>,
    ) -> Result<&[f64], GapError> {
        let dt = self.check(state)?;
        self.read(state)?;
        let recorded = Sample {
            clock: state.clock,
            dt,
            q: state.q,
            qd: state.qd,
            qdd: state.qdd,
            reading: &self.smooth,
            load: &self.load,
            force_W: self.driver.force(),
        };
        let (posture, contacts) = (&mut self.posture, &mut self.contacts);
        let effects = &mut *self.effects;
        self.driver
            .step(&self.site, effects, &recorded, posture, contacts)?;
        let felt = Sample {
            force_W: self.driver.force(),
            ..self.driver.links().felt(&recorded)
        };
        let touch = Touch {
            rest: &self.site.rest,
            posture,
            contacts,
        };
        self.terms.step(effects, &felt, &touch)?;
        let torques = &mut self.terms.torques;
        if self.site.torque_kind == TorqueKind::Measured {
            let change =
                (self.driver.links()).rigid_change(&self.site, &recorded, &mut self.workspace)?;
            torques.iter_mut().zip(change).for_each(|(t, c)| *t += c);
        }
        self.modeled.copy_from_slice(torques);
        self.torques.apply(&mut self.modeled);
        self.left.copy_from_slice(&self.felt);
        self.readings.apply(&mut self.left);
        let pairs = self.left.iter_mut().zip(&self.modeled);
        pairs.for_each(|(l, a)| *l -= a);
        self.terms.observation(&touch, &self.left, obs)?;
        // A step that failed is part of neither means nor time.
        self.torques.add(&self.terms.torques);
        self.readings.add(&self.felt);
        let d = self.felt.len();
        if self.recent.len() == HALF_MEAN * d {
            self.recent.drain(..d);
        }
        self.recent.extend_from_slice(&self.felt);
        self.clock = Some(state.clock);
        Ok(&self.modeled)
    }

    /// Checks a state. Returns the time since the previous state in the touch (s), 0 at the first.
    fn check(&self, state: &JointState<'_>) -> Result<f64, GapError> {
        let rows = [
            ("positions of the joint state", state.q),
            ("velocities of the joint state", state.qd),
            ("accelerations of the joint state", state.qdd),
            ("torques of the joint state", state.torques),
        ];
        for (what, row) in rows {
            CoreError::check_len(what, row.len(), self.site.joints())?;
            CoreError::check_finite(what, row)?;
        }
        let dt = self.clock.map(|last| state.clock - last);
        let numbers = [state.clock, dt.unwrap_or(0.0)];
        CoreError::check_finite("clock of the joint state", &numbers)?;
        match dt {
            Some(dt) if dt <= 0.0 => Err(GapError::TimeBackwards { dt }),
            _ => Ok(dt.unwrap_or(0.0)),
        }
    }

    /// Computes the load of the gears, and the reading, raw and smoothed.
    fn read(&mut self, state: &JointState<'_>) -> Result<(), GapError> {
        match self.site.torque_kind {
            TorqueKind::External => {
                self.felt.copy_from_slice(state.torques);
                self.load.copy_from_slice(&self.felt);
                self.readings.apply(&mut self.load);
            }
            TorqueKind::Measured => {
                let (q, qd, qdd) = (state.q, state.qd, state.qdd);
                let (robot, gravity) = (&self.site.robot, &self.site.gravity);
                let rigid = robot.inverse_dynamics(q, qd, qdd, gravity, &mut self.workspace)?;
                self.load.copy_from_slice(rigid);
                let pairs = rigid.iter().zip(state.torques);
                (self.felt.iter_mut().zip(pairs)).for_each(|(f, (r, tau))| *f = r - tau);
            }
        }
        let d = self.felt.len();
        for (j, smooth) in self.smooth.iter_mut().enumerate() {
            let before = self.recent.iter().skip(j).step_by(d).copied();
            let all = before.chain([self.felt[j]]);
            *smooth = all.clone().sum::<f64>() / all.count() as f64 - self.readings.zero()[j];
        }
        Ok(CoreError::check_finite(
            "reading of the joint state",
            &self.smooth,
        )?)
    }
}

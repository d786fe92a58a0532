use crate::contact::ContactDriver;
use crate::{Compensator, GapError, Model, Prediction, Sample, Site, Touch};
use vsf_core::{Contacts, CoreError, Observation, Posture};
use vsf_data::TorqueKind;
use vsf_pipeline::Scene;
use vsf_robots::DynamicsWorkspace;

/// A corrected model in a control loop: contact, columns and torques, sample by sample. After
/// warm-up a step allocates nothing.
///
/// Fed with the samples of a recording it gives the observations of
/// [`Campaign::corrected`](crate::Campaign::corrected), which any
/// [`Estimator`](vsf_core::Estimator) takes; of a recording that is tared, after [`Corrector::tare`].
///
/// In place of a [`Session`](vsf_core::Session), whose contact knows no effects, it stands before the estimator:
///
/// ```no_run
/// # use nalgebra::Vector3;
/// # use vsf_core::{Estimator, Noise, Observation};
/// # use vsf_gap::{Campaign, Corrector, GapError, Model, Sample};
/// # struct Row { clock: f64, dt: f64, q: Vec<f64>, qd: Vec<f64>, qdd: Vec<f64>, tau: Vec<f64> }
/// # fn demo<E: Estimator<Scalar = f64>>(
/// #     campaign: &Campaign, model: &Model, mut filter: E, stream: impl Iterator<Item = Row>,
/// # ) -> Result<(), GapError> {
/// let mut corrector = Corrector::new(campaign.site(), campaign.scene(), model)?;
/// let mut obs = Observation::new(Noise::uniform(campaign.site().joints(), 0.3)?);
/// corrector.begin_sequence("live");
/// for row in stream {
///     // Of `external` torques, load and reading are both what the sensors say. Of `measured` ones the load is what
///     // `RobotModel::inverse_dynamics` needs, and the reading that less what the sensors say.
///     let sample = Sample {
///         clock: row.clock,
///         dt: row.dt,
///         q: &row.q,
///         qd: &row.qd,
///         qdd: &row.qdd,
///         reading: &row.tau,
///         load: &row.tau,
///         force_W: Vector3::zeros(), // found by the corrector
///     };
///     corrector.step(&sample, &row.tau, &mut obs)?;
///     filter.update(&obs)?;
/// }
/// # Ok(())
/// # }
/// ```
pub struct Corrector {
    site: Site,
    effects: Box<dyn Compensator>,
    driver: ContactDriver,
    posture: Posture,
    contacts: Contacts,
    prediction: Prediction,
    workspace: DynamicsWorkspace,
    left: Vec<f64>,
    /// Sum of the torques since the sequence began, and number of samples.
    sum: (Vec<f64>, usize),
    /// Torques that are taken as zero.
    tare: Vec<f64>,
}

impl std::fmt::Debug for Corrector {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Corrector")
            .field("samples", &self.sum.1)
            .field("tare", &self.tare)
            .finish_non_exhaustive()
    }
}

impl Corrector {
    /// A model at a site, with the scene of its contacts.
    ///
    /// # Errors
    /// Parameters that an effect or contact cannot take.
    pub fn new(site: &Site, scene: &Scene, model: &Model) -> Result<Self, GapError> {
        let effects = model.compensator(site)?;
        Ok(Self {
            driver: ContactDriver::new(site, scene, &*effects)?,
            effects,
            posture: site.robot.posture(),
            contacts: Contacts::new(),
            prediction: Prediction::new(site.joints()),
            workspace: site.robot.dynamics_workspace(),
            left: vec![0.0; site.joints()],
            sum: (vec![0.0; site.joints()], 0),
            tare: vec![0.0; site.joints()],
            site: site.clone(),
        })
    }

    /// A sequence begins, with its first touch.
    pub fn begin_sequence(&mut self, id: &str) {
        self.effects.begin_sequence(id);
        self.sum.0.fill(0.0);
        self.sum.1 = 0;
        self.tare.fill(0.0);
        self.begin_touch();
    }

    /// The sensors have been tared: from here on, readings are relative to their mean over the samples
    /// since the sequence began, and so are the torques of the model.
    pub fn tare(&mut self) {
        let (sum, samples) = &self.sum;
        let each = 1.0 / (*samples).max(1) as f64;
        self.tare
            .iter_mut()
            .zip(sum)
            .for_each(|(t, s)| *t = each * s);
    }

    /// A touch begins after motion that was not seen.
    pub fn begin_touch(&mut self) {
        self.driver.reset();
        self.effects.begin_touch();
    }

    /// One sample: writes the columns `G W` and the reading less the model's torques to `obs`, and
    /// returns those torques (N m or N). `reading` is that of this sample; [`Sample::reading`] may be
    /// smoother. The force of the sample is found here.
    ///
    /// # Errors
    /// Numbers that are not finite or not one per joint, a time step below zero; effects whose answers are not
    /// finite; a row that robot or contact cannot take. The observation is then empty or as before; begin a touch to
    /// go on.
    pub fn step(
        &mut self,
        sample: &Sample<'_>,
        reading: &[f64],
        obs: &mut Observation<f64>,
    ) -> Result<&[f64], GapError> {
        let rows = [
            ("positions of the sample", sample.q),
            ("velocities of the sample", sample.qd),
            ("accelerations of the sample", sample.qdd),
            ("smoothed reading of the sample", sample.reading),
            ("load of the sample", sample.load),
            ("reading of the sample", reading),
        ];
        for (what, row) in rows {
            CoreError::check_len(what, row.len(), self.site.joints())?;
            CoreError::check_finite(what, row)?;
        }
        CoreError::check_finite("clock and time step", &[sample.clock, sample.dt])?;
        if sample.dt < 0.0 {
            return Err(GapError::TimeBackwards { dt: sample.dt });
        }
        let known = Sample {
            force_W: self.driver.force(),
            ..*sample
        };
        let (posture, contacts) = (&mut self.posture, &mut self.contacts);
        let effects = &mut *self.effects;
        self.driver
            .step(&self.site, effects, &known, posture, contacts)?;
        let felt = Sample {
            force_W: self.driver.force(),
            ..self.driver.links().felt(sample)
        };
        let touch = Touch {
            rest: &self.site.rest,
            posture,
            contacts,
        };
        self.prediction.step(effects, &felt, &touch)?;
        let torques = &mut self.prediction.torques;
        if self.site.torque_kind == TorqueKind::Measured {
            let change =
                (self.driver.links()).rigid_change(&self.site, sample, &mut self.workspace)?;
            torques.iter_mut().zip(change).for_each(|(t, c)| *t += c);
        }
        torques
            .iter_mut()
            .zip(&self.tare)
            .for_each(|(t, o)| *t -= o);
        let pairs = reading.iter().zip(&*torques);
        self.left
            .iter_mut()
            .zip(pairs)
            .for_each(|(l, (y, a))| *l = y - a);
        self.prediction.observation(&touch, &self.left, obs)?;
        // A step that failed is not part of the tare.
        self.sum.1 += 1;
        let untared = self.prediction.torques.iter().zip(&self.tare);
        (self.sum.0.iter_mut().zip(untared)).for_each(|(s, (t, o))| *s += t + o);
        Ok(&self.prediction.torques)
    }
}

use super::{Numbered, Queue, Sample, WhenFull};
use crate::{PipelineError, SceneContact};
use nalgebra::Vector3;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;
use vsf_core::{CoreError, Estimator, Posture, Sensor, Session};
use vsf_robots::{DynamicsWorkspace, JointTorques, RobotModel};

/// The session of a node: any estimator that [`FilterSpec::build`](crate::FilterSpec::build) makes.
pub type LiveSession = Session<SceneContact, JointTorques, Box<dyn Estimator<Scalar = f32>>>;

/// How a node takes a stream that is not perfect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Rate of the samples \[Hz\], by which missing ones are counted; default 1000.
    pub rate_hz: f64,
    /// Summaries a second; default 10.
    pub publish_hz: f64,
    /// After a longer gap contacts are forgotten \[s\], since the path in between is not known;
    /// default 0.1. A single missing sample is no gap, however slow the stream.
    pub max_gap: f64,
    /// A sample this much older than the last is of a clock that was set anew, not late \[s\];
    /// default 1.
    pub restart: f64,
    /// Most samples that wait; default 64.
    pub queue: usize,
    /// What becomes of more.
    pub when_full: WhenFull,
    /// The acceleration of free fall in world \[m/s²\], where torques are those at the actuators: what holds the arm up, by
    /// its URDF, is taken off them. What moves it is not, which at the speed of touches is little. `None`, the default, where
    /// torques are those of the environment.
    pub weight: Option<Vector3<f64>>,
    /// So many samples in the beginning, in free air, whose mean reading is zero; default 0.
    pub tare: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            rate_hz: 1000.0,
            publish_hz: 10.0,
            max_gap: 0.1,
            restart: 1.0,
            queue: 64,
            when_full: WhenFull::DropOldest,
            weight: None,
            tare: 0,
        }
    }
}

/// What became of the samples. `received = refused + dropped + repeated + late + tared + used` in the end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Lines.
    pub received: u64,
    /// Lines that were no samples, or that the session refused.
    pub refused: u64,
    /// Samples that the estimation was too slow for.
    pub dropped: u64,
    /// Samples with the time of the one before.
    pub repeated: u64,
    /// Samples older than the one before.
    pub late: u64,
    /// Samples whose mean reading is zero.
    pub tared: u64,
    /// Samples that the belief has in it.
    pub used: u64,
    /// Samples that should have come between those of a touch that were used, dropped ones included.
    pub missing: u64,
    /// Gaps within a touch after which contacts were forgotten.
    pub gaps: u64,
    /// Times that the clock went back.
    pub restarts: u64,
}

/// Stiffness of the points touched so far \[N/m\].
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Stiffness {
    /// Mean of the points.
    pub mean: f64,
    /// Mean of their standard deviations.
    pub sd: f64,
    /// The stiffest.
    pub max: f64,
}

/// What a node says of its belief.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Time of the last sample \[s\].
    pub t: f64,
    /// Points touched now.
    pub contacts: usize,
    /// Points touched so far.
    pub touched: usize,
    /// Their stiffness.
    pub stiffness: Stiffness,
    /// Root mean square of the norm of the residuals since the last summary, before their update
    /// \[N m\].
    pub residual: f64,
    /// Squared innovations over expected ones since the start; see the guide on filter health.
    pub nis_ratio: Option<f64>,
    /// Longest step since the last summary \[ms\].
    pub slowest_ms: f64,
    /// What became of the samples.
    #[serde(flatten)]
    pub counts: Counts,
}

/// A session that takes samples as they come.
#[derive(Debug)]
pub struct Node {
    robot: Arc<RobotModel>,
    session: LiveSession,
    options: Options,
    posture: Posture,
    workspace: DynamicsWorkspace,
    /// Torques of the environment, and what is zero of them.
    reading: Vec<f64>,
    zero: Vec<f64>,
    /// Time of the last sample that was used, and its touch.
    last: Option<f64>,
    touch: u64,
    due: Option<f64>,
    is_due: bool,
    touched: Vec<bool>,
    since: Since,
    pub(super) counts: Counts,
}

/// What was seen since the last summary.
#[derive(Debug, Default)]
struct Since {
    steps: u32,
    squares: f64,
    slowest: f64,
}

impl Node {
    /// A node of a robot and a session of its joint torques.
    ///
    /// # Errors
    /// Rates that are not positive, a gap or a restart that is negative or not a number, a session of another robot, a weight that
    /// the robot cannot have.
    pub fn new(
        robot: impl Into<Arc<RobotModel>>,
        session: LiveSession,
        options: Options,
    ) -> Result<Self, PipelineError> {
        let Options {
            rate_hz,
            publish_hz,
            max_gap,
            restart,
            ..
        } = options;
        for (name, value) in [("rate", rate_hz), ("rate of summaries", publish_hz)] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(parameter(name, value, "> 0 Hz"));
            }
        }
        for (name, value) in [("longest gap", max_gap), ("restart", restart)] {
            if value.is_nan() || value <= 0.0 {
                return Err(parameter(name, value, "> 0 s"));
            }
        }
        let options = Options {
            max_gap: max_gap.max(2.5 / rate_hz),
            ..options
        };
        let robot: Arc<RobotModel> = robot.into();
        Sensor::<f32>::check_robot(session.sensor(), robot.chains())?;
        let (joints, mut workspace) = (robot.joint_count(), robot.dynamics_workspace());
        if let Some(gravity) = &options.weight {
            robot.gravity_torques(&vec![0.0; joints], gravity, &mut workspace)?;
        }
        Ok(Self {
            posture: robot.posture(),
            workspace,
            reading: vec![0.0; joints],
            zero: vec![0.0; joints],
            touched: vec![false; session.rest().len()],
            last: None,
            touch: 0,
            due: None,
            is_due: false,
            since: Since::default(),
            counts: Counts::default(),
            robot,
            session,
            options,
        })
    }

    /// Joints of the robot.
    pub fn joints(&self) -> usize {
        self.robot.joint_count()
    }

    /// A queue for its samples, empty, for [`run`](super::run).
    pub fn queue(&self) -> Arc<Queue<Numbered>> {
        Arc::new(Queue::new(self.options.queue, self.options.when_full))
    }

    /// How it takes the stream.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// The session.
    pub fn session(&self) -> &LiveSession {
        &self.session
    }

    /// Which points were touched so far.
    pub fn touched(&self) -> &[bool] {
        &self.touched
    }

    /// What became of the samples so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Takes in a sample, unless it is late or repeated, which is counted.
    ///
    /// # Errors
    /// A sample that robot or session refuse; the belief is unchanged.
    pub fn take(&mut self, sample: &Sample) -> Result<(), PipelineError> {
        CoreError::check_finite("time", &[sample.t])?;
        let Options {
            rate_hz,
            max_gap,
            restart,
            ..
        } = self.options;
        let step = self.last.map_or(f64::INFINITY, |last| sample.t - last);
        if step == 0.0 {
            self.counts.repeated += 1;
            return Ok(());
        }
        if step < 0.0 && step > -restart {
            self.counts.late += 1;
            return Ok(());
        }
        self.robot.update_posture(&sample.q, &mut self.posture)?;
        self.read(sample)?;
        if self.counts.tared < self.options.tare {
            self.counts.tared += 1;
            let share = 1.0 / self.counts.tared as f64;
            let pairs = self.zero.iter_mut().zip(&self.reading);
            pairs.for_each(|(zero, tau)| *zero += share * (tau - *zero));
            self.last = Some(sample.t);
            self.touch = sample.touch;
            return Ok(());
        }
        let pairs = self.reading.iter_mut().zip(&self.zero);
        pairs.for_each(|(tau, zero)| *tau -= zero);
        let (restarted, begins) = (step < 0.0, sample.touch != self.touch);
        let within = self.last.is_some() && !restarted && !begins;
        let gap = step > max_gap && within;
        if restarted {
            self.session.begin_sequence();
        } else if gap || begins {
            self.session.begin_touch();
        }
        let begin = Instant::now();
        let report = self.session.step(&self.posture, &self.reading)?;
        let took = 1e3 * begin.elapsed().as_secs_f64();
        for &point in self.session.contacts().points() {
            self.touched[point as usize] = true;
        }
        if within {
            let between = (step * rate_hz).round() - 1.0;
            self.counts.missing = self.counts.missing.saturating_add(between.max(0.0) as u64);
        }
        self.counts.gaps += u64::from(gap);
        self.counts.restarts += u64::from(restarted);
        self.counts.used += 1;
        self.last = Some(sample.t);
        self.touch = sample.touch;
        self.since.steps += 1;
        self.since.squares += report.prefit * report.prefit;
        self.since.slowest = self.since.slowest.max(took);
        let period = 1.0 / self.options.publish_hz;
        let due = match self.due {
            Some(due) if !restarted => due,
            _ => sample.t + period,
        };
        // The sample next to the time that is due, not the one after it.
        self.is_due = sample.t + 0.5 / rate_hz >= due;
        self.due = Some(if !self.is_due {
            due
        } else if due + period > sample.t {
            due + period
        } else {
            sample.t + period
        });
        Ok(())
    }

    /// Torques of the environment.
    fn read(&mut self, sample: &Sample) -> Result<(), PipelineError> {
        CoreError::check_len("reading", sample.tau.len(), self.reading.len())?;
        CoreError::check_finite("reading", &sample.tau)?;
        self.reading.copy_from_slice(&sample.tau);
        if let Some(gravity) = &self.options.weight {
            let held = (self.robot).gravity_torques(&sample.q, gravity, &mut self.workspace)?;
            let pairs = self.reading.iter_mut().zip(held);
            pairs.for_each(|(tau, held)| *tau = held - *tau);
        }
        Ok(())
    }

    /// Whether it is time for a summary.
    pub fn is_due(&self) -> bool {
        self.is_due
    }

    /// What is known now; begins the next period.
    pub fn summary(&mut self) -> Summary {
        self.is_due = false;
        let since = std::mem::take(&mut self.since);
        let belief = self.session.belief();
        let mut stiffness = Stiffness::default();
        let mut touched = 0;
        for (i, _) in self.touched.iter().enumerate().filter(|(_, t)| **t) {
            let k = f64::from(belief.mean()[i]);
            stiffness.mean += k;
            stiffness.sd += f64::from(belief.variance()[i]).sqrt();
            stiffness.max = stiffness.max.max(k);
            touched += 1;
        }
        stiffness.mean /= f64::max(1.0, touched as f64);
        stiffness.sd /= f64::max(1.0, touched as f64);
        Summary {
            t: self.last.unwrap_or(0.0),
            contacts: self.session.contacts().len(),
            touched,
            stiffness,
            residual: (since.squares / f64::from(since.steps.max(1))).sqrt(),
            nis_ratio: self.session.health().nis_ratio(),
            slowest_ms: since.slowest,
            counts: self.counts,
        }
    }
}

fn parameter(name: &'static str, value: f64, range: &'static str) -> PipelineError {
    CoreError::Parameter { name, value, range }.into()
}

use crate::estimate::touched_points;
use crate::readings::check_sequence;
use crate::{PipelineError, Scene, external_torques};
use rayon::prelude::*;
use std::ops::Range;
use vsf_core::{
    ContactModel, Contacts, CoreError, Noise, Observation, Posture, RestPoints, Sensor,
};
use vsf_data::{Sequence, Table};
use vsf_robots::JointTorques;

/// The observations of one sequence, one per sample.
///
/// Contacts and columns are computed once and serve every estimator and every choice of prior and noise.
/// [`Scene::trace`] gives the observations unit noise; [`estimate`](crate::estimate()) replaces whatever
/// noise they have.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// ID of the sequence.
    pub id: String,
    /// Time of each sample (s).
    pub time: Vec<f64>,
    /// One observation per sample; samples in free air have no points.
    pub observations: Vec<Observation<f64>>,
    /// Sample ranges of the touches, in order and without gaps. Contacts are forgotten where a touch
    /// begins.
    pub touches: Vec<Range<usize>>,
}

impl Trace {
    /// Checks that the trace fits the given numbers of rest points and joints.
    ///
    /// Every sample must have an observation that fits, times must increase, and touches must cover all
    /// samples in order, without gaps.
    ///
    /// # Errors
    /// The first sample or touch that does not fit, which is named.
    pub fn check(&self, points: usize, joints: usize) -> Result<(), PipelineError> {
        let rows = self.observations.len();
        let at = |row| {
            move |source| PipelineError::Sequence {
                id: self.id.clone(),
                row,
                source,
            }
        };
        let stamps = self.time.len();
        CoreError::check_len("time", stamps, rows).map_err(at(stamps.min(rows)))?;
        for (row, obs) in self.observations.iter().enumerate() {
            CoreError::check_len("observation", obs.dim(), joints)
                .and_then(|()| obs.check_fits(points))
                .and_then(|()| CoreError::check_finite("time", &self.time[row..=row]))
                .map_err(at(row))?;
            if row > 0 && self.time[row] <= self.time[row - 1] {
                return Err(at(row)(CoreError::Parameter {
                    name: "time",
                    value: self.time[row],
                    range: "later than that of the row before it (s)",
                }));
            }
        }
        let wrong = |index, start, end| {
            let id = self.id.clone();
            Err(PipelineError::Touches {
                id,
                index,
                start,
                end,
                rows,
            })
        };
        let mut last = 0;
        for (index, &Range { start, end }) in self.touches.iter().enumerate() {
            if !(last == start && start <= end && end <= rows) {
                return wrong(index, start, end);
            }
            last = end;
        }
        if last < rows {
            return wrong(self.touches.len(), last, last);
        }
        Ok(())
    }

    /// The same observations with another noise.
    ///
    /// # Errors
    /// Noise of another dimension, or noise so small that a reading overflows when it is whitened.
    pub fn with_noise(&self, noise: &Noise) -> Result<Self, CoreError> {
        let mut trace = self.clone();
        for obs in &mut trace.observations {
            obs.set_noise(noise)?;
        }
        Ok(trace)
    }

    /// Whether these are the same readings at the same times in the same touches, whatever was touched.
    pub(crate) fn has_samples_of(&self, other: &Self) -> bool {
        (&self.id, &self.time, &self.touches) == (&other.id, &other.time, &other.touches)
            && self.readings().eq(other.readings())
    }

    /// Number of samples with at least one contact.
    pub fn contact_samples(&self) -> usize {
        self.observations.iter().filter(|o| !o.is_empty()).count()
    }

    /// The reading of each sample.
    pub fn readings(&self) -> impl Iterator<Item = &[f64]> {
        self.observations.iter().map(Observation::reading)
    }

    /// Mean number of contacts over the samples in contact, 0 without any.
    pub fn mean_contacts(&self) -> f64 {
        let total: usize = self.observations.iter().map(Observation::len).sum();
        total as f64 / self.contact_samples().max(1) as f64
    }

    /// Share of contact at points that are not `touched` elsewhere; `None` without contact.
    ///
    /// Contact is weighted by the readings that springs of equal stiffness at all points would give. Points
    /// beyond the list count as touched.
    pub fn share_of_new(&self, touched: &[bool]) -> Option<f64> {
        let (mut new, mut all) = (0.0, 0.0);
        for observation in &self.observations {
            for (k, p) in observation.points().iter().enumerate() {
                let rows = (0..observation.dim()).map(|j| observation.row(j)[k]);
                let pull = rows.map(|w| w * w).sum::<f64>().sqrt();
                all += pull;
                if touched.get(*p as usize) == Some(&false) {
                    new += pull;
                }
            }
        }
        (all > 0.0).then(|| new / all)
    }
}

impl Scene {
    /// Runs [`Scene::trace`] on every sequence, on the threads of the current rayon pool. The results are
    /// in order. `done` is called after each sequence.
    ///
    /// # Errors
    /// As [`Scene::trace`].
    pub fn traces(
        &self,
        sequences: &[&Sequence],
        done: impl Fn() + Sync,
    ) -> Result<Vec<Trace>, PipelineError> {
        let run = |sequence: &&Sequence| self.trace(sequence).inspect(|_| done());
        sequences.par_iter().map(run).collect()
    }

    /// Runs the contact model over a sequence and observes its joint torques. Contacts are forgotten where a touch
    /// begins.
    ///
    /// # Errors
    /// A sequence that [`Sequence::check`] refuses, or a row that robot, contact or sensor cannot take,
    /// which is named.
    pub fn trace(&self, sequence: &Sequence) -> Result<Trace, PipelineError> {
        let torques = external_torques(self, sequence)?;
        let sensor = JointTorques::new(Noise::uniform(self.robot().joint_count(), 1.0)?);
        self.observe(sequence, &sensor, &torques)
    }

    /// Like [`trace`](Self::trace), with another sensor, such as a force gauge at the wrist.
    ///
    /// `readings` has one row per sample and one column per channel, as the load of the environment on the
    /// robot. Readings are used as they are: they are not tared, and the weight of what the gauge carries
    /// is not removed.
    ///
    /// [`crate::choose_hyper`], [`crate::estimate`] and [`crate::predict`] accept such traces. Functions
    /// for joint torques only ([`crate::score`], [`crate::reading_warnings`], [`crate::Experiment`]) refuse
    /// traces whose number of channels is not the number of joints.
    ///
    /// # Errors
    /// As [`Scene::trace`]; also a sensor for another robot, or readings whose number of rows is not that
    /// of the sequence.
    pub fn observe(
        &self,
        sequence: &Sequence,
        sensor: &dyn Sensor<f64>,
        readings: &Table,
    ) -> Result<Trace, PipelineError> {
        sensor.check_robot(self.robot().chains())?;
        CoreError::check_len("rows of readings", readings.rows(), sequence.len())?;
        let mut observations = Vec::with_capacity(sequence.len());
        self.follow(sequence, |row, posture, contacts| {
            let mut obs = sensor.blank();
            sensor.observe(self.rest(), posture, contacts, &readings[row], &mut obs)?;
            observations.push(obs);
            Ok(())
        })?;
        Ok(Trace {
            id: sequence.id.clone(),
            time: sequence.time.clone(),
            observations,
            touches: sequence.touches().collect(),
        })
    }

    /// Moves the robot through a sequence and calls `visit` with the row, the posture and the contacts of
    /// every sample, in order. Contacts are forgotten where a touch begins.
    ///
    /// # Errors
    /// A sequence that [`Sequence::check`] refuses, or a row that robot, contact or `visit` refuses, which
    /// is named.
    pub fn follow(
        &self,
        sequence: &Sequence,
        mut visit: impl FnMut(usize, &Posture, &Contacts) -> Result<(), CoreError>,
    ) -> Result<(), PipelineError> {
        check_sequence(self.robot(), sequence)?;
        let mut contact = self.contact_model()?;
        let mut posture = self.robot().posture();
        let mut contacts = Contacts::new();
        for touch in sequence.touches() {
            contact.reset();
            for row in touch {
                self.robot()
                    .update_posture(&sequence.angles[row], &mut posture)
                    .and_then(|()| contact.step(self.rest(), &posture, &mut contacts))
                    .and_then(|()| visit(row, &posture, &contacts))
                    .map_err(|source| PipelineError::Sequence {
                        id: sequence.id.clone(),
                        row,
                        source,
                    })?;
            }
        }
        Ok(())
    }
}

/// [`Trace::check`] of all traces.
pub(crate) fn check_traces(
    traces: &[Trace],
    points: usize,
    joints: usize,
) -> Result<(), PipelineError> {
    traces.iter().try_for_each(|t| t.check(points, joints))
}

/// The same problem without the points that are never touched, with another noise and a trace per
/// touch.
pub(crate) fn touched_alone(
    rest: &RestPoints,
    traces: &[Trace],
    noise: &Noise,
) -> Result<(RestPoints, Vec<Trace>), PipelineError> {
    let touched = touched_points(traces, rest.len());
    let mut place = vec![0u32; rest.len()];
    let mut positions = Vec::new();
    for (p, _) in touched.iter().enumerate().filter(|(_, t)| **t) {
        place[p] = positions.len() as u32;
        positions.push(rest.positions()[p]);
    }
    let len = positions.len();
    let renamed = |obs: &Observation<f64>| {
        let points: Vec<u32> = obs.points().iter().map(|&p| place[p as usize]).collect();
        let mut copy = Observation::new(noise.clone());
        copy.rebuild(len, &points, obs.reading(), |k, column| {
            (0..obs.dim()).for_each(|i| column[i] = obs.row(i)[k]);
        })?;
        Ok(copy)
    };
    let of_touch = |(trace, touch): (&Trace, &Range<usize>)| {
        let observations = trace.observations[touch.clone()].iter().map(renamed);
        Ok(Trace {
            id: trace.id.clone(),
            time: trace.time[touch.clone()].to_vec(),
            observations: observations.collect::<Result<_, CoreError>>()?,
            touches: std::iter::once(0..touch.len()).collect(),
        })
    };
    let touches = traces
        .iter()
        .flat_map(|trace| trace.touches.iter().map(move |touch| (trace, touch)))
        .map(of_touch)
        .collect::<Result<_, PipelineError>>()?;
    Ok((RestPoints::new(positions)?, touches))
}

/// Most parts that touches are dealt to, to be held out in turn.
pub(crate) const MOST_FOLDS: usize = 10;

/// The traces that are kept, and those held out in a fold: every `folds`-th from the `fold`-th on.
pub(crate) fn split(traces: &[Trace], fold: usize, folds: usize) -> (Vec<&Trace>, Vec<&Trace>) {
    let (held, kept): (Vec<_>, Vec<_>) =
        (traces.iter().enumerate()).partition(|(i, _)| i % folds == fold);
    let traces = |part: Vec<(usize, _)>| part.into_iter().map(|(_, t)| t).collect();
    (traces(kept), traces(held))
}

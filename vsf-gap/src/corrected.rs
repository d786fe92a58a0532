use crate::{Campaign, GapError, Model};
use std::sync::Arc;
use vsf_core::{CoreError, Noise, Observation};
use vsf_data::{Table, TorqueKind};
use vsf_pipeline::{PipelineError, SequencePrediction, Trace};

/// One sequence under a corrected model `tau = G W K + a`.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Corrected {
    /// Columns `G W`, and the readings minus the model's torques `a`, which is what the stiffness has to explain. Its time
    /// is the clock of the session (s).
    pub trace: Trace,
    /// The torques `a` (N m or N), one row per sample.
    pub torques: Table,
}

impl Campaign {
    /// All sequences under a corrected model, in session order, with the contacts and readings of the diagnosis.
    ///
    /// # Errors
    /// Rows that contact cannot take; parameters that an effect cannot take.
    pub fn corrected(&self, model: &Model) -> Result<Vec<Corrected>, GapError> {
        let session = self.session();
        let d = self.site.joints();
        let unit = Noise::uniform(d, 1.0)?;
        let logs = self.contact_logs(model, &session)?;
        let mut observations: Vec<Vec<Observation<f64>>> = vec![Vec::new(); session.len()];
        let mut torques: Vec<Vec<f64>> = vec![Vec::new(); session.len()];
        let mut outcome: Result<(), PipelineError> = Ok(());
        let mut left = vec![0.0; d];
        self.predict(model, &session, &logs, |s, row, touch, terms| {
            let mut obs = Observation::new(unit.clone());
            let pairs = session[s].reading[row].iter().zip(&terms.torques);
            left.iter_mut()
                .zip(pairs)
                .for_each(|(l, (y, a))| *l = y - a);
            let built = terms.observation(touch, &left, &mut obs);
            if let (Err(source), true) = (built, outcome.is_ok()) {
                let id = session[s].id.clone();
                outcome = Err(PipelineError::Sequence { id, row, source });
            }
            observations[s].push(obs);
            torques[s].extend_from_slice(&terms.torques);
        })?;
        outcome?;
        (session.iter().zip(observations).zip(torques))
            .map(|((motion, observations), torques)| {
                Ok(Corrected {
                    trace: Trace {
                        id: motion.id.clone(),
                        time: motion.clock.clone(),
                        observations,
                        touches: motion.touches.clone(),
                    },
                    torques: Table::new(d, torques)?,
                })
            })
            .collect()
    }

    /// Simulates the readings that a model gives with a stiffness per rest point (N/m).
    ///
    /// Returns one table per sequence, in session order, with readings of the recording's kind. Effects that follow the
    /// load take it from the recorded readings. In a scene with a tare, torques are relative to their mean over the tare
    /// samples, so a constant torque leaves no trace. For readings as a sensor gives them, use
    /// [`vsf_pipeline::Scene::without_tare`].
    ///
    /// # Errors
    /// As [`Campaign::corrected`]; a stiffness that is not finite or whose length is not the number of rest points.
    pub fn simulated(&self, model: &Model, stiffness: &[f64]) -> Result<Vec<Table>, GapError> {
        CoreError::check_len("stiffness", stiffness.len(), self.site.rest.len())?;
        CoreError::check_finite("stiffness", stiffness)?;
        let session = self.session();
        let d = self.site.joints();
        let logs: Vec<Arc<_>> = self.contact_logs(model, &session)?;
        let mut readings: Vec<Vec<f64>> = vec![Vec::new(); session.len()];
        let mut tau = vec![0.0; d];
        self.predict(model, &session, &logs, |s, row, touch, terms| {
            terms.apply(touch, stiffness, &mut tau);
            if self.site.torque_kind == TorqueKind::Measured {
                let rigid = &session[s].load[row];
                tau.iter_mut().zip(rigid).for_each(|(t, r)| *t = r - *t);
            }
            readings[s].extend_from_slice(&tau);
        })?;
        (readings.into_iter())
            .map(|rows| Ok(Table::new(d, rows)?))
            .collect()
    }
}

impl Corrected {
    /// The columns with the readings as recorded, that is, with the model's torques added back.
    ///
    /// # Errors
    /// A sum that is not finite.
    pub fn recorded(&self) -> Result<Trace, GapError> {
        let mut trace = self.trace.clone();
        for (obs, torques) in trace.observations.iter_mut().zip(self.torques.iter()) {
            let sums = obs.reading().iter().zip(torques).map(|(y, a)| y + a);
            let readings: Vec<f64> = sums.collect();
            obs.set_reading(&readings)?;
        }
        Ok(trace)
    }

    /// Completes a field's prediction from [`Corrected::trace`] by adding the model's torques back.
    #[must_use]
    pub fn complete(&self, mut prediction: SequencePrediction) -> SequencePrediction {
        for (mean, torques) in prediction.mean.iter_mut().zip(self.torques.iter()) {
            mean.iter_mut().zip(torques).for_each(|(m, a)| *m += a);
        }
        prediction
    }
}

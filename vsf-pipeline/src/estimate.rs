use crate::{Hyper, PipelineError, Trace};
use vsf_core::{Belief, Estimator, FilterHealth, Noise, Observation, Scalar};
use vsf_filter::{BatchMap, DiagonalForm, DiagonalKalman, MemoryReplay, ReplayConfig};

/// How a field is estimated from recorded sequences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Sample by sample, as on the robot; the default.
    #[default]
    Online,
    /// The constrained optimum over all samples at once ([`BatchMap`]).
    Batch,
}

/// Which estimator, with all of its parameters but prior and noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EstimatorSpec {
    /// Online or batch; the other fields are those of the online estimator.
    pub method: Method,
    /// Form of the diagonal update.
    pub form: DiagonalForm,
    /// Memory replay; `replays = 0` is the plain filter.
    pub replay: ReplayConfig,
}

impl EstimatorSpec {
    /// Makes the estimator.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn build<T: Scalar>(
        &self,
        prior: Belief<T>,
    ) -> Result<Box<dyn Estimator<Scalar = T>>, PipelineError> {
        let filter = DiagonalKalman::with_form(prior, self.form);
        Ok(if self.replay.replays == 0 {
            Box::new(filter)
        } else {
            Box::new(MemoryReplay::new(filter, self.replay)?)
        })
    }
}

/// An estimated field.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// Belief about every point.
    pub belief: Belief<f64>,
    /// Points that were touched at least once.
    pub touched: Vec<bool>,
    /// Innovation statistics over the samples in contact; empty for [`Method::Batch`].
    pub health: FilterHealth,
    /// The prior and noise.
    pub hyper: Hyper,
}

/// Runs an estimator over sequences, from the uniform prior of `hyper`. Calls `progress` after
/// every sequence with the number done.
///
/// # Errors
/// As the estimator's update; the row is named.
pub fn estimate(
    traces: &[Trace],
    field_len: usize,
    spec: &EstimatorSpec,
    hyper: Hyper,
    mut progress: impl FnMut(usize),
) -> Result<Estimate, PipelineError> {
    let prior = Belief::uniform(field_len, 0.0, hyper.prior_sd)?;
    if spec.method == Method::Batch {
        return estimate_batch(traces, prior, hyper);
    }
    let mut estimator = spec.build(prior)?;
    let mut health = FilterHealth::default();
    let mut touched = vec![false; field_len];
    for (done, trace) in traces.iter().enumerate() {
        estimate_online(&mut *estimator, trace, hyper, |obs, report| {
            if !obs.is_empty() {
                health.record(report);
                obs.points()
                    .iter()
                    .for_each(|&p| touched[p as usize] = true);
            }
        })?;
        progress(done + 1);
    }
    Ok(Estimate {
        belief: estimator.belief().clone(),
        touched,
        health,
        hyper,
    })
}

fn estimate_batch(
    traces: &[Trace],
    prior: Belief<f64>,
    hyper: Hyper,
) -> Result<Estimate, PipelineError> {
    let touched = touched_points(traces, prior.len());
    let batch = normal_equations(traces, prior.len())?;
    let belief = batch.solve(&prior.into(), hyper.noise_sd)?.belief()?;
    Ok(Estimate {
        belief,
        touched,
        health: FilterHealth::default(),
        hyper,
    })
}

/// The normal equations of all observations, at unit noise.
pub(crate) fn normal_equations(
    traces: &[Trace],
    field_len: usize,
) -> Result<BatchMap<'_>, PipelineError> {
    let sequences = traces.iter().map(|t| t.observations.as_slice());
    Ok(BatchMap::new(field_len, sequences)?)
}

/// Which points any of the traces touches.
pub(crate) fn touched_points(traces: &[Trace], field_len: usize) -> Vec<bool> {
    let mut touched = vec![false; field_len];
    for &p in traces
        .iter()
        .flat_map(|t| &t.observations)
        .flat_map(Observation::points)
    {
        touched[p as usize] = true;
    }
    touched
}

/// Runs an estimator over one sequence, `seen` is told every observation and what it did.
///
/// # Errors
/// As the estimator's update; the row is named.
pub fn estimate_online(
    estimator: &mut dyn Estimator<Scalar = f64>,
    trace: &Trace,
    hyper: Hyper,
    mut seen: impl FnMut(&Observation<f64>, &vsf_core::UpdateReport),
) -> Result<(), PipelineError> {
    estimator.begin_sequence();
    let mut buffer: Option<Observation<f64>> = None;
    for (row, source) in trace.observations.iter().enumerate() {
        let noise = Noise::uniform(source.dim(), hyper.noise_sd)?;
        let obs = buffer.get_or_insert_with(|| source.clone());
        obs.clone_from(source);
        let report = obs
            .set_noise(&noise)
            .and_then(|()| estimator.update(obs))
            .map_err(|source| PipelineError::Sequence {
                id: trace.id.clone(),
                row,
                source,
            })?;
        seen(obs, &report);
    }
    Ok(())
}

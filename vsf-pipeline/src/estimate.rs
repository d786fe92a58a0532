use crate::trace::check_traces;
use crate::{Hyper, PipelineError, PriorShape, Trace};
use std::str::FromStr;
use vsf_core::{
    Belief, CoreError, Estimator, FilterHealth, Noise, Observation, RestPoints, Scalar,
    UpdateReport,
};
use vsf_filter::{
    BatchMap, CovarianceFilter, DiagonalForm, DiagonalKalman, DualConfig, DualReplay, FieldPrior,
    InformationFilter, MemoryReplay, Projection, ReplayConfig, RobustLoss, RobustNoise,
};

/// Choice of an estimator, with all of its parameters but prior and noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub enum EstimatorSpec {
    /// The constrained optimum over all samples at once, offline ([`BatchMap`]); the default.
    #[default]
    Batch,
    /// Sample by sample, as on the robot.
    Online {
        /// The filter.
        filter: FilterSpec,
        /// Robust weighting of outliers among the readings ([`RobustNoise`]); `None` gives all readings
        /// full weight.
        robust: Option<RobustLoss>,
    },
}

/// Choice of a filter, with all of its parameters but prior and noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilterSpec {
    /// The exact posterior, sample by sample ([`CovarianceFilter`]).
    ///
    /// With the default projection its mean follows the constrained optimum over the samples so far, to
    /// within about 1e-5 of its size. During the first few samples it may lag a percent behind.
    Exact(Projection),
    /// The same posterior by the precision matrix, eq. 5 ([`InformationFilter`]): slow, and without
    /// [`Projection::Constrained`].
    Information(Projection),
    /// Replays that converge to the constrained optimum of independent points, fast enough for the control
    /// loop of a robot ([`DualReplay`]). It uses only the marginals of the prior.
    Dual(DualConfig),
    /// The diagonal filter with memory replay, as in the paper (Alg. 1). It uses only the marginals of the
    /// prior.
    Replay {
        /// Form of the diagonal update.
        form: DiagonalForm,
        /// Parameters of memory replay; `replays = 0` is the plain filter.
        config: ReplayConfig,
    },
}

impl EstimatorSpec {
    /// The names that [`EstimatorSpec::from_str`] accepts, as in `vsf estimate --estimator`.
    pub const NAMES: [&str; 8] = [
        "batch",
        "exact",
        "information",
        "dual",
        "replay",
        "diagonal",
        "printed",
        "updated",
    ];

    /// The diagonal filter with memory replay and default parameters.
    pub fn replay() -> Self {
        FilterSpec::replay().into()
    }

    /// Whether it uses the correlations of the prior between points, not only its marginals.
    pub fn keeps_correlations(&self) -> bool {
        match self {
            Self::Batch => true,
            Self::Online { filter, .. } => match filter {
                FilterSpec::Exact(_) | FilterSpec::Information(_) => true,
                FilterSpec::Dual(_) | FilterSpec::Replay { .. } => false,
            },
        }
    }

    /// The prior shapes to choose from with [`choose_hyper`](crate::choose_hyper). Estimators that
    /// [keep correlations](Self::keeps_correlations) have shapes with and without a smooth part, the others
    /// only independent points.
    pub fn shapes(&self) -> Vec<PriorShape> {
        if self.keeps_correlations() {
            PriorShape::default().or_independent()
        } else {
            vec![PriorShape::independent()]
        }
    }
}

/// An estimator by its name, all parameters at their defaults: `batch`, `exact`, `information` (which shows negative means as
/// zero), `dual`, `replay`, `diagonal` (without replay), and the diagonal filter with replay in its other forms,
/// `printed` (eq. 7 as printed) and `updated`.
///
/// ```
/// use vsf_pipeline::EstimatorSpec;
///
/// let spec: EstimatorSpec = "exact".parse()?;
/// assert!(spec.keeps_correlations());
/// # for name in EstimatorSpec::NAMES { name.parse::<EstimatorSpec>()?; }
/// # Ok::<(), vsf_pipeline::PipelineError>(())
/// ```
impl FromStr for EstimatorSpec {
    type Err = PipelineError;

    fn from_str(name: &str) -> Result<Self, PipelineError> {
        let config = ReplayConfig::default();
        let replay = |form| FilterSpec::Replay { form, config };
        let filter = match name {
            "batch" => return Ok(Self::Batch),
            "exact" => FilterSpec::Exact(Projection::Constrained),
            "information" => FilterSpec::Information(Projection::OutputOnly),
            "dual" => FilterSpec::Dual(DualConfig::default()),
            "replay" => replay(DiagonalForm::Innovation),
            "diagonal" => FilterSpec::Replay {
                form: DiagonalForm::Innovation,
                config: ReplayConfig {
                    replays: 0,
                    ..config
                },
            },
            "printed" => replay(DiagonalForm::Printed),
            "updated" => replay(DiagonalForm::InnovationUpdated),
            _ => {
                return Err(PipelineError::UnknownEstimator {
                    name: name.to_owned(),
                    known: Self::NAMES.join(", "),
                });
            }
        };
        Ok(filter.into())
    }
}

impl From<FilterSpec> for EstimatorSpec {
    fn from(filter: FilterSpec) -> Self {
        let robust = None;
        Self::Online { filter, robust }
    }
}

impl FilterSpec {
    /// The diagonal filter with memory replay and default parameters.
    pub fn replay() -> Self {
        Self::Replay {
            form: DiagonalForm::default(),
            config: ReplayConfig::default(),
        }
    }

    /// Number of past observations replayed after every update.
    pub fn replays(&self) -> usize {
        match self {
            Self::Exact(_) | Self::Information(_) => 0,
            Self::Dual(config) => config.replays,
            Self::Replay { config, .. } => config.replays,
        }
    }

    /// Creates the filter, in `f32` for control loops or in `f64`. If a loss is given, it is robust against
    /// outliers.
    ///
    /// ```
    /// # use vsf_core::Belief;
    /// # use vsf_pipeline::FilterSpec;
    /// let prior = Belief::<f64>::uniform(1000, 0.0, 10.0)?;
    /// let filter = FilterSpec::replay().build::<f32>(prior.into(), None)?;
    /// assert_eq!(filter.belief().len(), 1000);
    /// # Ok::<(), vsf_core::CoreError>(())
    /// ```
    ///
    /// # Errors
    /// A parameter out of range, or a prior beyond the range of `T`.
    pub fn build<T: Scalar>(
        &self,
        prior: FieldPrior,
        robust: Option<RobustLoss>,
    ) -> Result<Box<dyn Estimator<Scalar = T>>, CoreError> {
        let marginals = || prior.marginals()?.cast::<T>();
        match *self {
            Self::Exact(projection) => boxed(
                CovarianceFilter::<T>::with_projection(prior, projection)?,
                robust,
            ),
            Self::Information(projection) => boxed(
                InformationFilter::<T>::with_projection(prior, projection)?,
                robust,
            ),
            Self::Dual(config) => boxed(DualReplay::new(marginals()?, config)?, robust),
            Self::Replay { form, config } => {
                let filter = DiagonalKalman::with_form(marginals()?, form);
                if config.replays == 0 {
                    return boxed(filter, robust);
                }
                match robust {
                    // Inside of the replay, so that past readings are judged anew.
                    Some(loss) => {
                        let filter = RobustNoise::new(filter, loss)?;
                        Ok(Box::new(MemoryReplay::new(filter, config)?))
                    }
                    None => Ok(Box::new(MemoryReplay::new(filter, config)?)),
                }
            }
        }
    }
}

fn boxed<E: Estimator + Clone + 'static>(
    filter: E,
    robust: Option<RobustLoss>,
) -> Result<Box<dyn Estimator<Scalar = E::Scalar>>, CoreError> {
    Ok(match robust {
        Some(loss) => Box::new(RobustNoise::new(filter, loss)?),
        None => Box::new(filter),
    })
}

/// An estimated field.
#[derive(Debug, Clone)]
pub struct Estimate {
    /// Belief about every point.
    pub belief: Belief<f64>,
    /// Points that were touched at least once.
    pub touched: Vec<bool>,
    /// Innovation statistics over the samples in contact; empty for [`EstimatorSpec::Batch`].
    pub health: FilterHealth,
}

/// Runs an estimator over sequences, starting from the prior of `hyper`. `progress` is called after every
/// sequence with the number of sequences done.
///
/// # Errors
/// Traces that [`Trace::check`] refuses, or an error of the estimator's update, which names the row.
pub fn estimate(
    rest: &RestPoints,
    traces: &[Trace],
    spec: &EstimatorSpec,
    hyper: &Hyper,
    progress: impl FnMut(usize),
) -> Result<Estimate, PipelineError> {
    let prior = hyper.shape.prior(rest, hyper.prior_sd)?;
    estimate_from(prior, traces, spec, &hyper.noise_sd, progress)
}

/// Like [`estimate`], but with a prior of your own.
///
/// It may be an earlier field ([`FieldPrior::from`] a belief), or means from another source with
/// [`PriorShape::prior_about`](crate::PriorShape::prior_about). `noise_sd` has one value per channel (N m
/// or N).
///
/// # Errors
/// As [`estimate`].
pub fn estimate_from(
    prior: FieldPrior,
    traces: &[Trace],
    spec: &EstimatorSpec,
    noise_sd: &[f64],
    progress: impl FnMut(usize),
) -> Result<Estimate, PipelineError> {
    check_traces(traces, prior.len(), noise_sd.len())?;
    let traces: Vec<&Trace> = traces.iter().collect();
    run(
        spec,
        prior,
        &traces,
        &Noise::per_channel(noise_sd)?,
        progress,
    )
}

/// Runs an estimator of your own, of any number type, over sequences.
///
/// Readings have the noise `noise`, or if none is given that of their observations. `progress` is called
/// after every sequence with the number of sequences done.
///
/// ```
/// # use vsf_core::{Belief, Estimator};
/// # use vsf_filter::DiagonalKalman;
/// # use vsf_pipeline::{Trace, estimate_with};
/// # fn traces() -> Vec<Trace> { Vec::new() }
/// let mut own: DiagonalKalman<f32> = DiagonalKalman::new(Belief::uniform(100, 0.0, 30.0)?);
/// let estimate = estimate_with(&mut own, &traces(), None, |_| ())?;
/// assert_eq!(estimate.belief.len(), 100);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// Traces that [`Trace::check`] refuses, or an error of the estimator's update, which names the row.
pub fn estimate_with<E: Estimator + ?Sized>(
    estimator: &mut E,
    traces: &[Trace],
    noise: Option<&Noise>,
    mut progress: impl FnMut(usize),
) -> Result<Estimate, PipelineError> {
    let points = estimator.belief().len();
    let channels = traces.iter().flat_map(|t| &t.observations).map(|o| o.dim());
    let channels = noise.map(Noise::dim).or(channels.max()).unwrap_or(0);
    check_traces(traces, points, channels)?;
    let mut health = FilterHealth::default();
    for (done, trace) in traces.iter().enumerate() {
        estimate_online(estimator, trace, noise, |obs, report| {
            if !obs.is_empty() {
                health.record(report);
            }
        })?;
        progress(done + 1);
    }
    Ok(Estimate {
        belief: estimator.field()?.cast()?,
        touched: touched_points(traces, points),
        health,
    })
}

/// [`estimate_from`] traces that were checked.
pub(crate) fn run(
    spec: &EstimatorSpec,
    prior: FieldPrior,
    traces: &[&Trace],
    noise: &Noise,
    mut progress: impl FnMut(usize),
) -> Result<Estimate, PipelineError> {
    let touched = touched_points(traces.iter().copied(), prior.len());
    let mut health = FilterHealth::default();
    let mut estimator = match *spec {
        EstimatorSpec::Online { filter, robust } => filter.build(prior, robust)?,
        EstimatorSpec::Batch => {
            let belief = optimum(traces, &prior, noise)?;
            progress(traces.len());
            return Ok(Estimate {
                belief,
                touched,
                health,
            });
        }
    };
    for (done, trace) in traces.iter().enumerate() {
        estimate_online(&mut *estimator, trace, Some(noise), |obs, report| {
            if !obs.is_empty() {
                health.record(report);
            }
        })?;
        progress(done + 1);
    }
    Ok(Estimate {
        belief: estimator.field()?,
        touched,
        health,
    })
}

/// The problem of all observations, with one noise.
pub(crate) fn batch_map<'a>(
    traces: impl IntoIterator<Item = &'a Trace>,
    field_len: usize,
    noise: &Noise,
) -> Result<BatchMap<'a>, CoreError> {
    let readings = traces.into_iter().map(|t| t.observations.as_slice());
    BatchMap::with_noise(field_len, readings, noise)
}

/// The optimum. Points never touched keep the variance of the prior, an upper bound.
fn optimum(traces: &[&Trace], prior: &FieldPrior, noise: &Noise) -> Result<Belief<f64>, CoreError> {
    let batch = batch_map(traces.iter().copied(), prior.len(), noise)?;
    let fit = batch.solve(prior, 1.0)?;
    let mut variance = prior.marginals()?.variance().to_vec();
    let touched = fit.marginals(batch.points())?;
    for (&p, &v) in batch.points().iter().zip(touched.variance()) {
        variance[p as usize] = v;
    }
    Belief::new(fit.mean(), variance)
}

/// Which points any of the traces touches.
pub(crate) fn touched_points<'a>(
    traces: impl IntoIterator<Item = &'a Trace>,
    field_len: usize,
) -> Vec<bool> {
    let mut touched = vec![false; field_len];
    let observations = traces.into_iter().flat_map(|t| &t.observations);
    for &p in observations.flat_map(Observation::points) {
        touched[p as usize] = true;
    }
    touched
}

/// Runs an estimator over one sequence. `seen` is called with every observation and the report of its
/// update.
///
/// Readings have the noise `noise`, or if none is given that of their observations.
///
/// # Errors
/// An error of the estimator's update or of [`Observation::set_noise`], which names the row.
pub fn estimate_online<E: Estimator + ?Sized>(
    estimator: &mut E,
    trace: &Trace,
    noise: Option<&Noise>,
    mut seen: impl FnMut(&Observation<E::Scalar>, &UpdateReport),
) -> Result<(), PipelineError> {
    estimator.begin_sequence();
    let Some(first) = trace.observations.first() else {
        return Ok(());
    };
    let mut own: Observation<E::Scalar> = Observation::new(first.noise().clone());
    for (row, obs) in trace.observations.iter().enumerate() {
        let at = |source| PipelineError::Sequence {
            id: trace.id.clone(),
            row,
            source,
        };
        own.cast_from(obs).map_err(at)?;
        if let Some(noise) = noise {
            own.set_noise(noise).map_err(at)?;
        }
        let report = estimator.update(&own).map_err(at)?;
        seen(&own, &report);
    }
    Ok(())
}

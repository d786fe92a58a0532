use crate::estimate::batch_map;
use crate::evaluate::{score, sequence_prediction};
use crate::{Evaluation, Experiment, HyperMethod, PipelineError, PriorShape, Trace, choose_hyper};
use serde::Serialize;
use vsf_core::Noise;

/// Result of one prior on one recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct PriorRow {
    /// Description of its assumption.
    pub prior: &'static str,
    /// Its shape.
    pub shape: PriorShape,
    /// Chosen standard deviation of a point's own part (N/m).
    pub prior_sd: f64,
    /// Errors on the test sequences, with the calibration of the predicted deviations. These include the
    /// correlations of the posterior.
    pub evaluation: Evaluation,
}

/// Compares priors on a recording: independent points as in the paper, a level common to all points in
/// addition to each point's own part (homogeneous plus heterogeneous), and smooth parts of several sizes.
///
/// Prior and noise are chosen for each shape alone. Each is fitted to the train sequences by the
/// constrained optimum and predicts the test sequences.
///
/// # Errors
/// Train sequences that touch nothing, or failures of the estimator.
pub fn compare_priors(experiment: &Experiment) -> Result<Vec<PriorRow>, PipelineError> {
    let independent = PriorShape::independent();
    let smooth = |smooth_share, length| PriorShape {
        smooth_share,
        length,
        ..independent
    };
    let level = PriorShape {
        level_share: 0.5,
        ..independent
    };
    let default = PriorShape::default();
    [
        ("independent points", independent),
        ("common level, 0.5 of the own part", level),
        ("smooth part 0.25 over 4 cm (default)", default),
        ("smooth part 1 over 4 cm", smooth(1.0, 0.04)),
        ("smooth part 1 over 1 cm", smooth(1.0, 0.01)),
        ("smooth part 4 over 1 cm", smooth(4.0, 0.01)),
    ]
    .into_iter()
    .map(|(name, shape)| row(experiment, name, shape))
    .collect()
}

fn row(
    experiment: &Experiment,
    name: &'static str,
    shape: PriorShape,
) -> Result<PriorRow, PipelineError> {
    let (scene, train, test) = (
        experiment.scene(),
        experiment.train_traces(),
        experiment.test_traces(),
    );
    let hyper = choose_hyper(scene.rest(), train, &[shape], HyperMethod::HeldOut)?.hyper;
    let noise = Noise::per_channel(&hyper.noise_sd)?;
    let batch = batch_map(train, scene.rest().len(), &noise)?;
    let fit = batch.solve(&shape.prior(scene.rest(), hyper.prior_sd)?, 1.0)?;
    let predict = |trace: &Trace| sequence_prediction(trace, |obs| fit.predict(obs));
    let predictions: Vec<_> = test.iter().map(predict).collect::<Result<_, _>>()?;
    Ok(PriorRow {
        prior: name,
        shape,
        prior_sd: hyper.prior_sd,
        evaluation: score(scene, test, &predictions)?,
    })
}

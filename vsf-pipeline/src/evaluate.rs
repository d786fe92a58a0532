use crate::trace::check_traces;
use crate::{PipelineError, Scene, Trace};
use serde::{Deserialize, Serialize};
use vsf_core::{Belief, CoreError, Observation, Prediction};

/// Prediction error over sequences: the metric of the paper, `||tau_hat - tau||_2` over time steps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Evaluation {
    /// Mean of the error norm over all samples, in `unit`.
    pub mean_error: f64,
    /// Standard deviation of the error norm over all samples.
    pub sd_error: f64,
    /// Number of samples.
    pub samples: usize,
    /// `N m`, `N` or both.
    pub unit: String,
    /// Mean norm of the readings: the error of predicting zero torque.
    pub zero_error: f64,
    /// Errors by sequence.
    pub per_sequence: Vec<SequenceError>,
    /// Errors by joint.
    pub per_joint: Vec<JointError>,
    /// Calibration of the predicted deviations, if the predictor has any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// Shares of single-channel readings that lie near their prediction, over the samples in contact. For a
/// calibrated Gaussian they are 0.683 and 0.954.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Calibration {
    /// Within one predicted standard deviation.
    pub within_1_sigma: f64,
    /// Within two predicted standard deviations.
    pub within_2_sigma: f64,
}

impl Calibration {
    /// `None` where a prediction has no deviations, or nothing is touched.
    fn of(traces: &[Trace], predictions: &[SequencePrediction]) -> Option<Self> {
        let (mut count, mut within) = (0usize, [0usize; 2]);
        for (trace, prediction) in traces.iter().zip(predictions) {
            if prediction.sd.len() != trace.observations.len() {
                return None;
            }
            let rows = trace.observations.iter().zip(&prediction.mean);
            for ((obs, mean), sd) in rows.zip(&prediction.sd).filter(|((o, _), _)| !o.is_empty()) {
                for ((tau, mean), sd) in obs.reading().iter().zip(mean).zip(sd) {
                    count += 1;
                    for (k, within) in within.iter_mut().enumerate() {
                        *within += usize::from((tau - mean).abs() <= (k + 1) as f64 * sd);
                    }
                }
            }
        }
        let share = |n: usize| n as f64 / count as f64;
        (count > 0).then(|| Self {
            within_1_sigma: share(within[0]),
            within_2_sigma: share(within[1]),
        })
    }
}

impl Evaluation {
    /// Adds, for each of the `traces` evaluated, the share of contact at points that are not in `touched`
    /// ([`SequenceError::new_places`]).
    #[must_use]
    pub fn with_new_places(mut self, touched: &[bool], traces: &[Trace]) -> Self {
        for (errors, trace) in self.per_sequence.iter_mut().zip(traces) {
            errors.new_places = trace.share_of_new(touched);
        }
        self
    }
}

/// Errors of one sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct SequenceError {
    /// ID of the sequence.
    pub sequence: String,
    /// Mean of the error norm over its samples.
    pub mean_error: f64,
    /// Standard deviation of the error norm.
    pub sd_error: f64,
    /// Number of samples.
    pub samples: usize,
    /// Mean norm of the readings.
    pub zero_error: f64,
    /// Number of samples with at least one contact.
    pub contact_samples: usize,
    /// Mean number of contacts over those samples.
    pub mean_contacts: f64,
    /// Share of contact at places that the field has not learned from ([`Trace::share_of_new`]); `None` if
    /// unknown or if nothing is touched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub new_places: Option<f64>,
}

/// Errors of one joint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JointError {
    /// Name of the joint.
    pub joint: String,
    /// `N m`, or `N` for a sliding joint.
    pub unit: String,
    /// Mean absolute error over all samples.
    pub mean_abs_error: f64,
    /// Mean absolute reading: the error of predicting zero torque.
    pub zero_error: f64,
    /// Root mean square error.
    pub rms_error: f64,
}

/// Predicted readings of one sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct SequencePrediction {
    /// ID of the sequence.
    pub id: String,
    /// Predicted readings, one row of `d` per sample.
    pub mean: Vec<Vec<f64>>,
    /// Their standard deviations, noise included; empty when the predictor has none.
    pub sd: Vec<Vec<f64>>,
}

impl SequencePrediction {
    /// Checks that there are `rows` of `joints` finite numbers, and deviations >= 0 for all or none of them.
    fn check(&self, rows: usize, joints: usize) -> Result<(), PipelineError> {
        let at = |row| {
            move |source| PipelineError::Sequence {
                id: self.id.clone(),
                row,
                source,
            }
        };
        let (means, sds) = (self.mean.len(), self.sd.len());
        CoreError::check_len("predicted rows", means, rows).map_err(at(means.min(rows)))?;
        if sds > 0 {
            CoreError::check_len("rows of predicted sd", sds, rows).map_err(at(sds.min(rows)))?;
        }
        let parts = [
            ("predicted reading", &self.mean, f64::NEG_INFINITY),
            ("predicted sd", &self.sd, 0.0),
        ];
        for (name, table, least) in parts {
            let in_range = |values: &[f64]| match values.iter().find(|v| **v < least) {
                None => Ok(()),
                Some(&value) => Err(CoreError::Parameter {
                    name,
                    value,
                    range: ">= 0",
                }),
            };
            for (row, values) in table.iter().enumerate() {
                CoreError::check_len(name, values.len(), joints)
                    .and_then(|()| CoreError::check_finite(name, values))
                    .and_then(|()| in_range(values))
                    .map_err(at(row))?;
            }
        }
        Ok(())
    }
}

/// Readings that a field of means predicts at every sample.
fn fits<'a>(mean: &'a [f64], trace: &'a Trace) -> impl Iterator<Item = Vec<f64>> + 'a {
    trace.observations.iter().map(|obs| {
        let mut fit = vec![0.0; obs.dim()];
        obs.apply(mean, &mut fit);
        fit
    })
}

/// What a field of means predicts for a sequence, without deviations.
pub(crate) fn mean_prediction(mean: &[f64], trace: &Trace) -> SequencePrediction {
    SequencePrediction {
        id: trace.id.clone(),
        mean: fits(mean, trace).collect(),
        sd: Vec::new(),
    }
}

/// Norm of the error of a field of means at every sample.
fn sample_errors<'a>(mean: &'a [f64], trace: &'a Trace) -> impl Iterator<Item = f64> + 'a {
    fits(mean, trace)
        .zip(trace.readings())
        .map(|(fit, tau)| distance(&fit, tau))
}

/// Mean of [`sample_errors`] over all samples of traces, 0 without any.
pub(crate) fn mean_error<'a>(mean: &[f64], traces: impl IntoIterator<Item = &'a Trace>) -> f64 {
    let errors = (traces.into_iter()).flat_map(|trace| sample_errors(mean, trace));
    let (sum, count) = errors.fold((0.0, 0usize), |(sum, n), error| (sum + error, n + 1));
    sum / count.max(1) as f64
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(x, y)| (x - y) * (x - y))
        .sum::<f64>()
        .sqrt()
}

fn check_size(belief: &Belief<f64>, scene: &Scene) -> Result<(), PipelineError> {
    if belief.len() == scene.rest().len() {
        Ok(())
    } else {
        Err(PipelineError::FieldSize {
            field: belief.len(),
            recording: scene.rest().len(),
        })
    }
}

/// Predicts the readings of a sequence from a belief, without learning.
///
/// The standard deviation is that of independent points plus a reading noise of `noise_sd`, one value per
/// channel.
///
/// # Errors
/// A belief of another size than the scene's points, a noise that is negative or not finite, a trace that
/// [`Trace::check`] refuses, such as one with another number of channels than the noise, or predictions
/// that are not representable.
pub fn predict(
    scene: &Scene,
    belief: &Belief<f64>,
    noise_sd: &[f64],
    trace: &Trace,
) -> Result<SequencePrediction, PipelineError> {
    check_size(belief, scene)?;
    CoreError::check_finite("noise sd", noise_sd)?;
    if let Some(&value) = noise_sd
        .iter()
        .find(|sd| **sd < 0.0 || !(*sd * *sd).is_finite())
    {
        return Err(CoreError::Parameter {
            name: "noise sd",
            value,
            range: ">= 0 and finite, its square too",
        }
        .into());
    }
    trace.check(belief.len(), noise_sd.len())?;
    sequence_prediction(trace, |obs| predict_independent(belief, noise_sd, obs))
}

/// What `of` predicts of every observation of a trace.
pub(crate) fn sequence_prediction(
    trace: &Trace,
    of: impl Fn(&Observation<f64>) -> Result<Prediction, CoreError>,
) -> Result<SequencePrediction, PipelineError> {
    let (mut mean, mut sd) = (Vec::new(), Vec::new());
    for obs in &trace.observations {
        let prediction = of(obs)?;
        mean.push(prediction.mean);
        sd.push(prediction.sd);
    }
    Ok(SequencePrediction {
        id: trace.id.clone(),
        mean,
        sd,
    })
}

/// One reading of independent points, with noise of a standard deviation per channel.
pub(crate) fn predict_independent(
    belief: &Belief<f64>,
    noise_sd: &[f64],
    obs: &Observation<f64>,
) -> Result<Prediction, CoreError> {
    let mut out = Prediction::default();
    belief.predict(obs, |i| noise_sd[i], &mut out)?;
    Ok(out)
}

/// Evaluates a field on sequences that it was not estimated from (or on any others).
///
/// # Errors
/// A belief of another size than the scene's points, traces that [`Trace::check`] refuses, or no sequence.
pub fn evaluate(
    scene: &Scene,
    belief: &Belief<f64>,
    traces: &[Trace],
) -> Result<Evaluation, PipelineError> {
    check_size(belief, scene)?;
    check_traces(traces, belief.len(), scene.robot().joint_count())?;
    let predictions = traces.iter().map(|t| mean_prediction(belief.mean(), t));
    score(scene, traces, &predictions.collect::<Vec<_>>())
}

/// Evaluates given predictions, one per trace.
///
/// # Errors
/// No sequence, traces that [`Trace::check`] refuses, or predictions that are not finite, of another shape
/// than the traces, with a negative deviation, or so far off that squared errors are not finite.
pub fn score(
    scene: &Scene,
    traces: &[Trace],
    predictions: &[SequencePrediction],
) -> Result<Evaluation, PipelineError> {
    CoreError::check_len("predictions", predictions.len(), traces.len())?;
    let joints = scene.robot().joint_count();
    check_traces(traces, scene.rest().len(), joints)?;
    let [mut absolute, mut squared, mut read] = [(); 3].map(|()| vec![0.0; joints]);
    let zeros = vec![0.0; joints];
    let mut all = Moments::default();
    let mut per_sequence = Vec::new();
    for (trace, prediction) in traces.iter().zip(predictions) {
        prediction.check(trace.observations.len(), joints)?;
        let mut own = Moments::default();
        for (obs, fit) in trace.observations.iter().zip(&prediction.mean) {
            own.add(
                distance(fit, obs.reading()),
                distance(&zeros, obs.reading()),
            );
            for (j, (f, tau)) in fit.iter().zip(obs.reading()).enumerate() {
                absolute[j] += (f - tau).abs();
                read[j] += tau.abs();
                squared[j] += (f - tau) * (f - tau);
            }
        }
        all.merge(&own);
        per_sequence.push(SequenceError {
            sequence: trace.id.clone(),
            mean_error: own.mean(),
            sd_error: own.sd(),
            samples: own.count,
            zero_error: own.zero / own.count.max(1) as f64,
            contact_samples: trace.contact_samples(),
            mean_contacts: trace.mean_contacts(),
            new_places: None,
        });
    }
    if all.count == 0 {
        return Err(PipelineError::NoSequences {
            what: "evaluation",
            hint: "name sequences, or give the recording a test split (--test of the command, `splits` of dataset.json)",
        });
    }
    let n = all.count as f64;
    CoreError::check_finite("squared errors", &squared)?;
    let per_joint = scene
        .robot()
        .joints()
        .iter()
        .enumerate()
        .map(|(j, joint)| JointError {
            joint: joint.name().to_owned(),
            unit: scene.unit(j).to_owned(),
            mean_abs_error: absolute[j] / n,
            zero_error: read[j] / n,
            rms_error: (squared[j] / n).sqrt(),
        });
    Ok(Evaluation {
        mean_error: all.mean(),
        sd_error: all.sd(),
        samples: all.count,
        unit: scene.error_unit().to_owned(),
        zero_error: all.zero / n,
        per_joint: per_joint.collect(),
        per_sequence,
        calibration: Calibration::of(traces, predictions),
    })
}

/// Moments of the errors of samples, after Chan, Golub and LeVeque (doi:10.2307/2683386): squares of large errors that
/// are alike would cancel.
#[derive(Default)]
struct Moments {
    count: usize,
    sum: f64,
    /// Squares about the mean.
    squares: f64,
    zero: f64,
}

impl Moments {
    fn add(&mut self, error: f64, zero: f64) {
        self.merge(&Self {
            count: 1,
            sum: error,
            squares: 0.0,
            zero,
        });
    }

    fn merge(&mut self, other: &Self) {
        let all = (self.count + other.count).max(1) as f64;
        let (own, others) = (self.count as f64, other.count as f64);
        let apart = other.mean() - self.mean();
        self.count += other.count;
        self.sum += other.sum;
        self.squares += other.squares + apart * apart * own * others / all;
        self.zero += other.zero;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    fn sd(&self) -> f64 {
        (self.squares / self.count.max(1) as f64).sqrt()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::slice::from_ref as one;
    use vsf_core::Noise;

    /// Errors of 0, 1.5 and 3 deviations; the reading in the air does not count.
    #[test]
    fn calibration_counts_readings_in_contact() {
        let obs = |points: &[u32], reading: f64| {
            let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
            obs.rebuild(1, points, &[reading], |_, w| w[0] = 1.0)
                .unwrap();
            obs
        };
        let trace = Trace {
            id: String::new(),
            time: vec![0.0; 4],
            observations: vec![
                obs(&[0], 2.0),
                obs(&[0], 5.0),
                obs(&[0], 8.0),
                obs(&[], 90.0),
            ],
            touches: Vec::new(),
        };
        let mut prediction = SequencePrediction {
            id: String::new(),
            mean: vec![vec![2.0]; 4],
            sd: vec![vec![2.0]; 4],
        };
        let found = Calibration::of(one(&trace), one(&prediction)).unwrap();
        assert_eq!(found.within_1_sigma, 1.0 / 3.0);
        assert_eq!(found.within_2_sigma, 2.0 / 3.0);
        prediction.sd.clear();
        assert_eq!(Calibration::of(one(&trace), one(&prediction)), None);
    }

    /// Of two points, one that pulls three times as hard in the one sample that touches both.
    #[test]
    fn new_places_count_by_what_is_felt_there() {
        let obs = |points: &[u32]| {
            let mut obs = Observation::new(Noise::uniform(2, 1.0).unwrap());
            obs.rebuild(2, points, &[0.0; 2], |k, w| {
                w.copy_from_slice(match points[k] {
                    0 => &[0.6, 0.8],
                    _ => &[0.0, -3.0],
                });
            })
            .unwrap();
            obs
        };
        let trace = |observations: Vec<_>| Trace {
            id: String::new(),
            time: vec![0.0; observations.len()],
            observations,
            touches: Vec::new(),
        };
        let both = trace(vec![obs(&[0, 1]), obs(&[0]), obs(&[])]);
        let share = |touched: &[bool]| both.share_of_new(touched).unwrap();
        assert_eq!(share(&[true, false]), 0.6);
        assert_eq!(share(&[false, true]), 0.4);
        assert_eq!((share(&[false, false]), share(&[])), (1.0, 0.0));
        assert_eq!(trace(vec![obs(&[])]).share_of_new(&[false]), None);
    }
}

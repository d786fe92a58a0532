use crate::estimate::{normal_equations, touched_points};
use crate::evaluate::sample_errors;
use crate::{EstimatorSpec, Method, PipelineError, Trace, estimate};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;
use vsf_core::{Belief, Observation};

/// Prior and noise of an estimation. Their ratio decides how closely readings are followed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Hyper {
    /// Standard deviation of the prior N(0, sd²) of every point (N/m).
    pub prior_sd: f64,
    /// Standard deviation of every reading (N m or N), model error included.
    pub noise_sd: f64,
}

/// One tried ratio of prior and noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Candidate {
    /// Prior sd per unit of noise sd.
    pub ratio: f64,
    /// Mean error on held-out train sequences, or the negative log-likelihood per sample of one
    /// pass; lower is better, comparable within one choice only.
    pub score: f64,
}

/// How prior and noise were chosen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HyperChoice {
    /// The choice.
    pub hyper: Hyper,
    /// `held-out` or `likelihood`.
    pub method: &'static str,
    /// All that was tried, by ratio.
    pub candidates: Vec<Candidate>,
}

/// Parts that the train sequences are split into; each is held out once.
const FOLDS: usize = 3;
/// Signal-to-noise ratios `prior sd * |w| / noise sd` of a typical reading: tried first, in powers
/// of 2 around the best next.
const COARSE: [i32; 6] = [-8, -5, -3, -1, 1, 4];

/// Signal-to-noise ratios tried for the batch estimator, in powers of 2.
const BATCH_POWERS: [i32; 8] = [-5, -4, -3, -2, -1, 0, 1, 2];
/// More touched points than this make the batch choice slow; the online one is taken.
const BATCH_CHOICE_POINTS: usize = 2000;

/// Chooses prior and noise from train sequences.
///
/// With several sequences, the ratio of the two is the one whose field, estimated without a third
/// of the sequences, predicts that third best (mean error over samples that touch an estimated
/// point). With a single sequence, or sequences that share no points, it maximises the
/// prequential likelihood of one online pass. The noise level then makes the mean normalised
/// innovation squared of an online pass over samples in contact equal to the number of channels.
///
/// For [`Method::Batch`] each sequence is left out once, the error is averaged over all of its
/// samples, and the noise is the RMS residual of the fit to all train samples in contact: a lower
/// bound, and so is the field's standard deviation. With a single sequence, sequences that share
/// no points, or more than 2000 touched points, the choice is that of `spec` run online.
///
/// # Errors
/// No train sequence ever touches a point; failures of the estimator.
pub fn choose_hyper(
    traces: &[Trace],
    field_len: usize,
    spec: &EstimatorSpec,
) -> Result<HyperChoice, PipelineError> {
    let typical = typical_column_norm(traces).ok_or(PipelineError::NoContact {
        what: "train",
        points: field_len,
    })?;
    let ratio_at = |power: i32| 2f64.powi(power) / typical;
    let held_out = folds_share_points(traces, field_len);
    if spec.method == Method::Batch {
        return choose_batch(traces, field_len, spec, typical, held_out);
    }
    let score = |power: i32| -> Result<Candidate, PipelineError> {
        let hyper = Hyper {
            prior_sd: ratio_at(power),
            noise_sd: 1.0,
        };
        let score = if held_out {
            held_out_error(traces, field_len, spec, hyper)?
        } else {
            negative_log_likelihood(traces, field_len, spec, hyper)?
        };
        Ok(Candidate {
            ratio: hyper.prior_sd,
            score,
        })
    };
    let all = |powers: &[i32]| -> Result<Vec<(i32, Candidate)>, PipelineError> {
        powers.par_iter().map(|&p| Ok((p, score(p)?))).collect()
    };
    let best = |tried: &[(i32, Candidate)]| {
        tried
            .iter()
            .min_by(|a, b| a.1.score.total_cmp(&b.1.score))
            .map_or(0, |b| b.0)
    };
    let mut tried = all(&COARSE)?;
    let near = best(&tried);
    let fine: Vec<i32> = (near - 2..=near + 2)
        .filter(|p| tried.iter().all(|t| t.0 != *p))
        .collect();
    tried.extend(all(&fine)?);
    tried.sort_by_key(|t| t.0);

    let ratio = ratio_at(best(&tried));
    let unit = Hyper {
        prior_sd: ratio,
        noise_sd: 1.0,
    };
    let nis = estimate(traces, field_len, spec, unit, |_| {})?
        .health
        .nis_ratio()
        .unwrap_or(1.0);
    // A perfect fit would ask for zero noise.
    let noise_sd = nis.sqrt().max(1e-9);
    Ok(HyperChoice {
        hyper: Hyper {
            prior_sd: ratio * noise_sd,
            noise_sd,
        },
        method: if held_out { "held-out" } else { "likelihood" },
        candidates: tried.into_iter().map(|t| t.1).collect(),
    })
}

/// As [`choose_hyper`] for the batch estimator. Every sequence is predicted from the others by
/// downdating the fit to all. Where sequences share no points, or there is one only, the online
/// choice serves.
fn choose_batch(
    traces: &[Trace],
    field_len: usize,
    spec: &EstimatorSpec,
    typical: f64,
    held_out: bool,
) -> Result<HyperChoice, PipelineError> {
    let touched = touched_points(traces, field_len);
    let online = EstimatorSpec {
        method: Method::Online,
        ..*spec
    };
    let count = touched.iter().filter(|t| **t).count();
    if !held_out || count > BATCH_CHOICE_POINTS {
        return choose_hyper(traces, field_len, &online);
    }
    let batch = normal_equations(traces, field_len)?;
    let candidate = |power: &i32| -> Result<Candidate, PipelineError> {
        let ratio = 2f64.powi(*power) / typical;
        let prior = Belief::<f64>::uniform(field_len, 0.0, ratio)?;
        let held_out = batch.solve(&prior.into(), 1.0)?.leave_one_out()?;
        let errors = held_out.iter().map(|h| h.mean_error);
        let score = errors.sum::<f64>() / held_out.len() as f64;
        Ok(Candidate { ratio, score })
    };
    let candidates = BATCH_POWERS.iter().map(candidate);
    let candidates: Vec<Candidate> = candidates.collect::<Result<_, _>>()?;
    let best = candidates.iter().min_by(|a, b| a.score.total_cmp(&b.score));
    let ratio = best.map_or(1.0 / typical, |c| c.ratio);
    // The level of what the optimum leaves unexplained, over the samples in contact.
    let field = estimate(
        traces,
        field_len,
        spec,
        Hyper {
            prior_sd: ratio,
            noise_sd: 1.0,
        },
        |_| {},
    )?;
    let (mut squares, mut channels) = (0.0, 0usize);
    for trace in traces {
        let errors = sample_errors(field.belief.mean(), trace);
        for (obs, error) in trace
            .observations
            .iter()
            .zip(errors)
            .filter(|(o, _)| !o.is_empty())
        {
            squares += error * error;
            channels += obs.dim();
        }
    }
    let noise_sd = (squares / channels.max(1) as f64).sqrt().max(1e-9);
    Ok(HyperChoice {
        hyper: Hyper {
            prior_sd: ratio * noise_sd,
            noise_sd,
        },
        method: "held-out",
        candidates,
    })
}

/// Median over the samples in contact of `sqrt(tr(W W^T) / d)`: the reading's sd per unit of
/// prior sd.
fn typical_column_norm(traces: &[Trace]) -> Option<f64> {
    let norm = |o: &Observation<f64>| {
        (o.rows().iter().map(|w| w * w).sum::<f64>() / o.dim() as f64).sqrt()
    };
    let mut norms: Vec<f64> = traces
        .iter()
        .flat_map(|t| &t.observations)
        .filter(|o| !o.is_empty())
        .map(norm)
        .filter(|n| *n > 0.0)
        .collect();
    let middle = norms.len() / 2;
    (!norms.is_empty()).then(|| *norms.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Sequences in and out of fold `k`.
fn split(traces: &[Trace], k: usize) -> (Vec<Trace>, Vec<&Trace>) {
    let folds = FOLDS.min(traces.len());
    let (held, kept): (Vec<_>, Vec<_>) =
        traces.iter().enumerate().partition(|(i, _)| i % folds == k);
    (
        kept.into_iter().map(|(_, t)| t.clone()).collect(),
        held.into_iter().map(|(_, t)| t).collect(),
    )
}

/// Whether held-out sequences mostly touch points that the others touch too.
fn folds_share_points(traces: &[Trace], field_len: usize) -> bool {
    traces.len() > 1
        && (0..FOLDS.min(traces.len())).all(|k| {
            let (kept, held) = split(traces, k);
            let known = touched_points(&kept, field_len);
            let (mut shared, mut all) = (0usize, 0usize);
            for obs in held.iter().flat_map(|t| &t.observations) {
                all += obs.len();
                shared += obs.points().iter().filter(|&&p| known[p as usize]).count();
            }
            2 * shared > all
        })
}

fn held_out_error(
    traces: &[Trace],
    field_len: usize,
    spec: &EstimatorSpec,
    hyper: Hyper,
) -> Result<f64, PipelineError> {
    let (mut sum, mut count) = (0.0, 0usize);
    for k in 0..FOLDS.min(traces.len()) {
        let (kept, held) = split(traces, k);
        let known = touched_points(&kept, field_len);
        let field = estimate(&kept, field_len, spec, hyper, |_| {})?;
        for trace in held {
            let errors = sample_errors(field.belief.mean(), trace);
            for (obs, error) in trace.observations.iter().zip(errors) {
                if obs.points().iter().any(|&p| known[p as usize]) {
                    sum += error;
                    count += 1;
                }
            }
        }
    }
    Ok(sum / count.max(1) as f64)
}

/// Per sample in contact, with the noise level that fits best: for `S = s² S_1` the likelihood is
/// greatest at `s² = mean nis_1 / d`.
fn negative_log_likelihood(
    traces: &[Trace],
    field_len: usize,
    spec: &EstimatorSpec,
    hyper: Hyper,
) -> Result<f64, PipelineError> {
    let mut estimator = spec.build(Belief::uniform(field_len, 0.0, hyper.prior_sd)?)?;
    let (mut nis, mut log_det, mut dof, mut samples) = (0.0, 0.0, 0usize, 0usize);
    for trace in traces {
        crate::estimate_online(&mut *estimator, trace, hyper, |obs, report| {
            if !obs.is_empty() {
                nis += report.nis;
                log_det -= 2.0 * report.log_likelihood + report.nis + report.dof as f64 * TAU.ln();
                dof += report.dof;
                samples += 1;
            }
        })?;
    }
    let level = (nis / dof as f64).max(1e-18);
    Ok(0.5 * (dof as f64 * (level.ln() + 1.0 + TAU.ln()) + log_det) / samples as f64)
}

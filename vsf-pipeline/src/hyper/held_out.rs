use super::{Candidate, HyperChoice, PriorShape, Problem, candidates};
use crate::estimate::{batch_map, run, touched_points};
use crate::evaluate::{predict_independent, sample_errors};
use crate::trace::{MOST_FOLDS, split};
use crate::{EstimatorSpec, PipelineError, Trace};
use rayon::prelude::*;
use std::slice::from_ref;
use vsf_core::{Belief, CoreError, Observation, Prediction};
use vsf_filter::BatchFit;

/// With more touched points than this, held-out readings are predicted by the online filter.
const LEAVE_ONE_OUT_POINTS: usize = 1500;
/// Contiguous parts of a touch that are held out where touches have no points in common.
const QUARTERS: usize = 4;

/// Chooses by [`super::HyperMethod::HeldOut`] among `shapes`, of which the online filter takes the first.
pub fn choose(
    mut problem: Problem,
    first: &PriorShape,
    shapes: &[PriorShape],
) -> Result<HyperChoice, PipelineError> {
    let mut folds = problem.touches.len().min(MOST_FOLDS);
    if !folds_share_points(&problem.touches, folds, problem.rest.len()) {
        problem.touches = problem.touches.iter().flat_map(quarters).collect();
        folds = QUARTERS;
    }
    let exact = problem.rest.len() <= LEAVE_ONE_OUT_POINTS;
    let priors = candidates(if exact { shapes } else { from_ref(first) });
    let choice = Choice {
        problem,
        folds,
        exact,
    };
    choice.among(priors)
}

/// Fold `k` holds out every `folds`-th trace from the `k`-th on.
struct Choice {
    problem: Problem,
    folds: usize,
    /// Whether the constrained optimum predicts.
    exact: bool,
}

/// What the touches that are kept say of the field.
enum Posterior<'a> {
    Optimum(Box<BatchFit<'a>>),
    /// Knows no correlations.
    Online(Belief<f64>),
}

impl Choice {
    fn among(&self, priors: Vec<(PriorShape, f64)>) -> Result<HyperChoice, PipelineError> {
        let folds = self.held_out(&priors, |posterior, held, _| {
            Ok(mean_error(&posterior.mean(), held))
        })?;
        let errors = HeldOutErrors { priors, folds };
        let chosen = errors.nearest_to_rule();
        let level = self.level(chosen)?;
        Ok(HyperChoice {
            // A perfect fit would ask for zero noise.
            hyper: self.problem.hyper(chosen, level.sqrt().max(1e-9)),
            candidates: errors.candidates(&self.problem),
        })
    }

    /// For every fold and every prior, `of` the posterior of what is kept, the traces that are held
    /// out, and the points that the others touch.
    fn held_out<T: Send>(
        &self,
        priors: &[(PriorShape, f64)],
        of: impl Fn(&Posterior<'_>, &[&Trace], &[bool]) -> Result<T, PipelineError> + Sync,
    ) -> Result<Vec<Vec<T>>, PipelineError> {
        let fold = |fold: usize| {
            let (kept, held) = split(&self.problem.touches, fold, self.folds);
            let kept: Vec<Trace> = kept.into_iter().cloned().collect();
            let field_len = self.problem.rest.len();
            let known = touched_points(&kept, field_len);
            let batch = (self.exact)
                .then(|| batch_map(&kept, field_len))
                .transpose()?;
            let of_prior = |candidate: &(PriorShape, f64)| {
                let prior = self.problem.prior(candidate)?;
                let posterior = match &batch {
                    Some(batch) => Posterior::Optimum(Box::new(batch.solve(&prior, 1.0)?)),
                    None => {
                        let pass = run(&EstimatorSpec::replay(), prior, &kept, |_| {})?;
                        Posterior::Online(pass.belief)
                    }
                };
                of(&posterior, &held, &known)
            };
            priors.iter().map(of_prior).collect()
        };
        (0..self.folds).into_par_iter().map(fold).collect()
    }

    /// By how much the variances of noise and prior are too small: what held-out readings that touch a
    /// known point leave, squared, per variance predicted for it. Where none does nothing is known but
    /// the scale.
    fn level(&self, chosen: (PriorShape, f64)) -> Result<f64, PipelineError> {
        let folds = self.held_out(&[chosen], |posterior, held, known| {
            let (mut squares, mut count) = (0.0, 0usize);
            let observations = held.iter().flat_map(|t| &t.observations);
            for obs in observations.filter(|o| o.points().iter().any(|&p| known[p as usize])) {
                let Prediction { mean, sd } = posterior.predict(obs, &self.problem.channels)?;
                let left = obs.reading().iter().zip(&mean).zip(&sd);
                squares += left
                    .map(|((tau, mean), sd)| ((tau - mean) / sd).powi(2))
                    .sum::<f64>();
                count += obs.dim();
            }
            Ok((squares, count))
        })?;
        let all = || folds.iter().flatten();
        let count: usize = all().map(|(_, count)| count).sum();
        let squares: f64 = all().map(|(squares, _)| squares).sum();
        Ok(if count > 0 {
            squares / count as f64
        } else {
            1.0
        })
    }
}

impl Posterior<'_> {
    fn mean(&self) -> Vec<f64> {
        match self {
            Self::Optimum(fit) => fit.mean(),
            Self::Online(belief) => belief.mean().to_vec(),
        }
    }

    fn predict(&self, obs: &Observation<f64>, noise_sd: &[f64]) -> Result<Prediction, CoreError> {
        match self {
            Self::Optimum(fit) => fit.predict(obs),
            Self::Online(belief) => Ok(predict_independent(belief, noise_sd, obs)),
        }
    }
}

/// Mean norm of the errors of a field over all samples.
fn mean_error(mean: &[f64], held: &[&Trace]) -> f64 {
    let errors = held.iter().flat_map(|trace| sample_errors(mean, trace));
    let (sum, count) = errors.fold((0.0, 0usize), |(sum, n), error| (sum + error, n + 1));
    sum / count.max(1) as f64
}

/// What every prior does on every held-out part.
struct HeldOutErrors {
    /// Shapes and powers.
    priors: Vec<(PriorShape, f64)>,
    /// The mean error norm of every prior in every fold, in units of the recording.
    folds: Vec<Vec<f64>>,
}

impl HeldOutErrors {
    fn mean(&self, prior: usize) -> f64 {
        self.folds.iter().map(|f| f[prior]).sum::<f64>() / self.folds.len() as f64
    }

    /// The prior nearest to the rule among those no worse than the best by more than one standard
    /// error.
    fn nearest_to_rule(&self) -> (PriorShape, f64) {
        let error = |k: &usize| self.mean(*k);
        let all = 0..self.priors.len();
        let best = all.clone().min_by(|a, b| error(a).total_cmp(&error(b)));
        let best = best.unwrap_or(0);
        let as_good = all.filter(|&k| k == best || !self.is_worse(k, best));
        let distance = |k: &usize| self.priors[*k].1.abs();
        // Of equals the first.
        let chosen = as_good.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        self.priors[chosen.unwrap_or(best)]
    }

    /// Whether the errors of one prior exceed those of another by more than one standard error.
    fn is_worse(&self, prior: usize, other: usize) -> bool {
        let excess = |fold: &Vec<f64>| fold[prior] - fold[other];
        let n = self.folds.len() as f64;
        let mean = self.folds.iter().map(excess).sum::<f64>() / n;
        let squares = self.folds.iter().map(|f| (excess(f) - mean).powi(2));
        let variance = squares.sum::<f64>() / (n - 1.0).max(1.0);
        mean > (variance / n).sqrt()
    }

    fn candidates(&self, problem: &Problem) -> Vec<Candidate> {
        let candidate = |(k, (shape, power)): (usize, &(PriorShape, f64))| Candidate {
            shape: *shape,
            signal_to_noise: problem.signal_to_noise(*power),
            error: Some(self.mean(k)),
            log_evidence: None,
        };
        self.priors.iter().enumerate().map(candidate).collect()
    }
}

/// Contiguous parts of the samples in contact.
fn quarters(trace: &Trace) -> Vec<Trace> {
    let touches = |row: &usize| !trace.observations[*row].is_empty();
    let rows: Vec<usize> = (0..trace.observations.len()).filter(touches).collect();
    let part = |k: usize| {
        let rows = &rows[k * rows.len() / QUARTERS..(k + 1) * rows.len() / QUARTERS];
        Trace {
            id: trace.id.clone(),
            time: rows.iter().map(|&r| trace.time[r]).collect(),
            observations: rows
                .iter()
                .map(|&r| trace.observations[r].clone())
                .collect(),
            touches: std::iter::once(0..rows.len()).collect(),
        }
    };
    (0..QUARTERS).map(part).collect()
}

/// Whether the parts that are held out mostly touch points that the others touch too.
fn folds_share_points(traces: &[Trace], folds: usize, field_len: usize) -> bool {
    folds > 1
        && (0..folds).all(|fold| {
            let (kept, held) = split(traces, fold, folds);
            let known = touched_points(kept, field_len);
            let (mut shared, mut all) = (0usize, 0usize);
            for obs in held.iter().flat_map(|t| &t.observations) {
                all += obs.len();
                shared += obs.points().iter().filter(|&&p| known[p as usize]).count();
            }
            2 * shared > all
        })
}

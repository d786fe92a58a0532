use super::{Candidate, HyperChoice, PriorShape, Problem};
use crate::estimate::{batch_map, run, touched_points};
use crate::trace::{MOST_FOLDS, split};
use crate::{EstimatorSpec, PipelineError, Trace};
use rayon::prelude::*;

/// With more touched points than this, held-out readings are predicted by the online filter.
const LEAVE_ONE_OUT_POINTS: usize = 1500;
/// Contiguous parts of a touch that are held out where touches have no points in common.
const QUARTERS: usize = 4;

/// Chooses by [`super::HyperMethod::HeldOut`], among priors without the smooth part too if shapes are compared.
pub fn choose(mut problem: Problem, compare_shapes: bool) -> Result<HyperChoice, PipelineError> {
    let mut folds = problem.touches.len().min(MOST_FOLDS);
    if !folds_share_points(&problem.touches, folds, problem.rest.len()) {
        problem.touches = problem.touches.iter().flat_map(quarters).collect();
        folds = QUARTERS;
    }
    let choice = Choice {
        problem,
        folds,
        compare_shapes,
    };
    choice.run()
}

/// Fold `k` holds out every `folds`-th trace from the `k`-th on.
struct Choice {
    problem: Problem,
    folds: usize,
    compare_shapes: bool,
}

/// Errors of one held-out part of the train sequences.
struct HeldOut {
    /// Mean error norm, in units of the recording.
    error: f64,
    /// Sum of the mean squares of the whitened errors, and their number.
    squares: f64,
    count: usize,
}

impl Choice {
    fn run(&self) -> Result<HyperChoice, PipelineError> {
        let errors = self.held_out_errors()?;
        let (chosen, level) = errors.nearest_to_rule();
        Ok(HyperChoice {
            // A perfect fit would ask for zero noise.
            hyper: self.problem.hyper(chosen, level.sqrt().max(1e-9)),
            candidates: errors.candidates(&self.problem),
        })
    }

    fn held_out_errors(&self) -> Result<HeldOutErrors, PipelineError> {
        let exact = self.problem.rest.len() <= LEAVE_ONE_OUT_POINTS;
        // The online filter knows no correlations.
        let priors = self.problem.candidates(exact && self.compare_shapes);
        let folds = (0..self.folds)
            .into_par_iter()
            .map(|fold| self.held_out(fold, exact, &priors))
            .collect::<Result<_, _>>()?;
        Ok(HeldOutErrors { priors, folds })
    }

    /// Every candidate's errors on a fold, from the other folds.
    fn held_out(
        &self,
        fold: usize,
        exact: bool,
        priors: &[(PriorShape, f64)],
    ) -> Result<Vec<HeldOut>, PipelineError> {
        let (kept, held) = split(&self.problem.touches, fold, self.folds);
        let kept: Vec<Trace> = kept.into_iter().cloned().collect();
        let field_len = self.problem.rest.len();
        let known = touched_points(&kept, field_len);
        let batch = exact.then(|| batch_map(&kept, field_len)).transpose()?;
        let of_prior = |candidate: &(PriorShape, f64)| {
            let prior = self.problem.prior(candidate)?;
            let mean = match &batch {
                Some(batch) => batch.solve(&prior, 1.0)?.mean(),
                None => {
                    let pass = run(&EstimatorSpec::replay(), prior, &kept, |_| {})?;
                    pass.belief.mean().to_vec()
                }
            };
            Ok(self.errors(&mean, &held, &known))
        };
        priors.iter().map(of_prior).collect()
    }

    /// Errors over all samples; the level over those that touch a known point.
    fn errors(&self, mean: &[f64], held: &[&Trace], known: &[bool]) -> HeldOut {
        let channels = &self.problem.channels;
        let (mut error, mut samples, mut squares, mut count) = (0.0, 0usize, 0.0, 0usize);
        let mut fit = vec![0.0; channels.len()];
        for obs in held.iter().flat_map(|t| &t.observations) {
            obs.apply(mean, &mut fit);
            let residuals = fit.iter().zip(obs.reading()).map(|(f, tau)| tau - f);
            let (mut norm, mut white) = (0.0, 0.0);
            for (r, scale) in residuals.zip(channels) {
                norm += r * r;
                white += (r / scale).powi(2);
            }
            error += norm.sqrt();
            samples += 1;
            if obs.points().iter().any(|&p| known[p as usize]) {
                squares += white / channels.len() as f64;
                count += 1;
            }
        }
        HeldOut {
            error: error / samples.max(1) as f64,
            squares,
            count,
        }
    }
}

/// What every prior does on every held-out part.
struct HeldOutErrors {
    /// Shapes and powers.
    priors: Vec<(PriorShape, f64)>,
    /// One entry per prior in every fold.
    folds: Vec<Vec<HeldOut>>,
}

impl HeldOutErrors {
    fn mean(&self, prior: usize, of: impl Fn(&HeldOut) -> f64) -> f64 {
        self.folds.iter().map(|f| of(&f[prior])).sum::<f64>() / self.folds.len() as f64
    }

    /// The prior nearest to the rule among those no worse than the best by more than one standard
    /// error, and its mean square whitened error.
    fn nearest_to_rule(&self) -> ((PriorShape, f64), f64) {
        let error = |k: &usize| self.mean(*k, |h| h.error);
        let all = 0..self.priors.len();
        let best = all.clone().min_by(|a, b| error(a).total_cmp(&error(b)));
        let best = best.unwrap_or(0);
        let as_good = all.filter(|&k| k == best || !self.is_worse(k, best));
        let distance = |k: &usize| self.priors[*k].1.abs();
        // Of equals the first: the one with a smooth part.
        let chosen = as_good.min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let chosen = chosen.unwrap_or(best);
        let sum = |of: fn(&HeldOut) -> f64| self.folds.iter().map(|f| of(&f[chosen])).sum::<f64>();
        let count = sum(|h| h.count as f64);
        // Where no held-out sample touches a known point nothing is known but the scale.
        let level = if count > 0.0 {
            sum(|h| h.squares) / count
        } else {
            1.0
        };
        (self.priors[chosen], level)
    }

    /// Whether the errors of one prior exceed those of another by more than one standard error.
    fn is_worse(&self, prior: usize, other: usize) -> bool {
        let excess = |fold: &Vec<HeldOut>| fold[prior].error - fold[other].error;
        let n = self.folds.len() as f64;
        let mean = self.folds.iter().map(excess).sum::<f64>() / n;
        let squares = self.folds.iter().map(|f| (excess(f) - mean).powi(2));
        let variance = squares.sum::<f64>() / (n - 1.0).max(1.0);
        mean > (variance / n).sqrt()
    }

    fn candidates(&self, problem: &Problem) -> Vec<Candidate> {
        let candidate = |(k, (shape, power)): (usize, &(PriorShape, f64))| Candidate {
            smooth_share: shape.smooth_share,
            signal_to_noise: problem.signal_to_noise(*power),
            error: Some(self.mean(k, |h| h.error)),
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

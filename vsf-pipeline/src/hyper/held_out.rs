use super::{Candidate, ContactChoice, HyperChoice, POWERS, PriorShape, Problem};
use crate::estimate::{estimate_online, touched_points};
use crate::evaluate::{mean_error, predict_independent};
use crate::trace::{MOST_FOLDS, split};
use crate::{FilterSpec, PipelineError, Trace};
use rayon::prelude::*;
use std::slice::from_ref;
use vsf_core::{Belief, CoreError, Observation, Prediction};
use vsf_filter::{BatchFit, BatchMap, FieldPrior};

/// Number of touched points above which held-out readings are predicted by the online filter.
pub const LEAVE_ONE_OUT_POINTS: usize = 1500;
/// Contiguous parts of a touch that are held out where touches have no points in common.
const QUARTERS: usize = 4;

/// Chooses among `problems`, which are the same samples with several contact models, and for each of them
/// among `shapes` by [`super::HyperMethod::HeldOut`]. The online filter uses only the first shape. Prior
/// and noise are those of the chosen contact model, whatever it was compared with.
pub fn choose(
    mut problems: Vec<Problem>,
    first: &PriorShape,
    shapes: &[PriorShape],
) -> Result<ContactChoice, PipelineError> {
    let folds = problems[0].touches.len().min(MOST_FOLDS);
    let share = |p: &Problem| folds_share_points(&p.touches, folds, p.rest.len());
    if problems.iter().all(share) {
        return among(&problems, folds, first, shapes);
    }
    let found = among(&quartered(&problems), QUARTERS, first, shapes)?;
    if problems.len() == 1 {
        return Ok(found);
    }
    let alone = problems.swap_remove(found.contact);
    Ok(ContactChoice {
        choice: choose(vec![alone], first, shapes)?.choice,
        ..found
    })
}

/// The same with so many folds.
fn among(
    problems: &[Problem],
    folds: usize,
    first: &PriorShape,
    shapes: &[PriorShape],
) -> Result<ContactChoice, PipelineError> {
    let exact = (problems.iter()).all(|p| p.rest.len() <= LEAVE_ONE_OUT_POINTS);
    let shapes = if exact { shapes } else { from_ref(first) };
    let chosen = problems.iter().map(|problem| {
        let all = (0..folds).into_par_iter();
        let folds = all.map(|k| Fold::new(problem, k, folds, exact));
        let choice = Choice {
            problem,
            folds: folds.collect::<Result<_, _>>()?,
        };
        choice.among(shapes)
    });
    let chosen: Vec<(HyperChoice, Vec<f64>)> = chosen.collect::<Result<_, PipelineError>>()?;
    let (mut choices, of_folds): (Vec<_>, Vec<_>) = chosen.into_iter().unzip();
    let errors: Vec<f64> = of_folds.iter().map(|e| mean(e)).collect();
    let contact = as_good_as_best(&of_folds).next().unwrap_or(0);
    Ok(ContactChoice {
        contact,
        errors,
        choice: choices.swap_remove(contact),
    })
}

struct Choice<'a> {
    problem: &'a Problem,
    folds: Vec<Fold<'a>>,
}

/// Traces that are held out, and the others.
struct Fold<'a> {
    kept: Vec<&'a Trace>,
    held: Vec<&'a Trace>,
    /// The points that the others touch.
    known: Vec<bool>,
    /// Their readings, where the constrained optimum predicts.
    batch: Option<BatchMap<'a>>,
}

/// What the touches that are kept say of the field.
enum Posterior<'a> {
    Optimum(Box<BatchFit<'a>>),
    /// Knows no correlations.
    Online(Belief<f64>),
}

impl Choice<'_> {
    /// Prior and noise, and the errors of the prior on the folds.
    fn among(&self, shapes: &[PriorShape]) -> Result<(HyperChoice, Vec<f64>), PipelineError> {
        let mut tried = HeldOutErrors::default();
        for shape in shapes {
            self.outward(shape, &mut tried)?;
        }
        let chosen = tried.nearest_to_rule();
        let prior = tried.priors[chosen];
        let misfits = match tried.misfits[chosen].clone() {
            Some(misfits) => misfits,
            None => self.held_out(&prior, |fold, posterior| {
                fold.misfit(posterior, self.problem)
            })?,
        };
        let level = level(&misfits);
        CoreError::check_finite(
            "squared errors of held-out touches over their variances",
            &[level],
        )?;
        let choice = HyperChoice {
            // A perfect fit would ask for zero noise.
            hyper: (self.problem).hyper(prior, level.sqrt().max(1e-9)),
            candidates: tried.candidates(self.problem),
        };
        Ok((choice, tried.errors.swap_remove(chosen)))
    }

    /// Tries the ratios of a shape from the rule on outward, while the error falls.
    fn outward(&self, shape: &PriorShape, tried: &mut HeldOutErrors) -> Result<(), PipelineError> {
        let mut error = |power: f64| {
            let prior = (*shape, power);
            let of_folds = self.held_out(&prior, |fold, posterior| {
                // Deviations of the optimum take long, those of the online filter are at hand.
                let misfit = match posterior {
                    Posterior::Optimum(_) => None,
                    Posterior::Online(_) => Some(fold.misfit(posterior, self.problem)?),
                };
                Ok((
                    mean_error(&posterior.mean(), fold.held.iter().copied()),
                    misfit,
                ))
            })?;
            let error = tried.add(prior, of_folds);
            let what = "the error on held-out touches";
            if error.is_finite() {
                Ok(error)
            } else {
                Err(PipelineError::from(CoreError::Overflow { what }))
            }
        };
        let by_rule = error(0.0)?;
        let above: Vec<f64> = POWERS.into_iter().filter(|p| *p > 0.0).collect();
        let below: Vec<f64> = POWERS.into_iter().rev().filter(|p| *p < 0.0).collect();
        for side in [above, below] {
            let mut least = by_rule;
            for power in side {
                let next = error(power)?;
                if next >= least {
                    break;
                }
                least = next;
            }
            if least < by_rule {
                break;
            }
        }
        Ok(())
    }

    /// For every fold, `of` the fold and the posterior of what is kept.
    fn held_out<T: Send>(
        &self,
        candidate: &(PriorShape, f64),
        of: impl Fn(&Fold<'_>, &Posterior<'_>) -> Result<T, PipelineError> + Sync,
    ) -> Result<Vec<T>, PipelineError> {
        let prior = self.problem.prior(candidate)?;
        let of_fold = |fold: &Fold<'_>| of(fold, &fold.posterior(&prior)?);
        self.folds.par_iter().map(of_fold).collect()
    }
}

impl<'a> Fold<'a> {
    /// Holds out every `folds`-th trace from the `fold`-th on.
    fn new(
        problem: &'a Problem,
        fold: usize,
        folds: usize,
        exact: bool,
    ) -> Result<Self, PipelineError> {
        let (kept, held) = split(&problem.touches, fold, folds);
        let points = problem.rest.len();
        let readings = kept.iter().map(|t| t.observations.as_slice());
        let batch = exact.then(|| BatchMap::new(points, readings)).transpose()?;
        Ok(Self {
            known: touched_points(kept.iter().copied(), points),
            kept,
            held,
            batch,
        })
    }

    fn posterior(&self, prior: &FieldPrior) -> Result<Posterior<'_>, PipelineError> {
        if let Some(batch) = &self.batch {
            return Ok(Posterior::Optimum(Box::new(batch.solve(prior, 1.0)?)));
        }
        let mut filter = FilterSpec::replay().build::<f64>(prior.clone(), None)?;
        for trace in &self.kept {
            estimate_online(&mut *filter, trace, None, |_, _| {})?;
        }
        Ok(Posterior::Online(filter.belief().clone()))
    }

    fn misfit(
        &self,
        posterior: &Posterior<'_>,
        problem: &Problem,
    ) -> Result<Misfit, PipelineError> {
        let (mut squares, mut count) = (0.0, 0);
        let known = |o: &&Observation<f64>| o.points().iter().any(|&p| self.known[p as usize]);
        for obs in self.held.iter().flat_map(|t| &t.observations).filter(known) {
            let Prediction { mean, sd } = posterior.predict(obs, &problem.channels)?;
            let left = obs.reading().iter().zip(&mean).zip(&sd);
            squares += left
                .map(|((tau, mean), sd)| ((tau - mean) / sd).powi(2))
                .sum::<f64>();
            count += obs.dim();
        }
        Ok(Misfit { squares, count })
    }
}

/// What held-out readings that touch a known point leave, squared, in units of the variances predicted for them; and
/// how many they are.
#[derive(Clone, Copy)]
struct Misfit {
    squares: f64,
    count: usize,
}

/// By how much the variances of noise and prior are too small. Where nothing that is held out touches a known point,
/// nothing is known but the scale.
fn level(misfits: &[Misfit]) -> f64 {
    let count: usize = misfits.iter().map(|m| m.count).sum();
    let squares: f64 = misfits.iter().map(|m| m.squares).sum();
    if count > 0 {
        squares / count as f64
    } else {
        1.0
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
            Self::Online(belief) => predict_independent(belief, noise_sd, obs),
        }
    }
}

/// What every prior that was tried does on every held-out part.
#[derive(Default)]
struct HeldOutErrors {
    /// Shapes and powers.
    priors: Vec<(PriorShape, f64)>,
    /// The mean error norms of every prior, one per fold, in units of the recording.
    errors: Vec<Vec<f64>>,
    /// What they leave on every fold, of priors for which it was at hand.
    misfits: Vec<Option<Vec<Misfit>>>,
}

impl HeldOutErrors {
    /// Adds a prior, and returns its mean error over the folds.
    fn add(&mut self, prior: (PriorShape, f64), of_folds: Vec<(f64, Option<Misfit>)>) -> f64 {
        let (errors, misfits): (Vec<f64>, Vec<_>) = of_folds.into_iter().unzip();
        self.priors.push(prior);
        self.errors.push(errors);
        self.misfits.push(misfits.into_iter().collect());
        self.mean(self.priors.len() - 1)
    }

    fn mean(&self, prior: usize) -> f64 {
        mean(&self.errors[prior])
    }

    /// Index of the prior nearest to the rule among those as good as the best.
    fn nearest_to_rule(&self) -> usize {
        let error = |k: &usize| self.mean(*k);
        let distance = |k: &usize| self.priors[*k].1.abs();
        let shape = |k: &usize| self.priors.iter().position(|p| p.0 == self.priors[*k].0);
        // Of equals the first shape, of its ratios the better.
        let chosen = as_good_as_best(&self.errors).min_by(|a, b| {
            (distance(a).total_cmp(&distance(b)))
                .then(shape(a).cmp(&shape(b)))
                .then(error(a).total_cmp(&error(b)))
        });
        chosen.unwrap_or(0)
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

/// Those of some models, in order, whose errors on the folds are no worse than those of the best model by more than one
/// standard error.
fn as_good_as_best(of_folds: &[Vec<f64>]) -> impl Iterator<Item = usize> {
    let all = 0..of_folds.len();
    let best = (all.clone()).min_by(|a, b| mean(&of_folds[*a]).total_cmp(&mean(&of_folds[*b])));
    let best = best.unwrap_or(0);
    all.filter(move |&k| k == best || !is_worse(&of_folds[k], &of_folds[best]))
}

/// Whether the errors of one model exceed those of another by more than one standard error.
fn is_worse(errors: &[f64], others: &[f64]) -> bool {
    let pairs = errors.iter().zip(others);
    let excess: Vec<f64> = pairs.map(|(error, other)| error - other).collect();
    let n = excess.len() as f64;
    let mean = mean(&excess);
    let squares = excess.iter().map(|e| (e - mean).powi(2));
    let variance = squares.sum::<f64>() / (n - 1.0).max(1.0);
    mean > (variance / n).sqrt()
}

fn mean(errors: &[f64]) -> f64 {
    errors.iter().sum::<f64>() / errors.len() as f64
}

/// The problems with every touch cut into contiguous parts of the samples that are in contact in any of them.
fn quartered(problems: &[Problem]) -> Vec<Problem> {
    let touches = 0..problems[0].touches.len();
    let rows: Vec<Vec<usize>> = touches
        .map(|touch| {
            let all = || problems.iter().map(|p| &p.touches[touch].observations);
            let touches = |row: &usize| all().any(|o| !o[*row].is_empty());
            let rows = all().next().map_or(0, Vec::len);
            (0..rows).filter(touches).collect()
        })
        .collect();
    let quartered = |problem: &Problem| {
        let touches = problem.touches.iter().zip(&rows);
        problem.with_touches(touches.flat_map(|(t, rows)| quarters(t, rows)).collect())
    };
    problems.iter().map(quartered).collect()
}

fn quarters(trace: &Trace, rows: &[usize]) -> Vec<Trace> {
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

use crate::estimate::{batch_map, run, touched_points};
use crate::{EstimatorSpec, PipelineError, Trace};
use rayon::prelude::*;
use serde::Serialize;
use std::ops::Range;
use vsf_core::{Belief, CoreError, Noise, Observation, RestPoints};
use vsf_filter::{FieldPrior, Matern, Smoothness};

/// Prior and noise of an estimation. Their ratio decides how closely readings are followed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hyper {
    /// Standard deviation of the part of the stiffness that is each point's own (N/m); the mean of
    /// the prior is 0.
    pub prior_sd: f64,
    /// What neighbours share.
    pub shape: PriorShape,
    /// Standard deviation of the reading of every channel (N m or N), model error included.
    pub noise_sd: Vec<f64>,
}

/// The smooth part of the prior: neighbouring points of a real object are alike. Estimators that
/// keep no correlations see its variance only.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PriorShape {
    /// Standard deviation of the smooth part per standard deviation of a point's own part, >= 0,
    /// default 0.25; 0 makes points independent, as in the paper.
    pub smooth_share: f64,
    /// Length over which the smooth part stays alike (m), > 0, default 4 cm.
    pub length: f64,
}

impl Default for PriorShape {
    fn default() -> Self {
        Self {
            smooth_share: 0.25,
            length: 0.04,
        }
    }
}

impl PriorShape {
    /// Points independent of each other, as in the paper.
    pub fn independent() -> Self {
        Self {
            smooth_share: 0.0,
            ..Self::default()
        }
    }

    /// The prior of a field with standard deviation `sd` (N/m) of every point's own part.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn prior(&self, rest: &RestPoints, sd: f64) -> Result<FieldPrior, PipelineError> {
        let own = FieldPrior::from(Belief::<f64>::uniform(rest.len(), 0.0, sd)?);
        if self.smooth_share == 0.0 {
            return Ok(own);
        }
        let smooth = Matern {
            sd: self.smooth_share * sd,
            length: self.length,
            smoothness: Smoothness::ThreeHalves,
        };
        Ok(own.with_smooth(smooth, rest)?)
    }
}

/// One tried prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Candidate {
    /// Standard deviation of the smooth part per that of a point's own part.
    pub smooth_share: f64,
    /// Standard deviation of the signal that the prior expects in one typical reading, per
    /// standard deviation of its noise.
    pub signal_to_noise: f64,
    /// Mean error norm on held-out train sequences.
    pub error: f64,
}

/// How prior and noise were chosen.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HyperChoice {
    /// The choice.
    pub hyper: Hyper,
    /// All that was tried.
    pub candidates: Vec<Candidate>,
}

/// Signal-to-noise ratios of one reading that are tried, as powers of 2 times the rule.
const POWERS: [f64; 8] = [-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 6.0];
/// As how many independent readings those of one point count by rule. What the model leaves
/// unexplained stays alike over a whole push, so that hundreds of readings say little more than one.
const INDEPENDENT: f64 = 4.0;
/// With more touched points than this, held-out readings are predicted by the online filter.
const LEAVE_ONE_OUT_POINTS: usize = 1500;
/// Most parts that the touches are dealt to.
const MOST_FOLDS: usize = 10;
/// Contiguous parts of a touch that are held out where touches have no points in common.
const QUARTERS: usize = 4;
/// Share of the whole reading that the noise of every channel gets besides its own.
const FLOOR: f64 = 0.05;

/// Chooses prior and noise from train sequences, for any estimator.
///
/// - *Noise by channel*: most of what a field leaves unexplained is error of the model, which
///   grows with the load. The noise of a channel is in proportion to its RMS reading in contact,
///   plus 5 % of the RMS norm of the whole reading.
/// - *Ratio of prior and noise*: by rule, all readings that a typical point takes part in count as
///   four, because the error of the model stays alike over a push: with `n` of them, the signal
///   that the prior expects in a typical reading is `sqrt(4 / n)` of its noise. The touches, dealt to at most ten
///   parts in turn, are held out once (where they have no points in common, every quarter of them)
///   and predicted from the others by the constrained optimum, with
///   other ratios and without the smooth part too; with more than 1500 touched points, by the online
///   filter. Of all priors whose error lies within one standard error of the best one's,
///   the one nearest to the rule is taken (L. Breiman et al., *Classification and Regression
///   Trees*, 1984, section 3.4.3).
/// - *Level*: the RMS of what is left unexplained of what was held out.
///
/// The likelihood of the readings is not asked: it takes the error of the model as independent from
/// sample to sample, which it is not, and follows the readings too closely.
///
/// # Errors
/// No train sequence ever touches a point; failures of an estimator.
pub fn choose_hyper(
    rest: &RestPoints,
    traces: &[Trace],
    shape: PriorShape,
) -> Result<HyperChoice, PipelineError> {
    let found = channel_scales(traces).and_then(|c| Some((typical_signal(traces, &c)?, c)));
    let (typical, channels) = found.ok_or(PipelineError::NoContact {
        what: "train",
        points: rest.len(),
    })?;
    let noise = Noise::per_channel(&channels)?;
    let rule = (INDEPENDENT / readings_per_point(traces, rest.len())).sqrt();
    let (rest, mut traces) = touched_alone(rest, traces, &noise)?;
    let mut folds = traces.len().min(MOST_FOLDS);
    if !folds_share_points(&traces, folds, rest.len()) {
        traces = traces.iter().flat_map(quarters).collect();
        folds = QUARTERS;
    }
    Choice {
        folds,
        rest: &rest,
        traces: &traces,
        shape,
        channels: &channels,
        typical,
        rule,
    }
    .run()
}

/// The problem with noise of the right shape and, for now, level 1.
struct Choice<'a> {
    rest: &'a RestPoints,
    traces: &'a [Trace],
    shape: PriorShape,
    channels: &'a [f64],
    /// Median over the samples in contact of the reading's sd per unit of prior sd.
    typical: f64,
    /// Signal-to-noise ratio of a typical reading by rule.
    rule: f64,
    /// Fold `k` holds out every `folds`-th trace from the `k`-th on.
    folds: usize,
}

/// Errors of one held-out part of the train sequences.
struct HeldOut {
    /// Mean error norm, in units of the recording.
    error: f64,
    /// Mean square of the whitened error per channel.
    level: f64,
}

impl Choice<'_> {
    fn run(&self) -> Result<HyperChoice, PipelineError> {
        let errors = self.held_out_errors()?;
        let ((shape, power), level) = errors.nearest_to_rule();
        // A perfect fit would ask for zero noise.
        let level = level.sqrt().max(1e-9);
        Ok(HyperChoice {
            hyper: Hyper {
                prior_sd: self.prior_sd(power) * level,
                shape,
                noise_sd: self.channels.iter().map(|c| c * level).collect(),
            },
            candidates: errors.candidates(self.rule),
        })
    }

    fn prior_sd(&self, power: f64) -> f64 {
        self.rule * 2f64.powf(power) / self.typical
    }

    fn held_out_errors(&self) -> Result<HeldOutErrors, PipelineError> {
        let exact = self.rest.len() <= LEAVE_ONE_OUT_POINTS;
        let folds = self.folds;
        let mut shapes = vec![self.shape];
        if exact && self.shape.smooth_share > 0.0 {
            shapes.push(PriorShape::independent());
        }
        let priors: Vec<_> = shapes
            .iter()
            .flat_map(|shape| POWERS.map(|power| (*shape, power)))
            .collect();
        let folds = (0..folds)
            .into_par_iter()
            .map(|fold| self.held_out(fold, folds, exact, &priors))
            .collect::<Result<_, _>>()?;
        Ok(HeldOutErrors { priors, folds })
    }

    /// Every candidate's errors on the sequences `fold`, `fold + folds`, ..., from the others.
    fn held_out(
        &self,
        fold: usize,
        folds: usize,
        exact: bool,
        priors: &[(PriorShape, f64)],
    ) -> Result<Vec<HeldOut>, PipelineError> {
        let in_fold = |(i, _): &(usize, &Trace)| i % folds == fold;
        let pick = |wanted: bool| {
            let all = self.traces.iter().enumerate();
            all.filter(move |t| in_fold(t) == wanted)
                .map(|(_, t)| t.clone())
        };
        let (kept, held): (Vec<Trace>, Vec<Trace>) = (pick(false).collect(), pick(true).collect());
        let known = touched_points(&kept, self.rest.len());
        let batch = exact
            .then(|| batch_map(&kept, self.rest.len()))
            .transpose()?;
        let of_prior = |(shape, power): &(PriorShape, f64)| {
            let prior = shape.prior(self.rest, self.prior_sd(*power))?;
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

    /// Errors over the samples that touch a known point.
    fn errors(&self, mean: &[f64], held: &[Trace], known: &[bool]) -> HeldOut {
        let (mut error, mut squares, mut count) = (0.0, 0.0, 0usize);
        let mut fit = vec![0.0; self.channels.len()];
        for obs in held.iter().flat_map(|t| &t.observations) {
            if !obs.points().iter().any(|&p| known[p as usize]) {
                continue;
            }
            obs.apply(mean, &mut fit);
            let residuals = fit.iter().zip(obs.reading()).map(|(f, tau)| tau - f);
            let (mut norm, mut white) = (0.0, 0.0);
            for (r, scale) in residuals.zip(self.channels) {
                norm += r * r;
                white += (r / scale).powi(2);
            }
            error += norm.sqrt();
            squares += white / self.channels.len() as f64;
            count += 1;
        }
        HeldOut {
            error: error / count.max(1) as f64,
            level: squares / count.max(1) as f64,
        }
    }
}

/// The same problem without the points that are never touched, with another noise and a trace per
/// touch.
fn touched_alone(
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
            touches: vec![0..touch.len()],
        })
    };
    let touches = traces
        .iter()
        .flat_map(|trace| trace.touches.iter().map(move |touch| (trace, touch)))
        .map(of_touch)
        .collect::<Result<_, PipelineError>>()?;
    Ok((RestPoints::new(positions)?, touches))
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
        (self.priors[chosen], self.mean(chosen, |h| h.level))
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

    fn candidates(&self, rule: f64) -> Vec<Candidate> {
        let candidate = |(k, (shape, power)): (usize, &(PriorShape, f64))| Candidate {
            smooth_share: shape.smooth_share,
            signal_to_noise: rule * 2f64.powf(*power),
            error: self.mean(k, |h| h.error),
        };
        self.priors.iter().enumerate().map(candidate).collect()
    }
}

/// Noise of every channel up to its level; `None` without contact.
fn channel_scales(traces: &[Trace]) -> Option<Vec<f64>> {
    let in_contact = || {
        traces
            .iter()
            .flat_map(|t| &t.observations)
            .filter(|o| !o.is_empty())
    };
    let count = in_contact().count() as f64;
    let dim = in_contact().next()?.dim();
    let rms = (0..dim).map(|c| {
        let squares: f64 = in_contact().map(|o| o.reading()[c] * o.reading()[c]).sum();
        (squares / count).sqrt()
    });
    let rms: Vec<f64> = rms.collect();
    let norm = rms.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Readings of zero say nothing about their noise.
    let floor = if norm > 0.0 { FLOOR * norm } else { 1.0 };
    Some(rms.iter().map(|x| x + floor).collect())
}

/// Median over the samples in contact of `sqrt(tr(R^-1 W W^T) / d)`.
fn typical_signal(traces: &[Trace], channels: &[f64]) -> Option<f64> {
    let norm = |o: &Observation<f64>| {
        let white = |c: usize| {
            o.row(c)
                .iter()
                .map(|w| (w / channels[c]).powi(2))
                .sum::<f64>()
        };
        ((0..o.dim()).map(white).sum::<f64>() / o.dim() as f64).sqrt()
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

/// Median over the touched points of the number of readings that a point takes part in.
fn readings_per_point(traces: &[Trace], field_len: usize) -> f64 {
    let mut counts = vec![0usize; field_len];
    for obs in traces.iter().flat_map(|t| &t.observations) {
        obs.points().iter().for_each(|&p| counts[p as usize] += 1);
    }
    counts.retain(|&n| n > 0);
    let middle = counts.len() / 2;
    if counts.is_empty() {
        1.0
    } else {
        *counts.select_nth_unstable(middle).1 as f64
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
            touches: vec![0..rows.len()],
        }
    };
    (0..QUARTERS).map(part).collect()
}

/// Whether the parts that are held out mostly touch points that the others touch too.
fn folds_share_points(traces: &[Trace], folds: usize, field_len: usize) -> bool {
    folds > 1
        && (0..folds).all(|fold| {
            let (held, kept): (Vec<_>, Vec<_>) = (0..traces.len()).partition(|i| i % folds == fold);
            let kept: Vec<&Trace> = kept.into_iter().map(|i| &traces[i]).collect();
            let known = touched_points(kept, field_len);
            let (mut shared, mut all) = (0usize, 0usize);
            for obs in held.iter().flat_map(|&i| &traces[i].observations) {
                all += obs.len();
                shared += obs.points().iter().filter(|&&p| known[p as usize]).count();
            }
            2 * shared > all
        })
}

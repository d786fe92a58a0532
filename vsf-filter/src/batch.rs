mod dense;
mod equations;
mod fit;
mod held_out;
mod pivoting;
mod points;
mod precision;
mod quadratic;
mod rows;

pub use fit::BatchFit;
pub use held_out::HeldOut;

use crate::FieldPrior;
use crate::limit::{FACTORIZED, check_entries};
use equations::{NONE, Whitener, gram, panel, project};
use faer::Mat;
use points::ByPoints;
use precision::{Inverse, Precision};
use quadratic::Quadratic;
use rows::ByRows;
use std::borrow::Cow;
use std::f64::consts::TAU;
use std::ops::Range;
use vsf_core::{CoreError, Noise, Observation, RestPoints};

/// The problem is solved by rows when there are this many times more touched points.
const POINTS_PER_ROW: usize = 3;

/// Offline estimator: the exact non-negative maximum a posteriori (MAP) field, given all observations.
///
/// It solves
///
/// `argmin_{K >= 0} sum_t |tau_t - W_t K|²_{(s² R_t)^-1} + |K - m|²_{C^-1}`
///
/// for any [`FieldPrior`] `N(m, C)` and any noise scale `s`. Building a `BatchMap` turns the observations
/// into normal equations once. It uses the noise `R_t` of each observation ([`BatchMap::new`]) or one noise
/// for all ([`BatchMap::with_noise`]). Any number of priors and scales can then be solved from there.
///
/// # Cost
/// Let `n` be the number of touched points and `m` the number of rows (the channels of all observations in
/// contact). `n` may be tens of thousands and `m` hundreds of thousands.
/// - Building takes `O(k² m)` time for `k` contacts per observation.
/// - A solution takes some ten factorizations of the points with `K > 0`.
/// - Memory is a few times `8 n²` bytes.
///
/// Where points far outnumber rows, an independent prior is solved in `O(m² n)` time and `8 m n` bytes
/// instead. Work is spread over the threads of the current rayon pool; results do not depend on their
/// number.
///
/// # Robust fits
/// Every observation carries its own noise, channel by channel. For iteratively reweighted least squares,
/// write a loop around this type: solve, widen the [`vsf_core::Noise`] of the channels with large residuals
/// ([`Observation::set_noise`]), and build again.
///
/// ```
/// use vsf_core::{Belief, Noise, Observation};
/// use vsf_filter::{BatchMap, FieldPrior};
/// let mut sequence = Vec::new();
/// for (w, force) in [([1.0, 1.0], 3.0), ([1.0, -1.0], 5.0)] {
///     let mut obs = Observation::new(Noise::uniform(1, 0.1)?);
///     obs.rebuild(2, &[0, 1], &[force], |k, column| column[0] = w[k])?;
///     sequence.push(obs);
/// }
/// let batch = BatchMap::new(2, [&sequence[..]])?;
/// // Unconstrained, the answer would be (4, -1).
/// let prior = FieldPrior::from(Belief::<f64>::uniform(2, 0.0, 100.0)?);
/// let fit = batch.solve(&prior, 1.0)?;
/// let belief = fit.belief()?;
/// assert_eq!(belief.mean()[1], 0.0);
/// assert!((belief.mean()[0] - 4.0).abs() < 1e-4 && fit.kkt_residual() < 1e-9);
/// // The same readings with twice the noise are half as sure.
/// let wide = batch.solve(&prior, 2.0)?.belief()?;
/// assert!((wide.variance()[0] / belief.variance()[0] - 4.0).abs() < 1e-4);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug)]
pub struct BatchMap<'a> {
    sequences: Vec<&'a [Observation<f64>]>,
    /// Of all observations, in place of their own.
    noise: Option<Noise>,
    /// Touched points and, for every point of the field, its place among them.
    points: Vec<u32>,
    slot: Vec<u32>,
    store: Store,
    /// The rows of each sequence in [`Store::Rows`], those of observations in contact.
    rows_of: Vec<Range<usize>>,
    /// `W^T R^-1 tau`.
    rhs: Vec<f64>,
    /// Channels of all observations.
    channels: usize,
    /// Sum of all `log det R_t`.
    log_det_noise: f64,
}

#[derive(Debug)]
enum Store {
    /// `W^T R^-1 W`.
    Gram(Mat<f64>),
    /// Whitened rows and readings.
    Rows(Mat<f64>, Vec<f64>),
}

/// `-2 log N(tau; W m, S)` with `S = W C W^T + s² R`, in parts.
struct Evidence {
    /// `log det (2 pi S)`.
    log_det: f64,
    /// `|tau - W m|²_{S^-1}`, which is twice the objective at its minimum.
    exponent: f64,
}

fn finite_evidence(log_evidence: f64) -> Result<f64, CoreError> {
    if log_evidence.is_finite() {
        Ok(log_evidence)
    } else {
        Err(CoreError::Overflow {
            what: "log evidence",
        })
    }
}

impl<'a> BatchMap<'a> {
    /// Builds the problem from the observations of all sequences, for a field of `field_len` points.
    ///
    /// [`BatchFit::leave_one_out`] leaves out one sequence at a time, as a whole. Observations without
    /// contacts carry information about the noise only.
    ///
    /// # Errors
    /// More points than [`RestPoints`] can have, an observation that reaches beyond the field, too many
    /// touched points for a dense matrix (32768 with as many rows), an overflow of the normal equations.
    pub fn new(
        field_len: usize,
        sequences: impl IntoIterator<Item = &'a [Observation<f64>]>,
    ) -> Result<Self, CoreError> {
        Self::build(field_len, sequences.into_iter().collect(), None)
    }

    /// Like [`BatchMap::new`], but with the given noise in place of the noise of every observation.
    ///
    /// # Errors
    /// As [`BatchMap::new`]. Also noise of another dimension, or noise so small that a reading overflows
    /// when it is whitened.
    pub fn with_noise(
        field_len: usize,
        sequences: impl IntoIterator<Item = &'a [Observation<f64>]>,
        noise: &Noise,
    ) -> Result<Self, CoreError> {
        let sequences: Vec<_> = sequences.into_iter().collect();
        let mut all = sequences.iter().copied().flatten();
        all.try_for_each(|obs| obs.check_noise(noise))?;
        Self::build(field_len, sequences, Some(noise.clone()))
    }

    fn build(
        field_len: usize,
        sequences: Vec<&'a [Observation<f64>]>,
        noise: Option<Noise>,
    ) -> Result<Self, CoreError> {
        RestPoints::check_count(field_len)?;
        let all = || sequences.iter().copied().flatten();
        let mut slot = vec![NONE; field_len];
        let mut whitener = Whitener::new(noise.as_ref());
        let (mut channels, mut log_det_noise) = (0, 0.0);
        for obs in all() {
            obs.check_fits(field_len)?;
            whitener.set(obs)?;
            channels += obs.dim();
            log_det_noise += whitener.log_det();
            obs.points().iter().for_each(|&p| slot[p as usize] = 0);
        }
        let mut points = Vec::new();
        for (p, slot) in slot.iter_mut().enumerate().filter(|(_, s)| **s != NONE) {
            *slot = points.len() as u32;
            points.push(p as u32);
        }
        let n = points.len();
        let mut rows_of = Vec::with_capacity(sequences.len());
        let mut rows = 0;
        for sequence in &sequences {
            let touching = sequence.iter().filter(|o| !o.is_empty());
            let own: usize = touching.map(Observation::dim).sum();
            rows_of.push(rows..rows + own);
            rows += own;
        }
        let by_rows = POINTS_PER_ROW * rows <= n;
        let each = if by_rows { rows } else { n };
        check_entries(n, each, FACTORIZED, "touched points")?;
        let store = if by_rows {
            let touching: Vec<_> = all().filter(|o| !o.is_empty()).collect();
            let w = panel(&touching, &slot, n, &mut whitener)?
                .transpose()
                .to_owned();
            let mut tau = Vec::with_capacity(rows);
            for obs in touching {
                whitener.set(obs)?;
                tau.extend_from_slice(obs.reading());
                let start = tau.len() - obs.dim();
                whitener.whiten(&mut tau[start..]);
            }
            Store::Rows(w, tau)
        } else {
            Store::Gram(gram(all(), &slot, n, &mut whitener)?)
        };
        let rhs = project(all(), &slot, n, &mut whitener, |_, _| {})?;
        Ok(Self {
            sequences,
            noise,
            points,
            slot,
            store,
            rows_of,
            rhs,
            channels,
            log_det_noise,
        })
    }

    /// The touched points, in increasing order.
    pub fn points(&self) -> &[u32] {
        &self.points
    }

    /// Finds the non-negative optimum under a prior. The noise sd of every observation is multiplied by
    /// `noise_scale` (> 0).
    ///
    /// All correlations of the prior are used. With a correlated prior the covariance of the touched points
    /// is inverted, which takes `O(n³)` time.
    ///
    /// # Errors
    /// A prior of another size than the field or that correlates more than 32768 touched points, a noise
    /// scale that is not positive and finite, normal equations that are not positive definite because of
    /// rounding, an overflow.
    pub fn solve(&self, prior: &FieldPrior, noise_scale: f64) -> Result<BatchFit<'_>, CoreError> {
        let precision = self.check(prior, noise_scale)?;
        let problem = self.problem(prior, &precision, noise_scale)?;
        let optimum = pivoting::minimize(&*problem)?;
        Ok(BatchFit::new(
            self,
            prior.clone(),
            precision,
            noise_scale,
            problem,
            optimum,
        ))
    }

    /// Log marginal likelihood (evidence) of all readings, `log N(tau; W m, W C W^T + s² R)`.
    ///
    /// Use it to compare values of the prior and of the noise. It is exact for the Gaussian model, which
    /// does not impose `K >= 0`.
    ///
    /// Costs one factorization of all touched points (two with a correlated prior).
    ///
    /// # Errors
    /// As [`BatchMap::solve`].
    ///
    /// # Reference
    /// C. E. Rasmussen, C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT Press
    /// 2006, section 5.4.1, through the matrix determinant lemma.
    pub fn log_evidence(&self, prior: &FieldPrior, noise_scale: f64) -> Result<f64, CoreError> {
        let evidence = self.evidence(prior, noise_scale)?;
        finite_evidence(-0.5 * (evidence.log_det + evidence.exponent))
    }

    /// The common scale of all standard deviations that maximizes the evidence, and the log evidence at
    /// that scale.
    ///
    /// The scale multiplies the standard deviations of `prior` and those of the noise alike, so it leaves
    /// the optimum where it is. It is computed in closed form, at the cost of [`BatchMap::log_evidence`].
    ///
    /// # Errors
    /// As [`BatchMap::solve`]. Also if there is no maximum: without readings, or if the mean of the prior
    /// predicts all readings without error.
    pub fn best_scale(
        &self,
        prior: &FieldPrior,
        noise_scale: f64,
    ) -> Result<(f64, f64), CoreError> {
        let evidence = self.evidence(prior, noise_scale)?;
        if self.channels == 0 {
            return Err(CoreError::other(
                "without readings no scale has more evidence than another",
            ));
        }
        let readings = self.channels as f64;
        let variance = evidence.exponent / readings;
        let log_det = evidence.log_det + readings * variance.ln();
        let log_evidence = finite_evidence(-0.5 * (log_det + readings))?;
        Ok((variance.sqrt(), log_evidence))
    }

    fn evidence(&self, prior: &FieldPrior, noise_scale: f64) -> Result<Evidence, CoreError> {
        let precision = self.check(prior, noise_scale)?;
        let problem = self.problem(prior, &precision, noise_scale)?;
        let factor = problem.factor((0..self.points.len()).collect())?;
        let x = problem.minimizer(&factor);
        let mut squares = 0.0;
        for s in 0..self.sequences.len() {
            squares += self.squares(s, &x, &x)?;
        }
        let offset: Vec<f64> = x
            .iter()
            .zip(self.means(prior))
            .map(|(x, m)| x - m)
            .collect();
        let pull = dense::dot(&offset, &precision.apply(&offset));
        let variance = noise_scale * noise_scale;
        let n = self.points.len() as f64;
        Ok(Evidence {
            log_det: self.channels as f64 * (TAU * variance).ln()
                + self.log_det_noise
                + precision.log_det
                + problem.log_det(&factor)
                - n * variance.ln(),
            exponent: squares / variance + pull,
        })
    }

    fn check(&self, prior: &FieldPrior, noise_scale: f64) -> Result<Precision, CoreError> {
        CoreError::check_len("prior", prior.len(), self.slot.len())?;
        let variance = noise_scale * noise_scale;
        if !(noise_scale > 0.0 && variance > 0.0 && variance.is_finite()) {
            return Err(CoreError::Parameter {
                name: "noise scale",
                value: noise_scale,
                range: "> 0 and finite, its square too",
            });
        }
        if !prior.is_independent() {
            let n = self.points.len();
            let what = "touched points under a prior that correlates them";
            check_entries(n, n, FACTORIZED, what)?;
        }
        Precision::new(prior, &self.points)
    }

    fn whitener(&self) -> Whitener<'_> {
        Whitener::new(self.noise.as_ref())
    }

    /// Prior means of the touched points.
    fn means(&self, prior: &FieldPrior) -> Vec<f64> {
        let mean = |&p: &u32| prior.mean()[p as usize];
        self.points.iter().map(mean).collect()
    }

    fn problem(
        &self,
        prior: &FieldPrior,
        precision: &Precision,
        noise_scale: f64,
    ) -> Result<Box<dyn Quadratic + '_>, CoreError> {
        let variance = noise_scale * noise_scale;
        let mean = self.means(prior);
        let mut linear = precision.apply(&mean);
        for (b, rhs) in linear.iter_mut().zip(&self.rhs) {
            *b = *b * variance + rhs;
        }
        let problem: Box<dyn Quadratic + '_> = match (&precision.inverse, &self.store) {
            (Inverse::Diagonal(inverse), store) => {
                let ridge = inverse.iter().map(|p| p * variance).collect();
                match store {
                    Store::Gram(gram) => {
                        Box::new(ByPoints::new(self, Cow::Borrowed(gram), ridge, linear))
                    }
                    Store::Rows(w, tau) => {
                        Box::new(ByRows::new(self, (w, tau), ridge, mean, linear))
                    }
                }
            }
            (Inverse::Dense(inverse), store) => {
                let mut matrix = match store {
                    Store::Gram(gram) => gram.clone(),
                    Store::Rows(w, _) => {
                        let mut gram = dense::outer(w.transpose());
                        dense::mirror(&mut gram);
                        gram
                    }
                };
                for j in 0..matrix.ncols() {
                    let from = inverse.col_as_slice(j);
                    dense::add_scaled(matrix.col_as_slice_mut(j), variance, from);
                }
                let ridge = vec![0.0; mean.len()];
                Box::new(ByPoints::new(self, Cow::Owned(matrix), ridge, linear))
            }
        };
        let well = |h: &f64| *h > 0.0 && h.is_finite();
        if problem.diagonal().iter().all(well) && problem.linear().iter().all(|b| b.is_finite()) {
            Ok(problem)
        } else {
            Err(CoreError::Overflow {
                what: "normal equations",
            })
        }
    }

    /// `r -= W x` for `x` over the touched points.
    fn subtract(&self, obs: &Observation<f64>, x: &[f64], r: &mut [f64]) {
        for (i, r) in r.iter_mut().enumerate() {
            let touched = obs.row(i).iter().zip(obs.points());
            let value = |(w, &p): (&f64, &u32)| w * x[self.slot[p as usize] as usize];
            *r -= touched.map(value).sum::<f64>();
        }
    }

    /// Whitened residuals of sequence `s`, of the observations in contact.
    fn whitened_residuals(&self, s: usize, x: &[f64]) -> Result<Vec<f64>, CoreError> {
        let mut whitener = self.whitener();
        let mut out = Vec::with_capacity(self.rows_of[s].len());
        for obs in self.sequences[s].iter().filter(|o| !o.is_empty()) {
            let mut r = obs.reading().to_vec();
            self.subtract(obs, x, &mut r);
            whitener.set(obs)?;
            whitener.whiten(&mut r);
            out.extend(r);
        }
        Ok(out)
    }

    /// `sum_t (tau_t - W_t x)^T R_t^-1 (tau_t - W_t y)` over sequence `s`.
    fn squares(&self, s: usize, x: &[f64], y: &[f64]) -> Result<f64, CoreError> {
        let mut whitener = self.whitener();
        let mut sum = 0.0;
        for obs in self.sequences[s] {
            whitener.set(obs)?;
            let [a, b] = [x, y].map(|x| {
                let mut r = obs.reading().to_vec();
                self.subtract(obs, x, &mut r);
                whitener.whiten(&mut r);
                r
            });
            sum += dense::dot(&a, &b);
        }
        Ok(sum)
    }
}

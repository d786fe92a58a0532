use super::BatchMap;
use super::dense::{add_scaled, apply, product};
use super::equations::NONE;
use super::pivoting::Optimum;
use super::precision::{Inverse, Precision};
use super::quadratic::Quadratic;
use crate::FieldPrior;
use crate::truncated::second_moment;
use faer::Mat;
use vsf_core::{Belief, CoreError, Observation, Prediction};

/// Points whose covariances are worked out at once.
const BLOCK: usize = 256;

/// A solution of [`BatchMap`]: the non-negative optimum and the Gaussian around it.
///
/// The posterior is the Gaussian that has the optimum as its mean. It covers the points with `K > 0`,
/// correlations included; points that the optimum holds at zero count as known to be zero. Points that no
/// observation touched keep their prior if it is independent. Under a correlated prior they follow from the
/// touched points by the conditional Gaussian.
#[derive(Debug)]
pub struct BatchFit<'a> {
    pub(super) batch: &'a BatchMap<'a>,
    prior: FieldPrior,
    precision: Precision,
    pub(super) noise_scale: f64,
    pub(super) problem: Box<dyn Quadratic + 'a>,
    pub(super) optimum: Optimum,
}

/// Some sums of stiffnesses, `a^T K`: their means, weights over touched points and covariance
/// given those.
struct Sums {
    mean: Vec<f64>,
    slots: Vec<usize>,
    weights: Mat<f64>,
    covariance: Mat<f64>,
}

impl<'a> BatchFit<'a> {
    pub(super) fn new(
        batch: &'a BatchMap<'a>,
        prior: FieldPrior,
        precision: Precision,
        noise_scale: f64,
        problem: Box<dyn Quadratic + 'a>,
        optimum: Optimum,
    ) -> Self {
        Self {
            batch,
            prior,
            precision,
            noise_scale,
            problem,
            optimum,
        }
    }

    /// Largest violation of the optimality conditions, relative to the largest term: only rounding remains.
    ///
    /// The conditions are `K >= 0`, gradient zero where `K > 0`, and gradient not negative where `K = 0`.
    /// The result does not depend on the units of single points.
    pub fn kkt_residual(&self) -> f64 {
        self.optimum.kkt_residual
    }

    /// Number of factorizations that the solution took.
    pub fn factorizations(&self) -> usize {
        self.optimum.factorizations
    }

    /// The touched points that the optimum leaves free (`K > 0`), in increasing order.
    pub fn free_points(&self) -> impl Iterator<Item = u32> + '_ {
        let free = self.optimum.factor.free.iter();
        free.map(|&i| self.batch.points[i])
    }

    /// Means of all points (N/m), >= 0.
    ///
    /// Touched points have the optimum. Points never touched have the mean of the prior given the optimum,
    /// clamped at 0. Under a correlated prior each of these costs `O(n)`.
    pub fn mean(&self) -> Vec<f64> {
        let mut mean = self.prior.mean().to_vec();
        if let Some(pull) = self.pull() {
            for (u, mean) in mean.iter_mut().enumerate() {
                if self.batch.slot[u] == NONE {
                    *mean = (*mean + self.cross(u, &pull)).max(0.0);
                }
            }
        }
        for (&p, &x) in self.batch.points.iter().zip(&self.optimum.x) {
            mean[p as usize] = x;
        }
        mean
    }

    /// Belief about every point: [`BatchFit::marginals`] of all points.
    ///
    /// # Errors
    /// As [`BatchFit::marginals`].
    pub fn belief(&self) -> Result<Belief<f64>, CoreError> {
        let all: Vec<u32> = (0..self.prior.len() as u32).collect();
        self.marginals(&all)
    }

    /// Mean and variance of the given points, in their order.
    ///
    /// - `K > 0`: the marginals of the Gaussian posterior.
    /// - Held at zero: mean 0. The variance is the second moment about zero of the point's Gaussian if this
    ///   point alone were freed. Its mean is below zero; only the part above zero counts.
    /// - Never touched: the prior, conditional on the touched points if correlated, its mean clamped at 0.
    ///   Where a part of the prior is smooth in space, this costs `O(n²)` time per point for `n` touched
    ///   points. If there are many, select points, or use [`BatchFit::mean`].
    ///
    /// # Errors
    /// A point beyond the field, or a variance that is not representable.
    pub fn marginals(&self, points: &[u32]) -> Result<Belief<f64>, CoreError> {
        let len = self.prior.len();
        if let Some(&p) = points.iter().find(|&&p| p as usize >= len) {
            return Err(CoreError::OutOfRange {
                what: "point",
                index: p as usize,
                len,
            });
        }
        let mut mean = vec![0.0; points.len()];
        let mut variance = vec![0.0; points.len()];
        let touched = self.variances();
        let mut others = Vec::new();
        for (k, &p) in points.iter().enumerate() {
            match self.batch.slot[p as usize] {
                NONE => others.push(k),
                i => (mean[k], variance[k]) = (self.optimum.x[i as usize], touched[i as usize]),
            }
        }
        self.extend(points, &others, &mut mean, &mut variance);
        Belief::new(mean, variance)
    }

    /// Variances of the touched points.
    fn variances(&self) -> Vec<f64> {
        let scale = self.noise_scale;
        let mut out = self.problem.variances(&self.optimum.factor);
        for (i, v) in out.iter_mut().enumerate() {
            let sd = v.sqrt();
            *v *= scale * scale;
            if self.optimum.factor.place[i] == NONE {
                *v *= second_moment::<200>(self.optimum.gradient[i].max(0.0) * sd / scale);
            }
        }
        out
    }

    /// Marginals of points that were never touched: `points[k]` for `k` of `others`.
    fn extend(&self, points: &[u32], others: &[usize], mean: &mut [f64], variance: &mut [f64]) {
        let own = |p: u32| self.prior.covariance(p as usize, p as usize);
        let Some(&first) = others.first() else { return };
        let mut put = |k: usize, m: f64, v: f64| (mean[k], variance[k]) = (m.max(0.0), v);
        if self.prior.is_independent() {
            for &k in others {
                put(k, self.prior.mean()[points[k] as usize], own(points[k]));
            }
        } else if self.prior.is_spatial() {
            for block in others.chunks(BLOCK) {
                let chosen: Vec<u32> = block.iter().map(|&k| points[k]).collect();
                let sums = self.sums(&chosen, &Mat::identity(chosen.len(), chosen.len()));
                let covariance = self.covariance(&sums);
                for (c, &k) in block.iter().enumerate() {
                    put(k, sums.mean[c], covariance[(c, c)]);
                }
            }
        } else {
            // A level tells the same of all points.
            let p = points[first];
            let sums = self.sums(&[p], &Mat::identity(1, 1));
            let known = own(p) - self.covariance(&sums)[(0, 0)];
            let shift = sums.mean[0] - self.prior.mean()[p as usize];
            for &k in others {
                let p = points[k];
                put(k, self.prior.mean()[p as usize] + shift, own(p) - known);
            }
        }
    }

    /// Predicts the reading of an observation, taking correlations between points into account. The reading
    /// in `obs` is ignored.
    ///
    /// The sd includes the noise of the observation, or that of [`BatchMap::with_noise`], times the noise
    /// scale. Points held at zero count as known.
    ///
    /// # Errors
    /// An observation that reaches beyond the field or has another number of channels than the noise, or
    /// predictions that are not representable.
    pub fn predict(&self, obs: &Observation<f64>) -> Result<Prediction, CoreError> {
        let (mean, covariance) = self.predict_joint(obs)?;
        let d = obs.dim();
        let sd = (0..d).map(|i| covariance[i * d + i].sqrt()).collect();
        Ok(Prediction { mean, sd })
    }

    /// Like [`BatchFit::predict`], but with the full covariance of the reading (row-major `d x d`).
    ///
    /// # Errors
    /// As [`BatchFit::predict`].
    pub fn predict_joint(&self, obs: &Observation<f64>) -> Result<(Vec<f64>, Vec<f64>), CoreError> {
        obs.check_fits(self.prior.len())?;
        let d = obs.dim();
        let rows = Mat::from_fn(obs.len(), d, |k, i| obs.row(i)[k]);
        let sums = self.sums(obs.points(), &rows);
        let covariance = self.covariance(&sums);
        let noise = self.batch.noise.as_ref().unwrap_or(obs.noise());
        CoreError::check_len("noise", noise.dim(), d)?;
        let scale = self.noise_scale * self.noise_scale;
        let entry = |(k, r): (usize, &f64)| {
            let (i, j) = (k / d, k % d);
            // What rounding leaves of nothing may lie below zero.
            match covariance[(i, j)] {
                below if i == j && below < 0.0 => scale * r,
                own => own + scale * r,
            }
        };
        let noise = noise.covariance().iter().enumerate();
        let covariance: Vec<f64> = noise.map(entry).collect();
        CoreError::check_finite("predicted reading", &sums.mean)?;
        CoreError::check_finite("covariance of the predicted reading", &covariance)?;
        Ok((sums.mean, covariance))
    }

    /// `C^-1 (x - m)`, by which a correlated prior moves points that were never touched.
    fn pull(&self) -> Option<Vec<f64>> {
        let Inverse::Dense(inverse) = &self.precision.inverse else {
            return None;
        };
        let means = self.batch.means(&self.prior);
        let offset: Vec<f64> = self
            .optimum
            .x
            .iter()
            .zip(means)
            .map(|(x, m)| x - m)
            .collect();
        Some(apply(inverse, &offset))
    }

    /// `sum_t C_ut a_t` over the touched points.
    fn cross(&self, u: usize, a: &[f64]) -> f64 {
        let touched = self.batch.points.iter().zip(a);
        touched
            .map(|(&t, a)| self.prior.covariance(u, t as usize) * a)
            .sum()
    }

    /// The sums `rows^T K` of the given points: one row per point, one column per sum.
    fn sums(&self, points: &[u32], rows: &Mat<f64>) -> Sums {
        let (n, k) = (self.batch.points.len(), rows.ncols());
        let row = |c: usize, r: &Mat<f64>| -> Vec<f64> { (0..k).map(|j| r[(c, j)]).collect() };
        let (touched, others): (Vec<usize>, Vec<usize>) =
            (0..points.len()).partition(|&c| self.batch.slot[points[c] as usize] != NONE);
        let slot = |c: usize| self.batch.slot[points[c] as usize] as usize;
        let mut mean = vec![0.0; k];
        for &c in &touched {
            add_scaled(&mut mean, self.optimum.x[slot(c)], &row(c, rows));
        }
        for &c in &others {
            let prior = self.prior.mean()[points[c] as usize];
            add_scaled(&mut mean, prior, &row(c, rows));
        }
        // Of the points never touched, before the touched ones are known.
        let between = |a: usize, b: usize| {
            let (i, j) = (points[others[a]] as usize, points[others[b]] as usize);
            self.prior.covariance(i, j)
        };
        let rest = Mat::from_fn(others.len(), k, |c, j| rows[(others[c], j)]);
        let Inverse::Dense(inverse) = &self.precision.inverse else {
            let scaled = Mat::from_fn(others.len(), k, |c, j| between(c, c) * rest[(c, j)]);
            return Sums {
                mean,
                slots: touched.iter().map(|&c| slot(c)).collect(),
                weights: Mat::from_fn(touched.len(), k, |c, j| rows[(touched[c], j)]),
                covariance: product(rest.transpose(), scaled.as_ref()),
            };
        };
        let mut weights = Mat::zeros(n, k);
        let mut covariance = Mat::zeros(k, k);
        if !others.is_empty() {
            let prior = Mat::from_fn(others.len(), others.len(), between);
            covariance = product(
                rest.transpose(),
                product(prior.as_ref(), rest.as_ref()).as_ref(),
            );
            let cross = Mat::from_fn(n, others.len(), |t, c| {
                let u = points[others[c]] as usize;
                self.prior.covariance(u, self.batch.points[t] as usize)
            });
            let cross = product(cross.as_ref(), rest.as_ref());
            weights = product(inverse.as_ref(), cross.as_ref());
            covariance -= product(cross.transpose(), weights.as_ref());
            let means = self.batch.means(&self.prior);
            for (j, mean) in mean.iter_mut().enumerate() {
                let offset = self.optimum.x.iter().zip(&means).map(|(x, m)| x - m);
                let pulled = offset.zip(weights.col_as_slice(j)).map(|(o, w)| o * w);
                *mean += pulled.sum::<f64>();
            }
        }
        for &c in &touched {
            for j in 0..k {
                weights[(slot(c), j)] += rows[(c, j)];
            }
        }
        Sums {
            mean,
            slots: (0..n).collect(),
            weights,
            covariance,
        }
    }

    /// Posterior covariance of sums.
    fn covariance(&self, sums: &Sums) -> Mat<f64> {
        let factor = &self.optimum.factor;
        let mut out = self.problem.spread(factor, &sums.slots, &sums.weights);
        let scale = self.noise_scale * self.noise_scale;
        for j in 0..out.ncols() {
            let given = sums.covariance.col_as_slice(j);
            for (v, given) in out.col_as_slice_mut(j).iter_mut().zip(given) {
                *v = *v * scale + given;
            }
        }
        out
    }
}

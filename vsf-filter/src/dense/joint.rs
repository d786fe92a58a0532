use super::touched::Touched;
use crate::prior::FieldPrior;
use faer::{Mat, MatRef};
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, Scalar};

/// Points extrapolated at once.
const CHUNK: usize = 8;

/// An estimator that keeps the joint Gaussian of the touched points and can extend it to all others by its
/// prior. Dyn-compatible; boxes of it can be cloned.
pub trait JointEstimator: Estimator {
    /// Forgets everything and starts again from any prior. ([`Estimator::reset`] takes marginals only.)
    ///
    /// # Errors
    /// Variances beyond the range of the number type; the estimator is then unchanged.
    fn restart(&mut self, prior: FieldPrior) -> Result<(), CoreError>;

    /// The touched (or included) points, in the order in which they were first touched or included.
    fn points(&self) -> &[u32];

    /// Posterior covariance (N²/m²) of points `i` and `j`, before projection; `None` if one of
    /// them was neither touched nor included.
    fn covariance(&self, i: usize, j: usize) -> Option<Self::Scalar>;

    /// Includes points as if they had been touched. From now on [`Estimator::belief`] follows them, and
    /// their first touch costs no more than any other. The posterior does not change.
    ///
    /// # Errors
    /// A point beyond the field, or a prior covariance that is not positive definite. Some points may then
    /// be included, which does no harm.
    fn include(&mut self, points: &[u32]) -> Result<(), CoreError>;

    /// Posterior marginals of any points, touched or not, in the order given; negative means are shown as
    /// zero.
    ///
    /// Costs `O(n²)` for every point that was never touched, with `n` touched points.
    ///
    /// # Errors
    /// A point beyond the field, or a variance that rounding left without a positive value.
    fn extrapolate(&self, points: &[u32]) -> Result<Belief<Self::Scalar>, CoreError>;
}

dyn_clone::clone_trait_object!(<T: Scalar> JointEstimator<Scalar = T>);

impl<T: Scalar> std::fmt::Debug for dyn JointEstimator<Scalar = T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("JointEstimator")
            .field("scalar", &T::NAME)
            .field("touched", &self.points().len())
            .finish_non_exhaustive()
    }
}

impl<E: JointEstimator + ?Sized> JointEstimator for Box<E>
where
    Self: Clone,
{
    fn restart(&mut self, prior: FieldPrior) -> Result<(), CoreError> {
        (**self).restart(prior)
    }

    fn points(&self) -> &[u32] {
        (**self).points()
    }

    fn covariance(&self, i: usize, j: usize) -> Option<E::Scalar> {
        (**self).covariance(i, j)
    }

    fn include(&mut self, points: &[u32]) -> Result<(), CoreError> {
        (**self).include(points)
    }

    fn extrapolate(&self, points: &[u32]) -> Result<Belief<E::Scalar>, CoreError> {
        (**self).extrapolate(points)
    }
}

/// A joint Gaussian of the touched points, by slots, and what follows from it for all points.
pub(super) trait Joint<T: Scalar> {
    fn touched(&self) -> &Touched;

    /// Mean and marginal variance.
    fn marginal(&self, slot: usize) -> (T, T);

    /// Covariance of two slots.
    fn slot_covariance(&self, i: usize, j: usize) -> T;

    /// Covariance of two points.
    fn covariance_of(&self, i: usize, j: usize) -> Option<T> {
        let slot = |p| self.touched().slot(u32::try_from(p).ok()?);
        Some(self.slot_covariance(slot(i)?, slot(j)?))
    }

    /// Variances of the sums `w^T K` of the touched points, one per column of `w`.
    fn spread(&self, w: &Mat<f64>) -> Vec<f64>;

    /// Means and variances of the sums `weights^T K` of given points, touched or not.
    fn moments(&self, points: &[u32], weights: MatRef<'_, f64>) -> (Vec<f64>, Vec<f64>) {
        let (touched, d) = (self.touched(), weights.ncols());
        let prior_mean = touched.prior().mean();
        let mut w = Mat::<f64>::zeros(touched.len(), d);
        let mut unseen = Vec::new();
        let mut rows = Vec::new();
        for (k, &p) in points.iter().enumerate() {
            match touched.slot(p) {
                Some(slot) => (0..d).for_each(|i| w[(slot, i)] = weights[(k, i)]),
                None => {
                    unseen.push(p);
                    rows.push(k);
                }
            }
        }
        let (mut mean, mut variance) = (vec![0.0; d], vec![0.0; d]);
        if !unseen.is_empty() {
            let rest = Mat::from_fn(rows.len(), d, |k, i| weights[(rows[k], i)]);
            let (onto, left) = touched.project(&unseen, rest.as_ref());
            variance = left;
            for (i, mean) in mean.iter_mut().enumerate() {
                let unseen = unseen.iter().enumerate();
                *mean = unseen
                    .map(|(k, &p)| rest[(k, i)] * prior_mean[p as usize])
                    .sum();
                for (slot, &p) in touched.points().iter().enumerate() {
                    *mean -= onto[(slot, i)] * prior_mean[p as usize];
                    w[(slot, i)] += onto[(slot, i)];
                }
            }
        }
        for (i, mean) in mean.iter_mut().enumerate() {
            let known = (0..touched.len()).map(|s| w[(s, i)] * self.marginal(s).0.to_f64());
            *mean += known.sum::<f64>();
        }
        for (variance, spread) in variance.iter_mut().zip(self.spread(&w)) {
            *variance += spread;
        }
        (mean, variance)
    }

    /// [`vsf_core::Estimator::predict`] with all correlations.
    fn predict_jointly(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        obs.check_fits(self.touched().prior().len())?;
        let weights = Mat::from_fn(obs.len(), obs.dim(), |k, i| obs.row(i)[k].to_f64());
        let (mean, variance) = self.moments(obs.points(), weights.as_ref());
        out.mean = mean;
        let channels = variance.iter().enumerate();
        out.sd = channels
            .map(|(i, v)| (v.max(0.0) + obs.noise().sd(i).powi(2)).sqrt())
            .collect();
        out.check_finite()
    }

    /// [`vsf_core::Estimator::field`] of what is shown and of the means by slot: `O(n)` a point that was never touched, after
    /// `O(n²)`.
    fn whole(&self, shown: &Belief<T>, mean: impl Fn(usize) -> T) -> Result<Belief<T>, CoreError> {
        let touched = self.touched();
        let prior = touched.prior().mean();
        let offsets = touched.points().iter().enumerate();
        let offsets: Vec<f64> = offsets
            .map(|(slot, &p)| mean(slot).to_f64() - prior[p as usize])
            .collect();
        let mut all = shown.mean().to_vec();
        for (p, shift) in touched.shifts(&offsets) {
            // Not `max`, which takes 0 for NaN; `Belief::new` refuses that.
            let free = prior[p] + shift;
            all[p] = T::from_f64(if free < 0.0 { 0.0 } else { free });
        }
        Belief::new(all, shown.variance().to_vec())
    }

    /// Marginals of given points, in their order.
    fn marginals(&self, points: &[u32]) -> Result<Belief<T>, CoreError> {
        let touched = self.touched();
        let unseen = touched.unseen(points)?;
        let mut found = vec![(T::ZERO, T::ZERO); unseen.len()];
        for (chunk, found) in unseen.chunks(CHUNK).zip(found.chunks_mut(CHUNK)) {
            let weights = Mat::identity(chunk.len(), chunk.len());
            let (mean, variance) = self.moments(chunk, weights.as_ref());
            for ((found, m), v) in found.iter_mut().zip(mean).zip(variance) {
                *found = (T::from_f64(m), T::from_f64(v));
            }
        }
        let all = points.iter().map(|p| match unseen.binary_search(p) {
            Ok(k) => found[k],
            Err(_) => touched
                .slot(*p)
                .map_or((T::ZERO, T::ZERO), |s| self.marginal(s)),
        });
        let (mean, variance) = all
            .map(|(m, v)| (if m < T::ZERO { T::ZERO } else { m }, v))
            .unzip();
        Belief::new(mean, variance)
    }
}

use crate::{CoreError, Observation, Prediction, RestPoints, Scalar};

/// Independent Gaussian belief about the stiffness of every point, `K_i ~ N(mean_i, variance_i)`
/// (eq. 6), with means in N/m and variances in N²/m².
///
/// Estimators that keep correlations report their marginals in it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::state::BeliefParts<T>")
)]
pub struct Belief<T: Scalar> {
    mean: Vec<T>,
    variance: Vec<T>,
}

impl<T: Scalar> Belief<T> {
    /// Creates a belief from one mean (N/m) and one variance (N²/m²) per point.
    ///
    /// # Errors
    /// Different lengths, values that are not finite, negative means, or variances that are not
    /// positive.
    pub fn new(mean: Vec<T>, variance: Vec<T>) -> Result<Self, CoreError> {
        CoreError::check_len("belief variance", variance.len(), mean.len())?;
        for (index, (&m, &v)) in mean.iter().zip(&variance).enumerate() {
            for (what, x) in [("belief mean", m), ("belief variance", v)] {
                if !x.is_finite() {
                    return Err(CoreError::NotFinite {
                        what,
                        index,
                        value: x.to_f64(),
                    });
                }
            }
            if m < T::ZERO {
                return Err(CoreError::Parameter {
                    name: "belief mean",
                    value: m.to_f64(),
                    range: ">= 0 N/m (stiffness is never negative)",
                });
            }
            if v <= T::ZERO {
                return Err(CoreError::Parameter {
                    name: "belief variance",
                    value: v.to_f64(),
                    range: "> 0 N²/m²",
                });
            }
        }
        Ok(Self { mean, variance })
    }

    /// The same independent prior `N(mean, sd²)` for each of `n` points. The paper uses mean 0 and sd 0.1 N/m.
    ///
    /// Over many untouched points the independent deviations average out, so predictions beside touched places are
    /// overconfident. Where these matter, use a prior that correlates neighbors (`FieldPrior` of `vsf-filter`) and an
    /// estimator that keeps correlations.
    ///
    /// # Errors
    /// As [`Belief::new`], or more points than [`RestPoints`](crate::RestPoints) supports.
    pub fn uniform(n: usize, mean: f64, sd: f64) -> Result<Self, CoreError> {
        RestPoints::check_count(n)?;
        if !(sd > 0.0 && sd.is_finite()) {
            return Err(CoreError::Parameter {
                name: "prior sd",
                value: sd,
                range: "> 0 N/m",
            });
        }
        Self::new(vec![T::from_f64(mean); n], vec![T::from_f64(sd * sd); n])
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.mean.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.mean.is_empty()
    }

    /// Means (N/m).
    pub fn mean(&self) -> &[T] {
        &self.mean
    }

    /// Variances (N²/m²).
    pub fn variance(&self) -> &[T] {
        &self.variance
    }

    /// Means and variances, for an estimator to write. The writer must keep the invariants: means
    /// finite and not negative, variances finite and positive.
    pub fn parts_mut(&mut self) -> (&mut [T], &mut [T]) {
        (&mut self.mean, &mut self.variance)
    }

    /// Adds `variance` (N²/m², >= 0) to the variance of every point, in O(N).
    ///
    /// This is [`Estimator::diffuse`](crate::Estimator::diffuse) for independent points.
    ///
    /// # Errors
    /// A variance that is negative or not finite, or a sum beyond the range of `T`. The belief is
    /// then unchanged.
    pub fn diffuse(&mut self, variance: T) -> Result<(), CoreError> {
        if !(variance >= T::ZERO && variance.is_finite()) {
            return Err(CoreError::Parameter {
                name: "variance of the random step",
                value: variance.to_f64(),
                range: ">= 0 N²/m²",
            });
        }
        // No early exit, which would keep the loop from vectorizing.
        let sums = self.variance.iter().map(|&v| v + variance);
        if !sums.fold(true, |ok, v| ok & v.is_finite()) {
            return Err(CoreError::Overflow {
                what: "variance of a point",
            });
        }
        for v in &mut self.variance {
            *v += variance;
        }
        Ok(())
    }

    /// Predicts the reading of `obs`, whose own reading and noise are ignored, and writes it to `out`.
    ///
    /// `noise_sd(i)` is the standard deviation (N m or N, >= 0) of the noise of channel `i`.
    ///
    /// # Errors
    /// An observation that refers to points beyond the field, or a prediction that overflows.
    pub fn predict(
        &self,
        obs: &Observation<T>,
        noise_sd: impl Fn(usize) -> f64,
        out: &mut Prediction,
    ) -> Result<(), CoreError> {
        obs.check_fits(self.len())?;
        out.mean.resize(obs.dim(), 0.0);
        out.sd.resize(obs.dim(), 0.0);
        for i in 0..obs.dim() {
            let (mut mean, mut variance) = (0.0, 0.0);
            for (&w, &p) in obs.row(i).iter().zip(obs.points()) {
                let w = w.to_f64();
                mean += w * self.mean[p as usize].to_f64();
                variance += w * w * self.variance[p as usize].to_f64();
            }
            out.mean[i] = mean;
            out.sd[i] = (variance + noise_sd(i).powi(2)).sqrt();
        }
        out.check_finite()
    }

    /// Converts the belief to another number type.
    ///
    /// # Errors
    /// A value that overflows, or a variance that underflows, in the target type.
    pub fn cast<U: Scalar>(&self) -> Result<Belief<U>, CoreError> {
        let cast = |v: &[T]| v.iter().map(|x| U::from_f64(x.to_f64())).collect();
        Belief::new(cast(&self.mean), cast(&self.variance))
    }
}

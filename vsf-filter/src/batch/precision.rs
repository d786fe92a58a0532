use super::dense::{Cholesky, apply};
use crate::FieldPrior;
use faer::Mat;
use vsf_core::CoreError;

/// The prior of the touched points by the inverse of its covariance.
#[derive(Debug)]
pub(super) struct Precision {
    pub(super) inverse: Inverse,
    /// `log det` of the covariance.
    pub(super) log_det: f64,
}

#[derive(Debug)]
pub(super) enum Inverse {
    /// Of independent points: one over their variances.
    Diagonal(Vec<f64>),
    Dense(Mat<f64>),
}

impl Precision {
    pub(super) fn new(prior: &FieldPrior, points: &[u32]) -> Result<Self, CoreError> {
        let covariance =
            |i: usize, j: usize| prior.covariance(points[i] as usize, points[j] as usize);
        let n = points.len();
        if prior.is_independent() {
            let variance = (0..n).map(|i| covariance(i, i));
            return Ok(Self {
                log_det: variance.clone().map(f64::ln).sum(),
                inverse: Inverse::Diagonal(variance.map(|v| 1.0 / v).collect()),
            });
        }
        if !prior.is_spatial() {
            return Ok(Self::shared_level(prior, points));
        }
        let lower = |i: usize, j: usize| if i >= j { covariance(i, j) } else { 0.0 };
        let factor = Cholesky::new("prior covariance", Mat::from_fn(n, n, lower))?;
        Ok(Self {
            log_det: factor.log_det(),
            inverse: Inverse::Dense(factor.inverse()),
        })
    }

    /// `(D + v 1 1^T)^-1 = D^-1 - D^-1 1 1^T D^-1 / (1/v + 1^T D^-1 1)` (Sherman and Morrison).
    fn shared_level(prior: &FieldPrior, points: &[u32]) -> Self {
        let local = points.iter().map(|&p| prior.local_variance(p as usize));
        let weight: Vec<f64> = local.clone().map(|v| 1.0 / v).collect();
        let (sum, level) = (weight.iter().sum::<f64>(), prior.level_variance());
        let shared = level / (1.0 + level * sum);
        let n = points.len();
        let mut inverse = Mat::from_fn(n, n, |i, j| -shared * weight[i] * weight[j]);
        (0..n).for_each(|i| inverse[(i, i)] += weight[i]);
        Self {
            log_det: local.map(f64::ln).sum::<f64>() + (level * sum).ln_1p(),
            inverse: Inverse::Dense(inverse),
        }
    }

    /// `C^-1 x`.
    pub(super) fn apply(&self, x: &[f64]) -> Vec<f64> {
        match &self.inverse {
            Inverse::Diagonal(d) => d.iter().zip(x).map(|(d, x)| d * x).collect(),
            Inverse::Dense(a) => apply(a, x),
        }
    }
}

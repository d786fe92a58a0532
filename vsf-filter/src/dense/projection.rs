use super::innovation::{Innovation, norm, residual};
use super::mode::Mode;
use crate::prior::FieldPrior;
use vsf_core::{Belief, CoreError, Observation, Scalar, UpdateReport};

/// How a dense filter handles negative means, which no stiffness can have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Projection {
    /// The mean is the mode of the posterior within `K >= 0`: the constrained optimum of all readings so
    /// far. The default of [`crate::CovarianceFilter`], which alone supports it.
    ///
    /// Where one point is held at zero, the points correlated with it move along, so that what the readings
    /// said of their sum still holds. The filter itself continues from the Gaussian posterior, which stays
    /// exact and does not depend on the order of observations.
    #[default]
    Constrained,
    /// The belief shows `max(mean, 0)`, point by point; the filter continues from the Gaussian posterior.
    ///
    /// Where points are strongly correlated, `W` times the clamped means no longer matches the readings. On
    /// held-out pushes into a plant it errs by 1.39 N m, [`Projection::Constrained`] by 1.22 and
    /// [`Projection::FedBack`] by 2.22 (same prior and noise).
    OutputOnly,
    /// The next update starts from the projected mean (eq. 5, last line).
    ///
    /// With little data it may come closer to the truth (distance 0.61 instead of 0.64 of the field's norm
    /// after 60 readings of 200 points). But it shifts combinations of points that are known well, without
    /// the covariance reflecting it, and the filter can diverge: 17.6 instead of 0.19 after 300 readings
    /// that all push the same way (`tests/filter/val_dense.rs`).
    FedBack,
}

/// What the outside sees of a dense filter.
#[derive(Debug, Clone)]
pub(super) struct Shown<T: Scalar> {
    pub(super) belief: Belief<T>,
    pub(super) projection: Projection,
    pub(super) whitened: Vec<f64>,
    after: Vec<f64>,
}

impl<T: Scalar> Shown<T> {
    pub(super) fn new(prior: &FieldPrior, projection: Projection) -> Result<Self, CoreError> {
        Ok(Self {
            belief: prior.marginals()?.cast()?,
            projection,
            whitened: Vec::new(),
            after: Vec::new(),
        })
    }

    /// Shows the posterior of `points`, projected; returns how many means were moved.
    pub(super) fn show<S: Scalar>(
        &mut self,
        points: &[u32],
        mean: &mut [S],
        variance: &[S],
    ) -> usize {
        let (means, variances) = self.belief.parts_mut();
        let mut moved = 0;
        for ((&p, m), &v) in points.iter().zip(mean).zip(variance) {
            let shown = if *m < S::ZERO { S::ZERO } else { *m };
            moved += usize::from(*m < S::ZERO);
            if self.projection == Projection::FedBack {
                *m = shown;
            }
            means[p as usize] = T::from_f64(shown.to_f64());
            variances[p as usize] = T::from_f64(v.to_f64());
        }
        moved
    }

    /// Shows the mode; returns how many points it holds at zero.
    pub(super) fn show_mode(&mut self, points: &[u32], mode: &Mode<T>) -> usize {
        let (means, variances) = self.belief.parts_mut();
        for (slot, &p) in points.iter().enumerate() {
            (means[p as usize], variances[p as usize]) = mode.marginal(slot);
        }
        (0..points.len()).filter(|&slot| mode.is_held(slot)).count()
    }

    /// Reports an update whose posterior is shown already.
    pub(super) fn report(
        &mut self,
        obs: &Observation<T>,
        innovation: &Innovation,
        projected: usize,
    ) -> UpdateReport {
        self.whitened.clone_from(&innovation.whitened);
        let (mean, points) = (self.belief.mean(), obs.points());
        let mean = |k: usize| mean[points[k] as usize].to_f64();
        residual(obs, mean, &mut self.after);
        UpdateReport {
            postfit: norm(&self.after),
            projected,
            ..innovation.report(obs)
        }
    }
}

use crate::{Features, Predictions, Regressor, Samples, VisionError};
use vsf_core::CoreError;

/// A regressor whose variances are scaled up so that they hold on held-out samples: residuals divided by
/// their predicted deviation have a mean square of at most 1.
///
/// Samples are held out in `folds` contiguous parts of the order given, so keep samples that belong
/// together, such as those of one touch, next to each other. If touches are close to each other, the result
/// is too optimistic for extrapolation over longer distances.
#[derive(Clone)]
pub struct Calibrated<R> {
    inner: R,
    folds: usize,
    scale: f64,
}

/// The factor by which predicted variances must be multiplied to match the residuals of held-out samples.
///
/// With the factor, `(y - mean)² / (factor * variance + v)` is 1 on average, where `v` is the variance of
/// the target's own error. The factor is at least 1: targets that are shrunk toward a prior scatter less
/// than their errors say, so residuals cannot show that a prediction is better than it claims.
///
/// # Errors
/// What [`Predictions::check`] refuses, or squares of residuals that are not finite.
pub fn variance_scale(predicted: &Predictions, held_out: &Samples) -> Result<f64, CoreError> {
    predicted.check(held_out.len())?;
    let pairs = predicted.mean.iter().zip(held_out.targets());
    let squares: Vec<f64> = pairs.map(|(mean, y)| (y - mean).powi(2)).collect();
    CoreError::check_finite("squares of held-out residuals", &squares)?;
    let variances = || predicted.variance.iter().zip(held_out.variances());
    let excess = |scale: f64| {
        let terms = squares.iter().zip(variances());
        // 0 / 0, where a prediction is sure and right, is nothing beyond the variance.
        let terms = terms.filter(|(r, _)| **r > 0.0);
        let sum: f64 = terms.map(|(r, (s, v))| r / (scale * s + v)).sum();
        sum / squares.len() as f64 - 1.0
    };
    // The sum falls with the scale: bisect its logarithm.
    if excess(1.0) <= 0.0 {
        return Ok(1.0);
    }
    let (mut low, mut high) = (1.0f64, 1e12f64);
    for _ in 0..100 {
        let middle = (low * high).sqrt();
        if excess(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    Ok(high)
}

impl<R: Regressor> Calibrated<R> {
    /// Wraps `inner`, to be calibrated on `folds` parts (at least 2; 5 is common) whenever it is fitted.
    ///
    /// # Errors
    /// Fewer than 2 parts.
    pub fn new(inner: R, folds: usize) -> Result<Self, VisionError> {
        if folds < 2 {
            return Err(CoreError::TooFew {
                what: "folds",
                got: folds,
                least: 2,
            }
            .into());
        }
        Ok(Self {
            inner,
            folds,
            scale: 1.0,
        })
    }

    /// The factor that variances are multiplied by; 1 before the first fit.
    pub fn scale(&self) -> f64 {
        self.scale
    }
}

impl<R> std::fmt::Debug for Calibrated<R> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Calibrated")
            .field("folds", &self.folds)
            .field("scale", &self.scale)
            .finish_non_exhaustive()
    }
}

impl<R: Regressor + Clone> Regressor for Calibrated<R> {
    /// Fits once per part and once on all samples. With fewer than four samples per part the variances are
    /// not scaled.
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        let (n, folds) = (samples.len(), self.folds);
        let mut scale = 1.0;
        if folds <= n / 4 {
            let mut held_out = Predictions::default();
            for fold in 0..folds {
                let out = fold * n / folds..(fold + 1) * n / folds;
                let kept: Vec<usize> = (0..n).filter(|i| !out.contains(i)).collect();
                let held: Vec<usize> = out.collect();
                let mut part = self.inner.fresh();
                part.fit(&samples.select(&kept)?)?;
                let found = part.predict(&samples.features().rows_of(&held)?)?;
                found.check(held.len())?;
                held_out.mean.extend(found.mean);
                held_out.variance.extend(found.variance);
            }
            scale = variance_scale(&held_out, samples)?;
        }
        self.inner.fit(samples)?;
        self.scale = scale;
        Ok(())
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        let mut predictions = self.inner.predict(features)?;
        predictions
            .variance
            .iter_mut()
            .for_each(|v| *v *= self.scale);
        predictions.check(features.len())?;
        Ok(predictions)
    }

    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Calibrated {
            inner: self.inner.fresh(),
            folds: self.folds,
            scale: 1.0,
        })
    }
}

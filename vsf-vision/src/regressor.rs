use crate::{Features, VisionError};
use dyn_clone::DynClone;
use vsf_core::CoreError;

/// What a [`Regressor`] learns from: features of points, and what is known of their stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    features: Features,
    targets: Vec<f64>,
    variances: Vec<f64>,
}

impl Samples {
    /// Features with one target each and the variance of its error (>= 0).
    ///
    /// # Errors
    /// Lengths that differ, targets or variances that are not finite or whose spread overflows,
    /// negative variances, fewer than 2 samples, no feature.
    pub fn new(
        features: Features,
        targets: Vec<f64>,
        variances: Vec<f64>,
    ) -> Result<Self, VisionError> {
        CoreError::check_len("targets", targets.len(), features.len())?;
        CoreError::check_len("variances of targets", variances.len(), features.len())?;
        CoreError::check_finite("targets", &targets)?;
        CoreError::check_finite("variances of targets", &variances)?;
        if let Some(&value) = variances.iter().find(|v| **v < 0.0) {
            return Err(CoreError::Parameter {
                name: "variance of a target",
                value,
                range: ">= 0",
            }
            .into());
        }
        for (what, got, least) in [
            ("samples", targets.len(), 2),
            ("features", features.width(), 1),
        ] {
            if got < least {
                return Err(CoreError::TooFew { what, got, least }.into());
            }
        }
        let samples = Self {
            features,
            targets,
            variances,
        };
        let (mean, variance) = samples.spread();
        CoreError::check_finite("mean and variance of the targets", &[mean, variance])?;
        Ok(samples)
    }

    /// Features, one row per sample.
    pub fn features(&self) -> &Features {
        &self.features
    }

    /// Targets.
    pub fn targets(&self) -> &[f64] {
        &self.targets
    }

    /// Variances of the targets' errors.
    pub fn variances(&self) -> &[f64] {
        &self.variances
    }

    /// Number of samples, at least 2.
    pub fn len(&self) -> usize {
        self.targets.len()
    }

    /// Never true: there are at least 2 samples.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// The samples `indices`, in that order.
    ///
    /// # Errors
    /// A sample that is not there, fewer than 2.
    pub fn select(&self, indices: &[usize]) -> Result<Self, VisionError> {
        let pick = |of: &[f64]| indices.iter().map(|&i| of[i]).collect();
        let features = self.features.rows_of(indices)?;
        Self::new(features, pick(&self.targets), pick(&self.variances))
    }

    /// Mean and variance of the targets, each counted by how well it is known: the weight of a
    /// sample is `1 / (spread + variance)`, with the plain variance of all targets as `spread`.
    pub fn spread(&self) -> (f64, f64) {
        let (mean, variance, _) = self.weighed();
        (mean, variance)
    }

    /// [`spread`](Self::spread), and the share of each sample in the mean.
    pub(crate) fn weighed(&self) -> (f64, f64, Vec<f64>) {
        let n = self.len() as f64;
        let plain = self.targets.iter().sum::<f64>() / n;
        let spread = self
            .targets
            .iter()
            .map(|y| (y - plain).powi(2))
            .sum::<f64>()
            / n;
        let floor = f64::EPSILON * (1.0 + plain * plain);
        let weight = |v: f64| 1.0 / (spread + v + floor);
        let total: f64 = self.variances.iter().map(|v| weight(*v)).sum();
        let pairs = || self.targets.iter().zip(&self.variances);
        let mean = pairs().map(|(y, v)| weight(*v) * y).sum::<f64>() / total;
        let variance = pairs()
            .map(|(y, v)| weight(*v) * (y - mean).powi(2))
            .sum::<f64>()
            / total;
        let shares = self.variances.iter().map(|v| weight(*v) / total);
        (mean, variance.max(floor), shares.collect())
    }
}

/// Predicted values, and the variances of what they will be off by.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Predictions {
    /// Means, one per row of features.
    pub mean: Vec<f64>,
    /// Variances, > 0: of the value at that point, its scatter about the trend included.
    pub variance: Vec<f64>,
}

impl Predictions {
    /// Checks the answer to `rows` rows of features.
    ///
    /// # Errors
    /// Another number of means or variances, one that is not finite, a negative variance.
    pub fn check(&self, rows: usize) -> Result<(), CoreError> {
        for (what, values) in [
            ("predicted mean", &self.mean),
            ("predicted variance", &self.variance),
        ] {
            CoreError::check_len(what, values.len(), rows)?;
            CoreError::check_finite(what, values)?;
        }
        match self.variance.iter().find(|v| **v < 0.0) {
            None => Ok(()),
            Some(&value) => Err(CoreError::Parameter {
                name: "predicted variance",
                value,
                range: ">= 0",
            }),
        }
    }
}

/// Learns numbers from features, with an honest variance: it grows with the distance from what was
/// learned, to that of all targets or beyond, and counts what their own variances leave open about
/// their mean.
///
/// Dyn-safe, so that a program chooses at run time; `Box<dyn Regressor>` is a regressor, and can be cloned.
/// Implementations give the same result for any number of threads, and leave their state alone on
/// an error. `check_regressor` of `vsf-testkit` is a suite that every implementation must pass.
pub trait Regressor: DynClone + Send + Sync {
    /// Learns, and forgets what it learned before.
    ///
    /// # Errors
    /// Samples that the implementation cannot take.
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError>;

    /// Predicts one value per row.
    ///
    /// # Errors
    /// [`VisionError::NotFitted`], other columns than it learned from, features so far from these
    /// that a prediction would overflow ([`Predictions::check`]).
    fn predict(&self, features: &Features) -> Result<Predictions, VisionError>;

    /// One of the same parameters that has not learned yet.
    fn fresh(&self) -> Box<dyn Regressor>;
}

dyn_clone::clone_trait_object!(Regressor);

impl std::fmt::Debug for dyn Regressor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Regressor").finish_non_exhaustive()
    }
}

impl<R: Regressor + ?Sized> Regressor for Box<R>
where
    Self: Clone,
{
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        (**self).fit(samples)
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        (**self).predict(features)
    }

    fn fresh(&self) -> Box<dyn Regressor> {
        (**self).fresh()
    }
}

use crate::{Features, VisionError};
use dyn_clone::DynClone;
use vsf_core::CoreError;

/// Training samples of a [`Regressor`]: features of points, and what is known of their stiffness.
#[derive(Debug, Clone, PartialEq)]
pub struct Samples {
    features: Features,
    targets: Vec<f64>,
    variances: Vec<f64>,
}

impl Samples {
    /// Creates samples from features, with one target per row and the variance of its error (>= 0).
    ///
    /// # Errors
    /// Lengths that differ, targets or variances that are not finite or whose spread overflows, negative
    /// variances, fewer than 2 samples, or no feature.
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

    /// Always false: there are at least 2 samples.
    pub fn is_empty(&self) -> bool {
        self.targets.is_empty()
    }

    /// The samples `indices`, in that order.
    ///
    /// # Errors
    /// A sample that does not exist, or fewer than 2 samples.
    pub fn select(&self, indices: &[usize]) -> Result<Self, VisionError> {
        let pick = |of: &[f64]| indices.iter().map(|&i| of[i]).collect();
        let features = self.features.rows_of(indices)?;
        Self::new(features, pick(&self.targets), pick(&self.variances))
    }

    /// Weighted mean and variance of the targets. The weight of a sample is `1 / (spread + variance)`,
    /// where `spread` is the plain variance of all targets.
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

/// Predicted values, with the variances of their errors.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Predictions {
    /// Means, one per row of features.
    pub mean: Vec<f64>,
    /// Variances, > 0, of the value at that point, including its scatter about the trend.
    pub variance: Vec<f64>,
}

impl Predictions {
    /// Checks that these are valid predictions for `rows` rows of features.
    ///
    /// # Errors
    /// Another number of means or variances, a number that is not finite, or a negative variance.
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

/// Predicts numbers from features, with an honest variance.
///
/// The variance grows with the distance from the samples, up to the variance of all targets or beyond. It
/// includes the uncertainty of the mean of the targets that their own variances cause.
///
/// Dyn-compatible, for a choice at run time; `Box<dyn Regressor>` is a regressor and can be cloned.
/// Implementations give the same result for any number of threads and leave their state unchanged on an
/// error. Every implementation must pass the suite `check_regressor` of `vsf-testkit`.
pub trait Regressor: DynClone + Send + Sync {
    /// Fits the samples, and forgets what was learned before.
    ///
    /// # Errors
    /// Samples that the implementation cannot handle.
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError>;

    /// Predicts one value per row.
    ///
    /// # Errors
    /// [`VisionError::NotFitted`], columns other than those it was fitted on, or features so far from these
    /// that a prediction would overflow ([`Predictions::check`]).
    fn predict(&self, features: &Features) -> Result<Predictions, VisionError>;

    /// An unfitted regressor with the same parameters.
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

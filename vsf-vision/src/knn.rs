use crate::neighbors::{Neighbor, Neighbors};
use crate::{Features, Predictions, Regressor, Samples, Scaler, VisionError};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vsf_core::{CoreError, median};

/// Nearest-neighbor regression with RBF weights: the extrapolation of the paper (section III-D).
///
/// Features are scaled to unit deviation. The targets `y_j` of the `k` samples nearest to a point, at
/// distances `r_j`, are modeled as noisy readings of one value `f`, with noise that grows with distance:
/// `y_j ~ N(f, (eta² + v_j) exp(r_j² / 2h²))`. `v_j` is the variance of the target and `eta²` the scatter
/// among neighbors, measured at the samples themselves.
///
/// The prior of `f` has the mean of all targets and their variance. Near the samples `f` is therefore the
/// RBF-weighted mean. Far from all of them it falls back to the mean of all targets, with their variance
/// plus that of this mean.
///
/// Neighbors are exact; a query takes some microseconds for thousands of samples. Queries are spread over
/// the threads of the current rayon pool.
///
/// # Reference
/// S. Yao, K. Hauser, section III-D (k = 200, RBF weights); E. A. Nadaraya, *On estimating
/// regression*, Theory of Probability and its Applications 9, 1964, doi:10.1137/1109020.
#[derive(Clone, Default)]
pub struct KnnRegressor {
    config: KnnConfig,
    fitted: Option<Fitted>,
}

/// Parameters of [`KnnRegressor`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KnnConfig {
    /// Number of neighbors, at least 1, default 200. If there are fewer samples, all are used.
    pub neighbors: usize,
    /// Width `h` of the RBF, in standard deviations of the features.
    pub width: Width,
    /// Whether means are shrunk toward the mean of all targets where the samples are far, default true.
    ///
    /// With false a mean is the RBF-weighted mean of the neighbors, however far they are. Variances are the
    /// same either way.
    pub shrink: bool,
}

/// How the width of a kernel is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Width {
    /// The median distance of the samples to their neighbors; the default.
    #[default]
    Median,
    /// A fixed width, > 0, in standard deviations of the features.
    Fixed(f64),
}

impl Default for KnnConfig {
    fn default() -> Self {
        Self {
            neighbors: 200,
            width: Width::Median,
            shrink: true,
        }
    }
}

/// Samples at which width and scatter are measured, at most.
const PROBES: usize = 1000;

#[derive(Clone)]
struct Fitted {
    scaler: Scaler,
    tree: Neighbors,
    neighbors: usize,
    shrink: bool,
    targets: Vec<f64>,
    variances: Vec<f64>,
    width: f64,
    /// Mean of all targets, its variance, variance of `f` about it, scatter of a value about `f`.
    mean: f64,
    of_mean: f64,
    between: f64,
    within: f64,
}

impl KnnRegressor {
    /// Creates an unfitted regressor.
    ///
    /// # Errors
    /// A number of neighbors of 0, or a width that is not positive and finite.
    pub fn new(config: KnnConfig) -> Result<Self, VisionError> {
        if config.neighbors == 0 {
            return Err(CoreError::Parameter {
                name: "neighbors",
                value: 0.0,
                range: ">= 1",
            }
            .into());
        }
        if let Width::Fixed(value) = config.width
            && !(value * value > 0.0 && (1.0 / (value * value)).is_finite())
        {
            return Err(CoreError::Parameter {
                name: "RBF width",
                value,
                range: "> 0 standard deviations of the features",
            }
            .into());
        }
        Ok(Self {
            config,
            fitted: None,
        })
    }
}

impl Fitted {
    fn new(samples: &Samples, config: &KnnConfig) -> Result<Self, VisionError> {
        let scaler = Scaler::of(samples.features())?;
        let rows = scaler.apply(samples.features())?;
        let width = samples.features().width();
        let (mean, total, shares) = samples.weighed();
        let errors = shares.iter().zip(samples.variances());
        let of_mean = errors.map(|(w, v)| w * w * (total + v)).sum();
        let mut fitted = Self {
            scaler,
            tree: Neighbors::new(&rows, width)?,
            neighbors: config.neighbors,
            shrink: config.shrink,
            targets: samples.targets().to_vec(),
            variances: samples.variances().to_vec(),
            width: 1.0,
            mean,
            of_mean,
            between: total,
            within: 0.5 * total,
        };
        let probes: Vec<usize> = (0..samples.len())
            .step_by(samples.len().div_ceil(PROBES))
            .collect();
        let around = |&i: &usize| {
            let mut found = Vec::new();
            let row = &rows[i * width..(i + 1) * width];
            fitted
                .tree
                .nearest(row, config.neighbors.saturating_add(1), &mut found);
            // Without the sample itself, or one at the same place.
            let own = found.iter().position(|n| n.index == i).unwrap_or(0);
            found.remove(own);
            found
        };
        let around: Vec<Vec<Neighbor>> = probes.par_iter().map(around).collect();
        fitted.width = match config.width {
            Width::Fixed(h) => h,
            Width::Median => median_positive(around.iter().flatten().map(|n| n.squared.sqrt())),
        };
        let (mut squares, mut weights) = (0.0, 0.0);
        for (&i, found) in probes.iter().zip(&around) {
            let residual = fitted.targets[i] - fitted.level(found).0;
            let weight = 1.0 / (total + fitted.variances[i]);
            squares += weight * (residual * residual - fitted.variances[i]);
            weights += weight;
        }
        let least = 1e-3 * total;
        fitted.within = (squares / weights).clamp(least, total);
        fitted.between = (total - fitted.within).max(least);
        Ok(fitted)
    }

    /// Mean and variance of `f`.
    fn level(&self, neighbors: &[Neighbor]) -> (f64, f64) {
        // Weights are reckoned from the nearest sample, so that not all of them vanish far away.
        let nearest = neighbors.first().map_or(0.0, |n| n.squared);
        let scale = -0.5 / (self.width * self.width);
        let (mut weights, mut sum) = (0.0, 0.0);
        for n in neighbors {
            let weight = (scale * (n.squared - nearest)).exp();
            let weight = weight / (self.within + self.variances[n.index]);
            weights += weight;
            sum += weight * self.targets[n.index];
        }
        let closeness = (scale * nearest).exp();
        let precision = 1.0 / self.between + closeness * weights;
        let mean = if self.shrink {
            (self.mean / self.between + closeness * sum) / precision
        } else {
            sum / weights
        };
        // The part that the mean of all targets has in `f`.
        let part = 1.0 / (self.between * precision);
        (mean, 1.0 / precision + part * part * self.of_mean)
    }
}

impl Regressor for KnnRegressor {
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        self.fitted = Some(Fitted::new(samples, &self.config)?);
        Ok(())
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        let by = "KnnRegressor";
        let fitted = self.fitted.as_ref().ok_or(VisionError::NotFitted { by })?;
        let rows = fitted.scaler.apply(features)?;
        let of_row = |found: &mut Vec<Neighbor>, row: &[f64]| {
            fitted.tree.nearest(row, fitted.neighbors, found);
            let (mean, variance) = fitted.level(found);
            (mean, variance + fitted.within)
        };
        let all = rows.par_chunks(features.width().max(1));
        let (mean, variance) = all.map_init(Vec::new, of_row).unzip();
        let predictions = Predictions { mean, variance };
        predictions.check(features.len())?;
        Ok(predictions)
    }

    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Self {
            config: self.config,
            fitted: None,
        })
    }
}

impl std::fmt::Debug for KnnRegressor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("KnnRegressor")
            .field("config", &self.config)
            .field("is_fitted", &self.fitted.is_some())
            .finish()
    }
}

/// The median of those that are above 0; 1 where there are none.
fn median_positive(values: impl Iterator<Item = f64>) -> f64 {
    median(values.filter(|v| *v > 0.0).collect()).unwrap_or(1.0)
}

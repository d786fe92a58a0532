use crate::cholesky::Cholesky;
use crate::{Features, Predictions, Regressor, Samples, Scaler, VisionError};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use vsf_core::CoreError;

/// Gaussian process regression with a Matérn 3/2 kernel over the scaled features.
///
/// A target is modeled as the sum of
/// - the mean of all targets,
/// - a smooth part with the covariance `s² (1 + a) exp(-a)`, `a = sqrt(3) r / l`,
/// - independent scatter of variance `eta²`,
/// - an error with the variance that comes with the target.
///
/// `s²`, `l` and `eta²` maximize the marginal likelihood (pattern search in their logarithms, on at most
/// 300 samples, evenly spread over the order given).
///
/// The mean of all targets is itself uncertain, because of the variances of the targets and the kernel.
/// This uncertainty enters predictions as far as no samples nearby determine the value. With vague targets,
/// the likelihood may choose `s²` and `eta²` whose sum is less than the variance of all targets. The
/// missing variance is added to the uncertainty of the mean, so that far from the samples predictions have
/// at least the variance of all targets.
///
/// Fitting takes `O(m³)` time and a prediction `O(m²)`, for `m` samples. Of more than
/// [`GpConfig::max_samples`], an evenly spread subset is used.
///
/// # Reference
/// C. E. Rasmussen, C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT Press 2006,
/// sections 2.2, 2.7, 4.2.1 and 5.4.1.
#[derive(Clone, Default)]
pub struct GaussianProcess {
    config: GpConfig,
    fitted: Option<Fitted>,
}

/// Parameters of [`GaussianProcess`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GpConfig {
    /// Largest number of samples that are used, 2 to [`GpConfig::MOST_SAMPLES`], default 1000.
    pub max_samples: usize,
}

impl GpConfig {
    /// Upper bound of [`GpConfig::max_samples`]: the covariance of so many takes 3.2 GB.
    pub const MOST_SAMPLES: usize = 20_000;
}

impl Default for GpConfig {
    fn default() -> Self {
        Self { max_samples: 1000 }
    }
}

/// Samples on which the likelihood is maximized, at most.
const LIKELIHOOD_SAMPLES: usize = 300;
/// Predictions that are solved together.
const BLOCK: usize = 256;

/// `s²`, `l`, `eta²`.
#[derive(Debug, Clone, Copy)]
struct Kernel([f64; 3]);

impl Kernel {
    fn smooth(&self, a: &[f64], b: &[f64]) -> f64 {
        let squared: f64 = a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum();
        let r = (3.0 * squared).sqrt() / self.0[1];
        self.0[0] * (1.0 + r) * (-r).exp()
    }
}

/// Scaled rows with targets about their mean.
#[derive(Clone)]
struct Data {
    rows: Vec<f64>,
    width: usize,
    targets: Vec<f64>,
    variances: Vec<f64>,
    /// Shares of the targets in their mean, up to a factor.
    shares: Vec<f64>,
}

impl Data {
    fn row(&self, i: usize) -> &[f64] {
        &self.rows[i * self.width..(i + 1) * self.width]
    }

    /// At most `most` samples, evenly spread.
    fn thinned(&self, most: usize) -> Self {
        let n = self.targets.len();
        let kept = most.min(n);
        let picks = (0..kept).map(|k| k * n / kept);
        Self {
            rows: picks.clone().flat_map(|i| self.row(i).to_vec()).collect(),
            width: self.width,
            targets: picks.clone().map(|i| self.targets[i]).collect(),
            variances: picks.clone().map(|i| self.variances[i]).collect(),
            shares: picks.map(|i| self.shares[i]).collect(),
        }
    }

    /// Variance of the smooth part of the mean of the targets.
    fn of_smooth_mean(&self, kernel: &Kernel) -> f64 {
        let mut sum = 0.0;
        for (i, w) in self.shares.iter().enumerate() {
            for (j, other) in self.shares.iter().enumerate() {
                sum += w * other * kernel.smooth(self.row(i), self.row(j));
            }
        }
        let total: f64 = self.shares.iter().sum();
        sum / (total * total)
    }

    fn factor(&self, kernel: &Kernel) -> Result<Cholesky, CoreError> {
        let scatter = kernel.0[2];
        Cholesky::new(self.targets.len(), |i, j| {
            let own = if i == j {
                scatter + self.variances[i]
            } else {
                0.0
            };
            kernel.smooth(self.row(i), self.row(j)) + own
        })
    }

    /// Log marginal likelihood, less what is the same for all.
    fn log_evidence(&self, kernel: &Kernel) -> Result<f64, CoreError> {
        let factor = self.factor(kernel)?;
        let weights = factor.solve(&self.targets);
        let misfit: f64 = weights.iter().zip(&self.targets).map(|(w, y)| w * y).sum();
        Ok(-0.5 * (misfit + factor.log_det()))
    }

    /// Pattern search from the variance `total` of all targets, half of it smooth.
    fn likeliest(&self, total: f64) -> Result<Kernel, CoreError> {
        let mut best = Kernel([0.5 * total, (self.width as f64).sqrt(), 0.5 * total]);
        let mut highest = self.log_evidence(&best)?;
        let floor = 1e-6 * total;
        let mut factor = 4.0;
        while factor > 1.1 {
            let before = highest;
            for (k, by) in (0..3).flat_map(|k| [(k, factor), (k, 1.0 / factor)]) {
                let mut tried = best;
                tried.0[k] *= by;
                // Scatter keeps the matrix positive definite.
                let within = tried.0[2] >= floor
                    && (1e-3..=1e3).contains(&tried.0[1])
                    && (floor..=1e3 * total).contains(&tried.0[0]);
                if within
                    && let Ok(value) = self.log_evidence(&tried)
                    && value > highest
                {
                    (best, highest) = (tried, value);
                }
            }
            // Nor when they are NaN.
            let is_better = highest > before;
            if !is_better {
                factor = f64::sqrt(factor);
            }
        }
        Ok(best)
    }
}

#[derive(Clone)]
struct Fitted {
    scaler: Scaler,
    mean: f64,
    /// Variance of a target's expectation about `mean`, beyond the kernel's.
    of_mean: f64,
    data: Data,
    kernel: Kernel,
    factor: Cholesky,
    weights: Vec<f64>,
    /// Weights with all targets 1.
    ones: Vec<f64>,
}

impl GaussianProcess {
    /// Creates an unfitted regressor.
    ///
    /// # Errors
    /// A maximum of fewer than 2 samples, or of more than [`GpConfig::MOST_SAMPLES`].
    pub fn new(config: GpConfig) -> Result<Self, VisionError> {
        if !(2..=GpConfig::MOST_SAMPLES).contains(&config.max_samples) {
            return Err(CoreError::Parameter {
                name: "max_samples",
                value: config.max_samples as f64,
                range: "2 .. 20000",
            }
            .into());
        }
        Ok(Self {
            config,
            fitted: None,
        })
    }
}

impl Regressor for GaussianProcess {
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        let scaler = Scaler::of(samples.features())?;
        let (mean, total, shares) = samples.weighed();
        let all = samples.variances().iter().zip(&shares);
        // The mean is that of all samples, however few the others are thinned to: so much of it is scatter and noise.
        let own = |scatter: f64| all.map(|(v, w)| w * w * (scatter + v)).sum::<f64>();
        let data = Data {
            rows: scaler.apply(samples.features())?,
            width: samples.features().width(),
            targets: samples.targets().iter().map(|y| y - mean).collect(),
            variances: samples.variances().to_vec(),
            shares: shares.clone(),
        }
        .thinned(self.config.max_samples);
        let kernel = data.thinned(LIKELIHOOD_SAMPLES).likeliest(total)?;
        let factor = data.factor(&kernel)?;
        let weights = factor.solve(&data.targets);
        let ones = factor.solve(&vec![1.0; data.targets.len()]);
        let [smooth, _, scatter] = kernel.0;
        let missing = (total - smooth - scatter).max(0.0);
        self.fitted = Some(Fitted {
            scaler,
            mean,
            of_mean: data.of_smooth_mean(&kernel) + own(scatter) + missing,
            data,
            kernel,
            factor,
            weights,
            ones,
        });
        Ok(())
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        let by = "GaussianProcess";
        let fitted = self.fitted.as_ref().ok_or(VisionError::NotFitted { by })?;
        let rows = fitted.scaler.apply(features)?;
        let width = fitted.data.width;
        let (kernel, data) = (&fitted.kernel, &fitted.data);
        let of_block = |block: &[f64]| {
            let queries: Vec<&[f64]> = block.chunks_exact(width).collect();
            let link = |i: usize, j: usize| kernel.smooth(data.row(i), queries[j]);
            let known = fitted.factor.whitened_squares(queries.len(), link);
            let of_query = |(j, known): (usize, &f64)| {
                // `left` is the part of the mean that the samples do not make up for.
                let (mut trend, mut left) = (0.0, 1.0);
                for (i, (w, one)) in fitted.weights.iter().zip(&fitted.ones).enumerate() {
                    let link = link(i, j);
                    trend += w * link;
                    left -= one * link;
                }
                let doubt = (kernel.0[0] - known).max(0.0) + left * left * fitted.of_mean;
                (fitted.mean + trend, doubt + kernel.0[2])
            };
            known.iter().enumerate().map(of_query).collect::<Vec<_>>()
        };
        let blocks = rows.par_chunks(BLOCK * width);
        let (mean, variance) = blocks.flat_map_iter(of_block).unzip();
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

impl std::fmt::Debug for GaussianProcess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GaussianProcess")
            .field("config", &self.config)
            .field("is_fitted", &self.fitted.is_some())
            .finish()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// 20 places, each sampled twice, of a smooth function of two features; each sample with an error
    /// of its own variance.
    fn samples() -> Samples {
        let at = |i: usize| {
            (
                (i / 2 * 7 % 20) as f64 / 5.0,
                (i / 2 * 13 % 20) as f64 / 4.0,
            )
        };
        let (a, b): (Vec<f64>, Vec<f64>) = (0..40).map(at).unzip();
        let wave = |i: usize| (a[i] * 1.3).sin() + 0.2 * b[i] + 0.2 * (17.0 * i as f64).sin();
        let targets = (0..40).map(wave).collect();
        let variances = (0..40).map(|i| 0.002 * (i % 3) as f64).collect();
        let empty = Features::new(40);
        let one = empty.with_column("a", &a).unwrap();
        Samples::new(one.with_column("b", &b).unwrap(), targets, variances).unwrap()
    }

    fn fitted(samples: &Samples) -> Fitted {
        let mut gp = GaussianProcess::default();
        gp.fit(samples).unwrap();
        gp.fitted.unwrap()
    }

    /// The covariance of the targets, formed and inverted.
    fn covariance(fitted: &Fitted) -> DMatrix<f64> {
        let data = &fitted.data;
        let [variance, length, scatter] = fitted.kernel.0;
        DMatrix::from_fn(40, 40, |i, j| {
            let (p, q) = (data.row(i), data.row(j));
            let a = 3f64.sqrt() * (p[0] - q[0]).hypot(p[1] - q[1]) / length;
            let own = if i == j {
                scatter + data.variances[i]
            } else {
                0.0
            };
            variance * (1.0 + a) * (-a).exp() + own
        })
    }

    /// Rasmussen and Williams, equations 2.25 and 2.26, with an explicit inverse; and the variance of
    /// what is predicted as a sum over all targets, whose mean has a part in it, less the value.
    #[test]
    fn predicts_as_the_closed_form() {
        let samples = samples();
        let fitted = fitted(&samples);
        let inverse = covariance(&fitted).try_inverse().unwrap();
        let y = DVector::from_vec(fitted.data.targets.clone());
        let mut gp = GaussianProcess::default();
        gp.fit(&samples).unwrap();
        let queries = Features::new(3)
            .with_column("a", &[0.35, 2.0, 9.0])
            .unwrap();
        let queries = queries.with_column("b", &[1.0, 4.4, -3.0]).unwrap();
        let found = gp.predict(&queries).unwrap();
        let rows = fitted.scaler.apply(&queries).unwrap();
        for (j, query) in rows.chunks_exact(2).enumerate() {
            let link = |i: usize, _| fitted.kernel.smooth(fitted.data.row(i), query);
            let link = DVector::from_fn(40, link);
            let mean = fitted.mean + link.dot(&(&inverse * &y));
            let [smooth, _, scatter] = fitted.kernel.0;
            let shares = DVector::from_vec(fitted.data.shares.clone());
            let solved = &inverse * &link;
            let sum = &solved + (1.0 - solved.sum()) * shares;
            let of_sum = sum.dot(&(covariance(&fitted) * &sum));
            let missing = (samples.spread().1 - smooth - scatter).max(0.0);
            let variance = smooth + scatter - 2.0 * sum.dot(&link)
                + of_sum
                + (1.0 - solved.sum()).powi(2) * missing;
            assert!((found.mean[j] - mean).abs() < 1e-8, "{j}");
            assert!((found.variance[j] - variance).abs() < 1e-8, "{j}");
        }
    }

    /// 2000 samples of noise at two places: their mean is known as well from 50 of them, but for how they scatter.
    #[test]
    fn the_mean_is_that_of_all_samples() {
        const MANY: usize = 2000;
        let place: Vec<f64> = (0..MANY).map(|i| (i / 7 % 2) as f64).collect();
        let noise = |i: usize| (12.9898 * i as f64).sin() * 43758.5453 % 1.0;
        let features = Features::new(MANY).with_column("a", &place).unwrap();
        let targets = (0..MANY).map(noise).collect();
        let samples = Samples::new(features, targets, vec![0.0; MANY]).unwrap();
        let mut gp = GaussianProcess::new(GpConfig { max_samples: 50 }).unwrap();
        gp.fit(&samples).unwrap();
        let fitted = gp.fitted.unwrap();
        let [smooth, _, scatter] = fitted.kernel.0;
        assert!(smooth < 0.01 * scatter, "{smooth} of {scatter}");
        let own = scatter / MANY as f64;
        let found = fitted.of_mean;
        assert!((own..1.1 * own).contains(&found), "{found} {own}");
    }

    /// Equation 2.30, but for its constant; and no neighboring parameters are likelier.
    #[test]
    fn likelihood_is_that_of_the_targets_and_greatest() {
        let fitted = fitted(&samples());
        let (data, kernel) = (&fitted.data, fitted.kernel);
        let covariance = covariance(&fitted);
        let y = DVector::from_vec(data.targets.clone());
        let misfit = y.dot(&(covariance.clone().try_inverse().unwrap() * &y));
        let expected = -0.5 * (misfit + covariance.determinant().ln());
        let highest = data.log_evidence(&kernel).unwrap();
        assert!((highest - expected).abs() < 1e-7, "{highest}, {expected}");
        for (k, by) in (0..3).flat_map(|k| [(k, 1.2), (k, 1.0 / 1.2)]) {
            let mut other = kernel;
            other.0[k] *= by;
            assert!(data.log_evidence(&other).unwrap() <= highest, "{other:?}");
        }
    }
}

use crate::{Features, Predictions, Regressor, Samples, Scaler, VisionError};
use vsf_core::SymmetricFactor;

/// Bayesian linear regression: the target is a level plus a slope along every feature.
///
/// Features are scaled to unit deviation. Level and slopes have the prior `N(0, alpha²)` about the mean of
/// all targets. A target scatters by `eta² + v_j` about the trend, where `v_j` is the variance that comes
/// with it. `alpha²` and `eta²` are those of the largest marginal likelihood on a grid of powers of 2. The
/// variance of a prediction grows with the square of the distance, beyond that of all targets.
///
/// The mean of all targets is itself uncertain, because of their variances. This uncertainty enters
/// predictions as far as the samples leave the level at its prior. With vague targets, the likelihood may
/// choose `alpha²` and `eta²` whose sum is less than the variance of all targets; the missing variance is
/// added to the uncertainty of the mean.
///
/// # Reference
/// C. M. Bishop, *Pattern Recognition and Machine Learning*, Springer 2006, sections 3.3 and 3.5.
#[derive(Clone, Default)]
pub struct Ridge {
    fitted: Option<Fitted>,
}

/// `alpha²` and `eta²` that are tried, as powers of 2 of the variance of all targets.
const POWERS: std::ops::RangeInclusive<i32> = -12..=2;

#[derive(Clone)]
struct Fitted {
    scaler: Scaler,
    mean: f64,
    /// Variance of the level about `mean`, beyond its prior.
    of_mean: f64,
    /// By a feature's row: the part of `mean` that the samples do not make up for.
    left: Vec<f64>,
    /// Level, then slopes.
    weights: Vec<f64>,
    /// Factor of their precision.
    factor: SymmetricFactor,
    prior: f64,
    scatter: f64,
    log_evidence: f64,
}

/// The problem at one `eta²`: weighted sums over the samples.
struct Sums {
    /// `X^T R^-1 X`, row by row, and `X^T R^-1 y`.
    gram: Vec<f64>,
    right: Vec<f64>,
    /// `y^T R^-1 y + log det R`.
    constant: f64,
}

impl Ridge {
    /// Creates an unfitted regressor.
    pub fn new() -> Self {
        Self::default()
    }
}

/// A row of features with the 1 of the level before it.
fn with_level(row: &[f64]) -> impl Iterator<Item = f64> + Clone {
    std::iter::once(1.0).chain(row.iter().copied())
}

impl Sums {
    fn new(rows: &[f64], width: usize, samples: &Samples, mean: f64, scatter: f64) -> Self {
        let dim = width + 1;
        let mut sums = Self {
            gram: vec![0.0; dim * dim],
            right: vec![0.0; dim],
            constant: 0.0,
        };
        let targets = samples.targets().iter().zip(samples.variances());
        for (row, (target, variance)) in rows.chunks_exact(width).zip(targets) {
            let (noise, y) = (variance + scatter, target - mean);
            let row = with_level(row);
            for (i, a) in row.clone().enumerate() {
                sums.right[i] += a * y / noise;
                for (j, b) in row.clone().enumerate() {
                    sums.gram[i * dim + j] += a * b / noise;
                }
            }
            sums.constant += y * y / noise + noise.ln();
        }
        sums
    }

    /// Weights, factor of their precision and log evidence, less what is the same for all.
    fn solve(&self, prior: f64) -> Result<(Vec<f64>, SymmetricFactor, f64), VisionError> {
        let dim = self.right.len();
        let mut precision = self.gram.clone();
        (0..dim).for_each(|i| precision[i * dim + i] += 1.0 / prior);
        let mut factor = SymmetricFactor::default();
        factor.factor("precision of the slopes", dim, &precision)?;
        let mut weights = self.right.clone();
        factor.solve(&mut weights);
        let explained: f64 = weights.iter().zip(&self.right).map(|(w, b)| w * b).sum();
        let log_det = factor.log_det() + dim as f64 * prior.ln();
        let log_evidence = -0.5 * (self.constant + log_det - explained);
        Ok((weights, factor, log_evidence))
    }
}

impl Fitted {
    /// Sets `of_mean` and `left`, with the share of each target in the mean.
    fn doubt_mean(&mut self, rows: &[f64], shares: &[f64], variances: &[f64], total: f64) {
        let dim = self.weights.len();
        let mut center = vec![0.0; dim];
        let mut errors = 0.0;
        for ((row, w), v) in rows.chunks_exact(dim - 1).zip(shares).zip(variances) {
            let row = with_level(row);
            center.iter_mut().zip(row).for_each(|(c, x)| *c += w * x);
            errors += w * w * (self.scatter + v);
        }
        let explained = self.prior * center.iter().map(|c| c * c).sum::<f64>();
        let missing = (total - self.prior - self.scatter).max(0.0);
        self.of_mean = explained + errors + missing;
        self.left = vec![0.0; dim];
        self.left[0] = 1.0 / self.prior;
        self.factor.solve(&mut self.left);
    }
}

impl Regressor for Ridge {
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        let scaler = Scaler::of(samples.features())?;
        let rows = scaler.apply(samples.features())?;
        let (mean, total, shares) = samples.weighed();
        let mut best: Option<Fitted> = None;
        for scatter in POWERS.map(|p| total * 2f64.powi(p)) {
            let sums = Sums::new(&rows, samples.features().width(), samples, mean, scatter);
            for prior in POWERS.map(|p| total * 2f64.powi(p)) {
                let (weights, factor, log_evidence) = sums.solve(prior)?;
                if best.as_ref().is_none_or(|b| log_evidence > b.log_evidence) {
                    best = Some(Fitted {
                        scaler: scaler.clone(),
                        mean,
                        of_mean: 0.0,
                        left: Vec::new(),
                        weights,
                        factor,
                        prior,
                        scatter,
                        log_evidence,
                    });
                }
            }
        }
        if let Some(best) = &mut best {
            best.doubt_mean(&rows, &shares, samples.variances(), total);
        }
        self.fitted = best;
        Ok(())
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        let by = "Ridge";
        let fitted = self.fitted.as_ref().ok_or(VisionError::NotFitted { by })?;
        let rows = fitted.scaler.apply(features)?;
        let mut white = vec![0.0; fitted.weights.len()];
        let of_row = |row: &[f64]| {
            let row = with_level(row);
            let trend: f64 = row.clone().zip(&fitted.weights).map(|(x, w)| x * w).sum();
            let left: f64 = row.clone().zip(&fitted.left).map(|(x, l)| x * l).sum();
            white.iter_mut().zip(row).for_each(|(w, x)| *w = x);
            fitted.factor.solve_lower(&mut white);
            let doubt: f64 = white.iter().map(|w| w * w).sum();
            let doubt = doubt + left * left * fitted.of_mean;
            (fitted.mean + trend, doubt + fitted.scatter)
        };
        let (mean, variance) = rows
            .chunks_exact(features.width().max(1))
            .map(of_row)
            .unzip();
        let predictions = Predictions { mean, variance };
        predictions.check(features.len())?;
        Ok(predictions)
    }

    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Self::new())
    }
}

impl std::fmt::Debug for Ridge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ridge")
            .field("is_fitted", &self.fitted.is_some())
            .finish()
    }
}

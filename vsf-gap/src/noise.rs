use crate::{ContactLog, Motion};
use std::sync::Arc;

/// Noise of one joint's reading: first-order autoregressive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointNoise {
    /// Standard deviation of a sample (N m or N).
    pub sd: f64,
    /// Correlation of one sample with the next, 0 to 0.95.
    pub correlation: f64,
}

impl JointNoise {
    /// Variance of the mean of `m` samples in a row.
    pub fn variance_of_mean(&self, m: usize) -> f64 {
        let (m, c) = (m.max(1) as f64, self.correlation);
        let long_run = (1.0 + c) / (1.0 - c);
        self.sd * self.sd * (long_run / m).min(1.0)
    }
}

/// Fewest free samples that speak for the noise on their own.
const FEWEST: usize = 150;
/// Differences beyond so many times their median are steps of the signal, not noise.
const STEP: f64 = 5.0;

/// The noise of every joint, from differences of neighbouring samples: in free motion where there
/// is enough of it, else of all samples. Differences leave out what changes slowly, whatever its
/// cause.
pub(crate) fn noise_floor(
    motions: &[&Motion],
    logs: &[Arc<ContactLog>],
    joints: usize,
) -> Vec<JointNoise> {
    let pairs = |free: bool| -> Vec<(usize, usize, usize)> {
        let mut rows = Vec::new();
        for (s, (motion, log)) in motions.iter().zip(logs).enumerate() {
            for touch in &motion.touches {
                for row in touch.start + 2..touch.end {
                    if !free || (row - 2..=row).all(|r| log.contacts[r].is_empty()) {
                        rows.push((s, row, touch.start));
                    }
                }
            }
        }
        rows
    };
    let mut rows = pairs(true);
    if rows.len() < FEWEST {
        rows = pairs(false);
    }
    let of_joint = |j: usize| {
        let difference = |&(s, row, _): &(usize, usize, usize)| {
            let r = &motions[s].reading;
            let (a, b, c) = (r[row - 2][j], r[row - 1][j], r[row][j]);
            (b - a, c - b)
        };
        joint_noise(rows.iter().map(difference).collect())
    };
    (0..joints).map(of_joint).collect()
}

/// Variance and correlation from pairs of differences in a row: those of AR(1) noise have variance
/// `2 s² (1 - c)` and covariance `-s² (1 - c)²`.
fn joint_noise(pairs: Vec<(f64, f64)>) -> JointNoise {
    let mut sizes: Vec<f64> = pairs.iter().map(|(a, _)| a.abs()).collect();
    let Some(middle) = sizes.len().checked_sub(1).map(|n| n / 2) else {
        return JointNoise {
            sd: 0.0,
            correlation: 0.0,
        };
    };
    sizes.sort_by(f64::total_cmp);
    let limit = STEP * sizes[middle].max(f64::MIN_POSITIVE);
    let kept = || (pairs.iter()).filter(|(a, b)| a.abs() <= limit && b.abs() <= limit);
    let n = kept().count().max(1) as f64;
    let variance = kept().map(|(a, b)| 0.5 * (a * a + b * b)).sum::<f64>() / n;
    let covariance = kept().map(|(a, b)| a * b).sum::<f64>() / n;
    let ratio = if variance > 0.0 {
        covariance / variance
    } else {
        -0.5
    };
    let correlation = (1.0 + 2.0 * ratio).clamp(0.0, 0.95);
    JointNoise {
        sd: (variance / (2.0 * (1.0 - correlation))).sqrt(),
        correlation,
    }
}

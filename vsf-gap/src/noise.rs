use crate::{ContactLog, Motion};
use std::ops::Range;
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
    /// Noise of means of `m` samples in a row, each the next to the one before; 0 is taken as 1.
    pub fn of_means(&self, m: usize) -> Self {
        let (m, c) = (m.max(1) as f64, self.correlation);
        let faded = (1.0 - c.powf(m)) / (1.0 - c);
        let variance = (m * (1.0 + c) - 2.0 * c * faded) / (1.0 - c);
        Self {
            sd: self.sd * variance.sqrt() / m,
            correlation: c * faded * faded / variance,
        }
    }
}

/// Fewest free samples that speak for the noise on their own.
const FEWEST: usize = 150;
/// Second differences beyond so many times their median are steps of the signal, not noise; unless they
/// are more than this share, as in readings that are quantised.
const STEP: f64 = 5.0;
const FEW: f64 = 0.1;
/// The largest correlation that is told from a signal.
const SMOOTHEST: f64 = 0.95;

/// The noise of every joint, from second differences of neighbouring samples: in free motion where
/// there is enough of it, else of all samples. Second differences leave out what is smooth, whatever its
/// cause.
pub(crate) fn noise_floor(
    motions: &[&Motion],
    logs: &[Arc<ContactLog>],
    joints: usize,
) -> Vec<JointNoise> {
    // Sequence and last row of every four samples in a row.
    let of_touches = || {
        motions.iter().enumerate().flat_map(|(s, motion)| {
            let own = |touch: &Range<usize>| touch.start + 3..touch.end;
            motion.touches.iter().flat_map(own).map(move |row| (s, row))
        })
    };
    let free = |&(s, row): &(usize, usize)| (row - 3..=row).all(|r| logs[s].contacts[r].is_empty());
    let mut rows: Vec<(usize, usize)> = of_touches().filter(free).collect();
    if rows.len() < FEWEST {
        rows = of_touches().collect();
    }
    // Touches are shorter than that.
    if rows.len() < FEWEST {
        let own = |(s, motion): (usize, &&Motion)| (3..motion.len()).map(move |row| (s, row));
        rows = motions.iter().enumerate().flat_map(own).collect();
    }
    let of_joint = |j: usize| {
        let differences = |&(s, row): &(usize, usize)| {
            let r = |back: usize| motions[s].reading[row - back][j];
            (r(3) - 2.0 * r(2) + r(1), r(2) - 2.0 * r(1) + r(0))
        };
        joint_noise(&rows.iter().map(differences).collect::<Vec<_>>())
    };
    (0..joints).map(of_joint).collect()
}

/// Variance and correlation from pairs of second differences in a row: those of AR(1) noise have
/// variance `2 s² (1 - c) (3 - c)` and covariance `-s² (1 - c) (4 - 3 c + c²)`, so that their
/// correlation `r` tells `c` by `c² - (3 + 2 r) c + 4 + 6 r = 0`.
fn joint_noise(pairs: &[(f64, f64)]) -> JointNoise {
    let mut sizes: Vec<f64> = pairs.iter().map(|(a, _)| a.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    let limit = STEP * sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    let beyond = sizes.len() - sizes.partition_point(|s| *s <= limit);
    let limit = match beyond as f64 > FEW * sizes.len() as f64 {
        true => f64::INFINITY,
        false => limit,
    };
    let kept = || (pairs.iter()).filter(|(a, b)| a.abs() <= limit && b.abs() <= limit);
    let n = kept().count().max(1) as f64;
    let variance = kept().map(|(a, b)| 0.5 * (a * a + b * b)).sum::<f64>() / n;
    let covariance = kept().map(|(a, b)| a * b).sum::<f64>() / n;
    if variance == 0.0 {
        return JointNoise {
            sd: 0.0,
            correlation: 0.0,
        };
    }
    let r = covariance / variance;
    let (half, product) = (1.5 + r, 4.0 + 6.0 * r);
    let root = (half * half - product).max(0.0).sqrt();
    let c = (half - root).clamp(0.0, SMOOTHEST);
    JointNoise {
        sd: (variance / (2.0 * (1.0 - c) * (3.0 - c))).sqrt(),
        correlation: c,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    /// AR(1) noise on a signal.
    fn readings(noise: JointNoise, seed: u64, signal: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut e = noise.sd * draw();
        let fresh = noise.sd * (1.0 - noise.correlation.powi(2)).sqrt();
        (0..20_000)
            .map(|k| {
                e = noise.correlation * e + fresh * draw();
                e + signal(0.01 * k as f64)
            })
            .collect()
    }

    fn found(r: &[f64]) -> JointNoise {
        let second = |k: usize| r[k] - 2.0 * r[k + 1] + r[k + 2];
        let pairs: Vec<_> = (0..r.len() - 3)
            .map(|k| (second(k), second(k + 1)))
            .collect();
        joint_noise(&pairs)
    }

    proptest! {
        /// A smooth signal a hundred times larger than the noise, sampled at 100 Hz, does not pass as
        /// noise. Noise that is more correlated is told from it less sharply: at 0.6, one recording in some
        /// thousand is further off.
        #[test]
        fn val_noise_is_found_under_a_smooth_signal(seed in any::<u64>(), c in 0.0..0.5) {
            let noise = JointNoise { sd: 0.02, correlation: c };
            let of = found(&readings(noise, seed, |t| 2.0 * (3.0 * t).sin()));
            prop_assert!((of.correlation - c).abs() < 0.25, "{of:?}");
            let (true_mean, mean) = (noise.of_means(20).sd, of.of_means(20).sd);
            prop_assert!((0.6..1.6).contains(&(mean / true_mean)), "{of:?}");
        }
    }

    #[test]
    fn val_noise_of_means_is_that_of_averaged_noise() {
        let noise = JointNoise {
            sd: 0.5,
            correlation: 0.7,
        };
        let r = readings(noise, 1, |_| 0.0);
        let means: Vec<f64> = r.chunks(4).map(|m| m.iter().sum::<f64>() / 4.0).collect();
        let n = means.len() as f64;
        let variance = means.iter().map(|m| m * m).sum::<f64>() / n;
        let covariance = means.windows(2).map(|m| m[0] * m[1]).sum::<f64>() / n;
        let of = noise.of_means(4);
        assert!((of.sd / variance.sqrt() - 1.0).abs() < 0.1, "{of:?}");
        assert!(
            (of.correlation - covariance / variance).abs() < 0.1,
            "{of:?}"
        );
    }

    #[test]
    fn quantised_readings_have_noise() {
        // Steps of 0.1 under a slow motion that the model knows almost.
        let read = |k: i32| (0.1 * f64::from(k)).round() * 0.1 - 0.0099 * f64::from(k);
        let sd = found(&(0..3000).map(read).collect::<Vec<_>>()).sd;
        assert!((0.1..4.0).contains(&(sd * 12.0_f64.sqrt() / 0.1)), "{sd}");
    }
}

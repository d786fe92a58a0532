use crate::{ContactLog, Motion};
use std::sync::Arc;
use vsf_core::median;

/// Noise of one joint's reading, a first-order autoregressive process.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct JointNoise {
    /// Standard deviation of a sample (N m or N).
    pub sd: f64,
    /// Correlation of consecutive samples, 0 to 0.95.
    pub correlation: f64,
}

impl JointNoise {
    /// Noise of means over `m` consecutive samples, each mean beginning where the last one ended; 0 counts as 1.
    pub fn of_means(&self, m: usize) -> Self {
        let (m, c) = (m.max(1) as f64, self.correlation);
        let faded = (1.0 - c.powf(m)) / (1.0 - c);
        let variance = (m * (1.0 + c) - 2.0 * c * faded) / (1.0 - c);
        Self {
            sd: self.sd * variance.sqrt() / m,
            correlation: c * faded * faded / variance,
        }
    }

    /// Covariance of the mean of `a` consecutive samples with that of `b` that begin `gap` samples after the end of the
    /// first.
    pub(crate) fn covariance_of_means(&self, a: usize, b: usize, gap: usize) -> f64 {
        let c = self.correlation;
        let mean_fade = |m: usize| (1.0 - c.powf(m as f64)) / (1.0 - c) / m as f64;
        self.sd * self.sd * c.powf(gap as f64 + 1.0) * mean_fade(a) * mean_fade(b)
    }
}

/// Pairs of second differences of free motion from which noise is estimated from them alone, and from which they are used
/// at all.
const FEWEST: usize = 150;
const SOME: usize = 24;
/// Samples whose mean compares one noise with another, as smoother noise is worse in means, and how many times as large
/// that of contact is where the air alone is believed: its correlation, from few samples, is often too small.
const A_FEW: usize = 5;
const CLEARLY: f64 = 2.0;
/// Differences beyond this many times their median are steps of the signal, not noise; unless they are more than this
/// share, as in quantized readings and in contact that changes all the time.
const STEP: f64 = 5.0;
const FEW: f64 = 0.1;
/// The largest correlation that can be told from a signal.
pub(crate) const SMOOTHEST: f64 = 0.95;

/// Orders of the differences that noise is estimated from, all even. Higher orders suppress more of a smooth signal, and
/// show less of noise that is smooth itself.
const ORDERS: [usize; 3] = [2, 4, 6];
/// Noise below this share of the estimate from second differences counts as none.
const FILTERED: f64 = 0.01;

/// Noise of the readings of every joint.
pub(crate) struct NoiseFloor {
    pub(crate) joints: Vec<JointNoise>,
    /// Whether the noise of a joint was estimated without free motion, so that contact changes from one sample to the next
    /// count as noise.
    pub(crate) is_bound: bool,
}

impl NoiseFloor {
    /// Estimates noise from differences of neighboring samples.
    ///
    /// Free motion is used if there is enough of it; otherwise all samples, with some free motion telling how large
    /// differences of noise are. Differences remove what is smooth, whatever its cause. Usually second differences do. If
    /// their remainder is smoother than noise, as with a hum or with friction that reverses again and again, higher orders
    /// are used.
    pub(crate) fn of(motions: &[&Motion], logs: &[Arc<ContactLog>], joints: usize) -> Self {
        let source = |source| Differences {
            motions,
            logs,
            source,
        };
        let [free, touches] = [Source::Free, Source::Touches].map(source);
        let is_enough = free.count() >= FEWEST;
        let all = if touches.count() >= FEWEST {
            touches
        } else {
            source(Source::Sequences)
        };
        let touches_something = logs.iter().flat_map(|l| &l.contacts).any(|c| !c.is_empty());
        let mut is_bound = false;
        let of_joint = |j: usize| {
            let in_air = || joint_noise(|order| moments(&free.pairs(j, order), None));
            // Readings that are zero in the air tell nothing of others.
            let largest = |order: usize| {
                let pairs = free.pairs(j, order);
                let is_told = pairs.len() >= SOME;
                Some(STEP * median_size(&pairs)).filter(|largest| is_told && *largest > 0.0)
            };
            let is_told = largest(ORDERS[0]).is_some();
            if is_enough && is_told {
                return in_air();
            }
            let noise = joint_noise(|order| moments(&all.pairs(j, order), largest(order)));
            if !is_told {
                is_bound |= touches_something && noise.sd > 0.0;
                return noise;
            }
            // Where the force in contact changes by a few deviations of noise from sample to sample, all of these
            // differences pass for noise, and the air knows better, for all that it is short.
            let in_air = in_air();
            if noise.of_means(A_FEW).sd > CLEARLY * in_air.of_means(A_FEW).sd {
                in_air
            } else {
                noise
            }
        };
        let joints = (0..joints).map(of_joint).collect();
        Self { joints, is_bound }
    }
}

/// Where noise is estimated from.
#[derive(Clone, Copy, PartialEq)]
enum Source {
    Free,
    Touches,
    /// Across touches, if these are short.
    Sequences,
}

/// Differences of neighboring samples.
#[derive(Clone, Copy)]
struct Differences<'a> {
    motions: &'a [&'a Motion],
    logs: &'a [Arc<ContactLog>],
    source: Source,
}

impl Differences<'_> {
    /// How many pairs of second differences there are.
    fn count(&self) -> usize {
        self.runs(ORDERS[0] + 2).len()
    }

    /// Differences for joint `j`, each paired with the previous one.
    fn pairs(&self, j: usize, order: usize) -> Vec<(f64, f64)> {
        let weights = binomials(order);
        let difference = |s: usize, row: usize| -> f64 {
            let at = |(back, w): (usize, &f64)| w * self.motions[s].reading[row - back][j];
            weights.iter().enumerate().map(at).sum()
        };
        let pair = |(s, row): (usize, usize)| (difference(s, row - 1), difference(s, row));
        self.runs(order + 2).into_iter().map(pair).collect()
    }

    /// Sequence and last row of every run of `length` consecutive samples.
    fn runs(&self, length: usize) -> Vec<(usize, usize)> {
        let is_free = |s: usize, row: usize| {
            (row + 1 - length..=row).all(|r| self.logs[s].contacts[r].is_empty())
        };
        let mut rows = Vec::new();
        for (s, motion) in self.motions.iter().enumerate() {
            let whole = 0..motion.len();
            let ranges = match self.source {
                Source::Sequences => std::slice::from_ref(&whole),
                _ => &motion.touches,
            };
            for range in ranges {
                let own = (range.start + length - 1..range.end)
                    .filter(|&row| self.source != Source::Free || is_free(s, row));
                rows.extend(own.map(|row| (s, row)));
            }
        }
        rows
    }
}

/// Weights of the samples, the last one first, in a difference of this order.
fn binomials(order: usize) -> Vec<f64> {
    let mut next = 1.0;
    let weight = |k: usize| {
        let weight = next;
        next = -weight * (order - k) as f64 / (k + 1) as f64;
        weight
    };
    (0..=order).map(weight).collect()
}

/// Estimates noise from the moments of differences, by their order: the lowest order is used whose correlation is one of
/// AR(1) noise. If there is none, or next to nothing is left, the noise itself is smooth, as in filtered readings; then
/// second differences bound it.
fn joint_noise(moments: impl Fn(usize) -> Moments) -> JointNoise {
    // Their correlation, known from `n` pairs to within about `1 / sqrt(n)`, is to lie below that of the smoothest
    // noise by `margins` of these.
    let of_order = |order: usize, margins: f64| {
        let Moments {
            variance,
            covariance,
            pairs,
        } = moments(order);
        let margin = margins / (pairs.max(1) as f64).sqrt();
        let correlation = if variance > 0.0 {
            correlation(order, covariance / variance, margin)
        } else {
            0.0
        };
        JointNoise {
            sd: (variance / unit_moments(order, correlation).0).sqrt(),
            correlation,
        }
    };
    let bound = of_order(ORDERS[0], 0.0);
    if bound.correlation < SMOOTHEST {
        return bound;
    }
    let is_noise = |n: &JointNoise| n.correlation < SMOOTHEST && n.sd > FILTERED * bound.sd;
    let mut others = ORDERS[1..].iter().map(|order| of_order(*order, 1.0));
    others.find(is_noise).unwrap_or(bound)
}

/// Variance of differences, and covariance of consecutive ones.
struct Moments {
    variance: f64,
    covariance: f64,
    /// Number of pairs.
    pairs: usize,
}

/// The median size of differences.
fn median_size(pairs: &[(f64, f64)]) -> f64 {
    median(pairs.iter().map(|(a, _)| a.abs()).collect()).unwrap_or(0.0)
}

/// Moments without steps of the signal, which lie beyond `steps_from` if that is known.
fn moments(pairs: &[(f64, f64)], steps_from: Option<f64>) -> Moments {
    let limit = steps_from.unwrap_or_else(|| {
        let limit = STEP * median_size(pairs);
        let beyond = pairs.iter().filter(|(a, _)| a.abs() > limit).count();
        if beyond as f64 > FEW * pairs.len() as f64 {
            f64::INFINITY
        } else {
            limit
        }
    });
    let kept = || (pairs.iter()).filter(|(a, b)| a.abs() <= limit && b.abs() <= limit);
    let pairs = kept().count();
    let n = pairs.max(1) as f64;
    Moments {
        variance: kept().map(|(a, b)| 0.5 * (a * a + b * b)).sum::<f64>() / n,
        covariance: kept().map(|(a, b)| a * b).sum::<f64>() / n,
        pairs,
    }
}

/// The same moments for AR(1) noise of variance 1 and this correlation.
fn unit_moments(order: usize, correlation: f64) -> (f64, f64) {
    let weights = binomials(2 * order);
    // What a difference and its shifted self have in common are, for even orders, the weights of twice the
    // order.
    let moment = |lag: isize| -> f64 {
        let of = |(k, w): (usize, &f64)| {
            let apart = (k as isize - order as isize - lag).unsigned_abs();
            w * correlation.powi(apart as i32)
        };
        weights.iter().enumerate().map(of).sum()
    };
    (moment(0), moment(1))
}

/// The correlation of AR(1) noise whose consecutive differences have the correlation `r`, with which it grows.
/// [`SMOOTHEST`] unless `r` is below that of such noise by `margin`.
fn correlation(order: usize, r: f64, margin: f64) -> f64 {
    let of = |c: f64| {
        let (variance, covariance) = unit_moments(order, c);
        covariance / variance
    };
    if r + margin >= of(SMOOTHEST) {
        return SMOOTHEST;
    }
    let (mut low, mut high) = (0.0, SMOOTHEST);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if of(middle) < r {
            low = middle
        } else {
            high = middle
        }
    }
    low
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
        joint_noise(|order| {
            let weights = binomials(order);
            let difference =
                |k: usize| -> f64 { weights.iter().zip(&r[k..]).map(|(w, r)| w * r).sum() };
            let pair = |k: usize| (difference(k), difference(k + 1));
            let pairs: Vec<_> = (0..r.len() - order - 1).map(pair).collect();
            moments(&pairs, None)
        })
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

    /// A hum of 6 Hz in readings at 70 Hz, twenty times as large as the noise.
    #[test]
    fn val_noise_is_found_under_a_hum() {
        let noise = JointNoise {
            sd: 0.05,
            correlation: 0.3,
        };
        let hum = |t: f64| (std::f64::consts::TAU * 6.0 / 0.7 * t).sin();
        let of = found(&readings(noise, 2, hum));
        assert!((of.sd / 0.05 - 1.0).abs() < 0.1, "{of:?}");
        assert!((of.correlation - 0.3).abs() < 0.1, "{of:?}");
    }

    /// By the closed form for second differences: variance `2 s² (1 - c) (3 - c)`, covariance
    /// `-s² (1 - c) (4 - 3 c + c²)`.
    #[test]
    fn val_moments_of_second_differences() {
        for c in [0.0, 0.3, 0.9] {
            let (variance, covariance) = unit_moments(2, c);
            assert!((variance - 2.0 * (1.0 - c) * (3.0 - c)).abs() < 1e-12);
            assert!((covariance + (1.0 - c) * (4.0 - 3.0 * c + c * c)).abs() < 1e-12);
            assert!((correlation(2, covariance / variance, 0.0) - c).abs() < 1e-9);
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
    fn val_covariance_of_means_is_the_sum_over_pairs() {
        for (c, a, b, gap) in [(0.0, 3, 4, 0), (0.3, 5, 2, 0), (0.9, 4, 7, 3)] {
            let noise = JointNoise {
                sd: 0.5,
                correlation: c,
            };
            let mut sum = 0.0;
            for i in 0..a {
                for j in 0..b {
                    sum += 0.25 * f64::powi(c, (a - i + gap + j) as i32);
                }
            }
            let expected = sum / (a * b) as f64;
            let found = noise.covariance_of_means(a, b, gap);
            assert!((found - expected).abs() < 1e-14, "{found} {expected}");
        }
    }

    /// A triangle of means has no noise that differences of a high order would see.
    #[test]
    fn filtered_readings_have_noise() {
        let noise = JointNoise {
            sd: 0.05,
            correlation: 0.0,
        };
        let r = readings(noise, 3, |_| 0.0);
        let mean =
            |r: &[f64]| -> Vec<f64> { r.windows(8).map(|w| w.iter().sum::<f64>() / 8.0).collect() };
        let r = mean(&mean(&mean(&r)));
        let sd = (r.iter().map(|v| v * v).sum::<f64>() / r.len() as f64).sqrt();
        let of = found(&r);
        // A ninth of it is found: what is smoother than the smoothest noise passes for signal.
        assert!((0.08..0.16).contains(&(of.sd / sd)), "{of:?} of {sd}");
    }

    #[test]
    fn quantized_readings_have_noise() {
        // Steps of 0.1 under a slow motion that the model knows almost.
        let read = |k: i32| (0.1 * f64::from(k)).round() * 0.1 - 0.0099 * f64::from(k);
        let sd = found(&(0..3000).map(read).collect::<Vec<_>>()).sd;
        // Its single steps are differences as large as any: found is some 3.4 times the error of rounding.
        assert!((2.4..4.0).contains(&(sd * 12.0_f64.sqrt() / 0.1)), "{sd}");
    }
}

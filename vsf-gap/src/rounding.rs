use crate::noise::{JointNoise, SMOOTHEST};
use vsf_data::Sequence;

/// Changes below this share of the largest reading count as none: numbers stored with fewer digits.
const ALIKE: f64 = 1e-6;
/// Largest deviation of a change from a multiple of the step, as a share of the step; and share of the changes that may
/// deviate more, the smallest ones included.
const OFF: f64 = 0.01;
const OTHERS: f64 = 0.01;
/// Noise of a third of a step or more makes rounding errors white. With less, the noise found in differences is below this
/// share of a step; or, if it takes jumps for noise, more than this share of the readings equal the previous one.
const DITHER: f64 = 0.5;
const SAME: f64 = 0.5;
/// Fewest changes of readings from which a step is determined.
const FEWEST: usize = 3;
/// Standard deviation of rounded noise of a third of a step, in steps.
const MOST: f64 = 0.45;

/// What rounding adds to the noise of a joint whose readings come in steps.
///
/// If the noise is small compared with the step, the rounding error is a sawtooth of the signal. It lasts while the signal
/// stays in a step. Differences of neighboring samples miss it, or take the jumps between steps for noise.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rounding {
    /// Distance of neighboring readings (N m or N).
    pub(crate) step: f64,
    /// Share of the readings that equal the previous one.
    same: f64,
}

impl Rounding {
    /// Rounding of the readings of joint `j` as recorded; `None` if they are not in steps.
    pub(crate) fn of(sequences: &[&Sequence], j: usize) -> Option<Self> {
        let readings = sequences.iter().flat_map(|s| s.torques.column(j));
        let largest = readings.fold(0.0, |most: f64, r| most.max(r.abs()));
        let pairs = || {
            sequences.iter().flat_map(|s| {
                let rows = s.touches().flat_map(|t| t.start + 1..t.end);
                rows.map(|k| (s.torques[k][j] - s.torques[k - 1][j]).abs())
            })
        };
        let is_change = |change: &f64| *change > ALIKE * largest;
        let mut changes: Vec<f64> = pairs().filter(is_change).collect();
        if changes.len() < FEWEST {
            return None;
        }
        let same = 1.0 - changes.len() as f64 / pairs().count() as f64;
        changes.sort_by(f64::total_cmp);
        let few = (OTHERS * changes.len() as f64) as usize;
        let step = changes[few];
        let is_other = |change: &&f64| (**change / step - (**change / step).round()).abs() > OFF;
        (changes.iter().filter(is_other).count() <= few).then_some(Self { step, same })
    }

    /// Whether rounding errors are not white. The noise found in differences then misses them, or takes jumps for noise.
    pub(crate) fn lasts(&self, noise: &JointNoise) -> bool {
        noise.sd < DITHER * self.step || self.same > SAME
    }

    /// Adds the noise of rounding to the noise found in differences. How long a rounding error lasts differs between motion
    /// and rest, so it is taken to be as smooth as noise may be.
    pub(crate) fn with(&self, noise: &JointNoise) -> JointNoise {
        JointNoise {
            sd: (noise.sd).clamp(self.step / 12f64.sqrt(), MOST * self.step),
            correlation: SMOOTHEST,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;
    use vsf_data::Table;

    const SAMPLES: usize = 10_000;

    fn rounding(reading: impl Fn(usize) -> f64) -> Option<Rounding> {
        let time = (0..SAMPLES).map(|k| 0.01 * k as f64).collect();
        let still = Table::new(1, vec![0.0; SAMPLES]).unwrap();
        let torques = Table::new(1, (0..SAMPLES).map(reading).collect()).unwrap();
        Rounding::of(&[&Sequence::new("0", time, still, torques)], 0)
    }

    /// The error itself, of signals in motion and at rest, without noise and with some: that of means is not more
    /// than it is taken for, and hardly less of single samples.
    #[test]
    fn val_error_of_rounding() {
        const STEP: f64 = 0.5;
        for (amplitude, noise) in [
            (0.8, 0.0),
            (3.0, 0.0),
            (20.0, 0.0),
            (3.0, 0.05),
            (20.0, 0.1),
        ] {
            let mut rng = Pcg64Mcg::seed_from_u64(1);
            let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
            let signal = |k: usize| match k / 1000 % 2 {
                0 => amplitude * (0.005 * k as f64).sin() + 0.3,
                _ => amplitude * (0.3 * (k / 1000) as f64).sin(),
            };
            let read: Vec<f64> = (0..SAMPLES)
                .map(|k| ((signal(k) + noise * draw()) / STEP).round() * STEP)
                .collect();
            // As stored in fewer digits.
            let found = rounding(|k| f64::from(read[k] as f32)).unwrap();
            assert!((found.step - STEP).abs() < 1e-5);
            let of = found.with(&JointNoise {
                sd: noise,
                correlation: 0.0,
            });
            let errors: Vec<f64> = (0..SAMPLES).map(|k| read[k] - signal(k)).collect();
            let sd = |e: &mut dyn Iterator<Item = f64>| {
                let (sum, n) = e.fold((0.0, 0.0), |(s, n), e| (s + e * e, n + 1.0));
                (sum / n).sqrt()
            };
            let single = sd(&mut errors.iter().copied());
            assert!((0.7..1.3).contains(&(of.sd / single)), "{of:?}, {single}");
            let mean = sd(&mut errors.chunks(10).map(|e| e.iter().sum::<f64>() / 10.0));
            assert!(of.of_means(10).sd > 0.8 * mean, "{of:?}, {mean}");
        }
    }

    #[test]
    fn readings_of_any_number_are_not_rounded() {
        assert!(rounding(|k| (0.01 * k as f64).sin()).is_none());
        assert!(rounding(|_| 0.1).is_none());
        // One sensor of steps, with an offset, and a spike.
        let stepped = |k: usize| {
            if k == 77 {
                9.876
            } else {
                0.123 + 0.25 * ((k / 7 % 9) as f64)
            }
        };
        assert!((rounding(stepped).unwrap().step - 0.25).abs() < 1e-9);
    }

    /// Differences see errors of rounding that noise makes white; jumps are not taken for noise.
    #[test]
    fn white_errors_are_no_rounding() {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        let draw: Vec<f64> = StandardNormal.sample_iter(&mut rng).take(SAMPLES).collect();
        let read = |k: usize, noise: f64| {
            let slow = 2.0 * (0.002 * k as f64).sin();
            (slow + noise * draw[k]).round()
        };
        let of = |sd| JointNoise {
            sd,
            correlation: 0.0,
        };
        assert!(!rounding(|k| read(k, 0.7)).unwrap().lasts(&of(0.76)));
        let found = rounding(|k| read(k, 0.1)).unwrap();
        assert!(found.lasts(&of(0.2)) && found.lasts(&of(0.9)));
        assert!((found.with(&of(0.9)).sd - 0.45).abs() < 1e-12);
        // In motion hardly a reading is as the one before.
        let quick = rounding(|k| (20.0 * (0.13 * k as f64).sin()).round()).unwrap();
        assert!(quick.same < SAME && quick.lasts(&of(0.3)));
        // Steps so coarse that few readings change.
        let coarse = |k: usize| {
            if (3000..5000).contains(&k) || k > 8000 {
                50.0
            } else {
                0.0
            }
        };
        assert_eq!(rounding(coarse).unwrap().step, 50.0);
    }
}

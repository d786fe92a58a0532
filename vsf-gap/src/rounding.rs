use crate::noise::{JointNoise, SMOOTHEST};
use vsf_data::Sequence;

/// Numbers closer than this share of the largest are one number, stored with fewer digits.
const ALIKE: f64 = 1e-6;
/// Largest part of a step by which a rounded reading may lie beside a multiple of it.
const OFF: f64 = 0.01;
/// Noise of this share of a step and more makes rounding errors white, and is seen with them.
const DITHER: f64 = 0.5;
/// Fewest changes of readings from which a step is told.
const FEWEST: usize = 20;

/// What rounding adds to the noise of a joint whose readings come in steps.
///
/// Next to noise that is small against the step, the error of rounding is a sawtooth of the signal: it lasts
/// while the signal stays in a step, and differences of neighbouring samples miss it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rounding {
    /// Distance of neighbouring readings (N m or N).
    pub(crate) step: f64,
    /// Steps that the reading moves by from one sample to the next, mean.
    pace: f64,
}

impl Rounding {
    /// Of the readings of joint `j` as recorded; `None` when any number occurs.
    pub(crate) fn of(sequences: &[&Sequence], j: usize) -> Option<Self> {
        let readings = || {
            sequences
                .iter()
                .flat_map(|s| s.torques.iter())
                .map(|row| row[j])
        };
        let largest = readings().fold(0.0, |most: f64, r| most.max(r.abs()));
        let changes = || {
            let pairs = sequences.iter().flat_map(|s| {
                s.touches()
                    .flat_map(|t| t.start + 1..t.end)
                    .map(|k| (s.torques[k][j] - s.torques[k - 1][j]).abs())
            });
            pairs.filter(|change| *change > ALIKE * largest)
        };
        let step = changes().fold(f64::INFINITY, f64::min);
        let multiple = |change: f64| (change / step - (change / step).round()).abs() <= OFF;
        if changes().count() < FEWEST || !changes().all(multiple) {
            return None;
        }
        let samples = readings().count() as f64;
        Some(Self {
            step,
            pace: changes().sum::<f64>() / (step * samples),
        })
    }

    /// Whether it is more than noise as it is found in differences.
    pub(crate) fn exceeds(&self, noise: &JointNoise) -> bool {
        noise.sd < DITHER * self.step
    }

    /// Noise as it is found in differences, and that of rounding.
    pub(crate) fn with(&self, noise: &JointNoise) -> JointNoise {
        // Of a sawtooth whose phase moves by `r`.
        let r = self.pace.min(0.5);
        let correlation = (1.0 - 6.0 * r * (1.0 - r)).min(SMOOTHEST);
        JointNoise {
            sd: noise.sd.max(self.step / 12f64.sqrt()),
            correlation: noise.correlation.max(correlation),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use vsf_data::Table;

    fn rounding(reading: impl Fn(usize) -> f64) -> Option<Rounding> {
        let n = 5000;
        let time = (0..n).map(|k| 0.01 * k as f64).collect();
        let still = Table::new(1, vec![0.0; n]).unwrap();
        let torques = Table::new(1, (0..n).map(reading).collect()).unwrap();
        Rounding::of(&[&Sequence::new("0", time, still, torques)], 0)
    }

    /// The error itself, of a signal that moves by a fiftieth to a third of a step from sample to sample.
    #[test]
    fn val_error_of_rounding() {
        for amplitude in [1.0, 3.0, 15.0] {
            let signal = |k: usize| amplitude * (0.01 * k as f64).sin() + 0.3;
            let read = |k: usize| (signal(k) / 0.5).round() * 0.5;
            // As stored in fewer digits.
            let found = rounding(|k| f64::from(read(k) as f32)).unwrap();
            let noise = found.with(&JointNoise {
                sd: 0.0,
                correlation: 0.0,
            });
            let errors: Vec<f64> = (0..5000).map(|k| read(k) - signal(k)).collect();
            let square = errors.iter().map(|e| e * e).sum::<f64>() / 5000.0;
            let next = errors.windows(2).map(|e| e[0] * e[1]).sum::<f64>() / 4999.0;
            assert!((noise.sd / square.sqrt() - 1.0).abs() < 0.1, "{noise:?}");
            let correlation = (next / square).clamp(0.0, SMOOTHEST);
            assert!(
                (noise.correlation - correlation).abs() < 0.15,
                "{noise:?}, {correlation}"
            );
        }
    }

    #[test]
    fn readings_of_any_number_are_not_rounded() {
        assert!(rounding(|k| (0.01 * k as f64).sin()).is_none());
        assert!(rounding(|_| 0.1).is_none());
        // One sensor of steps, with an offset.
        let stepped = rounding(|k| 0.123 + 0.25 * ((k / 7 % 9) as f64)).unwrap();
        assert!((stepped.step - 0.25).abs() < 1e-9);
    }

    #[test]
    fn noise_of_half_a_step_makes_rounding_white() {
        let found = rounding(|k| (k / 10 % 30) as f64).unwrap();
        let of = |sd| JointNoise {
            sd,
            correlation: 0.2,
        };
        assert!(found.exceeds(&of(0.1)) && !found.exceeds(&of(0.5)));
        assert_eq!(found.with(&of(0.4)).sd, 0.4);
    }
}

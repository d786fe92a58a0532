//! Oscillations in what a model leaves, such as a hum of drives.
//!
//! Differences of samples take fast oscillations for noise, and means of samples average them out. Samples one period apart
//! are alike, and so are those two periods apart. Samples of noise, or of a motion that is repeated, are not.

/// Smallest share of the energy that an oscillation makes up.
const LEAST: f64 = 0.3;
/// Fewest pairs of samples for a correlation.
const FEWEST: usize = 100;
/// Longest period, in samples and as a share of the longest run.
const LONGEST: usize = 200;
const PART: usize = 3;
/// The period is at most this many times the lag at which samples are first opposite to each other.
const PERIOD: usize = 4;

/// RMS over samples (N m or N) of the oscillation in runs of samples; 0 if there is none.
///
/// Each run consists of rows of joint residuals with noise of these deviations. The mean of a run does not count. Time: the
/// number of samples times the length of the period.
pub(crate) fn oscillation(runs: &[&[f64]], noise: &[f64]) -> f64 {
    let joints = noise.len();
    let runs: Vec<Vec<f64>> = runs.iter().map(|run| centered(run, joints)).collect();
    // Every joint counts by its own noise: a wrist is heard beside a shoulder.
    let weights: Vec<f64> = noise.iter().map(|sd| (sd * sd).recip()).collect();
    let weights = if weights.iter().all(|w| w.is_finite()) {
        weights
    } else {
        vec![1.0; joints]
    };
    let ones = vec![1.0; joints];
    // Mean product of samples that lie `lag` apart.
    let product = |lag: usize, weights: &[f64]| -> Option<f64> {
        let shift = lag * joints;
        let (mut sum, mut count) = (0.0, 0);
        for run in runs.iter().filter(|run| run.len() > shift) {
            let pairs = run.iter().zip(&run[shift..]).zip(weights.iter().cycle());
            sum += pairs.map(|((a, b), w)| w * a * b).sum::<f64>();
            count += (run.len() - shift) / joints;
        }
        (count >= FEWEST).then(|| sum / count as f64)
    };
    let longest = runs.iter().map(|run| run.len() / joints).max();
    let longest = (longest.unwrap_or(0) / PART).min(LONGEST);
    let Some(energy) = product(0, &weights).filter(|e| *e > 0.0) else {
        return 0.0;
    };
    let alike = |lag: usize| product(lag, &weights).map_or(0.0, |p| p / energy);
    let Some(opposite) = (1..=longest).find(|lag| alike(*lag) < -LEAST) else {
        return 0.0;
    };
    let periods = opposite + 1..=(PERIOD * opposite + 2).min(longest);
    let best = periods.max_by(|a, b| alike(*a).total_cmp(&alike(*b)));
    let twice = |lag: usize| (2 * lag - 1..=2 * lag + 1).map(alike).fold(0.0, f64::max);
    match best.filter(|lag| alike(*lag) > LEAST && twice(*lag) > LEAST) {
        Some(lag) => product(lag, &ones).unwrap_or(0.0).max(0.0).sqrt(),
        None => 0.0,
    }
}

/// A run without its mean, joint by joint.
fn centered(run: &[f64], joints: usize) -> Vec<f64> {
    let samples = (run.len() / joints.max(1)).max(1) as f64;
    let mean = |j: usize| run.iter().skip(j).step_by(joints).sum::<f64>() / samples;
    let means: Vec<f64> = (0..joints).map(mean).collect();
    run.iter()
        .zip(means.iter().cycle())
        .map(|(r, m)| r - m)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;
    use std::f64::consts::TAU;

    /// Joints with AR(1) noise of these deviations and correlation `c`, and a signal of the time from the start of a run and
    /// of the session; runs of samples at 70 Hz.
    fn found(
        (seed, noise, c): (u64, &[f64], f64),
        (runs, samples): (u32, u32),
        signal: impl Fn(f64, f64) -> f64,
    ) -> f64 {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let mut errors = vec![0.0; noise.len()];
        let mut run = |s: u32| -> Vec<f64> {
            let mut row = |k: u32| -> Vec<f64> {
                let t = f64::from(k) / 70.0;
                for (e, sd) in errors.iter_mut().zip(noise) {
                    let fresh: f64 = StandardNormal.sample(&mut rng);
                    *e = c * *e + (1.0 - c * c).sqrt() * sd * fresh;
                }
                let felt = signal(t, t + 7.3 * f64::from(s));
                errors.iter().map(|e| e + felt).collect()
            };
            (0..samples).flat_map(&mut row).collect()
        };
        let runs: Vec<Vec<f64>> = (0..runs).map(&mut run).collect();
        let runs: Vec<&[f64]> = runs.iter().map(Vec::as_slice).collect();
        oscillation(&runs, noise)
    }

    #[test]
    fn val_hums_are_found() {
        for c in [0.0, 0.5, 0.95] {
            for frequency in [0.8, 3.0, 6.0, 17.0] {
                let hum = |_, t: f64| 2.0 * (TAU * frequency * t).sin();
                let of = found((3, &[1.0, 1.0], c), (3, 300), hum);
                // Of two joints, each with an RMS of 2 / sqrt(2).
                assert!((of / 2.0 - 1.0).abs() < 0.2, "{c} {frequency}: {of}");
            }
        }
        // In the pauses of two touches.
        let hum = |_, t: f64| 2.0 * (TAU * 6.0 * t).sin();
        let of = found((3, &[1.0, 1.0], 0.0), (2, 110), hum);
        assert!((of / 2.0 - 1.0).abs() < 0.2, "{of}");
        // A joint with little noise is heard beside one with much.
        let hum = |_, t: f64| 0.3 * (TAU * 3.0 * t).sin();
        let of = found((3, &[2.0, 0.1], 0.0), (3, 300), hum);
        assert!((of / 0.3 - 1.0).abs() < 0.5, "{of}");
    }

    /// Noise that is smooth, of few joints and samples; motions that every run repeats.
    #[test]
    fn val_noise_and_repeated_motions_are_no_hum() {
        let mut heard = 0;
        for (seed, (c, noise)) in (0..50).flat_map(|s| {
            let of = [0.5, 0.9, 0.95].map(|c| [(c, &[1.0][..]), (c, &[1.0, 2.0])]);
            of.concat().into_iter().map(move |of| (s, of))
        }) {
            for runs in [(1, 130), (2, 128), (1, 200), (1, 400), (3, 304), (20, 64)] {
                heard += u32::from(found((seed, noise, c), runs, |_, _| 0.0) > 0.0);
            }
        }
        assert!(heard <= 18, "{heard} of 1800");
        let motions: [fn(f64) -> f64; 4] = [
            |t| t,
            |t| (t - 0.45).powi(2),
            |t| (3.5 * t).sin(),
            |t| (t - 0.45).abs(),
        ];
        for (k, motion) in motions.iter().enumerate() {
            let of = found((5, &[1.0], 0.0), (20, 64), |t, _| 100.0 * motion(t));
            assert_eq!(of, 0.0, "{k}");
        }
        assert_eq!(found((1, &[1.0, 1.0], 0.0), (3, 300), |_, _| 5.0), 0.0);
        assert_eq!(oscillation(&[], &[1.0; 2]), 0.0);
        assert_eq!(oscillation(&[&[0.0; 1000]], &[0.0; 2]), 0.0);
    }
}

//! Oscillations in what a model leaves, such as a hum of drives: differences of samples take fast ones for noise, and
//! means of samples leave nothing of them. Correlation over a whole period tells: noise of sensors has none.

/// An oscillation makes this part of the energy at least.
const LEAST: f64 = 0.3;
/// Fewest pairs of samples of which a correlation is told.
const FEWEST: usize = 200;
/// Longest period, in samples.
const LONGEST: usize = 200;

/// RMS over samples (N m or N) of the oscillation in runs of samples, each a row of `joints` residuals; 0 without one.
/// The mean of a run is no part of it. Time: samples times the length of the period.
pub(crate) fn oscillation(runs: &[&[f64]], joints: usize) -> f64 {
    let runs: Vec<Vec<f64>> = runs.iter().map(|run| centred(run, joints)).collect();
    // Mean product of samples that lie `lag` apart.
    let product = |lag: usize| -> Option<f64> {
        let shift = lag * joints;
        let (sum, count) =
            (runs.iter().filter(|run| run.len() > shift)).fold((0.0, 0), |(sum, count), run| {
                let pairs = run.iter().zip(&run[shift..]);
                let own: f64 = pairs.map(|(a, b)| a * b).sum();
                (sum + own, count + (run.len() - shift) / joints)
            });
        (count >= FEWEST).then(|| sum / count as f64)
    };
    let Some(energy) = product(0).filter(|e| *e > 0.0) else {
        return 0.0;
    };
    let mut after_half = (1..=LONGEST)
        .map_while(product)
        .skip_while(|p| *p > -LEAST * energy)
        .skip_while(|p| *p < LEAST * energy)
        .take_while(|p| *p > 0.0);
    let first = after_half.next().unwrap_or(0.0);
    after_half.fold(first, f64::max).sqrt()
}

/// A run without its mean, joint by joint.
fn centred(run: &[f64], joints: usize) -> Vec<f64> {
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

    /// Two joints with AR(1) noise of deviation 1 and correlation `c`, and a signal; three runs at 70 Hz.
    fn found(c: f64, signal: impl Fn(f64) -> f64) -> f64 {
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        let mut noise = [0.0; 2];
        let mut run = |from: f64| -> Vec<f64> {
            let mut row = |k: i32| {
                let t = from + f64::from(k) / 70.0;
                noise = noise.map(|e| {
                    let fresh: f64 = StandardNormal.sample(&mut rng);
                    c * e + (1.0 - c * c).sqrt() * fresh
                });
                noise.map(|e| e + signal(t))
            };
            (0..300).flat_map(&mut row).collect()
        };
        let runs = [0.0, 7.3, 20.1].map(&mut run);
        let runs: Vec<&[f64]> = runs.iter().map(Vec::as_slice).collect();
        oscillation(&runs, 2)
    }

    #[test]
    fn val_hums_are_found_and_noise_is_none() {
        for c in [0.0, 0.5, 0.95] {
            assert_eq!(found(c, |_| 0.0), 0.0, "{c}");
            // A constant and a slow rise are none either.
            assert_eq!(found(c, |_| 5.0), 0.0, "{c}");
            for frequency in [0.8, 3.0, 6.0, 17.0] {
                let of = found(c, |t| 2.0 * (TAU * frequency * t).sin());
                // Of two joints, each with an RMS of 2 / sqrt(2).
                assert!((of / 2.0 - 1.0).abs() < 0.2, "{c} {frequency}: {of}");
            }
        }
        assert_eq!(oscillation(&[], 2), 0.0);
        assert_eq!(oscillation(&[&[0.0; 1000]], 2), 0.0);
    }
}

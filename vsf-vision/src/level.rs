use vsf_core::{CoreError, Noise, Observation};

/// The one stiffness that explains readings best when all points have it in the proportions of a
/// `shape`: `K_i = level * shape_i`.
///
/// Readings are sums over many points, so that their common level is what touches tell most
/// surely, and is right where the stiffnesses of single points are not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Least-squares level over all readings (N/m), >= 0.
    pub mean: f64,
    /// Variance of the level from sequence to sequence (N²/m²), unbiased where each counts by the weight of its readings; the
    /// square of the mean with a single sequence.
    pub variance: f64,
}

impl Level {
    /// Fits the level to the readings of sequences, each channel counted by its own noise: that of the observation, or
    /// `noise` where one is given for all.
    ///
    /// # Errors
    /// An observation that reaches beyond the shape, or of another number of channels than `noise`, readings that no point of the shape bears on.
    pub fn fit<'a>(
        shape: &[f64],
        sequences: impl IntoIterator<Item = &'a [Observation<f64>]>,
        noise: Option<&Noise>,
    ) -> Result<Self, CoreError> {
        CoreError::check_finite("shape", shape)?;
        // Weights and levels of the sequences.
        let mut found: Vec<(f64, f64)> = Vec::new();
        for sequence in sequences {
            let (mut cross, mut square) = (0.0, 0.0);
            for obs in sequence.iter().filter(|o| !o.is_empty()) {
                obs.check_fits(shape.len())?;
                let noise = noise.unwrap_or(obs.noise());
                CoreError::check_len("noise", noise.dim(), obs.dim())?;
                let mut unit = vec![0.0; obs.dim()];
                obs.apply(shape, &mut unit);
                for (i, (a, b)) in unit.iter().zip(obs.reading()).enumerate() {
                    let weight = noise.sd(i).powi(-2);
                    cross += weight * a * b;
                    square += weight * a * a;
                }
            }
            if square > 0.0 {
                found.push((square, cross / square));
            }
        }
        let weight: f64 = found.iter().map(|(w, _)| w).sum();
        if !(weight > 0.0 && weight.is_finite()) {
            return Err(CoreError::Parameter {
                name: "weight of the shape in the readings",
                value: weight,
                range: "> 0: some touched point must have a part in it",
            });
        }
        let mean = found.iter().map(|(w, l)| w * l).sum::<f64>() / weight;
        let squares: f64 = found.iter().map(|(w, l)| w * (l - mean).powi(2)).sum();
        let square_of_weights: f64 = found.iter().map(|(w, _)| w * w).sum();
        let variance = match found.len() {
            1 => mean * mean,
            _ => squares / (weight - square_of_weights / weight),
        };
        Ok(Self {
            mean: mean.max(0.0),
            variance,
        })
    }
}

use super::BatchFit;
use std::f64::consts::TAU;
use vsf_core::{CoreError, Observation};

/// Prediction of one sequence from all others: see [`BatchFit::leave_one_out`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct HeldOut {
    /// `log p(tau_s | others)`, the joint density of all readings of the sequence.
    pub log_density: f64,
    /// Mean of `||tau_hat - tau||_2` over the observations of the sequence; 0 if it has none.
    pub mean_error: f64,
    /// Predicted readings `tau_hat`, one observation after another.
    pub prediction: Vec<f64>,
}

impl BatchFit<'_> {
    /// Predicts every sequence from all others, without refitting.
    ///
    /// The Gaussian posterior of the points with `K > 0` is downdated by the sequence, exactly. The set of
    /// free points is kept. A fit without the sequence might choose another set, and predicted fields may
    /// fall below zero where only the left-out sequence had the information.
    ///
    /// Costs `O(k³)` per sequence, where `k` is the smaller of its number of rows and its number of touched
    /// points with `K > 0`.
    ///
    /// # Errors
    /// Posteriors that are not positive definite because of rounding.
    ///
    /// # Reference
    /// C. E. Rasmussen, C. K. I. Williams, *Gaussian Processes for Machine Learning*, MIT Press
    /// 2006, section 5.4.2, by blocks.
    pub fn leave_one_out(&self) -> Result<Vec<HeldOut>, CoreError> {
        (0..self.batch.sequences.len())
            .map(|s| self.leave_out(s))
            .collect()
    }

    fn leave_out(&self, s: usize) -> Result<HeldOut, CoreError> {
        let x = self.optimum.x.as_slice();
        let (log_det, without) = self.problem.leave_out(&self.optimum.factor, s, x)?;
        let variance = self.noise_scale * self.noise_scale;
        let sequence = self.batch.sequences[s];
        let channels: usize = sequence.iter().map(Observation::dim).sum();
        // Residuals of the fit times those without the sequence: r^T (I - H)^-1 r.
        let squares = self.batch.squares(s, x, &without)?;
        let mut log_sum = channels as f64 * (TAU * variance).ln() - log_det + squares / variance;
        let mut whitener = self.batch.whitener();
        let mut prediction = Vec::with_capacity(channels);
        let mut errors = 0.0;
        for obs in sequence {
            whitener.set(obs)?;
            log_sum += whitener.log_det();
            let mut error = obs.reading().to_vec();
            self.batch.subtract(obs, &without, &mut error);
            errors += error.iter().map(|e| e * e).sum::<f64>().sqrt();
            prediction.extend(obs.reading().iter().zip(&error).map(|(tau, e)| tau - e));
        }
        Ok(HeldOut {
            log_density: -0.5 * log_sum,
            mean_error: errors / sequence.len().max(1) as f64,
            prediction,
        })
    }
}

use crate::kernel;
use vsf_core::{CoreError, Noise, Observation, Scalar, SymmetricFactor};

/// Keeps past readings honest about a field that has moved since.
///
/// A reading `tau = W K_then + n` says of the field now, `K_now = K_then + step` with a step of
/// variance Q in every point: `tau = W K_now + (n - W step)`. Its noise has become `R + Q W W^T`, if
/// nothing else is known of the field.
#[derive(Debug, Clone)]
pub(crate) struct Aging<T> {
    steps: Vec<T>,
    moments: Vec<f64>,
    noise: Noise,
    factor: SymmetricFactor,
}

impl<T: Scalar> Aging<T> {
    pub(crate) fn new() -> Result<Self, CoreError> {
        Ok(Self {
            steps: Vec::new(),
            moments: Vec::new(),
            noise: Noise::uniform(0, 1.0)?,
            factor: SymmetricFactor::default(),
        })
    }

    /// Adds `variance * W W^T` to the noise of `obs`, and returns the largest ratio of what is added
    /// to what was there, over the channels. On an error the noise is unchanged.
    pub(crate) fn age(
        &mut self,
        obs: &mut Observation<T>,
        variance: f64,
    ) -> Result<f64, CoreError> {
        let d = obs.dim();
        self.steps.clear();
        self.steps.resize(obs.len(), T::from_f64(variance));
        self.moments.resize((d + 1) * d, 0.0);
        kernel::moments(obs, &self.steps, &self.steps, &mut self.moments);
        let covariance = &mut self.moments[..d * d];
        let mut ratio = 0.0f64;
        for i in 0..d {
            ratio = ratio.max(covariance[i * d + i] / obs.noise().sd(i).powi(2));
            for j in 0..=i {
                let sum = covariance[i * d + j] + obs.noise().covariance()[i * d + j];
                covariance[i * d + j] = sum;
                covariance[j * d + i] = sum;
            }
        }
        self.noise.set_full(d, covariance, &mut self.factor)?;
        obs.set_noise(&self.noise)?;
        Ok(ratio)
    }
}

use crate::{CoreError, SymmetricFactor};

/// Covariance of the reading noise, `R` (`d x d`, in squared units of the reading).
///
/// It is given as one standard deviation for all channels, one per channel, or a full matrix. Noise
/// that changes with time is updated by [`Noise::set_per_channel`], [`Noise::set_full`] or
/// [`Clone::clone_from`], which reuse the memory.
#[derive(Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::state::NoiseParts")
)]
pub struct Noise {
    dim: usize,
    covariance: Vec<f64>,
}

/// Covariances are dense.
const MOST_CHANNELS: usize = 4096;

fn check_channels(dim: usize) -> Result<(), CoreError> {
    if dim <= MOST_CHANNELS {
        return Ok(());
    }
    Err(CoreError::TooMany {
        what: "channels of the noise",
        got: dim,
        max: MOST_CHANNELS,
    })
}

impl Clone for Noise {
    fn clone(&self) -> Self {
        Self {
            dim: self.dim,
            covariance: self.covariance.clone(),
        }
    }

    /// Copies into the existing memory.
    fn clone_from(&mut self, source: &Self) {
        self.dim = source.dim;
        self.covariance.clone_from(&source.covariance);
    }
}

impl Noise {
    /// Independent noise with the same standard deviation in all `dim` channels: the paper's sigma_tau. `dim` may be 0.
    ///
    /// # Errors
    /// A standard deviation that is not positive and finite, its square included, or more than 4096 channels.
    pub fn uniform(dim: usize, sd: f64) -> Result<Self, CoreError> {
        check_channels(dim)?;
        Self::per_channel(&vec![sd; dim])
    }

    /// Independent noise with one standard deviation per channel.
    ///
    /// # Errors
    /// As [`Noise::uniform`].
    pub fn per_channel(sd: &[f64]) -> Result<Self, CoreError> {
        let mut noise = Self {
            dim: 0,
            covariance: Vec::new(),
        };
        noise.set_per_channel(sd)?;
        Ok(noise)
    }

    /// Replaces the noise as by [`Noise::per_channel`]. Does not allocate after the first use at a given size.
    ///
    /// # Errors
    /// As [`Noise::uniform`]; the noise is then unchanged.
    pub fn set_per_channel(&mut self, sd: &[f64]) -> Result<(), CoreError> {
        let dim = sd.len();
        check_channels(dim)?;
        let is_deviation = |s: f64| s > 0.0 && (s * s).is_finite() && s * s > 0.0;
        if let Some(&value) = sd.iter().find(|s| !is_deviation(**s)) {
            return Err(CoreError::Parameter {
                name: "noise sd",
                value,
                range: "> 0 and finite, its square too",
            });
        }
        self.dim = dim;
        self.covariance.clear();
        self.covariance.resize(dim * dim, 0.0);
        (sd.iter().enumerate()).for_each(|(i, s)| self.covariance[i * dim + i] = s * s);
        Ok(())
    }

    /// Noise with a full covariance, row-major `dim x dim`.
    ///
    /// # Errors
    /// A matrix of the wrong size or that is not finite, symmetric (to 1e-9 of its largest entry) and positive definite, or
    /// more than 4096 channels.
    pub fn full(dim: usize, covariance: Vec<f64>) -> Result<Self, CoreError> {
        Self::check(dim, &covariance, &mut SymmetricFactor::default())?;
        Ok(Self { dim, covariance })
    }

    /// Replaces the noise as by [`Noise::full`]. Does not allocate after the first use at a given size.
    /// `workspace` is used by the checks and holds the Cholesky factor of the covariance afterward.
    ///
    /// # Errors
    /// As [`Noise::full`]; the noise is then unchanged.
    pub fn set_full(
        &mut self,
        dim: usize,
        covariance: &[f64],
        workspace: &mut SymmetricFactor,
    ) -> Result<(), CoreError> {
        Self::check(dim, covariance, workspace)?;
        self.dim = dim;
        self.covariance.clear();
        self.covariance.extend_from_slice(covariance);
        Ok(())
    }

    fn check(
        dim: usize,
        covariance: &[f64],
        workspace: &mut SymmetricFactor,
    ) -> Result<(), CoreError> {
        check_channels(dim)?;
        let size = dim.saturating_mul(dim);
        CoreError::check_len("noise covariance", covariance.len(), size)?;
        CoreError::check_finite("noise covariance", covariance)?;
        let largest = covariance.iter().fold(0.0f64, |a, v| a.max(v.abs()));
        for i in 0..dim {
            for j in 0..i {
                let gap = covariance[i * dim + j] - covariance[j * dim + i];
                if gap.abs() > 1e-9 * largest {
                    return Err(CoreError::Parameter {
                        name: "noise covariance asymmetry",
                        value: gap,
                        range: "0: the matrix must be symmetric",
                    });
                }
            }
        }
        workspace.factor("noise covariance", dim, covariance)
    }

    /// Number of channels `d`.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// The covariance, row-major `d x d`.
    pub fn covariance(&self) -> &[f64] {
        &self.covariance
    }

    /// Standard deviation of channel `i`.
    ///
    /// # Panics
    /// If `i >= dim`.
    pub fn sd(&self, i: usize) -> f64 {
        self.covariance[i * self.dim + i].sqrt()
    }
}

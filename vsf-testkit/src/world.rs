use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use vsf_core::{CoreError, Noise, Observation, Scalar};

/// One sparse reading of a field: the contents of an [`Observation`] in `f64`, so that tests can relabel and rescale it.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Touched points, strictly increasing.
    pub points: Vec<u32>,
    /// One column `w` of `d` entries per touched point.
    pub columns: Vec<Vec<f64>>,
    /// The reading `tau`, `d` values.
    pub tau: Vec<f64>,
    /// Standard deviation of the noise of each channel.
    pub noise_sd: Vec<f64>,
}

impl Reading {
    /// The observation for a field of `field_len` points.
    ///
    /// # Errors
    /// As [`Observation::rebuild`] and [`Noise::per_channel`]; columns of another number or length.
    pub fn observation<T: Scalar>(&self, field_len: usize) -> Result<Observation<T>, CoreError> {
        CoreError::check_len("columns", self.columns.len(), self.points.len())?;
        for column in &self.columns {
            CoreError::check_len("column", column.len(), self.tau.len())?;
        }
        let mut obs = Observation::new(Noise::per_channel(&self.noise_sd)?);
        obs.rebuild(field_len, &self.points, &self.tau, |k, w| {
            w.copy_from_slice(&self.columns[k]);
        })?;
        Ok(obs)
    }
}

/// A world with a known answer: a true field `K >= 0` and sparse linear readings of it with Gaussian noise. The seed
/// determines all draws.
#[derive(Debug, Clone)]
pub struct LinearWorld {
    /// True stiffness of every point.
    pub stiffness: Vec<f64>,
    rng: Pcg64Mcg,
}

impl LinearWorld {
    /// A field of `n` points with `K_i ~ N(mean, sd²)`, negative values set to zero.
    pub fn new(n: usize, mean: f64, sd: f64, seed: u64) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let stiffness = (0..n)
            .map(|_| (mean + sd * normal(&mut rng)).max(0.0))
            .collect();
        Self { stiffness, rng }
    }

    /// A reading with `d` channels that touches `contacts` random points below `limit`. Entries of `W` are uniform in
    /// `[-weight, weight]`; the noise has standard deviation `noise_sd`.
    pub fn reading(
        &mut self,
        limit: usize,
        contacts: usize,
        d: usize,
        weight: f64,
        noise_sd: f64,
    ) -> Reading {
        let rng = &mut self.rng;
        let limit = limit.min(self.stiffness.len());
        let mut left = contacts.min(limit);
        let mut points = Vec::with_capacity(left);
        for p in 0..limit {
            if rng.random_range(0..limit - p) < left {
                points.push(p as u32);
                left -= 1;
            }
        }
        let columns: Vec<Vec<f64>> = points
            .iter()
            .map(|_| {
                (0..d)
                    .map(|_| weight * rng.random_range(-1.0..1.0))
                    .collect()
            })
            .collect();
        let tau = (0..d)
            .map(|i| {
                let touched = points.iter().zip(&columns);
                let signal: f64 = touched
                    .map(|(&p, w)| w[i] * self.stiffness[p as usize])
                    .sum();
                signal + noise_sd * normal(rng)
            })
            .collect();
        Reading {
            points,
            columns,
            tau,
            noise_sd: vec![noise_sd; d],
        }
    }
}

/// Draws a standard normal number (Box and Muller, doi 10.1214/aoms/1177706645).
pub fn normal(rng: &mut Pcg64Mcg) -> f64 {
    let radius = (-2.0 * (1.0 - rng.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.random::<f64>()).cos()
}

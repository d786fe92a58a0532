use vsf_core::{CoreError, Observation, Scalar, SymmetricFactor, UpdateReport};

/// What a Gaussian belief did not know of a reading: `r = tau - W mu` and `S = W P W^T + R`.
#[derive(Debug, Clone, Default)]
pub(super) struct Innovation {
    pub(super) residual: Vec<f64>,
    /// `S`, row-major, lower triangle.
    covariance: Vec<f64>,
    factor: SymmetricFactor,
    /// `L^-1 r` with `L L^T = S`.
    pub(super) whitened: Vec<f64>,
    column: Vec<f64>,
    inverse: Vec<f64>,
}

impl Innovation {
    /// From the mean of contact `k` and row `k` of `P W^T`, written by `row(k, d values)`.
    ///
    /// # Errors
    /// Numbers that overflow, a covariance that is not positive definite.
    pub(super) fn measure<T: Scalar>(
        &mut self,
        obs: &Observation<T>,
        mean: impl Fn(usize) -> f64,
        mut row: impl FnMut(usize, &mut [f64]),
    ) -> Result<(), CoreError> {
        let d = obs.dim();
        residual(obs, mean, &mut self.residual);
        CoreError::check_finite("residual", &self.residual)?;
        self.covariance.clear();
        self.covariance.extend_from_slice(obs.noise().covariance());
        self.column.resize(d, 0.0);
        for k in 0..obs.len() {
            row(k, &mut self.column);
            for (i, to) in self.covariance.chunks_exact_mut(d.max(1)).enumerate() {
                let w = obs.row(i)[k].to_f64();
                for (to, y) in to.iter_mut().zip(&self.column).take(i + 1) {
                    *to += w * y;
                }
            }
        }
        self.factor
            .factor("innovation covariance", d, &self.covariance)?;
        self.whitened.clone_from(&self.residual);
        self.factor.solve_lower(&mut self.whitened);
        CoreError::check_finite("whitened residual", &self.whitened)
    }

    /// Replaces `r` by `L^-1 r`.
    pub(super) fn whiten(&self, r: &mut [f64]) {
        self.factor.solve_lower(r);
    }

    /// `L^-1`, row-major.
    pub(super) fn whitening(&mut self) -> &[f64] {
        self.factor.inverse_lower(&mut self.inverse);
        &self.inverse
    }

    /// What can be said before the belief is projected.
    pub(super) fn report<T: Scalar>(&self, obs: &Observation<T>) -> UpdateReport {
        UpdateReport::from_innovation(
            obs.len(),
            &self.residual,
            &self.whitened,
            self.factor.log_det(),
        )
    }
}

/// `tau - W x` for values `x(k)` of the contacts.
pub(super) fn residual<T: Scalar>(
    obs: &Observation<T>,
    x: impl Fn(usize) -> f64,
    out: &mut Vec<f64>,
) {
    out.clear();
    out.extend(obs.reading().iter().enumerate().map(|(i, tau)| {
        let row = obs.row(i).iter().enumerate();
        tau.to_f64() - row.map(|(k, w)| w.to_f64() * x(k)).sum::<f64>()
    }));
}

pub(super) fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}

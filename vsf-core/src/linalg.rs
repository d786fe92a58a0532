use crate::CoreError;

/// Cholesky factor of a small symmetric positive definite matrix, for `d x d` systems in the
/// real-time path.
///
/// The memory is reused: nothing is allocated after the first use at a given size.
///
/// ```
/// use vsf_core::SymmetricFactor;
/// let mut s = SymmetricFactor::default();
/// s.factor("S", 2, &[4.0, 2.0, 2.0, 3.0])?;
/// let mut x = [8.0, 7.0];
/// s.solve(&mut x);
/// assert!((x[0] - 1.25).abs() < 1e-15 && (x[1] - 1.5).abs() < 1e-15);
/// # Ok::<(), vsf_core::CoreError>(())
/// ```
#[derive(Debug, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::state::FactorParts")
)]
pub struct SymmetricFactor {
    dim: usize,
    lower: Vec<f64>,
}

impl Clone for SymmetricFactor {
    fn clone(&self) -> Self {
        Self {
            dim: self.dim,
            lower: self.lower.clone(),
        }
    }

    /// Copies into the existing memory.
    fn clone_from(&mut self, source: &Self) {
        self.dim = source.dim;
        self.lower.clone_from(&source.lower);
    }
}

impl SymmetricFactor {
    /// Takes over the factor `L` itself, row-major `dim x dim`. The upper triangle is never read.
    ///
    /// # Errors
    /// A wrong length, numbers that are not finite, or a diagonal entry that is not positive.
    #[cfg(feature = "serde")]
    pub(crate) fn from_lower(dim: usize, lower: Vec<f64>) -> Result<Self, CoreError> {
        CoreError::check_len("Cholesky factor", lower.len(), dim.saturating_mul(dim))?;
        CoreError::check_finite("Cholesky factor", &lower)?;
        for pivot in 0..dim {
            let value = lower[pivot * dim + pivot];
            if value <= 0.0 {
                return Err(CoreError::NotPositiveDefinite {
                    what: "Cholesky factor",
                    pivot,
                    value,
                });
            }
        }
        Ok(Self { dim, lower })
    }

    /// Factors the row-major `dim x dim` matrix `a = L L^T`. Only its lower triangle is read. Errors
    /// refer to the matrix as `what`.
    ///
    /// # Errors
    /// [`CoreError::Length`] for a wrong size, [`CoreError::NotPositiveDefinite`] otherwise. The
    /// factor is then unusable until the next successful call.
    pub fn factor(&mut self, what: &'static str, dim: usize, a: &[f64]) -> Result<(), CoreError> {
        CoreError::check_len(what, a.len(), dim.saturating_mul(dim))?;
        self.dim = dim;
        self.lower.clear();
        self.lower.extend_from_slice(a);
        let l = &mut self.lower;
        for j in 0..dim {
            for i in j..dim {
                let mut s = l[i * dim + j];
                for k in 0..j {
                    s -= l[i * dim + k] * l[j * dim + k];
                }
                if i == j {
                    if !(s > 0.0 && s.is_finite()) {
                        return Err(CoreError::NotPositiveDefinite {
                            what,
                            pivot: j,
                            value: s,
                        });
                    }
                    l[j * dim + j] = s.sqrt();
                } else {
                    l[i * dim + j] = s / l[j * dim + j];
                }
            }
        }
        Ok(())
    }

    /// Solves `L y = b` in place (whitening).
    ///
    /// # Panics
    /// If `b` is shorter than the factored dimension.
    pub fn solve_lower(&self, b: &mut [f64]) {
        let n = self.dim;
        for i in 0..n {
            let row = &self.lower[i * n..];
            let done: f64 = row.iter().zip(&b[..i]).map(|(l, x)| l * x).sum();
            b[i] = (b[i] - done) / row[i];
        }
    }

    /// Solves `A x = b` in place.
    ///
    /// # Panics
    /// If `b` is shorter than the factored dimension.
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_lower(b);
        let n = self.dim;
        for i in (0..n).rev() {
            b[i] /= self.lower[i * n + i];
            let (above, solved) = b.split_at_mut(i);
            for (y, l) in above.iter_mut().zip(&self.lower[i * n..]) {
                *y -= l * solved[0];
            }
        }
    }

    /// Writes `L^-1` to `out`, row-major `dim x dim` with zeros above the diagonal, reusing its memory.
    pub fn inverse_lower(&self, out: &mut Vec<f64>) {
        let n = self.dim;
        out.clear();
        out.resize(n * n, 0.0);
        for i in 0..n {
            let row = &self.lower[i * n..];
            out[i * n + i] = 1.0 / row[i];
            for j in 0..i {
                let left = (j..i).fold(0.0, |left, k| left - row[k] * out[k * n + j]);
                out[i * n + j] = left / row[i];
            }
        }
    }

    /// Dimension of the factored matrix.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// `log det A`.
    pub fn log_det(&self) -> f64 {
        (0..self.dim)
            .map(|i| 2.0 * self.lower[i * self.dim + i].ln())
            .sum()
    }
}

use super::dense::Cholesky;
use super::equations::NONE;
use faer::Mat;
use std::fmt::Debug;
use std::sync::OnceLock;
use vsf_core::CoreError;

/// What the optimum minimizes over the touched points, `x^T H x / 2 - b^T x` up to a constant,
/// with `H = W^T R^-1 W + C^-1` times the square of the noise scale.
///
/// Two implementations: by points, where `H` is a matrix, and by rows, where it is `W` and the
/// prior, for fewer rows than points.
pub(super) trait Quadratic: Debug + Send + Sync {
    /// `H_ii`.
    fn diagonal(&self) -> &[f64];
    /// `b`.
    fn linear(&self) -> &[f64];
    /// `H x - b`.
    fn gradient(&self, x: &[f64]) -> Vec<f64>;
    /// Coordinate descent from zero within `x >= 0`.
    fn descend(&self, sweeps: usize) -> Vec<f64>;

    /// Factors the problem of the free unknowns, the others held at zero.
    fn factor(&self, free: Vec<usize>) -> Result<Factor, CoreError>;
    /// Its minimizer.
    fn minimizer(&self, factor: &Factor) -> Vec<f64>;
    /// The minimizer for other free unknowns with an old factor, `None` where a new one is cheaper.
    fn minimizer_near(&self, _factor: &Factor, _free: &[bool]) -> Option<Vec<f64>> {
        None
    }
    /// `log det H_FF` of the free unknowns.
    fn log_det(&self, factor: &Factor) -> f64;

    /// `(H_FF^-1)_ii` of every free unknown, `(H_GG^-1)_ii` with `G` the free ones and `i` of
    /// every other.
    fn variances(&self, factor: &Factor) -> Vec<f64>;
    /// `v^T H_FF^-1 v`, where row `k` of `v` belongs to unknown `slots[k]`.
    fn spread(&self, factor: &Factor, slots: &[usize], v: &Mat<f64>) -> Mat<f64>;
    /// Takes out the rows `W_s` of sequence `s` for the same free unknowns:
    /// `log det(I - W_s H_FF^-1 W_s^T)` and the minimizer without them.
    fn leave_out(&self, factor: &Factor, s: usize, x: &[f64])
    -> Result<(f64, Vec<f64>), CoreError>;
}

/// The factorized problem of some free unknowns.
#[derive(Debug)]
pub(super) struct Factor {
    pub(super) free: Vec<usize>,
    /// Place of an unknown in `free`.
    pub(super) place: Vec<u32>,
    pub(super) cholesky: Cholesky,
    inverse: OnceLock<Mat<f64>>,
}

impl Factor {
    pub(super) fn new(unknowns: usize, free: Vec<usize>, cholesky: Cholesky) -> Self {
        let mut place = vec![NONE; unknowns];
        for (k, &i) in free.iter().enumerate() {
            place[i] = k as u32;
        }
        Self {
            free,
            place,
            cholesky,
            inverse: OnceLock::new(),
        }
    }

    /// Inverse of what was factored, computed at its first use.
    pub(super) fn inverse(&self) -> &Mat<f64> {
        if let Some(inverse) = self.inverse.get() {
            return inverse;
        }
        // Outside of `get_or_init`: a thread that waits for the others there may be given another task that asks
        // for the inverse, and would wait for itself.
        let inverse = self.cholesky.inverse();
        self.inverse.get_or_init(|| inverse)
    }
}

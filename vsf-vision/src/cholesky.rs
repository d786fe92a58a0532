//! The dense factor of the Gaussian process, the only place in this crate that uses faer. It runs on one
//! thread, so that the same bits come out wherever it runs.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::triangular_solve::{
    solve_lower_triangular_in_place, solve_upper_triangular_in_place,
};
use faer::{Mat, Par, Spec};
use vsf_core::CoreError;

/// `A = L L^T`.
#[derive(Clone)]
pub(crate) struct Cholesky(Mat<f64>);

impl Cholesky {
    /// Factors the matrix with the entries `a(i, j)`.
    pub(crate) fn new(n: usize, a: impl Fn(usize, usize) -> f64) -> Result<Self, CoreError> {
        let mut lower = Mat::from_fn(n, n, |i, j| if i >= j { a(i, j) } else { 0.0 });
        let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let regularization = Default::default();
        match cholesky_in_place(
            lower.as_mut(),
            regularization,
            Par::Seq,
            stack,
            Spec::default(),
        ) {
            Ok(_) => Ok(Self(lower)),
            Err(LltError::NonPositivePivot { index: pivot }) => {
                Err(CoreError::NotPositiveDefinite {
                    what: "kernel matrix",
                    pivot,
                    value: lower[(pivot, pivot)],
                })
            }
        }
    }

    fn dim(&self) -> usize {
        self.0.nrows()
    }

    pub(crate) fn log_det(&self) -> f64 {
        (0..self.dim()).map(|i| 2.0 * self.0[(i, i)].ln()).sum()
    }

    /// `A^-1 b`.
    pub(crate) fn solve(&self, b: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(self.dim(), 1, |i, _| b[i]);
        solve_lower_triangular_in_place(self.0.as_ref(), x.as_mut(), Par::Seq);
        solve_upper_triangular_in_place(self.0.transpose(), x.as_mut(), Par::Seq);
        x.col_as_slice(0).to_vec()
    }

    /// `|L^-1 b_j|²` for the `columns` vectors with the entries `b(i, j)`.
    pub(crate) fn whitened_squares(
        &self,
        columns: usize,
        b: impl Fn(usize, usize) -> f64,
    ) -> Vec<f64> {
        let mut x = Mat::from_fn(self.dim(), columns, b);
        solve_lower_triangular_in_place(self.0.as_ref(), x.as_mut(), Par::Seq);
        let squares = |j| x.col_as_slice(j).iter().map(|v| v * v).sum();
        (0..columns).map(squares).collect()
    }
}

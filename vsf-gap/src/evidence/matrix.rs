//! Products of dense matrices, and covariances in factors.

use crate::GapError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::{Accum, Mat, Par};
use std::ops::Range;
use vsf_core::CoreError;

/// Rows of a band in [`add_outer`].
const BAND: usize = 64;

/// A factored covariance.
pub(crate) struct Factor(Mat<f64>);

impl Factor {
    /// Of a covariance, by its lower triangle.
    ///
    /// # Errors
    /// A matrix that is not positive definite.
    pub(crate) fn new(mut a: Mat<f64>) -> Result<Self, GapError> {
        let scratch = cholesky_in_place_scratch::<f64>(a.nrows(), Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        let stack = MemStack::new(&mut memory);
        let factored = cholesky_in_place(
            a.as_mut(),
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        );
        if let Err(LltError::NonPositivePivot { index: pivot }) = factored {
            return Err(GapError::from(CoreError::NotPositiveDefinite {
                what: "the covariance of the readings",
                pivot,
                value: a[(pivot, pivot)],
            }));
        }
        Ok(Self(a))
    }

    /// Whitens every column in place: `L^-1 x`.
    pub(crate) fn whiten(&self, x: &mut Mat<f64>) {
        triangular_solve::solve_lower_triangular_in_place(self.0.as_ref(), x.as_mut(), Par::Seq);
    }

    /// `x` of `C x = b`.
    pub(crate) fn solved(&self, b: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(b.len(), 1, |i, _| b[i]);
        self.solve(&mut x);
        x.col_as_slice(0).to_vec()
    }

    /// Solves `C x = b` for every column in place.
    pub(crate) fn solve(&self, x: &mut Mat<f64>) {
        self.whiten(x);
        triangular_solve::solve_upper_triangular_in_place(self.0.transpose(), x.as_mut(), Par::Seq);
    }

    /// `log det C`.
    pub(crate) fn log_det(&self) -> f64 {
        (0..self.0.nrows()).map(|i| 2.0 * self.0[(i, i)].ln()).sum()
    }
}

/// `A A^T`; above the diagonal it is not complete.
pub(crate) fn outer(a: &Mat<f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), a.nrows());
    add_outer(&mut out, a, 1.0);
    out
}

/// Adds `sign A A^T` on and below the diagonal. Neighboring rows touch the same few points: of two bands of rows
/// only the columns count that are not zero in both.
pub(super) fn add_outer(to: &mut Mat<f64>, a: &Mat<f64>, sign: f64) {
    let n = a.nrows();
    let touched = |rows: &Range<usize>| -> Vec<usize> {
        let is_touched = |k: &usize| a.col_as_slice(*k)[rows.clone()].iter().any(|v| *v != 0.0);
        (0..a.ncols()).filter(is_touched).collect()
    };
    let bands: Vec<(Range<usize>, Vec<usize>)> = (0..n)
        .step_by(BAND)
        .map(|start| start..(start + BAND).min(n))
        .map(|rows| (rows.clone(), touched(&rows)))
        .collect();
    for (i, (columns, here)) in bands.iter().enumerate() {
        let mut is_here = vec![false; a.ncols()];
        here.iter().for_each(|&k| is_here[k] = true);
        for (rows, there) in &bands[i..] {
            let shared: Vec<usize> = there.iter().copied().filter(|&k| is_here[k]).collect();
            if shared.is_empty() {
                continue;
            }
            let part = |rows: &Range<usize>| {
                let mut part = Mat::zeros(rows.len(), shared.len());
                for (to, &k) in shared.iter().enumerate() {
                    let from = &a.col_as_slice(k)[rows.clone()];
                    part.col_as_slice_mut(to).copy_from_slice(from);
                }
                part
            };
            matmul(
                to.submatrix_mut(rows.start, columns.start, rows.len(), columns.len()),
                Accum::Add,
                &part(rows),
                part(columns).transpose(),
                sign,
                Par::Seq,
            );
        }
    }
}

/// `A x` of a column-major matrix.
pub(crate) fn times(a: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    let mut out = Mat::zeros(a.nrows(), 1);
    let x = Mat::from_fn(x.len(), 1, |i, _| x[i]);
    matmul(
        out.as_mut(),
        Accum::Replace,
        a.as_ref(),
        x.as_ref(),
        1.0,
        Par::Seq,
    );
    out.col_as_slice(0).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns that are zero but for some rows, as of points that are touched for a while, every third for a long one.
    fn sparse(rows: usize, columns: usize) -> Mat<f64> {
        Mat::from_fn(rows, columns, |i, k| {
            let from = 37 * k % rows;
            let inside = match k % 3 {
                2 => (from..from + 110).contains(&i),
                _ => (from..from + 5 + k).contains(&i) && !(64..128).contains(&i),
            };
            if inside {
                (i as f64 - 2.0 * k as f64).sin()
            } else {
                0.0
            }
        })
    }

    #[test]
    fn bands_add_up_to_the_outer_product() {
        for (rows, columns) in [(0, 0), (5, 0), (63, 4), (150, 30), (192, 7)] {
            let a = sparse(rows, columns);
            let mut found = Mat::from_fn(rows, rows, |i, j| (i + j) as f64);
            add_outer(&mut found, &a, -1.0);
            for i in 0..rows {
                for j in 0..=i {
                    let product: f64 = (0..columns).map(|k| a[(i, k)] * a[(j, k)]).sum();
                    let expected = (i + j) as f64 - product;
                    assert!((found[(i, j)] - expected).abs() < 1e-11, "{rows}: {i}, {j}");
                }
            }
        }
    }
}

//! Products of dense matrices, and factored covariances.

use crate::GapError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::{Accum, Mat, MatRef, Par};
use std::ops::Range;
use vsf_core::CoreError;

/// Rows of a band in [`add_outer`].
const BAND: usize = 64;

/// A factored covariance, in blocks of rows that are independent of each other.
pub(crate) struct Factor {
    lower: Mat<f64>,
    blocks: Vec<Range<usize>>,
}

impl Factor {
    /// Factors a covariance, given by its lower triangle.
    ///
    /// # Errors
    /// A matrix that is not positive definite.
    pub(crate) fn new(covariance: Mat<f64>) -> Result<Self, GapError> {
        let all = 0..covariance.nrows();
        Self::of_blocks(covariance, vec![all])
    }

    /// Factors a covariance that is zero except for blocks along its diagonal.
    ///
    /// # Errors
    /// A matrix that is not positive definite.
    pub(crate) fn of_blocks(
        mut covariance: Mat<f64>,
        blocks: Vec<Range<usize>>,
    ) -> Result<Self, GapError> {
        let most = blocks.iter().map(Range::len).max().unwrap_or(0);
        let scratch = cholesky_in_place_scratch::<f64>(most, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        for block in &blocks {
            let (start, rows) = (block.start, block.len());
            let factored = cholesky_in_place(
                covariance.submatrix_mut(start, start, rows, rows),
                Default::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Default::default(),
            );
            if let Err(LltError::NonPositivePivot { index }) = factored {
                let pivot = start + index;
                return Err(GapError::from(CoreError::NotPositiveDefinite {
                    what: "the covariance of the readings",
                    pivot,
                    value: covariance[(pivot, pivot)],
                }));
            }
        }
        Ok(Self {
            lower: covariance,
            blocks,
        })
    }

    /// The lower triangles of the blocks, each with its rows.
    fn parts(&self) -> impl Iterator<Item = (MatRef<'_, f64>, &Range<usize>)> {
        let part = |rows: &Range<usize>| {
            let (start, len) = (rows.start, rows.len());
            self.lower.submatrix(start, start, len, len)
        };
        self.blocks.iter().map(move |rows| (part(rows), rows))
    }

    /// Whitens every column in place: `L^-1 x`.
    pub(crate) fn whiten(&self, x: &mut Mat<f64>) {
        for (lower, rows) in self.parts() {
            let own = x.subrows_mut(rows.start, rows.len());
            triangular_solve::solve_lower_triangular_in_place(lower, own, Par::Seq);
        }
    }

    /// Solves `C x = b`.
    pub(crate) fn solved(&self, b: &[f64]) -> Vec<f64> {
        let mut x = Mat::from_fn(b.len(), 1, |i, _| b[i]);
        self.solve(&mut x);
        x.col_as_slice(0).to_vec()
    }

    /// Solves `C x = b` for every column in place.
    pub(crate) fn solve(&self, x: &mut Mat<f64>) {
        self.whiten(x);
        for (lower, rows) in self.parts() {
            let own = x.subrows_mut(rows.start, rows.len());
            triangular_solve::solve_upper_triangular_in_place(lower.transpose(), own, Par::Seq);
        }
    }

    /// `log det C`.
    pub(crate) fn log_det(&self) -> f64 {
        self.log_det_of(self.lower.nrows())
    }

    /// `log det C` of the first `rows` rows and columns.
    pub(crate) fn log_det_of(&self, rows: usize) -> f64 {
        let diagonal = (0..rows).map(|i| self.lower[(i, i)]);
        diagonal.map(|pivot| 2.0 * pivot.ln()).sum()
    }
}

/// `A A^T`; incomplete above the diagonal.
pub(crate) fn outer(a: &Mat<f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), a.nrows());
    add_outer(&mut out, a, 1.0);
    out
}

/// Adds `sign A A^T` on and below the diagonal. Neighboring rows touch the same few points, so for two bands of rows only
/// the columns that are not zero in both are multiplied.
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
#[allow(clippy::unwrap_used)]
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

    /// The same as of the whole.
    #[test]
    fn blocks_are_factored_on_their_own() {
        let blocks = vec![0..4, 4..5, 5..12];
        let of = |i: usize| blocks.iter().position(|b| b.contains(&i));
        let a = sparse(12, 40);
        let covariance = Mat::from_fn(12, 12, |i, j| {
            let product: f64 = (0..40).map(|k| a[(i, k)] * a[(j, k)]).sum();
            let noise = if i == j { 0.1 } else { 0.0 };
            if of(i) == of(j) { product + noise } else { 0.0 }
        });
        let whole = Factor::new(covariance.clone()).unwrap();
        let parts = Factor::of_blocks(covariance.clone(), blocks).unwrap();
        assert!((whole.log_det() - parts.log_det()).abs() < 1e-12);
        let b: Vec<f64> = (0..12).map(|i| f64::from(i).cos()).collect();
        let (x, y) = (whole.solved(&b), parts.solved(&b));
        assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1e-10));

        let mut broken = covariance;
        broken[(7, 7)] = -1.0;
        let refused = Factor::of_blocks(broken, vec![0..4, 4..5, 5..12]).err();
        assert!(refused.unwrap().to_string().contains('7'));
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

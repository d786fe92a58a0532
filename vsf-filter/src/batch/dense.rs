//! The dense linear algebra of the batch estimator. Results do not depend on the number of threads.

use crate::cholesky::cholesky;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::{matmul, triangular_solve};
use faer::{Accum, Mat, MatRef, Par};
use vsf_core::CoreError;

/// Below this size a second thread is not worth it; and products with single vectors, which faer
/// sums in an order that depends on the threads, stay on one.
const PARALLEL: usize = 128;

/// Threads for work of this size: those of the current rayon pool.
fn threads(size: usize) -> Par {
    if size < PARALLEL {
        Par::Seq
    } else {
        Par::rayon(0)
    }
}

/// Cholesky factor `L L^T` of a symmetric positive definite matrix; above the diagonal anything.
#[derive(Debug, Clone)]
pub(super) struct Cholesky(Mat<f64>);

impl Cholesky {
    /// Factors `a` in its own memory, reading the lower triangle only.
    pub(super) fn new(what: &'static str, mut a: Mat<f64>) -> Result<Self, CoreError> {
        let par = threads(a.nrows());
        cholesky(what, &mut a, par)?;
        Ok(Self(a))
    }

    pub(super) fn dim(&self) -> usize {
        self.0.nrows()
    }

    pub(super) fn log_det(&self) -> f64 {
        (0..self.dim()).map(|i| 2.0 * self.0[(i, i)].ln()).sum()
    }

    /// Solves `A x = b` in place.
    pub(super) fn solve(&self, b: &mut [f64]) {
        // In a matrix of its own, whose alignment is always the same.
        let mut x = Mat::from_fn(self.dim(), 1, |i, _| b[i]);
        self.solve_lower(&mut x);
        self.solve_transposed(&mut x);
        b.copy_from_slice(x.col_as_slice(0));
    }

    /// Solves `L^T x = b` in place.
    pub(super) fn solve_upper(&self, b: &mut [f64]) {
        let mut x = Mat::from_fn(self.dim(), 1, |i, _| b[i]);
        self.solve_transposed(&mut x);
        b.copy_from_slice(x.col_as_slice(0));
    }

    fn solve_transposed(&self, x: &mut Mat<f64>) {
        let upper = self.0.transpose();
        triangular_solve::solve_upper_triangular_in_place(upper, x.as_mut(), Par::Seq);
    }

    /// Solves `L y = b` for every column in place.
    pub(super) fn solve_lower(&self, b: &mut Mat<f64>) {
        let par = threads(self.dim().min(b.ncols()));
        triangular_solve::solve_lower_triangular_in_place(self.0.as_ref(), b.as_mut(), par);
    }

    /// `A^-1`, both triangles.
    pub(super) fn inverse(&self) -> Mat<f64> {
        let (n, par) = (self.dim(), threads(self.dim()));
        let mut out = Mat::zeros(n, n);
        let mut memory = MemBuffer::new(llt::inverse::inverse_scratch::<f64>(n, par));
        let stack = MemStack::new(&mut memory);
        llt::inverse::inverse(out.as_mut(), self.0.as_ref(), par, stack);
        mirror(&mut out);
        out
    }
}

/// The lower triangle of `a a^T`; above the diagonal zeros.
pub(super) fn outer(a: MatRef<'_, f64>) -> Mat<f64> {
    let n = a.nrows();
    let mut out = Mat::zeros(n, n);
    triangular::matmul(
        out.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Replace,
        a,
        BlockStructure::Rectangular,
        a.transpose(),
        BlockStructure::Rectangular,
        1.0,
        threads(n),
    );
    out
}

/// `a b`.
pub(super) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    let par = threads(a.nrows().min(b.ncols()));
    matmul::matmul(out.as_mut(), Accum::Replace, a, b, 1.0, par);
    out
}

/// Copies the lower triangle to the upper one, block by block for the cache's sake.
pub(super) fn mirror(a: &mut Mat<f64>) {
    const BLOCK: usize = 32;
    let n = a.nrows();
    for top in (0..n).step_by(BLOCK) {
        for left in (0..=top).step_by(BLOCK) {
            for j in left..(left + BLOCK).min(n) {
                for i in top.max(j + 1)..(top + BLOCK).min(n) {
                    a[(j, i)] = a[(i, j)];
                }
            }
        }
    }
}

/// The rows and columns `set` of a symmetric matrix.
pub(super) fn principal(a: &Mat<f64>, set: &[usize]) -> Mat<f64> {
    let mut out = Mat::zeros(set.len(), set.len());
    for (k, &j) in set.iter().enumerate() {
        let from = a.col_as_slice(j);
        for (to, &i) in out.col_as_slice_mut(k).iter_mut().zip(set) {
            *to = from[i];
        }
    }
    out
}

/// `y += a x`.
pub(super) fn add_scaled(y: &mut [f64], a: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// Inner product, in several sums at once for the vector units' sake.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 16;
    let mut sums = [0.0; LANES];
    let (heads_a, tail_a) = a.as_chunks::<LANES>();
    let (heads_b, tail_b) = b.as_chunks::<LANES>();
    for (x, y) in heads_a.iter().zip(heads_b) {
        for ((s, x), y) in sums.iter_mut().zip(x).zip(y) {
            *s += x * y;
        }
    }
    let tail: f64 = tail_a.iter().zip(tail_b).map(|(x, y)| x * y).sum();
    sums.iter().sum::<f64>() + tail
}

/// Sum over the columns, `a x` for a matrix stored by columns.
pub(super) fn apply(a: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    let mut y = vec![0.0; a.nrows()];
    for (j, &x) in x.iter().enumerate().filter(|(_, x)| **x != 0.0) {
        add_scaled(&mut y, x, a.col_as_slice(j));
    }
    y
}

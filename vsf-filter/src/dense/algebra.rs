//! Dense linear algebra on one thread, so that the same bits come out wherever it runs.

use faer::linalg::matmul::matmul;
use faer::linalg::{triangular_inverse, triangular_solve};
use faer::{Accum, Mat, MatRef, Par};

pub(super) const PAR: Par = Par::Seq;

/// `a b`.
pub(super) fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut y = Mat::zeros(a.nrows(), b.ncols());
    add_product(&mut y, 1.0, a, b);
    y
}

/// `y += alpha a b`.
pub(super) fn add_product(y: &mut Mat<f64>, alpha: f64, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(y.as_mut(), Accum::Add, a, b, alpha, PAR);
}

/// `L^-1`, its upper triangle zero, of a lower triangle.
pub(super) fn inverse_lower(lower: &Mat<f64>) -> Mat<f64> {
    let mut inverse = Mat::zeros(lower.nrows(), lower.ncols());
    triangular_inverse::invert_lower_triangular(inverse.as_mut(), lower.as_ref(), PAR);
    inverse
}

/// Replaces `x` by `L^-1 x`.
pub(super) fn solve_lower(lower: &Mat<f64>, x: &mut Mat<f64>) {
    triangular_solve::solve_lower_triangular_in_place(lower.as_ref(), x.as_mut(), PAR);
}

/// Replaces `x` by `L^-T x`.
pub(super) fn solve_lower_transposed(lower: &Mat<f64>, x: &mut Mat<f64>) {
    triangular_solve::solve_upper_triangular_in_place(lower.transpose(), x.as_mut(), PAR);
}

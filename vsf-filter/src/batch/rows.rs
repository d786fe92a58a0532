use super::BatchMap;
use super::dense::{Cholesky, add_scaled, apply, dot, outer, principal, product};
use super::equations::NONE;
use super::points::WITHOUT;
use super::quadratic::{Factor, Quadratic};
use faer::Mat;
use vsf_core::CoreError;

/// The problem of independent points through its rows: `H = W^T W + ridge`, factored as
/// `S = I + W_F ridge_F^-1 W_F^T` (Woodbury).
#[derive(Debug)]
pub(super) struct ByRows<'a> {
    batch: &'a BatchMap<'a>,
    /// Whitened, one row per channel of every observation.
    w: &'a Mat<f64>,
    /// Whitened readings.
    tau: &'a [f64],
    ridge: Vec<f64>,
    mean: Vec<f64>,
    diagonal: Vec<f64>,
    linear: Vec<f64>,
}

impl<'a> ByRows<'a> {
    pub(super) fn new(
        batch: &'a BatchMap<'a>,
        (w, tau): (&'a Mat<f64>, &'a [f64]),
        ridge: Vec<f64>,
        mean: Vec<f64>,
        linear: Vec<f64>,
    ) -> Self {
        let square = |j: usize| dot(w.col_as_slice(j), w.col_as_slice(j));
        let diagonal = ridge.iter().enumerate();
        let diagonal = diagonal.map(|(j, r)| square(j) + r).collect();
        Self {
            batch,
            w,
            tau,
            ridge,
            mean,
            diagonal,
            linear,
        }
    }

    /// `tau - W x`.
    fn residual(&self, x: &[f64]) -> Vec<f64> {
        let predicted = apply(self.w, x);
        self.tau.iter().zip(predicted).map(|(t, p)| t - p).collect()
    }

    /// `mean + ridge^-1 W^T alpha` of the free unknowns: every minimizer has this form.
    fn represent(&self, factor: &Factor, alpha: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.ridge.len()];
        for &i in &factor.free {
            x[i] = self.mean[i] + dot(self.w.col_as_slice(i), alpha) / self.ridge[i];
        }
        x
    }
}

impl Quadratic for ByRows<'_> {
    fn diagonal(&self) -> &[f64] {
        &self.diagonal
    }

    fn linear(&self) -> &[f64] {
        &self.linear
    }

    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        let r = self.residual(x);
        let slope =
            |i: usize| self.ridge[i] * (x[i] - self.mean[i]) - dot(self.w.col_as_slice(i), &r);
        (0..x.len()).map(slope).collect()
    }

    fn descend(&self, sweeps: usize) -> Vec<f64> {
        let mut x = vec![0.0; self.ridge.len()];
        let mut r = self.tau.to_vec();
        for _ in 0..sweeps {
            for (i, x) in x.iter_mut().enumerate() {
                let w = self.w.col_as_slice(i);
                let slope = self.ridge[i] * (*x - self.mean[i]) - dot(w, &r);
                let step = (*x - slope / self.diagonal[i]).max(0.0) - *x;
                if step != 0.0 {
                    *x += step;
                    add_scaled(&mut r, -step, w);
                }
            }
        }
        x
    }

    fn factor(&self, free: Vec<usize>) -> Result<Factor, CoreError> {
        let scale: Vec<f64> = free.iter().map(|&i| 1.0 / self.ridge[i].sqrt()).collect();
        let mut scaled = Mat::zeros(self.tau.len(), free.len());
        for (k, &i) in free.iter().enumerate() {
            add_scaled(scaled.col_as_slice_mut(k), scale[k], self.w.col_as_slice(i));
        }
        let mut s = outer(scaled.as_ref());
        (0..s.nrows()).for_each(|k| s[(k, k)] += 1.0);
        let cholesky = Cholesky::new("covariance of the readings", s)?;
        Ok(Factor::new(self.ridge.len(), free, cholesky))
    }

    fn minimizer(&self, factor: &Factor) -> Vec<f64> {
        let mut start = vec![0.0; self.mean.len()];
        factor.free.iter().for_each(|&i| start[i] = self.mean[i]);
        let mut alpha = self.residual(&start);
        factor.cholesky.solve(&mut alpha);
        self.represent(factor, &alpha)
    }

    fn log_det(&self, factor: &Factor) -> f64 {
        let ridge: f64 = factor.free.iter().map(|&i| self.ridge[i].ln()).sum();
        factor.cholesky.log_det() + ridge
    }

    fn variances(&self, factor: &Factor) -> Vec<f64> {
        let mut white = self.w.clone();
        factor.cholesky.solve_lower(&mut white);
        let variance = |(i, &ridge): (usize, &f64)| {
            let known = dot(white.col_as_slice(i), white.col_as_slice(i)) / ridge;
            if factor.place[i] == NONE {
                1.0 / (ridge * (1.0 + known))
            } else {
                (1.0 - known).max(f64::EPSILON) / ridge
            }
        };
        self.ridge.iter().enumerate().map(variance).collect()
    }

    fn spread(&self, factor: &Factor, slots: &[usize], v: &Mat<f64>) -> Mat<f64> {
        let rows = (0..slots.len()).filter(|&k| factor.place[slots[k]] != NONE);
        let rows: Vec<usize> = rows.collect();
        let ridge = |k: usize| self.ridge[slots[rows[k]]];
        let scaled = Mat::from_fn(rows.len(), v.ncols(), |k, c| {
            v[(rows[k], c)] / ridge(k).sqrt()
        });
        let mut white = Mat::zeros(self.tau.len(), v.ncols());
        for c in 0..v.ncols() {
            for (k, &row) in rows.iter().enumerate() {
                let w = self.w.col_as_slice(slots[row]);
                add_scaled(white.col_as_slice_mut(c), v[(row, c)] / ridge(k), w);
            }
        }
        factor.cholesky.solve_lower(&mut white);
        product(scaled.transpose(), scaled.as_ref()) - product(white.transpose(), white.as_ref())
    }

    /// Leave-one-out from the inverse of `S`: C. E. Rasmussen, C. K. I. Williams, *Gaussian
    /// Processes for Machine Learning*, MIT Press 2006, eq. 5.12, by blocks.
    fn leave_out(
        &self,
        factor: &Factor,
        s: usize,
        x: &[f64],
    ) -> Result<(f64, Vec<f64>), CoreError> {
        let rows: Vec<usize> = self.batch.rows_of[s].clone().collect();
        let inverse = factor.inverse();
        let own = Cholesky::new(WITHOUT, principal(inverse, &rows))?;
        let mut alpha = self.residual(x);
        let mut error: Vec<f64> = rows.iter().map(|&k| alpha[k]).collect();
        own.solve(&mut error);
        for (&k, e) in rows.iter().zip(&error) {
            add_scaled(&mut alpha, -e, inverse.col_as_slice(k));
        }
        Ok((own.log_det(), self.represent(factor, &alpha)))
    }
}

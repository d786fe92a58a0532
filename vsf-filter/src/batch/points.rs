use super::BatchMap;
use super::dense::{Cholesky, add_scaled, apply, outer, principal, product};
use super::equations::{NONE, gram, panel, project};
use super::quadratic::{Factor, Quadratic};
use faer::Mat;
use std::borrow::Cow;
use vsf_core::{CoreError, Observation};

/// Columns solved at once.
const BLOCK: usize = 256;
/// An old factor serves while one in so many unknowns has changed.
const UNCHANGED: usize = 10;
/// The matrix that fails when rounding leaves nothing of the other sequences and the prior.
pub(super) const WITHOUT: &str = "posterior without the sequence";

/// The problem with `H` as a matrix.
#[derive(Debug)]
pub(super) struct ByPoints<'a> {
    batch: &'a BatchMap<'a>,
    /// `H` without `ridge`.
    matrix: Cow<'a, Mat<f64>>,
    /// What `H` has on its diagonal besides.
    ridge: Vec<f64>,
    diagonal: Vec<f64>,
    linear: Vec<f64>,
}

impl<'a> ByPoints<'a> {
    pub(super) fn new(
        batch: &'a BatchMap<'a>,
        matrix: Cow<'a, Mat<f64>>,
        ridge: Vec<f64>,
        linear: Vec<f64>,
    ) -> Self {
        let diagonal = ridge.iter().enumerate();
        let diagonal = diagonal.map(|(i, r)| matrix[(i, i)] + r).collect();
        Self {
            batch,
            matrix,
            ridge,
            diagonal,
            linear,
        }
    }

    /// `H` of some unknowns, lower triangle.
    fn part(&self, set: &[usize]) -> Mat<f64> {
        let mut part = Mat::zeros(set.len(), set.len());
        for (k, &j) in set.iter().enumerate() {
            self.gather(j, &set[k..], &mut part.col_as_slice_mut(k)[k..]);
            part[(k, k)] = self.diagonal[j];
        }
        part
    }

    /// Entries `set` of column `j` of the matrix.
    fn gather(&self, j: usize, set: &[usize], out: &mut [f64]) {
        let from = self.matrix.col_as_slice(j);
        for (to, &i) in out.iter_mut().zip(set) {
            *to = from[i];
        }
    }

    fn gather_linear(&self, set: &[usize], out: &mut [f64]) {
        out.iter_mut()
            .zip(set)
            .for_each(|(to, &i)| *to = self.linear[i]);
    }

    fn observations(&self, s: usize) -> impl Iterator<Item = &'a Observation<f64>> + use<'a> {
        self.batch.sequences[s].iter().filter(|o| !o.is_empty())
    }

    /// Where each point of the field stands among the free unknowns at `places`.
    fn order(&self, factor: &Factor, places: &[usize]) -> Vec<u32> {
        let mut order = vec![NONE; self.batch.slot.len()];
        for (k, &place) in places.iter().enumerate() {
            order[self.batch.points[factor.free[place]] as usize] = k as u32;
        }
        order
    }

    /// As [`Quadratic::leave_out`] with a system of the size of the sequence's rows: its touched
    /// `places`, the change of the minimizer there.
    fn leave_out_rows(
        &self,
        factor: &Factor,
        s: usize,
        x: &[f64],
        places: &[usize],
    ) -> Result<(f64, Vec<f64>), CoreError> {
        let observations: Vec<_> = self.observations(s).collect();
        let w = panel(
            &observations,
            &self.order(factor, places),
            places.len(),
            &mut self.batch.whitener(),
        )?;
        let gain = product(principal(factor.inverse(), places).as_ref(), w.as_ref());
        let mut kept = product(w.transpose(), gain.as_ref());
        for j in 0..kept.ncols() {
            kept.col_as_slice_mut(j).iter_mut().for_each(|v| *v = -*v);
            kept[(j, j)] += 1.0;
        }
        let kept = Cholesky::new(WITHOUT, kept)?;
        let mut error = self.batch.whitened_residuals(s, x)?;
        kept.solve(&mut error);
        let change = apply(&gain, &error).iter().map(|v| -v).collect();
        Ok((kept.log_det(), change))
    }

    /// The same with a system of the size of `places`: their precision, all others integrated
    /// out, less the sequence's share.
    fn leave_out_points(
        &self,
        factor: &Factor,
        s: usize,
        x: &[f64],
        places: &[usize],
    ) -> Result<(f64, Vec<f64>), CoreError> {
        let (mut precision, log_det) = if places.len() == factor.free.len() {
            (self.part(&factor.free), factor.cholesky.log_det())
        } else {
            let part = principal(factor.inverse(), places);
            let part = Cholesky::new("posterior covariance", part)?;
            (part.inverse(), -part.log_det())
        };
        let order = self.order(factor, places);
        let own = gram(
            self.observations(s),
            &order,
            places.len(),
            &mut self.batch.whitener(),
        )?;
        for j in 0..places.len() {
            add_scaled(precision.col_as_slice_mut(j), -1.0, own.col_as_slice(j));
        }
        let kept = Cholesky::new(WITHOUT, precision)?;
        let residual = |obs: &Observation<f64>, r: &mut [f64]| self.batch.subtract(obs, x, r);
        let mut change = project(
            self.observations(s),
            &order,
            places.len(),
            &mut self.batch.whitener(),
            residual,
        )?;
        kept.solve(&mut change);
        change.iter_mut().for_each(|v| *v = -*v);
        Ok((kept.log_det() - log_det, change))
    }
}

impl Quadratic for ByPoints<'_> {
    fn diagonal(&self) -> &[f64] {
        &self.diagonal
    }

    fn linear(&self) -> &[f64] {
        &self.linear
    }

    fn gradient(&self, x: &[f64]) -> Vec<f64> {
        let mut g = apply(&self.matrix, x);
        for (((g, r), x), b) in g.iter_mut().zip(&self.ridge).zip(x).zip(&self.linear) {
            *g += r * x - b;
        }
        g
    }

    fn descend(&self, sweeps: usize) -> Vec<f64> {
        let mut x = vec![0.0; self.linear.len()];
        // Without the ridge's part.
        let mut gradient: Vec<f64> = self.linear.iter().map(|b| -b).collect();
        for _ in 0..sweeps {
            for i in 0..x.len() {
                let slope = gradient[i] + self.ridge[i] * x[i];
                let step = (x[i] - slope / self.diagonal[i]).max(0.0) - x[i];
                if step != 0.0 {
                    x[i] += step;
                    add_scaled(&mut gradient, step, self.matrix.col_as_slice(i));
                }
            }
        }
        x
    }

    fn factor(&self, free: Vec<usize>) -> Result<Factor, CoreError> {
        let cholesky = Cholesky::new("normal equations", self.part(&free))?;
        Ok(Factor::new(self.linear.len(), free, cholesky))
    }

    fn minimizer(&self, factor: &Factor) -> Vec<f64> {
        let mut part = vec![0.0; factor.free.len()];
        self.gather_linear(&factor.free, &mut part);
        factor.cholesky.solve(&mut part);
        let mut x = vec![0.0; self.linear.len()];
        for (&i, v) in factor.free.iter().zip(part) {
            x[i] = v;
        }
        x
    }

    /// Solves `[H J E; J^T P 0; E^T 0 0] [x; z; y] = [b; c; 0]`. `H` belongs to the old unknowns `x`; `J`
    /// and `P` are the columns of the unknowns `z` that join. Unit columns `E` with the multipliers `y`
    /// hold those that leave at zero. With `H = L L^T`, the remaining system has the size of the changes.
    fn minimizer_near(&self, factor: &Factor, free: &[bool]) -> Option<Vec<f64>> {
        let old = &factor.free;
        let leaving: Vec<usize> = (0..old.len()).filter(|&k| !free[old[k]]).collect();
        let joins = |i: &usize| free[*i] && factor.place[*i] == NONE;
        let joining: Vec<usize> = (0..free.len()).filter(joins).collect();
        let k = leaving.len();
        if UNCHANGED * (k + joining.len()) > old.len() {
            return None;
        }
        // L^-1 J and L^-1 [E b].
        let mut join = Mat::zeros(old.len(), joining.len());
        for (c, &i) in joining.iter().enumerate() {
            self.gather(i, old, join.col_as_slice_mut(c));
        }
        factor.cholesky.solve_lower(&mut join);
        let mut right = Mat::zeros(old.len(), k + 1);
        leaving
            .iter()
            .enumerate()
            .for_each(|(c, &place)| right[(place, c)] = 1.0);
        self.gather_linear(old, right.col_as_slice_mut(k));
        factor.cholesky.solve_lower(&mut right);
        // The old unknowns eliminated, the joining ones next: M^-1 [Q r], M M^T = P - J^T H^-1 J.
        let pivot = self.part(&joining) - outer(join.transpose());
        let pivot = Cholesky::new("joining unknowns", pivot).ok()?;
        let mut cross = product(join.transpose(), right.as_ref());
        for (c, &i) in joining.iter().enumerate() {
            cross[(c, k)] = self.linear[i] - cross[(c, k)];
        }
        pivot.solve_lower(&mut cross);
        // The multipliers, and back.
        let first = product(right.transpose(), right.as_ref());
        let second = product(cross.transpose(), cross.as_ref());
        let held = Mat::from_fn(k, k, |i, j| first[(i, j)] + second[(i, j)]);
        let mut y: Vec<f64> = (0..k).map(|i| first[(i, k)] - second[(i, k)]).collect();
        Cholesky::new("leaving unknowns", held).ok()?.solve(&mut y);
        let mut z = cross.col_as_slice(k).to_vec();
        let mut x = right.col_as_slice(k).to_vec();
        for (c, &y) in y.iter().enumerate() {
            add_scaled(&mut z, y, cross.col_as_slice(c));
            add_scaled(&mut x, -y, right.col_as_slice(c));
        }
        pivot.solve_upper(&mut z);
        for (c, &z) in z.iter().enumerate() {
            add_scaled(&mut x, -z, join.col_as_slice(c));
        }
        factor.cholesky.solve_upper(&mut x);
        let mut out = vec![0.0; free.len()];
        let kept = old.iter().zip(x).chain(joining.iter().zip(z));
        for (&i, v) in kept.filter(|(i, _)| free[**i]) {
            out[i] = v;
        }
        Some(out)
    }

    fn log_det(&self, factor: &Factor) -> f64 {
        factor.cholesky.log_det()
    }

    fn variances(&self, factor: &Factor) -> Vec<f64> {
        let mut out = vec![0.0; self.linear.len()];
        let inverse = factor.inverse();
        for (k, &i) in factor.free.iter().enumerate() {
            out[i] = inverse[(k, k)];
        }
        // The others by their Schur complements H_ii - H_iF H_FF^-1 H_Fi.
        let held = (0..out.len()).filter(|&i| factor.place[i] == NONE);
        for block in held.collect::<Vec<_>>().chunks(BLOCK) {
            let mut cross = Mat::zeros(factor.free.len(), block.len());
            for (k, &i) in block.iter().enumerate() {
                self.gather(i, &factor.free, cross.col_as_slice_mut(k));
            }
            factor.cholesky.solve_lower(&mut cross);
            for (k, &i) in block.iter().enumerate() {
                let known: f64 = cross.col_as_slice(k).iter().map(|v| v * v).sum();
                let left = self.diagonal[i] - known;
                out[i] = 1.0 / left.max(f64::EPSILON * self.diagonal[i]);
            }
        }
        out
    }

    fn spread(&self, factor: &Factor, slots: &[usize], v: &Mat<f64>) -> Mat<f64> {
        let rows = (0..slots.len()).filter(|&k| factor.place[slots[k]] != NONE);
        let rows: Vec<usize> = rows.collect();
        let places: Vec<usize> = rows
            .iter()
            .map(|&k| factor.place[slots[k]] as usize)
            .collect();
        let v = Mat::from_fn(rows.len(), v.ncols(), |k, c| v[(rows[k], c)]);
        let part = if places.len() < factor.free.len() {
            &principal(factor.inverse(), &places)
        } else {
            factor.inverse()
        };
        product(v.transpose(), product(part.as_ref(), v.as_ref()).as_ref())
    }

    fn leave_out(
        &self,
        factor: &Factor,
        s: usize,
        x: &[f64],
    ) -> Result<(f64, Vec<f64>), CoreError> {
        let mut touched = vec![false; self.batch.slot.len()];
        for &p in self.observations(s).flat_map(Observation::points) {
            touched[p as usize] = true;
        }
        let is_touched = |k: &usize| touched[self.batch.points[factor.free[*k]] as usize];
        let mut places: Vec<usize> = (0..factor.free.len()).filter(is_touched).collect();
        let rows: usize = self.observations(s).map(Observation::dim).sum();
        let (log_det, change) = if rows <= places.len() {
            self.leave_out_rows(factor, s, x, &places)?
        } else {
            // To integrate few points out costs more than to take them along.
            if 4 * places.len().pow(3) > factor.free.len().pow(3) {
                places = (0..factor.free.len()).collect();
            }
            self.leave_out_points(factor, s, x, &places)?
        };
        let mut without = x.to_vec();
        for (&k, v) in places.iter().zip(change) {
            without[factor.free[k]] += v;
        }
        Ok((log_det, without))
    }
}

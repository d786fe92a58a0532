//! Gaussian models of readings over windows: what the stiffness, the noise and the model's own
//! roughness let a reading vary, and how well an effect explains the rest.

use crate::GapError;
use crate::effect::RandomWalk;
use crate::windows::{Design, Windows};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::{Accum, Mat, Par};
use nalgebra::{DMatrix, DVector, Point3};
use std::ops::Range;

/// Edge of the cells (m) over which stiffness varies smoothly.
const CELL: f64 = 0.04;
/// Times (s) over which the model's roughness persists: of contact, and of joints.
const CONTACT_TIMES: [f64; 3] = [0.05, 0.3, 3.0];
const JOINT_TIMES: [f64; 2] = [0.5, 5.0];
/// Most rounds per parameter of a fit within bounds, and the slope at a bound (square root of nats) that is rounding.
const ROUNDS: usize = 20;
const LEVEL_SLOPE: f64 = 1e-9;
/// Rows of a band in [`add_outer`].
const BAND: usize = 64;

/// Sizes of what readings vary by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Spread {
    /// Standard deviation of each point's stiffness on its own (N/m).
    pub(crate) point: f64,
    /// Standard deviation of the part of the stiffness that is smooth over 4 cm (N/m).
    pub(crate) smooth: f64,
    /// Standard deviation of the common level of the stiffness (N/m).
    pub(crate) level: f64,
    /// Roughness of contact: unexplained force as a share of the force.
    pub(crate) contact: f64,
    /// Roughness of joints: unexplained torque as a share of each joint's RMS torque.
    pub(crate) joint: f64,
    /// The same of what does not persist from window to window.
    pub(crate) white: f64,
    /// Random walks of the model's effects, in their own sizes ([`RandomWalk`]).
    pub(crate) walk: f64,
}

/// The parts of the covariance of a design, ready to be put together for any [`Spread`].
pub(crate) struct Parts {
    windows: Windows,
    points: Mat<f64>,
    smooth: Mat<f64>,
    level: Vec<f64>,
    lever: Mat<f64>,
    errors: Errors,
}

/// What readings are off by, whatever is touched.
pub(crate) struct Errors {
    /// Covariance of the noise of the rows, lower triangle where it matters ([`Windows::noise`]).
    pub(crate) noise: Vec<(usize, usize, f64)>,
    /// How far the zero of every row is off ([`Windows::zeros`]).
    pub(crate) zeros: Vec<f64>,
    /// RMS reading per joint (N m or N).
    pub(crate) joint_rms: Vec<f64>,
    /// What the model's effects stray by.
    pub(crate) walks: Vec<RandomWalk>,
    /// When the sequence of every motion begins, by the session's clock (s): the same of parts of one sequence.
    pub(crate) begins: Vec<f64>,
    /// Whether its readings are relative to its begin.
    pub(crate) tared: Vec<bool>,
}

/// A factored covariance.
pub(crate) struct Factor(Mat<f64>);

impl Parts {
    /// Gathers the parts; `lever` is that of [`crate::Campaign::lever`].
    pub(crate) fn new(
        design: &Design,
        rest: &[Point3<f64>],
        windows: &Windows,
        lever: Mat<f64>,
        errors: Errors,
    ) -> Self {
        let (smooth, level) = common(design, rest);
        Self {
            windows: windows.clone(),
            points: outer(&design.w),
            smooth,
            level,
            lever,
            errors,
        }
    }

    /// Takes points out: `design` holds the points that are left, `out` the columns of those that are not.
    pub(crate) fn leave_out(&mut self, out: &Mat<f64>, design: &Design, rest: &[Point3<f64>]) {
        add_outer(&mut self.points, out, -1.0);
        (self.smooth, self.level) = common(design, rest);
    }

    /// Whether an effect of the model strays.
    pub(crate) fn walks(&self) -> bool {
        !self.errors.walks.is_empty()
    }

    /// Torques of a field of 1 N/m everywhere.
    pub(crate) fn unit_field(&self) -> &[f64] {
        &self.level
    }

    /// The covariance of the readings, factored.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn factor(&self, spread: &Spread) -> Result<Factor, GapError> {
        Factor::new(self.covariance(spread))
    }

    /// The covariance of the readings, lower triangle.
    pub(crate) fn covariance(&self, spread: &Spread) -> Mat<f64> {
        let n = self.windows.rows();
        let (d, errors) = (self.windows.joints, &self.errors);
        let (point, smooth, level) = (
            spread.point * spread.point,
            spread.smooth * spread.smooth,
            spread.level * spread.level,
        );
        let mut c = Mat::zeros(n, n);
        for col in 0..n {
            let (a, b, l) = (
                self.points.col_as_slice(col),
                self.smooth.col_as_slice(col),
                level * self.level[col],
            );
            let out = c.col_as_slice_mut(col);
            for row in col..n {
                out[row] = point * a[row] + smooth * b[row] + l * self.level[row];
            }
        }
        for &(row, col, value) in &self.errors.noise {
            c[(row, col)] += value;
        }
        let [contact, joint, white] = [spread.contact, spread.joint, spread.white].map(|s| s * s);
        for (i, w) in self.windows.list.iter().enumerate() {
            for (k, v) in self.windows.list.iter().enumerate().skip(i) {
                if v.sequence != w.sequence {
                    break;
                }
                let dt = (v.clock - w.clock).abs();
                let fade = |times: &[f64]| {
                    times.iter().map(|t| (-dt / t).exp()).sum::<f64>() / times.len() as f64
                };
                let (of_contact, of_joint) =
                    (contact * fade(&CONTACT_TIMES), joint * fade(&JOINT_TIMES));
                for j in 0..d {
                    let col = i * d + j;
                    let at = |axis| self.lever[(col, axis)];
                    let arm = [at(0), at(1), at(2)];
                    for m in 0..d {
                        let row = k * d + m;
                        if row >= col {
                            let along: f64 =
                                (0..3).map(|axis| arm[axis] * self.lever[(row, axis)]).sum();
                            c[(row, col)] += of_contact * along;
                        }
                    }
                    let own = of_joint + if k == i { white } else { 0.0 };
                    let row = k * d + j;
                    c[(row, col)] += own * errors.joint_rms[j] * errors.joint_rms[j]
                        + errors.zeros[row] * errors.zeros[col];
                }
            }
        }
        if spread.walk > 0.0 {
            self.add_walks(spread.walk * spread.walk, &mut c);
        }
        c
    }

    /// Adds the covariance of the random walks: a variance times what two readings of a joint have walked together.
    fn add_walks(&self, variance: f64, c: &mut Mat<f64>) {
        let d = self.windows.joints;
        let Errors { begins, tared, .. } = &self.errors;
        let together = |a: f64, b: f64, begin: f64| (a.min(b) - begin).max(0.0);
        for walk in &self.errors.walks {
            for (i, w) in self.windows.list.iter().enumerate() {
                for (k, v) in self.windows.list.iter().enumerate().skip(i) {
                    let [begin, other] = [w, v].map(|of| begins[of.sequence]);
                    let sequence = match begin == other {
                        true => together(w.clock, v.clock, begin),
                        false => 0.0,
                    };
                    // What the session has walked before is in the tare.
                    let session = match tared[w.sequence] || tared[v.sequence] {
                        true => sequence,
                        false => together(w.clock, v.clock, 0.0),
                    };
                    for j in 0..d {
                        let size = walk.of_session[j].powi(2) * session
                            + walk.of_sequence[j].powi(2) * sequence;
                        c[(k * d + j, i * d + j)] += variance * size;
                    }
                }
            }
        }
    }
}

/// The covariance of the torques of a field that is smooth, lower triangle, and the torques of one that
/// is 1 N/m everywhere.
fn common(design: &Design, rest: &[Point3<f64>]) -> (Mat<f64>, Vec<f64>) {
    let n = design.w.nrows();
    let hats = hats(&design.points, rest);
    let mut smooth = Mat::zeros(n, hats.nodes);
    for (k, node, weight) in hats.weights {
        let from = design.w.col_as_slice(k);
        let to = smooth.col_as_slice_mut(node);
        to.iter_mut().zip(from).for_each(|(t, f)| *t += weight * f);
    }
    let mut level = vec![0.0; n];
    for k in 0..design.points.len() {
        let column = design.w.col_as_slice(k);
        level.iter_mut().zip(column).for_each(|(l, w)| *l += w);
    }
    (outer(&smooth), level)
}

/// `A A^T`; above the diagonal it is not complete.
fn outer(a: &Mat<f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), a.nrows());
    add_outer(&mut out, a, 1.0);
    out
}

/// Adds `sign A A^T` on and below the diagonal. Neighbouring rows touch the same few points: of two bands of rows
/// only the columns count that are not zero in both.
fn add_outer(to: &mut Mat<f64>, a: &Mat<f64>, sign: f64) {
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

struct Hats {
    nodes: usize,
    /// Point, node and weight.
    weights: Vec<(usize, usize, f64)>,
}

/// Trilinear interpolation of the points between the nodes of a lattice, scaled so that every
/// point has unit variance when the nodes have.
fn hats(points: &[u32], rest: &[Point3<f64>]) -> Hats {
    let mut nodes = std::collections::BTreeMap::new();
    let mut weights = Vec::with_capacity(8 * points.len());
    for (k, &p) in points.iter().enumerate() {
        let x = rest[p as usize].coords / CELL;
        let base = x.map(f64::floor);
        let t = x - base;
        let own: Vec<_> = (0..8)
            .map(|corner| {
                let bit = |axis: usize| (corner >> axis) & 1;
                let along = |axis: usize| {
                    if bit(axis) == 1 {
                        t[axis]
                    } else {
                        1.0 - t[axis]
                    }
                };
                let key: [i64; 3] =
                    std::array::from_fn(|axis| base[axis] as i64 + bit(axis) as i64);
                (key, along(0) * along(1) * along(2))
            })
            .collect();
        let norm = own.iter().map(|(_, w)| w * w).sum::<f64>().sqrt();
        for (key, weight) in own {
            let fresh = nodes.len();
            let node = *nodes.entry(key).or_insert(fresh);
            weights.push((k, node, weight / norm));
        }
    }
    Hats {
        nodes: nodes.len(),
        weights,
    }
}

impl Factor {
    /// Of a covariance, by its lower triangle.
    ///
    /// # Errors
    /// A matrix that is not positive definite.
    pub(crate) fn new(mut a: Mat<f64>) -> Result<Self, GapError> {
        let scratch =
            llt::factor::cholesky_in_place_scratch::<f64>(a.nrows(), Par::Seq, Default::default());
        let mut memory = MemBuffer::new(scratch);
        llt::factor::cholesky_in_place(
            a.as_mut(),
            Default::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .map_err(|_| GapError::Numerical("the covariance of the readings"))?;
        Ok(Self(a))
    }

    /// Whitens every column in place: `L^-1 x`.
    pub(crate) fn whiten(&self, x: &mut Mat<f64>) {
        triangular_solve::solve_lower_triangular_in_place(self.0.as_ref(), x.as_mut(), Par::Seq);
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

/// An effect beside the rest, linear in its parameters.
#[derive(Debug, Clone)]
pub(crate) struct Fit {
    /// Log of the evidence's gain over the same model without the effect (nats).
    pub(crate) gain: f64,
    /// Parameters with the largest posterior density.
    pub(crate) theta: DVector<f64>,
    /// Their covariance.
    pub(crate) covariance: DMatrix<f64>,
}

/// Information and score of whitened tangents (one column per parameter) for whitened readings.
#[derive(Debug, Clone)]
pub(crate) struct Normal {
    /// `T^T C^-1 T`.
    pub(crate) information: DMatrix<f64>,
    /// `T^T C^-1 y`.
    pub(crate) score: DVector<f64>,
}

impl Normal {
    /// Of tangents `t` and readings `y`, both whitened.
    pub(crate) fn new(y: &[f64], t: &[&[f64]]) -> Self {
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let mut information = DMatrix::zeros(t.len(), t.len());
        for i in 0..t.len() {
            for j in 0..=i {
                information[(i, j)] = dot(t[i], t[j]);
                information[(j, i)] = information[(i, j)];
            }
        }
        Self {
            information,
            score: DVector::from_fn(t.len(), |i, _| dot(t[i], y)),
        }
    }

    /// The evidence with the parameters integrated out under independent priors of mean zero and
    /// deviations `sd`. Parameters that would leave their bounds are held there; a bound
    /// at zero takes them out of the model. `None` where numbers do not tell.
    pub(crate) fn fit(&self, sd: &[f64], bounds: &[[f64; 2]]) -> Option<Fit> {
        let p = sd.len();
        let mut theta = DVector::from_fn(p, |i, _| 0.0_f64.clamp(bounds[i][0], bounds[i][1]));
        let mut held: Vec<Option<f64>> = vec![None; p];
        // A primal active set method: each round holds one more or comes to a smaller minimum.
        for _ in 0..ROUNDS * (p + 1) {
            let free: Vec<usize> = (0..p).filter(|&i| held[i].is_none()).collect();
            let fit = self.fit_free(sd, &held, &free)?;
            let reach = |&i: &usize| {
                let [low, high] = bounds[i];
                let (from, to) = (theta[i], fit.theta[i]);
                let bound = to.clamp(low, high);
                (bound != to).then(|| (i, bound, ((bound - from) / (to - from)).clamp(0.0, 1.0)))
            };
            let first = free
                .iter()
                .filter_map(reach)
                .min_by(|a, b| a.2.total_cmp(&b.2));
            if let Some((i, bound, share)) = first {
                theta += share * (&fit.theta - &theta);
                held[i] = Some(bound);
                continue;
            }
            theta.copy_from(&fit.theta);
            match self.leaves_bound(&theta, sd, bounds, &held) {
                Some(i) => held[i] = None,
                None => return fit.gain.is_finite().then_some(fit),
            }
        }
        None
    }

    /// The held parameter that would gain most by moving inside of its bounds, if any would.
    fn leaves_bound(
        &self,
        theta: &DVector<f64>,
        sd: &[f64],
        bounds: &[[f64; 2]],
        held: &[Option<f64>],
    ) -> Option<usize> {
        let pull = &self.score - &self.information * theta;
        // Slope of the log posterior towards the inside, in units of the prior's deviation.
        let inward = |i: usize| {
            let slope = sd[i] * pull[i] - theta[i] / sd[i];
            match (held[i]?, bounds[i]) {
                (_, [low, high]) if low == high => None,
                (at, [low, _]) if at == low => Some(slope),
                _ => Some(-slope),
            }
        };
        let size = |i: usize| sd[i] * sd[i] * self.information[(i, i)] + 1.0;
        (0..sd.len())
            .filter_map(|i| Some((i, inward(i)? / size(i).sqrt())))
            .filter(|(_, slope)| *slope > LEVEL_SLOPE)
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| i)
    }

    fn fit_free(&self, sd: &[f64], held: &[Option<f64>], free: &[usize]) -> Option<Fit> {
        let (p, n) = (sd.len(), free.len());
        let at_bound = DVector::from_fn(p, |i, _| held[i].unwrap_or(0.0));
        let moved = &self.score - &self.information * &at_bound;
        // In units of the prior's deviations.
        let precision = DMatrix::from_fn(n, n, |a, b| {
            let (i, j) = (free[a], free[b]);
            sd[i] * sd[j] * self.information[(i, j)] + f64::from(u8::from(a == b))
        });
        let score = DVector::from_fn(n, |a, _| sd[free[a]] * moved[free[a]]);
        let factor = precision.cholesky()?;
        let best = factor.solve(&score);
        let log_det: f64 = (0..n).map(|i| 2.0 * factor.l_dirty()[(i, i)].ln()).sum();
        let of_held = self.score.dot(&at_bound)
            - 0.5 * at_bound.dot(&(&self.information * &at_bound))
            - (0..p)
                .map(|i| 0.5 * (at_bound[i] / sd[i]).powi(2))
                .sum::<f64>();
        let gain = 0.5 * score.dot(&best) - 0.5 * log_det + of_held;
        let inverse = factor.inverse();
        let (mut theta, mut covariance) = (at_bound, DMatrix::zeros(p, p));
        // A bound is no certainty.
        for i in (0..p).filter(|&i| held[i].is_some()) {
            covariance[(i, i)] = 1.0 / (self.information[(i, i)] + 1.0 / (sd[i] * sd[i]));
        }
        for (a, &i) in free.iter().enumerate() {
            theta[i] = sd[i] * best[a];
            for (b, &j) in free.iter().enumerate() {
                covariance[(i, j)] = sd[i] * sd[j] * inverse[(a, b)];
            }
        }
        Some(Fit {
            gain,
            theta,
            covariance,
        })
    }

    /// `log det (1 + S^1/2 I S^1/2)`, what integrating out the parameters costs twice.
    pub(crate) fn log_det(&self, sd: &[f64]) -> f64 {
        let p = sd.len();
        let precision = DMatrix::from_fn(p, p, |i, j| {
            sd[i] * sd[j] * self.information[(i, j)] + f64::from(u8::from(i == j))
        });
        match precision.cholesky() {
            Some(factor) => (0..p).map(|i| 2.0 * factor.l_dirty()[(i, i)].ln()).sum(),
            None => f64::INFINITY,
        }
    }
}

/// The field's mean over touched points, given readings without the additive torques, already
/// solved with the covariance (`C^-1 r`).
pub(crate) fn field_mean(
    design: &Design,
    rest: &[Point3<f64>],
    spread: &Spread,
    solved: &[f64],
) -> Vec<f64> {
    let p = design.points.len();
    let mut back = vec![0.0; p];
    for (k, b) in back.iter_mut().enumerate() {
        *b = (design.w.col_as_slice(k).iter())
            .zip(solved)
            .map(|(w, s)| w * s)
            .sum();
    }
    let hats = hats(&design.points, rest);
    let mut nodes = vec![0.0; hats.nodes];
    for &(k, node, weight) in &hats.weights {
        nodes[node] += weight * back[k];
    }
    let level: f64 = back.iter().sum();
    let mut field: Vec<f64> = (back.iter())
        .map(|b| spread.point * spread.point * b + spread.level * spread.level * level)
        .collect();
    for &(k, node, weight) in &hats.weights {
        field[k] += spread.smooth * spread.smooth * weight * nodes[node];
    }
    field
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
    use crate::windows::Window;
    use proptest::prelude::*;

    /// Columns that are zero but for some rows, as of points that are touched for a while.
    fn sparse(rows: usize, columns: usize) -> Mat<f64> {
        Mat::from_fn(rows, columns, |i, k| {
            let from = 37 * k % rows;
            let inside = (from..from + 5 + k).contains(&i) && !(64..128).contains(&i);
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

    /// Against sums of the steps that two readings have walked together. The last sequence is tared, and in two parts.
    #[test]
    fn val_walks_are_sums_of_steps() {
        const STEP: f64 = 0.01;
        let joints = 2;
        let places = [(0, 0.3), (0, 1.1), (1, 2.5), (1, 2.9), (2, 4.2), (3, 4.9)];
        let list = places.map(|(sequence, clock)| Window {
            sequence,
            run: sequence,
            rows: 0..1,
            clock,
        });
        let windows = Windows {
            list: list.to_vec(),
            joints,
        };
        let begins = [0.0, 2.0, 4.0, 4.0];
        let tared = [false, false, true, true];
        let walk = RandomWalk {
            of_session: vec![0.5, 0.0],
            of_sequence: vec![0.2, 3.0],
        };
        let n = windows.rows();
        let design = Design {
            points: Vec::new(),
            w: Mat::zeros(n, 0),
            a: vec![0.0; n],
        };
        let errors = Errors {
            noise: Vec::new(),
            zeros: vec![0.0; n],
            joint_rms: vec![0.0; joints],
            walks: vec![walk.clone()],
            begins: begins.to_vec(),
            tared: tared.to_vec(),
        };
        let parts = Parts::new(&design, &[], &windows, Mat::zeros(n, 3), errors);
        let spread = Spread {
            point: 0.0,
            smooth: 0.0,
            level: 0.0,
            contact: 0.0,
            joint: 0.0,
            white: 0.0,
            walk: 0.3,
        };
        let c = parts.covariance(&spread);
        // Steps of the session, then those of the sequences, each of which has its own.
        let per_walk = 600;
        let steps = |w: &Window, j: usize| -> Vec<f64> {
            let size = STEP.sqrt() * spread.walk;
            let begin = begins[w.sequence];
            let between = |k: usize, from: f64| {
                let t = (k as f64 + 0.5) * STEP;
                f64::from(u8::from(t > from && t < w.clock))
            };
            let from = if tared[w.sequence] { begin } else { 0.0 };
            let of_session = (0..per_walk).map(|k| between(k, from) * size * walk.of_session[j]);
            let of_sequences = [0.0, 2.0, 4.0].into_iter().flat_map(|own| {
                let own = f64::from(u8::from(own == begin));
                (0..per_walk).map(move |k| (own, k))
            });
            let of_sequences =
                of_sequences.map(|(own, k)| own * between(k, begin) * size * walk.of_sequence[j]);
            of_session.chain(of_sequences).collect()
        };
        for row in 0..n {
            for col in 0..=row {
                let [a, b] = [row, col].map(|i| steps(&windows.list[i / joints], i % joints));
                let together: f64 = a.iter().zip(&b).map(|(a, b)| a * b).sum();
                let expected = match row % joints == col % joints {
                    true => together,
                    false => 0.0,
                };
                assert!((c[(row, col)] - expected).abs() < 1e-9, "{row}, {col}");
            }
        }
    }

    /// The best of all ways to hold each of three parameters at a bound or not.
    fn best_of_all(normal: &Normal, sd: &[f64; 3], bounds: &[[f64; 2]; 3]) -> Vec<f64> {
        let precision = DMatrix::from_fn(3, 3, |i, j| {
            normal.information[(i, j)] + if i == j { sd[i].powi(-2) } else { 0.0 }
        });
        let cost =
            |theta: &DVector<f64>| 0.5 * theta.dot(&(&precision * theta)) - normal.score.dot(theta);
        let mut best: Option<DVector<f64>> = None;
        for way in 0..27_usize {
            let at = |i: usize| match way / 3_usize.pow(i as u32) % 3 {
                2 => None,
                side => Some(bounds[i][side]),
            };
            // Rows of held parameters say where they are.
            let rows = DMatrix::from_fn(3, 3, |i, j| match at(i) {
                None => precision[(i, j)],
                Some(_) => f64::from(u8::from(i == j)),
            });
            let right = DVector::from_fn(3, |i, _| at(i).unwrap_or(normal.score[i]));
            let Some(theta) = rows.lu().solve(&right) else {
                continue;
            };
            let inside = (0..3)
                .all(|i| theta[i] >= bounds[i][0] - 1e-12 && theta[i] <= bounds[i][1] + 1e-12);
            if inside && best.as_ref().is_none_or(|b| cost(&theta) < cost(b)) {
                best = Some(theta);
            }
        }
        best.map_or_else(Vec::new, |b| b.as_slice().to_vec())
    }

    proptest! {
        /// Columns that resemble each other, so that what is held may have to be let go.
        #[test]
        fn val_fits_within_bounds_are_the_best_of_all(
            columns in prop::array::uniform3(prop::array::uniform4(-1.0..1.0_f64)),
            y in prop::array::uniform4(-10.0..10.0_f64),
            alike in 0.0..0.95_f64,
            sd in prop::array::uniform3(0.1..30.0_f64),
            low in prop::array::uniform3(-2.0..0.0_f64),
            one_sided in prop::array::uniform3(any::<bool>()),
        ) {
            let mixed = columns.map(|c| -> Vec<f64> {
                let pairs = c.iter().zip(&columns[0]);
                pairs.map(|(c, first)| (1.0 - alike) * c + alike * first).collect()
            });
            let normal = Normal::new(&y, &[&mixed[0], &mixed[1], &mixed[2]]);
            let bounds = [0, 1, 2].map(|i| [if one_sided[i] { 0.0 } else { low[i] }, 1.5]);
            let fit = normal.fit(&sd, &bounds).ok_or_else(|| TestCaseError::fail("no fit"))?;
            let expected = best_of_all(&normal, &sd, &bounds);
            for (found, expected) in fit.theta.iter().zip(&expected) {
                prop_assert!((found - expected).abs() < 1e-7, "{} {expected:?}", fit.theta);
            }
        }
    }
}

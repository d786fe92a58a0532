//! The covariance of readings with the stiffness integrated out, and the posterior mean of the stiffness.

use super::lattice::hats;
use super::matrix::{Factor, add_outer, outer};
use crate::GapError;
use crate::design::Design;
use crate::effect::RandomWalk;
use crate::lever::LEVERS;
use crate::windows::{Window, Windows};
use faer::Mat;
use nalgebra::Point3;
use std::ops::Range;

/// Correlation times (s) of the model's roughness, of contact and of joints.
const CONTACT_TIMES: [f64; 3] = [0.05, 0.3, 3.0];
const JOINT_TIMES: [f64; 2] = [0.5, 5.0];

/// Standard deviations of what makes readings vary.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(test, derive(Default))]
pub(crate) struct Spread {
    /// Standard deviation of each point's stiffness on its own (N/m).
    pub(crate) point: f64,
    /// Standard deviation of the part of the stiffness that is smooth over 4 cm (N/m).
    pub(crate) smooth: f64,
    /// Standard deviation of the common level of the stiffness (N/m).
    pub(crate) level: f64,
    /// Roughness of contact: unexplained share of the force at the contact. The place where the force acts is off by as
    /// large a share of 0.1 m ([`crate::Campaign::lever`]).
    pub(crate) contact: f64,
    /// Roughness of joints: unexplained torque as a share of each joint's RMS torque.
    pub(crate) joint: f64,
    /// Roughness of joints that does not persist from window to window, as the same share.
    pub(crate) white: f64,
    /// Random walks of the model's effects, in their own sizes ([`RandomWalk`]).
    pub(crate) walk: f64,
}

impl Spread {
    /// The spread for a stiffness `by` times as large.
    pub(crate) fn scaled(self, by: f64) -> Self {
        Self {
            point: by * self.point,
            smooth: by * self.smooth,
            level: by * self.level,
            ..self
        }
    }
}

/// The parts of the covariance of a design, ready to be combined for any [`Spread`].
pub(crate) struct Parts {
    windows: Windows,
    /// Covariance of the torques for a stiffness that is independent from point to point, and for a smooth one; empty if
    /// nothing is touched.
    points: Mat<f64>,
    smooth: Mat<f64>,
    level: Vec<f64>,
    lever: Mat<f64>,
    /// Per window: how much of the roughness of contact, and of joints, persists to each window from itself to the end of
    /// its sequence.
    fades: Vec<Vec<[f64; 2]>>,
    errors: Errors,
    /// Blocks of rows that are independent of each other.
    blocks: Vec<Range<usize>>,
}

/// Errors of the readings, whatever is touched.
pub(crate) struct Errors {
    /// Covariance of the noise of the rows, lower triangle, entries that matter ([`Windows::noise`]).
    pub(crate) noise: Vec<(usize, usize, f64)>,
    /// Standard deviation of the zero of every row ([`Windows::zeros`]).
    pub(crate) zeros: Vec<f64>,
    /// RMS reading per joint (N m or N).
    pub(crate) joint_rms: Vec<f64>,
    /// Random walks by which the model's effects stray.
    pub(crate) walks: Vec<RandomWalk>,
    /// Start of the sequence of every motion, by the session's clock (s); the same for parts of one sequence.
    pub(crate) begins: Vec<f64>,
    /// Whether the motion's readings are relative to its start.
    pub(crate) tared: Vec<bool>,
}

impl Parts {
    /// Assembles the parts; `lever` is that of [`crate::Campaign::lever`].
    pub(crate) fn new(
        design: &Design,
        rest: &[Point3<f64>],
        windows: &Windows,
        lever: Mat<f64>,
        errors: Errors,
    ) -> Self {
        let (smooth, level) = common(design, rest);
        // What is touched and what wanders is common to sequences.
        let blocks = if design.points.is_empty() && errors.walks.is_empty() {
            windows.rows_of_sequences()
        } else {
            let all = 0..windows.rows();
            vec![all]
        };
        Self {
            windows: windows.clone(),
            points: outer_of_touched(&design.w),
            smooth,
            level,
            lever,
            fades: fades(windows),
            errors,
            blocks,
        }
    }

    /// Removes points: `design` holds the points that remain, `out` the columns of those that are removed.
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

    /// Variance of the scalar product of the readings' noise with `torques`.
    pub(crate) fn noise_along(&self, torques: &[f64]) -> f64 {
        let product = |&(row, col, value): &(usize, usize, f64)| {
            let times = if row == col { 1.0 } else { 2.0 };
            times * value * torques[row] * torques[col]
        };
        self.errors.noise.iter().map(product).sum()
    }

    /// The covariance of the readings, factored.
    ///
    /// # Errors
    /// A covariance that is not positive definite.
    pub(crate) fn factor(&self, spread: &Spread) -> Result<Factor, GapError> {
        Factor::of_blocks(self.covariance(spread), self.blocks.clone())
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
        // None where nothing is touched.
        for col in 0..self.smooth.ncols() {
            let below = col..n;
            let l = level * self.level[col];
            let parts = (self.points.col_as_slice(col)[below.clone()].iter())
                .zip(&self.smooth.col_as_slice(col)[below.clone()])
                .zip(&self.level[below.clone()]);
            let out = &mut c.col_as_slice_mut(col)[below];
            for (out, ((a, b), unit)) in out.iter_mut().zip(parts) {
                *out = point * a + smooth * b + l * unit;
            }
        }
        for &(row, col, value) in &self.errors.noise {
            c[(row, col)] += value;
        }
        let [contact, joint, white] = [spread.contact, spread.joint, spread.white].map(|s| s * s);
        let mut along = Vec::new();
        for (i, fades) in self.fades.iter().enumerate() {
            for j in 0..d {
                let col = i * d + j;
                let below = col..(i + fades.len()) * d;
                let out = &mut c.col_as_slice_mut(col)[below.clone()];
                if contact > 0.0 {
                    along.clear();
                    along.resize(below.len(), 0.0);
                    for l in 0..LEVERS {
                        let levers = &self.lever.col_as_slice(l)[below.clone()];
                        let arm = self.lever[(col, l)];
                        (along.iter_mut().zip(levers)).for_each(|(a, lever)| *a += arm * lever);
                    }
                    let mut rows = out.iter_mut().zip(&along);
                    let mut rows_of_window = d - j;
                    for [fade, _] in fades {
                        let of_contact = contact * fade;
                        let of_window = rows.by_ref().take(rows_of_window);
                        of_window.for_each(|(out, along)| *out += of_contact * along);
                        rows_of_window = d;
                    }
                }
                let (rms, zero) = (errors.joint_rms[j], errors.zeros[col]);
                for (k, [_, fade]) in fades.iter().enumerate() {
                    let own = joint * fade + if k == 0 { white } else { 0.0 };
                    out[k * d] += own * rms * rms + errors.zeros[col + k * d] * zero;
                }
            }
        }
        if spread.walk > 0.0 {
            self.add_walks(spread.walk * spread.walk, &mut c);
        }
        c
    }

    /// Adds the covariance of the random walks: a variance times the walk that two readings of a joint have in common.
    fn add_walks(&self, variance: f64, c: &mut Mat<f64>) {
        let d = self.windows.joints;
        let Errors { begins, tared, .. } = &self.errors;
        let together = |a: f64, b: f64, begin: f64| (a.min(b) - begin).max(0.0);
        for walk in &self.errors.walks {
            for (i, w) in self.windows.list.iter().enumerate() {
                for (k, v) in self.windows.list.iter().enumerate().skip(i) {
                    let [begin, other] = [w, v].map(|of| begins[of.sequence]);
                    let sequence = if begin == other {
                        together(w.clock, v.clock, begin)
                    } else {
                        0.0
                    };
                    // What the session has walked before is in the tare.
                    let session = if tared[w.sequence] || tared[v.sequence] {
                        sequence
                    } else {
                        together(w.clock, v.clock, 0.0)
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

/// How much persists from each window to the following ones of its sequence, for contact and for joints.
fn fades(windows: &Windows) -> Vec<Vec<[f64; 2]>> {
    let of = |(i, w): (usize, &Window)| {
        let followers = windows.list[i..].iter();
        followers
            .take_while(|v| v.sequence == w.sequence)
            .map(|v| {
                let dt = (v.clock - w.clock).abs();
                let fade = |times: &[f64]| {
                    times.iter().map(|t| (-dt / t).exp()).sum::<f64>() / times.len() as f64
                };
                [fade(&CONTACT_TIMES), fade(&JOINT_TIMES)]
            })
            .collect()
    };
    windows.list.iter().enumerate().map(of).collect()
}

/// The covariance of the torques of a smooth field, lower triangle, and the torques of a field that is 1 N/m everywhere.
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
    (outer_of_touched(&smooth), level)
}

/// `A A^T`, lower triangle; empty if nothing is touched.
fn outer_of_touched(a: &Mat<f64>) -> Mat<f64> {
    if a.ncols() > 0 {
        outer(a)
    } else {
        Mat::zeros(0, 0)
    }
}

/// Posterior mean of the field over touched points. `C^-1 r` must be given, where `r` are the readings without the additive
/// torques.
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

#[cfg(test)]
mod tests {
    use super::*;

    impl Errors {
        /// Of so many rows.
        fn none(n: usize, joints: usize) -> Self {
            Self {
                noise: Vec::new(),
                zeros: vec![0.0; n],
                joint_rms: vec![0.0; joints],
                walks: Vec::new(),
                begins: Vec::new(),
                tared: Vec::new(),
            }
        }
    }

    /// One window for each sequence and time.
    fn windows(places: &[(usize, f64)], joints: usize) -> Windows {
        let of = |&(sequence, clock): &(usize, f64)| Window {
            sequence,
            run: sequence,
            rows: 0..1,
            clock,
        };
        Windows {
            list: places.iter().map(of).collect(),
            joints,
        }
    }

    fn untouched(n: usize) -> Design {
        Design {
            points: Vec::new(),
            w: Mat::zeros(n, 0),
            a: vec![0.0; n],
        }
    }

    /// What contact gets wrong fades with the time between two windows of a sequence, and begins anew with the next one.
    #[test]
    fn val_contact_is_rough_by_all_of_its_levers() {
        let joints = 2;
        let places = [(0, 0.0), (0, 0.2), (0, 1.5), (1, 1.6)];
        let windows = windows(&places, joints);
        let n = windows.rows();
        let lever = Mat::from_fn(n, LEVERS, |i, l| {
            (1.0 + 3.7 * i as f64 + 0.9 * l as f64).sin()
        });
        let errors = Errors::none(n, joints);
        let parts = Parts::new(&untouched(n), &[], &windows, lever.clone(), errors);
        let c = parts.covariance(&Spread {
            contact: 0.5,
            ..Spread::default()
        });
        for row in 0..n {
            for col in 0..=row {
                let [v, w] = [row, col].map(|i| &windows.list[i / joints]);
                let dt = v.clock - w.clock;
                let fade = ((-dt / 0.05).exp() + (-dt / 0.3).exp() + (-dt / 3.0).exp()) / 3.0;
                let along: f64 = (0..LEVERS).map(|l| lever[(row, l)] * lever[(col, l)]).sum();
                let expected = if v.sequence == w.sequence {
                    0.25 * fade * along
                } else {
                    0.0
                };
                assert!((c[(row, col)] - expected).abs() < 1e-12, "{row}, {col}");
            }
        }
    }

    /// Against sums of the steps that two readings have walked together. The last sequence is tared, and in two parts.
    #[test]
    fn val_walks_are_sums_of_steps() {
        const STEP: f64 = 0.01;
        let joints = 2;
        let places = [(0, 0.3), (0, 1.1), (1, 2.5), (1, 2.9), (2, 4.2), (3, 4.9)];
        let windows = windows(&places, joints);
        let begins = [0.0, 2.0, 4.0, 4.0];
        let tared = [false, false, true, true];
        let walk = RandomWalk {
            of_session: vec![0.5, 0.0],
            of_sequence: vec![0.2, 3.0],
        };
        let n = windows.rows();
        let errors = Errors {
            walks: vec![walk.clone()],
            begins: begins.to_vec(),
            tared: tared.to_vec(),
            ..Errors::none(n, joints)
        };
        let parts = Parts::new(&untouched(n), &[], &windows, Mat::zeros(n, LEVERS), errors);
        let spread = Spread {
            walk: 0.3,
            ..Spread::default()
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
                let expected = if row % joints == col % joints {
                    together
                } else {
                    0.0
                };
                assert!((c[(row, col)] - expected).abs() < 1e-9, "{row}, {col}");
            }
        }
    }
}

//! Streaming passes over an observation matrix, with the vector instructions detected at run time. Sums run
//! over fixed lanes and blocks, so they give the same bits on every machine.

use crate::lanes::{Lanes, dispatch, products, scale};
use crate::values::gather;
use pulp::{Simd, WithSimd};
use std::array::from_mut;
use std::hint::black_box;
use std::ops::Range;
use vsf_core::{Belief, Observation, PerScalar, Scalar};

/// Contacts per block: what a pass needs of a block stays in the first-level cache, and a lane sums
/// 32 products in single precision at most.
const BLOCK: usize = 512;

/// Moments of the signal `W K` for independent `K` with `mean` and `variance` per contact: `d` rows
/// of the covariance `W diag(variance) W^T` (lower triangle), then one row, the mean `W mean`.
pub(crate) fn moments<T: Scalar>(
    obs: &Observation<T>,
    mean: &[T],
    variance: &[T],
    moments: &mut [f64],
) {
    T::run::<Passes>(Pass::Moments {
        obs,
        mean,
        variance,
        moments,
    });
}

/// Per channel of `W K`: its mean and variance under a belief of independent points.
pub(crate) fn predict<T: Scalar>(
    obs: &Observation<T>,
    belief: &Belief<T>,
    mean: &mut [f64],
    variance: &mut [f64],
) {
    T::run::<Passes>(Pass::Predict {
        obs,
        belief,
        mean,
        variance,
    });
}

/// Reading `W x` (`d` values) of values given per contact.
pub(crate) fn apply<T: Scalar>(obs: &Observation<T>, x: &[T], reading: &mut [f64]) {
    T::run::<Passes>(Pass::Apply { obs, x, reading });
}

/// `mean += v (W^T gain)` per contact.
pub(crate) fn shift<T: Scalar>(obs: &Observation<T>, gain: &[f64], variance: &[T], mean: &mut [T]) {
    T::run::<Passes>(Pass::Shift {
        obs,
        gain,
        variance,
        mean,
    });
}

/// The touched points of a field and of its prior, copied to `free` and `prior`, `mean = max(0, free)`, and
/// the reading `W mean`.
pub(crate) fn read_positive<T: Scalar>(
    obs: &Observation<T>,
    fields: [&[T]; 2],
    touched: [&mut [T]; 3],
    reading: &mut [f64],
) {
    T::run::<Passes>(Pass::ReadPositive {
        obs,
        fields,
        touched,
        reading,
    });
}

/// `free += prior (W^T gain)` and `mean = max(0, free)` per contact.
pub(crate) fn shift_positive<T: Scalar>(
    obs: &Observation<T>,
    gain: &[f64],
    prior: &[T],
    free: &mut [T],
    mean: &mut [T],
) {
    T::run::<Passes>(Pass::ShiftPositive {
        obs,
        gain,
        prior,
        free,
        mean,
    });
}

/// `W diag(variance) W^T` (lower triangle, rows of `d`), summed in double precision, one contact after
/// the other.
pub(crate) fn double_covariance<T: Scalar>(
    obs: &Observation<T>,
    variance: &[T],
    covariance: &mut [f64],
) {
    let d = obs.dim();
    for i in 0..d {
        for j in 0..=i {
            let terms = obs.row(i).iter().zip(obs.row(j)).zip(variance);
            let sum = terms.map(|((a, b), v)| a.to_f64() * b.to_f64() * v.to_f64());
            covariance[i * d + j] = sum.sum();
        }
    }
}

/// `v (1 - c v h) / (1 + (1 - c) v h)` with `h = w^T A^-1 w` per contact, in place: eq. 7, first line, for
/// c = 0 and A = R. `whitener` is the row-major inverse `L^-1` of the Cholesky factor of A.
pub(crate) fn shrink<T: Scalar>(
    obs: &Observation<T>,
    whitener: &[f64],
    c: f64,
    variance: &mut [T],
) {
    T::run::<Passes>(Pass::Shrink {
        obs,
        whitener,
        c,
        variance,
    });
}

enum Pass<'a, T: Scalar> {
    Moments {
        obs: &'a Observation<T>,
        mean: &'a [T],
        variance: &'a [T],
        moments: &'a mut [f64],
    },
    Predict {
        obs: &'a Observation<T>,
        belief: &'a Belief<T>,
        mean: &'a mut [f64],
        variance: &'a mut [f64],
    },
    Apply {
        obs: &'a Observation<T>,
        x: &'a [T],
        reading: &'a mut [f64],
    },
    Shift {
        obs: &'a Observation<T>,
        gain: &'a [f64],
        variance: &'a [T],
        mean: &'a mut [T],
    },
    ReadPositive {
        obs: &'a Observation<T>,
        fields: [&'a [T]; 2],
        /// Free means, prior, means.
        touched: [&'a mut [T]; 3],
        reading: &'a mut [f64],
    },
    ShiftPositive {
        obs: &'a Observation<T>,
        gain: &'a [f64],
        prior: &'a [T],
        free: &'a mut [T],
        mean: &'a mut [T],
    },
    Shrink {
        obs: &'a Observation<T>,
        whitener: &'a [f64],
        c: f64,
        variance: &'a mut [T],
    },
}

/// Compiled here, once for each number type: callers in debug builds get the quick code too.
struct Passes;

impl PerScalar for Passes {
    type Input<'a, T: Scalar> = Pass<'a, T>;
    type Output = ();
    fn f32(pass: Pass<'_, f32>) {
        dispatch(pass);
    }
    fn f64(pass: Pass<'_, f64>) {
        dispatch(pass);
    }
}

impl<T: Lanes> WithSimd for Pass<'_, T> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self {
            Pass::Moments {
                obs,
                mean,
                variance,
                moments,
            } => sum_moments(simd, obs, mean, variance, moments),
            Pass::Predict {
                obs,
                belief,
                mean,
                variance,
            } => sum_channels(simd, obs, belief, mean, variance),
            Pass::Apply { obs, x, reading } => sum_reading(simd, obs, x, reading),
            Pass::Shift {
                obs,
                gain,
                variance,
                mean,
            } => add_gain(obs, gain, variance, mean),
            Pass::ReadPositive {
                obs,
                fields,
                touched: [free, prior, mean],
                reading,
            } => {
                fetch(obs.rows());
                gather(obs.points(), fields, [&mut *free, prior]);
                cut_off(free, mean);
                sum_reading(simd, obs, mean, reading);
            }
            Pass::ShiftPositive {
                obs,
                gain,
                prior,
                free,
                mean,
            } => {
                add_gain(obs, gain, prior, free);
                cut_off(free, mean);
            }
            Pass::Shrink {
                obs,
                whitener,
                c,
                variance,
            } => shrink_blocks(obs, whitener, c, variance),
        }
    }
}

/// Some of the contacts.
struct Block<'a, T: Scalar> {
    obs: &'a Observation<T>,
    range: Range<usize>,
    mean: &'a [T],
    variance: &'a [T],
}

impl<T: Scalar> Block<'_, T> {
    #[inline(always)]
    fn rows<const N: usize>(&self, first: usize) -> [&[T]; N] {
        let mut rows = [[].as_slice(); N];
        for (i, row) in rows.iter_mut().enumerate() {
            *row = &self.obs.row(first + i)[self.range.clone()];
        }
        rows
    }
}

#[inline(always)]
fn sum_moments<S: Simd, T: Lanes>(
    simd: S,
    obs: &Observation<T>,
    mean: &[T],
    variance: &[T],
    moments: &mut [f64],
) {
    let (n, d) = (obs.len(), obs.dim());
    fetch(obs.rows());
    moments.fill(0.0);
    let mut scaled = [[T::ZERO; BLOCK]; 2];
    for start in (0..n).step_by(BLOCK) {
        let range = start..(start + BLOCK).min(n);
        let block = Block {
            obs,
            mean: &mean[range.clone()],
            variance: &variance[range.clone()],
            range,
        };
        for first in (0..d - d % 2).step_by(2) {
            add_rows(simd, &block, first, &mut scaled, moments);
        }
        if d % 2 == 1 {
            add_rows(simd, &block, d - 1, from_mut(&mut scaled[0]), moments);
        }
    }
}

/// Adds what `I` rows from `first` (even) on contribute to the moments, with all rows before them.
#[inline(always)]
fn add_rows<S: Simd, T: Lanes, const I: usize>(
    simd: S,
    block: &Block<'_, T>,
    first: usize,
    scaled: &mut [[T; BLOCK]; I],
    moments: &mut [f64],
) {
    let d = block.obs.dim();
    let rows = block.rows::<I>(first);
    let (squares, readings) = scale(simd, rows, block.variance, block.mean, scaled);
    for i in 0..I {
        for j in 0..=i {
            moments[(first + i) * d + first + j] += squares[i][j];
        }
        moments[d * d + first + i] += readings[i];
    }
    let mut left = [[].as_slice(); I];
    for i in 0..I {
        left[i] = &scaled[i][..block.range.len()];
    }
    for before in (0..first).step_by(2) {
        let sums = products(simd, left, block.rows::<2>(before));
        for i in 0..I {
            for j in 0..2 {
                moments[(first + i) * d + before + j] += sums[i][j];
            }
        }
    }
}

#[inline(always)]
fn sum_channels<S: Simd, T: Lanes>(
    simd: S,
    obs: &Observation<T>,
    belief: &Belief<T>,
    mean: &mut [f64],
    variance: &mut [f64],
) {
    let (n, d) = (obs.len(), obs.dim());
    mean.fill(0.0);
    variance.fill(0.0);
    let (mut m, mut v, mut scaled) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK], [[T::ZERO; BLOCK]]);
    for start in (0..n).step_by(BLOCK) {
        let range = start..(start + BLOCK).min(n);
        let (m, v) = (&mut m[..range.len()], &mut v[..range.len()]);
        let points = &obs.points()[range.clone()];
        gather(
            points,
            [belief.mean(), belief.variance()],
            [&mut *m, &mut *v],
        );
        for i in 0..d {
            let row = &obs.row(i)[range.clone()];
            let ([[square]], [reading]) = scale(simd, [row], v, m, &mut scaled);
            mean[i] += reading;
            variance[i] += square;
        }
    }
}

/// Four rows at a time: a number of `x` loaded once serves them all.
#[inline(always)]
fn sum_reading<S: Simd, T: Lanes>(simd: S, obs: &Observation<T>, x: &[T], reading: &mut [f64]) {
    let (n, d) = (obs.len(), obs.dim());
    reading.fill(0.0);
    for start in (0..n).step_by(BLOCK) {
        let range = start..(start + BLOCK).min(n);
        let block = Block {
            obs,
            mean: &x[range.clone()],
            variance: &[],
            range,
        };
        let mut first = 0;
        while first < d {
            first += match d - first {
                1 => add_readings::<S, T, 1>(simd, &block, first, reading),
                2 => add_readings::<S, T, 2>(simd, &block, first, reading),
                3 => add_readings::<S, T, 3>(simd, &block, first, reading),
                _ => add_readings::<S, T, 4>(simd, &block, first, reading),
            };
        }
    }
}

/// Adds the products of `J` rows from `first` on with the means, and returns their number.
#[inline(always)]
fn add_readings<S: Simd, T: Lanes, const J: usize>(
    simd: S,
    block: &Block<'_, T>,
    first: usize,
    reading: &mut [f64],
) -> usize {
    let [sums] = products(simd, [block.mean], block.rows::<J>(first));
    for (reading, sum) in reading[first..].iter_mut().zip(sums) {
        *reading += sum;
    }
    J
}

/// `to = max(0, from)`.
#[inline(always)]
fn cut_off<T: Scalar>(from: &[T], to: &mut [T]) {
    for (to, &x) in to.iter_mut().zip(from) {
        *to = if x < T::ZERO { T::ZERO } else { x };
    }
}

#[inline(always)]
fn add_gain<T: Scalar>(obs: &Observation<T>, gain: &[f64], variance: &[T], mean: &mut [T]) {
    const ROWS: usize = 8;
    let (n, d) = (obs.len(), obs.dim());
    for first in (0..d).step_by(ROWS) {
        // Rows beyond the last are the last again, with gain 0.
        let mut w = [obs.row(d - 1); ROWS];
        let mut g = [T::ZERO; ROWS];
        for i in 0..ROWS.min(d - first) {
            w[i] = obs.row(first + i);
            g[i] = T::from_f64(gain[first + i]);
        }
        let (mean, variance) = (&mut mean[..n], &variance[..n]);
        for k in 0..n {
            let low = (g[0] * w[0][k] + g[1] * w[1][k]) + (g[2] * w[2][k] + g[3] * w[3][k]);
            let high = (g[4] * w[4][k] + g[5] * w[5][k]) + (g[6] * w[6][k] + g[7] * w[7][k]);
            mean[k] += variance[k] * (low + high);
        }
    }
}

#[inline(always)]
fn shrink_blocks<T: Scalar>(obs: &Observation<T>, whitener: &[f64], c: f64, variance: &mut [T]) {
    let (n, d) = (obs.len(), obs.dim());
    let (mut gained, mut white) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK]);
    for start in (0..n).step_by(BLOCK) {
        let end = (start + BLOCK).min(n);
        let (gained, white) = (&mut gained[..end - start], &mut white[..end - start]);
        gained.fill(T::ZERO);
        for i in 0..d {
            white.fill(T::ZERO);
            for j in 0..=i {
                if whitener[i * d + j] != 0.0 {
                    let scale = T::from_f64(whitener[i * d + j]);
                    for (x, &w) in white.iter_mut().zip(&obs.row(j)[start..end]) {
                        *x += scale * w;
                    }
                }
            }
            for (g, &x) in gained.iter_mut().zip(&*white) {
                *g += x * x;
            }
        }
        let (c, rest) = (T::from_f64(c), T::from_f64(1.0 - c));
        for (v, &g) in variance[start..end].iter_mut().zip(&*gained) {
            let learned = *v * g;
            let left = T::ONE - c * learned;
            // What rounding makes of nothing; NaN stays.
            let left = if left < T::EPSILON { T::EPSILON } else { left };
            *v = *v * left / (T::ONE + rest * learned);
        }
    }
}

/// Brings a matrix into the cache: one number of every line, in order, which is quicker than to
/// wait for its rows block by block.
#[inline(always)]
fn fetch<T: Scalar>(rows: &[T]) {
    const LINE: usize = 64;
    let mut sums = [T::ZERO; 4];
    for lines in rows.chunks_exact(4 * LINE / size_of::<T>()) {
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += lines[k * LINE / size_of::<T>()];
        }
    }
    black_box(sums);
}

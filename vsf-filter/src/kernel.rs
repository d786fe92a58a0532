//! Streaming passes over an observation matrix. Sums run over fixed lanes and blocks, so that
//! they vectorise and give the same bits on every machine.

use std::ops::Range;
use vsf_core::{Observation, Scalar};

const LANES: usize = 16;
/// Contacts per block: what a pass needs of a block stays in the first-level cache.
const BLOCK: usize = 256;

/// `sum a_k b_k` over two slices of equal length.
#[inline]
pub(crate) fn dot<T: Scalar>(a: &[T], b: &[T]) -> T {
    let mut lanes = [T::ZERO; LANES];
    let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let (a_rest, b_rest) = (a_chunks.remainder(), b_chunks.remainder());
    for (x, y) in a_chunks.zip(b_chunks) {
        for l in 0..LANES {
            lanes[l] += x[l] * y[l];
        }
    }
    let mut sum = T::ZERO;
    for (x, y) in a_rest.iter().zip(b_rest) {
        sum += *x * *y;
    }
    let mut width = LANES;
    while width > 1 {
        width /= 2;
        for l in 0..width {
            lanes[l] = lanes[l] + lanes[l + width];
        }
    }
    sum + lanes[0]
}

/// Copies `from[points[k]]` into `to[k]`.
pub(crate) fn gather<T: Scalar>(points: &[u32], from: &[T], to: &mut Vec<T>) {
    to.clear();
    to.extend(points.iter().map(|&p| from[p as usize]));
}

/// Ranges of at most `BLOCK` contacts.
fn blocks(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n)
        .step_by(BLOCK)
        .map(move |start| start..(start + BLOCK).min(n))
}

/// Predicted reading `W mu` (`d` values) and signal covariance `W diag(v) W^T` (lower triangle of
/// a row-major `d x d`) for means and variances given per contact.
pub(crate) fn predict<T: Scalar>(
    obs: &Observation<T>,
    mean: &[T],
    variance: &[T],
    reading: &mut [f64],
    covariance: &mut [f64],
) {
    let d = obs.dim();
    reading.fill(0.0);
    covariance.fill(0.0);
    let mut wv = [T::ZERO; BLOCK];
    for block in blocks(obs.len()) {
        let (m, v) = (&mean[block.clone()], &variance[block.clone()]);
        let wv = &mut wv[..block.len()];
        for i in 0..d {
            let row = &obs.row(i)[block.clone()];
            reading[i] += dot(row, m).to_f64();
            for ((x, &w), &v) in wv.iter_mut().zip(row).zip(v) {
                *x = w * v;
            }
            for j in 0..=i {
                covariance[i * d + j] += dot(wv, &obs.row(j)[block.clone()]).to_f64();
            }
        }
    }
}

/// `v / (1 + v w^T R^-1 w)` per contact (eq. 7, first line), in place. `whitener` is the row-major
/// inverse `L^-1` of the Cholesky factor of R.
pub(crate) fn shrink<T: Scalar>(obs: &Observation<T>, whitener: &[f64], variance: &mut [T]) {
    let d = obs.dim();
    let (mut gained, mut white) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK]);
    for block in blocks(obs.len()) {
        let (gained, white) = (&mut gained[..block.len()], &mut white[..block.len()]);
        gained.fill(T::ZERO);
        for i in 0..d {
            white.fill(T::ZERO);
            for j in (0..=i).filter(|j| whitener[i * d + j] != 0.0) {
                add_scaled(
                    white,
                    T::from_f64(whitener[i * d + j]),
                    &obs.row(j)[block.clone()],
                );
            }
            for (g, &x) in gained.iter_mut().zip(&*white) {
                *g += x * x;
            }
        }
        for (v, &g) in variance[block].iter_mut().zip(&*gained) {
            *v = *v / (T::ONE + *v * g);
        }
    }
}

/// `mean += v (W^T gain)` per contact.
pub(crate) fn shift<T: Scalar>(obs: &Observation<T>, gain: &[f64], variance: &[T], mean: &mut [T]) {
    let mut sum = [T::ZERO; BLOCK];
    for block in blocks(obs.len()) {
        let sum = &mut sum[..block.len()];
        sum.fill(T::ZERO);
        for (i, &g) in gain.iter().enumerate() {
            add_scaled(sum, T::from_f64(g), &obs.row(i)[block.clone()]);
        }
        let (v, m) = (&variance[block.clone()], &mut mean[block]);
        for ((m, &v), &s) in m.iter_mut().zip(v).zip(&*sum) {
            *m += v * s;
        }
    }
}

/// `y += a x`.
fn add_scaled<T: Scalar>(y: &mut [T], a: T, x: &[T]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

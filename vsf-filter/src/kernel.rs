//! Streaming passes over an observation matrix. Sums run over fixed lanes and blocks, so that
//! they vectorise and give the same bits on every machine. Rows are taken two at a time: a number
//! loaded once then serves two products.

use std::ops::Range;
use vsf_core::{Belief, Observation, Scalar};

const LANES: usize = 8;
/// Contacts per block: what a pass needs of a block stays in the first-level cache.
const BLOCK: usize = 256;

/// `sum_k a_k b_k` and `sum_k a_k c_k` of slices of equal length.
#[inline]
fn dots<T: Scalar>(a: &[T], b: &[T], c: &[T]) -> [T; 2] {
    let (a_chunks, a_rest) = a.as_chunks::<LANES>();
    let (b_chunks, b_rest) = b.as_chunks::<LANES>();
    let (c_chunks, c_rest) = c.as_chunks::<LANES>();
    let (mut b_sums, mut c_sums) = ([T::ZERO; LANES], [T::ZERO; LANES]);
    for ((x, y), z) in a_chunks.iter().zip(b_chunks).zip(c_chunks) {
        for l in 0..LANES {
            b_sums[l] += x[l] * y[l];
        }
        for l in 0..LANES {
            c_sums[l] += x[l] * z[l];
        }
    }
    let rest = |y: &[T]| -> T { a_rest.iter().zip(y).map(|(&x, &y)| x * y).sum() };
    [total(&b_sums) + rest(b_rest), total(&c_sums) + rest(c_rest)]
}

/// Sum of the lanes. Kept apart: inlined, its pairs would make the compiler cut the vectors of
/// the loop before it in two.
#[inline(never)]
fn total<T: Scalar>(lanes: &[T; LANES]) -> T {
    let quad = |i: usize| (lanes[i] + lanes[i + 4]) + (lanes[i + 2] + lanes[i + 6]);
    quad(0) + quad(1)
}

/// Pairs `(i, i + 1)` that cover `0..n`; the last is `(n - 1, n - 1)` when `n` is odd.
fn pairs(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..n).step_by(2).map(move |i| (i, (i + 1).min(n - 1)))
}

/// `y += a x`.
fn add_scaled<T: Scalar>(y: &mut [T], a: T, x: &[T]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// Copies `from[points[k]]` to the end of `to`.
pub(crate) fn gather<T: Scalar>(points: &[u32], from: &[T], to: &mut Vec<T>) {
    to.extend(points.iter().map(|&p| from[p as usize]));
}

/// Means and variances at `points`.
pub(crate) fn gather_belief<T: Scalar>(
    points: &[u32],
    belief: &Belief<T>,
    mean: &mut Vec<T>,
    variance: &mut Vec<T>,
) {
    let means = belief.mean();
    let variances = &belief.variance()[..means.len()];
    mean.resize(points.len(), T::ZERO);
    variance.resize(points.len(), T::ZERO);
    for ((&p, m), v) in points.iter().zip(mean).zip(variance) {
        *m = means[p as usize];
        *v = variances[p as usize];
    }
}

/// Writes `from[k]` to `to[points[k]]`.
pub(crate) fn scatter<T: Scalar>(points: &[u32], from: &[T], to: &mut [T]) {
    for (&p, &x) in points.iter().zip(from) {
        to[p as usize] = x;
    }
}

/// Whether all values are finite.
pub(crate) fn all_finite<T: Scalar>(values: &[T]) -> bool {
    // No early exit, which would keep the loop from vectorising.
    values.iter().fold(true, |ok, x| ok & x.is_finite())
}

/// Whether all values are finite and positive.
pub(crate) fn all_positive<T: Scalar>(values: &[T]) -> bool {
    values
        .iter()
        .fold(true, |ok, x| ok & x.is_finite() & (*x > T::ZERO))
}

/// Ranges of at most `BLOCK` contacts.
fn blocks(n: usize) -> impl Iterator<Item = Range<usize>> {
    (0..n)
        .step_by(BLOCK)
        .map(move |start| start..(start + BLOCK).min(n))
}

/// Reading `W x` (`d` values) of values given per contact.
pub(crate) fn apply<T: Scalar>(obs: &Observation<T>, x: &[T], reading: &mut [f64]) {
    reading.fill(0.0);
    for block in blocks(obs.len()) {
        let x = &x[block.clone()];
        for (i, j) in pairs(obs.dim()) {
            let [first, second] = dots(x, &obs.row(i)[block.clone()], &obs.row(j)[block.clone()]);
            reading[i] += first.to_f64();
            if j > i {
                reading[j] += second.to_f64();
            }
        }
    }
}

/// Signal covariance `W diag(v) W^T` (lower triangle of a row-major `d x d`) of variances given
/// per contact.
pub(crate) fn gram<T: Scalar>(obs: &Observation<T>, variance: &[T], covariance: &mut [f64]) {
    let d = obs.dim();
    covariance.fill(0.0);
    let mut wv = [T::ZERO; BLOCK];
    for block in blocks(obs.len()) {
        let v = &variance[block.clone()];
        let wv = &mut wv[..block.len()];
        for i in 0..d {
            let row = &obs.row(i)[block.clone()];
            for ((x, &w), &v) in wv.iter_mut().zip(row).zip(v) {
                *x = w * v;
            }
            for (j, k) in pairs(i + 1) {
                let [first, second] =
                    dots(wv, &obs.row(j)[block.clone()], &obs.row(k)[block.clone()]);
                covariance[i * d + j] += first.to_f64();
                if k > j {
                    covariance[i * d + k] += second.to_f64();
                }
            }
        }
    }
}

/// Per channel of `W K`: its mean and variance under a belief of independent points.
pub(crate) fn predict<T: Scalar>(
    obs: &Observation<T>,
    belief: &Belief<T>,
    mean: &mut [f64],
    variance: &mut [f64],
) {
    mean.fill(0.0);
    variance.fill(0.0);
    let (mut m, mut v, mut wv) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK], [T::ZERO; BLOCK]);
    for block in blocks(obs.len()) {
        let (m, v, wv) = (
            &mut m[..block.len()],
            &mut v[..block.len()],
            &mut wv[..block.len()],
        );
        for ((&p, m), v) in obs.points()[block.clone()].iter().zip(&mut *m).zip(&mut *v) {
            *m = belief.mean()[p as usize];
            *v = belief.variance()[p as usize];
        }
        for i in 0..obs.dim() {
            let row = &obs.row(i)[block.clone()];
            for ((x, &w), &v) in wv.iter_mut().zip(row).zip(&*v) {
                *x = w * v;
            }
            let [first, second] = dots(row, m, wv);
            mean[i] += first.to_f64();
            variance[i] += second.to_f64();
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
    const WIDTH: usize = 2 * LANES;
    let n = obs.len();
    let (chunks, rest) = mean.as_chunks_mut::<WIDTH>();
    let (variances, rest_variance) = variance.as_chunks::<WIDTH>();
    let mut k = 0;
    for (m, v) in chunks.iter_mut().zip(variances) {
        let mut sum = [T::ZERO; WIDTH];
        for (&g, row) in gain.iter().zip(obs.rows().chunks_exact(n)) {
            let (g, w) = (T::from_f64(g), &row[k..k + WIDTH]);
            for l in 0..WIDTH {
                sum[l] += g * w[l];
            }
        }
        for l in 0..WIDTH {
            m[l] += v[l] * sum[l];
        }
        k += WIDTH;
    }
    for (m, &v) in rest.iter_mut().zip(rest_variance) {
        let rows = gain.iter().zip(obs.rows().chunks_exact(n));
        *m += v * rows.map(|(&g, row)| T::from_f64(g) * row[k]).sum();
        k += 1;
    }
}

/// Sets negative values to zero and returns their number.
pub(crate) fn project<T: Scalar>(values: &mut [T]) -> usize {
    let mut moved = 0u32;
    for x in values {
        moved += u32::from(*x < T::ZERO);
        *x = if *x < T::ZERO { T::ZERO } else { *x };
    }
    moved as usize
}

/// [`project`] of the values at `points`.
pub(crate) fn project_at<T: Scalar>(points: &[u32], values: &mut [T]) -> usize {
    let mut moved = 0;
    for &p in points {
        let x = &mut values[p as usize];
        if *x < T::ZERO {
            *x = T::ZERO;
            moved += 1;
        }
    }
    moved
}

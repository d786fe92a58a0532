//! Inner loops of a matrix cut into 8 x 8 squares. They are plain loops over arrays of eight, compiled once
//! for any processor and once for the vector instructions detected at run time. Every sum has a fixed
//! order.

use pulp::{Arch, Simd, WithSimd};
use vsf_core::Scalar;

/// Width of the inner loops.
pub(super) const OCTET: usize = 8;
/// Squares along the edge of a tile.
pub(super) const BANDS: usize = 8;
/// Rows and columns of a tile.
pub(super) const TILE: usize = BANDS * OCTET;
/// Squares of a tile, one band of eight rows after the other.
pub(super) const TILE_SQUARES: usize = BANDS * BANDS;
/// Rows whose sums stay in registers.
const ROWS: usize = 4;

/// Eight neighboring numbers, aligned so that no vector straddles a cache line.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub(super) struct Octet<T>(pub(super) [T; OCTET]);

/// Eight octets; of a tile `square[column][row]`.
pub(super) type Square<T> = [Octet<T>; OCTET];

pub(super) fn zero<T: Scalar>() -> Square<T> {
    [Octet([T::ZERO; OCTET]); OCTET]
}

/// A loop nest; `FMA` says whether the processor fuses products into sums.
pub(super) trait Kernel {
    fn run<const FMA: bool>(self);
}

/// Runs a kernel with the widest instructions there are.
pub(super) fn dispatch(kernel: impl Kernel) {
    struct Run<K>(K);
    impl<K: Kernel> WithSimd for Run<K> {
        type Output = ();
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            if S::IS_SCALAR {
                self.0.run::<false>();
            } else {
                self.0.run::<true>();
            }
        }
    }
    Arch::new().dispatch(Run(kernel));
}

/// `y += a x`.
#[inline(always)]
pub(super) fn add_scaled<T: Scalar, const FMA: bool>(y: &mut Octet<T>, a: T, x: &Octet<T>) {
    for l in 0..OCTET {
        y.0[l] = if FMA {
            a.mul_add(x.0[l], y.0[l])
        } else {
            a * x.0[l] + y.0[l]
        };
    }
}

/// `part[c] -= sum_k columns[k][first + c] rows[k]` over the squares at `positions`.
#[inline(always)]
fn subtract_outer<T: Scalar, const FMA: bool, const N: usize>(
    part: &mut [Octet<T>; N],
    first: usize,
    rows: &[Square<T>],
    columns: &[Square<T>],
    positions: &[usize],
) {
    let mut sum = *part;
    for &p in positions {
        for (row, column) in rows[p].iter().zip(&columns[p]) {
            for (sum, &c) in sum.iter_mut().zip(&column.0[first..first + N]) {
                add_scaled::<T, FMA>(sum, -c, row);
            }
        }
    }
    *part = sum;
}

/// `square[c][l] -= sum_k columns[k][c] rows[k][l]`, ranks `k` of the squares at `positions`.
#[inline(always)]
pub(super) fn downdate<T: Scalar, const FMA: bool>(
    square: &mut Square<T>,
    rows: &[Square<T>],
    columns: &[Square<T>],
    positions: &[usize],
) {
    // As many sums as fit into sixteen registers of 32 bytes.
    if size_of::<T>() == 4 {
        subtract_outer::<T, FMA, OCTET>(square, 0, rows, columns, positions);
    } else {
        let (halves, _) = square.as_chunks_mut::<{ OCTET / 2 }>();
        for (first, half) in [0, OCTET / 2].into_iter().zip(halves) {
            subtract_outer::<T, FMA, { OCTET / 2 }>(half, first, rows, columns, positions);
        }
    }
}

/// `sum[k] += sum_i a[k][i] b[i]`.
#[inline(always)]
pub(super) fn multiply_square<T: Scalar, const FMA: bool>(
    sum: &mut Square<T>,
    a: &Square<T>,
    b: &Square<T>,
) {
    for (sum, a) in sum.iter_mut().zip(a) {
        for (&a, b) in a.0.iter().zip(b) {
            add_scaled::<T, FMA>(sum, a, b);
        }
    }
}

/// Rows and columns of vectors that a tile multiplies: `w` goes in, `y` comes out.
pub(super) struct Strip<'a, T> {
    pub(super) w: &'a [Square<T>],
    pub(super) y: &'a mut [Square<T>],
}

/// `rows.y += tile columns.w` if `DOWN`, `columns.y += tile^T rows.w` if `ACROSS`, eight channels
/// at a time, in one pass over the tile.
#[inline(always)]
pub(super) fn multiply<T: Scalar, const FMA: bool, const DOWN: bool, const ACROSS: bool>(
    tile: &[Square<T>],
    rows: &mut Strip<'_, T>,
    columns: &mut Strip<'_, T>,
) {
    let bands = tile.chunks_exact(BANDS).zip(rows.w).zip(&mut *rows.y);
    for ((band, w), y) in bands {
        for first in [0, ROWS] {
            let (mut sums, mut weights) = ([Octet([T::ZERO; OCTET]); ROWS], [w[0]; ROWS]);
            sums.copy_from_slice(&y[first..first + ROWS]);
            weights.copy_from_slice(&w[first..first + ROWS]);
            let columns = band.iter().zip(columns.w).zip(&mut *columns.y);
            for ((square, w), y) in columns {
                for ((column, w), y) in square.iter().zip(w).zip(y) {
                    let mut across = *y;
                    for i in 0..ROWS {
                        let entry = column.0[first + i];
                        if DOWN {
                            add_scaled::<T, FMA>(&mut sums[i], entry, w);
                        }
                        if ACROSS {
                            add_scaled::<T, FMA>(&mut across, entry, &weights[i]);
                        }
                    }
                    if ACROSS {
                        *y = across;
                    }
                }
            }
            if DOWN {
                y[first..first + ROWS].copy_from_slice(&sums);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares(seed: usize, count: usize) -> Vec<Square<f64>> {
        let number = |i: usize| ((i * 37 + seed * 101) % 64) as f64 / 16.0 - 2.0;
        let octet = |i: usize| Octet(std::array::from_fn(|l| number(8 * i + l)));
        (0..count)
            .map(|s| std::array::from_fn(|c| octet(8 * s + c)))
            .collect()
    }

    /// Row `i` and column `j` of a tile.
    fn entry(tile: &[Square<f64>], i: usize, j: usize) -> f64 {
        tile[i / OCTET * BANDS + j / OCTET][j % OCTET].0[i % OCTET]
    }

    /// All numbers are sixteenths, so that every sum is exact, fused or not.
    fn check<const FMA: bool>() {
        let tile = squares(1, TILE_SQUARES);
        let (w, v) = (squares(2, BANDS), squares(3, BANDS));
        let (mut down, mut across) = (squares(4, BANDS), squares(5, BANDS));
        multiply::<f64, FMA, true, true>(
            &tile,
            &mut Strip {
                w: &w,
                y: &mut down,
            },
            &mut Strip {
                w: &v,
                y: &mut across,
            },
        );
        let row = |x: &[Square<f64>], i: usize, l: usize| x[i / OCTET][i % OCTET].0[l];
        for (i, l) in (0..TILE).flat_map(|i| (0..OCTET).map(move |l| (i, l))) {
            let sum: f64 = (0..TILE).map(|j| entry(&tile, i, j) * row(&v, j, l)).sum();
            assert_eq!(row(&down, i, l), row(&squares(4, BANDS), i, l) + sum);
            let sum: f64 = (0..TILE).map(|j| entry(&tile, j, i) * row(&w, j, l)).sum();
            assert_eq!(row(&across, i, l), row(&squares(5, BANDS), i, l) + sum);
        }

        let mut square = tile[0];
        downdate::<f64, FMA>(&mut square, &w, &v, &[1, 6]);
        let mut product = tile[0];
        multiply_square::<f64, FMA>(&mut product, &w[0], &v[0]);
        for (c, l) in (0..OCTET).flat_map(|c| (0..OCTET).map(move |l| (c, l))) {
            let ranks = [1, 6]
                .into_iter()
                .flat_map(|p| (0..OCTET).map(move |k| (p, k)));
            let sum: f64 = ranks.map(|(p, k)| v[p][k].0[c] * w[p][k].0[l]).sum();
            assert_eq!(square[c].0[l], tile[0][c].0[l] - sum);
            let sum: f64 = (0..OCTET).map(|i| w[0][c].0[i] * v[0][i].0[l]).sum();
            assert_eq!(product[c].0[l], tile[0][c].0[l] + sum);
        }
    }

    #[test]
    fn with_and_without_fused_products() {
        check::<false>();
        check::<true>();
    }
}

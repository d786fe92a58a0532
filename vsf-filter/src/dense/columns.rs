//! Columns of a tiled matrix, a block at a time.

use super::square::{
    BANDS, Kernel, OCTET, Octet, Square, TILE_SQUARES, add_scaled, dispatch, downdate, zero,
};
use super::tiles::Tiles;
use vsf_core::Scalar;

/// Numbers of the rows of one block, `vector[band][row]`.
pub(super) type Vector<T> = Square<T>;

impl<T: Scalar> Tiles<T> {
    /// The rows and columns of a block, as a tile. The tile is whole.
    pub(super) fn diagonal(&self, block: usize, out: &mut Vec<Square<T>>) {
        let panel = &self.panels[block];
        out.clear();
        out.extend_from_slice(&panel.tiles[block * TILE_SQUARES..][..TILE_SQUARES]);
        dispatch(Diagonal {
            ranks: &self.ranks[block * BANDS * self.ring..][..BANDS * self.ring],
            ring: self.ring,
            pending: (panel.applied, self.pushed),
            out,
        });
    }

    /// `x += P delta` for a `delta` that is zero outside of one block. On one thread: to wake others
    /// takes as long as their share would.
    pub(super) fn add_columns(
        &self,
        block: usize,
        delta: &Vector<T>,
        x: &mut [Vector<T>],
        inner: &mut Vec<Octet<T>>,
    ) {
        inner.clear();
        inner.resize(self.ring, Octet([T::ZERO; OCTET]));
        dispatch(Inner {
            ranks: &self.ranks[block * BANDS * self.ring..][..BANDS * self.ring],
            delta,
            inner,
        });
        for (row, x) in x.iter_mut().enumerate() {
            dispatch(Add {
                tiles: self,
                block,
                row,
                delta,
                inner,
                x,
            });
        }
    }
}

/// Subtracts the waiting ranks from a diagonal tile.
struct Diagonal<'a, T> {
    ranks: &'a [Square<T>],
    ring: usize,
    pending: (usize, usize),
    out: &'a mut [Square<T>],
}

impl<T: Scalar> Kernel for Diagonal<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rings = || self.ranks.chunks_exact(self.ring);
        for (squares, rows) in self.out.chunks_exact_mut(BANDS).zip(rings()) {
            for (square, columns) in squares.iter_mut().zip(rings()) {
                for group in self.pending.0..self.pending.1 {
                    downdate::<T, FMA>(square, rows, columns, &[group % self.ring]);
                }
            }
        }
    }
}

/// `V^T delta` of one block, eight ranks for every place of the ring.
struct Inner<'a, T> {
    ranks: &'a [Square<T>],
    delta: &'a Vector<T>,
    inner: &'a mut [Octet<T>],
}

impl<T: Scalar> Kernel for Inner<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rings = self.ranks.chunks_exact(self.inner.len());
        for (delta, ring) in self.delta.iter().zip(rings) {
            for (sums, ranks) in self.inner.iter_mut().zip(ring) {
                for (sum, rank) in sums.0.iter_mut().zip(ranks) {
                    *sum += dot(rank, delta);
                }
            }
        }
    }
}

/// `x += P delta` for a block of rows `x` and a block of columns.
struct Add<'a, T: Scalar> {
    tiles: &'a Tiles<T>,
    block: usize,
    row: usize,
    delta: &'a Vector<T>,
    inner: &'a [Octet<T>],
    x: &'a mut Vector<T>,
}

impl<T: Scalar> Kernel for Add<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self { block, row, .. } = self;
        let panel = &self.tiles.panels[row.max(block)];
        let tile = &panel.tiles[row.min(block) * TILE_SQUARES..][..TILE_SQUARES];
        if row >= block {
            for (band, delta) in self.delta.iter().enumerate() {
                combine::<T, FMA>(self.x, delta, |to| &tile[to * BANDS + band]);
            }
        } else {
            for (band, x) in self.x.iter_mut().enumerate() {
                let squares = tile.iter().skip(band).step_by(BANDS);
                add_transposed::<T, FMA>(x, squares.zip(self.delta));
            }
        }
        let ring = self.tiles.ring;
        let ranks = &self.tiles.ranks[row * BANDS * ring..][..BANDS * ring];
        for place in (panel.applied..self.tiles.pushed).map(|group| group % ring) {
            let minus = Octet(self.inner[place].0.map(|x| -x));
            combine::<T, FMA>(self.x, &minus, |to| &ranks[to * ring + place]);
        }
    }
}

/// `x[to] += sum_k factors[k] squares(to)[k]`, as many sums at a time as hide each other's latency.
#[inline(always)]
fn combine<'a, T: Scalar, const FMA: bool>(
    x: &mut Vector<T>,
    factors: &Octet<T>,
    squares: impl Fn(usize) -> &'a Square<T>,
) {
    const SUMS: usize = 4;
    for first in (0..BANDS).step_by(SUMS) {
        let squares: [_; SUMS] = std::array::from_fn(|s| squares(first + s));
        let mut sums: [_; SUMS] = std::array::from_fn(|s| x[first + s]);
        for (k, &factor) in factors.0.iter().enumerate() {
            for (sum, square) in sums.iter_mut().zip(squares) {
                add_scaled::<T, FMA>(sum, factor, &square[k]);
            }
        }
        x[first..first + SUMS].copy_from_slice(&sums);
    }
}

/// `x[c] += sum square[c] . delta` over pairs of a square and a part of `delta`.
#[inline(always)]
fn add_transposed<'a, T: Scalar, const FMA: bool>(
    x: &mut Octet<T>,
    pairs: impl Iterator<Item = (&'a Square<T>, &'a Octet<T>)>,
) {
    let mut sums = zero::<T>();
    for (square, delta) in pairs {
        for (sum, column) in sums.iter_mut().zip(square) {
            for l in 0..OCTET {
                let (a, b) = (column.0[l], delta.0[l]);
                sum.0[l] = if FMA {
                    a.mul_add(b, sum.0[l])
                } else {
                    a * b + sum.0[l]
                };
            }
        }
    }
    for (x, sum) in x.0.iter_mut().zip(sums) {
        *x += sum.0.into_iter().sum();
    }
}

#[inline(always)]
fn dot<T: Scalar>(a: &Octet<T>, b: &Octet<T>) -> T {
    a.0.iter().zip(&b.0).map(|(&a, &b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::super::channels::Channels;
    use super::super::square::TILE;
    use super::*;

    /// Numbers of which all sums are exact.
    fn number(i: usize) -> f64 {
        ((i * 37) % 64) as f64 / 16.0 - 2.0
    }

    #[test]
    fn columns_are_those_of_the_entries() {
        let n = 3 * TILE - 5;
        let mut tiles = Tiles::<f64>::new();
        for row in 0..n {
            tiles.push();
            (0..=row).for_each(|column| tiles.set(row, column, number(row * row + 3 * column)));
        }
        // More ranks than fit: some blocks have subtracted theirs, others wait.
        for update in 0..11 {
            let mut v = Channels::default();
            v.clear(n, 3);
            for (row, k) in (0..n).flat_map(|row| (0..3).map(move |k| (row, k))) {
                v.set(row, k, number(7 * row + 11 * k + update));
            }
            tiles.settle(v.groups());
            tiles.downdate(&v);
        }
        for block in 0..3 {
            let mut tile = Vec::new();
            tiles.diagonal(block, &mut tile);
            let mut delta = zero();
            let mut x = vec![zero(); 3];
            let slots = block * TILE..((block + 1) * TILE).min(n);
            for slot in slots.clone() {
                let i = slot % TILE;
                delta[i / OCTET].0[i % OCTET] = number(slot);
                for other in slots.clone() {
                    let j = other % TILE;
                    let square = &tile[i / OCTET * BANDS + j / OCTET];
                    let entry = square[j % OCTET].0[i % OCTET];
                    assert_eq!(entry, tiles.get(slot, other));
                }
            }
            tiles.add_columns(block, &delta, &mut x, &mut Vec::new());
            for row in 0..n {
                let products = slots
                    .clone()
                    .map(|slot| tiles.get(row, slot) * number(slot));
                let (got, i) = (&x[row / TILE], row % TILE);
                assert_eq!(got[i / OCTET].0[i % OCTET], products.sum::<f64>(), "{row}");
            }
        }
    }
}

//! Columns of a tiled matrix, a block at a time.

use super::square::{
    BANDS, Kernel, OCTET, Octet, Square, TILE_SQUARES, add_scaled, dispatch, downdate,
};
use super::tiles::{Tiles, for_chunks};
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

    /// `x += P delta` for a `delta` that is zero outside of one block.
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
        let inner = &*inner;
        for_chunks(self.parallel(), x, 1, |row, x| {
            for x in x {
                dispatch(Add {
                    tiles: self,
                    block,
                    row,
                    delta,
                    inner,
                    x,
                });
            }
        });
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
        let Self {
            tiles,
            block,
            row,
            delta,
            x,
            ..
        } = self;
        let panel = &tiles.panels[row.max(block)];
        let tile = &panel.tiles[row.min(block) * TILE_SQUARES..][..TILE_SQUARES];
        if row >= block {
            for (x, squares) in x.iter_mut().zip(tile.chunks_exact(BANDS)) {
                let mut sum = *x;
                for (square, delta) in squares.iter().zip(delta) {
                    for (column, &delta) in square.iter().zip(&delta.0) {
                        add_scaled::<T, FMA>(&mut sum, delta, column);
                    }
                }
                *x = sum;
            }
        } else {
            for (c, x) in x.iter_mut().enumerate() {
                let mut sums = [Octet([T::ZERO; OCTET]); OCTET];
                for (squares, delta) in tile.chunks_exact(BANDS).zip(delta) {
                    for (sum, column) in sums.iter_mut().zip(&squares[c]) {
                        for l in 0..OCTET {
                            sum.0[l] = if FMA {
                                column.0[l].mul_add(delta.0[l], sum.0[l])
                            } else {
                                column.0[l] * delta.0[l] + sum.0[l]
                            };
                        }
                    }
                }
                for (x, sum) in x.0.iter_mut().zip(sums) {
                    *x += sum.0.into_iter().sum();
                }
            }
        }
        let ring = tiles.ring;
        let rings = tiles.ranks[row * BANDS * ring..][..BANDS * ring].chunks_exact(ring);
        for (x, ranks) in x.iter_mut().zip(rings) {
            let mut sum = *x;
            for group in panel.applied..tiles.pushed {
                let place = group % ring;
                for (rank, &inner) in ranks[place].iter().zip(&self.inner[place].0) {
                    add_scaled::<T, FMA>(&mut sum, -inner, rank);
                }
            }
            *x = sum;
        }
    }
}

#[inline(always)]
fn dot<T: Scalar>(a: &Octet<T>, b: &Octet<T>) -> T {
    a.0.iter().zip(&b.0).map(|(&a, &b)| a * b).sum()
}

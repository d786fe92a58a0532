//! Products of a tiled matrix.

use super::channels::Channels;
use super::square::{
    BANDS, Kernel, OCTET, Square, Strip, TILE_SQUARES, dispatch, downdate, multiply,
    multiply_square, zero,
};
use super::tiles::{Panel, Tiles, for_chunks};
use vsf_core::Scalar;

/// Partial sums of a product. A fixed number, so that results do not depend on threads.
const LANES: usize = 8;

/// Buffers of [`Tiles::times`].
#[derive(Debug, Clone, Default)]
pub(super) struct Workspace<T> {
    /// Partial sums.
    lanes: Vec<Channels<T>>,
    /// Which blocks of the factor are not zero.
    touched: Vec<bool>,
    /// `V^T W` of every block, then what `V` is multiplied with.
    inner: Vec<Square<T>>,
    outer: Vec<Square<T>>,
}

impl<T: Scalar> Tiles<T> {
    /// `y = P w`. Tiles that meet only zeros of `w` are not read.
    pub(super) fn times(&self, w: &Channels<T>, y: &mut Channels<T>, work: &mut Workspace<T>) {
        let blocks = self.panels.len();
        let channels = w.groups() * OCTET;
        y.clear(self.len, channels);
        work.touched.clear();
        work.touched.extend((0..blocks).map(|block| {
            let rows = block * BANDS..(block + 1) * BANDS;
            let mut groups = (0..w.groups()).map(|g| &w.group(g)[rows.clone()]);
            groups.any(|rows| rows.iter().any(|square| *square != zero()))
        }));
        let Workspace {
            lanes,
            touched,
            inner,
            outer,
        } = work;
        let parallel = self.parallel();
        lanes.resize_with(LANES, Channels::default);
        for_chunks(parallel, lanes, 1, |lane, sums| {
            for y in sums {
                y.clear(self.len, channels);
                dispatch(Multiply {
                    panels: &self.panels,
                    touched,
                    lane,
                    w,
                    y,
                });
            }
        });
        for group in 0..w.groups() {
            let w = w.group(group);
            inner.clear();
            inner.resize(blocks * self.ring, zero());
            for_chunks(parallel, inner, self.ring, |block, inner| {
                if touched[block] {
                    dispatch(Inner {
                        ranks: &self.ranks[block * BANDS * self.ring..],
                        w: &w[block * BANDS..(block + 1) * BANDS],
                        inner,
                    });
                }
            });
            self.gather(inner, outer);
            for_chunks(parallel, y.group_mut(group), BANDS, |block, y| {
                dispatch(Outer {
                    lanes,
                    group,
                    block,
                    ranks: &self.ranks[block * BANDS * self.ring..],
                    outer: &outer[block * self.ring..(block + 1) * self.ring],
                    y,
                });
            });
        }
    }

    /// What a block of `V` has to be multiplied with, from `V^T w` of all blocks.
    ///
    /// A tile `(i, j)`, `j <= i`, lacks the ranks that panel `i` lacks. So block `i` of `V` meets
    /// the blocks up to itself with the ranks of its own panel, and those after it with the ranks
    /// of theirs.
    fn gather(&self, inner: &[Square<T>], outer: &mut Vec<Square<T>>) {
        let ring = self.ring;
        outer.clear();
        outer.resize(inner.len(), zero());
        for position in 0..ring {
            let newest = (self.pushed - 1) - (self.pushed - 1 - position) % ring;
            let lacks = |block: usize| newest >= self.panels[block].applied;
            let places = |block: usize| block * ring + position;
            let mut sum = zero();
            for block in 0..self.panels.len() {
                add(&mut sum, &inner[places(block)]);
                if lacks(block) {
                    add(&mut outer[places(block)], &sum);
                }
            }
            let mut sum = zero();
            for block in (0..self.panels.len()).rev() {
                add(&mut outer[places(block)], &sum);
                if lacks(block) {
                    add(&mut sum, &inner[places(block)]);
                }
            }
        }
    }
}

/// Adds the products of every `LANES`th panel, there and back so that lanes are of equal size.
struct Multiply<'a, T> {
    panels: &'a [Panel<T>],
    touched: &'a [bool],
    lane: usize,
    w: &'a Channels<T>,
    y: &'a mut Channels<T>,
}

impl<T: Scalar> Kernel for Multiply<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rows = |block: usize| block * BANDS..(block + 1) * BANDS;
        let mut none = [zero(); BANDS];
        for (i, panel) in self.panels.iter().enumerate() {
            let turn = i % (2 * LANES);
            if turn.min(2 * LANES - 1 - turn) != self.lane {
                continue;
            }
            for (j, tile) in panel.tiles.chunks_exact(TILE_SQUARES).enumerate() {
                for group in 0..self.w.groups() {
                    let w = self.w.group(group);
                    let (before, from_i) = self.y.group_mut(group).split_at_mut(i * BANDS);
                    let mut down = Strip {
                        w: &w[rows(i)],
                        y: &mut from_i[..BANDS],
                    };
                    let diagonal = i == j;
                    let mut across = Strip {
                        w: &w[rows(j)],
                        y: if diagonal {
                            &mut none
                        } else {
                            &mut before[rows(j)]
                        },
                    };
                    match (self.touched[j], self.touched[i] && !diagonal) {
                        (true, true) => {
                            multiply::<T, FMA, true, true>(tile, &mut down, &mut across);
                        }
                        (true, false) => {
                            multiply::<T, FMA, true, false>(tile, &mut down, &mut across);
                        }
                        (false, true) => {
                            multiply::<T, FMA, false, true>(tile, &mut down, &mut across);
                        }
                        (false, false) => {}
                    }
                }
            }
        }
    }
}

/// `V^T w` of one block, for every place of the ring.
struct Inner<'a, T> {
    ranks: &'a [Square<T>],
    w: &'a [Square<T>],
    inner: &'a mut [Square<T>],
}

impl<T: Scalar> Kernel for Inner<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rings = self.ranks.chunks_exact(self.inner.len());
        for (w, ring) in self.w.iter().zip(rings) {
            for (sum, rank) in self.inner.iter_mut().zip(ring) {
                multiply_square::<T, FMA>(sum, rank, w);
            }
        }
    }
}

/// One block of the product: the sum of the lanes less the ranks that wait.
struct Outer<'a, T> {
    lanes: &'a [Channels<T>],
    group: usize,
    block: usize,
    ranks: &'a [Square<T>],
    outer: &'a [Square<T>],
    y: &'a mut [Square<T>],
}

impl<T: Scalar> Kernel for Outer<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let rings = self.ranks.chunks_exact(self.outer.len());
        for (band, (y, ring)) in self.y.iter_mut().zip(rings).enumerate() {
            for lane in self.lanes {
                add(y, &lane.group(self.group)[self.block * BANDS + band]);
            }
            for position in 0..ring.len() {
                downdate::<T, FMA>(y, self.outer, ring, &[position]);
            }
        }
    }
}

#[inline(always)]
fn add<T: Scalar>(sum: &mut Square<T>, x: &Square<T>) {
    for (sum, x) in sum.iter_mut().zip(x) {
        for (sum, &x) in sum.0.iter_mut().zip(&x.0) {
            *sum += x;
        }
    }
}

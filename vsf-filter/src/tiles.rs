//! A symmetric matrix that grows and is downdated, for covariances of thousands of points.

use crate::tile_kernel::{
    BANDS, Kernel, OCTET, Square, Strip, TILE, TILE_SQUARES, dispatch, downdate, multiply,
    multiply_square, zero,
};
use rayon::prelude::*;
use vsf_core::Scalar;

/// Groups of eight ranks that may wait before they are subtracted.
const RING: usize = 8;
/// Partial sums of a product. A fixed number, so that results do not depend on threads.
const LANES: usize = 8;
/// Blocks of rows from which on threads pay off.
const PARALLEL: usize = 16;

/// Vectors of eight channels a group, one number per row of a matrix; rows padded to whole tiles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Channels<T> {
    rows: usize,
    groups: usize,
    /// Group after group; `square[row][channel]`.
    squares: Vec<Square<T>>,
}

impl<T: Scalar> Channels<T> {
    /// Zeros for a matrix of `rows` rows.
    pub(crate) fn clear(&mut self, rows: usize, channels: usize) {
        self.rows = rows.next_multiple_of(TILE);
        self.groups = channels.div_ceil(OCTET);
        let len = self.groups * self.rows / OCTET;
        self.squares.clear();
        self.squares.resize(len, zero());
    }

    pub(crate) fn groups(&self) -> usize {
        self.groups
    }

    pub(crate) fn squares_mut(&mut self) -> &mut [Square<T>] {
        &mut self.squares
    }

    /// Squares of one group.
    pub(crate) fn group(&self, group: usize) -> &[Square<T>] {
        let len = self.rows / OCTET;
        &self.squares[group * len..][..len]
    }

    pub(crate) fn get(&self, row: usize, channel: usize) -> T {
        self.group(channel / OCTET)[row / OCTET][row % OCTET].0[channel % OCTET]
    }

    pub(crate) fn set(&mut self, row: usize, channel: usize, value: T) {
        let square = (channel / OCTET * self.rows + row) / OCTET;
        self.squares[square][row % OCTET].0[channel % OCTET] = value;
    }
}

/// A symmetric matrix `P = M - V V^T`: `M` in the lower tiles, `V` the ranks that are not yet
/// subtracted from them.
///
/// A tile is read and written once for many ranks, while a product reads only the tiles that meet
/// a non-zero row. Blocks of rows take turns, so that every update costs about the same.
#[derive(Debug, Clone)]
pub(crate) struct Tiles<T> {
    len: usize,
    panels: Vec<Panel<T>>,
    /// Groups of ranks that fit into the ring.
    ring: usize,
    /// Groups of ranks ever pushed, plus one ring.
    pushed: usize,
    /// `V`: for every eight rows a ring of squares `[rank][row]`.
    ranks: Vec<Square<T>>,
    /// Whether a block of rows of `V` is non-zero, for every place of the ring.
    live: Vec<bool>,
}

/// A block of rows up to and with the diagonal tile, which is stored whole.
#[derive(Debug, Clone)]
struct Panel<T> {
    tiles: Vec<Square<T>>,
    /// Groups of ranks that are subtracted.
    applied: usize,
}

/// Buffers of [`Tiles::times`].
#[derive(Debug, Clone, Default)]
pub(crate) struct Workspace<T> {
    /// Partial sums.
    lanes: Vec<Channels<T>>,
    /// Which blocks of the factor are not zero.
    touched: Vec<bool>,
    /// `V^T W` of every block, then what `V` is multiplied with.
    inner: Vec<Square<T>>,
    outer: Vec<Square<T>>,
}

impl<T: Scalar> Tiles<T> {
    pub(crate) fn new() -> Self {
        Self {
            len: 0,
            panels: Vec::new(),
            ring: RING,
            pushed: RING,
            ranks: Vec::new(),
            live: Vec::new(),
        }
    }

    /// Appends a row of zeros.
    pub(crate) fn push(&mut self) {
        if self.len.is_multiple_of(TILE) {
            let block = self.panels.len();
            self.panels.push(Panel {
                tiles: vec![zero(); (block + 1) * TILE_SQUARES],
                // All ranks are zero here; the offset only fixes the turn of the block.
                applied: self.pushed - block % self.ring,
            });
            self.ranks
                .resize(self.ranks.len() + BANDS * self.ring, zero());
            self.live.resize(self.live.len() + self.ring, false);
        }
        self.len += 1;
    }

    /// Sets an entry of a row without ranks: a row that was pushed after the last downdate.
    pub(crate) fn set(&mut self, row: usize, column: usize, value: T) {
        let (i, j) = (row.max(column), row.min(column));
        let tiles = &mut self.panels[i / TILE].tiles;
        *entry(tiles, i, j) = value;
        if i / TILE == j / TILE {
            *entry(tiles, j, i) = value;
        }
    }

    /// An entry of `P`.
    pub(crate) fn get(&self, row: usize, column: usize) -> T {
        let (i, j) = (row.max(column), row.min(column));
        let panel = &self.panels[i / TILE];
        let (square, lane) = place(i, j);
        let mut value = panel.tiles[square][j % OCTET].0[lane];
        for position in self.pending(panel) {
            let rank = |i: usize| &self.ranks[i / OCTET * self.ring + position];
            let products = rank(i).iter().zip(rank(j));
            value -= products.map(|(a, b)| a.0[i % OCTET] * b.0[j % OCTET]).sum();
        }
        value
    }

    /// Places in the ring of the ranks that a panel still lacks.
    fn pending(&self, panel: &Panel<T>) -> impl Iterator<Item = usize> {
        let ring = self.ring;
        (panel.applied..self.pushed).map(move |group| group % ring)
    }

    fn parallel(&self) -> bool {
        self.panels.len() >= PARALLEL && rayon::current_num_threads() > 1
    }

    /// Subtracts the ranks of `v` (`P -= v v^T`). Needs room made by [`Tiles::settle`].
    pub(crate) fn downdate(&mut self, v: &Channels<T>) {
        for group in 0..v.groups() {
            let position = self.pushed % self.ring;
            let rings = self.ranks.chunks_exact_mut(self.ring);
            for (ring, rows) in rings.zip(v.group(group)) {
                for (k, rank) in ring[position].iter_mut().enumerate() {
                    for (to, row) in rank.0.iter_mut().zip(rows) {
                        *to = row.0[k];
                    }
                }
            }
            let blocks = v.group(group).chunks_exact(BANDS);
            for (live, rows) in self.live.chunks_exact_mut(self.ring).zip(blocks) {
                live[position] = rows.iter().any(|square| *square != zero());
            }
            self.pushed += 1;
        }
    }

    /// Makes room for `groups` more groups of ranks: subtracts what waits from the blocks whose
    /// turn it is. `P` stays the same.
    pub(crate) fn settle(&mut self, groups: usize) {
        let parallel = self.parallel();
        let Self {
            panels,
            ranks,
            live,
            ring,
            pushed,
            ..
        } = self;
        for_chunks(parallel, panels, 1, |block, panel| {
            for panel in panel {
                if *pushed - panel.applied + groups > *ring {
                    dispatch(Apply {
                        block,
                        panel,
                        ranks,
                        live,
                        ring: *ring,
                        pushed: *pushed,
                    });
                    panel.applied = *pushed;
                }
            }
        });
        if groups > self.ring {
            // More ranks at once than ever before; nothing waits now.
            self.ring = groups;
            self.pushed = self.pushed.max(groups);
            let blocks = self.panels.len();
            for (block, panel) in self.panels.iter_mut().enumerate() {
                panel.applied = self.pushed - block % groups;
            }
            self.ranks.clear();
            self.ranks.resize(blocks * BANDS * groups, zero());
            self.live.clear();
            self.live.resize(blocks * groups, false);
        }
    }

    /// `y = P w`. Tiles that meet only zeros of `w` are not read.
    pub(crate) fn times(&self, w: &Channels<T>, y: &mut Channels<T>, work: &mut Workspace<T>) {
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
            let len = w.len();
            let y = &mut y.squares[group * len..][..len];
            for_chunks(parallel, y, BANDS, |block, y| {
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

/// Calls `f` with the number of every chunk and the chunk.
fn for_chunks<I: Send>(
    parallel: bool,
    items: &mut [I],
    size: usize,
    f: impl Fn(usize, &mut [I]) + Send + Sync,
) {
    if parallel {
        let chunks = items.par_chunks_mut(size).enumerate();
        chunks.for_each(|(k, chunk)| f(k, chunk));
    } else {
        let chunks = items.chunks_mut(size).enumerate();
        chunks.for_each(|(k, chunk)| f(k, chunk));
    }
}

/// Square and row within it of an entry of a panel.
fn place(i: usize, j: usize) -> (usize, usize) {
    let band = i % TILE / OCTET;
    let square = j / TILE * TILE_SQUARES + band * BANDS + j % TILE / OCTET;
    (square, i % OCTET)
}

fn entry<T>(tiles: &mut [Square<T>], i: usize, j: usize) -> &mut T {
    let (square, lane) = place(i, j);
    &mut tiles[square][j % OCTET].0[lane]
}

/// Subtracts the waiting ranks from a panel.
struct Apply<'a, T> {
    block: usize,
    panel: &'a mut Panel<T>,
    ranks: &'a [Square<T>],
    live: &'a [bool],
    ring: usize,
    pushed: usize,
}

impl<T: Scalar> Kernel for Apply<'_, T> {
    #[inline(always)]
    fn run<const FMA: bool>(self) {
        let Self { ring, live, .. } = self;
        let strip = |block: usize| &self.ranks[block * BANDS * ring..(block + 1) * BANDS * ring];
        let mut positions = [0; 4 * RING];
        for (j, tile) in self.panel.tiles.chunks_exact_mut(TILE_SQUARES).enumerate() {
            let mut waiting = self.panel.applied..self.pushed;
            // A ring that was made larger goes by parts.
            while !waiting.is_empty() {
                let mut count = 0;
                for group in waiting.by_ref().take(positions.len()) {
                    let p = group % ring;
                    if live[self.block * ring + p] && live[j * ring + p] {
                        positions[count] = p;
                        count += 1;
                    }
                }
                if count == 0 {
                    continue;
                }
                let bands = strip(self.block).chunks_exact(ring);
                for (squares, rows) in tile.chunks_exact_mut(BANDS).zip(bands) {
                    for (square, columns) in squares.iter_mut().zip(strip(j).chunks_exact(ring)) {
                        downdate::<T, FMA>(square, rows, columns, &positions[..count]);
                    }
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
                    let len = w.len();
                    let y = &mut self.y.squares[group * len..][..len];
                    let (before, from_i) = y.split_at_mut(i * BANDS);
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

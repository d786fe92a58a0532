//! A symmetric matrix that can grow and be downdated, for covariances of thousands of points.

use super::channels::Channels;
use super::square::{BANDS, Kernel, OCTET, Square, TILE, TILE_SQUARES, dispatch, downdate, zero};
use rayon::prelude::*;
use vsf_core::Scalar;

/// Groups of eight ranks that may wait before they are subtracted.
const RING: usize = 8;
/// Blocks of rows from which on threads pay off.
const PARALLEL: usize = 16;

/// A symmetric matrix `P = M - V V^T`: `M` in the lower tiles, `V` the ranks that are not yet
/// subtracted from them.
///
/// A tile is read and written once for many ranks, while a product reads only the tiles that meet
/// a non-zero row. Blocks of rows take turns, so that every update costs about the same.
#[derive(Debug, Clone)]
pub(super) struct Tiles<T> {
    pub(super) len: usize,
    pub(super) panels: Vec<Panel<T>>,
    /// Groups of ranks that fit into the ring.
    pub(super) ring: usize,
    /// Groups of ranks ever pushed, plus one ring.
    pub(super) pushed: usize,
    /// `V`: for every eight rows a ring of squares `[rank][row]`.
    pub(super) ranks: Vec<Square<T>>,
    /// Whether a block of rows of `V` is non-zero, for every place of the ring.
    live: Vec<bool>,
}

/// A block of rows up to and with the diagonal tile, which is stored whole.
#[derive(Debug, Clone)]
pub(super) struct Panel<T> {
    pub(super) tiles: Vec<Square<T>>,
    /// Groups of ranks that are subtracted.
    pub(super) applied: usize,
}

impl<T: Scalar> Tiles<T> {
    pub(super) fn new() -> Self {
        Self {
            len: 0,
            panels: Vec::new(),
            ring: RING,
            pushed: RING,
            ranks: Vec::new(),
            live: Vec::new(),
        }
    }

    /// From what was saved; `[ring, pushed]`.
    #[cfg(feature = "serde")]
    pub(super) fn restored(
        len: usize,
        panels: Vec<Panel<T>>,
        [ring, pushed]: [usize; 2],
        ranks: Vec<Square<T>>,
    ) -> Self {
        let mut live = vec![false; panels.len() * ring];
        for (i, square) in ranks.iter().enumerate() {
            live[i / (BANDS * ring) * ring + i % ring] |= *square != zero();
        }
        Self {
            len,
            panels,
            ring,
            pushed,
            ranks,
            live,
        }
    }

    /// Appends a row of zeros.
    pub(super) fn push(&mut self) {
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
    pub(super) fn set(&mut self, row: usize, column: usize, value: T) {
        let (i, j) = (row.max(column), row.min(column));
        let tiles = &mut self.panels[i / TILE].tiles;
        *entry(tiles, i, j) = value;
        if i / TILE == j / TILE {
            *entry(tiles, j, i) = value;
        }
    }

    /// Adds a value to the diagonal.
    pub(super) fn add_to_diagonal(&mut self, value: T) {
        for i in 0..self.len {
            *entry(&mut self.panels[i / TILE].tiles, i, i) += value;
        }
    }

    /// An entry of `P`.
    pub(super) fn get(&self, row: usize, column: usize) -> T {
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

    pub(super) fn parallel(&self) -> bool {
        self.panels.len() >= PARALLEL && rayon::current_num_threads() > 1
    }

    /// Subtracts the ranks of `v` (`P -= v v^T`). Needs room made by [`Tiles::settle`].
    pub(super) fn downdate(&mut self, v: &Channels<T>) {
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
    pub(super) fn settle(&mut self, groups: usize) {
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
}

/// Calls `f` with the number of every chunk and the chunk.
pub(super) fn for_chunks<I: Send>(
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

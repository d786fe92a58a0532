use super::square::{OCTET, Square, TILE, zero};
use vsf_core::Scalar;

/// Vectors of eight channels a group, one number per row of a matrix; rows padded to whole tiles.
#[derive(Debug, Clone, Default)]
pub(super) struct Channels<T> {
    rows: usize,
    groups: usize,
    /// Group after group; `square[row][channel]`.
    squares: Vec<Square<T>>,
}

impl<T: Scalar> Channels<T> {
    /// Zeros for a matrix of `rows` rows.
    pub(super) fn clear(&mut self, rows: usize, channels: usize) {
        self.rows = rows.next_multiple_of(TILE);
        self.groups = channels.div_ceil(OCTET);
        let len = self.groups * self.rows / OCTET;
        self.squares.clear();
        self.squares.resize(len, zero());
    }

    pub(super) fn groups(&self) -> usize {
        self.groups
    }

    pub(super) fn group_mut(&mut self, group: usize) -> &mut [Square<T>] {
        let len = self.rows / OCTET;
        &mut self.squares[group * len..][..len]
    }

    /// Squares of all groups.
    pub(super) fn squares_mut(&mut self) -> &mut [Square<T>] {
        &mut self.squares
    }

    /// Squares of one group, one for every eight rows.
    pub(super) fn group(&self, group: usize) -> &[Square<T>] {
        let len = self.rows / OCTET;
        &self.squares[group * len..][..len]
    }

    pub(super) fn get(&self, row: usize, channel: usize) -> T {
        self.group(channel / OCTET)[row / OCTET][row % OCTET].0[channel % OCTET]
    }

    pub(super) fn set(&mut self, row: usize, channel: usize, value: T) {
        let square = (channel / OCTET * self.rows + row) / OCTET;
        self.squares[square][row % OCTET].0[channel % OCTET] = value;
    }
}

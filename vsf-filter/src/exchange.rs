//! Chooses which unknowns of a linear complementarity problem change sides, between free and held at the
//! bound.

/// Exchanges of the whole wrong set that may fail to make it smaller before single exchanges guarantee the end.
const PATIENCE: usize = 10;

/// Block principal pivoting exchanges all unknowns that came out wrong. When that stops making progress, exchanging the
/// last wrong one alone is finite (Murty's rule).
///
/// # Reference
/// J. J. Júdice, F. M. Pires, *A block principal pivoting algorithm for large-scale strictly monotone linear
/// complementarity problems*, Comput. Oper. Res. 21 (1994), doi 10.1016/0305-0548(94)90106-6.
pub(crate) struct Exchanges {
    fewest: usize,
    patience: usize,
    singles: usize,
}

impl Exchanges {
    /// Of `n` unknowns.
    pub(crate) fn new(n: usize) -> Self {
        Self {
            fewest: n + 1,
            patience: PATIENCE,
            singles: 0,
        }
    }

    /// How often one unknown was exchanged alone.
    pub(crate) fn singles(&self) -> usize {
        self.singles
    }

    /// Lets some of the `wrong` unknowns, in their order, change `sides`; none where there are none.
    pub(crate) fn exchange(&mut self, sides: &mut [bool], wrong: &[usize]) {
        if wrong.len() < self.fewest {
            (self.fewest, self.patience) = (wrong.len(), PATIENCE);
        } else {
            self.patience = self.patience.saturating_sub(1);
        }
        let changed = if self.patience > 0 {
            wrong
        } else {
            self.singles += 1;
            &wrong[wrong.len().saturating_sub(1)..]
        };
        changed.iter().for_each(|&i| sides[i] = !sides[i]);
    }
}

//! Other conventions of a table of readings: signs and order of its columns.

use vsf_robots::Joint;

/// For each joint, its column and the sign of that column.
pub type Columns = Vec<(usize, f64)>;

pub fn as_given(joints: usize) -> Columns {
    with_signs(&vec![1.0; joints])
}

pub fn with_signs(signs: &[f64]) -> Columns {
    signs.iter().copied().enumerate().collect()
}

/// How the order of columns may have been changed.
pub enum Order {
    Reversed,
    /// This many columns moved from the end to the start.
    Turned(usize),
    Exchanged(usize, usize),
}

impl Order {
    pub fn in_words(&self, joints: &[Joint]) -> String {
        let name = |j: usize| joints[j].name();
        match *self {
            Self::Reversed => "in reverse order".to_owned(),
            Self::Turned(by) => format!("turned on ({} in the column of {})", name(0), name(by)),
            Self::Exchanged(a, b) => format!("of {} and {} exchanged", name(a), name(b)),
        }
    }
}

/// All such orders, each once, with the column that each joint then takes.
pub fn orders(joints: usize) -> impl Iterator<Item = (Order, Columns)> {
    let with = move |change: &dyn Fn(&mut Columns)| {
        let mut columns = as_given(joints);
        change(&mut columns);
        columns
    };
    let reversed = (Order::Reversed, with(&|c| c.reverse()));
    let turned = (1..joints).map(move |by| (Order::Turned(by), with(&|c| c.rotate_left(by))));
    let pairs = (0..joints).flat_map(move |a| (a + 1..joints).map(move |b| (a, b)));
    let exchanged = pairs.map(move |(a, b)| (Order::Exchanged(a, b), with(&|c| c.swap(a, b))));
    // Of two and of three joints, some of them are the reverse order.
    let others = exchanged.chain(turned);
    let others = others.filter(move |(_, columns)| {
        (columns.iter().rev().enumerate()).any(|(place, (column, _))| place != *column)
    });
    others.chain([reversed])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_order_comes_once() {
        for (joints, count) in [(1, 1), (2, 1), (3, 5), (4, 6 + 3 + 1), (40, 780 + 39 + 1)] {
            let columns = |(_, columns): (Order, Columns)| -> Vec<usize> {
                columns.iter().map(|(column, _)| *column).collect()
            };
            let all: Vec<_> = orders(joints).map(columns).collect();
            assert_eq!(all.len(), count);
            assert_eq!(all.iter().collect::<BTreeSet<_>>().len(), count);
        }
    }
}

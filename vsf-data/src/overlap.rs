//! Test sequences that are cut out of train sequences.

use crate::{DataWarning, Dataset, Sequence};
use std::collections::BTreeSet;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

/// Rows are the same where no number differs by much more than this (rad, m, N m or N): no sensor reads the same twice.
const GRAIN: f64 = 1e-6;
/// Share of the rows of a test sequence, and number of them, that are a train sequence's, too.
const LEAST_SHARE: f64 = 0.5;
const LEAST_ROWS: usize = 8;

impl Dataset {
    /// Test sequences that hold rows of train sequences, trimmed or with rounding of another kind. Copies as a whole are told
    /// of as such. In time proportional to the rows.
    pub(crate) fn overlapping_sequences(&self, dir: &Path) -> Option<DataWarning> {
        let of = |ids: &[String]| -> Vec<(&Sequence, BTreeSet<u64>)> {
            let own = self.sequences.iter().filter(|s| ids.contains(&s.id));
            own.map(|s| (s, rows(s))).collect()
        };
        let (train, test) = (of(&self.splits.train), of(&self.splits.test));
        let overlap = |(s, own): &(&Sequence, BTreeSet<u64>)| {
            train.iter().find_map(|(of, others)| {
                let same = own.intersection(others).count();
                let is_copy = s.angles == of.angles && s.torques == of.torques;
                let overlaps = same >= LEAST_ROWS && same as f64 >= LEAST_SHARE * own.len() as f64;
                (overlaps && !is_copy).then(|| (s.id.clone(), of.id.clone(), same))
            })
        };
        let mut found = test.iter().filter_map(overlap);
        let (first, of, rows) = found.next()?;
        Some(DataWarning::OverlappingSequences {
            path: dir.to_owned(),
            first,
            of,
            rows,
            others: found.count(),
        })
    }
}

/// What tells the different rows of a sequence apart, without those that read nothing.
fn rows(sequence: &Sequence) -> BTreeSet<u64> {
    let pairs = sequence.angles.iter().zip(sequence.torques.iter());
    let read = pairs.filter(|(_, torques)| torques.iter().any(|t| *t != 0.0));
    let key = |(angles, torques): (&[f64], &[f64])| {
        let mut hasher = DefaultHasher::new();
        let numbers = angles.iter().chain(torques);
        numbers.for_each(|v| ((v / GRAIN).round() as i64).hash(&mut hasher));
        hasher.finish()
    };
    read.map(key).collect()
}

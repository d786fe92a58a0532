//! Test sequences that were cut out of train sequences.

use crate::{DataWarning, Dataset, Sequence};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

/// Rows are the same if no number differs by much more than this (rad, m, N m or N): no sensor reads the same twice.
const GRAIN: f64 = 1e-6;
/// Share and number of the rows of a test sequence that must also be in a train sequence.
const LEAST_SHARE: f64 = 0.5;
const LEAST_ROWS: usize = 8;

impl Dataset {
    /// Test sequences that contain rows of train sequences, even if trimmed or rounded differently.
    ///
    /// Complete copies are reported elsewhere. A row that is in several train sequences counts for the first one. Takes
    /// time proportional to the number of rows.
    pub(crate) fn overlapping_sequences(&self, dir: &Path) -> Option<DataWarning> {
        let train: Vec<&Sequence> = self.train().collect();
        let mut having: HashMap<u64, usize> = HashMap::new();
        for (k, sequence) in train.iter().enumerate() {
            for row in rows(sequence) {
                having.entry(row).or_insert(k);
            }
        }
        let overlap = |s: &Sequence| {
            let own = rows(s);
            let mut same: BTreeMap<usize, usize> = BTreeMap::new();
            for k in own.iter().filter_map(|row| having.get(row)) {
                *same.entry(*k).or_default() += 1;
            }
            let enough = |n: usize| n >= LEAST_ROWS && n as f64 >= LEAST_SHARE * own.len() as f64;
            let is_copy = |of: &Sequence| s.angles == of.angles && s.torques == of.torques;
            let mut of = same.into_iter().map(|(k, n)| (train[k], n));
            let (of, n) = of.find(|(of, n)| enough(*n) && !is_copy(of))?;
            Some((s.id.clone(), of.id.clone(), n))
        };
        let mut found = self.test().filter_map(overlap);
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

/// Hashes of the different rows of a sequence, without rows that read zero.
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

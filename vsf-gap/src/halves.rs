//! Test sequences cut in two.
//!
//! What differs in every sequence, such as the place of the object, shows where sequences touch the same places. It can be
//! checked only on the sequence that it was fitted to.

use crate::{Acts, Campaign, ContactLog, Effect, GapError, Model, Motion};
use std::ops::Range;

/// Smallest share of the samples in contact that each part of a sequence holds.
const LEAST: f64 = 0.25;

/// Whether an effect moves contacts by parameters of its own for every sequence.
pub(crate) fn is_of_sequences(effect: &dyn Effect, campaign: &Campaign) -> bool {
    let mut parameters = effect.parameters(&campaign.site).into_iter();
    effect.acts() == Acts::Contact && parameters.any(|p| p.sequence.is_some())
}

impl Campaign {
    /// The campaign with the first halves of its test sequences among the train sequences; the second halves are the test
    /// sequences.
    ///
    /// Left out are test sequences that do not let go of the object in between, or whose readings are relative to their
    /// start, which a second half does not have. `None` if all are left out.
    ///
    /// # Errors
    /// Rows that contact cannot take.
    pub(crate) fn halved(&self) -> Result<Option<Self>, GapError> {
        let tested: Vec<&Motion> = self.test.iter().collect();
        let logs = self.contact_logs(&Model::default(), &tested)?;
        let (mut train, mut test) = (self.train.to_vec(), Vec::new());
        for (motion, log) in tested.into_iter().zip(&logs) {
            if let Some(row) = middle(motion, log).filter(|_| motion.tare == 0) {
                train.push(motion.part(0..row)?);
                test.push(motion.part(row..motion.len())?);
            }
        }
        train.sort_by(|a, b| a.begin().total_cmp(&b.begin()));
        let mut halved = self.with_sequences(train, test);
        halved.held_out = false;
        Ok((!halved.test.is_empty()).then_some(halved))
    }
}

/// The row in the middle of the free motion, or at the start of a touch, that is nearest to the middle of the contact.
fn middle(motion: &Motion, log: &ContactLog) -> Option<usize> {
    let touching = |row: usize| !log.contacts[row].is_empty();
    let all = (0..motion.len()).filter(|row| touching(*row)).count();
    let mut begins = vec![false; motion.len()];
    let nonempty = motion.touches.iter().filter(|t| !t.is_empty());
    nonempty.for_each(|t| begins[t.start] = true);
    let mut before = 0;
    let mut best: Option<(f64, Range<usize>)> = None;
    for (row, begins) in begins.into_iter().enumerate() {
        let off = (before as f64 / all.max(1) as f64 - 0.5).abs();
        if (begins || !touching(row)) && off <= 0.5 - LEAST {
            match &mut best {
                Some((least, rows)) if off == *least => rows.end = row + 1,
                Some((least, _)) if off > *least => {}
                _ => best = Some((off, row..row + 1)),
            }
        }
        before += usize::from(touching(row));
    }
    best.map(|(_, rows)| rows.start + rows.len() / 2)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::single_range_in_vec_init)]
mod tests {
    use super::*;
    use crate::campaign::sequence_begins;
    use nalgebra::Vector3;
    use vsf_core::Contacts;

    /// A sequence of one joint; touched where `contact` says.
    fn sequence(contact: &[bool], touches: Vec<Range<usize>>) -> (Motion, ContactLog) {
        let motion = Motion {
            tare: 2,
            ..Motion::counting(contact.len(), touches)
        };
        let contacts = contact.iter().map(|touched| {
            let mut contacts = Contacts::new();
            if *touched {
                contacts.push(0, 0, Vector3::zeros(), Vector3::z()).unwrap();
            }
            contacts
        });
        let log = ContactLog {
            postures: Vec::new(),
            contacts: contacts.collect(),
            forces: Vec::new(),
            rigid: Vec::new(),
            moved: Vec::new(),
        };
        (motion, log)
    }

    fn pattern(text: &str) -> Vec<bool> {
        text.chars().map(|c| c == '#').collect()
    }

    #[test]
    fn sequences_are_cut_where_nothing_is_touched_near_the_middle_of_contact() {
        let cut = |text: &str| {
            let contact = pattern(text);
            let (motion, log) = sequence(&contact, vec![0..contact.len()]);
            middle(&motion, &log)
        };
        assert_eq!(cut("..###...####."), Some(6));
        assert_eq!(cut("..#######.."), None);
        assert_eq!(cut("#.##########"), None);
        assert_eq!(cut("......"), None);
        assert_eq!(cut(""), None);
        let (motion, log) = sequence(&pattern("######"), vec![0..3, 3..6]);
        assert_eq!(middle(&motion, &log), Some(3));
    }

    #[test]
    fn parts_hold_their_rows_and_touches() {
        let (motion, _) = sequence(&pattern("..##..##"), vec![0..3, 3..8]);
        let [first, second] = [0..5, 5..8].map(|rows| motion.part(rows).unwrap());
        assert_eq!((first.len(), second.len()), (5, 3));
        assert_eq!(
            (first.touches, second.touches),
            (vec![0..3, 3..5], vec![0..3])
        );
        assert_eq!((first.tare, second.tare), (2, 0));
        assert_eq!(second.q.data(), [5.0, 6.0, 7.0]);
        assert_eq!(second.clock, motion.clock[5..]);
        let [first, second] = [0..5, 5..8].map(|rows| motion.part(rows).unwrap().is(&motion));
        assert!(first && !second);
    }

    #[test]
    fn parts_of_a_sequence_begin_when_it_does() {
        let (motion, _) = sequence(&pattern("..##..##"), vec![0..8]);
        let [first, second] = [0..5, 5..8].map(|rows| motion.part(rows).unwrap());
        let other = Motion {
            id: "other".to_owned(),
            ..second.clone()
        };
        let begins = sequence_begins(&[&first, &second, &other]);
        assert_eq!(begins, [motion.begin(), motion.begin(), second.begin()]);
    }
}

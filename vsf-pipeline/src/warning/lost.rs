//! Samples whose readings were lost, or repeated from the one before.

use super::PipelineWarning;
use super::sensors::{LEAST_DROP, LEAST_ROWS, runs};
use vsf_data::Sequence;

/// Values that come twice or more, of all values of a sequence: fewest, and their share, that are no arm at rest.
const LEAST_TWICE: usize = 10;
const LEAST_SHARE: f64 = 0.2;

/// Reports rows in which all joints read exactly zero, between rows with large readings. Longer runs of
/// zeros belong to a frozen sensor.
pub fn zeros(sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let mut found = sequences
        .iter()
        .flat_map(|s| lost(s).into_iter().map(|row| (&s.id, row)));
    let (sequence, row) = found.next()?;
    Some(PipelineWarning::LostReadings {
        sequence: sequence.clone(),
        row,
        others: found.count(),
    })
}

fn lost(sequence: &Sequence) -> Vec<usize> {
    let norm = |row: &[f64]| row.iter().map(|t| t * t).sum::<f64>().sqrt();
    let norms: Vec<f64> = sequence.torques.iter().map(norm).collect();
    let silent: Vec<bool> = norms.iter().map(|n| *n == 0.0).collect();
    let much = LEAST_DROP * norms.iter().copied().fold(0.0, f64::max);
    let is_much = |row: Option<usize>| row.and_then(|r| norms.get(r)).is_some_and(|n| *n >= much);
    let is_lost = |(rows, is_silent): &(std::ops::Range<usize>, bool)| {
        let begins = |start: &usize| (rows.start..=rows.end).contains(start);
        *is_silent
            && rows.len() < LEAST_ROWS
            && is_much(rows.start.checked_sub(1))
            && is_much(Some(rows.end))
            && !sequence.touch_starts.iter().skip(1).any(begins)
    };
    let lost = runs(&silent).filter(is_lost);
    lost.flat_map(|(rows, _)| rows).collect()
}

/// Reports sequences in which many samples repeat the one before to the last digit.
pub fn repeated(sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let mut found = sequences.iter().filter_map(|s| Some((s, repeats(s)?)));
    let (sequence, count) = found.next()?;
    Some(PipelineWarning::RepeatedSamples {
        sequence: sequence.id.clone(),
        count,
        rows: sequence.len(),
        others: found.count(),
    })
}

/// How many samples do.
fn repeats(sequence: &Sequence) -> Option<usize> {
    let rows: Vec<(&[f64], &[f64])> = (sequence.angles.iter())
        .zip(sequence.torques.iter())
        .collect();
    let (mut values, mut twice) = (0, 0);
    for (run, _) in runs(&rows) {
        values += 1;
        twice += usize::from(run.len() > 1);
    }
    let many = twice >= LEAST_TWICE && twice as f64 >= LEAST_SHARE * values as f64;
    many.then(|| rows.len() - values)
}

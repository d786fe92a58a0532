//! Readings in a few rows that are far larger than all others and than those around them.

use super::PipelineWarning;
use super::sensors::range;
use crate::{Scene, Trace, reading_unit};
use vsf_core::median;
use vsf_data::Sequence;

/// A spike is so many times the range of all other readings of its joint in the sequence, so many times what readings are
/// as a rule off the median of those around them, and at least this share of the largest range of a joint.
const TIMES: f64 = 1.5;
const NOISE: f64 = 12.0;
const LEAST: f64 = 0.2;
/// Rows on either side that it is compared with, in turn: no longer than the first of these, it is told near a touch, too.
const ROWS: [usize; 2] = [1, 5];
/// Fewest rows that tell a range.
const FEWEST: usize = 30;

struct Spike {
    joint: usize,
    row: usize,
    value: f64,
    /// The median around it.
    beside: f64,
}

/// Reports the first spike, and how many rows there are. The beginning or end of a touch does not count,
/// nor does a touch of a few rows.
pub fn warning(
    scene: &Scene,
    sequences: &[&Sequence],
    traces: &[Trace],
) -> Option<PipelineWarning> {
    let pairs = sequences.iter().zip(traces);
    let mut found = pairs.flat_map(|(sequence, trace)| {
        let spikes = spikes(scene, sequence, trace).into_iter();
        spikes.map(|spike| (&sequence.id, spike))
    });
    let (sequence, spike) = found.next()?;
    let joint = &scene.robot().joints()[spike.joint];
    Some(PipelineWarning::Spike {
        joint: joint.name().to_owned(),
        sequence: sequence.clone(),
        row: spike.row,
        value: spike.value,
        beside: spike.beside,
        unit: reading_unit(joint),
        others: found.count(),
    })
}

fn spikes(scene: &Scene, sequence: &Sequence, trace: &Trace) -> Vec<Spike> {
    let mut found: Vec<Spike> = Vec::new();
    if sequence.len() < FEWEST {
        return found;
    }
    let units: Vec<&str> = scene.robot().joints().iter().map(reading_unit).collect();
    let columns: Vec<Vec<f64>> = (0..units.len())
        .map(|j| sequence.torques.column(j).collect())
        .collect();
    for rows in ROWS {
        let middles: Vec<Vec<f64>> = columns.iter().map(|c| medians(c, rows)).collect();
        let ranges: Vec<f64> = middles.iter().map(|m| range(m.iter().copied())).collect();
        for joint in 0..units.len() {
            let alike = (0..units.len()).filter(|k| units[*k] == units[joint]);
            let widest = alike.map(|k| ranges[k]).fold(0.0, f64::max);
            let pairs = || columns[joint].iter().zip(&middles[joint]);
            let noise = median(pairs().map(|(y, m)| (y - m).abs()).collect()).unwrap_or(0.0);
            let least = (TIMES * ranges[joint])
                .max(LEAST * widest)
                .max(NOISE * noise);
            for (row, (&value, &beside)) in pairs().enumerate() {
                let is_far = least > 0.0 && (value - beside).abs() > least;
                let is_known = || found.iter().any(|s| s.joint == joint && s.row == row);
                if is_far && is_inside(sequence, trace, row, rows) && !is_known() {
                    found.push(Spike {
                        joint,
                        row,
                        value,
                        beside,
                    });
                }
            }
        }
    }
    found
}

/// Whether a row is of one touch, or of free motion, with those around it.
fn is_inside(sequence: &Sequence, trace: &Trace, row: usize, rows: usize) -> bool {
    let near = row.saturating_sub(rows)..(row + rows + 1).min(trace.observations.len());
    let touching = near.clone().filter(|k| !trace.observations[*k].is_empty());
    let begins = |start: &usize| near.contains(start) && *start > 0;
    (touching.count() % near.len() == 0) && !sequence.touch_starts.iter().any(begins)
}

/// The median of every value and so many on either side; at the ends, of as many of the first or last.
fn medians(values: &[f64], rows: usize) -> Vec<f64> {
    let width = 2 * rows + 1;
    let of = |k: usize| {
        let first = k
            .saturating_sub(rows)
            .min(values.len().saturating_sub(width));
        let near = &values[first..values.len().min(first + width)];
        median(near.to_vec()).unwrap_or(values[k])
    };
    (0..values.len()).map(of).collect()
}

//! Single readings that are far larger than all others, and than those beside them.

use super::PipelineWarning;
use super::sensors::range;
use crate::{Scene, reading_unit};
use vsf_data::Sequence;

/// A spike is so many times the range of all other readings of its joint in the sequence, and at least this share of the
/// largest range of a joint.
const TIMES: f64 = 1.5;
const LEAST: f64 = 0.2;

/// The first spike, and how many there are.
pub fn warning(scene: &Scene, sequences: &[&Sequence]) -> Option<PipelineWarning> {
    let joints = scene.robot().joints();
    let mut found = sequences.iter().flat_map(|sequence| {
        let columns: Vec<Vec<f64>> = (0..joints.len())
            .map(|j| sequence.torques.column(j).collect())
            .collect();
        let middles: Vec<Vec<f64>> = columns.iter().map(|c| medians(c)).collect();
        let ranges: Vec<f64> = middles.iter().map(|m| range(m.iter().copied())).collect();
        let spikes = move |j: usize| {
            let alike =
                (0..joints.len()).filter(|k| reading_unit(&joints[*k]) == reading_unit(&joints[j]));
            let widest = alike.map(|k| ranges[k]).fold(0.0, f64::max);
            let least = (TIMES * ranges[j]).max(LEAST * widest);
            let pairs = columns[j].iter().zip(&middles[j]).enumerate();
            let spikes = pairs.filter(|(_, (y, m))| ranges[j] > 0.0 && (*y - *m).abs() > least);
            let spikes = spikes.map(|(row, (y, m))| (j, sequence.id.clone(), row, *y, *m));
            spikes.collect::<Vec<_>>()
        };
        (0..joints.len()).flat_map(spikes).collect::<Vec<_>>()
    });
    let (j, sequence, row, value, beside) = found.next()?;
    Some(PipelineWarning::Spike {
        joint: joints[j].name().to_owned(),
        sequence,
        row,
        value,
        beside,
        unit: reading_unit(&joints[j]),
        others: found.count(),
    })
}

/// The median of every value and the two beside it; at the ends, of the first or last three.
fn medians(values: &[f64]) -> Vec<f64> {
    let of = |k: usize| {
        let first = k.saturating_sub(1).min(values.len().saturating_sub(3));
        let mut near = values[first..values.len().min(first + 3)].to_vec();
        near.sort_by(f64::total_cmp);
        near[near.len() / 2]
    };
    (0..values.len()).map(of).collect()
}

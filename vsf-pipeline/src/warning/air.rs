//! Compares readings where nothing is touched with readings in contact.

use super::{PipelineWarning, energy};
use crate::{Scene, Trace};
use vsf_core::Observation;

/// Readings in the air that are on average more than this share of those in contact are no noise.
const MOST_OFFSET: f64 = 0.3;
/// The same of one that is constant: that exceeds what means of samples differ from it by so many times, in so many means.
const MOST_CONSTANT: f64 = 0.05;
const CONSTANT: f64 = 4.0;
const FEWEST_BLOCKS: usize = 4;
/// Least number of samples in the air from which a conclusion is drawn.
pub const LEAST_FREE: usize = 16;

/// Reports readings that are not zero on average where nothing is touched.
pub fn not_tared(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    let observations = || traces.iter().flat_map(|t| &t.observations);
    let free = || observations().filter(|o| o.is_empty());
    let touching = || observations().filter(|o| !o.is_empty());
    let (count, touches) = (free().count(), touching().count());
    if count < LEAST_FREE || touches == 0 {
        return None;
    }
    let joints = scene.robot().joints();
    let mean = |j: usize| free().map(|o| o.reading()[j]).sum::<f64>() / count as f64;
    let means: Vec<f64> = (0..joints.len()).map(mean).collect();
    let square = |o: &Observation<f64>| {
        let beyond = o.reading().iter().zip(&means).map(|(t, m)| t - m);
        beyond.map(|t| t * t).sum::<f64>()
    };
    let touch = (touching().map(square).sum::<f64>() / touches as f64).sqrt();
    let offset = means.iter().map(|m| m * m).sum::<f64>().sqrt();
    let largest = (0..joints.len()).max_by(|a, b| means[*a].abs().total_cmp(&means[*b].abs()))?;
    let spread = spread_in_air(traces, largest, means[largest]);
    let is_constant = means[largest].abs() > CONSTANT * spread;
    if offset <= MOST_OFFSET * touch && !(is_constant && offset > MOST_CONSTANT * touch) {
        return None;
    }
    Some(PipelineWarning::NotTared {
        joint: joints[largest].name().to_owned(),
        mean: means[largest],
        offset,
        touch,
        unit: scene.error_unit(),
    })
}

/// Successive samples in the air, so many at a time: noise shrinks in their means.
fn free_blocks(traces: &[Trace]) -> impl Iterator<Item = &[Observation<f64>]> {
    let parts = traces.iter().flat_map(|t| {
        let all = &t.observations;
        all.chunk_by(|a, b| a.is_empty() == b.is_empty())
    });
    let free = parts.filter(|part| part[0].is_empty());
    free.flat_map(|part| part.chunks_exact(LEAST_FREE))
}

/// Mean reading of a joint (N m or N).
fn mean_of(block: &[Observation<f64>], j: usize) -> f64 {
    block.iter().map(|o| o.reading()[j]).sum::<f64>() / block.len() as f64
}

/// Root mean square of what the means of blocks of a joint's readings in the air differ from `mean` by (N m or N); infinite
/// without enough of them.
fn spread_in_air(traces: &[Trace], j: usize, mean: f64) -> f64 {
    let count = free_blocks(traces).count();
    if count < FEWEST_BLOCKS {
        return f64::INFINITY;
    }
    let squares: f64 = free_blocks(traces)
        .map(|block| (mean_of(block, j) - mean).powi(2))
        .sum();
    (squares / count as f64).sqrt()
}

/// Reports readings that persist where nothing is touched but change their sign, so that their mean shows
/// nothing.
pub fn felt_in_air(scene: &Scene, traces: &[Trace]) -> Option<PipelineWarning> {
    let joints = scene.robot().joints();
    let touching = || {
        let all = traces.iter().flat_map(|t| &t.observations);
        all.filter(|o| !o.is_empty())
    };
    let (blocks, touches) = (free_blocks(traces).count(), touching().count());
    if blocks == 0 || touches == 0 {
        return None;
    }
    let squares = |j: usize| free_blocks(traces).map(|b| mean_of(b, j).powi(2)).sum();
    let of_joints: Vec<f64> = (0..joints.len()).map(squares).collect();
    let size = (of_joints.iter().sum::<f64>() / blocks as f64).sqrt();
    let touch = (touching().map(energy).sum::<f64>() / touches as f64).sqrt();
    let largest = (0..joints.len()).max_by(|a, b| of_joints[*a].total_cmp(&of_joints[*b]))?;
    (size > MOST_OFFSET * touch).then(|| PipelineWarning::FeltInAir {
        joint: joints[largest].name().to_owned(),
        size,
        touch,
        unit: scene.error_unit(),
    })
}

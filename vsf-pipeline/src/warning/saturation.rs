//! Sensors that read no more from a level on, though noise is added to it.

use super::sensors::range;
use super::{PipelineWarning, springs};
use crate::{Scene, Trace, reading_unit};
use std::ops::Range;
use vsf_core::median;

/// Samples that are averaged (odd).
const AVERAGED: usize = 9;
/// Means within so many of their deviations of the largest one may be at one level.
const LEVEL: f64 = 6.0;
/// Share of the largest torques of springs by which those of a joint change meanwhile, and how many deviations of the means
/// its readings would have to change by.
const LEAST_CHANGE: f64 = 0.2;
const LEAST_EXPECTED: f64 = 20.0;
/// The share of a stay at the level, at either end, in which touch may change because readings are late; and how much it has to
/// change in between.
const EDGE: usize = 5;
const LEAST_INSIDE: f64 = 0.05;
/// Sequences that end at the level: one may by chance, as where the object yields.
const FEWEST: usize = 2;

/// A joint whose readings stop at one level.
#[derive(Debug, Clone, PartialEq)]
pub struct Saturation {
    /// Index of the joint.
    pub joint: usize,
    /// The level (N m or N), of either sign.
    pub level: f64,
    /// Number of readings at the level.
    pub count: usize,
    /// Index of the trace of the first one.
    pub trace: usize,
    /// Its row.
    pub row: usize,
}

impl Saturation {
    /// As a warning.
    pub(super) fn warning(&self, scene: &Scene, traces: &[Trace]) -> PipelineWarning {
        let joint = &scene.robot().joints()[self.joint];
        PipelineWarning::ClippedReadings {
            joint: joint.name().to_owned(),
            count: self.count,
            value: self.level,
            unit: reading_unit(joint),
            sequence: traces[self.trace].id.clone(),
            row: self.row,
        }
    }
}

/// Joints whose readings, as those of the environment, stay at the end of their range within noise, sample after sample and in
/// more than one sequence, while the touch goes on to change: by a fifth, at least, of the torques of springs of one
/// stiffness. One at most for each joint and sign.
pub fn saturated_joints(traces: &[Trace]) -> Vec<Saturation> {
    let joints = (traces.iter().flat_map(Trace::readings).next()).map_or(0, <[f64]>::len);
    let sides = (0..joints).flat_map(|j| [1.0, -1.0].map(|side| (j, side)));
    sides
        .filter_map(|(j, side)| saturated(traces, j, side))
        .collect()
}

fn saturated(traces: &[Trace], joint: usize, side: f64) -> Option<Saturation> {
    let reading = |y: &[f64]| side * y.get(joint).copied().unwrap_or(0.0);
    let readings = |t: &Trace| -> Vec<f64> { t.readings().map(reading).collect() };
    let readings: Vec<Vec<f64>> = traces.iter().map(readings).collect();
    let bend = |w: &[f64]| (w[0] - 2.0 * w[1] + w[2]).abs();
    let bends = readings.iter().flat_map(|y| y.windows(3).map(bend));
    // The median of the size of a normal variable is 0.6745 deviations.
    let sd = median(bends.collect())? / (0.6745 * 6.0_f64.sqrt());
    let noise = sd / (AVERAGED as f64).sqrt();
    let means: Vec<Vec<f64>> = readings.iter().map(|y| means(y)).collect();
    let end = means.iter().flatten().copied().fold(0.0, f64::max);
    let unit = |t: &Trace| -> Vec<f64> {
        let torques = t.observations.iter().map(|obs| springs(obs).nth(joint));
        torques.map(|t| t.unwrap_or(0.0)).collect()
    };
    let units: Vec<Vec<f64>> = traces.iter().map(unit).collect();
    let whole = range(units.iter().flatten().copied());
    if noise <= 0.0 || whole <= 0.0 {
        return None;
    }
    let least = LEAST_CHANGE.max(LEAST_EXPECTED * noise / end);
    let mut found: Vec<(usize, Range<usize>)> = Vec::new();
    for (k, (means, unit)) in means.iter().zip(&units).enumerate() {
        let ends = means.iter().map(|m| *m >= end - LEVEL * noise);
        let ends: Vec<bool> = ends.collect();
        let mut start = 0;
        for run in ends.chunk_by(|a, b| a == b) {
            let rows = start..start + run.len();
            start = rows.end;
            let edge = rows.len() / EDGE;
            let change = |rows: Range<usize>| range(unit[rows].iter().copied()) / whole;
            let changes = change(rows.clone()) > least
                && change(rows.start + edge..rows.end - edge) > LEAST_INSIDE;
            if run[0] && run.len() >= AVERAGED && changes {
                found.push((k, rows));
            }
        }
    }
    let (trace, first) = found.first()?.clone();
    let sequences = found.chunk_by(|a, b| a.0 == b.0).count();
    let at_end = (found.iter()).flat_map(|(k, rows)| &readings[*k][rows.clone()]);
    // No digits that noise makes up.
    let digit = 10.0_f64.powf(noise.log10().floor());
    let level = (median(at_end.copied().collect())? / digit).round() * digit;
    (sequences >= FEWEST).then(|| Saturation {
        joint,
        level: side * level,
        count: found.iter().map(|(_, rows)| rows.len()).sum(),
        trace,
        row: first.start,
    })
}

/// Means of each value and its neighbors, of fewer at the ends.
fn means(values: &[f64]) -> Vec<f64> {
    let half = AVERAGED / 2;
    let mean = |k: usize| {
        let near = &values[k.saturating_sub(half)..(k + half + 1).min(values.len())];
        near.iter().sum::<f64>() / near.len() as f64
    };
    (0..values.len()).map(mean).collect()
}

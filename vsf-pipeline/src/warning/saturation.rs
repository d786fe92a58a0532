//! Detects saturated sensors: readings that stop at a level, with noise on top.

use super::PipelineWarning;
use super::sensors::{LEAST_CHANGE, range, runs};
use super::springs::{Likeness, Springs, springs};
use crate::{Scene, Trace, reading_unit};
use std::ops::Range;
use vsf_core::median;

/// Samples whose median is taken (odd).
const SMOOTHED: usize = 9;
/// The deviation of the median of so many samples, over that of one: of a mean it is a third, of a median a quarter more.
const OF_MEDIAN: f64 = 0.42;
/// Deviations of the medians by which readings would have to change meanwhile, were the object of one stiffness.
const LEAST_EXPECTED: f64 = 20.0;
/// How many times the band in which readings are at the level that is from zero: tops of touches are not that flat.
const LEAST_END: f64 = 20.0;
/// A stay at the level less a fifth of it at either end, where touch may change because readings are late; and the share of the
/// range of the torques of springs by which it has to change in between.
const EDGES: usize = 5;
const LEAST_INSIDE: f64 = 0.05;

/// A joint whose readings stop at one level.
#[derive(Debug, Clone, PartialEq)]
pub struct Saturation {
    /// Index of the joint.
    pub joint: usize,
    /// The level (N m or N), of either sign, in the units of the traces: relative to the tare.
    pub level: f64,
    /// Number of readings at the level.
    pub count: usize,
    /// Index of the trace with the first such reading.
    pub trace: usize,
    /// Row of the first such reading.
    pub row: usize,
}

impl Saturation {
    /// As a warning.
    pub(super) fn warning(&self, scene: &Scene, traces: &[Trace]) -> PipelineWarning {
        let joint = &scene.robot().joints()[self.joint];
        PipelineWarning::SaturatedReadings {
            joint: joint.name().to_owned(),
            count: self.count,
            level: self.level,
            unit: reading_unit(joint),
            sequence: traces[self.trace].id.clone(),
            row: self.row,
        }
    }
}

/// Finds joints whose readings saturate: they stay within noise of the end of their range while the touch
/// continues to change.
///
/// They must do so sample after sample, and in two different touches. Meanwhile the torques of springs of
/// equal stiffness must change by at least a fifth of their range. Readings are torques of the environment.
/// At most one level is reported per joint and sign. Time and memory grow with the number of samples.
pub fn saturated_joints(traces: &[Trace]) -> Vec<Saturation> {
    saturated(traces, &springs(traces))
}

/// [`saturated_joints`], with the springs of the traces.
pub(super) fn saturated(traces: &[Trace], springs: &[Springs]) -> Vec<Saturation> {
    let joints = (traces.iter().flat_map(Trace::readings).next()).map_or(0, <[f64]>::len);
    let stiffness = uniform(traces, springs);
    (0..joints)
        .flat_map(|j| Readings::new(traces, springs, stiffness, j).map(|r| r.ends()))
        .flatten()
        .collect()
}

/// The stiffness that, everywhere the same, explains the readings best; not negative.
fn uniform(traces: &[Trace], springs: &[Springs]) -> f64 {
    let mut likeness = Likeness::default();
    let readings = traces.iter().flat_map(Trace::readings);
    for (reading, springs) in readings.zip(springs.iter().flatten()) {
        let pairs = reading.iter().zip(springs);
        pairs.for_each(|(tau, spring)| likeness.add(*tau, *spring));
    }
    // NaN where nothing is touched.
    likeness.slope().max(0.0)
}

/// What one joint reads, and what it would read of springs.
struct Readings<'a> {
    joint: usize,
    readings: Vec<Vec<f64>>,
    /// Their running medians, and the noise of these.
    medians: Vec<Vec<f64>>,
    noise: f64,
    /// Torques of springs of 1 N/m, of all joints.
    touches: &'a [Springs],
    /// Those of the joint, in N m or N as far as one stiffness explains the readings of all.
    expected: Vec<Vec<f64>>,
}

impl<'a> Readings<'a> {
    /// `None` of readings without noise.
    fn new(traces: &[Trace], touches: &'a [Springs], stiffness: f64, joint: usize) -> Option<Self> {
        let own = |row: &[f64]| row.get(joint).copied().unwrap_or(0.0);
        let readings: Vec<Vec<f64>> = (traces.iter())
            .map(|t| t.readings().map(own).collect())
            .collect();
        let bend = |w: &[f64]| (w[0] - 2.0 * w[1] + w[2]).abs();
        let bends = readings.iter().flat_map(|y| y.windows(3).map(bend));
        // The median of the size of a normal variable is 0.6745 deviations.
        let noise = OF_MEDIAN * median(bends.collect())? / (0.6745 * 6.0_f64.sqrt());
        let expected = |t: &Springs| t.iter().map(|u| stiffness * own(u)).collect();
        (noise > 0.0).then(|| Self {
            joint,
            medians: readings.iter().map(|y| medians(y)).collect(),
            readings,
            noise,
            touches,
            expected: touches.iter().map(expected).collect(),
        })
    }

    /// Where it is at the end of its range, upward and downward.
    fn ends(&self) -> Vec<Saturation> {
        [1.0, -1.0]
            .into_iter()
            .filter_map(|side| self.end(side))
            .collect()
    }

    fn end(&self, side: f64) -> Option<Saturation> {
        let values = self.medians.iter().flatten();
        let (samples, end) = values.fold((0, 0.0_f64), |(n, end), v| (n + 1, end.max(side * v)));
        // The largest and the smallest of many at one level lie apart.
        let band = 2.0 * self.noise * (2.0 * f64::from(samples).ln()).sqrt();
        if end < LEAST_END * band {
            return None;
        }
        let whole = range(self.expected.iter().flatten().copied());
        let least = (LEAST_CHANGE * whole).max(LEAST_EXPECTED * self.noise);
        let mut found: Vec<(usize, Range<usize>)> = Vec::new();
        for (k, (medians, expected)) in self.medians.iter().zip(&self.expected).enumerate() {
            // Nothing is felt where nothing is touched.
            let is_at =
                |row: usize| side * medians[row] >= end - band && side * expected[row] > 0.0;
            let at: Vec<bool> = (0..medians.len()).map(is_at).collect();
            let change = |rows: Range<usize>| range(expected[rows].iter().copied());
            for (rows, _) in runs(&at).filter(|(rows, at)| *at && rows.len() >= SMOOTHED) {
                let edge = rows.len() / EDGES;
                let inside = rows.start + edge..rows.end - edge;
                if change(rows.clone()) > least && change(inside) > LEAST_INSIDE * whole {
                    found.push((k, rows));
                }
            }
        }
        let (trace, first) = found.first()?.clone();
        let another = found.iter().any(|other| self.differ(&found[0], other));
        let at_end = (found.iter()).flat_map(|(k, rows)| &self.readings[*k][rows.clone()]);
        // No digits that noise makes up.
        let digit = 10.0_f64.powf(self.noise.log10().floor());
        let level = (median(at_end.copied().collect())? / digit).round() * digit;
        another.then(|| Saturation {
            joint: self.joint,
            level,
            count: found.iter().map(|(_, rows)| rows.len()).sum(),
            trace,
            row: first.start,
        })
    }

    /// Whether two stays are of touches that differ, by what the joints would read of springs: an object that yields does the
    /// same whenever it is touched alike.
    fn differ(&self, (a, of_a): &(usize, Range<usize>), (b, of_b): &(usize, Range<usize>)) -> bool {
        let middle = |k: usize, rows: &Range<usize>| &self.touches[k][(rows.start + rows.end) / 2];
        let pairs = || middle(*a, of_a).iter().zip(middle(*b, of_b));
        let apart = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let size = pairs()
            .map(|(a, b)| a.abs().max(b.abs()))
            .fold(0.0, f64::max);
        a != b && apart > LEAST_CHANGE * size
    }
}

/// The median of each value and its neighbors, of fewer at the ends.
fn medians(values: &[f64]) -> Vec<f64> {
    let half = SMOOTHED / 2;
    let near = |k: usize| values[k.saturating_sub(half)..(k + half + 1).min(values.len())].to_vec();
    (0..values.len()).filter_map(|k| median(near(k))).collect()
}

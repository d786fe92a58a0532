//! Readings that come later than their touches.
//!
//! A touch from free air to free air is a loop: whatever the force law, the arm gets no more work out of
//! the object than it has put in. Late readings show more force on the way out than on the way in, as if it
//! did. Their lag is then found by shifting them against springs of equal stiffness at all points, if it is
//! no longer than a touch. Readings that come early look like those of a viscous object and are not
//! reported.

use super::PipelineWarning;
use super::springs::{Likeness, Springs};
use crate::Trace;
use std::ops::Range;
use vsf_core::median;

/// Lags that are looked at (s), and in how many steps.
const MOST_LAG: f64 = 1.0;
const STEPS: usize = 50;
/// A lag from which on it is told (s).
const LEAST_LAG: f64 = 0.08;
/// With half of the lag removed, readings have to give this share of the work that springs would give with the other
/// half. For objects whose contact is not that of the model, such as a pad without friction, it is 0.4.
const LEAST_BY_WORK: f64 = 0.6;
/// Share of what springs leave of the readings that they leave with the lag. On plants and soft bodies, with any effect of a
/// diagnosis but latency, it is 0.89 and more.
const MOST_LEFT: f64 = 0.85;
/// Share of the loops that show it.
const LEAST_SHARE: f64 = 0.75;
/// Samples of touches, of all loops, and all samples that are looked at.
const LEAST_SAMPLES: usize = 16;
const MOST_SAMPLES: usize = 20_000;

/// Reports readings that give back more work than was put in, and that fit the touches far better when
/// taken some time later.
pub fn warning(traces: &[Trace], springs: &[Springs]) -> Option<PipelineWarning> {
    let lagging = Lagging::new(traces, springs);
    let step = MOST_LAG / STEPS as f64;
    let left = |likeness: &Likeness| 1.0 - likeness.correlation().max(0.0).powi(2);
    let own = left(&lagging.at(0.0));
    let lags = (1..=STEPS).map(|k| step * k as f64);
    let all = lags.map(|lag| (lag, lagging.at(lag)));
    let all = all.map(|(lag, likeness)| (lag, left(&likeness) / own, likeness.slope()));
    let (seconds, left, stiffness) = all
        .filter(|(_, left, _)| left.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let is_better = left < MOST_LEFT && seconds >= LEAST_LAG;
    // By half of it, since a touch that is over does no work any more.
    let is_gained = || lagging.by_work(0.5 * seconds, stiffness) >= Some(LEAST_BY_WORK);
    (is_better && is_gained()).then_some(PipelineWarning::Late {
        seconds,
        is_more: seconds > MOST_LAG - 0.5 * step,
        left,
    })
}

/// Readings, and what springs give.
struct Lagging<'a> {
    traces: &'a [Trace],
    springs: &'a [Springs],
    /// Time from sample to sample of each trace (s).
    steps: Vec<f64>,
    /// Every so many samples are shifted.
    every: usize,
}

impl<'a> Lagging<'a> {
    fn new(traces: &'a [Trace], springs: &'a [Springs]) -> Self {
        let samples: usize = traces.iter().map(|t| t.observations.len()).sum();
        let step_of = |t: &Trace| {
            let steps = t.time.windows(2).map(|w| w[1] - w[0]);
            median(steps.collect()).unwrap_or(MOST_LAG)
        };
        Self {
            springs,
            steps: traces.iter().map(step_of).collect(),
            every: samples.div_ceil(MOST_SAMPLES).max(1),
            traces,
        }
    }

    /// Work gained with readings taken `lag` (s) later, relative to the work that springs of a stiffness (N/m) would give
    /// with that lag. `None` if too few touches begin and end in free air, or too few of them gain any.
    fn by_work(&self, lag: f64, stiffness: f64) -> Option<f64> {
        let (mut gained, mut expected) = (0.0, 0.0);
        let (mut loops, mut late, mut samples) = (0_u32, 0_u32, 0);
        for ((trace, springs), step) in self.traces.iter().zip(self.springs).zip(&self.steps) {
            let (all, later) = (trace.observations.len(), (lag / step).round() as usize);
            let read = |row: usize, j: usize| {
                let row = (row + later).min(all - 1);
                trace.observations[row].reading()[j]
            };
            let late_spring = |row: usize, j: usize| springs[row.saturating_sub(later)][j];
            for rows in loops_of(trace) {
                let done = work(springs, rows.clone(), read);
                gained -= done;
                expected -= work(springs, rows.clone(), late_spring);
                samples += rows.len();
                loops += 1;
                late += u32::from(done < 0.0);
            }
        }
        let tells = samples >= LEAST_SAMPLES && f64::from(late) >= LEAST_SHARE * f64::from(loops);
        tells.then_some(gained / (stiffness * expected))
    }

    /// Likeness of readings taken `lag` (s) later and springs, on the same samples for every lag, with the means of both
    /// removed at each joint. Beyond the end, the last reading is repeated.
    fn at(&self, lag: f64) -> Likeness {
        let mut likeness = Likeness::default();
        for ((trace, springs), step) in self.traces.iter().zip(self.springs).zip(&self.steps) {
            let (all, later) = (trace.observations.len(), (lag / step).round() as usize);
            let rows = (0..all).step_by(self.every);
            let joints = springs.first().map_or(0..0, |s| 0..s.len());
            for j in joints {
                let spring = |row: usize| springs[row][j];
                let read = |row: usize| trace.observations[(row + later).min(all - 1)].reading()[j];
                let count = rows.clone().count() as f64;
                let mean_read = rows.clone().map(read).sum::<f64>() / count;
                let mean_spring = rows.clone().map(spring).sum::<f64>() / count;
                for row in rows.clone() {
                    likeness.add(read(row) - mean_read, spring(row) - mean_spring);
                }
            }
        }
        likeness
    }
}

/// Touches from free air to free air, with a free sample at each end.
fn loops_of(trace: &Trace) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    for touch in &trace.touches {
        let mut start = touch.start;
        let rows = &trace.observations[touch.clone()];
        for part in rows.chunk_by(|a, b| a.is_empty() == b.is_empty()) {
            let end = start + part.len();
            if !part[0].is_empty() && start > touch.start && end < touch.end {
                found.push(start - 1..end + 1);
            }
            start = end;
        }
    }
    found
}

/// Work that the arm does on the object along a loop, relative to the work of springs of 1 N/m. `torque` gives the
/// torque of a row and a joint. A constant torque does none.
fn work(springs: &[Vec<f64>], rows: Range<usize>, torque: impl Fn(usize, usize) -> f64) -> f64 {
    let mut work = 0.0;
    for (row, ends) in rows.clone().zip(springs[rows].windows(2)) {
        for (j, (from, to)) in ends[0].iter().zip(&ends[1]).enumerate() {
            work += 0.5 * (torque(row, j) + torque(row + 1, j)) * (to - from);
        }
    }
    work
}

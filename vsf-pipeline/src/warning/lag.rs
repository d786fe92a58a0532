//! Readings that come later, or earlier, than the touches that they are of, by springs of one stiffness everywhere.

use super::{Likeness, PipelineWarning, springs};
use crate::Trace;
use vsf_core::median;

/// Lags that are looked at, to both sides (s), and in how many steps.
const MOST_LAG: f64 = 1.0;
const MOST_STEPS: usize = 50;
/// Lags below this (s), or of fewer samples, may be those of the object: what is viscous is felt early, what is dragged along late.
const LEAST_LAG: f64 = 0.08;
const LEAST_SAMPLES: usize = 2;
/// Share of what springs leave of the readings that they leave with the lag. Of plants, soft bodies and silicone, with any effect of a
/// diagnosis but latency or none, it is 0.89 and more; with 0.2 s of latency 0.48 to 0.81.
const MOST_LEFT: f64 = 0.85;
/// Samples that are looked at.
const MOST_SAMPLES: usize = 20_000;

/// Readings that fit the touches far better some time later or earlier.
pub fn warning(traces: &[Trace]) -> Option<PipelineWarning> {
    let steps = traces
        .iter()
        .flat_map(|t| t.time.windows(2).map(|w| w[1] - w[0]));
    let step = median(steps.collect())?;
    let samples = (MOST_LAG / step).min(MOST_SAMPLES as f64) as usize;
    let stride = samples.div_ceil(MOST_STEPS).max(1);
    let most = (samples / stride * stride) as isize;
    let given = Lagging::new(traces);
    let own = given.left(0);
    // Readings of the other sign are for others to tell.
    if own >= 1.0 {
        return None;
    }
    let lags = (-most..=most).step_by(stride);
    let all = lags.map(|lag| (lag, given.left(lag) / own));
    let (lag, left) = all
        .filter(|(_, left)| left.is_finite())
        .min_by(|a, b| a.1.total_cmp(&b.1))?;
    let seconds = lag as f64 * step;
    let is_evident =
        left < MOST_LEFT && seconds.abs() >= LEAST_LAG && lag.unsigned_abs() >= LEAST_SAMPLES;
    is_evident.then_some(PipelineWarning::Lag { seconds, left })
}

/// Readings, and what springs give.
struct Lagging<'a> {
    traces: &'a [Trace],
    springs: Vec<Vec<Vec<f64>>>,
    /// Every so many samples are looked at.
    every: usize,
}

impl<'a> Lagging<'a> {
    fn new(traces: &'a [Trace]) -> Self {
        let of_trace = |t: &Trace| {
            let rows = t.observations.iter();
            rows.map(|o| springs(o).collect()).collect()
        };
        let samples: usize = traces.iter().map(|t| t.observations.len()).sum();
        Self {
            springs: traces.iter().map(of_trace).collect(),
            every: samples.div_ceil(MOST_SAMPLES).max(1),
            traces,
        }
    }

    /// Share of the readings that springs leave so many samples later.
    fn left(&self, lag: isize) -> f64 {
        let mut likeness = Likeness::default();
        for (trace, springs) in self.traces.iter().zip(&self.springs) {
            for (row, obs) in trace.observations.iter().enumerate().step_by(self.every) {
                let touched = row.checked_add_signed(-lag).and_then(|k| springs.get(k));
                if let Some(springs) = touched {
                    let pairs = obs.reading().iter().zip(springs);
                    pairs.for_each(|(reading, spring)| likeness.add(*reading, *spring));
                }
            }
        }
        let correlation = likeness.correlation().max(0.0);
        1.0 - correlation * correlation
    }
}

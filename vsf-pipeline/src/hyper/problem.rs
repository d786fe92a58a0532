//! The problem whose prior and noise are chosen.

use super::{Hyper, PriorShape};
use crate::estimate::touched_points;
use crate::trace::{check_traces, touched_alone};
use crate::{PipelineError, Trace};
use vsf_core::{Noise, Observation, RestPoints, median};
use vsf_filter::FieldPrior;

/// As how many independent readings those of one point count by rule. What the model leaves
/// unexplained stays alike over a whole push, so that hundreds of readings say little more than one.
const INDEPENDENT: f64 = 4.0;
/// Share of the whole reading that the noise of every channel gets besides its own.
const FLOOR: f64 = 0.05;

/// The problem with noise of the right shape and, for now, level 1, a trace per touch, and without
/// the points that are never touched.
pub(super) struct Problem {
    pub(super) rest: RestPoints,
    pub(super) touches: Vec<Trace>,
    pub(super) channels: Vec<f64>,
    /// Median over the samples in contact of the reading's sd per unit of prior sd.
    typical: f64,
    /// Signal-to-noise ratio of a typical reading by rule.
    rule: f64,
}

impl Problem {
    pub(super) fn new(rest: &RestPoints, traces: &[Trace]) -> Result<Self, PipelineError> {
        let first = traces.iter().flat_map(|t| &t.observations).next();
        check_traces(traces, rest.len(), first.map_or(0, Observation::dim))?;
        let what = "train";
        let channels = channel_scales(traces).ok_or(PipelineError::NoContact {
            what,
            points: rest.len(),
            nearest: None,
        })?;
        let typical = typical_signal(traces, &channels).ok_or_else(|| {
            let touched = touched_points(traces, rest.len());
            let touched = touched.iter().filter(|t| **t).count();
            PipelineError::NoTorque { what, touched }
        })?;
        let rule = (INDEPENDENT / readings_per_point(traces, rest.len())).sqrt();
        let noise = Noise::per_channel(&channels)?;
        let (rest, touches) = touched_alone(rest, traces, &noise)?;
        Ok(Self {
            rest,
            touches,
            channels,
            typical,
            rule,
        })
    }

    /// The same with its touches cut into others.
    pub(super) fn with_touches(&self, touches: Vec<Trace>) -> Self {
        Self {
            rest: self.rest.clone(),
            touches,
            channels: self.channels.clone(),
            ..*self
        }
    }

    pub(super) fn prior_sd(&self, power: f64) -> f64 {
        self.rule * 2f64.powf(power) / self.typical
    }

    pub(super) fn prior(
        &self,
        (shape, power): &(PriorShape, f64),
    ) -> Result<FieldPrior, PipelineError> {
        shape.prior(&self.rest, self.prior_sd(*power))
    }

    pub(super) fn signal_to_noise(&self, power: f64) -> f64 {
        self.rule * 2f64.powf(power)
    }

    pub(super) fn hyper(&self, (shape, power): (PriorShape, f64), level: f64) -> Hyper {
        Hyper {
            prior_sd: self.prior_sd(power) * level,
            shape,
            noise_sd: self.channels.iter().map(|c| c * level).collect(),
        }
    }
}

/// Noise of every channel up to its level; `None` without contact.
fn channel_scales(traces: &[Trace]) -> Option<Vec<f64>> {
    let in_contact = || {
        traces
            .iter()
            .flat_map(|t| &t.observations)
            .filter(|o| !o.is_empty())
    };
    let count = in_contact().count() as f64;
    let dim = in_contact().next()?.dim();
    let rms = (0..dim).map(|c| {
        let squares: f64 = in_contact().map(|o| o.reading()[c] * o.reading()[c]).sum();
        (squares / count).sqrt()
    });
    let rms: Vec<f64> = rms.collect();
    let norm = rms.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Readings of zero say nothing about their noise.
    let floor = if norm > 0.0 { FLOOR * norm } else { 1.0 };
    Some(rms.iter().map(|x| x + floor).collect())
}

/// Median over the samples in contact of `sqrt(tr(R^-1 W W^T) / d)`.
fn typical_signal(traces: &[Trace], channels: &[f64]) -> Option<f64> {
    let norm = |o: &Observation<f64>| {
        let white = |c: usize| {
            o.row(c)
                .iter()
                .map(|w| (w / channels[c]).powi(2))
                .sum::<f64>()
        };
        ((0..o.dim()).map(white).sum::<f64>() / o.dim() as f64).sqrt()
    };
    let norms = traces
        .iter()
        .flat_map(|t| &t.observations)
        .filter(|o| !o.is_empty())
        .map(norm)
        .filter(|n| *n > 0.0);
    median(norms.collect())
}

/// Median over the touched points of the number of readings that a point takes part in.
fn readings_per_point(traces: &[Trace], field_len: usize) -> f64 {
    let mut counts = vec![0usize; field_len];
    for obs in traces.iter().flat_map(|t| &t.observations) {
        obs.points().iter().for_each(|&p| counts[p as usize] += 1);
    }
    let touched = counts.into_iter().filter(|n| *n > 0);
    median(touched.map(|n| n as f64).collect()).unwrap_or(1.0)
}

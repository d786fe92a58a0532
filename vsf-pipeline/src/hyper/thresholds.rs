//! From where on points may be touched, where nobody says.

use super::held_out::LEAVE_ONE_OUT_POINTS;
use crate::estimate::touched_points;
use crate::{Scene, Trace};
use std::ops::Range;

/// Shares of the scene's threshold that are worth a comparison.
const SHARES: [f64; 2] = [0.25, 0.0625];
/// No threshold is smaller (m).
const LEAST: f64 = 1e-4;
/// Fewer touches tell little of it.
const FEWEST_TOUCHES: usize = 4;

/// Thresholds (m) that are worth comparing with that of a scene by [`choose_contact`](crate::choose_contact): a quarter and a
/// sixteenth of it. Points that fill an object are touched where its surface is; those that stand for thin parts with gaps between them,
/// from further away.
///
/// `traces` are the train sequences in the scene. None of fewer than four touches, which tell little, and of more than 1500
/// touched points, which take long; none below 0.1 mm, within the error of a mesh's distance grid (99 %), or in which surfaces that are drawn in
/// ([`ContactConfig::padding`](vsf_contact::ContactConfig::padding)) touch nothing.
pub fn closer_thresholds(scene: &Scene, traces: &[Trace]) -> Vec<f64> {
    let touches = |t: &Trace| {
        let touching = |rows: &&Range<usize>| {
            let mut observations = t.observations[(*rows).clone()].iter();
            observations.any(|o| !o.is_empty())
        };
        t.touches.iter().filter(touching).count()
    };
    let touched = touched_points(traces, scene.rest().len());
    let touched = touched.iter().filter(|t| **t).count();
    if traces.iter().map(touches).sum::<usize>() < FEWEST_TOUCHES || touched > LEAVE_ONE_OUT_POINTS
    {
        return Vec::new();
    }
    let grids = scene.grids().iter().map(|grid| grid.report.error.p99);
    let least = grids.fold(LEAST, f64::max);
    let contact = scene.contact();
    let closer = SHARES.into_iter().map(|share| share * contact.threshold);
    closer
        .filter(|t| *t >= least && t + contact.padding >= LEAST)
        .collect()
}

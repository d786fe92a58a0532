//! Candidates of contact thresholds, where none is given.

use super::held_out::LEAVE_ONE_OUT_POINTS;
use crate::estimate::touched_points;
use crate::trace::check_traces;
use crate::{LEAST_THRESHOLD, PipelineError, Scene, Trace};
use std::ops::Range;

/// Shares of the scene's threshold that are worth a comparison.
const SHARES: [f64; 2] = [0.25, 0.0625];
/// Fewer touches tell little of it.
const FEWEST_TOUCHES: usize = 4;

/// Contact thresholds (m) to compare with that of a scene by [`choose_contact`](crate::choose_contact): a
/// quarter and a sixteenth of it.
///
/// A solid cloud bears force from its surface on. Points that stand for thin parts with gaps between them
/// need the larger threshold of the scene.
///
/// `traces` are the train sequences in the scene. The result is empty for fewer than four touches, which
/// say too little, and for more than 1500 touched points, which take too long. Thresholds are left out if
/// they are below [`LEAST_THRESHOLD`] or below the error of a mesh's distance grid (its 99 % quantile), or
/// if a negative [`padding`](vsf_contact::ContactConfig::padding) leaves nothing to touch.
///
/// # Errors
/// Traces that [`Trace::check`] refuses for this scene.
pub fn closer_thresholds(scene: &Scene, traces: &[Trace]) -> Result<Vec<f64>, PipelineError> {
    let points = scene.rest().len();
    check_traces(traces, points, scene.robot().joint_count())?;
    let touches = |t: &Trace| {
        let touching = |rows: &&Range<usize>| {
            let mut observations = t.observations[(*rows).clone()].iter();
            observations.any(|o| !o.is_empty())
        };
        t.touches.iter().filter(touching).count()
    };
    let touched = touched_points(traces, points);
    let touched = touched.iter().filter(|t| **t).count();
    if traces.iter().map(touches).sum::<usize>() < FEWEST_TOUCHES || touched > LEAVE_ONE_OUT_POINTS
    {
        return Ok(Vec::new());
    }
    let grids = scene.grids().iter().map(|grid| grid.report.error.p99);
    let least = grids.fold(LEAST_THRESHOLD, f64::max);
    let contact = scene.contact();
    let closer = SHARES.into_iter().map(|share| share * contact.threshold);
    Ok(closer
        .filter(|t| *t >= least && t + contact.padding >= LEAST_THRESHOLD)
        .collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::SceneOptions;
    use nalgebra::Point3;
    use vsf_core::{Noise, Observation};

    /// Sequences of one touch each.
    fn touches(count: usize, points: usize, joints: usize) -> Vec<Trace> {
        let touch = |id: usize| {
            let mut observation = Observation::new(Noise::uniform(joints, 1.0).unwrap());
            (observation.rebuild(points, &[points as u32 - 1], &vec![1.0; joints], |_, w| {
                w.fill(0.1)
            }))
            .unwrap();
            Trace {
                id: id.to_string(),
                time: vec![0.0],
                observations: vec![observation],
                touches: std::iter::once(0..1).collect(),
            }
        };
        (0..count).map(touch).collect()
    }

    #[test]
    fn closer_thresholds_are_those_that_can_be_told() {
        let scene = |threshold: f64, padding: f64| {
            let mut options = SceneOptions::default();
            (options.contact.threshold, options.contact.padding) = (threshold, padding);
            let points = (0..5).map(|i| Point3::new(0.01 * f64::from(i), 0.0, 0.0));
            let robot = vsf_robots::cartesian_stage(0.01).unwrap();
            Scene::new(robot, points.collect(), &options).unwrap()
        };
        let joints = scene(0.008, 0.0).robot().joint_count();
        let of = |threshold: f64, padding: f64, count: usize| {
            closer_thresholds(&scene(threshold, padding), &touches(count, 5, joints)).unwrap()
        };
        assert_eq!(of(0.008, 0.0, 4), [0.002, 0.0005]);
        assert!(of(0.008, 0.0, 3).is_empty());
        assert_eq!(of(0.001, 0.0, 4), [0.00025]);
        assert_eq!(of(0.008, -0.001, 4), [0.002]);
        let foreign = closer_thresholds(&scene(0.008, 0.0), &touches(4, 6, joints));
        assert!(foreign.is_err());
    }
}

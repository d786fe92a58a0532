//! How much of a guess by the camera is believed.
#![allow(non_snake_case)]

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion};
use std::sync::Arc;
use vsf_core::{Belief, Noise, Observation, RestPoints};
use vsf_pipeline::{
    EstimatorSpec, Hyper, PipelineError, PriorShape, Trace, VisionEstimate, VisionSpec,
    estimate_with_vision,
};
use vsf_vision::{Camera, LearnedPrior, RegressorSpec, RgbdView, Seen, VisionError};

const POINTS: usize = 20;
/// Torque per stiffness.
const BEARS: f64 = 0.1;

/// A pole of points, 1 m in front of a camera that looks along x at a wall in the same place.
fn pole() -> (RestPoints, RgbdView) {
    let points = (0..POINTS).map(|i| Point3::new(1.0, 0.0, 0.01 * i as f64));
    let camera = Camera {
        fx: 50.0,
        fy: 50.0,
        cx: 31.5,
        cy: 23.5,
        X_WC: Isometry3::from_parts(
            Default::default(),
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::new(
                0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
            ))),
        ),
    };
    let (color, depth) = (vec![90; 64 * 48 * 3], vec![1000; 64 * 48]);
    let view = RgbdView::new(camera, (64, 48), &color, &depth, 0.001).unwrap();
    (RestPoints::new(points.collect()).unwrap(), view)
}

/// A sequence of touches of single points.
fn trace(touches: &[&[usize]], stiffness: &[f64]) -> Trace {
    let reading = |&p: &usize| {
        let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
        obs.rebuild(POINTS, &[p as u32], &[BEARS * stiffness[p]], |_, w| {
            w[0] = BEARS;
        })
        .unwrap();
        obs
    };
    let observations: Vec<_> = touches.iter().copied().flatten().map(reading).collect();
    let mut start = 0;
    let touch = |t: &&[usize]| {
        start += t.len();
        start - t.len()..start
    };
    Trace {
        id: "0".to_owned(),
        time: (0..observations.len()).map(|k| k as f64).collect(),
        touches: touches.iter().map(touch).collect(),
        observations,
    }
}

fn found(trace: Trace, vision: &VisionSpec) -> Result<VisionEstimate, PipelineError> {
    let (rest, view) = pole();
    let hyper = Hyper {
        prior_sd: 10.0,
        shape: PriorShape::default(),
        noise_sd: vec![0.1],
    };
    let spec = EstimatorSpec::Batch;
    estimate_with_vision(&rest, &view, &[trace], &spec, &hyper, vision, |_| {})
}

/// What was learned is right about this pole, so that held-out touches of its upper half are predicted
/// without an error: heights there are those above the lowest of all points.
#[test]
fn held_out_guesses_are_those_of_the_field() {
    let (rest, view) = pole();
    let seen = Seen::new(&view, rest.positions(), 0.005).unwrap();
    let taught = (0..POINTS).map(|i| 5.0 + 2.0 * i as f64).collect();
    let field = Belief::new(taught, vec![0.01; POINTS]).unwrap();
    let samples = LearnedPrior::samples(&seen, &field, &[true; POINTS], 400.0).unwrap();
    let learned = LearnedPrior::fit(RegressorSpec::Ridge, &[samples.clone(), samples]).unwrap();
    let truth = learned.stiffness(&seen).unwrap();
    assert!(truth[POINTS - 1] > truth[0] + 20.0, "{truth:?}");

    let touches: [&[usize]; 3] = [&[10, 11, 12], &[13, 14, 15], &[16, 17, 18]];
    let vision = VisionSpec::Learned(Arc::new(learned));
    let found = found(trace(&touches, &truth), &vision).unwrap();
    let error = |share: f64| {
        let mut all = found.candidates.iter();
        all.find(|c| c.share == share).unwrap().error
    };
    assert!(error(1.0) < 1e-9, "{}", error(1.0));
    assert!(error(0.0) > 1.0);
    assert_eq!(found.share, 1.0);
}

/// It is touches that are held out, however they are cut into sequences.
#[test]
fn touches_of_one_sequence_are_held_out() {
    let stiffness = [20.0; POINTS];
    let tried = |touches: &[&[usize]]| {
        let found = found(trace(touches, &stiffness), &VisionSpec::Level).unwrap();
        (found.candidates.len(), found.share)
    };
    assert_eq!(tried(&[&[3, 4, 5, 6]]), (0, 0.5));
    assert_eq!(tried(&[&[3, 4], &[5, 6]]), (3, 1.0));
}

#[test]
fn touches_that_are_not_seen() {
    let stiffness = [20.0; POINTS];
    let error = found(trace(&[&[3]], &stiffness), &VisionSpec::Level).unwrap_err();
    assert!(matches!(
        error,
        PipelineError::Vision(VisionError::Unseen {
            touched: 1,
            seen: 1
        })
    ));
}

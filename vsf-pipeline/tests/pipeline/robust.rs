//! Every filter by name can take spikes for what they are.

use nalgebra::Point3;
use vsf_core::{Belief, Noise, Observation, RestPoints};
use vsf_filter::{
    DiagonalForm, DiagonalKalman, DualConfig, MemoryReplay, Projection, ReplayConfig, RobustLoss,
};
use vsf_pipeline::{EstimatorSpec, FilterSpec, Hyper, PriorShape, Trace, estimate, estimate_with};

const STIFFNESS: f64 = 20.0;

/// A spring pressed by 1 m sixty times; every fifteenth reading is a spike.
fn trace() -> Trace {
    let reading = |k: usize| {
        let tau = if k % 15 == 14 {
            10.0 * STIFFNESS
        } else {
            STIFFNESS
        };
        let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
        obs.rebuild(1, &[0], &[tau], |_, w| w[0] = 1.0).unwrap();
        obs
    };
    Trace {
        id: "000".to_owned(),
        time: (0..60).map(f64::from).collect(),
        observations: (0..60).map(reading).collect(),
        touches: std::iter::once(0..60).collect(),
    }
}

/// A filter of one's own, in any number type, comes to what the same one by its name does.
#[test]
fn filters_of_ones_own() {
    let rest = RestPoints::new(vec![Point3::origin()]).unwrap();
    let hyper = Hyper {
        prior_sd: 50.0,
        shape: PriorShape::independent(),
        noise_sd: vec![0.5],
    };
    let spec = FilterSpec::replay().into();
    let named = estimate(&rest, &[trace()], &spec, &hyper, |_| {}).unwrap();
    let noise = Noise::uniform(1, 0.5).unwrap();
    let prior = Belief::uniform(1, 0.0, 50.0).unwrap();
    let filter = DiagonalKalman::<f64>::new(prior.clone());
    let mut own = MemoryReplay::new(filter, ReplayConfig::default()).unwrap();
    let found = estimate_with(&mut own, &[trace()], Some(&noise), |_| {}).unwrap();
    assert_eq!(found.belief, named.belief);
    assert_eq!(
        (&found.touched, found.health),
        (&named.touched, named.health)
    );
    let mut single = DiagonalKalman::<f32>::new(prior.cast().unwrap());
    let found = estimate_with(&mut single, &[trace()], None, |_| {}).unwrap();
    let mut double = DiagonalKalman::<f64>::new(prior);
    let other = estimate_with(&mut double, &[trace()], None, |_| {}).unwrap();
    assert!((found.belief.mean()[0] - other.belief.mean()[0]).abs() < 1e-4);
    let wide = Noise::uniform(2, 0.5).unwrap();
    assert!(estimate_with(&mut double, &[trace()], Some(&wide), |_| {}).is_err());
}

#[test]
fn val_spikes_hardly_move_a_robust_filter() {
    let rest = RestPoints::new(vec![Point3::origin()]).unwrap();
    let hyper = Hyper {
        prior_sd: 50.0,
        shape: PriorShape::independent(),
        noise_sd: vec![0.5],
    };
    let replay = |replays| FilterSpec::Replay {
        form: DiagonalForm::default(),
        config: ReplayConfig {
            replays,
            ..ReplayConfig::default()
        },
    };
    for filter in [
        FilterSpec::Exact(Projection::Constrained),
        FilterSpec::Information(Projection::OutputOnly),
        FilterSpec::Dual(DualConfig::default()),
        replay(0),
        replay(20),
    ] {
        let error = |robust| {
            let spec = EstimatorSpec::Online { filter, robust };
            let found = estimate(&rest, &[trace()], &spec, &hyper, |_| {}).unwrap();
            (found.belief.mean()[0] - STIFFNESS).abs()
        };
        // Dual replay goes from reading to reading where they contradict each other, and ends at any of them.
        if !matches!(filter, FilterSpec::Dual(_)) {
            let plain = error(None);
            assert!(plain > 5.0, "{filter:?}: {plain}");
        }
        for loss in [RobustLoss::HUBER, RobustLoss::STUDENT_T] {
            let robust = error(Some(loss));
            assert!(robust < 0.5, "{filter:?}, {loss:?}: {robust}");
        }
    }
}

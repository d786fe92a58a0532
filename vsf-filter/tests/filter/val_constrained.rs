//! The constrained mean of the covariance filter against the batch optimum, which reaches it by
//! another way (block principal pivoting on all readings at once), and against numbers made by
//! other software (see `golden/README.md`).

use crate::common::{archive, golden_observations};
use nalgebra::Point3;
use ndarray::Array1;
use proptest::prelude::*;
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, Prediction, RestPoints, Scalar};
use vsf_filter::{
    BatchMap, CovarianceFilter, FieldPrior, InformationFilter, JointEstimator, Matern, Projection,
    Smoothness,
};
use vsf_testkit::{LinearWorld, Reading};

/// Two blocks of 64 points and a part of a third.
const N: usize = 150;

fn priors(n: usize, mean: f64) -> [(&'static str, FieldPrior); 4] {
    let at = |i: usize| Point3::new(0.01 * (i % 5) as f64, 0.01 * (i / 5) as f64, 0.0);
    let cloud = RestPoints::new((0..n).map(at).collect()).unwrap();
    let local = || {
        let mean = (0..n).map(|i| mean * (1.0 + (i % 3) as f64)).collect();
        let variance = (0..n).map(|i| 1.0 + 0.5 * (i % 7) as f64).collect();
        FieldPrior::from(Belief::<f64>::new(mean, variance).unwrap())
    };
    let smooth = Matern {
        sd: 2.0,
        length: 0.03,
        smoothness: Smoothness::ThreeHalves,
    };
    let level = || local().with_level(1.5).unwrap();
    [
        ("independent", local()),
        ("level", level()),
        ("smooth", local().with_smooth(smooth, &cloud).unwrap()),
        (
            "level and smooth",
            level().with_smooth(smooth, &cloud).unwrap(),
        ),
    ]
}

/// Readings of a field of which half is zero. Touches wander, so that points come in late; those
/// of the last tenth are never touched.
fn wandering(n: usize, d: usize, steps: usize, seed: u64) -> Vec<Reading> {
    let mut world = LinearWorld::new(n, 0.0, 3.0, seed);
    (0..steps)
        .map(|t| {
            let limit = n / 5 + (n - n / 10 - n / 5) * (t + 1) / steps;
            world.reading(limit, 2 + (t * 7) % (n / 6), d, 0.5, 0.2)
        })
        .collect()
}

fn observations<T: Scalar>(n: usize, readings: &[Reading]) -> Vec<Observation<T>> {
    let observation = |r: &Reading| r.observation(n).unwrap();
    readings.iter().map(observation).collect()
}

fn run<T: Scalar>(prior: &FieldPrior, data: &[Observation<T>]) -> CovarianceFilter<T> {
    let mut filter = CovarianceFilter::new(prior.clone()).unwrap();
    assert_eq!(filter.projection(), Projection::Constrained);
    for obs in data {
        filter.update(obs).unwrap();
    }
    filter
}

/// Largest difference, relative to the largest value.
fn gap(got: &[f64], expected: &[f64]) -> f64 {
    let size = expected.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    let gaps = got.iter().zip(expected).map(|(a, b)| (a - b).abs());
    gaps.fold(0.0, f64::max) / size
}

/// Between updates the multipliers are corrected a bounded number of times. Over a session that
/// keeps the mean within 1 % of the optimum; nothing bounds it after the first few readings.
fn compare_unsettled(what: &str, prior: &FieldPrior, data: &[Observation<f64>]) {
    let batch = BatchMap::new(prior.len(), [data]).unwrap();
    let all: Vec<u32> = (0..prior.len() as u32).collect();
    let mean = run(prior, data).extrapolate(&all).unwrap().mean().to_vec();
    let off = gap(&mean, &batch.solve(prior, 1.0).unwrap().mean());
    assert!(off < 1e-2, "{what}: off by {off:.1e} before settling");
}

/// Readings that tie three points together a million times more tightly than the prior: one after the other, their multipliers
/// would take turns without end.
#[test]
fn points_that_are_tied_together_settle() {
    for noise in [1e-2, 1e-3] {
        let mut obs = Observation::new(Noise::uniform(2, noise).unwrap());
        obs.rebuild(4, &[0, 1, 3], &[1.0; 2], |k, column| {
            for (i, w) in column.iter_mut().enumerate() {
                *w = 1.0 + k as f64 + 0.3 * i as f64;
            }
        })
        .unwrap();
        let prior = FieldPrior::from(Belief::<f64>::uniform(4, 1.0, 10.0).unwrap());
        assert_eq!(compare("tied", &prior, &[obs]), 2);
    }
}

/// Compares filter and batch; returns how many points are held at zero.
fn compare(what: &str, prior: &FieldPrior, data: &[Observation<f64>]) -> usize {
    let batch = BatchMap::new(prior.len(), [data]).unwrap();
    let fit = batch.solve(prior, 1.0).unwrap();
    let all: Vec<u32> = (0..prior.len() as u32).collect();
    let mut filter = run(prior, data);
    let field = filter.field().unwrap();
    let off = gap(field.mean(), &fit.mean());
    assert!(off < 1e-6, "{what}: a field off by {off:.1e}");
    filter.settle();
    let residual = filter.kkt_residual();
    assert!(residual <= 1e-10, "{what}: KKT residual {residual:.1e}");

    // All points, those never touched included.
    let settled = filter.extrapolate(&all).unwrap();
    let off = gap(settled.mean(), &fit.mean());
    assert!(off < 1e-6, "{what}: off by {off:.1e}");
    let touched = batch.points();
    let free: Vec<u32> = fit.free_points().collect();
    let expected = fit.marginals(touched).unwrap();
    for (k, &p) in touched.iter().enumerate() {
        let (mean, variance) = (filter.belief().mean(), filter.belief().variance());
        let (m, v) = (mean[p as usize], variance[p as usize]);
        assert_eq!(m == 0.0, free.binary_search(&p).is_err(), "{what}: {p}");
        assert_eq!((m, v), {
            let (mean, variance) = (settled.mean(), settled.variance());
            (mean[p as usize], variance[p as usize])
        });
        let bound = expected.variance()[k];
        assert!(
            v >= bound * (1.0 - 1e-5) && v > 0.0,
            "{what}: variance {v} of point {p} below the {bound} of the batch optimum"
        );
    }
    touched.len() - free.len()
}

#[test]
fn the_mean_is_the_batch_optimum() {
    for (d, steps) in [(1, 60), (7, 60), (19, 20), (70, 12)] {
        for (name, prior) in priors(N, 0.2) {
            let data = observations(N, &wandering(N, d, steps, 11));
            compare_unsettled(&format!("{name} d {d}"), &prior, &data);
            let held = compare(&format!("{name} d {d}"), &prior, &data);
            assert!(held > 0, "{name} d {d}: nothing to hold at zero");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_mean_is_the_batch_optimum_of_any_problem(
        (n, d, steps, seed) in (20usize..120, 1usize..9, 1usize..40, 0u64..1000),
        mean in 0.0f64..2.0,
    ) {
        // The first touches an unknown that pulls its point below zero.
        let mut readings = wandering(n, d, steps, seed);
        let Reading { columns, tau, .. } = &mut readings[0];
        tau.iter_mut().zip(&columns[0]).for_each(|(t, w)| *t -= 40.0 * w);
        for (name, prior) in priors(n, mean) {
            let data = observations(n, &readings);
            compare(name, &prior, &data);
        }
    }
}

/// 60 observations of 7 channels over 200 points, and their optimum from a quadratic program.
#[test]
fn the_mean_is_that_of_a_quadratic_program() {
    let (data, truth) = golden_observations();
    let n = truth.len();
    let expected: Array1<f64> = archive("quadprog.npz").by_name("x_exact_nnls").unwrap();
    let prior = FieldPrior::from(Belief::<f64>::uniform(n, 0.0, 0.1).unwrap());
    let mut filter = run(&prior, &data);
    filter.settle();
    for (i, (a, b)) in filter.belief().mean().iter().zip(&expected).enumerate() {
        assert!((a - b).abs() < 1e-8, "point {i}: {a} instead of {b}");
    }
    compare_unsettled("golden", &prior, &data);
    compare("golden", &prior, &data);
}

/// What the mean says is what is predicted and what residuals are of, and it fits the readings
/// better than means that were cut off at zero.
#[test]
fn predictions_are_of_the_constrained_mean() {
    let readings = wandering(N, 3, 40, 5);
    let (seen, ahead) = readings.split_at(30);
    for (name, prior) in priors(N, 0.2) {
        let mut filter = run::<f64>(&prior, &observations(N, seen));
        for obs in observations::<f64>(N, ahead) {
            filter.include(obs.points()).unwrap();
            filter.settle();
            let mean = filter.belief().mean().to_vec();
            let expected: Vec<f64> = (0..obs.dim())
                .map(|i| {
                    let row = obs.row(i).iter().zip(obs.points());
                    row.map(|(w, &p)| w * mean[p as usize]).sum()
                })
                .collect();
            let mut predicted = Prediction::default();
            filter.predict(&obs, &mut predicted).unwrap();
            let residual = expected.iter().zip(obs.reading()).map(|(e, t)| e - t);
            let norm = residual.map(|r| r * r).sum::<f64>().sqrt();
            let report = filter.update(&obs).unwrap();
            assert!(report.projected > 0, "{name}");
            assert!((report.prefit - norm).abs() < 1e-8, "{name}: prefit");
            for (p, e) in predicted.mean.iter().zip(&expected) {
                assert!((p - e).abs() < 1e-8, "{name}: predicted {p}, not {e}");
            }
        }
    }
}

/// The constraint is no information: what the Gaussian says of readings does not depend on it.
#[test]
fn the_gaussian_goes_on_as_without_constraint() {
    let data = observations::<f64>(N, &wandering(N, 3, 30, 7));
    for (name, prior) in priors(N, 0.2) {
        let mut plain =
            CovarianceFilter::with_projection(prior.clone(), Projection::OutputOnly).unwrap();
        let mut filter = CovarianceFilter::new(prior).unwrap();
        for obs in &data {
            let (a, b) = (plain.update(obs).unwrap(), filter.update(obs).unwrap());
            assert_eq!(a.nis, b.nis, "{name}");
            assert_eq!(a.log_likelihood, b.log_likelihood, "{name}");
            assert_eq!(plain.whitened_residual(), filter.whitened_residual());
            assert_eq!(plain.covariance(1, 2), filter.covariance(1, 2));
        }
    }
}

/// What an update leaves undone goes on with the next.
#[test]
fn work_is_carried_over() {
    let n = 1500;
    let mut world = LinearWorld::new(n, 0.0, 3.0, 2);
    let prior = FieldPrior::from(Belief::<f64>::uniform(n, 0.0, 3.0).unwrap());
    let reading = world.reading(n, n, 7, 0.5, 0.1);
    let mut filter = run::<f64>(&prior, &[reading.observation(n).unwrap()]);
    let first = filter.kkt_residual();
    assert!(first > 1e-6, "one update was enough: {first:.1e}");
    let mut idle = Observation::new(Noise::uniform(7, 0.1).unwrap());
    idle.rebuild(n, &[], &[0.0; 7], |_, _| {}).unwrap();
    for _ in 0..100 {
        filter.update(&idle).unwrap();
    }
    assert!(filter.kkt_residual() <= 1e-6);
}

#[test]
fn restart_and_errors() {
    let readings = wandering(N, 3, 12, 3);
    let data = observations::<f64>(N, &readings);
    for (name, prior) in priors(N, 0.2) {
        let mut filter = run(&prior, &data);
        let before = filter.belief().clone();
        let mut huge = readings[0].clone();
        huge.points = vec![140, 145];
        huge.columns = vec![vec![1e300; 3]; 2];
        assert!(filter.update(&huge.observation(N).unwrap()).is_err());
        assert_eq!(filter.belief(), &before, "{name}");
        filter.restart(prior.clone()).unwrap();
        assert_eq!(filter.projection(), Projection::Constrained);
        assert_eq!(filter.kkt_residual(), 0.0);
        for obs in &data {
            filter.update(obs).unwrap();
        }
        assert_eq!(filter.belief(), &before, "{name}");
    }
}

#[test]
fn the_information_filter_has_no_constrained_mean() {
    let prior = Belief::<f64>::uniform(2, 0.0, 1.0).unwrap();
    let refused = InformationFilter::<f64>::with_projection(prior, Projection::Constrained);
    assert!(matches!(refused, Err(CoreError::Unsupported { .. })));
}

/// The documented accuracy of `f32`.
#[test]
fn single_precision() {
    for (name, prior) in priors(N, 0.2) {
        let readings = wandering(N, 7, 60, 11);
        let mut double = run::<f64>(&prior, &observations(N, &readings));
        let mut single = run::<f32>(&prior, &observations(N, &readings));
        double.settle();
        single.settle();
        assert!(single.kkt_residual() <= 8e-6, "{name}");
        let mean: Vec<f64> = single.belief().mean().iter().map(|&m| m.into()).collect();
        let off = gap(&mean, double.belief().mean());
        eprintln!("{name}: f32 off by {off:.1e}");
        assert!(off < 1e-3, "{name}: off by {off:.1e}");
    }
}

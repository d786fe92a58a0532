//! The dense filters keep the promises of every estimator, in both precisions; what `f32` costs,
//! and that threads change nothing.

use nalgebra::Point3;
use rayon::ThreadPoolBuilder;
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, RestPoints, Scalar};
use vsf_filter::{
    CovarianceFilter, FieldPrior, InformationFilter, JointEstimator, Matern, Projection,
    RobustLoss, RobustNoise, Smoothness,
};
use vsf_testkit::{EstimatorOptions, LinearWorld, check_estimator};

fn check<T: Scalar, E: Estimator<Scalar = T> + 'static>(make: impl Fn(Belief<T>) -> E) {
    for (channels, seed) in [(1, 1), (3, 2), (7, 3), (11, 4)] {
        let options = EstimatorOptions {
            channels,
            seed,
            exact: true,
            ..EstimatorOptions::default()
        };
        check_estimator(&make, options);
        let boxed = |prior| Box::new(make(prior)) as Box<dyn Estimator<Scalar = T>>;
        check_estimator(boxed, options);
    }
}

fn conforms<T: Scalar>() {
    check(|p: Belief<T>| CovarianceFilter::new(p).unwrap());
    for projection in [Projection::OutputOnly, Projection::FedBack] {
        check(|p: Belief<T>| CovarianceFilter::with_projection(p, projection).unwrap());
        check(|p: Belief<T>| InformationFilter::with_projection(p, projection).unwrap());
    }
}

/// A prior that is alike in space and of one level: every touch teaches about all points.
fn correlated<T: Scalar>(own: Belief<T>) -> FieldPrior {
    let sd = own.variance()[0].to_f64().sqrt();
    let points = (0..own.len()).map(|i| Point3::new(0.01 * i as f64, 0.0, 0.0));
    let rest = RestPoints::new(points.collect()).unwrap();
    let smooth = Matern {
        sd: 0.5 * sd,
        length: 0.04,
        smoothness: Smoothness::ThreeHalves,
    };
    let prior = FieldPrior::from(own).with_level(0.3 * sd).unwrap();
    prior.with_smooth(smooth, &rest).unwrap()
}

fn conforms_in_space<T: Scalar>() {
    let options = EstimatorOptions {
        local: false,
        exact: true,
        ..EstimatorOptions::default()
    };
    let make = |p: Belief<T>| CovarianceFilter::new(correlated(p)).unwrap();
    check_estimator(make, options);
    let make = |p: Belief<T>| InformationFilter::new(correlated(p)).unwrap();
    check_estimator(make, options);
}

#[test]
fn priors_in_space_conform_f32() {
    conforms_in_space::<f32>();
}

#[test]
fn priors_in_space_conform_f64() {
    conforms_in_space::<f64>();
}

/// Told that its points are independent, the suite finds that they are not.
#[test]
#[should_panic = "untouched points keep their prior"]
fn a_prior_in_space_is_not_local() {
    let options = EstimatorOptions {
        exact: true,
        gaussian: false,
        ..EstimatorOptions::default()
    };
    // A level that is a share of the mean variance stands relabeling and other units, which are asked first.
    let make = |p: Belief<f64>| {
        let mean = p.variance().iter().sum::<f64>() / p.len() as f64;
        let prior = FieldPrior::from(p).with_level(0.3 * mean.sqrt()).unwrap();
        CovarianceFilter::new(prior).unwrap()
    };
    check_estimator(make, options);
}

#[test]
fn conforms_f32() {
    conforms::<f32>();
}

#[test]
fn conforms_f64() {
    conforms::<f64>();
}

#[test]
fn more_points_than_a_matrix_holds_are_refused() {
    let n = 40_000;
    let points: Vec<u32> = (0..n as u32).collect();
    let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
    obs.rebuild(n, &points, &[1.0], |_, w| w[0] = 1.0).unwrap();
    let mut one = Observation::new(Noise::uniform(1, 1.0).unwrap());
    one.rebuild(n, &[7], &[1.0], |_, w| w[0] = 1.0).unwrap();
    let prior = Belief::<f64>::uniform(n, 0.0, 1.0).unwrap();
    // Chosen at run time, they are estimators like any other.
    let filters: [Box<dyn JointEstimator<Scalar = f64>>; 2] = [
        Box::new(CovarianceFilter::new(prior.clone()).unwrap()),
        Box::new(InformationFilter::new(prior).unwrap()),
    ];
    for filter in filters {
        let mut filter = RobustNoise::new(filter.clone(), RobustLoss::HUBER)
            .unwrap()
            .into_inner();
        filter.update(&one).unwrap();
        let before = filter.belief().clone();
        let error = filter.update(&obs).unwrap_err();
        assert!(
            matches!(error, CoreError::TooMany { max: 32_768, .. }),
            "{error}"
        );
        assert_eq!(filter.belief(), &before);
        assert_eq!(filter.extrapolate(&points).unwrap().len(), n);
    }
}

/// Updates of `n` points of which most are touched at once, after all were touched.
fn pushes<T: Scalar>(n: usize, sd: f64, steps: usize) -> Vec<Observation<T>> {
    let mut world = LinearWorld::new(n, 2.0 * sd, sd, 6);
    let first = world.reading(n, n, 7, 0.03, 0.3);
    let later = (0..steps).map(|_| world.reading(n, n * 5 / 6, 7, 0.03, 0.3));
    let readings: Vec<_> = std::iter::once(first).chain(later).collect();
    readings.iter().map(|r| r.observation(n).unwrap()).collect()
}

fn run<E: Estimator>(mut filter: E, data: &[Observation<E::Scalar>]) -> E {
    data.iter().for_each(|obs| {
        filter.update(obs).unwrap();
    });
    filter
}

fn threads_do_not_matter<E: Estimator>(
    data: &[Observation<E::Scalar>],
    make: impl Fn() -> E + Sync,
) {
    let beliefs = [1, 2, 3, 8].map(|threads| {
        let pool = ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| run(make(), data).belief().clone())
    });
    for (belief, threads) in beliefs.iter().zip([1, 2, 3, 8]) {
        assert!(belief == &beliefs[0], "{threads} threads");
    }
}

#[test]
fn results_do_not_depend_on_threads() {
    fn check<T: Scalar>() {
        let prior = |n| Belief::<T>::uniform(n, 4.0, 2.0).unwrap();
        threads_do_not_matter(&pushes::<T>(1300, 2.0, 25), || {
            CovarianceFilter::new(prior(1300)).unwrap()
        });
        threads_do_not_matter(&pushes::<T>(300, 2.0, 3), || {
            InformationFilter::new(prior(300)).unwrap()
        });
    }
    check::<f32>();
    check::<f64>();
}

/// The figures that the documentation of `CovarianceFilter` gives for `f32`.
#[test]
fn single_precision_errs_by_a_millionth_of_the_prior() {
    for (projection, bound) in [
        (Projection::OutputOnly, 1e-3),
        (Projection::Constrained, 4e-3),
    ] {
        let (n, sd) = (300, 10.0);
        let prior = Belief::<f64>::uniform(n, 2.0 * sd, sd).unwrap();
        let single = CovarianceFilter::<f32>::with_projection(prior.clone(), projection).unwrap();
        let single = run(single, &pushes(n, sd, 1000));
        let double = CovarianceFilter::<f64>::with_projection(prior, projection).unwrap();
        let double = run(double, &pushes(n, sd, 1000));
        let (a, b) = (single.belief(), double.belief());
        let (mut mean, mut variance, mut least) = (0.0f64, 0.0f64, 1.0f64);
        for i in 0..n {
            let v = double.covariance(i, i).unwrap();
            least = least.min(v / sd.powi(2));
            mean = mean.max((f64::from(a.mean()[i]) - b.mean()[i]).abs() / v.sqrt());
            let off = f64::from(single.covariance(i, i).unwrap()) - v;
            variance = variance.max(off.abs() / sd.powi(2));
        }
        eprintln!(
            "{projection:?}: posterior variance down to {least:.1e} of the prior's: f32 means off by \
             {mean:.1e} of their sd, variances by {variance:.1e} of the prior's"
        );
        assert!(least < 1e-3, "an easy case");
        assert!(mean < bound);
        assert!(variance < 2e-6);
    }
}

/// Where `f32` cannot hold the posterior any more, the filter says so and keeps what it had.
#[test]
fn lost_definiteness_is_an_error() {
    let n = 300;
    let mut world = LinearWorld::new(n, 200.0, 100.0, 1);
    let prior = Belief::<f32>::uniform(n, 200.0, 100.0).unwrap();
    let mut filter = CovarianceFilter::<f32>::new(prior).unwrap();
    let mut lost = false;
    for _ in 0..150 {
        let reading = world.reading(n, 250, 7, 0.1, 0.05);
        let before = filter.belief().clone();
        if let Err(error) = filter.update(&reading.observation(n).unwrap()) {
            assert!(matches!(error, CoreError::NotPositiveDefinite { .. }));
            assert_eq!(filter.belief(), &before);
            lost = true;
        }
        let belief = filter.belief();
        assert!(belief.variance().iter().all(|v| *v > 0.0 && v.is_finite()));
    }
    assert!(lost, "f32 held");
}

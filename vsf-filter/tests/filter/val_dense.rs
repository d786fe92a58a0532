//! The dense filters against numbers made by other software (see `golden/README.md`) and against
//! the closed form of a Gaussian posterior.

use crate::common::{archive, golden_observations};
use nalgebra::{DMatrix, DVector, Point3};
use ndarray::Array2;
use proptest::prelude::*;
use vsf_core::{Belief, CoreError, Estimator, Observation, Prediction, RestPoints, Scalar};
use vsf_filter::{
    CovarianceFilter, FieldPrior, InformationFilter, JointEstimator, Matern, Projection,
    RobustLoss, RobustNoise, Smoothness,
};
use vsf_testkit::{LinearWorld, Reading};

/// Both filters behind one face.
type Dense<T> = dyn JointEstimator<Scalar = T>;

fn both<T: Scalar>(prior: &FieldPrior, projection: Projection) -> [Box<Dense<T>>; 2] {
    let prior = || prior.clone();
    [
        Box::new(CovarianceFilter::with_projection(prior(), projection).unwrap()),
        Box::new(InformationFilter::with_projection(prior(), projection).unwrap()),
    ]
}

#[test]
fn golden_means_and_covariances() {
    let (observations, _) = golden_observations();
    let covariance: Array2<f64> = archive("ekf_dense.npz").by_name("cov_final").unwrap();
    let n = covariance.nrows();
    let prior = FieldPrior::from(Belief::<f64>::uniform(n, 0.0, 0.1).unwrap());
    for (projection, key) in [
        (Projection::OutputOnly, "mu_exact"),
        (Projection::FedBack, "mu_fed_back"),
    ] {
        let mean: Array2<f64> = archive("ekf_dense.npz").by_name(key).unwrap();
        for (k, mut filter) in both::<f64>(&prior, projection).into_iter().enumerate() {
            let mut projected = 0;
            for (t, obs) in observations.iter().enumerate() {
                projected += filter.update(obs).unwrap().projected;
                for i in 0..n {
                    let gap = filter.belief().mean()[i] - mean[[t, i]];
                    assert!(
                        gap.abs() < 1e-9,
                        "{key} filter {k} step {t} point {i}: {gap:e}"
                    );
                }
            }
            assert!(projected > 0, "{key}: nothing to project");
            for i in 0..n {
                for j in 0..n {
                    let expected = covariance[[i, j]];
                    let gap = filter.covariance(i, j).unwrap_or(expected) - expected;
                    assert!(gap.abs() < 1e-9, "{key} filter {k} entry {i}, {j}: {gap:e}");
                }
                let gap = filter.belief().variance()[i] - covariance[[i, i]];
                assert!(gap.abs() < 1e-9, "{key} filter {k} variance {i}: {gap:e}");
            }
        }
    }
}

/// Distances to the true field, relative to its norm.
fn errors(observations: &[Observation<f64>], truth: &[f64], sd: f64) -> [f64; 2] {
    let prior = FieldPrior::from(Belief::<f64>::uniform(truth.len(), 0.0, sd).unwrap());
    let norm = truth.iter().map(|k| k * k).sum::<f64>().sqrt();
    [Projection::OutputOnly, Projection::FedBack].map(|projection| {
        let [mut filter, _] = both::<f64>(&prior, projection);
        observations.iter().for_each(|o| {
            filter.update(o).unwrap();
        });
        let pairs = filter.belief().mean().iter().zip(truth);
        pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt() / norm
    })
}

/// Why [`Projection::FedBack`] is no default: on little data feeding back helps a little, but
/// it throws the mean off what is known well. With the same sign in all columns, as when an object
/// is pushed, it does not recover.
#[test]
fn fed_back_projection_diverges() {
    let (observations, truth) = golden_observations();
    let [exact, fed_back] = errors(&observations, &truth.to_vec(), 0.1);
    eprintln!("golden: exact {exact:.3}, fed back {fed_back:.3}");
    assert!((exact - fed_back).abs() < 0.1 * exact);

    let (n, sd) = (200, 1.0);
    let mut world = LinearWorld::new(n, 0.0, sd, 8);
    let truth = world.stiffness.clone();
    let observations: Vec<_> = (0..300)
        .map(|_| {
            let mut r = world.reading(n, 40, 3, 0.1, 0.1);
            // One sign: what that adds to the columns adds to the reading.
            for (&p, column) in r.points.iter().zip(&mut r.columns) {
                for (w, tau) in column.iter_mut().zip(&mut r.tau) {
                    *tau += (w.abs() - *w) * truth[p as usize];
                    *w = w.abs();
                }
            }
            r.observation(n).unwrap()
        })
        .collect();
    let [exact, fed_back] = errors(&observations, &truth, sd);
    eprintln!("pushes: exact {exact:.3}, fed back {fed_back:.3}");
    assert!(exact < 0.5 && fed_back > 2.0 * exact);
}

const N: usize = 150;

fn cloud() -> RestPoints {
    let at = |i: usize| {
        Point3::new(
            0.01 * (i % 5) as f64,
            0.01 * (i / 5 % 6) as f64,
            0.01 * (i / 30) as f64,
        )
    };
    RestPoints::new((0..N).map(at).collect()).unwrap()
}

/// Correlations are finite at any distance that points can have.
#[test]
fn far_apart_nothing_is_shared() {
    use Smoothness::{FiveHalves, Half, ThreeHalves};
    for smoothness in [Half, ThreeHalves, FiveHalves] {
        for length in [2e-154, 1e-6, 0.02, 1e153] {
            let matern = Matern {
                sd: 3.0,
                length,
                smoothness,
            };
            assert_eq!(matern.covariance(0.0), 9.0);
            for distance in [1e-9, 1.0, 1e6] {
                let found = matern.covariance(distance);
                assert!((0.0..=9.0).contains(&found), "{length} {distance}: {found}");
            }
        }
        let length = 1e-160;
        let matern = Matern {
            sd: 3.0,
            length,
            smoothness,
        };
        let prior = FieldPrior::from(Belief::<f64>::uniform(N, 0.0, 1.0).unwrap());
        assert!(prior.with_smooth(matern, &cloud()).is_err());
    }
}

fn priors() -> [(&'static str, FieldPrior); 4] {
    let local = || {
        let mean = (0..N).map(|i| 4.0 + 0.01 * i as f64).collect();
        let variance = (0..N).map(|i| 1.0 + 0.01 * (i % 7) as f64).collect();
        FieldPrior::from(Belief::<f64>::new(mean, variance).unwrap())
    };
    let smooth = |smoothness| Matern {
        sd: 3.0,
        length: 0.02,
        smoothness,
    };
    let level = || local().with_level(2.0).unwrap();
    [
        ("independent", local()),
        ("level", level()),
        (
            "smooth",
            local()
                .with_smooth(smooth(Smoothness::ThreeHalves), &cloud())
                .unwrap(),
        ),
        (
            "level and smooth",
            level()
                .with_smooth(smooth(Smoothness::FiveHalves), &cloud())
                .unwrap(),
        ),
    ]
}

/// Readings whose touches wander through the field, so that points come in late; the last ten
/// points are never touched.
fn wandering(d: usize, steps: usize) -> Vec<Reading> {
    let mut world = LinearWorld::new(N, 5.0, 3.0, 11);
    (0..steps)
        .map(|t| {
            let limit = 20 + (N - 30) * (t + 1) / steps;
            world.reading(limit, 8 + (t * 7) % 20, d, 0.2, 0.1)
        })
        .collect()
}

/// Mean and covariance of all points after all readings, in one go.
fn batch(prior: &FieldPrior, readings: &[Reading]) -> (DVector<f64>, DMatrix<f64>) {
    let n = prior.len();
    let covariance = DMatrix::from_fn(n, n, |i, j| prior.covariance(i, j));
    let mut precision = covariance.try_inverse().unwrap();
    let mean = DVector::from_column_slice(prior.mean());
    let mut rhs = &precision * mean;
    for r in readings {
        let mut w = DMatrix::zeros(r.tau.len(), n);
        for (&p, column) in r.points.iter().zip(&r.columns) {
            (0..r.tau.len()).for_each(|i| w[(i, p as usize)] = column[i]);
        }
        let weight = DMatrix::from_diagonal(&DVector::from_fn(r.tau.len(), |i, _| {
            r.noise_sd[i].powi(-2)
        }));
        precision += w.transpose() * &weight * &w;
        rhs += w.transpose() * weight * DVector::from_column_slice(&r.tau);
    }
    let covariance = precision.try_inverse().unwrap();
    (&covariance * rhs, covariance)
}

fn feed<T: Scalar>(filter: &mut Dense<T>, readings: &[Reading]) -> f64 {
    let update = |r: &Reading| {
        let report = filter.update(&r.observation(N).unwrap()).unwrap();
        report.log_likelihood
    };
    readings.iter().map(update).sum()
}

#[test]
fn the_posterior_is_that_of_all_readings_at_once() {
    let all: Vec<u32> = (0..N as u32).collect();
    // More than 64 channels do not fit into the room that eight groups of ranks have.
    for (d, steps) in [(1, 60), (7, 40), (19, 20), (70, 12)] {
        let readings = wandering(d, steps);
        for (name, prior) in priors() {
            let (mean, covariance) = batch(&prior, &readings);
            for (k, mut filter) in both::<f64>(&prior, Projection::OutputOnly)
                .into_iter()
                .enumerate()
            {
                let what = format!("{name} filter {k} d {d}");
                feed(&mut *filter, &readings);
                let touched = filter.points().to_vec();
                assert!(touched.len() > 60 && touched.len() <= N - 10);
                for &p in &touched {
                    let i = p as usize;
                    let gap = filter.belief().mean()[i] - mean[i].max(0.0);
                    assert!(gap.abs() < 1e-9, "{what}: mean {i} off by {gap:e}");
                    for &q in &touched {
                        let j = q as usize;
                        let gap = filter.covariance(i, j).unwrap() - covariance[(i, j)];
                        assert!(gap.abs() < 1e-10, "{what}: covariance {i}, {j}: {gap:e}");
                    }
                }
                // Untouched points: the belief shows the prior, extrapolation the posterior.
                let belief = filter.extrapolate(&all).unwrap();
                let field = filter.field().unwrap();
                let marginals = prior.marginals().unwrap();
                for i in 0..N {
                    let gap = belief.mean()[i] - mean[i].max(0.0);
                    assert!(gap.abs() < 1e-9, "{what}: extrapolated mean {i}: {gap:e}");
                    let gap = field.mean()[i] - mean[i].max(0.0);
                    assert!(gap.abs() < 1e-9, "{what}: mean {i} of the field: {gap:e}");
                    assert_eq!(field.variance()[i], filter.belief().variance()[i]);
                    let gap = belief.variance()[i] - covariance[(i, i)];
                    assert!(
                        gap.abs() < 1e-9,
                        "{what}: extrapolated variance {i}: {gap:e}"
                    );
                    if !touched.contains(&(i as u32)) {
                        assert_eq!(filter.belief().mean()[i], marginals.mean()[i]);
                        assert_eq!(filter.belief().variance()[i], marginals.variance()[i]);
                        assert_eq!(filter.covariance(i, i), None);
                    }
                }
                // Included, they are followed by the belief.
                filter.include(&all).unwrap();
                for i in 0..N {
                    let gap = filter.belief().variance()[i] - covariance[(i, i)];
                    assert!(gap.abs() < 1e-9, "{what}: included variance {i}: {gap:e}");
                    let gap = filter.covariance(i, N - 1).unwrap() - covariance[(i, N - 1)];
                    assert!(gap.abs() < 1e-9, "{what}: included covariance {i}: {gap:e}");
                }
            }
        }
    }
}

/// What wraps a filter hands its field on, not its belief.
#[test]
fn the_field_of_a_wrapped_filter_is_its_own() {
    let readings = wandering(3, 10);
    for (name, prior) in priors() {
        let filter = CovarianceFilter::<f64>::with_projection(prior, Projection::OutputOnly);
        let mut filter = filter.unwrap();
        feed(&mut filter, &readings);
        let field = filter.field().unwrap();
        // Independent points say nothing of each other.
        assert_eq!(&field == filter.belief(), name == "independent", "{name}");
        let boxed: Box<dyn Estimator<Scalar = f64>> = Box::new(filter.clone());
        let robust = RobustNoise::new(filter, RobustLoss::Huber { k: 1.345 }).unwrap();
        assert_eq!(boxed.field().unwrap(), field, "{name}");
        assert_eq!(robust.field().unwrap(), field, "{name}");
    }
}

/// `W mu` and `W P W^T + R` of points of which some were never touched.
#[test]
fn predictions_use_all_correlations() {
    let readings = wandering(3, 20);
    let mut world = LinearWorld::new(N, 5.0, 1.0, 3);
    let ahead = world.reading(N, 60, 4, 0.2, 0.3);
    let w = DMatrix::from_fn(4, N, |i, p| {
        let column = ahead.points.iter().position(|&q| q as usize == p);
        column.map_or(0.0, |k| ahead.columns[k][i])
    });
    for (name, prior) in priors() {
        let (mean, covariance) = batch(&prior, &readings);
        let (mean, covariance) = (&w * mean, &w * covariance * w.transpose());
        for mut filter in both::<f64>(&prior, Projection::OutputOnly) {
            feed(&mut *filter, &readings);
            assert!(ahead.points.iter().any(|p| !filter.points().contains(p)));
            let mut predicted = Prediction::default();
            let obs = ahead.observation(N).unwrap();
            filter.predict(&obs, &mut predicted).unwrap();
            for i in 0..4 {
                let sd = (covariance[(i, i)] + 0.09).sqrt();
                assert!((predicted.mean[i] - mean[i]).abs() < 1e-9, "{name}");
                assert!((predicted.sd[i] - sd).abs() < 1e-9, "{name}");
            }
            // What is predicted is what the update then finds, for the whole distribution.
            let report = filter.update(&obs).unwrap();
            let r = DVector::from_column_slice(&ahead.tau) - &mean;
            let s = covariance.clone() + DMatrix::identity(4, 4) * 0.09;
            let nis = r.dot(&(s.clone().try_inverse().unwrap() * &r));
            let log = -0.5 * (nis + s.determinant().ln() + 4.0 * std::f64::consts::TAU.ln());
            assert!((report.nis - nis).abs() < 1e-8, "{name}");
            assert!((report.log_likelihood - log).abs() < 1e-8, "{name}");
            assert!((report.prefit - r.norm()).abs() < 1e-9, "{name}");
        }
    }
}

/// The sum of the log-likelihoods of a run is that of all readings under the prior, whatever the
/// order.
#[test]
fn order_does_not_matter() {
    let readings = wandering(5, 30);
    let mut turned = readings.clone();
    turned.reverse();
    turned.swap(3, 17);
    for (name, prior) in priors() {
        let [mut a, mut b] = both::<f64>(&prior, Projection::OutputOnly);
        let [mut c, _] = both::<f64>(&prior, Projection::OutputOnly);
        let logs = [
            feed(&mut *a, &readings),
            feed(&mut *b, &turned),
            feed(&mut *c, &turned),
        ];
        assert!((logs[0] - logs[1]).abs() < 1e-7, "{name}: {logs:?}");
        assert!((logs[0] - logs[2]).abs() < 1e-7, "{name}: {logs:?}");
        for i in 0..N {
            let mean = |f: &Dense<f64>| f.extrapolate(&[i as u32]).unwrap().mean()[0];
            assert!((mean(&*a) - mean(&*b)).abs() < 1e-9, "{name}: point {i}");
            assert!((mean(&*a) - mean(&*c)).abs() < 1e-9, "{name}: point {i}");
        }
    }
}

/// Points with correlated noise channels, a reading that is refused, and a restart.
#[test]
fn errors_and_restarts() {
    let readings = wandering(3, 12);
    for (name, prior) in priors() {
        for mut filter in both::<f64>(&prior, Projection::FedBack) {
            let log = feed(&mut *filter, &readings);
            let before = filter.belief().clone();
            let mut huge = readings[0].clone();
            huge.points = vec![140, 145];
            huge.columns = vec![vec![1e300; 3]; 2];
            let obs = huge.observation(N).unwrap();
            assert!(filter.update(&obs).is_err(), "{name}");
            assert_eq!(filter.belief(), &before, "{name}");
            let whitened = filter.whitened_residual().to_vec();
            assert!(whitened.iter().all(|x| x.is_finite()) && whitened.len() == 3);
            for bad in [N as u32, u32::MAX] {
                assert!(filter.include(&[0, bad]).is_err());
                assert!(filter.extrapolate(&[0, bad]).is_err());
            }
            assert_eq!(filter.belief(), &before, "{name}");
            filter.restart(prior.clone()).unwrap();
            assert_eq!(filter.belief(), &prior.marginals().unwrap());
            assert!(filter.points().is_empty() && filter.whitened_residual().is_empty());
            assert_eq!(feed(&mut *filter, &readings), log, "{name}");
            assert_eq!(filter.belief(), &before, "{name}");
        }
    }
    // A prior that `f32` cannot hold.
    let wide = Belief::<f64>::uniform(3, 0.0, 1e30).unwrap();
    assert!(CovarianceFilter::<f32>::new(wide.clone()).is_err());
    assert!(InformationFilter::<f32>::new(wide).is_err());
}

/// A singular prior (the local part vanishes beside the level) is an error, not a nonsense.
#[test]
fn a_prior_without_room_is_refused() {
    let prior = FieldPrior::from(Belief::<f64>::uniform(N, 1.0, 1e-12).unwrap())
        .with_level(1e3)
        .unwrap();
    let readings = wandering(2, 3);
    for mut filter in both::<f64>(&prior, Projection::OutputOnly) {
        let before = filter.belief().clone();
        let error = filter.update(&readings[0].observation(N).unwrap());
        assert!(
            matches!(error, Err(CoreError::NotPositiveDefinite { .. })),
            "{error:?}"
        );
        assert_eq!(filter.belief(), &before);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The two forms are the same filter.
    #[test]
    fn both_forms_agree(
        seed in 0u64..1000,
        d in 1usize..10,
        steps in 1usize..25,
        contacts in 1usize..60,
        which in 0usize..4,
        fed_back: bool,
        noise in 0.02f64..2.0,
    ) {
        let projection = if fed_back { Projection::FedBack } else { Projection::OutputOnly };
        let (_, prior) = priors().into_iter().nth(which).unwrap();
        let mut world = LinearWorld::new(N, 2.0, 3.0, seed);
        let [mut a, mut b] = both::<f64>(&prior, projection);
        for t in 0..steps {
            let limit = N.min(contacts + 20 * t);
            let reading = world.reading(limit, contacts, d, 0.1, noise);
            let obs = reading.observation(N).unwrap();
            let (x, y) = (a.update(&obs).unwrap(), b.update(&obs).unwrap());
            prop_assert!((x.nis - y.nis).abs() < 1e-7 * (1.0 + y.nis));
            prop_assert!((x.postfit - y.postfit).abs() < 1e-8);
        }
        for i in 0..N {
            let gap = a.belief().mean()[i] - b.belief().mean()[i];
            prop_assert!(gap.abs() < 1e-9, "mean {} off by {:e}", i, gap);
            let (v, w) = (a.belief().variance()[i], b.belief().variance()[i]);
            prop_assert!((v - w).abs() < 1e-9 * w.max(1.0), "variance {}: {} {}", i, v, w);
            let prior = prior.covariance(i, i);
            prop_assert!(v > 0.0 && v <= prior * (1.0 + 1e-12));
        }
    }
}

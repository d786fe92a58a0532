use crate::property::ask;
use crate::world::normal;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use vsf_vision::{Features, Regressor, Samples};

/// Number of samples in the problems.
const SAMPLES: usize = 400;
/// Share of the spread of a plane that may stay unexplained.
const LEFT: f64 = 0.7;
/// Range of squared errors, in units of their predicted variances.
const HONEST: std::ops::Range<f64> = 0.5..2.0;

type Property = fn(&dyn Regressor);

/// Checks that a regressor keeps the promises of [`Regressor`], on noisy planes in two features.
///
/// Only [`Regressor::fresh`] copies are used; the regressor itself stays unchanged.
///
/// | property |
/// | --- |
/// | a regressor that has not learned refuses to predict |
/// | a plane is predicted better than by its mean, and the mean squared error is 0.5 to 2 times the predicted variance |
/// | far away, the variance is at least nearly that of all targets (0.8 of it), and larger than among them |
/// | learning again replaces what was learned |
/// | a fresh one learns the same |
/// | coincident samples, lattices and constant features are accepted |
/// | features other than those it learned from are refused, and change nothing |
/// | features so far away that numbers overflow are an error |
///
/// # Panics
/// With the name of the property that does not hold.
///
/// ```
/// vsf_testkit::check_regressor(&vsf_vision::Ridge::new());
/// ```
pub fn check_regressor(regressor: &dyn Regressor) {
    let properties: [(&str, Property); 8] = [
        ("one that has not learned refuses", unlearned),
        ("a plane is predicted, errors are as large as told", plane),
        ("far away it knows no more than the spread", far_away),
        ("what is learned anew replaces the old", anew),
        ("a fresh one learns the same", fresh),
        ("coincident and constant samples are taken", odd_samples),
        ("other features are refused", other_features),
        ("what overflows is an error", overflow),
    ];
    for (property, check) in properties {
        ask("regressor", property, || check(regressor));
    }
}

fn features(rows: &[[f64; 2]]) -> Features {
    let column = |k: usize| rows.iter().map(|r| r[k]).collect::<Vec<_>>();
    let all = Features::new(rows.len()).with_column("a", &column(0));
    all.and_then(|f| f.with_column("b", &column(1)))
        .expect("features")
}

fn samples(rows: &[[f64; 2]], targets: Vec<f64>, variance: f64) -> Samples {
    let variances = vec![variance; rows.len()];
    Samples::new(features(rows), targets, variances).expect("samples")
}

/// Places, and `5 + slope a + 0.3 b` there, with noise of standard deviation 0.5.
fn noisy_plane(slope: f64, seed: u64) -> (Vec<[f64; 2]>, Vec<f64>) {
    let mut rng = Pcg64Mcg::seed_from_u64(seed);
    let mut row = || {
        let row = [rng.random_range(-1.0..1.0), rng.random_range(0.0..10.0)];
        let target = 5.0 + slope * row[0] + 0.3 * row[1] + 0.5 * normal(&mut rng);
        (row, target)
    };
    (0..SAMPLES).map(|_| row()).unzip()
}

/// A fresh regressor that has learned a plane.
fn learned(regressor: &dyn Regressor, slope: f64) -> Box<dyn Regressor> {
    let (rows, targets) = noisy_plane(slope, 1);
    let mut learned = regressor.fresh();
    learned
        .fit(&samples(&rows, targets, 0.0))
        .expect("a plane is learned");
    learned
}

fn unlearned(regressor: &dyn Regressor) {
    let found = regressor.fresh().predict(&features(&[[0.0, 0.0]]));
    assert!(found.is_err(), "it predicted {found:?}");
}

fn plane(regressor: &dyn Regressor) {
    let (rows, truth) = noisy_plane(2.0, 2);
    let found = learned(regressor, 2.0)
        .predict(&features(&rows))
        .expect("a prediction");
    found.check(SAMPLES).expect("a prediction");
    let n = SAMPLES as f64;
    let mean = truth.iter().sum::<f64>() / n;
    let plain: f64 = truth.iter().map(|y| (y - mean).powi(2)).sum();
    let squares = || truth.iter().zip(&found.mean).map(|(y, m)| (y - m).powi(2));
    let left: f64 = squares().sum();
    assert!(
        left < LEFT * plain,
        "errors of {left}, of {plain} about the mean"
    );
    let white = squares()
        .zip(&found.variance)
        .map(|(s, v)| s / v)
        .sum::<f64>()
        / n;
    assert!(
        HONEST.contains(&white),
        "their squares are {white} times the variances"
    );
}

fn far_away(regressor: &dyn Regressor) {
    let (_, targets) = noisy_plane(2.0, 1);
    let n = SAMPLES as f64;
    let mean = targets.iter().sum::<f64>() / n;
    let spread = targets.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / n;
    let asked = features(&[[0.0, 5.0], [40.0, 400.0]]);
    let found = learned(regressor, 2.0)
        .predict(&asked)
        .expect("a prediction");
    let [near, far] = [found.variance[0], found.variance[1]];
    assert!(near < far, "a variance of {near} near, of {far} far away");
    assert!(
        far > 0.8 * spread,
        "a variance of {far}, of all targets {spread}"
    );
}

fn anew(regressor: &dyn Regressor) {
    let (rows, targets) = noisy_plane(-2.0, 1);
    let mut again = learned(regressor, 2.0);
    again
        .fit(&samples(&rows, targets, 0.0))
        .expect("a plane is learned");
    same(&*again, &*learned(regressor, -2.0), &rows);
}

fn fresh(regressor: &dyn Regressor) {
    let (rows, targets) = noisy_plane(2.0, 1);
    let first = learned(regressor, 2.0);
    let mut fresh = first.fresh();
    assert!(
        fresh.predict(&features(&rows)).is_err(),
        "it knows what the other one learned"
    );
    fresh
        .fit(&samples(&rows, targets, 0.0))
        .expect("a plane is learned");
    same(&*fresh, &*first, &rows);
}

fn same(one: &dyn Regressor, other: &dyn Regressor, rows: &[[f64; 2]]) {
    let of = |r: &dyn Regressor| r.predict(&features(rows)).expect("a prediction");
    assert_eq!(of(one), of(other));
}

fn odd_samples(regressor: &dyn Regressor) {
    let lattice: Vec<[f64; 2]> = (0..384)
        .map(|i| [f64::from(i % 8), f64::from(i / 8 % 8)])
        .collect();
    let along = lattice.iter().map(|r| r[0]).collect();
    let mut fresh = regressor.fresh();
    fresh
        .fit(&samples(&lattice, along, 1e-4))
        .expect("a lattice is learned");
    let found = fresh.predict(&features(&lattice)).expect("a prediction");
    found.check(lattice.len()).expect("a prediction");
    let one_place = [[3.0, 3.0]; 100];
    fresh
        .fit(&samples(&one_place, vec![2.0; 100], 0.0))
        .expect("one place is learned");
    let found = fresh
        .predict(&features(&[[3.0, 3.0], [9.0, 0.0]]))
        .expect("a prediction");
    let is_that = |m: &f64| (m - 2.0).abs() < 1e-6;
    assert!(
        found.mean.iter().all(is_that),
        "targets of 2 everywhere give {found:?}"
    );
    assert!(
        found.variance.iter().all(|v| *v > 0.0),
        "no variance: {found:?}"
    );
}

fn other_features(regressor: &dyn Regressor) {
    let (rows, _) = noisy_plane(2.0, 1);
    let first = learned(regressor, 2.0);
    let other = Features::new(1).with_column("c", &[0.0]).expect("features");
    assert!(first.predict(&other).is_err(), "another feature was taken");
    let fewer = Features::new(1).with_column("a", &[0.0]).expect("features");
    assert!(
        first.predict(&fewer).is_err(),
        "one feature of two was taken"
    );
    same(&*first, &*learned(regressor, 2.0), &rows);
}

fn overflow(regressor: &dyn Regressor) {
    let first = learned(regressor, 2.0);
    for far in [1e50, 1e120, 1e200, f64::MAX] {
        if let Ok(found) = first.predict(&features(&[[far, -far]])) {
            assert!(found.check(1).is_ok(), "at {far:e} it predicts {found:?}");
        }
    }
}

//! What every regressor promises, asked of each.

use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;
use vsf_testkit::check_regressor;
use vsf_vision::{
    Calibrated, Features, GaussianProcess, GpConfig, KnnConfig, KnnRegressor, Predictions,
    Regressor, RegressorSpec, Ridge, Samples, VisionError, variance_scale,
};

fn all() -> Vec<(String, Box<dyn Regressor>)> {
    let specs = [
        RegressorSpec::Knn(KnnConfig::default()),
        RegressorSpec::Knn(KnnConfig {
            neighbors: 10,
            ..KnnConfig::default()
        }),
        RegressorSpec::Knn(KnnConfig {
            shrink: false,
            ..KnnConfig::default()
        }),
        RegressorSpec::Ridge,
        RegressorSpec::GaussianProcess(GpConfig::default()),
    ];
    let mut all: Vec<(String, Box<dyn Regressor>)> = specs
        .iter()
        .map(|s| (format!("{s:?}"), s.build().unwrap()))
        .collect();
    let calibrated = Calibrated::new(specs[0].build().unwrap(), 5).unwrap();
    all.push(("calibrated knn".to_owned(), Box::new(calibrated)));
    all
}

fn features(rows: &[[f64; 2]]) -> Features {
    let column = |k: usize| rows.iter().map(|r| r[k]).collect::<Vec<_>>();
    let empty = Features::new(rows.len());
    let one = empty.with_column("a", &column(0)).unwrap();
    one.with_column("b", &column(1)).unwrap()
}

/// A plane with noise of deviation 0.5.
fn plane(n: usize, seed: u64) -> (Vec<[f64; 2]>, Vec<f64>) {
    let mut random = Pcg64::seed_from_u64(seed);
    let rows: Vec<[f64; 2]> = (0..n)
        .map(|_| {
            [
                random.random_range(-1.0..1.0),
                random.random_range(0.0..10.0),
            ]
        })
        .collect();
    let noise = |r: &mut Pcg64| -> f64 { StandardNormal.sample(r) };
    let targets = rows
        .iter()
        .map(|r| 5.0 + 2.0 * r[0] + 0.3 * r[1] + 0.5 * noise(&mut random))
        .collect();
    (rows, targets)
}

fn fitted() -> Vec<(String, Box<dyn Regressor>)> {
    let (rows, targets) = plane(400, 1);
    let samples = Samples::new(features(&rows), targets, vec![0.0; 400]).unwrap();
    let mut all = all();
    all.iter_mut().for_each(|(_, r)| r.fit(&samples).unwrap());
    all
}

#[test]
fn every_regressor_keeps_its_promises() {
    all()
        .iter()
        .for_each(|(_, regressor)| check_regressor(&**regressor));
}

#[test]
fn predicts_better_than_the_mean_with_honest_variance() {
    let (rows, truth) = plane(400, 2);
    let mean = truth.iter().sum::<f64>() / 400.0;
    let plain: f64 = truth.iter().map(|y| (y - mean).powi(2)).sum();
    for (name, regressor) in fitted() {
        let found = regressor.predict(&features(&rows)).unwrap();
        let squares = truth.iter().zip(&found.mean).map(|(y, m)| (y - m).powi(2));
        let left: f64 = squares.clone().sum();
        assert!(left < 0.7 * plain, "{name}: {left} of {plain}");
        let white = squares
            .zip(&found.variance)
            .map(|(s, v)| s / v)
            .sum::<f64>()
            / 400.0;
        assert!((0.6..1.6).contains(&white), "{name}: {white}");
    }
}

#[test]
fn uncertain_targets_count_less() {
    let rows = [
        [0.0, 0.0],
        [0.0, 0.0],
        [0.0, 0.0],
        [0.0, 0.0],
        [1.0, 1.0],
        [1.0, 1.0],
    ];
    let targets = vec![1.0, 1.0, 9.0, 9.0, 5.0, 5.0];
    let sure = vec![0.01, 0.01, 1e4, 1e4, 0.01, 0.01];
    let samples = Samples::new(features(&rows), targets, sure).unwrap();
    for (name, mut regressor) in all() {
        regressor.fit(&samples).unwrap();
        let found = regressor.predict(&features(&[[0.0, 0.0]])).unwrap();
        assert!(found.mean[0] < 4.0, "{name}: {found:?}");
    }
}

/// The mean of 20 targets of variance 400 is known to a variance of 20, whether they are alike or not.
#[test]
fn vague_targets_leave_their_mean_uncertain() {
    let rows: Vec<[f64; 2]> = (0..20).map(|i| [f64::from(i), 0.0]).collect();
    let near = features(&[[9.5, 0.0], [0.0, 0.0]]);
    let far = features(&[[100.0, 0.0], [1000.0, 0.0]]);
    for slope in [0.0, 1e-3, 1.0] {
        let targets: Vec<f64> = rows.iter().map(|r| 7.0 + slope * r[0]).collect();
        let spread = slope * slope * 399.0 / 12.0;
        let samples = Samples::new(features(&rows), targets, vec![400.0; 20]).unwrap();
        for (name, mut regressor) in all() {
            regressor.fit(&samples).unwrap();
            let of = |f: &Features| regressor.predict(f).unwrap().variance;
            // Neighbors take the targets for more than noise, and their mean for known twice.
            let least = if name.contains("nn") { 15.0 } else { 20.0 };
            let case = format!("{name}, {slope}: {:?}, {:?}", of(&near), of(&far));
            assert!(of(&near).iter().all(|v| *v > 0.99 * least), "{case}");
            assert!(
                of(&far).iter().all(|v| *v > 0.99 * (spread + 20.0)),
                "{case}"
            );
        }
    }
}

/// Where targets are sure and many, the variance of their mean has no part in a prediction among them.
#[test]
fn sure_targets_leave_their_mean_no_part() {
    let line = |v: f64| {
        let rows: Vec<[f64; 2]> = (0..40).map(|i| [f64::from(i), 0.0]).collect();
        let targets = rows.iter().map(|r| (0.3 * r[0]).sin()).collect();
        Samples::new(features(&rows), targets, vec![v; 40]).unwrap()
    };
    let mut gp = GaussianProcess::default();
    gp.fit(&line(1e-6)).unwrap();
    let found = gp.predict(&features(&[[20.5, 0.0]])).unwrap();
    assert!((found.mean[0] - 6.15f64.sin()).abs() < 0.01, "{found:?}");
    assert!(found.variance[0] < 1e-3, "{found:?}");
}

#[test]
fn the_same_for_any_number_of_threads() {
    let (rows, _) = plane(700, 3);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        pool.build().unwrap().install(|| {
            let predict = |(_, r): (String, Box<dyn Regressor>)| r.predict(&features(&rows));
            fitted()
                .into_iter()
                .map(|r| predict(r).unwrap())
                .collect::<Vec<_>>()
        })
    };
    assert_eq!(run(1), run(4));
}

/// Refuses targets of 1000.
#[derive(Clone)]
struct Choosy(Ridge);

impl Regressor for Choosy {
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        if samples.targets().contains(&1000.0) {
            Err(VisionError::NotFitted { by: "Choosy" })
        } else {
            self.0.fit(samples)
        }
    }
    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        self.0.predict(features)
    }
    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Self(Ridge::new()))
    }
}

/// What was learned before stays when a part of the samples is refused.
#[test]
fn a_refused_calibration_changes_nothing() {
    let (rows, targets) = plane(100, 4);
    let samples = |targets| Samples::new(features(&rows), targets, vec![0.0; 100]).unwrap();
    let mut calibrated = Calibrated::new(Choosy(Ridge::new()), 5).unwrap();
    calibrated.fit(&samples(targets.clone())).unwrap();
    let before = calibrated.predict(&features(&rows)).unwrap();
    // The first part is held out with the odd one, and learned without it.
    let mut odd: Vec<f64> = targets.iter().map(|t| 3.0 * t).collect();
    odd[0] = 1000.0;
    assert!(calibrated.fit(&samples(odd)).is_err());
    assert_eq!(calibrated.predict(&features(&rows)).unwrap(), before);
}

#[test]
fn copies_predict_the_same() {
    fn check<R: Regressor + Clone + std::fmt::Debug>(mut regressor: R) {
        let (rows, targets) = plane(40, 5);
        let samples = Samples::new(features(&rows), targets, vec![0.0; 40]).unwrap();
        regressor.fit(&samples).unwrap();
        let of = |r: &R| r.predict(&features(&rows)).unwrap();
        assert_eq!(of(&regressor.clone()), of(&regressor));
        assert!(format!("{regressor:?}").len() < 200, "{regressor:?}");
    }
    check(Ridge::new());
    check(KnnRegressor::default());
    check(GaussianProcess::default());
    check(Calibrated::new(Ridge::new(), 5).unwrap());
}

/// Answers the same, whatever is asked.
#[derive(Clone)]
struct Fixed(Predictions);

impl Regressor for Fixed {
    fn fit(&mut self, _: &Samples) -> Result<(), VisionError> {
        Ok(())
    }
    fn predict(&self, _: &Features) -> Result<Predictions, VisionError> {
        Ok(self.0.clone())
    }
    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Self(self.0.clone()))
    }
}

#[test]
fn predictions_that_are_none_are_refused() {
    let two = features(&[[0.0, 0.0], [1.0, 0.0]]);
    let held_out = Samples::new(two.clone(), vec![1.0, 2.0], vec![0.1; 2]).unwrap();
    let wrong = [
        (vec![f64::NAN, 0.0], vec![1.0; 2]),
        (vec![0.0; 2], vec![1.0, f64::NAN]),
        (vec![0.0; 2], vec![f64::INFINITY, 1.0]),
        (vec![0.0; 2], vec![-1.0, 1.0]),
        (vec![0.0; 2], vec![1.0]),
        (vec![0.0; 3], vec![1.0; 3]),
    ];
    for (mean, variance) in wrong {
        let predictions = Predictions { mean, variance };
        assert!(predictions.check(2).is_err(), "{predictions:?}");
        let scale = variance_scale(&predictions, &held_out);
        assert!(scale.is_err(), "{predictions:?}: {scale:?}");
        let calibrated = Calibrated::new(Fixed(predictions.clone()), 2).unwrap();
        assert!(calibrated.predict(&two).is_err(), "{predictions:?}");
    }
    let right = Predictions {
        mean: vec![1.0, 2.0],
        variance: vec![0.0; 2],
    };
    let sure = Samples::new(two, vec![1.0, 2.0], vec![0.0; 2]).unwrap();
    assert_eq!(variance_scale(&right, &sure).unwrap(), 1.0);
    let far = Predictions {
        mean: vec![1e200; 2],
        ..right
    };
    assert!(variance_scale(&far, &held_out).is_err());
}

#[test]
fn says_what_is_wrong() {
    for (name, regressor) in all() {
        let asked = regressor.predict(&features(&[[0.0, 0.0]]));
        assert!(
            matches!(asked, Err(VisionError::NotFitted { .. })),
            "{name}"
        );
    }
    for (name, regressor) in fitted() {
        let other = Features::new(1).with_column("c", &[0.0]).unwrap();
        let asked = regressor.predict(&other);
        assert!(matches!(asked, Err(VisionError::Features { .. })), "{name}");
    }
    assert!(Features::new(1).with_column("a", &[f64::NAN]).is_err());
    assert!(Features::new(2).with_column("a", &[1.0]).is_err());
    let twice = features(&[[0.0, 0.0]]).with_column("b", &[1.0]);
    assert!(matches!(twice, Err(VisionError::Duplicate { name }) if name == "b"));
    let mut many = Features::new(usize::MAX);
    assert!(many.extend(&Features::new(1)).is_err());
    assert_eq!(many.len(), usize::MAX);
    let far = features(&[[0.0; 2], [1.0; 2]]);
    assert!(Samples::new(far, vec![1e200; 2], vec![0.0; 2]).is_err());
    let one = || features(&[[0.0, 0.0]]);
    assert!(Samples::new(one(), vec![0.0], vec![0.0]).is_err());
    let two = || features(&[[0.0, 0.0]; 2]);
    assert!(Samples::new(two(), vec![0.0, f64::INFINITY], vec![0.0; 2]).is_err());
    assert!(Samples::new(two(), vec![0.0; 2], vec![0.0, -1.0]).is_err());
    assert!(Samples::new(two(), vec![0.0; 2], vec![0.0]).is_err());
}

#[test]
fn features_that_are_none_are_not_read() {
    let two = features(&[[0.0, 1.0], [2.0, 3.0]]);
    let text = serde_json::to_string(&two).unwrap();
    let read = |text: &str| serde_json::from_str::<Features>(text);
    assert_eq!(read(&text).unwrap(), two);
    for (part, other, problem) in [
        ("\"b\"", "\"a\"", "two features are named \"a\""),
        (
            "\"len\":2",
            "\"len\":3",
            "features has length 4, expected 6",
        ),
        (",3.0", "", "features has length 3, expected 4"),
        (
            "\"len\":2",
            "\"len\":18446744073709551615",
            "features has length 4",
        ),
    ] {
        assert!(text.contains(part), "{text}");
        let error = read(&text.replacen(part, other, 1)).unwrap_err();
        assert!(error.to_string().contains(problem), "{error}");
    }
}

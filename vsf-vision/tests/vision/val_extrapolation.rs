//! Fields whose untouched part is known.

use vsf_core::nalgebra::Point3;
use vsf_core::{Belief, Estimator, Noise, Observation};
use vsf_filter::DiagonalKalman;
use vsf_vision::{
    Calibrated, Extrapolation, Features, KnnRegressor, LearnedPrior, Predictions, Regressor,
    RegressorSpec, Ridge, Samples, Seen, VisionError, fit_level,
};

const PRIOR: f64 = 400.0;

/// A block whose stiffness goes with its color: green 5, brown 20 N/m in bands of 5 cm, in sight
/// down to 2 cm; what lies deeper is hidden, and empty from 6 cm on.
struct Block {
    points: Vec<Point3<f64>>,
    seen: Seen,
    truth: Vec<f64>,
    touched: Vec<bool>,
}

fn block() -> Block {
    let mut b = Block {
        points: Vec::new(),
        seen: Seen::default(),
        truth: Vec::new(),
        touched: Vec::new(),
    };
    for (x, y) in (0..40).flat_map(|x| (0..12).map(move |y| (x, y))) {
        for z in 0..10 {
            let brown = (x / 5) % 2 == 1;
            let depth = 0.01 * f64::from(z);
            b.points.push(Point3::new(
                0.01 * f64::from(x),
                0.01 * f64::from(y),
                -depth,
            ));
            b.seen.visible.push(z < 2);
            b.seen.behind.push(if z < 2 { 0.0 } else { depth });
            b.seen.in_picture.push(true);
            b.seen
                .colors
                .push(if brown { [120, 80, 40] } else { [40, 140, 40] });
            b.seen.heights.push(0.09 - depth);
            let full = if brown { 20.0 } else { 5.0 };
            b.truth.push(if z < 6 { full } else { 0.0 });
            b.touched.push(x < 12);
        }
    }
    b
}

impl Block {
    fn field(&self) -> Belief<f64> {
        let known = |i: usize| self.touched[i];
        let all = 0..self.points.len();
        let mean = all
            .clone()
            .map(|i| if known(i) { self.truth[i] } else { 0.0 });
        let variance = all.map(|i| if known(i) { 1.0 } else { PRIOR });
        Belief::new(mean.collect(), variance.collect()).unwrap()
    }

    fn extended(&self, extrapolation: &mut Extrapolation) -> Belief<f64> {
        extrapolation
            .extend(
                &self.points,
                &self.seen,
                &self.field(),
                &self.touched,
                PRIOR,
            )
            .unwrap()
    }
}

#[test]
fn colors_tell_stiff_from_soft_where_nothing_was_touched() {
    let block = block();
    let all = block.extended(&mut Extrapolation::new(
        Ridge::new(),
        KnnRegressor::default(),
    ));
    let untouched = |i: &usize| !block.touched[*i];
    let visible = |i: &usize| untouched(i) && block.seen.visible[*i];
    for i in (0..block.points.len()).filter(visible) {
        let error = all.mean()[i] - block.truth[i];
        assert!(error.abs() < 2.5, "{}: {error}", block.points[i]);
        assert!(error * error < 9.0 * all.variance()[i] + 0.5);
    }
    // The total is what readings feel.
    let sum = |of: &[f64]| (0..of.len()).filter(untouched).map(|i| of[i]).sum::<f64>();
    let ratio = sum(all.mean()) / sum(&block.truth);
    assert!((0.5..1.5).contains(&ratio), "{ratio}");
}

#[test]
fn touched_points_keep_what_is_known() {
    let block = block();
    let all = block.extended(&mut Extrapolation::new(Ridge::new(), Ridge::new()));
    let field = block.field();
    for i in (0..block.points.len()).filter(|&i| block.touched[i]) {
        assert_eq!(
            (all.mean()[i], all.variance()[i]),
            (field.mean()[i], field.variance()[i])
        );
    }
}

#[test]
fn deep_points_are_thought_empty_unless_told_otherwise() {
    let block = block();
    let deepest = (0..block.points.len()).filter(|&i| !block.touched[i] && i % 10 == 9);
    let mean = |belief: &Belief<f64>| {
        let values: Vec<f64> = deepest.clone().map(|i| belief.mean()[i]).collect();
        values.iter().sum::<f64>() / values.len() as f64
    };
    let knn = || Extrapolation::new(KnnRegressor::default(), KnnRegressor::default());
    let fading = mean(&block.extended(&mut knn()));
    let full = mean(&block.extended(&mut knn().with_fade(f64::INFINITY)));
    assert!(fading < 0.3 * full, "{fading}, {full}");
}

#[test]
fn a_later_touch_corrects_the_guess() {
    let block = block();
    let guess = block.extended(&mut Extrapolation::new(Ridge::new(), Ridge::new()));
    let i = block.points.len() - 10;
    let before = guess.mean()[i];
    let mut filter = DiagonalKalman::new(guess);
    let mut touch = Observation::new(Noise::uniform(1, 0.01).unwrap());
    touch
        .rebuild(block.points.len(), &[i as u32], &[60.0], |_, w| w[0] = 1.0)
        .unwrap();
    filter.update(&touch).unwrap();
    let after = filter.belief().mean()[i];
    assert!(
        before < 30.0 && (after - 60.0).abs() < 1.0,
        "{before} {after}"
    );
}

#[test]
fn without_colors_in_sight_positions_do() {
    let mut block = block();
    block
        .seen
        .visible
        .iter_mut()
        .zip(&block.touched)
        .for_each(|(v, t)| *v &= !t);
    let all = block.extended(&mut Extrapolation::new(
        Ridge::new(),
        KnnRegressor::default(),
    ));
    assert!(all.mean().iter().all(|m| m.is_finite()));
}

#[test]
fn extrapolation_says_what_is_wrong() {
    let block = block();
    let mut ridge = Extrapolation::new(Ridge::new(), Ridge::new());
    let asked = ridge.predict(&block.points, &block.seen);
    assert!(matches!(asked, Err(VisionError::NotFitted { .. })));
    let (field, none) = (block.field(), vec![false; block.points.len()]);
    let mut fit = |touched: &[bool], prior: f64| {
        ridge.fit(&block.points, &block.seen, &field, touched, prior)
    };
    let unseen = fit(&none, PRIOR);
    assert!(matches!(
        unseen,
        Err(VisionError::Unseen {
            touched: 0,
            seen: 0
        })
    ));
    // Touches that told nothing.
    assert!(matches!(
        fit(&block.touched, 1.0),
        Err(VisionError::Untold { told: 0 })
    ));
    assert!(fit(&none[1..], PRIOR).is_err());
    assert!(fit(&block.touched, 0.0).is_err());
    assert!(fit(&block.touched, f64::NAN).is_err());
    assert!(fit(&block.touched, PRIOR).is_ok());
}

#[test]
fn the_level_is_the_least_squares_one() {
    let reading = |w: [f64; 2], tau: [f64; 2]| {
        let mut obs = Observation::new(Noise::per_channel(&[1.0, 0.5]).unwrap());
        obs.rebuild(3, &[0, 2], &tau, |k, column| column.fill(w[k]))
            .unwrap();
        obs
    };
    // shape (1, ., 2): unit readings 1 w0 + 2 w1.
    let shape = [1.0, 9.0, 2.0];
    let first = [reading([1.0, 1.0], [6.0, 9.0])];
    let second = [reading([0.0, 0.5], [5.0, 5.0])];
    let level = fit_level(&shape, first.iter().chain(&second), None).unwrap();
    // Weights 1 and 4: (3*6 + 4*3*9 + 5 + 4*5) / (9 + 36 + 1 + 4).
    assert!((level - 151.0 / 50.0).abs() < 1e-12, "{level}");
    // All readings with noise of which the second channel's is the greater: weights 4 and 1.
    let noise = Noise::per_channel(&[0.5, 1.0]).unwrap();
    let other = fit_level(&shape, first.iter().chain(&second), Some(&noise)).unwrap();
    assert!((other - 124.0 / 50.0).abs() < 1e-12, "{other}");
    let alone = fit_level(&shape, &second, None).unwrap();
    assert!((alone - 5.0).abs() < 1e-12, "{alone}");
    assert!(fit_level(&[0.0, 1.0, 0.0], &first, None).is_err());
    assert!(fit_level(&shape[..2], &first, None).is_err());
    let noise = Noise::uniform(3, 1.0).unwrap();
    assert!(fit_level(&shape, &first, Some(&noise)).is_err());
}

#[test]
fn a_prior_learned_from_objects_is_the_same_from_its_json() {
    let object = |shift: f64| {
        let height: Vec<f64> = (0..60).map(|i| f64::from(i) / 60.0).collect();
        let targets = height.iter().map(|h| 10.0 - 8.0 * h + shift).collect();
        let features = Features::new(60).with_column("height", &height).unwrap();
        Samples::new(features, targets, vec![0.1; 60]).unwrap()
    };
    let asked = Features::new(2).with_column("height", &[0.2, 0.9]).unwrap();
    let mut text = String::new();
    for regressor in [
        RegressorSpec::default(),
        RegressorSpec::Ridge,
        RegressorSpec::GaussianProcess(Default::default()),
    ] {
        let prior =
            LearnedPrior::fit(regressor, &[object(-2.0), object(0.0), object(2.0)]).unwrap();
        let found = prior.predict(&asked).unwrap();
        assert!(
            found.mean[0] > found.mean[1] + 2.0,
            "{regressor:?}: {found:?}"
        );
        // Objects differ by 2 N/m, and a fourth one may as well.
        assert!(found.variance[0] > 1.0, "{regressor:?}: {found:?}");
        text = prior.to_json();
        let again = LearnedPrior::from_json(&text).unwrap();
        assert_eq!(again.predict(&asked).unwrap(), found, "{regressor:?}");
    }
    for damaged in ["{}", &text[..90]] {
        let refused = LearnedPrior::from_json(damaged);
        assert!(
            matches!(refused, Err(VisionError::Json { .. })),
            "{damaged}"
        );
    }
    let negative = text.replacen("\"variances\":[0.1", "\"variances\":[-0.1", 1);
    let refused = LearnedPrior::from_json(&negative);
    assert!(matches!(refused, Err(VisionError::Core(_))));
    // More objects than there are samples: too few of each to hold out.
    let many = text.replacen("\"objects\":3", "\"objects\":4611686018427387904", 1);
    assert!(many.contains("4611686018427387904"));
    let found = LearnedPrior::from_json(&many).unwrap().predict(&asked);
    let found = found.unwrap();
    assert!(found.mean[0] > found.mean[1] + 2.0);
    assert!(LearnedPrior::fit(RegressorSpec::Ridge, &[]).is_err());
}

/// What is stiff by its color on two objects is so on a third, which was never touched.
#[test]
fn looks_carry_over_to_another_object() {
    let mut block = block();
    let occupancy = block.seen.occupancy(Extrapolation::FADE).unwrap();
    for (i, k) in block.truth.iter_mut().enumerate() {
        let is_brown = block.seen.colors[i] == [120, 80, 40];
        *k = occupancy[i] * if is_brown { 20.0 } else { 5.0 };
    }
    let field = block.field();
    let samples = LearnedPrior::samples(&block.seen, &field, &block.touched, PRIOR);
    let samples = samples.unwrap();
    // All touched ones but those in the deepest layer, where there is hardly anything.
    let touched = block.touched.iter().filter(|t| **t).count();
    assert_eq!(samples.len(), touched * 9 / 10);
    assert_eq!(
        samples.features().names(),
        ["L", "a", "b", "depth", "height"]
    );
    let mut seen = block.seen.clone();
    let n = seen.len();
    // The last row lies out of the picture.
    for i in n - 120..n {
        (seen.in_picture[i], seen.behind[i]) = (false, f64::INFINITY);
        seen.visible[i] = false;
    }
    for regressor in [
        RegressorSpec::default(),
        RegressorSpec::Ridge,
        RegressorSpec::GaussianProcess(Default::default()),
    ] {
        let prior = LearnedPrior::fit(regressor, &[samples.clone(), samples.clone()]).unwrap();
        let found = prior.stiffness(&seen).unwrap();
        let pairs = found.iter().zip(&block.truth).take(n - 120);
        let off: Vec<f64> = pairs.map(|(k, truth)| (k - truth).abs()).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        assert!(mean < 0.5, "{regressor:?}: {mean} N/m");
        assert!(found[n - 120..].iter().all(|k| *k == 0.0));
        assert!(found.iter().all(|k| *k >= 0.0 && k.is_finite()));
    }
}

/// Four points that are only ever touched together, each of 20 N/m: the posterior of independent points after an
/// exact reading of their sum. Each is a sample of 20 N/m, and together they count as one reading does; so does
/// a point that is touched alone.
#[test]
fn points_touched_together_count_as_one() {
    let (k, together) = (20.0, 4.0);
    let shared = PRIOR * (1.0 - 1.0 / together);
    let alone = 1e-6 * PRIOR;
    let variance = vec![shared, shared, shared, shared, alone];
    let field = Belief::new(vec![k; 5], variance).unwrap();
    let seen = Seen {
        visible: vec![true; 5],
        behind: vec![0.0; 5],
        in_picture: vec![true; 5],
        colors: vec![[90; 3]; 5],
        heights: vec![0.0, 0.1, 0.2, 0.3, 0.4],
    };
    let found = LearnedPrior::samples(&seen, &field, &[true; 5], PRIOR).unwrap();
    assert_eq!(found.targets(), [k; 5]);
    let weight: f64 = found.variances()[..4].iter().map(|v| shared / v).sum();
    assert!((weight - 1.0).abs() < 1e-9, "{weight}");
    assert!((found.variances()[4] / alone - 1.0).abs() < 1e-5);
}

/// A part of what is seen keeps its heights above the lowest of all points.
#[test]
fn a_part_looks_as_it_does_in_the_whole() {
    let block = block();
    let part = block.seen.select(&[7, 3, 120]).unwrap();
    let alone = part.appearance(&[0, 1, 2]).unwrap();
    let whole = block.seen.appearance(&[7, 3, 120]).unwrap();
    assert_eq!(alone, whole);
    assert!(block.seen.select(&[block.points.len()]).is_err());
}

/// Points beside the picture are unknown, points that are seen through are empty.
#[test]
fn nothing_is_known_out_of_the_picture() {
    let mut b = block();
    let far = Point3::new(0.0, 0.0, 1.0);
    for in_picture in [false, true] {
        b.points.push(far);
        b.seen.visible.push(false);
        b.seen.behind.push(f64::INFINITY);
        b.seen.in_picture.push(in_picture);
        b.seen.colors.push([0; 3]);
        b.seen.heights.push(1.09);
        b.truth.push(0.0);
        b.touched.push(false);
    }
    let n = b.points.len();
    let mut extrapolation = Extrapolation::new(Ridge::new(), Ridge::new());
    let field = b.field();
    let all = extrapolation
        .extend(&b.points, &b.seen, &field, &b.touched, PRIOR)
        .unwrap();
    assert_eq!((all.mean()[n - 2], all.variance()[n - 2]), (0.0, PRIOR));
    assert_eq!(all.mean()[n - 1], 0.0);
    assert!(all.variance()[n - 1] < 1e-3 * PRIOR);
}

/// Points in a row, all in sight, and their field: all but the last are touched, which took half of the
/// prior's variance.
fn row(n: usize) -> (Vec<Point3<f64>>, Seen, Belief<f64>, Vec<bool>) {
    let points = (0..n).map(|i| Point3::new(0.01 * i as f64, 0.0, 0.0));
    let seen = Seen {
        visible: vec![true; n],
        behind: vec![0.0; n],
        in_picture: vec![true; n],
        colors: vec![[90; 3]; n],
        heights: vec![0.0; n],
    };
    let touched: Vec<bool> = (0..n).map(|i| i + 1 < n).collect();
    let of = |&t: &bool| if t { (9.9, 0.5 * PRIOR) } else { (0.0, PRIOR) };
    let (mean, variance) = touched.iter().map(of).unzip();
    let field = Belief::new(mean, variance).unwrap();
    (points.collect(), seen, field, touched)
}

/// 30 samples of variance 400 (half a reading each) say what their mean is to a variance of 400 / 30.
#[test]
fn vague_touches_leave_the_others_uncertain() {
    let (points, seen, field, touched) = row(31);
    for spec in [
        RegressorSpec::default(),
        RegressorSpec::Ridge,
        RegressorSpec::GaussianProcess(Default::default()),
    ] {
        let regressor = || Calibrated::new(spec.build().unwrap(), 5).unwrap();
        let mut extrapolation = Extrapolation::new(regressor(), regressor());
        let found = extrapolation
            .extend(&points, &seen, &field, &touched, PRIOR)
            .unwrap();
        assert!((found.mean()[30] - 9.9).abs() < 1e-6, "{spec:?}");
        let variance = found.variance()[30];
        assert!(
            (0.99 * 400.0 / 30.0..PRIOR).contains(&variance),
            "{spec:?}: {variance}"
        );
    }
}

/// Answers every row with the same mean and variance.
#[derive(Clone)]
struct Fixed(f64, f64);

impl Regressor for Fixed {
    fn fit(&mut self, _: &Samples) -> Result<(), VisionError> {
        Ok(())
    }
    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        Ok(Predictions {
            mean: vec![self.0; features.len()],
            variance: vec![self.1; features.len()],
        })
    }
    fn fresh(&self) -> Box<dyn Regressor> {
        Box::new(Self(self.0, self.1))
    }
}

#[test]
fn what_a_regressor_does_not_know_is_not_certain() {
    let (points, seen, field, touched) = row(10);
    let extended = |mean: f64, variance: f64| {
        let regressor = || Fixed(mean, variance);
        let mut extrapolation = Extrapolation::new(regressor(), regressor());
        extrapolation.extend(&points, &seen, &field, &touched, PRIOR)
    };
    let nan = f64::NAN;
    for (mean, variance) in [(nan, 1.0), (1.0, nan), (1.0, -1.0), (1e200, 1.0)] {
        assert!(extended(mean, variance).is_err(), "{mean}, {variance}");
    }
    let least = extended(1.0, 0.0).unwrap();
    assert_eq!((least.mean()[9], least.variance()[9]), (1.0, 1e-6 * PRIOR));
}

#[test]
fn views_that_are_none_are_refused() {
    let (points, seen, field, touched) = row(10);
    let spoiled = |spoil: fn(&mut Seen)| {
        let mut seen = seen.clone();
        spoil(&mut seen);
        seen
    };
    let wrong = [
        spoiled(|s| s.behind.truncate(3)),
        spoiled(|s| s.in_picture.truncate(3)),
        spoiled(|s| s.colors.truncate(3)),
        spoiled(|s| s.heights.truncate(3)),
        spoiled(|s| s.heights.push(0.0)),
        spoiled(|s| s.behind[4] = -5.0),
        spoiled(|s| s.behind[4] = f64::NAN),
    ];
    let mut extrapolation = Extrapolation::new(Ridge::new(), Ridge::new());
    for seen in wrong {
        assert!(seen.check().is_err());
        assert!(seen.occupancy(0.03).is_err());
        assert!(seen.appearance(&[4]).is_err());
        assert!(seen.select(&[4]).is_err());
        assert!(
            extrapolation
                .extend(&points, &seen, &field, &touched, PRIOR)
                .is_err()
        );
    }
    let fit = extrapolation.extend(&points, &seen, &field, &touched, PRIOR);
    assert!(fit.is_ok() && seen.check().is_ok());
    assert!(format!("{extrapolation:?}").contains("0.03"));
}

use super::suite::{Suite, same};
use crate::Reading;
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, Prediction, Scalar};

impl<T: Scalar> Suite<'_, T> {
    pub(super) fn determinism(&self) {
        let readings = self.sequence(self.options.points);
        let first = self.run(self.prior(), &readings);
        same(&self.run(self.prior(), &readings), &first, "a second one");
    }

    pub(super) fn reset(&self) {
        let readings = self.sequence(self.options.points);
        let mut estimator = (self.make)(self.prior());
        self.feed(&mut estimator, &readings);
        let first = estimator.belief().clone();
        estimator.begin_sequence();
        same(estimator.belief(), &first, "a new sequence");
        estimator.reset(self.prior()).unwrap();
        same(estimator.belief(), &self.prior(), "right after reset");
        let expected = self.afresh(&readings);
        assert!(
            estimator.whitened_residual().is_empty(),
            "a residual is left after reset"
        );
        self.feed(&mut estimator, &readings);
        same(estimator.belief(), &expected, "the same run after reset");
        if self.options.local {
            same(&first, &expected, "one that was never reset");
        }
    }

    /// The belief of an estimator that was made, reset and fed. For priors that correlate points, the reset is left out.
    fn afresh(&self, readings: &[Reading]) -> Belief<T> {
        let mut estimator = (self.make)(self.prior());
        estimator.reset(self.prior()).unwrap();
        self.feed(&mut estimator, readings);
        estimator.belief().clone()
    }

    pub(super) fn empty(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        let before = estimator.belief().clone();
        let mut obs = Observation::new(Noise::uniform(o.channels, o.noise_sd).unwrap());
        let tau: Vec<f64> = (0..o.channels)
            .map(|i| o.noise_sd * (1.0 + i as f64))
            .collect();
        obs.rebuild(o.points, &[], &tau, |_, _| {}).unwrap();
        let report = estimator.update(&obs).unwrap();
        same(estimator.belief(), &before, "without contacts");
        assert_eq!(report.contacts, 0, "contacts reported");
        if o.gaussian {
            let expected: f64 = (1..=o.channels).map(|i| (i * i) as f64).sum();
            assert!(
                (report.nis - expected).abs() <= 1e-5 * expected,
                "NIS is {}, that of the noise alone {expected}",
                report.nis
            );
        }
    }

    pub(super) fn untouched(&self) {
        let o = &self.options;
        let (limit, prior) = (o.points / 2, self.prior());
        let mut estimator = (self.make)(prior.clone());
        same(estimator.belief(), &prior, "before the first update");
        self.feed(&mut estimator, &self.sequence(limit));
        let belief = estimator.belief();
        for i in limit..o.points {
            assert!(
                belief.mean()[i] == prior.mean()[i] && belief.variance()[i] == prior.variance()[i],
                "point {i} was never touched, but moved"
            );
        }
    }

    /// A point first touched late still has its prior to learn from.
    pub(super) fn late(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        self.feed(&mut estimator, &self.sequence(o.points / 2));
        let before = estimator.belief().clone();
        let last = o.points - 1;
        let late = Reading {
            points: vec![last as u32],
            columns: vec![vec![o.weight; o.channels]],
            tau: vec![o.weight * 2.0 * o.prior_mean; o.channels],
            noise_sd: vec![o.noise_sd; o.channels],
        };
        self.feed(&mut estimator, &[late]);
        let (m, v) = (
            before.mean()[last].to_f64(),
            before.variance()[last].to_f64(),
        );
        let mean = estimator.belief().mean()[last].to_f64();
        let variance = estimator.belief().variance()[last].to_f64();
        assert!(mean > m, "the mean {mean} did not rise from {m}");
        assert!(variance <= v, "the variance {variance} rose from {v}");
        if o.exact && o.local {
            let gained = o.channels as f64 * (o.weight / o.noise_sd).powi(2);
            let expected = v / (1.0 + v * gained);
            let bound = self.tolerance();
            assert!(
                (variance - expected).abs() <= bound * v,
                "the variance is {variance}, that of one spring {expected}"
            );
            let expected = m + expected * gained * (2.0 * o.prior_mean - m);
            assert!(
                (mean - expected).abs() <= bound * expected,
                "the mean is {mean}, that of one spring {expected}"
            );
        }
    }

    /// Time that passes widens the belief by exactly the given variance, or is refused.
    pub(super) fn diffusion(&self) {
        let o = &self.options;
        let readings = self.sequence(o.points);
        let mut estimator = (self.make)(self.prior());
        self.feed(&mut estimator, &readings);
        let before = estimator.belief().clone();
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            let result = estimator.diffuse(T::from_f64(bad));
            assert!(result.is_err(), "a step of variance {bad} was taken");
            same(estimator.belief(), &before, "a refused step");
        }
        let step = T::from_f64(0.3 * o.prior_sd.powi(2));
        match estimator.diffuse(step) {
            Err(CoreError::Unsupported { .. }) => {
                same(
                    estimator.belief(),
                    &before,
                    "an estimator of a constant field",
                );
                return;
            }
            Err(error) => panic!("a good step was refused as {error:?}, not as unsupported"),
            Ok(()) => {}
        }
        let after = estimator.belief().clone();
        for i in 0..o.points {
            assert!(
                after.mean()[i] == before.mean()[i],
                "the step moved mean {i}"
            );
            let expected = before.variance()[i].to_f64() + step.to_f64();
            let got = after.variance()[i].to_f64();
            assert!(
                (got - expected).abs() <= 4.0 * T::EPSILON.to_f64() * expected,
                "variance {i} is {got} after the step, expected {expected}"
            );
        }
        estimator.diffuse(T::ZERO).unwrap();
        same(estimator.belief(), &after, "a step of zero");
        self.feed(&mut estimator, &readings);
        estimator.reset(self.prior()).unwrap();
        self.feed(&mut estimator, &readings);
        let expected = self.afresh(&readings);
        same(estimator.belief(), &expected, "steps before a reset");
    }
}

/// A box forwards everything.
pub(super) fn boxed<T: Scalar, E: Estimator<Scalar = T>>(
    suite: &Suite<'_, T>,
    make: &dyn Fn(Belief<T>) -> E,
) {
    let o = &suite.options;
    let mut plain = make(suite.prior());
    let mut boxed = (suite.make)(suite.prior());
    let (mut a, mut b) = (Prediction::default(), Prediction::default());
    for (t, reading) in suite.sequence(o.points).iter().enumerate() {
        let obs = reading.observation(o.points).unwrap();
        plain.predict(&obs, &mut a).unwrap();
        boxed.predict(&obs, &mut b).unwrap();
        assert!(a == b, "step {t}: predictions {a:?} and {b:?}");
        let (a, b) = (plain.update(&obs).unwrap(), boxed.update(&obs).unwrap());
        assert!(a == b, "step {t}: reports {a:?} and {b:?}");
        assert_eq!(
            plain.whitened_residual(),
            boxed.whitened_residual(),
            "step {t}"
        );
        if t == o.steps / 3 {
            plain.begin_sequence();
            boxed.begin_sequence();
        }
        if t == o.steps / 2 {
            let step = T::from_f64(0.1 * o.prior_sd.powi(2));
            let (a, b) = (plain.diffuse(step), boxed.diffuse(step));
            assert_eq!(a.is_ok(), b.is_ok(), "step {t}: diffusion {a:?} and {b:?}");
        }
        same(boxed.belief(), plain.belief(), "in a box");
    }
    plain.reset(suite.prior()).unwrap();
    boxed.reset(suite.prior()).unwrap();
    same(boxed.belief(), plain.belief(), "reset in a box");
}

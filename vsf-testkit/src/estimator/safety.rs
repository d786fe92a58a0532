use super::suite::{Suite, same};
use vsf_core::{Belief, CoreError, Estimator, Prediction, Scalar};

impl<T: Scalar> Suite<'_, T> {
    pub(super) fn never_negative(&self) {
        let o = &self.options;
        let prior = Belief::uniform(o.points, 0.0, o.prior_sd).unwrap();
        let mut estimator = (self.make)(prior);
        for (t, mut reading) in self.sequence(o.points).into_iter().enumerate() {
            // Pulls as well as pushes: forces that no stiffness explains.
            reading.tau.iter_mut().for_each(|x| *x = -*x);
            let obs = reading.observation(o.points).unwrap();
            let report = estimator.update(&obs).unwrap();
            let belief = estimator.belief();
            let field = estimator.field().unwrap();
            assert_eq!(field.len(), belief.len(), "points of the field");
            for known in [belief, &field] {
                for i in 0..known.len() {
                    let (m, v) = (known.mean()[i], known.variance()[i]);
                    assert!(m.is_finite() && m >= T::ZERO, "mean {i} is {m} at step {t}");
                    assert!(
                        v.is_finite() && v > T::ZERO,
                        "variance {i} is {v} at step {t}"
                    );
                }
            }
            assert!(
                report.projected <= belief.len(),
                "{} of {} points projected",
                report.projected,
                belief.len()
            );
        }
    }

    pub(super) fn field(&self) {
        // Pushes, and pulls, which no stiffness explains.
        for sign in [1.0, -1.0] {
            let mut estimator = (self.make)(self.prior());
            let mut touched = vec![false; self.options.points];
            for (t, mut reading) in self.sequence(touched.len()).into_iter().enumerate() {
                reading.tau.iter_mut().for_each(|x| *x *= sign);
                let obs = reading.observation(touched.len()).unwrap();
                estimator.update(&obs).unwrap();
                (obs.points().iter()).for_each(|&p| touched[p as usize] = true);
                let (belief, field) = (estimator.belief(), estimator.field().unwrap());
                assert_eq!(field.variance(), belief.variance(), "variances at step {t}");
                for (i, _) in touched.iter().enumerate().filter(|(_, touched)| **touched) {
                    let (known, kept) = (belief.mean()[i], field.mean()[i]);
                    assert_eq!(kept, known, "mean {i}, touched, at step {t}");
                }
            }
        }
    }

    pub(super) fn errors(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        let readings = self.sequence(o.points);
        self.feed(&mut estimator, &readings);
        let before = estimator.belief().clone();
        let mut beyond = readings[o.steps - 1].clone();
        let last = beyond.points.len() - 1;
        beyond.points[last] = o.points as u32;
        let obs = beyond.observation(o.points + 1).unwrap();
        match estimator.update(&obs) {
            Err(CoreError::OutOfRange { index, .. }) if index == o.points => {}
            other => panic!("a point beyond the field gave {other:?}"),
        }
        same(estimator.belief(), &before, "point beyond the field");
        let predicted = estimator.predict(&obs, &mut Prediction::default());
        assert!(predicted.is_err(), "predicted a point beyond the field");

        self.feed(&mut estimator, &readings);
        let twice = [&readings[..], &readings].concat();
        let expected = self.run(self.prior(), &twice);
        same(estimator.belief(), &expected, "learning after an error");
    }

    pub(super) fn non_finite(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        let before = estimator.belief().clone();
        let good = self.sequence(o.points).swap_remove(1);
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut reading = good.clone();
            reading.tau[0] = bad;
            assert!(
                reading.observation::<T>(o.points).is_err(),
                "reading {bad} was taken"
            );
            let mut obs = good.observation::<T>(o.points).unwrap();
            let refused = obs.rebuild(o.points, &good.points, &good.tau, |_, w| w[0] = bad);
            assert!(refused.is_err(), "column entry {bad} was taken");
            // What is left behind must be harmless.
            estimator.update(&obs).unwrap();
            same(estimator.belief(), &before, "a refused observation");
        }
    }

    /// Numbers whose squares overflow. An estimator may cope with them, but not partially.
    pub(super) fn overflow(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        let readings = self.sequence(o.points);
        self.feed(&mut estimator, &readings);
        let finite = |x: &[T]| x.iter().all(|x| x.is_finite() && *x >= T::ZERO);
        for factor in [huge::<T>(), -huge::<T>()] {
            let mut reading = readings[1].clone();
            let columns = reading.columns.iter_mut().flatten();
            columns.for_each(|w| *w = factor);
            let obs = reading.observation(o.points).unwrap();
            let mut prediction = Prediction::default();
            assert!(
                estimator.predict(&obs, &mut prediction).is_err()
                    || prediction.check_finite().is_ok(),
                "columns of {factor:e} gave predictions that are not finite"
            );
            let before = estimator.belief().clone();
            if estimator.update(&obs).is_err() {
                same(estimator.belief(), &before, "columns that overflow");
            }
            let belief = estimator.belief();
            assert!(
                finite(belief.mean()) && finite(belief.variance()),
                "columns of {factor:e} left values that are not finite or negative"
            );
        }
        self.feed(&mut estimator, &readings);
        assert!(
            finite(estimator.belief().mean()) && finite(estimator.belief().variance()),
            "learning after an overflow left values that are not finite or negative"
        );

        let mut estimator = (self.make)(self.prior());
        for _ in 0..3 {
            let before = estimator.belief().clone();
            if estimator
                .diffuse(T::from_f64(0.9 * largest::<T>()))
                .is_err()
            {
                same(estimator.belief(), &before, "steps that overflow");
            }
            assert!(
                finite(estimator.belief().variance()),
                "large steps left variances that are not finite"
            );
        }
    }
}

fn single<T: Scalar>() -> bool {
    T::EPSILON.to_f64() > 1e-10
}

/// A number whose square overflows.
fn huge<T: Scalar>() -> f64 {
    if single::<T>() { 1e30 } else { 1e300 }
}

fn largest<T: Scalar>() -> f64 {
    if single::<T>() {
        f64::from(f32::MAX)
    } else {
        f64::MAX
    }
}

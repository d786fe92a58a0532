use crate::{LinearWorld, Reading};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use vsf_core::{Belief, CoreError, Estimator, Noise, Observation, Prediction, Scalar};

/// The problems that [`check_estimator`] poses, and what is asked beyond the common rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorOptions {
    /// Points of the field, at least 8; default 40.
    pub points: usize,
    /// Channels of a reading, at least 1; default 3.
    pub channels: usize,
    /// Observations of a sequence; default 12.
    pub steps: usize,
    /// Entries of W lie within `[-weight, weight]`; default 0.05.
    pub weight: f64,
    /// Standard deviation of the reading noise; default 0.1.
    pub noise_sd: f64,
    /// Prior mean; default 3, far above 0 in units of the prior sd.
    pub prior_mean: f64,
    /// Prior standard deviation; default 0.5.
    pub prior_sd: f64,
    /// Whether NIS and whitened residual come from the Gaussian model `S = W Sigma W^T + R`.
    /// Default true; false for estimators without a noise model.
    pub gaussian: bool,
    /// Whether the posterior does not depend on how an observation with independent channels is
    /// cut into single ones (estimators that are exact for linear Gaussian problems). Default
    /// false.
    pub exact: bool,
    /// Seed of all draws; default 1.
    pub seed: u64,
}

impl Default for EstimatorOptions {
    fn default() -> Self {
        Self {
            points: 40,
            channels: 3,
            steps: 12,
            weight: 0.05,
            noise_sd: 0.1,
            prior_mean: 3.0,
            prior_sd: 0.5,
            gaussian: true,
            exact: false,
            seed: 1,
        }
    }
}

/// Checks that an estimator keeps the promises of [`Estimator`]. `make` builds one from a prior;
/// two of them from the same prior must behave the same.
///
/// # Panics
/// With the name of the property that does not hold.
///
/// ```
/// use vsf_filter::DiagonalKalman;
/// use vsf_testkit::{EstimatorOptions, check_estimator};
/// check_estimator(DiagonalKalman::<f32>::new, EstimatorOptions::default());
/// ```
pub fn check_estimator<T: Scalar, E: Estimator<Scalar = T>>(
    make: impl Fn(Belief<T>) -> E,
    options: EstimatorOptions,
) {
    let suite = Suite {
        make: &make,
        options,
    };
    let all: [(&str, &dyn Fn()); 11] = [
        ("means are never negative", &|| suite.never_negative()),
        ("an error leaves the belief unchanged", &|| suite.errors()),
        ("relabelling points relabels the belief", &|| {
            suite.permutation();
        }),
        ("units do not matter", &|| suite.units()),
        ("reset starts over", &|| suite.reset()),
        ("an empty observation teaches nothing", &|| suite.empty()),
        ("untouched points keep their prior", &|| suite.untouched()),
        ("non-finite numbers cannot enter", &|| suite.non_finite()),
        ("reports and residuals agree", &|| suite.reports()),
        ("NIS of well-specified readings is consistent", &|| {
            if suite.options.gaussian {
                suite.nis();
            }
        }),
        ("readings can be taken in channel by channel", &|| {
            if suite.options.exact {
                suite.splitting();
            }
        }),
    ];
    for (property, check) in all {
        if let Err(cause) = catch_unwind(AssertUnwindSafe(check)) {
            eprintln!("estimator conformance ({}): {property}: FAILED", T::NAME);
            match cause.downcast_ref::<String>() {
                Some(text) => panic!("{} estimator: {property}: {text}", T::NAME),
                None => match cause.downcast_ref::<&str>() {
                    Some(text) => panic!("{} estimator: {property}: {text}", T::NAME),
                    None => resume_unwind(cause),
                },
            }
        }
    }
}

struct Suite<'a, T: Scalar, E> {
    make: &'a dyn Fn(Belief<T>) -> E,
    options: EstimatorOptions,
}

impl<T: Scalar, E: Estimator<Scalar = T>> Suite<'_, T, E> {
    /// A prior that differs from point to point, so that mixed-up points show.
    fn prior(&self) -> Belief<T> {
        let o = &self.options;
        let spread = |i: usize| 1.0 + 0.2 * ((i * 7 % 5) as f64 - 2.0) / 2.0;
        let mean = (0..o.points).map(|i| T::from_f64(o.prior_mean * spread(i)));
        let variance = (0..o.points).map(|i| T::from_f64((o.prior_sd * spread(i)).powi(2)));
        Belief::new(mean.collect(), variance.collect()).unwrap()
    }

    /// A sequence that touches the points below `limit`.
    fn sequence(&self, limit: usize) -> Vec<Reading> {
        let o = &self.options;
        let mut world = LinearWorld::new(o.points, o.prior_mean, o.prior_sd, o.seed);
        (0..o.steps)
            .map(|t| {
                let contacts = 1 + (t * 5) % (limit / 2);
                world.reading(limit, contacts, o.channels, o.weight, o.noise_sd)
            })
            .collect()
    }

    fn feed(&self, estimator: &mut E, readings: &[Reading]) {
        for (t, reading) in readings.iter().enumerate() {
            let obs = reading.observation(self.options.points).unwrap();
            if let Err(error) = estimator.update(&obs) {
                panic!("a good observation was refused at step {t}: {error}");
            }
        }
    }

    fn run(&self, prior: Belief<T>, readings: &[Reading]) -> Belief<T> {
        let mut estimator = (self.make)(prior);
        self.feed(&mut estimator, readings);
        estimator.belief().clone()
    }

    /// Tolerance of sums over a sequence, relative to the prior's scale.
    fn tolerance(&self) -> f64 {
        2e3 * T::EPSILON.to_f64()
    }

    fn close(&self, got: &Belief<T>, expected: &Belief<T>, scale: f64, what: &str) {
        let o = &self.options;
        let bound = self.tolerance() * scale;
        for i in 0..o.points {
            let (a, b) = (got.mean()[i].to_f64(), expected.mean()[i].to_f64());
            let allowed = bound * (o.prior_mean + o.prior_sd);
            assert!(
                (a - b).abs() <= allowed,
                "{what}: mean {i} is {a}, expected {b}"
            );
            let (a, b) = (got.variance()[i].to_f64(), expected.variance()[i].to_f64());
            let allowed = bound * scale * o.prior_sd.powi(2);
            assert!(
                (a - b).abs() <= allowed,
                "{what}: variance {i} is {a}, expected {b}"
            );
        }
    }

    fn never_negative(&self) {
        let o = &self.options;
        let prior = Belief::uniform(o.points, 0.0, o.prior_sd).unwrap();
        let mut estimator = (self.make)(prior);
        for (t, mut reading) in self.sequence(o.points).into_iter().enumerate() {
            // Pulls as well as pushes: forces that no stiffness explains.
            reading.tau.iter_mut().for_each(|x| *x = -*x);
            let obs = reading.observation(o.points).unwrap();
            let report = estimator.update(&obs).unwrap();
            let belief = estimator.belief();
            for i in 0..belief.len() {
                let (m, v) = (belief.mean()[i], belief.variance()[i]);
                assert!(m.is_finite() && m >= T::ZERO, "mean {i} is {m} at step {t}");
                assert!(
                    v.is_finite() && v > T::ZERO,
                    "variance {i} is {v} at step {t}"
                );
            }
            assert!(
                report.projected <= belief.len(),
                "{} of {} points projected",
                report.projected,
                belief.len()
            );
        }
    }

    fn errors(&self) {
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

        // Squares of these columns overflow; an estimator may cope, but not half.
        let huge = if T::EPSILON.to_f64() > 1e-10 {
            1e30
        } else {
            1e300
        };
        for factor in [huge, -huge] {
            let mut reading = readings[1].clone();
            reading
                .columns
                .iter_mut()
                .flatten()
                .for_each(|w| *w = factor);
            let before = estimator.belief().clone();
            if estimator
                .update(&reading.observation(o.points).unwrap())
                .is_err()
            {
                same(estimator.belief(), &before, "columns that overflow");
            }
            let belief = estimator.belief();
            let finite = |x: &[T]| x.iter().all(|x| x.is_finite() && *x >= T::ZERO);
            assert!(
                finite(belief.mean()) && finite(belief.variance()),
                "columns of {factor:e} left values that are not finite or negative"
            );
        }
        estimator.reset(self.prior()).unwrap();
        self.feed(&mut estimator, &readings);
        same(estimator.belief(), &before, "after errors and a reset");
    }

    fn permutation(&self) {
        let (n, prior) = (self.options.points, self.prior());
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by_key(|&i| (i * 17 % 31, i));
        let mut rank = vec![0; n];
        order.iter().enumerate().for_each(|(r, &i)| rank[i] = r);
        let relabel = |belief: &Belief<T>| {
            let pick = |x: &[T]| order.iter().map(|&i| x[i]).collect();
            Belief::new(pick(belief.mean()), pick(belief.variance())).unwrap()
        };
        let readings = self.sequence(n);
        let relabelled: Vec<Reading> = readings
            .iter()
            .map(|r| {
                let mut touched: Vec<(u32, Vec<f64>)> = r
                    .points
                    .iter()
                    .map(|&p| rank[p as usize] as u32)
                    .zip(r.columns.iter().cloned())
                    .collect();
                touched.sort_by_key(|(p, _)| *p);
                let (points, columns) = touched.into_iter().unzip();
                Reading {
                    points,
                    columns,
                    ..r.clone()
                }
            })
            .collect();
        let expected = relabel(&self.run(prior.clone(), &readings));
        self.close(
            &self.run(relabel(&prior), &relabelled),
            &expected,
            1.0,
            "relabelled",
        );
    }

    fn units(&self) {
        let o = &self.options;
        let (readings, prior) = (self.sequence(o.points), self.prior());
        let expected = self.run(prior.clone(), &readings);
        let c = 3.7;
        let scaled = |columns: f64, torque: f64| -> Vec<Reading> {
            let times = |x: &[f64], c: f64| x.iter().map(|v| v * c).collect::<Vec<_>>();
            let scale = |r: &Reading| Reading {
                points: r.points.clone(),
                columns: r.columns.iter().map(|w| times(w, columns)).collect(),
                tau: times(&r.tau, torque),
                noise_sd: times(&r.noise_sd, torque),
            };
            readings.iter().map(scale).collect()
        };
        // tau, W and the noise in another unit of torque: the same stiffness.
        let got = self.run(prior.clone(), &scaled(c, c));
        self.close(&got, &expected, 1.0, "unit of torque");
        // W in another unit of length: stiffness in its inverse.
        let stiffer = |b: &Belief<T>| {
            let times = |x: &[T], c: f64| x.iter().map(|v| T::from_f64(v.to_f64() * c)).collect();
            Belief::new(times(b.mean(), 1.0 / c), times(b.variance(), 1.0 / (c * c))).unwrap()
        };
        let got = self.run(stiffer(&prior), &scaled(c, 1.0));
        self.close(&got, &stiffer(&expected), 1.0, "unit of length");
    }

    fn reset(&self) {
        let readings = self.sequence(self.options.points);
        let mut estimator = (self.make)(self.prior());
        self.feed(&mut estimator, &readings);
        let first = estimator.belief().clone();
        same(
            &self.run(self.prior(), &readings),
            &first,
            "a second one of the same make",
        );
        estimator.begin_sequence();
        same(estimator.belief(), &first, "a new sequence");
        estimator.reset(self.prior()).unwrap();
        same(estimator.belief(), &self.prior(), "right after reset");
        assert!(
            estimator.whitened_residual().is_empty(),
            "a residual is left after reset"
        );
        self.feed(&mut estimator, &readings);
        same(estimator.belief(), &first, "the same run after reset");
    }

    fn empty(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        let mut obs = Observation::new(Noise::uniform(o.channels, o.noise_sd).unwrap());
        let tau: Vec<f64> = (0..o.channels)
            .map(|i| o.noise_sd * (1.0 + i as f64))
            .collect();
        obs.rebuild(o.points, &[], &tau, |_, _| {}).unwrap();
        let report = estimator.update(&obs).unwrap();
        same(estimator.belief(), &self.prior(), "without contacts");
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

    fn untouched(&self) {
        let o = &self.options;
        let (limit, prior) = (o.points / 2, self.prior());
        let mut estimator = (self.make)(prior.clone());
        self.feed(&mut estimator, &self.sequence(limit));
        let belief = estimator.belief();
        for i in limit..o.points {
            assert!(
                belief.mean()[i] == prior.mean()[i] && belief.variance()[i] == prior.variance()[i],
                "point {i} was never touched, but moved"
            );
        }
        let last = o.points - 1;
        let late = Reading {
            points: vec![last as u32],
            columns: vec![vec![o.weight; o.channels]],
            tau: vec![o.weight * 2.0 * o.prior_mean; o.channels],
            noise_sd: vec![o.noise_sd; o.channels],
        };
        self.feed(&mut estimator, &[late]);
        assert!(
            estimator.belief().mean()[last] > prior.mean()[last],
            "a point first touched late did not learn"
        );
    }

    fn non_finite(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
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
            same(estimator.belief(), &self.prior(), "a refused observation");
        }
    }

    fn reports(&self) {
        let o = &self.options;
        let mut estimator = (self.make)(self.prior());
        assert!(
            estimator.whitened_residual().is_empty(),
            "whitened residual before the first update"
        );
        let mut prediction = Prediction::default();
        for (t, reading) in self.sequence(o.points).iter().enumerate() {
            let obs = reading.observation::<T>(o.points).unwrap();
            estimator.predict(&obs, &mut prediction).unwrap();
            let residual = |mean: &[f64]| -> f64 {
                let pairs = mean.iter().zip(obs.reading());
                pairs
                    .map(|(m, t)| (t.to_f64() - m).powi(2))
                    .sum::<f64>()
                    .sqrt()
            };
            let marginal = |belief: &Belief<T>| -> Vec<f64> {
                let mean = |i| {
                    let row = obs.row(i).iter().zip(obs.points());
                    row.map(|(w, &p)| w.to_f64() * belief.mean()[p as usize].to_f64())
                        .sum()
                };
                (0..o.channels).map(mean).collect()
            };
            let scale = self.tolerance() * o.weight * o.points as f64 * (o.prior_mean + o.prior_sd);
            let expected = marginal(estimator.belief());
            for (i, (m, e)) in prediction.mean.iter().zip(&expected).enumerate() {
                assert!(
                    (m - e).abs() <= scale,
                    "step {t}: predicted {m} in channel {i}, not {e}"
                );
                assert!(
                    prediction.sd[i] >= o.noise_sd * (1.0 - 1e-6),
                    "step {t}: predicted sd {} below the noise",
                    prediction.sd[i]
                );
            }
            let report = estimator.update(&obs).unwrap();
            assert_eq!(report.contacts, obs.len(), "step {t}: contacts");
            assert_eq!(report.dof, o.channels, "step {t}: degrees of freedom");
            for (what, got, expected) in [
                ("prefit", report.prefit, residual(&expected)),
                (
                    "postfit",
                    report.postfit,
                    residual(&marginal(estimator.belief())),
                ),
            ] {
                assert!(
                    (got - expected).abs() <= scale,
                    "step {t}: {what} {got}, not {expected}"
                );
            }
            let whitened = estimator.whitened_residual();
            assert_eq!(
                whitened.len(),
                o.channels,
                "step {t}: length of whitened residual"
            );
            let squared: f64 = whitened.iter().map(|x| x * x).sum();
            assert!(
                (squared - report.nis).abs() <= 1e-9 * (1.0 + report.nis),
                "step {t}: squared whitened residual {squared}, NIS {}",
                report.nis
            );
            assert!(
                report.log_likelihood.is_finite(),
                "step {t}: log-likelihood"
            );
        }
    }

    /// Mean NIS of independent first readings, within five standard deviations of its law.
    fn nis(&self) {
        let o = &self.options;
        let (trials, mut total) = (400u64, 0.0);
        let prior = Belief::uniform(o.points, 10.0 * o.prior_sd, o.prior_sd).unwrap();
        let mut estimator = (self.make)(prior.clone());
        for trial in 0..trials {
            let seed = o.seed.wrapping_add(1000 + trial);
            let mut world = LinearWorld::new(o.points, 10.0 * o.prior_sd, o.prior_sd, seed);
            let reading = world.reading(o.points, o.points / 2, o.channels, o.weight, o.noise_sd);
            estimator.reset(prior.clone()).unwrap();
            let obs = reading.observation(o.points).unwrap();
            total += estimator.update(&obs).unwrap().nis;
        }
        let dof = trials as f64 * o.channels as f64;
        let bound = 5.0 * (2.0 * dof).sqrt();
        assert!(
            (total - dof).abs() <= bound,
            "sum of NIS over {trials} readings is {total}, expected {dof} +- {bound}"
        );
    }

    fn splitting(&self) {
        let readings = self.sequence(self.options.points);
        let single = |r: &Reading, i: usize| Reading {
            points: r.points.clone(),
            columns: r.columns.iter().map(|w| vec![w[i]]).collect(),
            tau: vec![r.tau[i]],
            noise_sd: vec![r.noise_sd[i]],
        };
        let split: Vec<Reading> = readings
            .iter()
            .flat_map(|r| (0..self.options.channels).map(move |i| single(r, i)))
            .collect();
        let expected = self.run(self.prior(), &readings);
        self.close(
            &self.run(self.prior(), &split),
            &expected,
            10.0,
            "channel by channel",
        );
    }
}

/// Equal bit for bit.
fn same<T: Scalar>(got: &Belief<T>, expected: &Belief<T>, what: &str) {
    let bits = |x: &[T]| x.iter().map(|v| v.to_f64().to_bits()).collect::<Vec<_>>();
    let (g, e) = (bits(got.mean()), bits(expected.mean()));
    if let Some(i) = (0..e.len()).find(|&i| g.get(i) != e.get(i)) {
        panic!("{what}: mean {i} is not the same bit for bit");
    }
    let (g, e) = (bits(got.variance()), bits(expected.variance()));
    if let Some(i) = (0..e.len()).find(|&i| g.get(i) != e.get(i)) {
        panic!("{what}: variance {i} is not the same bit for bit");
    }
}

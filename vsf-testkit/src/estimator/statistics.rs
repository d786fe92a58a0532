use super::suite::Suite;
use crate::{LinearWorld, normal};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use vsf_core::{Belief, Estimator, Prediction, Scalar, SymmetricFactor};

impl<T: Scalar> Suite<'_, T> {
    pub(super) fn reports(&self) {
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
            // Where points are correlated, those that are touched for the first time are known better than by
            // their marginals.
            let expected = if o.local {
                marginal(estimator.belief())
            } else {
                prediction.mean.clone()
            };
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

    /// For independent points, the first innovation is known: `S = W diag(v) W^T + R`.
    pub(super) fn first_innovation(&self) {
        let (o, prior) = (&self.options, self.prior());
        let (d, r) = (o.channels, o.noise_sd.powi(2));
        let reading = &self.sequence(o.points)[1];
        let mut s = vec![0.0; d * d];
        let mut residual = reading.tau.clone();
        for (w, &p) in reading.columns.iter().zip(&reading.points) {
            let (m, v) = (prior.mean()[p as usize], prior.variance()[p as usize]);
            for i in 0..d {
                residual[i] -= w[i] * m.to_f64();
                for j in 0..d {
                    s[i * d + j] += w[i] * v.to_f64() * w[j];
                }
            }
        }
        (0..d).for_each(|i| s[i * d + i] += r);
        let mut factor = SymmetricFactor::default();
        factor.factor("S", d, &s).unwrap();
        let mut whitened = residual;
        factor.solve_lower(&mut whitened);
        let nis: f64 = whitened.iter().map(|x| x * x).sum();
        let log_likelihood =
            -0.5 * (nis + factor.log_det() + d as f64 * std::f64::consts::TAU.ln());

        let mut estimator = (self.make)(prior);
        let obs = reading.observation(o.points).unwrap();
        let mut prediction = Prediction::default();
        estimator.predict(&obs, &mut prediction).unwrap();
        let report = estimator.update(&obs).unwrap();
        let check = |what: &str, got: f64, expected: f64| {
            let bound = self.tolerance() * (1.0 + expected.abs());
            assert!(
                (got - expected).abs() <= bound,
                "{what} is {got}, expected {expected}"
            );
        };
        for i in 0..d {
            check("predicted sd", prediction.sd[i], s[i * d + i].sqrt());
        }
        check("NIS", report.nis, nis);
        check("log-likelihood", report.log_likelihood, log_likelihood);
        let (got, expected) = (estimator.whitened_residual(), &whitened);
        for (got, expected) in got.iter().zip(expected) {
            check("whitened residual", *got, *expected);
        }
    }

    /// Mean NIS of independent first readings is within five standard deviations of its law.
    pub(super) fn nis(&self) {
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

    /// Mean NIS per degree of freedom, and the degrees of freedom, of sequences of strong readings.
    ///
    /// The fields are drawn from the prior and take a step of variance `drift` before each reading. `None` if the estimator
    /// cannot follow.
    fn nis_ratio(&self, drift: f64) -> Option<(f64, f64)> {
        let o = &self.options;
        let (mean, worlds) = (20.0 * o.prior_sd, 100);
        let (mut total, mut dof) = (0.0, 0.0);
        for world in 0..worlds {
            let seed = o.seed.wrapping_add(5000 + world);
            let mut rng = Pcg64Mcg::seed_from_u64(!seed);
            let mut world = LinearWorld::new(o.points, mean, o.prior_sd, seed);
            let mut estimator = (self.make)(Belief::uniform(o.points, mean, o.prior_sd).unwrap());
            for t in 0..4 * o.steps {
                if drift > 0.0 {
                    estimator.diffuse(T::from_f64(drift)).ok()?;
                    let field = &mut world.stiffness;
                    field
                        .iter_mut()
                        .for_each(|k| *k += drift.sqrt() * normal(&mut rng));
                }
                let contacts = 1 + (t * 5) % (o.points / 2);
                let weight = 4.0 * o.weight;
                let reading = world.reading(o.points, contacts, o.channels, weight, o.noise_sd);
                let obs = reading.observation(o.points).unwrap();
                total += estimator.update(&obs).unwrap().nis;
                dof += o.channels as f64;
            }
        }
        Some((total / dof, dof))
    }

    /// Mean NIS of sequences: within five standard deviations of the chi-squared law for exact estimators, within their
    /// stated interval for others.
    pub(super) fn consistency(&self) {
        let o = &self.options;
        if !o.exact && o.nis_ratio.is_none() {
            return;
        }
        for drift in [0.0, 0.2 * o.prior_sd.powi(2)] {
            let Some((ratio, dof)) = self.nis_ratio(drift) else {
                continue;
            };
            let spread = 5.0 * (2.0 / dof).sqrt();
            let chi_squared = (1.0 - spread, 1.0 + spread);
            let stated = o.nis_ratio.filter(|_| !o.exact);
            let (low, high) = stated.unwrap_or(chi_squared);
            assert!(
                low <= ratio && ratio <= high,
                "the NIS ratio of sequences is {ratio:.3}, not in [{low:.3}, {high:.3}], for steps \
                 of variance {drift}"
            );
        }
    }
}

//! Every estimator keeps the promises of `vsf_core::Estimator`; one of them is defined here, as a
//! user of the library would.

use vsf_core::{Belief, CoreError, Estimator, Observation, Scalar, UpdateReport};
use vsf_filter::{
    DiagonalForm, DiagonalKalman, DualConfig, DualReplay, MemoryReplay, ReplayConfig,
    ReplayVariance, RobustLoss, RobustNoise,
};
use vsf_testkit::{EstimatorOptions, check_estimator};

const FORMS: [DiagonalForm; 3] = [
    DiagonalForm::Innovation,
    DiagonalForm::InnovationUpdated,
    DiagonalForm::Printed,
];

fn diagonal<T: Scalar>() {
    for form in FORMS {
        for (channels, seed) in [(1, 1), (3, 2), (7, 3)] {
            let options = EstimatorOptions {
                channels,
                seed,
                nis_ratio: nis_ratio(form, ReplayVariance::Keep),
                ..EstimatorOptions::default()
            };
            check_estimator(
                |prior: Belief<T>| DiagonalKalman::with_form(prior, form),
                options,
            );
        }
    }
}

/// What is promised beyond the default: nothing by the form that may diverge, and overconfidence
/// where variances shrink at every replay.
fn nis_ratio(form: DiagonalForm, variance: ReplayVariance) -> Option<(f64, f64)> {
    match (form, variance) {
        (DiagonalForm::Printed, _) => None,
        (_, ReplayVariance::Shrink) => Some((1.2, 2.6)),
        _ => EstimatorOptions::default().nis_ratio,
    }
}

/// With room for all observations, and for few.
fn replay<T: Scalar>() {
    let budgets = [ReplayConfig::default().byte_budget, 5000];
    for (form, byte_budget) in FORMS.into_iter().flat_map(|f| budgets.map(|b| (f, b))) {
        for variance in [ReplayVariance::Keep, ReplayVariance::Shrink] {
            let config = ReplayConfig {
                variance,
                byte_budget,
                ..ReplayConfig::default()
            };
            let make = |prior: Belief<T>| {
                MemoryReplay::new(DiagonalKalman::with_form(prior, form), config).unwrap()
            };
            let options = EstimatorOptions {
                nis_ratio: nis_ratio(form, variance),
                ..EstimatorOptions::default()
            };
            check_estimator(make, options);
        }
    }
}

/// With room for all observations, and for few.
fn dual<T: Scalar>() {
    for byte_budget in [DualConfig::default().byte_budget, 5000, 1] {
        let config = DualConfig {
            byte_budget,
            ..DualConfig::default()
        };
        for (channels, seed) in [(1, 1), (3, 2), (7, 3)] {
            let options = EstimatorOptions {
                channels,
                seed,
                ..EstimatorOptions::default()
            };
            check_estimator(
                |prior: Belief<T>| DualReplay::new(prior, config).unwrap(),
                options,
            );
        }
    }
}

#[test]
fn dual_f32() {
    dual::<f32>();
}

#[test]
fn dual_f64() {
    dual::<f64>();
}

/// With inflated noise, innovations are not those of the Gaussian model, and smaller.
fn robust<T: Scalar>() {
    for loss in [RobustLoss::HUBER, RobustLoss::STUDENT_T] {
        let options = EstimatorOptions {
            gaussian: false,
            nis_ratio: Some((0.7, 1.2)),
            ..EstimatorOptions::default()
        };
        let config = ReplayConfig::default();
        let plain = |prior: Belief<T>| DiagonalKalman::new(prior);
        let robust = |prior| RobustNoise::new(plain(prior), loss).unwrap();
        check_estimator(robust, options);
        check_estimator(
            |prior| MemoryReplay::new(robust(prior), config).unwrap(),
            options,
        );
        let outside = |prior| {
            let replay = MemoryReplay::new(plain(prior), config).unwrap();
            RobustNoise::new(replay, loss).unwrap()
        };
        check_estimator(outside, options);
    }
}

#[test]
fn robust_f32() {
    robust::<f32>();
}

#[test]
fn robust_f64() {
    robust::<f64>();
}

#[test]
fn diagonal_f32() {
    diagonal::<f32>();
}

#[test]
fn diagonal_f64() {
    diagonal::<f64>();
}

#[test]
fn replay_f32() {
    replay::<f32>();
}

#[test]
fn replay_f64() {
    replay::<f64>();
}

/// Normalized least mean squares with one channel after the other: no noise model, variances
/// stay.
#[derive(Clone)]
struct Nlms<T: Scalar> {
    belief: Belief<T>,
    next: Vec<T>,
    whitened: Vec<f64>,
}

impl<T: Scalar> Nlms<T> {
    fn new(prior: Belief<T>) -> Self {
        Self {
            next: prior.mean().to_vec(),
            belief: prior,
            whitened: Vec::new(),
        }
    }
}

impl<T: Scalar> Estimator for Nlms<T> {
    type Scalar = T;

    fn belief(&self) -> &Belief<T> {
        &self.belief
    }

    fn reset(&mut self, prior: Belief<T>) -> Result<(), CoreError> {
        *self = Self::new(prior);
        Ok(())
    }

    fn update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        obs.check_fits(self.belief.len())?;
        let d = obs.dim();
        let mut fit = vec![T::ZERO; d];
        let norm = |fit: &[T]| -> f64 {
            let pairs = fit.iter().zip(obs.reading());
            pairs
                .map(|(f, t)| (t.to_f64() - f.to_f64()).powi(2))
                .sum::<f64>()
                .sqrt()
        };
        obs.apply(self.belief.mean(), &mut fit);
        let prefit = norm(&fit);
        let whitened: Vec<f64> = (0..d)
            .map(|i| (obs.reading()[i].to_f64() - fit[i].to_f64()) / obs.noise().sd(i))
            .collect();
        self.next.copy_from_slice(self.belief.mean());
        for i in 0..d {
            let row = || obs.row(i).iter().zip(obs.points());
            let power: T = row().map(|(&w, _)| w * w).sum();
            let fit: T = row().map(|(&w, &p)| w * self.next[p as usize]).sum();
            if power > T::ZERO {
                let step = T::from_f64(0.5) * (obs.reading()[i] - fit) / power;
                row().for_each(|(&w, &p)| self.next[p as usize] += step * w);
            }
        }
        if !self.next.iter().all(|x| x.is_finite()) {
            return Err(CoreError::Overflow { what: "mean" });
        }
        let mut projected = 0;
        for x in &mut self.next {
            projected += usize::from(*x < T::ZERO);
            *x = x.max(T::ZERO);
        }
        self.belief.parts_mut().0.copy_from_slice(&self.next);
        obs.apply(self.belief.mean(), &mut fit);
        self.whitened = whitened;
        Ok(UpdateReport {
            contacts: obs.len(),
            dof: d,
            nis: self.whitened.iter().map(|x| x * x).sum(),
            prefit,
            postfit: norm(&fit),
            projected,
            ..UpdateReport::default()
        })
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.whitened
    }
}

#[test]
fn an_estimator_from_outside() {
    let options = EstimatorOptions {
        gaussian: false,
        nis_ratio: None,
        ..EstimatorOptions::default()
    };
    check_estimator(Nlms::<f32>::new, options);
    check_estimator(Nlms::<f64>::new, options);
}

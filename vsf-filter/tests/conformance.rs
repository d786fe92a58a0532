//! Every estimator keeps the promises of `vsf_core::Estimator`; one of them is defined here, as a
//! user of the library would.

#![allow(clippy::unwrap_used)]

use vsf_core::{Belief, CoreError, Estimator, Observation, Scalar, UpdateReport};
use vsf_filter::{DiagonalForm, DiagonalKalman, MemoryReplay, ReplayConfig, ReplayVariance};
use vsf_testkit::{EstimatorOptions, check_estimator};

const FORMS: [DiagonalForm; 3] = [
    DiagonalForm::Innovation,
    DiagonalForm::InnovationUpdated,
    DiagonalForm::Printed,
];

fn check_both<T: Scalar, E: Estimator<Scalar = T> + 'static>(
    make: impl Fn(Belief<T>) -> E,
    options: EstimatorOptions,
) {
    check_estimator(&make, options);
    let boxed = |prior| Box::new(make(prior)) as Box<dyn Estimator<Scalar = T>>;
    check_estimator(boxed, options);
}

fn diagonal<T: Scalar>() {
    for form in FORMS {
        for (channels, seed) in [(1, 1), (3, 2), (7, 3)] {
            let options = EstimatorOptions {
                channels,
                seed,
                ..EstimatorOptions::default()
            };
            check_both(
                |prior: Belief<T>| DiagonalKalman::with_form(prior, form),
                options,
            );
        }
    }
}

fn replay<T: Scalar>() {
    for form in FORMS {
        for variance in [ReplayVariance::Keep, ReplayVariance::Shrink] {
            let config = ReplayConfig {
                variance,
                ..ReplayConfig::default()
            };
            let make = |prior: Belief<T>| {
                MemoryReplay::new(DiagonalKalman::with_form(prior, form), config).unwrap()
            };
            check_both(make, EstimatorOptions::default());
        }
    }
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

/// Normalised least mean squares with one channel after the other: no noise model, variances
/// stay.
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
        ..EstimatorOptions::default()
    };
    check_both(Nlms::<f32>::new, options);
    check_both(Nlms::<f64>::new, options);
}

/// The suite itself must find faults.
#[test]
fn a_broken_estimator_is_caught() {
    struct Leaky(DiagonalKalman<f64>);
    impl Estimator for Leaky {
        type Scalar = f64;
        fn belief(&self) -> &Belief<f64> {
            self.0.belief()
        }
        // Keeps what it learned.
        fn reset(&mut self, _: Belief<f64>) -> Result<(), CoreError> {
            Ok(())
        }
        fn update(&mut self, obs: &Observation<f64>) -> Result<UpdateReport, CoreError> {
            self.0.update(obs)
        }
        fn whitened_residual(&self) -> &[f64] {
            self.0.whitened_residual()
        }
    }
    let run = || {
        let make = |prior| Leaky(DiagonalKalman::new(prior));
        check_estimator(make, EstimatorOptions::default());
    };
    let cause = std::panic::catch_unwind(run).unwrap_err();
    let text = cause.downcast_ref::<String>().unwrap();
    assert!(
        text.contains("leaves the belief unchanged") || text.contains("reset"),
        "{text}"
    );
}

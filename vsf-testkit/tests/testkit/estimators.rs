//! The conformance suite passes an exact filter, and finds each of its faults by name.

use std::panic::catch_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_core::{
    Belief, CoreError, Estimator, Observation, Prediction, Scalar, SymmetricFactor, UpdateReport,
};
use vsf_testkit::{EstimatorOptions, check_estimator};

/// What can be wrong with an estimator, one thing at a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    AllowsNegative,
    ChangesBeliefOnError,
    AcceptsForeignPoints,
    LetsInfinityIn,
    PredictsInfinity,
    TreatsOnePointApart,
    ForgetsNoise,
    ClampsStiffness,
    ResetsHalf,
    DiffersFromItsLike,
    BeginsAfresh,
    LearnsFromNothing,
    ForgetsUntouched,
    LearnsWithWhatItTouchedFirst,
    WidensWrongly,
    MovesMeansWithTime,
    RefusesButWidens,
    TakesNegativeSteps,
    MisstatesPrefit,
    MisstatesResidual,
    PredictsWithoutField,
    MisstatesLikelihood,
    WhitensByNoiseAlone,
    DistrustsEverySecond,
    SharesNoiseAmongChannels,
    CountsTwice,
    KeepsAPartOfTheField,
    KeepsOtherMeans,
    KeepsPullsApart,
    KeepsOtherVariances,
}

static MADE: AtomicUsize = AtomicUsize::new(0);

/// The full Kalman filter (eq. 5) with a fault.
#[derive(Clone)]
struct Dense<T: Scalar> {
    fault: Fault,
    belief: Belief<T>,
    mean: Vec<f64>,
    covariance: Vec<f64>,
    whitened: Vec<f64>,
    updates: usize,
    first: Vec<u32>,
    number: usize,
}

impl<T: Scalar> Dense<T> {
    fn new(prior: Belief<T>, fault: Fault) -> Self {
        let n = prior.len();
        let mut covariance = vec![0.0; n * n];
        for (i, v) in prior.variance().iter().enumerate() {
            covariance[i * n + i] = v.to_f64();
        }
        Self {
            fault,
            mean: prior.mean().iter().map(|m| m.to_f64()).collect(),
            belief: prior,
            covariance,
            whitened: Vec::new(),
            updates: 0,
            first: Vec::new(),
            number: MADE.fetch_add(1, Ordering::Relaxed),
        }
    }

    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }

    /// `P W^T`, one row of `d` per point of the field, and `S` without noise.
    fn project(&self, obs: &Observation<T>) -> (Vec<f64>, Vec<f64>) {
        let (n, d) = (self.mean.len(), obs.dim());
        let (mut gain, mut s) = (vec![0.0; n * d], vec![0.0; d * d]);
        for i in 0..d {
            for (w, &p) in obs.row(i).iter().zip(obs.points()) {
                let column = &self.covariance[p as usize * n..][..n];
                for (k, c) in column.iter().enumerate() {
                    gain[k * d + i] += w.to_f64() * c;
                }
            }
        }
        for i in 0..d {
            for (w, &p) in obs.row(i).iter().zip(obs.points()) {
                for j in 0..d {
                    s[i * d + j] += w.to_f64() * gain[p as usize * d + j];
                }
            }
        }
        (gain, s)
    }

    fn residual(&self, obs: &Observation<T>) -> Vec<f64> {
        let predicted = |i| {
            let row = obs.row(i).iter().zip(obs.points());
            row.map(|(w, &p)| w.to_f64() * self.mean[p as usize])
                .sum::<f64>()
        };
        (0..obs.dim())
            .map(|i| obs.reading()[i].to_f64() - predicted(i))
            .collect()
    }

    /// Mean and covariance as the belief; an error when they do not fit into it.
    fn publish(&mut self) -> Result<(), CoreError> {
        let n = self.mean.len();
        let mean: Vec<T> = self.mean.iter().map(|m| T::from_f64(*m)).collect();
        let variance: Vec<T> = (0..n)
            .map(|i| T::from_f64(self.covariance[i * n + i]))
            .collect();
        match Belief::new(mean.clone(), variance.clone()) {
            Ok(belief) => self.belief = belief,
            Err(_) if self.is(Fault::AllowsNegative) || self.is(Fault::LetsInfinityIn) => {
                let (m, v) = self.belief.parts_mut();
                m.copy_from_slice(&mean);
                v.copy_from_slice(&variance);
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }

    fn try_update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        let (n, d) = (self.mean.len(), obs.dim());
        if self.is(Fault::LetsInfinityIn) && obs.rows().iter().any(|w| w.to_f64() > 1e20) {
            self.mean.fill(f64::INFINITY);
        }
        let (mut gain, mut s) = self.project(obs);
        let residual = self.residual(obs);
        let mut noise = obs.noise().covariance().to_vec();
        if self.is(Fault::ForgetsNoise) {
            noise = (0..d * d)
                .map(|k| if k % (d + 1) == 0 { 0.01 } else { 0.0 })
                .collect();
        }
        s.iter_mut().zip(&noise).for_each(|(s, r)| *s += r);
        let mut factor = SymmetricFactor::default();
        if let Err(error) = factor.factor("S", d, &s) {
            self.publish()?;
            return Err(error);
        }
        let log_det = factor.log_det();
        if self.is(Fault::WhitensByNoiseAlone) {
            factor.factor("S", d, &noise)?;
        }
        let mut whitened = residual.clone();
        factor.solve_lower(&mut whitened);
        let nis: f64 = whitened.iter().map(|x| x * x).sum();

        // The noise that the correction believes in.
        let mut more = 0.0;
        if self.is(Fault::DistrustsEverySecond) {
            more = (self.updates % 2) as f64;
        }
        if self.is(Fault::SharesNoiseAmongChannels) && obs.len() > 1 {
            more = d as f64 - 1.0;
        }
        if self.is(Fault::CountsTwice) && obs.len() > 1 {
            more = -0.5;
        }
        for i in 0..d {
            s[i * d + i] += more * noise[i * d + i];
        }
        if self.is(Fault::LearnsWithWhatItTouchedFirst) {
            if self.first.is_empty() {
                self.first = obs.points().to_vec();
            }
            let known = |k: &usize| self.updates < 8 || self.first.contains(&(*k as u32));
            for k in (0..n).filter(|k| !known(k)) {
                gain[k * d..(k + 1) * d].fill(0.0);
            }
        }
        factor.factor("S", d, &s)?;
        let mut white = residual.clone();
        factor.solve_lower(&mut white);
        for row in gain.chunks_mut(d) {
            factor.solve_lower(row);
        }
        for k in 0..n {
            self.mean[k] += (0..d).map(|i| gain[k * d + i] * white[i]).sum::<f64>();
            for l in 0..n {
                let lost: f64 = (0..d).map(|i| gain[k * d + i] * gain[l * d + i]).sum();
                self.covariance[k * n + l] -= lost;
            }
        }
        if self.is(Fault::TreatsOnePointApart) && obs.points().first() == Some(&0) {
            self.mean[0] *= 1.01;
        }
        if self.is(Fault::ClampsStiffness) {
            self.mean.iter_mut().for_each(|m| *m = m.min(4.0));
        }
        if self.is(Fault::DiffersFromItsLike) {
            self.mean[0] += 1e-6 * self.number as f64;
        }
        if self.is(Fault::LearnsFromNothing) {
            self.mean.iter_mut().for_each(|m| *m *= 1.001);
        }
        if self.is(Fault::ForgetsUntouched) {
            (0..n).for_each(|k| self.covariance[k * n + k] *= 1.0 + 1e-6 * obs.len() as f64);
        }
        let mut projected = 0;
        if !self.is(Fault::AllowsNegative) {
            for m in self.mean.iter_mut().filter(|m| **m < 0.0) {
                *m = 0.0;
                projected += 1;
            }
        }
        self.publish()?;
        self.updates += 1;
        let norm = |r: &[f64]| r.iter().map(|x| x * x).sum::<f64>().sqrt();
        if self.is(Fault::MisstatesResidual) {
            whitened[0] *= 2.0;
        }
        self.whitened = whitened;
        let mut log_likelihood = -0.5 * (nis + log_det + d as f64 * std::f64::consts::TAU.ln());
        if self.is(Fault::MisstatesLikelihood) {
            log_likelihood += 0.5 * log_det;
        }
        let scale = if self.is(Fault::MisstatesPrefit) {
            2.0
        } else {
            1.0
        };
        Ok(UpdateReport {
            contacts: obs.len(),
            dof: d,
            nis,
            log_likelihood,
            prefit: scale * norm(&residual),
            postfit: norm(&self.residual(obs)),
            projected,
        })
    }
}

impl<T: Scalar> Estimator for Dense<T> {
    type Scalar = T;

    fn belief(&self) -> &Belief<T> {
        &self.belief
    }

    fn field(&self) -> Result<Belief<T>, CoreError> {
        let (mut mean, mut variance) =
            (self.belief.mean().to_vec(), self.belief.variance().to_vec());
        match self.fault {
            Fault::KeepsAPartOfTheField => {
                mean.pop();
                variance.pop();
            }
            Fault::KeepsOtherMeans => mean.iter_mut().for_each(|m| *m *= T::from_f64(1.01)),
            // The means that were not projected.
            Fault::KeepsPullsApart => {
                let points = mean.iter_mut().filter(|m| **m == T::ZERO);
                points.for_each(|m| *m = T::from_f64(1e-3));
            }
            Fault::KeepsOtherVariances => {
                variance.iter_mut().for_each(|v| *v *= T::from_f64(2.0));
            }
            _ => {}
        }
        Belief::new(mean, variance)
    }

    fn reset(&mut self, prior: Belief<T>) -> Result<(), CoreError> {
        let old = std::mem::replace(self, Self::new(prior, self.fault));
        self.number = old.number;
        if self.is(Fault::ResetsHalf) {
            self.covariance = old.covariance;
        }
        Ok(())
    }

    fn begin_sequence(&mut self) {
        if self.is(Fault::BeginsAfresh) {
            self.mean.fill(1.0);
            let _ = self.publish();
        }
    }

    fn update(&mut self, obs: &Observation<T>) -> Result<UpdateReport, CoreError> {
        if let Err(error) = obs.check_fits(self.belief.len()) {
            if self.is(Fault::ChangesBeliefOnError) {
                self.belief.parts_mut().0[0] += T::ONE;
            }
            if self.is(Fault::AcceptsForeignPoints) {
                return Ok(UpdateReport::default());
            }
            return Err(error);
        }
        let before = self.clone();
        let result = self.try_update(obs);
        if result.is_err() && !self.is(Fault::LetsInfinityIn) {
            *self = before;
        }
        result
    }

    fn diffuse(&mut self, variance: T) -> Result<(), CoreError> {
        let mut wider = self.belief.clone();
        let step = if self.is(Fault::TakesNegativeSteps) && variance < T::ZERO {
            T::from_f64(1e-6)
        } else {
            variance
        };
        wider.diffuse(step)?;
        let refuses = self.is(Fault::RefusesButWidens);
        let step = match self.fault {
            Fault::WidensWrongly => 1.5 * step.to_f64(),
            _ => step.to_f64(),
        };
        let n = self.mean.len();
        let before = self.clone();
        (0..n).for_each(|k| self.covariance[k * n + k] += step);
        if self.is(Fault::MovesMeansWithTime) && step > 0.0 {
            self.mean.iter_mut().for_each(|m| *m *= 0.99);
        }
        if let Err(error) = self.publish() {
            *self = before;
            return Err(error);
        }
        if refuses {
            return Err(CoreError::Unsupported {
                what: "time",
                by: "this",
            });
        }
        Ok(())
    }

    fn whitened_residual(&self) -> &[f64] {
        &self.whitened
    }

    fn predict(&self, obs: &Observation<T>, out: &mut Prediction) -> Result<(), CoreError> {
        obs.check_fits(self.belief.len())?;
        let d = obs.dim();
        let (_, s) = self.project(obs);
        let residual = self.residual(obs);
        out.mean.clear();
        out.sd.clear();
        for i in 0..d {
            out.mean.push(obs.reading()[i].to_f64() - residual[i]);
            let field = if self.is(Fault::PredictsWithoutField) {
                0.0
            } else {
                s[i * d + i]
            };
            out.sd.push((field + obs.noise().sd(i).powi(2)).sqrt());
        }
        if self.is(Fault::PredictsInfinity) {
            let overflows = |sd: &mut f64| *sd = T::from_f64(*sd * *sd).to_f64().sqrt();
            out.sd.iter_mut().for_each(overflows);
            return Ok(());
        }
        out.check_finite()
    }
}

fn check<T: Scalar>(fault: Fault) {
    let options = EstimatorOptions {
        exact: true,
        ..EstimatorOptions::default()
    };
    check_estimator(|prior: Belief<T>| Dense::new(prior, fault), options);
}

#[test]
fn the_exact_filter_passes() {
    check::<f32>(Fault::None);
    check::<f64>(Fault::None);
}

#[test]
fn every_fault_is_found_by_name() {
    for (fault, property) in [
        (Fault::AllowsNegative, "means are never negative"),
        (
            Fault::ChangesBeliefOnError,
            "an error leaves the belief unchanged",
        ),
        (
            Fault::AcceptsForeignPoints,
            "an error leaves the belief unchanged",
        ),
        (Fault::LetsInfinityIn, "overflow does no harm"),
        (Fault::PredictsInfinity, "overflow does no harm"),
        (Fault::TreatsOnePointApart, "relabeling points"),
        (Fault::ForgetsNoise, "the unit of torque"),
        (Fault::ClampsStiffness, "the unit of stiffness"),
        (Fault::ResetsHalf, "reset starts over"),
        (Fault::DiffersFromItsLike, "two of a kind"),
        (Fault::BeginsAfresh, "reset starts over"),
        (Fault::LearnsFromNothing, "an empty observation"),
        (Fault::ForgetsUntouched, "untouched points"),
        (Fault::LearnsWithWhatItTouchedFirst, "first touched late"),
        (Fault::WidensWrongly, "time widens"),
        (Fault::MovesMeansWithTime, "time widens"),
        (Fault::RefusesButWidens, "time widens"),
        (Fault::TakesNegativeSteps, "time widens"),
        (Fault::MisstatesPrefit, "reports and residuals"),
        (Fault::MisstatesResidual, "reports and residuals"),
        (Fault::PredictsWithoutField, "the first innovation"),
        (Fault::MisstatesLikelihood, "the first innovation"),
        (Fault::WhitensByNoiseAlone, "the first innovation"),
        (Fault::DistrustsEverySecond, "the order of observations"),
        (Fault::SharesNoiseAmongChannels, "channel by channel"),
        (Fault::CountsTwice, "NIS of sequences"),
        (Fault::KeepsAPartOfTheField, "points of the field"),
        (Fault::KeepsOtherMeans, "the field knows"),
        (Fault::KeepsPullsApart, "the field knows"),
        (Fault::KeepsOtherVariances, "the field knows"),
    ] {
        for check in [check::<f32>, check::<f64>] {
            let cause = catch_unwind(|| check(fault)).expect_err("nothing was found");
            let text = cause.downcast_ref::<String>().unwrap();
            assert!(text.contains(property), "{fault:?} was found as: {text}");
        }
    }
}

#[test]
fn options_that_cannot_be_are_named() {
    let good = EstimatorOptions::default();
    for (options, name) in [
        (EstimatorOptions { points: 7, ..good }, "option points"),
        (
            EstimatorOptions {
                channels: 0,
                ..good
            },
            "option channels",
        ),
        (EstimatorOptions { steps: 1, ..good }, "option steps"),
        (
            EstimatorOptions {
                weight: f64::NAN,
                ..good
            },
            "option weight",
        ),
        (
            EstimatorOptions {
                noise_sd: 0.0,
                ..good
            },
            "option noise_sd",
        ),
        (
            EstimatorOptions {
                prior_sd: f64::NAN,
                ..good
            },
            "option prior_sd",
        ),
        (
            EstimatorOptions {
                prior_mean: 0.0,
                ..good
            },
            "option prior_mean",
        ),
    ] {
        let check =
            || check_estimator(|prior: Belief<f64>| Dense::new(prior, Fault::None), options);
        let cause = catch_unwind(check).unwrap_err();
        let text = cause.downcast_ref::<String>().unwrap();
        assert!(text.contains(name), "{text}");
    }
}

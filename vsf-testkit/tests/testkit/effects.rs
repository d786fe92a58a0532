//! The suite of effects passes a good one, and finds each of its faults by name.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use vsf_contact::ContactConfig;
use vsf_core::nalgebra::Vector3;
use vsf_gap::{Acts, Compensator, Effect, GapError, Need, Parameter, Sample, Site, Touch};
use vsf_testkit::{check_effect, sites};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    None,
    BoundsWithoutZero,
    StartsOutOfBounds,
    HidesAParameter,
    TakesAnyNumber,
    ActsAtZero,
    ActsAtZeroAfterOthers,
    ReachesDeeper,
    DoesNothing,
    ActsOnTorquesAlone,
    AssignsTorques,
    AssignsGains,
    AssignsSprings,
    DiffersFromItsLike,
    OverflowsAtItsBounds,
    LeavesContactOutOfRange,
    Jumps,
    JumpsAtZero,
}

static MADE: AtomicUsize = AtomicUsize::new(0);

/// Drag of the air, weaker springs and a slippery surface, with a fault.
struct Weather(Fault);

#[derive(Clone)]
struct Compensate {
    fault: Fault,
    k: f64,
    power: f64,
    off: f64,
}

impl Effect for Weather {
    fn name(&self) -> &str {
        "weather"
    }

    fn summary(&self) -> &str {
        match self.0 {
            Fault::HidesAParameter => "wind of the size `k`",
            _ => "wind of the size `k`, that grows with the speed to the power `n`",
        }
    }

    fn acts(&self) -> Acts {
        match self.0 {
            Fault::ReachesDeeper => Acts::Springs,
            _ => Acts::Contact,
        }
    }

    fn needs(&self) -> &[Need] {
        &[]
    }

    fn parameters(&self, _: &Site) -> Vec<Parameter> {
        let most = match self.0 {
            Fault::OverflowsAtItsBounds => 1e200,
            _ => 1.0,
        };
        let low = match self.0 {
            Fault::BoundsWithoutZero => 0.01,
            _ => 0.0,
        };
        vec![
            Parameter::amplitude("k", "1", [low, most], 0.1),
            Parameter::shape("n", "1", [1.0, 3.0], 0.5),
        ]
    }

    fn starts(&self, _: &Site) -> Vec<Vec<f64>> {
        match self.0 {
            Fault::StartsOutOfBounds => vec![vec![0.0, 5.0]],
            _ => vec![vec![0.0, 1.0], vec![0.0, 2.0]],
        }
    }

    fn compensator(&self, _: &Site, theta: &[f64]) -> Result<Box<dyn Compensator>, GapError> {
        let found = match (theta, self.0) {
            (&[k, power], _) => Some((k, power)),
            (_, Fault::TakesAnyNumber) => Some((0.0, 1.0)),
            _ => None,
        };
        let Some((k, power)) = found else {
            return Err(GapError::Parameters {
                effect: self.name().to_owned(),
                got: theta.len(),
                expected: 2,
            });
        };
        let k = match self.0 {
            Fault::ActsAtZero => k + 1e-9,
            Fault::JumpsAtZero if k > 0.0 => k + 0.2,
            Fault::Jumps if power > 1.2 => 2.0 * k,
            _ => k,
        };
        Ok(Box::new(Compensate {
            fault: self.0,
            k,
            power,
            off: MADE.fetch_add(1, Ordering::Relaxed) as f64,
        }))
    }
}

impl Compensate {
    fn is(&self, fault: Fault) -> bool {
        self.fault == fault
    }
}

impl Compensator for Compensate {
    fn contact(&self, config: &mut ContactConfig) {
        match self.fault {
            Fault::DoesNothing | Fault::ActsOnTorquesAlone => {}
            Fault::LeavesContactOutOfRange => config.friction -= self.k,
            _ => config.friction += self.k,
        }
    }

    fn springs(&mut self, _: &Sample<'_>, touch: &Touch<'_>, springs: &mut [Vector3<f64>]) {
        match self.fault {
            Fault::DoesNothing | Fault::ActsOnTorquesAlone => {}
            Fault::AssignsSprings if self.k > 0.0 => {
                let displacements = touch.contacts.displacements().iter();
                (springs.iter_mut().zip(displacements)).for_each(|(s, u)| *s = u * (1.0 - self.k));
            }
            _ => springs.iter_mut().for_each(|s| *s *= 1.0 - self.k),
        }
    }

    fn gains(&mut self, _: &Sample<'_>, _: &Touch<'_>, gains: &mut [f64]) {
        match self.fault {
            Fault::DoesNothing | Fault::ActsOnTorquesAlone => {}
            Fault::AssignsGains if self.k > 0.0 => gains.fill(1.0 + self.k),
            Fault::ActsAtZeroAfterOthers if gains.iter().any(|g| *g != 1.0) => gains.fill(1.0),
            _ => gains.iter_mut().for_each(|g| *g *= 1.0 + self.k),
        }
    }

    fn torques(&mut self, sample: &Sample<'_>, _: &Touch<'_>, tau: &mut [f64]) {
        if self.is(Fault::DoesNothing) {
            return;
        }
        let mut k = self.k;
        if self.is(Fault::OverflowsAtItsBounds) {
            k *= k;
        }
        if self.is(Fault::DiffersFromItsLike) {
            k *= 1.0 + 1e-9 * self.off;
        }
        for (t, v) in tau.iter_mut().zip(sample.qd) {
            let drag = -k * v.signum() * v.abs().powf(self.power);
            match self.fault {
                Fault::AssignsTorques if self.k > 0.0 => *t = drag,
                _ => *t += drag,
            }
        }
    }
}

#[test]
fn a_good_effect_passes() {
    check_effect(&Weather(Fault::None), &sites().unwrap());
}

#[test]
fn every_fault_is_found_by_name() {
    for (fault, property) in [
        (Fault::BoundsWithoutZero, "it declares what can be"),
        (Fault::StartsOutOfBounds, "it declares what can be"),
        (Fault::HidesAParameter, "its summary names"),
        (Fault::TakesAnyNumber, "parameters of another number"),
        (Fault::ActsAtZero, "amplitudes at zero"),
        (Fault::ActsAtZeroAfterOthers, "amplitudes at zero"),
        (Fault::ReachesDeeper, "no deeper than it says"),
        (Fault::DoesNothing, "it acts"),
        (Fault::ActsOnTorquesAlone, "it acts"),
        (Fault::AssignsTorques, "what other effects did stays"),
        (Fault::AssignsGains, "what other effects did stays"),
        (Fault::AssignsSprings, "what other effects did stays"),
        (Fault::DiffersFromItsLike, "two of a kind"),
        (Fault::OverflowsAtItsBounds, "finite within the bounds"),
        (Fault::LeavesContactOutOfRange, "finite within the bounds"),
        (Fault::Jumps, "it is continuous"),
        (Fault::JumpsAtZero, "it is continuous"),
    ] {
        let check = || check_effect(&Weather(fault), &sites().unwrap());
        let cause = catch_unwind(AssertUnwindSafe(check)).expect_err("nothing was found");
        let text = cause.downcast_ref::<String>().unwrap();
        assert!(text.contains(property), "{fault:?} was found as: {text}");
    }
}

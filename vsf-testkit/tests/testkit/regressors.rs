//! The suite of regressors passes a good one, and finds each of its faults by name.

use std::panic::{AssertUnwindSafe, catch_unwind};
use vsf_testkit::check_regressor;
use vsf_vision::{Features, Predictions, Regressor, Ridge, Samples, VisionError};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    GuessesAtOnce,
    PredictsTheMean,
    TooSure,
    SureFarAway,
    RemembersTheFirst,
    FreshOnesKnow,
    NoVarianceInOnePlace,
    TakesAnyFeature,
    Overflows,
}

/// A ridge, with a fault.
#[derive(Clone)]
struct Broken {
    fault: Fault,
    ridge: Ridge,
    learned: bool,
}

impl Broken {
    fn new(fault: Fault) -> Self {
        Self {
            fault,
            ridge: Ridge::new(),
            learned: false,
        }
    }
}

impl Regressor for Broken {
    fn fit(&mut self, samples: &Samples) -> Result<(), VisionError> {
        if self.fault == Fault::RemembersTheFirst && self.learned {
            return Ok(());
        }
        self.learned = true;
        self.ridge.fit(samples)
    }

    fn predict(&self, features: &Features) -> Result<Predictions, VisionError> {
        let rows = features.len();
        let of = |mean: f64, variance: f64| Predictions {
            mean: vec![mean; rows],
            variance: vec![variance; rows],
        };
        let found = self.ridge.predict(features);
        match (self.fault, found) {
            (Fault::GuessesAtOnce, Err(_)) if !self.learned => Ok(of(0.0, 1.0)),
            (Fault::TakesAnyFeature, Err(_)) if self.learned => Ok(of(0.0, 1.0)),
            (Fault::Overflows, Err(_)) if self.learned && features.width() == 2 => {
                Ok(of(f64::INFINITY, 1.0))
            }
            (Fault::PredictsTheMean, Ok(_)) => Ok(of(6.5, 1.5)),
            (Fault::TooSure, Ok(found)) => Ok(Predictions {
                variance: found.variance.iter().map(|v| v / 9.0).collect(),
                ..found
            }),
            (Fault::SureFarAway, Ok(found)) => Ok(Predictions {
                variance: vec![0.25; rows],
                ..found
            }),
            (Fault::NoVarianceInOnePlace, Ok(found)) => Ok(Predictions {
                variance: (found.variance.iter())
                    .map(|v| if *v < 1e-3 { 0.0 } else { *v })
                    .collect(),
                ..found
            }),
            (_, found) => found,
        }
    }

    fn fresh(&self) -> Box<dyn Regressor> {
        match self.fault {
            Fault::FreshOnesKnow if self.learned => Box::new(Self {
                ridge: self.ridge.clone(),
                ..*self
            }),
            fault => Box::new(Self::new(fault)),
        }
    }
}

#[test]
fn faults_are_found_by_name() {
    check_regressor(&Broken::new(Fault::None));
    for (fault, property) in [
        (Fault::GuessesAtOnce, "has not learned refuses"),
        (Fault::PredictsTheMean, "a plane is predicted"),
        (Fault::TooSure, "a plane is predicted"),
        (Fault::SureFarAway, "far away"),
        (Fault::RemembersTheFirst, "learned anew"),
        (Fault::FreshOnesKnow, "a fresh one"),
        (Fault::NoVarianceInOnePlace, "coincident"),
        (Fault::TakesAnyFeature, "other features"),
        (Fault::Overflows, "what overflows"),
    ] {
        let run = AssertUnwindSafe(|| check_regressor(&Broken::new(fault)));
        let cause = catch_unwind(run).unwrap_err();
        let text = cause.downcast_ref::<String>().unwrap();
        assert!(text.contains(property), "{fault:?}: {text}");
    }
}

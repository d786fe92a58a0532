//! The dense filters keep the promises of every estimator, in both precisions; what `f32` costs,
//! and that threads change nothing.

#![allow(clippy::unwrap_used)]

use rayon::ThreadPoolBuilder;
use vsf_core::{Belief, Estimator, Observation, Scalar};
use vsf_filter::{CovarianceFilter, InformationFilter, Projection};
use vsf_testkit::{EstimatorOptions, LinearWorld, check_estimator};

fn check<T: Scalar, E: Estimator<Scalar = T> + 'static>(make: impl Fn(Belief<T>) -> E) {
    for (channels, seed) in [(1, 1), (3, 2), (7, 3), (11, 4)] {
        let options = EstimatorOptions {
            channels,
            seed,
            exact: true,
            ..EstimatorOptions::default()
        };
        check_estimator(&make, options);
        let boxed = |prior| Box::new(make(prior)) as Box<dyn Estimator<Scalar = T>>;
        check_estimator(boxed, options);
    }
}

fn conforms<T: Scalar>() {
    for projection in [Projection::OutputOnly, Projection::FedBack] {
        check(|p: Belief<T>| CovarianceFilter::with_projection(p, projection).unwrap());
        check(|p: Belief<T>| InformationFilter::with_projection(p, projection).unwrap());
    }
}

#[test]
fn conforms_f32() {
    conforms::<f32>();
}

#[test]
fn conforms_f64() {
    conforms::<f64>();
}

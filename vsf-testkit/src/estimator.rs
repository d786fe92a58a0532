mod history;
mod safety;
mod statistics;
mod suite;
mod symmetry;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use suite::Suite;
use vsf_core::{Belief, Estimator, Scalar};

/// The problems that [`check_estimator`] poses, and what is asked beyond the common rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorOptions {
    /// Points of the field, at least 8; default 40.
    pub points: usize,
    /// Channels of a reading, at least 1; default 3.
    pub channels: usize,
    /// Observations of a sequence, at least 2; default 12.
    pub steps: usize,
    /// Entries of W lie within `[-weight, weight]`, > 0 and finite; default 0.05.
    pub weight: f64,
    /// Standard deviation of the reading noise; default 0.1.
    pub noise_sd: f64,
    /// Prior mean; default 3, far above 0 in units of the prior sd.
    pub prior_mean: f64,
    /// Prior standard deviation; default 0.5.
    pub prior_sd: f64,
    /// Whether NIS, log-likelihood and whitened residual are those of the Gaussian model
    /// `S = W Sigma W^T + R`. Default true; false for estimators without a noise model, and for those
    /// that change the noise.
    pub gaussian: bool,
    /// Whether the estimator is exact for linear Gaussian problems of independent points: neither
    /// the order of observations nor cutting them into single channels matters, and NIS follows the
    /// chi-squared law over whole sequences. Default false.
    pub exact: bool,
    /// For estimators that are not `exact`: the interval in which they promise the mean NIS per
    /// degree of freedom of well-specified sequences, of constant fields and, where they support it,
    /// of fields that drift. Sequences are four times as long and as strong as the others. Default
    /// `Some((0.9, 1.8))`, what leaving out correlations may cost there; `None` asks nothing.
    pub nis_ratio: Option<(f64, f64)>,
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
            nis_ratio: Some((0.9, 1.8)),
            seed: 1,
        }
    }
}

type Property<'a, T, E> = fn(&Suite<'a, T, E>);

/// Checks that an estimator keeps the promises of [`Estimator`], boxed as well. `make` builds one
/// from a prior; two of them from the same prior must behave the same.
///
/// # Panics
/// With the name of the property that does not hold, or of the option that is out of range.
///
/// ```
/// use vsf_filter::DiagonalKalman;
/// use vsf_testkit::{EstimatorOptions, check_estimator};
/// check_estimator(DiagonalKalman::<f32>::new, EstimatorOptions::default());
/// ```
pub fn check_estimator<T: Scalar, E: Estimator<Scalar = T> + 'static>(
    make: impl Fn(Belief<T>) -> E,
    options: EstimatorOptions,
) {
    let EstimatorOptions {
        points,
        channels,
        steps,
        weight,
        ..
    } = options;
    assert!(points >= 8, "option points: {points}, at least 8");
    assert!(channels >= 1, "option channels: {channels}, at least 1");
    assert!(steps >= 2, "option steps: {steps}, at least 2");
    assert!(
        weight > 0.0 && weight.is_finite(),
        "option weight: {weight}, > 0 and finite"
    );
    let suite = Suite {
        make: &make,
        options,
    };
    let mut properties: Vec<(&str, Property<'_, T, E>)> = vec![
        ("two of a kind behave the same", Suite::determinism),
        ("means are never negative", Suite::never_negative),
        ("an error leaves the belief unchanged", Suite::errors),
        ("an empty observation teaches nothing", Suite::empty),
        ("non-finite numbers cannot enter", Suite::non_finite),
        ("relabelling points relabels the belief", Suite::permutation),
        ("the unit of torque does not matter", Suite::torque_units),
        (
            "the unit of stiffness does not matter",
            Suite::stiffness_units,
        ),
        ("reset starts over", Suite::reset),
        ("untouched points keep their prior", Suite::untouched),
        ("points first touched late learn", Suite::late),
        ("time widens the belief or is refused", Suite::diffusion),
        ("overflow does no harm", Suite::overflow),
        ("a box changes nothing", Suite::boxed),
        ("reports and residuals agree", Suite::reports),
    ];
    if options.gaussian {
        properties.push(("the first innovation is known", Suite::first_innovation));
        properties.push(("NIS of single readings is consistent", Suite::nis));
    }
    if options.exact {
        properties.push(("the order of observations does not matter", Suite::order));
        properties.push(("readings may come channel by channel", Suite::splitting));
    }
    properties.push(("NIS of sequences is consistent", Suite::consistency));
    for (property, check) in properties {
        if let Err(cause) = catch_unwind(AssertUnwindSafe(|| check(&suite))) {
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

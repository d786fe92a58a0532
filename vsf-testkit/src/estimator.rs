mod history;
mod safety;
mod statistics;
mod suite;
mod symmetry;

use crate::property::ask;
use history::boxed;
use suite::Suite;
use vsf_core::{Belief, Estimator, Scalar};

/// Options of [`check_estimator`]: the problems, and what is tested beyond the common rules.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatorOptions {
    /// Number of points of the field, at least 8; default 40.
    pub points: usize,
    /// Number of channels of a reading, at least 1; default 3.
    pub channels: usize,
    /// Number of observations in a sequence, at least 2; default 12.
    pub steps: usize,
    /// Entries of W lie within `[-weight, weight]`, > 0 and finite; default 0.05.
    pub weight: f64,
    /// Standard deviation of the reading noise, > 0 and finite; default 0.1.
    pub noise_sd: f64,
    /// Prior mean, at least 4 times the prior sd, so that `K >= 0` hardly acts; default 3.
    pub prior_mean: f64,
    /// Prior standard deviation, > 0 and finite; default 0.5.
    pub prior_sd: f64,
    /// Whether points are independent in the prior, so that touched points teach nothing about others. Default true.
    ///
    /// Set it to false for priors that correlate points, in space or by a common level. What relies on independence is then
    /// not tested; see the table of [`check_estimator`].
    pub local: bool,
    /// Whether NIS, log-likelihood and whitened residual are those of the Gaussian model `S = W Sigma W^T + R`. Default
    /// true.
    ///
    /// Set it to false for estimators without a noise model, and for those that change the noise.
    pub gaussian: bool,
    /// Whether the estimator is exact for linear Gaussian problems with independent points. Default false.
    ///
    /// Then neither the order of observations nor splitting them into single channels matters, and NIS follows the
    /// chi-squared law over whole sequences.
    pub exact: bool,
    /// For estimators that are not `exact`: the interval in which they promise the mean NIS per degree of freedom of
    /// well-specified sequences.
    ///
    /// It applies to constant fields and, if the estimator supports it, to fields that drift. Sequences are four times as
    /// long and as strong as the others. Default `Some((0.9, 1.8))`, which allows for neglected correlations; `None` tests
    /// nothing.
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
            local: true,
            gaussian: true,
            exact: false,
            nis_ratio: Some((0.9, 1.8)),
            seed: 1,
        }
    }
}

type Property<'a, T> = fn(&Suite<'a, T>);

/// Checks that an estimator keeps the promises of [`Estimator`], also when boxed.
///
/// `make` builds an estimator from a prior. Two estimators from the same prior must behave the same.
///
/// | property | asked of |
/// | --- | --- |
/// | two of a kind behave the same, bit for bit | all |
/// | means are never negative, variances are positive | all |
/// | the field has the belief's variances, and its means of touched points | all |
/// | an error leaves the belief unchanged; points beyond the field are refused | all |
/// | an empty observation teaches nothing | all |
/// | non-finite numbers cannot enter | all |
/// | relabeling points relabels the belief | `local` |
/// | the unit of torque does not matter | all |
/// | the unit of stiffness does not matter | `local`; a prior of its own has a unit |
/// | untouched points keep their prior | `local` |
/// | reset starts over; a new sequence keeps the belief | all |
/// | points first touched late learn; by how much | all; `exact` and `local` |
/// | time widens the belief by what it is told, or is refused | all |
/// | overflow does no harm | all |
/// | a box changes nothing | all |
/// | reports and residuals agree with belief and readings | all |
/// | the first innovation, its NIS and log-likelihood are those of `S = W Sigma W^T + R` | `gaussian` and `local` |
/// | NIS of single readings follows its law | `gaussian` and `local` |
/// | the order of observations does not matter | `exact` |
/// | readings may come channel by channel | `exact` |
/// | NIS of sequences follows its law, or lies in `nis_ratio` | `local` |
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
    let suite = Suite {
        make: &|prior| Box::new(make(prior)),
        options,
    };
    check(&suite);
    // Last: what differs from its like differs in a box.
    ask(&who::<T>(), "a box changes nothing", || {
        boxed(&suite, &make);
    });
}

fn who<T: Scalar>() -> String {
    format!("{} estimator", T::NAME)
}

/// All checks except those that need the estimator's own type.
fn check<'a, T: Scalar>(suite: &Suite<'a, T>) {
    let EstimatorOptions {
        points,
        channels,
        steps,
        weight,
        noise_sd,
        prior_mean,
        prior_sd,
        local,
        gaussian,
        exact,
        ..
    } = suite.options;
    assert!(points >= 8, "option points: {points}, at least 8");
    assert!(channels >= 1, "option channels: {channels}, at least 1");
    assert!(steps >= 2, "option steps: {steps}, at least 2");
    for (option, value) in [
        ("weight", weight),
        ("noise_sd", noise_sd),
        ("prior_sd", prior_sd),
    ] {
        assert!(
            value > 0.0 && value.is_finite(),
            "option {option}: {value}, > 0 and finite"
        );
    }
    assert!(
        prior_mean >= 4.0 * prior_sd && prior_mean.is_finite(),
        "option prior_mean: {prior_mean}, at least 4 times prior_sd"
    );
    let properties: [(&str, bool, Property<'a, T>); 20] = [
        ("two of a kind behave the same", true, Suite::determinism),
        ("means are never negative", true, Suite::never_negative),
        ("the field knows what the belief does", true, Suite::field),
        ("an error leaves the belief unchanged", true, Suite::errors),
        ("an empty observation teaches nothing", true, Suite::empty),
        ("non-finite numbers cannot enter", true, Suite::non_finite),
        (
            "relabeling points relabels the belief",
            local,
            Suite::permutation,
        ),
        (
            "the unit of torque does not matter",
            true,
            Suite::torque_units,
        ),
        (
            "the unit of stiffness does not matter",
            local,
            Suite::stiffness_units,
        ),
        ("untouched points keep their prior", local, Suite::untouched),
        ("reset starts over", true, Suite::reset),
        ("points first touched late learn", true, Suite::late),
        (
            "time widens the belief or is refused",
            true,
            Suite::diffusion,
        ),
        ("overflow does no harm", true, Suite::overflow),
        ("reports and residuals agree", true, Suite::reports),
        (
            "the first innovation is known",
            gaussian && local,
            Suite::first_innovation,
        ),
        (
            "NIS of single readings is consistent",
            gaussian && local,
            Suite::nis,
        ),
        (
            "the order of observations does not matter",
            exact,
            Suite::order,
        ),
        (
            "readings may come channel by channel",
            exact,
            Suite::splitting,
        ),
        ("NIS of sequences is consistent", local, Suite::consistency),
    ];
    for (property, _, check) in properties.into_iter().filter(|(_, asked, _)| *asked) {
        ask(&who::<T>(), property, || check(suite));
    }
}

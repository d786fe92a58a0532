mod held_out;
mod likelihood;
mod problem;
mod thresholds;

pub use thresholds::closer_thresholds;

use crate::{PipelineError, Trace};
use problem::Problem;
use serde::{Deserialize, Serialize};
use vsf_core::{Belief, CoreError, RestPoints};
use vsf_filter::{FieldPrior, Matern, Smoothness};

/// Prior and noise of an estimation. Their ratio determines how closely readings are followed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hyper {
    /// Standard deviation of each point's own part of the stiffness (N/m). The mean of the prior is 0.
    pub prior_sd: f64,
    /// Correlations of the prior between points.
    pub shape: PriorShape,
    /// Standard deviation of the readings (N m or N), one value per channel, including model error.
    pub noise_sd: Vec<f64>,
}

impl Hyper {
    /// Standard deviation of the stiffness of a point (N/m), all parts of the prior together.
    pub fn point_sd(&self) -> f64 {
        let PriorShape {
            smooth_share,
            level_share,
            ..
        } = self.shape;
        self.prior_sd * (1.0 + smooth_share.powi(2) + level_share.powi(2)).sqrt()
    }
}

/// Correlated parts of the prior: a smooth part, since neighboring points of a real object are alike, and a
/// common level. Estimators that keep no correlations use only their variances.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PriorShape {
    /// Standard deviation of the smooth part, relative to that of a point's own part, >= 0, default 0.25.
    /// With 0 points are independent, as in the paper.
    pub smooth_share: f64,
    /// Length scale of the smooth part (m), > 0, default 4 cm.
    pub length: f64,
    /// Standard deviation of a level common to all points, relative to that of a point's own part, >= 0,
    /// default 0.
    pub level_share: f64,
}

impl Default for PriorShape {
    fn default() -> Self {
        Self {
            smooth_share: 0.25,
            length: 0.04,
            level_share: 0.0,
        }
    }
}

impl PriorShape {
    /// Independent points, as in the paper.
    pub fn independent() -> Self {
        Self {
            smooth_share: 0.0,
            ..Self::default()
        }
    }

    /// This shape and, if it has a smooth part, the same one without it, to compare.
    pub fn or_independent(self) -> Vec<Self> {
        let independent = Self {
            smooth_share: 0.0,
            ..self
        };
        if self == independent {
            vec![self]
        } else {
            vec![self, independent]
        }
    }

    /// The prior of a field with mean 0, where `sd` (N/m) is the standard deviation of every point's own
    /// part.
    ///
    /// # Errors
    /// A parameter out of range.
    pub fn prior(&self, rest: &RestPoints, sd: f64) -> Result<FieldPrior, PipelineError> {
        self.prior_about(rest, sd, vec![0.0; rest.len()])
    }

    /// Like [`prior`](Self::prior), but about the given means (N/m, >= 0), one per point.
    ///
    /// # Errors
    /// A parameter out of range, or means that are negative, not finite, or not one per point.
    pub fn prior_about(
        &self,
        rest: &RestPoints,
        sd: f64,
        mean: Vec<f64>,
    ) -> Result<FieldPrior, PipelineError> {
        if !(sd > 0.0 && (sd * sd).is_normal()) {
            return Err(CoreError::Parameter {
                name: "prior sd",
                value: sd,
                range: "> 0 and finite, its square too",
            }
            .into());
        }
        CoreError::check_len("means of the prior", mean.len(), rest.len())?;
        let variance = vec![sd * sd; mean.len()];
        let own =
            FieldPrior::from(Belief::new(mean, variance)?).with_level(self.level_share * sd)?;
        if self.smooth_share == 0.0 {
            return Ok(own);
        }
        let smooth = Matern {
            sd: self.smooth_share * sd,
            length: self.length,
            smoothness: Smoothness::ThreeHalves,
        };
        Ok(own.with_smooth(smooth, rest)?)
    }
}

/// How [`choose_hyper`] compares priors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HyperMethod {
    /// Compares the predictions of held-out touches (the default):
    ///
    /// 1. *Rule.* The `n` readings that involve a typical point count as four, because model error persists
    ///    over a push. The expected signal of a typical reading is thus `sqrt(4 / n)` of its noise.
    /// 2. *Candidates.* Every shape is tried at the ratio of the rule and at larger ones, up to 64 times,
    ///    as long as the error falls. If none is better, smaller ones are tried, down to a sixteenth.
    /// 3. *Folds.* The touches are dealt to at most ten folds. If folds share few points, each touch is cut
    ///    into quarters instead, and one of them is held out at a time.
    /// 4. *Predictor.* The constrained optimum. With more than 1500 touched points it is the online filter,
    ///    with the first shape only, since that filter does not use a smooth part.
    /// 5. *Choice.* Candidates qualify whose error exceeds the least one by no more than one standard error
    ///    (of paired differences). Of these the one nearest to the rule is chosen (L. Breiman et al.,
    ///    *Classification and Regression Trees*, 1984, section 3.4.3).
    /// 6. *Level.* Prior and noise are scaled together until held-out residuals are as large as predicted.
    #[default]
    HeldOut,
    /// Compares the marginal likelihood of all readings ([`vsf_filter::BatchMap::best_scale`]), over all of
    /// these ratios and the same shapes.
    ///
    /// It assumes that model errors are independent from sample to sample. If they are not, as in most
    /// recordings of pushes, the readings are followed too closely.
    Likelihood,
}

/// One prior that was tried.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Candidate {
    /// Correlations of the prior between points.
    #[serde(flatten)]
    pub shape: PriorShape,
    /// Standard deviation of the signal that the prior expects in a typical reading, relative to that of
    /// its noise.
    pub signal_to_noise: f64,
    /// Mean error norm on held-out touches, for [`HyperMethod::HeldOut`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f64>,
    /// Log marginal likelihood at the best level, for [`HyperMethod::Likelihood`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub log_evidence: Option<f64>,
}

/// Result of [`choose_contact`]: a contact model, with prior and noise for it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ContactChoice {
    /// Index of the chosen contact model.
    pub contact: usize,
    /// Mean error norm on held-out touches with each contact model, with the prior chosen for it. The same
    /// samples are held out for all, so the errors may differ from those of a choice with one model alone.
    pub errors: Vec<f64>,
    /// Prior and noise for the chosen contact model.
    pub choice: HyperChoice,
}

/// Result of [`choose_hyper`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct HyperChoice {
    /// The chosen prior and noise.
    pub hyper: Hyper,
    /// All candidates that were tried.
    pub candidates: Vec<Candidate>,
}

/// Signal-to-noise ratios of one reading that are tried, as powers of 2 times the rule.
const POWERS: [f64; 8] = [-4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 6.0];

/// Chooses prior and noise from train sequences, for any estimator.
///
/// *Noise per channel*: most of what a field leaves unexplained is model error, which grows with the load.
/// The noise of a channel is therefore proportional to the RMS of its readings in contact, plus 5 % of the
/// RMS norm of the whole reading.
///
/// `method` chooses the level of the noise, the sd of the prior and one of `shapes`; of equally good shapes
/// it chooses the first. [`EstimatorSpec::shapes`](crate::EstimatorSpec::shapes) gives the shapes for an
/// estimator. Estimators that keep no correlations are overconfident about sums over points if
/// they get a prior that was chosen for correlated points.
///
/// # Errors
/// No shape, traces that [`Trace::check`] refuses or that differ in their number of joints, train sequences
/// that never touch a point, or failures of an estimator.
pub fn choose_hyper(
    rest: &RestPoints,
    traces: &[Trace],
    shapes: &[PriorShape],
    method: HyperMethod,
) -> Result<HyperChoice, PipelineError> {
    match method {
        HyperMethod::HeldOut => Ok(choose_contact(rest, &[traces], shapes)?.choice),
        HyperMethod::Likelihood => {
            first("shapes of the prior", shapes)?;
            likelihood::choose(&Problem::new(rest, traces)?, shapes)
        }
    }
}

/// Chooses one of several contact models by the prediction of held-out touches, with prior and noise for it
/// as in [`HyperMethod::HeldOut`]. The models may be [`Scene`](crate::Scene)s that differ in their
/// threshold, friction or padding.
///
/// `contacts` are the traces of the same samples with each model. For all models the same samples are held
/// out, and the same estimator predicts them. Each model is compared with the prior chosen for it. Of the
/// models whose error exceeds the best one by no more than one standard error of the difference, the first
/// is chosen, so pass the preferred model first. If, under any of the models, the touches have few points
/// in common, parts of touches are held out for all. The returned prior and noise are those of the chosen model alone.
///
/// # Errors
/// As [`choose_hyper`]; also no contact model, or traces that do not have the same samples.
pub fn choose_contact(
    rest: &RestPoints,
    contacts: &[&[Trace]],
    shapes: &[PriorShape],
) -> Result<ContactChoice, PipelineError> {
    let own = first("models of contact", contacts)?;
    for (index, traces) in contacts.iter().enumerate().skip(1) {
        CoreError::check_len("traces", traces.len(), own.len())?;
        let mut pairs = own.iter().zip(*traces);
        if let Some((of, _)) = pairs.find(|(of, trace)| !of.has_samples_of(trace)) {
            let id = of.id.clone();
            return Err(PipelineError::OtherSamples { id, index });
        }
    }
    let shape = first("shapes of the prior", shapes)?;
    let problems = contacts.iter().map(|traces| Problem::new(rest, traces));
    held_out::choose(problems.collect::<Result<_, _>>()?, shape, shapes)
}

fn first<'a, T>(what: &'static str, all: &'a [T]) -> Result<&'a T, CoreError> {
    all.first().ok_or(CoreError::TooFew {
        what,
        got: 0,
        least: 1,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64Mcg;
    use vsf_core::{Noise, Observation};

    const POINTS: usize = 12;

    fn rest() -> RestPoints {
        let at = |i: usize| Point3::new(0.01 * i as f64, 0.0, 0.0);
        RestPoints::new((0..POINTS).map(at).collect()).unwrap()
    }

    /// Four touches of every point, one at a time, each by `bears` on the only joint.
    fn touches(bears: f64) -> Vec<Trace> {
        let touch = |id: usize| {
            let reading = |p: usize| {
                // Stiff and soft in turn, and a little noise.
                let stiffness = if p.is_multiple_of(2) { 40.0 } else { 1.0 };
                let noise = if (p + id).is_multiple_of(3) {
                    0.3
                } else {
                    -0.2
                };
                let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
                let tau = [bears * stiffness + noise];
                obs.rebuild(POINTS, &[p as u32], &tau, |_, w| w[0] = bears)
                    .unwrap();
                obs
            };
            Trace {
                id: id.to_string(),
                time: (0..POINTS).map(|k| k as f64).collect(),
                observations: (0..POINTS).map(reading).collect(),
                touches: std::iter::once(0..POINTS).collect(),
            }
        };
        (0..4).map(touch).collect()
    }

    /// What the field is uncertain by is no noise.
    #[test]
    fn val_noise_of_a_right_model() {
        const MANY: usize = 300;
        let mut rng = Pcg64Mcg::seed_from_u64(5);
        let field: Vec<f64> = (0..MANY).map(|_| rng.random_range(0.0..40.0)).collect();
        let noise = Normal::new(0.0, 0.5).unwrap();
        let mut reading = |p: usize| {
            let mut obs = Observation::new(Noise::uniform(1, 1.0).unwrap());
            let tau = [0.1 * field[p] + noise.sample(&mut rng)];
            obs.rebuild(MANY, &[p as u32], &tau, |_, w| w[0] = 0.1)
                .unwrap();
            obs
        };
        let traces: Vec<Trace> = (0..3)
            .map(|id: usize| Trace {
                id: id.to_string(),
                time: (0..MANY).map(|k| k as f64).collect(),
                observations: (0..MANY).map(&mut reading).collect(),
                touches: std::iter::once(0..MANY).collect(),
            })
            .collect();
        let at = |i: usize| Point3::new(0.01 * i as f64, 0.0, 0.0);
        let rest = RestPoints::new((0..MANY).map(at).collect()).unwrap();
        for shape in [PriorShape::independent(), PriorShape::default()] {
            let choice = choose_hyper(&rest, &traces, &[shape], HyperMethod::HeldOut).unwrap();
            let sd = choice.hyper.noise_sd[0];
            assert!((sd / 0.5 - 1.0).abs() < 0.05, "{sd}");
        }
    }

    /// A row of a comparison of priors is that prior's, however badly it does.
    #[test]
    fn one_shape_is_not_compared_with_others() {
        let smooth = PriorShape {
            smooth_share: 30.0,
            length: 1.0,
            ..PriorShape::default()
        };
        let chosen = |shapes: &[PriorShape]| {
            let choice = choose_hyper(&rest(), &touches(0.1), shapes, HyperMethod::HeldOut);
            choice.unwrap().hyper.shape
        };
        assert_eq!(chosen(&smooth.or_independent()).smooth_share, 0.0);
        assert_eq!(chosen(&[smooth]), smooth);
        let none = choose_hyper(&rest(), &touches(0.1), &[], HyperMethod::HeldOut);
        assert!(
            none.unwrap_err()
                .to_string()
                .contains("shapes of the prior")
        );
    }

    /// On either side of the rule errors fall, but for the last, and only one side does better than the rule.
    #[test]
    fn ratios_are_tried_outward_while_the_error_falls() {
        let shape = PriorShape::independent();
        let choice = choose_hyper(&rest(), &touches(0.1), &[shape], HyperMethod::HeldOut).unwrap();
        let tried: Vec<(f64, f64)> = (choice.candidates.iter())
            .map(|c| (c.signal_to_noise, c.error.unwrap()))
            .collect();
        let (rule, by_rule) = tried[0];
        assert!(tried.len() > 1 && tried.len() < POWERS.len(), "{tried:?}");
        let mut sides_that_gain = 0;
        for above in [true, false] {
            let side = tried[1..].iter().filter(|(r, _)| (*r > rule) == above);
            let errors: Vec<f64> = std::iter::once(by_rule)
                .chain(side.map(|(_, e)| *e))
                .collect();
            let last = errors.len().saturating_sub(2);
            assert!(errors[..=last].is_sorted_by(|a, b| a > b), "{tried:?}");
            sides_that_gain += usize::from(errors.len() > 2);
        }
        assert!(sides_that_gain < 2, "{tried:?}");
    }

    #[test]
    fn contacts_without_torque_are_told_from_none() {
        let why = |traces: &[Trace]| {
            let (shape, method) = (PriorShape::default(), HyperMethod::HeldOut);
            choose_hyper(&rest(), traces, &[shape], method).unwrap_err()
        };
        assert!(matches!(why(&[]), PipelineError::NoContact { .. }));
        let error = why(&touches(0.0));
        assert!(
            matches!(
                error,
                PipelineError::NoTorque {
                    touched: POINTS,
                    ..
                }
            ),
            "{error}"
        );
    }

    /// As the prior of a point has it.
    #[test]
    fn sd_of_a_point_has_all_parts() {
        let hyper = Hyper {
            prior_sd: 7.0,
            shape: PriorShape {
                smooth_share: 0.5,
                level_share: 2.0,
                ..PriorShape::default()
            },
            noise_sd: vec![1.0],
        };
        let prior = hyper.shape.prior(&rest(), hyper.prior_sd).unwrap();
        let variance = prior.marginals().unwrap().variance()[3];
        assert!((hyper.point_sd().powi(2) / variance - 1.0).abs() < 1e-9);
    }
}

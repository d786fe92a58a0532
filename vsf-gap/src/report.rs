//! What a diagnosis says, and its JSON.

use crate::closure::Residuals;
use crate::limits::Limit;
use crate::locate::Location;
use crate::next::NextExperiment;
use crate::refine::{Refined, is_stopped};
use crate::search::Candidate;
use crate::trial::Checked;
use crate::verdict::{Verdict, VerdictKind};
use crate::{Campaign, Effect, Model, Motion, Parameter, Role};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Name of the stiffness field in [`EffectReport::ambiguous_with`].
pub const STIFFNESS_FIELD: &str = "stiffness_field";

/// Effects that close this share of the gap explain it, however rough the rest is.
pub(crate) const MOSTLY: f64 = 0.5;
/// A model whose error is no more than this many times that of a perfect one leaves no gap.
const PERFECT: f64 = 1.1;

/// A parameter at least this many deviations from zero shows that its effect acts on a joint. If the effect does not act on
/// seven joints, one of them exceeds this in one case of twenty. Parameters below a share of the largest one of the effect
/// need more.
const SHOWS: f64 = 2.7;
const SMALL: f64 = 0.05;
const SHOWS_SMALL: f64 = 5.0;

/// An estimated parameter of an effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "a parameter, an object")]
pub struct ParameterEstimate {
    /// Name of the parameter.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Standard deviation; 0 if a file gives none.
    #[serde(rename = "std", default)]
    pub sd: f64,
    /// Unit; `1` for dimensionless numbers.
    pub unit: String,
}

/// What a diagnosis reports about one effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectReport {
    /// Its name.
    pub effect: String,
    /// The effect and its parameters, in one phrase.
    #[serde(default)]
    pub summary: String,
    /// Probability that the effect acts.
    pub probability: f64,
    /// Gain of log evidence over the nominal model (nats); to first order for effects that were not fitted.
    pub score: f64,
    /// Score (nats) that the effect reaches where nothing acts.
    ///
    /// A constant of the effect, calibrated on other recordings. It is higher where contact is rough, or where the effect
    /// generalizes another one. The probability grows with the score beyond this value. To be the only
    /// named effect takes some 8 to 10 nats beyond it. `null` if the effect was not fitted.
    #[serde(default)]
    pub null_score: Option<f64>,
    /// Parameters: those of the corrected model if the effect is part of it. Empty for effects that were not fitted.
    pub parameters: Vec<ParameterEstimate>,
    /// Names of the parameters that the recording hardly determines: their posterior deviations are more than nine tenths
    /// of those of the prior.
    #[serde(default)]
    pub undetermined: Vec<String>,
    /// Names of the amplitudes that stopped at a bound of the plausible range. The effect may then stand for something
    /// else.
    #[serde(default)]
    pub at_bound: Vec<String>,
    /// Names of the shapes that are determined and lie at a bound of the plausible range. The data may want a value beyond
    /// it, so their deviations describe the inner side alone.
    #[serde(default)]
    pub shapes_at_bound: Vec<String>,
    /// Joints with a parameter that is at least 2.7 deviations from zero, or five if it is less than a twentieth of the
    /// effect's largest one.
    pub joints: Vec<String>,
    /// Mean error on the test sequences with this effect (N m or N); `null` except for the likeliest effects and those that
    /// were up to be named.
    pub test_error: Option<f64>,
    /// Share of the gap that the effect closes on the test sequences.
    pub closed_fraction: Option<f64>,
    /// Gain of the log predictive density of the test sequences over the nominal model (nats); `null` where `test_error`
    /// is.
    ///
    /// Both models are fitted to the train sequences, which leave the effect's parameters uncertain.
    #[serde(default)]
    pub test_score: Option<f64>,
    /// Share of the effect's information that the stiffness absorbs, 0 to 1.
    pub absorbed_share: Option<f64>,
    /// What the model with this effect leaves unexplained; `null` if it was not fitted.
    pub roughness: Option<Roughness>,
    /// What these recordings cannot tell from this effect.
    ///
    /// Names of effects, and [`STIFFNESS_FIELD`] if the effect, with one stiffness everywhere, explains what a field
    /// explains that differs from place to place.
    pub ambiguous_with: Vec<String>,
    /// How large each amplitude has to be for the recording to show it, the one that shows best first; empty where another
    /// contact threshold explains as much ([`Verdict::or_threshold`]).
    #[serde(default)]
    pub shows_from: Vec<Limit>,
    /// Whether the recording can show the effect.
    pub testable: bool,
    /// Why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Unexplained torques that persist, as shares of what is measured. The values come from a lattice.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Roughness {
    /// Share of the force in contact, and as large a share of 0.1 m in the place where it acts.
    pub contact: f64,
    /// Share of each joint's RMS torque.
    pub joint: f64,
    /// Share of the random walk by which an effect may stray ([`crate::RandomWalk`]).
    #[serde(default)]
    pub walk: f64,
}

/// Errors before and after the correction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Gap {
    /// Mean error of the nominal model on the test sequences (N m or N).
    pub test_error_nominal: f64,
    /// Mean error of the corrected model on the test sequences (N m or N).
    pub test_error_corrected: f64,
    /// Mean error of a perfect model, from the noise of the train sequences.
    pub noise_floor: f64,
    /// Whether the noise floor is only an upper bound. It is if the noise was read in contact, for want of readings in the
    /// air other than zero: changes from one sample to the next then count as noise.
    #[serde(default)]
    pub noise_floor_is_bound: bool,
    /// Share of the gap that the corrected model closes.
    pub closed_fraction: f64,
    /// 95 % interval of that share, from drawing stretches of the test sequences anew with the fitted model fixed.
    ///
    /// It says how well these recordings determine the share, not how it comes out in another touch. It extends beyond 0
    /// and 1 where the gap is hardly larger than the noise.
    pub closed_interval: [f64; 2],
    /// Unit of the errors.
    pub unit: String,
    /// Effects of the corrected model; empty if nothing is corrected.
    #[serde(default)]
    pub corrected_by: Vec<String>,
    /// Mean errors of the samples in which nothing is touched at either threshold; `null` if there are none.
    #[serde(default)]
    pub free: Option<MeanErrors>,
    /// Mean errors of the samples in which something is touched; `null` if there are none.
    #[serde(default)]
    pub contact: Option<MeanErrors>,
    /// Whether the errors are those of fields as estimated outside of a diagnosis ([`Campaign::estimated`]).
    ///
    /// If not, they are those of the diagnosis' own fields, as where nothing is touched or test sequences were learned
    /// from.
    #[serde(default)]
    pub estimated: bool,
    /// Whether there are no test sequences. The errors are then in-sample, on the only sequence.
    #[serde(default)]
    pub in_sample: bool,
    /// Contact threshold (m) of the corrected model's field; `null` in free air.
    #[serde(default)]
    pub threshold: Option<f64>,
    /// Contact threshold (m) of the nominal model's field: that of the corrected model or the one that suits the points,
    /// whichever predicts better.
    #[serde(default)]
    pub threshold_nominal: Option<f64>,
}

/// Mean errors over some of the samples that check the models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanErrors {
    /// Of the nominal model (N m or N).
    pub nominal: f64,
    /// Of the corrected model (N m or N).
    pub corrected: f64,
    /// Number of samples.
    pub samples: usize,
}

/// A diagnosis, as written by `vsf diagnose --json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Diagnosis {
    /// Version of this format, 1.
    pub schema: u32,
    /// Name of the recording.
    pub dataset: String,
    /// How far the gap closes.
    pub gap: Gap,
    /// Where the gap lies.
    #[serde(rename = "where")]
    pub location: Location,
    /// Which effects explain it: all of the catalogue, best first.
    pub effects: Vec<EffectReport>,
    /// The answer.
    pub verdict: Verdict,
    /// What to record next.
    pub next_experiment: NextExperiment,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// A diagnosis and the results that it rests on.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Outcome {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The corrected model; without parts if nothing is corrected.
    pub model: Model,
    /// Standard deviations of the parameters of `model`, effect by effect.
    pub sd: Vec<f64>,
    /// The corrected model's field per rest point (N/m), at the contact threshold [`Gap::threshold`].
    pub field: Vec<f64>,
    /// The sequences that check the models: those of the test split, or the part of them that was not fitted to.
    pub checked: Vec<Motion>,
    /// Residuals of the nominal model on `checked`.
    pub nominal: Residuals,
    /// Residuals of the corrected model on `checked`.
    pub corrected: Residuals,
    /// The recording in the contact in which effects were looked for.
    ///
    /// That is the given contact, or the one of [`Campaign::with_suited_fields`] if effects cannot be told from it. If
    /// halves of test sequences were fitted, the recording is split accordingly.
    pub campaign: Campaign,
    /// Whether the cause is unknown because what the named effects leave persists, or because the test sequences contradict
    /// the answer that there is none, and no sensor, sign or place is at fault.
    pub(crate) open: bool,
    /// Whether the corrected model closes some of the gap in 95 % of the draws of its test sequences.
    pub(crate) surely_closes: bool,
}

/// Whether a model with this mean error leaves no gap; `noise_floor` is the error of a perfect model.
pub(crate) fn is_perfect(error: f64, noise_floor: f64) -> bool {
    error <= PERFECT * noise_floor
}

impl Outcome {
    /// Whether a gap is left, and the answer is not that no known effect explains it.
    pub(crate) fn is_open(&self) -> bool {
        let gap = &self.diagnosis.gap;
        let perfect = is_perfect(gap.test_error_nominal, gap.noise_floor);
        let unknown = self.diagnosis.verdict.kind == VerdictKind::Unknown && !self.open;
        !perfect && gap.closed_fraction < MOSTLY && !unknown
    }

    /// Whether effects are named and the corrected model closes the gap surely, and most of it.
    pub(crate) fn explains(&self) -> bool {
        let Diagnosis { verdict, gap, .. } = &self.diagnosis;
        let closes = gap.closed_fraction >= MOSTLY && self.surely_closes;
        verdict.kind == VerdictKind::Effects && closes
    }

    /// Takes what halves of the test sequences show, instead of what whole ones did not; the other effects are kept.
    pub(crate) fn in_place_of(mut self, whole: Self) -> Self {
        let d = &mut self.diagnosis;
        let mut others = whole.diagnosis.effects;
        others.retain(|e| d.effects.iter().all(|own| own.effect != e.effect));
        let left = 1.0 - d.verdict.probability;
        others.iter_mut().for_each(|e| e.probability *= left);
        d.effects.extend(others);
        // Both were looked for in that contact.
        let mut or_threshold = whole.diagnosis.verdict.or_threshold;
        if !or_threshold.is_empty() {
            d.notes
                .splice(..0, whole.diagnosis.notes.into_iter().take(1));
        }
        or_threshold.retain(|e| !d.verdict.effects.contains(e));
        d.verdict.leave_open(&or_threshold);
        d.verdict.or_threshold = or_threshold;
        d.notes.push(format!(
            "with {} the first halves of the test sequences are fitted, too: where the object lies in a sequence, no other \
             sequence tells. Errors, and what is closed, are those of the second halves, of effects that are not named \
             those of whole sequences",
            d.verdict.effects.join(" and ")
        ));
        self
    }
}

impl EffectReport {
    /// Whether the effect may be what the stiffness field shows.
    pub fn is_like_field(&self) -> bool {
        self.ambiguous_with.iter().any(|w| w == STIFFNESS_FIELD)
    }

    /// For an effect that the search looked at: its gain over the log evidence `base`.
    pub(crate) fn of(
        campaign: &Campaign,
        candidate: &Candidate,
        base: f64,
        probabilities: &[(String, f64)],
    ) -> Self {
        let effect = candidate.effect.as_ref();
        let mut report = Self {
            probability: (probabilities.iter())
                .find(|(name, _)| name == effect.name())
                .map_or(0.0, |(_, p)| *p),
            score: candidate.score(base),
            ..Self::empty(effect)
        };
        if let Some(refined) = &candidate.refined {
            report.estimate(campaign, effect, refined, 0..refined.theta.len());
            report.roughness = Some(Roughness {
                contact: refined.spread.contact,
                joint: refined.spread.joint,
                walk: refined.spread.walk,
            });
        }
        report
    }

    /// For an effect that the recording cannot show.
    pub(crate) fn untestable(effect: &dyn Effect, reason: &str) -> Self {
        Self {
            testable: false,
            reason: Some(reason.to_owned()),
            ..Self::empty(effect)
        }
    }

    fn empty(effect: &dyn Effect) -> Self {
        Self {
            effect: effect.name().to_owned(),
            summary: effect.summary().to_owned(),
            probability: 0.0,
            score: 0.0,
            null_score: None,
            parameters: Vec::new(),
            undetermined: Vec::new(),
            at_bound: Vec::new(),
            shapes_at_bound: Vec::new(),
            joints: Vec::new(),
            test_error: None,
            closed_fraction: None,
            test_score: None,
            absorbed_share: None,
            roughness: None,
            ambiguous_with: Vec::new(),
            shows_from: Vec::new(),
            testable: true,
            reason: None,
        }
    }

    /// Sets the results on the test sequences.
    pub(crate) fn check(&mut self, checked: &Checked) {
        self.test_error = Some(checked.residuals.mean_error());
        self.closed_fraction = Some(checked.closure.fraction);
        self.test_score = Some(checked.foretold);
    }

    /// Sets the parameters of effects that are named together to their joint estimates.
    pub(crate) fn together(&mut self, campaign: &Campaign, named: &Refined) {
        for (effect, own) in named.model.places() {
            if effect.name() == self.effect {
                self.estimate(campaign, effect.as_ref(), named, own);
            }
        }
    }

    /// Takes the effect's parameters from those of a model, with the joints on which they show the effect to act.
    fn estimate(
        &mut self,
        campaign: &Campaign,
        effect: &dyn Effect,
        model: &Refined,
        places: Range<usize>,
    ) {
        let own = effect.parameters(&campaign.site);
        let [theta, sd, prior_sd] =
            [&model.theta, &model.sd, &model.prior.sd].map(|of| &of[places.clone()]);
        let undetermined = own.iter().zip(places.clone());
        self.undetermined = undetermined
            .filter(|(_, place)| model.is_undetermined(*place))
            .map(|(p, _)| p.name.clone())
            .collect();
        let stopped = model.at_bounds_among(places).into_iter();
        self.at_bound = stopped.map(str::to_owned).collect();
        let at_bound = |(p, t): &(&Parameter, &f64)| {
            p.role == Role::Shape && !self.undetermined.contains(&p.name) && is_stopped(p, **t)
        };
        let shapes = own.iter().zip(theta).filter(at_bound);
        self.shapes_at_bound = shapes.map(|(p, _)| p.name.clone()).collect();
        let amplitudes = || {
            let all = own.iter().zip(theta).zip(sd);
            all.filter(|((p, _), _)| p.role == Role::Amplitude)
        };
        self.joints.clear();
        for ((p, v), sd) in amplitudes() {
            let same = amplitudes().filter(|((q, _), _)| q.unit == p.unit);
            let largest = same.fold(0.0_f64, |most, ((_, v), _)| most.max(v.abs()));
            let from = if v.abs() < SMALL * largest {
                SHOWS_SMALL
            } else {
                SHOWS
            };
            let shows = *v != 0.0 && v.abs() > from * sd;
            if let Some(j) = p.joint.filter(|_| shows) {
                let name = campaign.site.robot.joints()[j].name().to_owned();
                if !self.joints.contains(&name) {
                    self.joints.push(name);
                }
            }
        }
        let estimate = |((p, v), sd): ((Parameter, &f64), &f64)| ParameterEstimate {
            name: p.name,
            value: *v,
            sd: *sd,
            unit: p.unit.to_owned(),
        };
        // Those that may not act are no part of the model.
        let all = own.into_iter().zip(theta).zip(sd).zip(prior_sd);
        let part = all.filter(|(((p, _), _), prior)| p.role == Role::Shape || **prior != 0.0);
        self.parameters = part.map(|(of, _)| estimate(of)).collect();
    }
}

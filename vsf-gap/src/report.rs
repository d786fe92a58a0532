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

/// Stands for the stiffness field among what effects are not told from.
pub const STIFFNESS_FIELD: &str = "stiffness_field";

/// Effects that close this share of the gap explain it, however rough the rest.
pub(crate) const MOSTLY: f64 = 0.5;
/// A model whose error is no more than this many times that of a perfect one leaves no gap.
const PERFECT: f64 = 1.1;

/// From so many deviations on, a parameter shows that its effect acts on a joint: one of seven on which it does not act comes
/// so far in one case of twenty. Parameters below a share of the largest of the effect take more.
const SHOWS: f64 = 2.7;
const SMALL: f64 = 0.05;
const SHOWS_SMALL: f64 = 5.0;

/// A parameter of an effect, estimated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(expecting = "a parameter, an object")]
pub struct ParameterEstimate {
    /// Name of the parameter.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation; 0 where a file gives none.
    #[serde(rename = "std", default)]
    pub sd: f64,
    /// Its unit, `1` of numbers without one.
    pub unit: String,
}

/// What the diagnosis says about one effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectReport {
    /// Its name.
    pub effect: String,
    /// What it is, and what its parameters are, in one phrase.
    #[serde(default)]
    pub summary: String,
    /// Probability that it acts.
    pub probability: f64,
    /// Gain of log evidence over the nominal model (nats); of effects that were not fitted, to first
    /// order.
    pub score: f64,
    /// The score (nats) that is reached where nothing acts: a constant of the effect, settled on other recordings; higher where
    /// contact is rough, or where the effect generalizes another one. Probabilities follow what the score is above it; to be named alone takes some 8 to 10
    /// nats more. `null` where it was not fitted.
    #[serde(default)]
    pub null_score: Option<f64>,
    /// Its parameters, in the corrected model if it is part of it; empty for effects that were not
    /// fitted.
    pub parameters: Vec<ParameterEstimate>,
    /// Names of the parameters of which the recording says next to nothing: their deviations are more than nine tenths of
    /// what is taken for plausible before any reading.
    #[serde(default)]
    pub undetermined: Vec<String>,
    /// Names of the amplitudes that stopped at a bound of what is plausible: the effect may stand for something else.
    #[serde(default)]
    pub at_bound: Vec<String>,
    /// Names of the shapes that are determined and lie at a bound of what is plausible, beyond which the data may want them:
    /// their deviations tell of the inner side alone.
    #[serde(default)]
    pub shapes_at_bound: Vec<String>,
    /// Joints with a parameter that is at least 2.7 deviations from zero; five, if it is less than a twentieth of the
    /// largest of the effect.
    pub joints: Vec<String>,
    /// Mean error of the test sequences with it (N m or N); `null` for all but the likeliest and those that were up to be
    /// named.
    pub test_error: Option<f64>,
    /// Share of the gap that it closes on the test sequences.
    pub closed_fraction: Option<f64>,
    /// How much likelier it makes the test sequences than the nominal model does, both fitted to the train sequences, which
    /// leave its parameters uncertain (nats); `null` where the error is.
    #[serde(default)]
    pub test_score: Option<f64>,
    /// Share of its information that the stiffness absorbs, 0 to 1.
    pub absorbed_share: Option<f64>,
    /// What the model with it leaves unexplained; `null` where it was not fitted.
    pub roughness: Option<Roughness>,
    /// What these recordings cannot tell from it: effects, and [`STIFFNESS_FIELD`] where it explains, with one
    /// stiffness everywhere, what a field explains that differs from place to place.
    pub ambiguous_with: Vec<String>,
    /// How large it has to be for the recording to show it, by amplitude, the one that shows best first; empty where
    /// another contact threshold does as much ([`Verdict::or_threshold`]).
    #[serde(default)]
    pub shows_from: Vec<Limit>,
    /// Whether the recording can show it.
    pub testable: bool,
    /// Why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Unexplained torques that persist, as shares of what is measured; lattice values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Roughness {
    /// Of the force in contact, and as large a share of 0.1 m of the place where it acts.
    pub contact: f64,
    /// Of each joint's RMS torque.
    pub joint: f64,
    /// Of the random walk that an effect may stray by ([`crate::RandomWalk`]).
    #[serde(default)]
    pub walk: f64,
}

/// Errors before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Gap {
    /// Mean error of the nominal model on the test sequences (N m or N).
    pub test_error_nominal: f64,
    /// That of the corrected model.
    pub test_error_corrected: f64,
    /// Mean error of a perfect model, by the noise of the train sequences.
    pub noise_floor: f64,
    /// Whether it is at most that: read in contact, for want of readings in the air other than zero, whose changes from one sample to the next count as noise.
    #[serde(default)]
    pub noise_floor_is_bound: bool,
    /// Share of the gap that the corrected model closes.
    pub closed_fraction: f64,
    /// Interval of that share, 95 %, by drawing stretches of the test sequences anew, the fitted model given: how
    /// sure these recordings are of it, not how it comes out in another touch. Beyond 0 and 1 where the gap is hardly larger
    /// than the noise.
    pub closed_interval: [f64; 2],
    /// Unit of the errors.
    pub unit: String,
    /// Effects of the corrected model; none where nothing is corrected.
    #[serde(default)]
    pub corrected_by: Vec<String>,
    /// Mean errors of the samples in which nothing is touched at either threshold; `null` without such ones.
    #[serde(default)]
    pub free: Option<MeanErrors>,
    /// The same of those in which something is.
    #[serde(default)]
    pub contact: Option<MeanErrors>,
    /// Whether errors are of fields as they are estimated outside of a diagnosis ([`Campaign::estimated`]); else of the
    /// diagnosis' own, as where nothing is touched or test sequences were learned from.
    #[serde(default)]
    pub estimated: bool,
    /// Whether there are no test sequences: errors are those of the fit itself, on the one sequence that there is.
    #[serde(default)]
    pub in_sample: bool,
    /// Contact threshold (m) of the corrected model's field; `null` in free air.
    #[serde(default)]
    pub threshold: Option<f64>,
    /// That of the nominal model's field: the corrected model's or the one that suits the points, whichever predicts better.
    #[serde(default)]
    pub threshold_nominal: Option<f64>,
}

/// Mean errors of some of the samples that check the models.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MeanErrors {
    /// Of the nominal model (N m or N).
    pub nominal: f64,
    /// Of the corrected one.
    pub corrected: f64,
    /// How many samples these are.
    pub samples: usize,
}

/// A diagnosis, as `vsf diagnose --json` writes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Diagnosis {
    /// Version of this form, 1.
    pub schema: u32,
    /// Name of the recording.
    pub dataset: String,
    /// How far.
    pub gap: Gap,
    /// Where.
    #[serde(rename = "where")]
    pub location: Location,
    /// Which: all of the catalogue, best first.
    pub effects: Vec<EffectReport>,
    /// The answer.
    pub verdict: Verdict,
    /// What to record next.
    pub next_experiment: NextExperiment,
    /// What a reader should know.
    pub notes: Vec<String>,
}

/// A diagnosis and what it rests on.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Outcome {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The corrected model; without parts when nothing is corrected.
    pub model: Model,
    /// Standard deviations of its parameters, effect by effect.
    pub sd: Vec<f64>,
    /// The corrected model's field per rest point (N/m), at the contact threshold [`Gap::threshold`].
    pub field: Vec<f64>,
    /// The sequences that check the models: those of the test split, or what of them was not fitted to.
    pub checked: Vec<Motion>,
    /// Residuals of the nominal model there.
    pub nominal: Residuals,
    /// Residuals of the corrected model there.
    pub corrected: Residuals,
    /// The recording in the contact that effects were looked for in: the given one, or that of
    /// [`Campaign::with_suited_fields`] where effects are not told from it; as it was split, where halves of test
    /// sequences were fitted.
    pub campaign: Campaign,
    /// Whether the cause is unknown since what the named effects leave lasts, or the test sequences contradict that there is
    /// none, and no sensor, sign or place is at fault.
    pub(crate) open: bool,
    /// Whether the corrected model closes some of the gap in 95 % of the draws of its test sequences.
    pub(crate) surely_closes: bool,
}

/// Whether a model with this mean error leaves no gap, `noise_floor` being that of a perfect one.
pub(crate) fn is_perfect(error: f64, noise_floor: f64) -> bool {
    error <= PERFECT * noise_floor
}

impl Outcome {
    /// Whether a gap is left, of which it is not said that nothing known explains it.
    pub(crate) fn is_open(&self) -> bool {
        let gap = &self.diagnosis.gap;
        let perfect = is_perfect(gap.test_error_nominal, gap.noise_floor);
        let unknown = self.diagnosis.verdict.kind == VerdictKind::Unknown && !self.open;
        !perfect && gap.closed_fraction < MOSTLY && !unknown
    }

    /// Whether effects are named, and the corrected model surely closes, and closes most of, the gap.
    pub(crate) fn explains(&self) -> bool {
        let Diagnosis { verdict, gap, .. } = &self.diagnosis;
        let closes = gap.closed_fraction >= MOSTLY && self.surely_closes;
        verdict.kind == VerdictKind::Effects && closes
    }

    /// What halves of the test sequences show, instead of what whole ones did not, with the other effects.
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
    /// Whether it may be what the stiffness field shows.
    pub fn is_like_field(&self) -> bool {
        self.ambiguous_with.iter().any(|w| w == STIFFNESS_FIELD)
    }

    /// Of an effect that the search looked at: what it gains over the log evidence `base`.
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

    /// Of an effect that the recording cannot show.
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

    /// Takes how it does on the test sequences.
    pub(crate) fn check(&mut self, checked: &Checked) {
        self.test_error = Some(checked.residuals.mean_error());
        self.closed_fraction = Some(checked.closure.fraction);
        self.test_score = Some(checked.foretold);
    }

    /// Of effects that are named together, parameters are those that they have together.
    pub(crate) fn together(&mut self, campaign: &Campaign, named: &Refined) {
        for (effect, own) in named.model.places() {
            if effect.name() == self.effect {
                self.estimate(campaign, effect.as_ref(), named, own);
            }
        }
    }

    /// Takes its parameters out of those of a model, and the joints that they show the effect to act on.
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

use crate::closure::{Residuals, closure, noise_norm};
use crate::effect::{EVIDENT, check_effect};
use crate::evidence::{Factor, Normal, Spread};
use crate::locate::{Where, locate};
use crate::next::{NextExperiment, next_experiment};
use crate::nominal::Fitted;
use crate::refine::Refined;
use crate::screen::{Screened, Tangent, best_of, log_mean_exp, screen};
use crate::verdict::{Hypothesis, Nominal, Verdict, judge, needed_beside, threshold};
use crate::windows::Windows;
use crate::{Acts, Campaign, Effect, GapError, Model, Motion, Parameter, Role};
use faer::Mat;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Fewest samples of a window that contact is run through.
const PER_WINDOW: usize = 5;
/// Effects that are fitted together with the field after screening.
const FINALISTS: usize = 6;
/// Second effects that are tried beside the best one.
const SECONDS: usize = 2;
/// An effect that screening puts so far below the best (nats) is no finalist.
const HOPELESS: f64 = 400.0;
/// Effects that close this share of the gap explain it, however rough the rest.
const MOSTLY: f64 = 0.5;
/// A model whose error is no more than this many times that of a perfect one leaves no gap.
const PERFECT: f64 = 1.1;
/// Share of an effect's torques that another must imitate for the two to be one group.
const ALIKE: f64 = 0.9;

/// A parameter of an effect, estimated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Name of the parameter.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Its unit.
    pub unit: String,
}

/// What the diagnosis says about one effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EffectReport {
    /// Its name.
    pub effect: String,
    /// Probability that it acts.
    pub probability: f64,
    /// Gain of log evidence over the nominal model (nats); of effects that were not fitted, to first
    /// order.
    pub score: f64,
    /// Its parameters, in the corrected model if it is part of it; empty for effects that were not
    /// fitted.
    pub parameters: Vec<Estimate>,
    /// Joints whose parameters are at least two deviations from zero.
    pub joints: Vec<String>,
    /// Mean error of the test sequences with it, `null` where it was not fitted (N m or N).
    pub test_error: Option<f64>,
    /// Share of the gap that it closes on the test sequences.
    pub closed_fraction: Option<f64>,
    /// Share of its information that the stiffness absorbs, 0 to 1.
    pub absorbed_share: Option<f64>,
    /// What the model with it leaves unexplained; `null` where it was not fitted.
    pub roughness: Option<Roughness>,
    /// Effects that these recordings cannot tell from it.
    pub ambiguous_with: Vec<String>,
    /// Whether the recording can show it.
    pub testable: bool,
    /// Why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
}

/// Unexplained torques that persist, as shares of what is measured; lattice values.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Roughness {
    /// Of the force in contact.
    pub contact: f64,
    /// Of each joint's RMS torque.
    pub joint: f64,
}

/// Errors before and after.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Gap {
    /// Mean error of the nominal model on the test sequences (N m or N).
    pub test_error_nominal: f64,
    /// That of the corrected model.
    pub test_error_corrected: f64,
    /// Mean error of a perfect model.
    pub noise_floor: f64,
    /// Share of the gap that the corrected model closes.
    pub closed_fraction: f64,
    /// Interval of that share, 95 %.
    pub closed_interval: [f64; 2],
    /// Unit of the errors.
    pub unit: String,
    /// Effects of the corrected model; none where nothing is corrected.
    #[serde(default)]
    pub corrected_by: Vec<String>,
}

/// A diagnosis, as `vsf diagnose --json` writes it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Diagnosis {
    /// Version of this form, 1.
    pub schema: u32,
    /// Name of the recording.
    pub dataset: String,
    /// How far.
    pub gap: Gap,
    /// Where.
    pub r#where: Where,
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
pub struct Outcome {
    /// The diagnosis.
    pub diagnosis: Diagnosis,
    /// The corrected model; without parts when nothing is corrected.
    pub model: Model,
    /// Standard deviations of its parameters, effect by effect.
    pub sd: Vec<f64>,
    /// The corrected model's field per rest point (N/m).
    pub field: Vec<f64>,
    /// Residuals of the nominal model on the test sequences.
    pub nominal: Residuals,
    /// Residuals of the corrected model there.
    pub corrected: Residuals,
}

/// One step of a diagnosis, for progress reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// The nominal model is fitted.
    Nominal,
    /// All effects are screened.
    Screen,
    /// Finalists are fitted with the field.
    Finalists,
    /// Pairs are tried.
    Pairs,
    /// Models are checked on the test sequences.
    Check,
}

impl Step {
    /// All steps in order.
    pub const ALL: [Self; 5] = [
        Self::Nominal,
        Self::Screen,
        Self::Finalists,
        Self::Pairs,
        Self::Check,
    ];
}

/// A fitted model on sequences that it was not fitted to.
struct Check {
    effects: Vec<String>,
    /// Mean error (N m or N).
    error: f64,
    /// Share of the gap that it closes.
    closed: f64,
}

struct Candidate {
    effect: Arc<dyn Effect>,
    /// What screening found at its best start, and the gain there (nats).
    found: Screened,
    screened: f64,
    refined: Option<Refined>,
}

/// Diagnoses a recording: which of the effects, if any, explains what the nominal model leaves.
/// `progress` is told each step as it begins. Time: seconds to a minute; see the guide.
///
/// # Errors
/// No train sequence, effects whose parameters or starts cannot be, rows that contact cannot take,
/// covariances that are not positive definite.
pub fn diagnose(
    campaign: &Campaign,
    name: &str,
    effects: &[Arc<dyn Effect>],
    seed: u64,
    mut progress: impl FnMut(Step),
) -> Result<Outcome, GapError> {
    if campaign.train.is_empty() {
        return Err(GapError::TooLittle {
            what: "train sequences",
            problem: "there are none; give the recording a train split".to_owned(),
        });
    }
    progress(Step::Nominal);
    let nominal = Model::default();
    let samples = campaign.train.iter().map(Motion::len).sum();
    let thinner = match campaign.test.is_empty() {
        true => 1,
        false => Windows::size(samples, campaign.site.joints()) / PER_WINDOW,
    };
    // What is fitted sees windows only; the full recording checks it.
    let (whole, campaign) = (campaign, &campaign.thinned(thinner.max(1))?);
    let mut fitted = campaign.fitted(&nominal, &campaign.train)?;
    let stiffness = fitted.best_stiffness()?;
    let field = campaign.non_negative(&fitted, &stiffness)?;
    let spreads = fitted.roughness(&stiffness);
    progress(Step::Screen);
    let mut untestable = Vec::new();
    let mut tangents: Vec<Tangent> = Vec::new();
    for effect in effects {
        match effect.untestable(campaign) {
            Some(reason) => untestable.push((effect.clone(), reason)),
            None => {
                check_effect(effect.as_ref(), &campaign.site)?;
                tangents.extend(campaign.tangents(&nominal, &fitted, &field, effect)?);
            }
        }
    }
    let torques = fitted.predicted(&field);
    let screening = screen(&fitted, &torques, &tangents, &spreads)?;
    let screened_base = log_mean_exp(&screening.nominal);
    let mut candidates = best_starts(&tangents, &screening.candidates, screened_base);
    let smoothest = spreads[best_of(&screening.nominal)];
    // Stiffness is not negative, in any model that is compared.
    let (field, _) = campaign.field(&mut fitted, &smoothest)?;
    let without: Vec<f64> = (spreads.par_iter())
        .map(|s| fitted.log_evidence(s))
        .collect::<Result<_, _>>()?;
    let base = log_mean_exp(&without);
    let spread = spreads[best_of(&without)];

    progress(Step::Finalists);
    // What screening promises most may come to nothing: the others are measured against what it keeps.
    let refine = |candidate: &mut Candidate| {
        let tangent = &tangents[candidate.found.tangent];
        candidate.refined = Some(campaign.refined(tangent, &candidate.found, &spread)?);
        Ok::<f64, GapError>(candidate.score(base))
    };
    if let Some((first, others)) = candidates.split_first_mut() {
        let leader = refine(first)?;
        (others.par_iter_mut().enumerate()).try_for_each(|(rank, candidate)| {
            let moves = candidate.effect.acts() == Acts::Contact;
            let near = candidate.screened > leader - HOPELESS;
            if near && (rank + 1 < FINALISTS || moves && leader < HOPELESS) {
                refine(candidate)?;
            }
            Ok::<(), GapError>(())
        })?;
    }
    best_first(&mut candidates, base);

    progress(Step::Pairs);
    let mut pair = campaign.pair(&tangents, &mut candidates, base, &spread)?;
    best_first(&mut candidates, base);
    if !fitted.touches() {
        let models = candidates.iter_mut().filter_map(|c| c.refined.as_mut());
        for refined in models.chain(&mut pair) {
            campaign.settle(refined)?;
        }
    }

    progress(Step::Check);
    let alone = |name: &str| {
        let of = candidates.iter().find(|c| c.effect.name() == name)?;
        Some(of.refined.as_ref()?.log_evidence - base)
    };
    let mut hypotheses: Vec<Hypothesis<'_>> = (candidates.iter())
        .filter_map(|c| c.refined.as_ref())
        .chain(&pair)
        .map(|refined| Hypothesis::new(refined, base, spread.contact, alone))
        .collect();
    let likeness = likeness(&fitted, &tangents, &candidates, &spread)?;
    let checked = match whole.test.is_empty() {
        true => &whole.train,
        false => &whole.test,
    };
    let all: Vec<&Motion> = checked.iter().collect();
    let noise = &whole.noise;
    let floor = noise_norm(noise);
    let before = whole.residuals(&nominal, &field, &all)?;
    let mut notes = Vec::new();
    if campaign.test.is_empty() {
        notes.push("there is one sequence only: errors are those of the fit itself".to_owned());
    }
    if let Some(last) = campaign.test.first().filter(|_| campaign.held_out) {
        notes.push(format!(
            "there is no test split: sequence {} is held out",
            last.id
        ));
    }
    let nominally = Nominal {
        spread,
        touches: fitted.touches(),
        left: unexplained(&fitted, &field),
        perfect: before.mean_error() <= PERFECT * floor,
    };
    let (mut model, mut after, mut corrected_field) = (nominal.clone(), before.clone(), field);
    let mut sd = Vec::new();
    let mut checks: Vec<Check> = Vec::new();
    // What is named has to stand the check: all but the last have failed it, or all if nothing is named.
    let judged = loop {
        let judged = judge(&hypotheses, &nominally);
        let Some(i) = judged.named else { break judged };
        let refined = hypotheses[i].refined;
        let (field, residuals) = campaign.checked(&refined.model, &refined.spread, whole, &all)?;
        let error = residuals.mean_error();
        let worse = error > before.mean_error();
        let closed = closure(&before, &residuals, noise, checked, seed).fraction;
        let stands = hypotheses[i].stands(closed, worse);
        checks.push(Check {
            effects: judged.verdict.effects.clone(),
            error,
            closed,
        });
        if !worse && stands {
            (model, after, corrected_field) = (refined.model.clone(), residuals, field);
            sd.clone_from(&refined.sd);
            break judged;
        }
        if stands {
            let (which, then) = (judged.verdict.effects.join(" and "), before.mean_error());
            notes.push(format!(
                "with {which} the test sequences are predicted worse ({error:.3} instead of {then:.3}): \
                 the corrected model is the nominal one"
            ));
            break judged;
        }
        hypotheses.remove(i);
    };
    let closed = closure(&before, &after, noise, checked, seed);
    let aside = &checks[..checks.len() - usize::from(judged.named.is_some())];
    let mut verdict = judged.verdict;
    if verdict.effects.is_empty() && nominally.contradicts() {
        notes.push(format!(
            "no stiffness explains what is felt in contact: the best one leaves {:.0} % of its energy; check \
             the sign and the unit of the torques, base_pose and points",
            100.0 * nominally.left
        ));
    }
    if closed.fraction >= MOSTLY {
        verdict.explain();
    }
    if !aside.is_empty() {
        let all = (aside.iter()).map(|c| format!("{} ({:.3})", c.effects.join(" and "), c.error));
        notes.push(format!(
            "left aside, since the test sequences do not bear them out enough for what they gain on the \
             train sequences: {}; test error without them {:.3}",
            all.collect::<Vec<_>>().join(", "),
            before.mean_error()
        ));
    }
    // Not borne out is not ruled out.
    for effect in aside.iter().flat_map(|c| &c.effects) {
        if !verdict.effect_set_95.contains(effect) {
            verdict.effect_set_95.push(effect.clone());
        }
    }
    let r#where = locate(
        whole,
        &model,
        &corrected_field,
        &before,
        checked,
        noise,
        seed,
    )?;
    let bare = Spread {
        point: 0.0,
        smooth: 0.0,
        level: 0.0,
        ..spread
    };
    let factor = |spread: &Spread| fitted.parts.factor(spread).ok();
    let factors = factor(&spread).zip(factor(&bare));
    let mut reports = Vec::new();
    for candidate in &candidates {
        let mut report = campaign.report(candidate, &tangents, base, &judged.probabilities);
        if let Some(refined) = candidate.refined.as_ref().filter(|_| reports.len() < 3) {
            let known = checks
                .iter()
                .find(|c| c.effects == [report.effect.as_str()]);
            let (error, closed) = match known {
                Some(check) => (check.error, check.closed),
                None => {
                    let (_, residuals) =
                        campaign.checked(&refined.model, &refined.spread, whole, &all)?;
                    let closed = closure(&before, &residuals, noise, checked, seed).fraction;
                    (residuals.mean_error(), closed)
                }
            };
            (report.test_error, report.closed_fraction) = (Some(error), Some(closed));
        }
        // Of effects that are named together, parameters are those that they have together.
        let mut of_part = 0;
        for (effect, theta) in &model.parts {
            let own = of_part..of_part + theta.len();
            of_part = own.end;
            if effect.name() == report.effect {
                (report.parameters, report.joints) =
                    campaign.estimates(effect.as_ref(), theta, &sd[own]);
            }
        }
        report.absorbed_share =
            (factors.as_ref()).and_then(|f| absorbed(f, &tangents[candidate.found.tangent]));
        report.ambiguous_with = (likeness.iter())
            .filter(|(a, _, share)| a == candidate.effect.name() && *share > ALIKE)
            .map(|(_, b, _)| b.clone())
            .collect();
        reports.push(report);
    }
    reports.sort_by(|a, b| {
        let fitted = |r: &EffectReport| r.roughness.is_some();
        (fitted(b).cmp(&fitted(a))).then(b.probability.total_cmp(&a.probability))
    });
    reports.extend(untestable.into_iter().map(|(effect, reason)| EffectReport {
        effect: effect.name().to_owned(),
        probability: 0.0,
        score: 0.0,
        parameters: Vec::new(),
        joints: Vec::new(),
        test_error: None,
        closed_fraction: None,
        absorbed_share: None,
        roughness: None,
        ambiguous_with: Vec::new(),
        testable: false,
        reason: Some(reason),
    }));
    let next_experiment = next_experiment(&verdict, &reports);
    Ok(Outcome {
        diagnosis: Diagnosis {
            schema: 1,
            dataset: name.to_owned(),
            gap: Gap {
                test_error_nominal: before.mean_error(),
                test_error_corrected: after.mean_error(),
                noise_floor: floor,
                closed_fraction: closed.fraction,
                closed_interval: closed.interval,
                unit: campaign.scene.error_unit().to_owned(),
                corrected_by: (model.parts.iter())
                    .map(|(effect, _)| effect.name().to_owned())
                    .collect(),
            },
            r#where,
            effects: reports,
            verdict,
            next_experiment,
            notes,
        },
        model,
        sd,
        field: corrected_field,
        nominal: before,
        corrected: after,
    })
}

impl Candidate {
    /// Gain of log evidence (nats); in screening if it was not fitted.
    fn score(&self, base: f64) -> f64 {
        match &self.refined {
            Some(refined) => refined.log_evidence - base,
            None => self.screened,
        }
    }
}

/// Sorts candidates by what they gain; those that were fitted come before the others.
fn best_first(candidates: &mut [Candidate], base: f64) {
    candidates.sort_by(|a, b| {
        let fitted = |c: &Candidate| c.refined.is_some();
        (fitted(b).cmp(&fitted(a))).then(b.score(base).total_cmp(&a.score(base)))
    });
}

/// The best start of every effect, best first.
fn best_starts(tangents: &[Tangent], screened: &[Screened], base: f64) -> Vec<Candidate> {
    let mut best: Vec<Candidate> = Vec::new();
    for s in screened {
        let effect = &tangents[s.tangent].effect;
        let gain = s.log_evidence - base;
        match best.iter_mut().find(|c| c.effect.name() == effect.name()) {
            Some(c) if c.screened >= gain => {}
            Some(c) => (c.screened, c.found) = (gain, s.clone()),
            None => best.push(Candidate {
                effect: effect.clone(),
                found: s.clone(),
                screened: gain,
                refined: None,
            }),
        }
    }
    best.sort_by(|a, b| b.screened.total_cmp(&a.screened));
    best
}

impl Campaign {
    /// The nominal model with one effect, fitted from what screening found of it.
    fn refined(
        &self,
        tangent: &Tangent,
        found: &Screened,
        spread: &Spread,
    ) -> Result<Refined, GapError> {
        let start = self.start(&Model::default(), tangent, found, spread)?;
        self.refine(&start, tangent.prior(&self.site), &found.spread)
    }

    /// The best model of two effects, the best single one and another, if the other earns it. Others
    /// that it takes are fitted alone as well, if they are not yet.
    fn pair(
        &self,
        tangents: &[Tangent],
        candidates: &mut [Candidate],
        base: f64,
        nominal: &Spread,
    ) -> Result<Option<Refined>, GapError> {
        let Some((leader, rest)) = candidates.split_first_mut() else {
            return Ok(None);
        };
        let first = &tangents[leader.found.tangent];
        let Some(best) = leader
            .refined
            .as_ref()
            .filter(|r| r.log_evidence - base > EVIDENT)
        else {
            return Ok(None);
        };
        let fitted = self.fitted(&best.model, &self.train)?;
        let mut others = Vec::new();
        for candidate in &*rest {
            let effect = &candidate.effect;
            others.extend(self.tangents(&best.model, &fitted, &best.stiffness, effect)?);
        }
        let torques = fitted.predicted(&best.stiffness);
        let screening = screen(&fitted, &torques, &others, &fitted.roughness(&best.spread))?;
        let without = log_mean_exp(&screening.nominal);
        let mut seconds = best_starts(&others, &screening.candidates, without);
        seconds.retain(|c| c.screened > EVIDENT);
        seconds.truncate(SECONDS);
        let mut found: Option<Refined> = None;
        for second in seconds {
            let tangent = &others[second.found.tangent];
            let start = self.start(&best.model, tangent, &second.found, &best.spread)?;
            let prior = first.prior(&self.site).and(tangent.prior(&self.site));
            let refined = self.refine(&start, prior, &best.spread)?;
            let needed = needed_beside(
                tangent.effect.as_ref(),
                best.log_evidence - base,
                nominal.contact,
            );
            if refined.log_evidence - best.log_evidence <= needed {
                continue;
            }
            // Backward: the second on its own must not do as well.
            let name = tangent.effect.name();
            if let Some(alone) = rest.iter_mut().find(|c| c.effect.name() == name) {
                if alone.refined.is_none() {
                    let tangent = &tangents[alone.found.tangent];
                    alone.refined = Some(self.refined(tangent, &alone.found, nominal)?);
                }
                let gained = refined.log_evidence - base - alone.score(base);
                if gained <= threshold(first.effect.as_ref(), nominal.contact) {
                    continue;
                }
            }
            if (found.as_ref()).is_none_or(|f| f.log_evidence < refined.log_evidence) {
                found = Some(refined);
            }
        }
        Ok(found)
    }

    /// The field of a model, fitted to the train sequences, and its residuals on sequences of the
    /// whole recording.
    fn checked(
        &self,
        model: &Model,
        spread: &Spread,
        whole: &Self,
        on: &[&Motion],
    ) -> Result<(Vec<f64>, Residuals), GapError> {
        let mut fitted = self.fitted(model, &self.train)?;
        let (field, _) = self.field(&mut fitted, spread)?;
        let residuals = whole.residuals(model, &field, on)?;
        Ok((field, residuals))
    }

    /// The parameters of an effect, and the joints that they show it to act on.
    fn estimates(
        &self,
        effect: &dyn Effect,
        theta: &[f64],
        sd: &[f64],
    ) -> (Vec<Estimate>, Vec<String>) {
        let own = effect.parameters(&self.site);
        let mut joints: Vec<String> = Vec::new();
        for ((p, v), sd) in own.iter().zip(theta).zip(sd) {
            let shows = p.role == Role::Amplitude && *v != 0.0 && v.abs() > 2.0 * sd;
            if let Some(j) = p.joint.filter(|_| shows) {
                let name = self.site.robot.joints()[j].name().to_owned();
                if !joints.contains(&name) {
                    joints.push(name);
                }
            }
        }
        let estimate = |((p, v), sd): ((Parameter, &f64), &f64)| Estimate {
            name: p.name,
            value: *v,
            std: *sd,
            unit: p.unit.to_owned(),
        };
        let all = own.into_iter().zip(theta).zip(sd).map(estimate).collect();
        (all, joints)
    }

    fn report(
        &self,
        candidate: &Candidate,
        tangents: &[Tangent],
        base: f64,
        probabilities: &[(String, f64)],
    ) -> EffectReport {
        let effect = &tangents[candidate.found.tangent].effect;
        let (parameters, joints) = match &candidate.refined {
            Some(refined) => self.estimates(effect.as_ref(), &refined.theta, &refined.sd),
            None => Default::default(),
        };
        let name = effect.name();
        EffectReport {
            effect: name.to_owned(),
            probability: (probabilities.iter())
                .find(|(n, _)| n == name)
                .map_or(0.0, |(_, p)| *p),
            score: candidate.score(base),
            parameters,
            joints,
            test_error: None,
            closed_fraction: None,
            absorbed_share: None,
            roughness: candidate.refined.as_ref().map(|r| Roughness {
                contact: r.spread.contact,
                joint: r.spread.joint,
            }),
            ambiguous_with: Vec::new(),
            testable: true,
            reason: None,
        }
    }
}

/// Share of the energy of the readings that a field leaves.
fn unexplained(fitted: &Fitted<'_>, field: &[f64]) -> f64 {
    let energy = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let predicted = fitted.predicted(field);
    let left: Vec<f64> = (fitted.readings.iter().zip(&predicted))
        .map(|(y, p)| y - p)
        .collect();
    energy(&left) / energy(&fitted.readings).max(f64::MIN_POSITIVE)
}

/// The share of an effect's information that the field absorbs: what is left of its tangents,
/// beside what they would tell were the stiffness known; by the factors of both covariances.
fn absorbed((free, known): &(Factor, Factor), tangent: &Tangent) -> Option<f64> {
    let columns = &tangent.columns;
    let n = columns.first().map_or(0, Vec::len);
    let information = |factor: &Factor| {
        let mut all = Mat::from_fn(n, columns.len(), |i, k| columns[k][i] * tangent.sd[k]);
        factor.whiten(&mut all);
        (0..columns.len())
            .map(|k| all.col_as_slice(k).iter().map(|v| v * v).sum::<f64>())
            .sum::<f64>()
    };
    if columns.is_empty() {
        return None;
    }
    let (left, whole) = (information(free), information(known));
    (whole > 0.0).then(|| (1.0 - left / whole).clamp(0.0, 1.0))
}

/// For every pair of fitted effects, the share of the first one's torques that the second can
/// imitate, the field being free.
fn likeness(
    fitted: &Fitted<'_>,
    tangents: &[Tangent],
    candidates: &[Candidate],
    spread: &Spread,
) -> Result<Vec<(String, String, f64)>, GapError> {
    let factor = fitted.parts.factor(spread)?;
    let n = fitted.readings.len();
    let finalists: Vec<&Candidate> = candidates.iter().filter(|c| c.refined.is_some()).collect();
    // Torques of the effect as fitted, and whitened tangents around there.
    let mut white = Vec::new();
    for candidate in &finalists {
        let Some(refined) = &candidate.refined else {
            continue;
        };
        let parameters = tangents[candidate.found.tangent].amplitudes.clone();
        let columns = &refined.tangent;
        let mut all = Mat::from_fn(n, columns.len() + 1, |i, k| match k {
            0 => parameters
                .iter()
                .map(|&p| columns[p][i] * refined.theta[p])
                .sum(),
            k => columns[k - 1][i],
        });
        factor.whiten(&mut all);
        white.push((candidate.effect.name().to_owned(), all));
    }
    let mut pairs = Vec::new();
    for (a, of_a) in &white {
        for (b, of_b) in white.iter().filter(|(b, _)| a != b) {
            let signal = of_a.col_as_slice(0);
            let whole: f64 = signal.iter().map(|v| v * v).sum();
            let columns: Vec<&[f64]> = (1..of_b.ncols()).map(|k| of_b.col_as_slice(k)).collect();
            let normal = Normal::new(signal, &columns);
            let ridge = 1e-9 * normal.information.trace().max(f64::MIN_POSITIVE);
            let damped = &normal.information
                + nalgebra::DMatrix::identity(columns.len(), columns.len()) * ridge;
            let explained = damped
                .cholesky()
                .map_or(0.0, |f| normal.score.dot(&f.solve(&normal.score)));
            if whole > 0.0 {
                pairs.push((a.clone(), b.clone(), (explained / whole).clamp(0.0, 1.0)));
            }
        }
    }
    Ok(pairs)
}

use crate::alike::Likeness;
use crate::closure::noise_norm;
use crate::doubts::{Case, Doubts};
use crate::effect::Arm;
use crate::enough::enough;
use crate::estimated::Extent;
use crate::halves::is_of_sequences;
use crate::judge::{Nominal, hidden_weight};
use crate::locate::locate;
use crate::next::next_experiment;
use crate::notes::{closest, few_rows, of_search};
use crate::plain::Plain;
use crate::report::{Diagnosis, EffectReport, Outcome, STIFFNESS_FIELD, is_perfect};
use crate::report_file::SCHEMA;
use crate::search::Search;
use crate::trial::{Judgment, Trial};
use crate::verdict::Answer;
use crate::{Campaign, Effect, GapError, Model, effects};
use std::sync::Arc;

/// Number of effects whose results on the test sequences are reported, whether they were up to be named or not.
const CHECKED: usize = 3;
/// Two probabilities closer than this count as equal.
const ALIKE: f64 = 1e-6;
/// One step of a diagnosis, for progress reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum DiagnosisStep {
    /// The nominal model is fitted.
    Nominal,
    /// All effects are screened.
    Screen,
    /// Finalists are fitted with the field.
    Finalists,
    /// Several effects together are tried.
    Sets,
    /// Models are checked on the test sequences.
    Check,
    /// Effects are searched again in another contact, which explains as much.
    Contact,
    /// Fields are estimated with the corrected model and without it.
    Fields,
    /// Effects that differ from sequence to sequence are fitted with half of every test sequence.
    Halves,
}

impl DiagnosisStep {
    /// All steps in order.
    pub const ALL: [Self; 8] = [
        Self::Nominal,
        Self::Screen,
        Self::Finalists,
        Self::Sets,
        Self::Check,
        Self::Contact,
        Self::Fields,
        Self::Halves,
    ];
}

/// Diagnoses a recording: which of the effects, if any, explains what the nominal model leaves?
///
/// `progress` is called at the start of each step. `seed` is the seed of the bootstrap intervals. Prediction errors are
/// those of fields at the campaign's own contact threshold or, with [`Campaign::with_suited_fields`] (as the command does),
/// at the threshold that suits the points. Time: seconds for a few hundred touched points, minutes for thousands.
///
/// ```
/// use vsf_data::{Dataset, Overrides};
/// use vsf_gap::{Campaign, Corrector, diagnose, effects};
/// use vsf_pipeline::SceneOptions;
///
/// let (recording, _warnings) = Dataset::open("tests/data/unisa_ur10", &Overrides::default())?;
/// let campaign = Campaign::open(&recording, &SceneOptions::default())?.with_suited_fields();
/// let sought = effects::named(&["joint_coulomb_friction", "joint_viscous_friction"])?; // or `effects::catalogue()`
/// let outcome = diagnose(&campaign, &sought, 0, |_step| {})?;
/// let verdict = &outcome.diagnosis.verdict;
/// println!("{}: {}", verdict.kind, verdict.effects.join(" and "));
///
/// let corrected = outcome.model_file()?.to_json(); // what `--model corrected.json` reads
/// let found_in = &outcome.campaign; // with the contact that the model was found in
/// let corrector = Corrector::new(found_in.site(), found_in.scene(), &outcome.model)?; // the same in a control loop
/// # assert!(outcome.diagnosis.gap.test_error_corrected < outcome.diagnosis.gap.test_error_nominal);
/// # assert!(!corrected.is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// - [`GapError::TooLittle`]: no train sequence, fewer than 8 runs of 4 train samples, torques that are all zero, joints
///   that all stand still (within 1e-3 rad or m), or no effect that these data could show.
/// - [`GapError::TooMuch`]: a robot with more than 48 joints, or a split of more than 5200 sequences times joints.
/// - Effects with invalid parameters or starts, rows that contact cannot take, covariances that are not positive definite.
pub fn diagnose(
    campaign: &Campaign,
    effects: &[Arc<dyn Effect>],
    seed: u64,
    mut progress: impl FnMut(DiagnosisStep),
) -> Result<Outcome, GapError> {
    let first = attempt(campaign, effects, seed, Split::Whole, &mut progress)?;
    let own = |e: &Arc<dyn Effect>| is_of_sequences(e.as_ref(), campaign);
    if !first.is_open() || !effects.iter().any(own) {
        return Ok(first);
    }
    progress(DiagnosisStep::Halves);
    let Some(halved) = first.campaign.halved()? else {
        return Ok(first);
    };
    // What was named without explaining much competes, or belongs to it.
    let named = &first.diagnosis.verdict.effects;
    let stays = |e: &&Arc<dyn Effect>| own(e) || named.iter().any(|n| n == e.name());
    let candidates: Vec<Arc<dyn Effect>> = effects.iter().filter(stays).cloned().collect();
    let second = match attempt(&halved, &candidates, seed, Split::Halves, &mut |_| {}) {
        // Where the field is zero, say, there is nothing that effects of the place could change.
        Err(GapError::TooLittle { .. }) => return Ok(first),
        second => second?,
    };
    if second.explains() && second.model.parts.iter().any(|(e, _)| own(e)) {
        Ok(second.in_place_of(first))
    } else {
        Ok(first)
    }
}

/// How a campaign is split for a diagnosis.
#[derive(Clone, Copy, PartialEq)]
enum Split {
    /// As the recording has it.
    Whole,
    /// With first halves of test sequences among the train sequences. Only effects that close most of the gap count then.
    Halves,
}

/// The diagnosis of a campaign as it is split.
fn attempt(
    campaign: &Campaign,
    effects: &[Arc<dyn Effect>],
    seed: u64,
    split: Split,
    progress: &mut dyn FnMut(DiagnosisStep),
) -> Result<Outcome, GapError> {
    enough(campaign)?;
    // What is fitted sees windows only; the full recording checks it.
    let fewer = few_samples(campaign)?;
    let thinned = fewer.as_ref().unwrap_or(campaign);
    let search = thinned.search(effects, split == Split::Halves, progress)?;

    progress(DiagnosisStep::Check);
    let trial = Trial::new(
        campaign,
        thinned,
        &search.nominal,
        &search.field,
        &search.spread,
        seed,
    )?;
    let nominal = Nominal {
        spread: search.spread,
        touches: search.nominal.touched,
        left: search.share_left(),
        likeness: search.nominal.likeness,
        perfect: is_perfect(trial.before.mean_error(), noise_norm(&campaign.noise)),
    };
    let hypotheses = search.hypotheses(|part, whole| trial.completes(part, whole))?;
    let mut judgment = trial.judge(hypotheses, &nominal)?;
    let anew = |c: &Campaign| {
        progress(DiagnosisStep::Contact);
        attempt(c, effects, seed, split, &mut |_| {})
    };
    let of_contact = match in_other_contact(campaign, thinned, &search, &judgment, anew) {
        OtherContact::Explains(outcome) => return Ok(*outcome),
        OtherContact::Noted(note) => note,
    };

    progress(DiagnosisStep::Fields);
    let (extent, failed) = compared_fields(campaign, &trial, &judgment, &search, split, seed)?;
    let likeness = Likeness::new(&search)?;
    let case = Case {
        campaign,
        thinned,
        search: &search,
        likeness: &likeness,
        trial: &trial,
        nominal: &nominal,
    };
    let saturated = match split {
        Split::Whole => campaign.saturated()?,
        Split::Halves => Vec::new(),
    };
    let estimated = extent.estimated;
    let (doubts, compared) = Doubts::find(&case, &mut judgment, extent, saturated)?;
    let hidden = hidden(&case, &judgment.names_refused(), effects.len());
    let findings = doubts.findings(&case, &judgment, &compared, hidden);
    let answer = judgment.judged.conclude(&findings);

    let (model, sd, own_field) = match judgment.corrected() {
        Some(t) => (
            t.refined.model.clone(),
            t.refined.sd.clone(),
            t.checked.field.clone(),
        ),
        None => (Model::default(), Vec::new(), search.field.clone()),
    };
    // Doubts about the answer come first.
    let mut notes = doubts.notes(campaign, &judgment);
    if split == Split::Whole {
        notes.extend(few_rows(campaign, &model, &own_field)?);
    }
    notes.extend(of_search(
        campaign, &trial, &compared, estimated, &judgment, &answer, &nominal,
    ));
    notes.extend(closest(answer.verdict.kind, &model));
    notes.extend(of_contact);
    notes.extend(failed.map(|e| {
        format!(
            "no field could be estimated to tell errors of ({e}): they are those of the diagnosis' own fields"
        )
    }));
    let reports = reports(&case, &doubts, &judgment, &answer)?;
    let before = &compared.before.residuals;
    let surely_closes = compared.closed.least > 0.0;
    let arm = Arm::of(&campaign.site);
    Ok(Outcome {
        diagnosis: Diagnosis {
            schema: SCHEMA,
            dataset: campaign.name().to_owned(),
            gap: compared.gap(campaign, &model, estimated),
            location: locate(campaign, &model, &own_field, before, trial.sequences, seed)?,
            next_experiment: next_experiment(&answer, &reports, effects, arm),
            effects: reports,
            verdict: answer.verdict,
            notes,
        },
        model,
        sd,
        field: compared.after.field,
        checked: trial.sequences.to_vec(),
        nominal: compared.before.residuals,
        corrected: compared.after.residuals,
        campaign: campaign.clone(),
        open: answer.open,
        surely_closes,
    })
}

/// The campaign with means of several samples in place of each, so that contact runs in little time; `None` if it already
/// has few samples.
///
/// # Errors
/// None in practice: tables keep their form.
fn few_samples(campaign: &Campaign) -> Result<Option<Campaign>, GapError> {
    // Without contact there is none to run, and friction of mean speeds is not the mean of friction.
    let by = if campaign.test.is_empty() || campaign.site.rest.is_empty() {
        1
    } else {
        campaign.averaged()
    };
    (by > 1).then(|| campaign.thinned(by)).transpose()
}

/// The effect of another contact on the named effects.
enum OtherContact {
    /// It explains as much: the diagnosis in it.
    Explains(Box<Outcome>),
    /// A note about it, if there is one.
    Noted(Option<String>),
}

/// Repeats the diagnosis by `anew` in another contact if that explains as much as the named effects.
fn in_other_contact(
    campaign: &Campaign,
    thinned: &Campaign,
    search: &Search<'_>,
    judgment: &Judgment<'_>,
    anew: impl FnOnce(&Campaign) -> Result<Outcome, GapError>,
) -> OtherContact {
    let (rival, scene) = match search.rival(thinned, judgment) {
        Ok(Some(found)) => found,
        Ok(None) => return OtherContact::Noted(None),
        Err(e) => {
            let note = format!("effects are not compared with another contact: {e}");
            return OtherContact::Noted(Some(note));
        }
    };
    let told = rival.told();
    if !rival.outdoes() {
        return OtherContact::Noted(Some(told));
    }
    let other = campaign.to_search_in(scene);
    match other.and_then(|c| anew(&c)) {
        Ok(mut outcome) => {
            let found = &mut outcome.diagnosis;
            found.notes.insert(0, told);
            // Not told from another contact is not ruled out, and would not show from any size on.
            let verdict = &mut found.verdict;
            verdict.leave_open(rival.effects());
            verdict.or_threshold = rival.effects().to_vec();
            verdict
                .or_threshold
                .retain(|e| !verdict.effects.contains(e));
            for report in &mut found.effects {
                if verdict.or_threshold.contains(&report.effect) {
                    report.shows_from.clear();
                }
            }
            OtherContact::Explains(Box::new(outcome))
        }
        Err(e) => OtherContact::Noted(Some(format!("{told}, but there they cannot be ({e})"))),
    }
}

/// Fields of the nominal model and of the named one, as one would estimate them. If there are none, the diagnosis' own
/// fields, and the reason if the estimation failed.
///
/// # Errors
/// Rows that contact cannot take.
fn compared_fields(
    campaign: &Campaign,
    trial: &Trial<'_>,
    judgment: &Judgment<'_>,
    search: &Search<'_>,
    split: Split,
    seed: u64,
) -> Result<(Extent, Option<GapError>), GapError> {
    let outside = match split {
        Split::Whole => Extent::outside(campaign, judgment, seed),
        // A field would have learned from test sequences.
        Split::Halves => Ok(None),
    };
    let inside = || Extent::inside(campaign, trial, judgment, &search.field);
    Ok(match outside {
        Ok(Some(extent)) => (extent, None),
        Ok(None) => (inside()?, None),
        Err(e) => (inside()?, Some(e)),
    })
}

/// Reports of all effects: those that were fitted, then the others, then those that the recording cannot show.
fn reports(
    case: &Case<'_>,
    doubts: &Doubts<'_>,
    judgment: &Judgment<'_>,
    answer: &Answer,
) -> Result<Vec<EffectReport>, GapError> {
    let Case {
        thinned: campaign,
        search,
        likeness,
        trial,
        ..
    } = *case;
    let mut reports = Vec::new();
    for candidate in &search.candidates {
        let mut report = EffectReport::of(campaign, candidate, search.base, &answer.probabilities);
        if let Some(refined) = &candidate.refined {
            report.null_score = Some(search.hypothesis(refined).required_gain());
            let mut tried = judgment.refused.iter().chain(&judgment.named);
            let own = tried.find(|t| t.effects == [report.effect.as_str()]);
            match own {
                Some(tried) => report.check(&tried.checked),
                None if reports.len() < CHECKED => report.check(&trial.of(refined)?),
                None => {}
            }
        }
        if let Some(named) = judgment.corrected() {
            report.together(campaign, named.refined);
        }
        report.absorbed_share = likeness.absorbed(&report.effect);
        report.ambiguous_with = likeness.ambiguous_with(&report.effect);
        report.shows_from = search
            .limits
            .get(&report.effect)
            .cloned()
            .unwrap_or_default();
        let is_own = |(p, _): &(&Plain, f64)| p.effect.name() == report.effect;
        if doubts.in_field.iter().any(is_own) {
            report.ambiguous_with.push(STIFFNESS_FIELD.to_owned());
        }
        reports.push(report);
    }
    // Effects of one model are equally likely up to rounding; the one that gains more comes first.
    reports.sort_by(|a, b| {
        let likely = |r: &EffectReport| (r.probability / ALIKE).round();
        let fitted = |r: &EffectReport| r.roughness.is_some();
        (likely(b).total_cmp(&likely(a)))
            .then(fitted(b).cmp(&fitted(a)))
            .then(b.score.total_cmp(&a.score))
    });
    let untestable = search.untestable.iter();
    reports.extend(untestable.map(|(e, reason)| EffectReport::untestable(e.as_ref(), reason)));
    Ok(reports)
}

/// The effects that may act without showing, each with its share. The shares add up to the number of effects looked for
/// divided by the size of the catalogue. Effects that were refused are left out, since other sequences contradict them.
fn hidden(case: &Case<'_>, refused: &[String], looked_for: usize) -> Vec<(String, f64)> {
    let (search, likeness) = (case.search, case.likeness);
    let weights: Vec<(String, f64)> = (search.candidates.iter())
        .filter(|c| !refused.iter().any(|e| e == c.effect.name()))
        .filter_map(|c| {
            let absorbed = likeness.absorbed(c.effect.name())?;
            let (effect, rough) = (c.effect.as_ref(), search.spread.contact);
            let weight = hidden_weight(effect, absorbed, c.score(search.base), rough);
            Some((effect.name().to_owned(), weight))
        })
        .collect();
    let sum: f64 = weights.iter().map(|(_, w)| w).sum();
    let all = (looked_for as f64 / effects::catalogue().len() as f64).min(1.0);
    let share = |(effect, weight)| (effect, all * weight / sum);
    if sum > 0.0 {
        weights.into_iter().map(share).collect()
    } else {
        Vec::new()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A mean of speeds has another friction than the mean of friction.
    #[test]
    fn long_recordings_are_thinned_for_contact_alone() {
        let row = |k: i32| [[0.004, 0.004, 0.01 * f64::from(k % 100)], [0.0; 3]];
        let sequences = [0, 1].map(|_| (0..6000).map(row).collect::<Vec<_>>());
        let touching = Campaign::of_stage(&sequences);
        let in_air = Campaign::of_stage_with(None, &sequences);
        assert!(few_samples(&touching).unwrap().is_some());
        assert!(few_samples(&in_air).unwrap().is_none());
    }
}

//! Notes for the reader of a diagnosis, in sentences.

use crate::closure::noise_norm;
use crate::effect::Need;
use crate::estimated::Compared;
use crate::judge::{Nominal, opposes};
use crate::outliers::outlier;
use crate::plain::Plain;
use crate::refine::Refined;
use crate::trial::{Judgment, Trial, Tried};
use crate::verdict::{Answer, VerdictKind};
use crate::{Campaign, GapError, Model, Motion, Parameter};
use vsf_pipeline::reading_unit;

/// In free air, a remaining error of this many times that of a perfect model is noted.
const MUCH: f64 = 1.5;
/// An error below this share of the noise shows that the noise was overestimated.
const BELOW: f64 = 0.7;

/// Effects that cannot show are noted from this probability on.
const TOLD: f64 = 0.05;

/// Note that an effect with one stiffness everywhere explains a share of what the field does.
pub(crate) fn told(campaign: &Campaign, plain: &Plain, share: f64) -> String {
    let value = |(p, v): (Parameter, &f64)| {
        let number = number(*v);
        match p.unit {
            "1" => format!("{} {number}", p.name),
            unit => format!("{} {number} {unit}", p.name),
        }
    };
    let parameters = plain.effect.parameters(&campaign.site);
    let theta: Vec<String> = parameters
        .into_iter()
        .zip(&plain.theta)
        .map(value)
        .collect();
    format!(
        "a uniform stiffness ({:.3} N/m) with {} ({}) explains {:.0} % of what a stiffness that differs from place to place \
         explains beyond a uniform one: these recordings do not tell the two apart",
        plain.stiffness,
        plain.effect.name(),
        theta.join(", "),
        100.0 * share
    )
}

/// A number for a sentence, to at least three digits.
pub(crate) fn number(v: f64) -> String {
    match v.abs() {
        size if size == 0.0 || (1.0..1e4).contains(&size) => format!("{v:.3}"),
        size if (1e-3..1.0).contains(&size) => format!("{v:.5}"),
        _ => format!("{v:.3e}"),
    }
}

/// A length (m) for a sentence about contact.
pub(crate) fn mm(length: f64) -> String {
    format!("{:.3} mm", 1e3 * length)
}

/// Note on the contact of the reported errors, if it is not the one in which effects are looked for.
fn contact(campaign: &Campaign, told: &Compared) -> Option<String> {
    let own = campaign.scene().contact().threshold;
    let [before, after] = told.thresholds.filter(|told| *told != [own; 2])?;
    let which = if before == after {
        "errors are"
    } else {
        "the error before is that"
    };
    Some(format!(
        "effects are searched with a contact threshold of {}; {which} of fields with {}, which suits the spacing of the \
         points",
        mm(own),
        mm(before)
    ))
}

/// Notes on the search and the trial.
pub(crate) fn of_search(
    campaign: &Campaign,
    trial: &Trial<'_>,
    told: &Compared,
    estimated: bool,
    judgment: &Judgment<'_>,
    answer: &Answer,
    nominal: &Nominal,
) -> Vec<String> {
    let mut notes = Vec::new();
    let error = told.after.residuals.mean_error();
    // Of the fit itself, errors are below the noise.
    if !campaign.test.is_empty() {
        let floor = noise_norm(&campaign.noise);
        notes.extend(overstated(floor, error, campaign.scene.error_unit()));
        // With contact, errors are far from a perfect model's for many reasons.
        if judgment.corrected().is_some() && !nominal.touches {
            notes.extend(incomplete(floor, error));
        }
    }
    let verdict = &answer.verdict;
    if let (Some(named), Some([error, without])) = (&judgment.named, judgment.worse) {
        let which = named.effects.join(" and ");
        let unit = campaign.scene.error_unit();
        notes.push(format!(
            "with {which} the test sequences are predicted worse ({} {unit} instead of {} {unit}), so the corrected model \
             stays the nominal one",
            number(error),
            number(without)
        ));
    }
    if verdict.effects.is_empty() && nominal.contradicts() {
        let how = if opposes(nominal.likeness) {
            format!(
                "on the whole it is opposite to what springs give (correlation {:.2})",
                nominal.likeness
            )
        } else {
            format!(
                "the best one leaves {:.0} % of its energy",
                100.0 * nominal.left
            )
        };
        notes.push(format!(
            "no stiffness explains what is felt in contact: {how}; check the sign and the unit of the torques, \
             base_pose and points"
        ));
    }
    if verdict.kind == VerdictKind::NoGap && verdict.hidden >= TOLD {
        notes.push(format!(
            "an effect may act that the stiffness field absorbs, so that it does not show here, above all one of contact or \
             material (probability {:.0} %)",
            100.0 * verdict.hidden
        ));
    }
    let unexplained = verdict.effects.is_empty() && judgment.left_free.is_none();
    if let Some(surprise) = trial.surprise.filter(|_| unexplained) {
        notes.push(format!(
            "the test sequences contradict the train sequences: their errors are {} times what the train sequences lead to \
             expect, new places allowed for (root mean square); look for other units, signs or orders of joints in some of them, and for another \
             object or place",
            number(surprise)
        ));
    }
    if let Some(left) = judgment.left_free {
        let unit = campaign.scene.error_unit();
        notes.push(format!(
            "in free motion of the test sequences an error of {} {unit} persists or oscillates, which neither a stiffness nor \
             a named effect explains",
            number(left)
        ));
    }
    let stopped = judgment.corrected().map(|t| t.refined.at_bounds());
    if let Some(stopped) = stopped.filter(|s| !s.is_empty()) {
        notes.push(format!(
            "at a bound of what is plausible: {}; {} may stand for what is not looked for, such as torques of \
             another sign, unit or order",
            stopped.join(", "),
            verdict.effects.join(" and ")
        ));
    }
    notes.extend((judgment.named.as_ref()).and_then(|t| relative(campaign, t.refined)));
    if let Some(persistence) = judgment.persistence {
        notes.push(format!(
            "the residual of {} persists, with a correlation of {persistence:.2} from one stretch of samples to \
             the next: something else acts, beside it or in its place",
            verdict.effects.join(" and ")
        ));
    }
    let unit = campaign.scene.error_unit();
    let aside = |t: &Tried<'_>| {
        let effects = t.effects.join(" and ");
        format!("{effects} (test error {} {unit})", number(t.error()))
    };
    let aside: Vec<String> = judgment.refused.iter().map(aside).collect();
    if !aside.is_empty() {
        notes.push(format!(
            "left aside, since the test sequences do not bear them out as much as the train sequences speak for them: {}; \
             {} {unit} without them{}",
            aside.join(", "),
            number(trial.before.mean_error()),
            if estimated { ", of the diagnosis' own fields" } else { "" }
        ));
    }
    if campaign.test.is_empty() {
        notes.push("there is only one sequence: errors are those of the fit itself".to_owned());
    }
    if let Some(last) = campaign.test.first().filter(|_| campaign.held_out) {
        notes.push(format!(
            "there is no test split: sequence {} is held out",
            last.id
        ));
    }
    notes.extend(rounded(campaign));
    notes.extend(contact(campaign, told));
    notes
}

/// Note that springs have no part in the answer.
pub(crate) fn nothing_touched() -> String {
    "the train sequences touch no point, so that springs explain nothing: if the arm did touch the object, base_pose or points \
     are wrong or in other units; if it did not, leave the points out"
        .to_owned()
}

/// Note that what effects leave to the springs is opposite to spring torques.
pub(crate) fn opposite(effects: &[String], likeness: f64) -> String {
    format!(
        "what remains with {} is opposite to what springs give (correlation {likeness:.2}), so that it may stand for \
         something else; check the sign and the unit of the torques, base_pose and points",
        effects.join(" and ")
    )
}

/// Note that effects have no parameter that the readings determine.
pub(crate) fn nothing_said_of(effects: &[String]) -> String {
    format!(
        "the readings say nothing about any parameter of {}, so that it may stand for something else",
        effects.join(" and ")
    )
}

/// Note that the corrected model does hardly better than sensors that read zero; `silence` is their error.
pub(crate) fn as_good_as_silence(campaign: &Campaign, silence: f64) -> String {
    format!(
        "predicting zero torque leaves an error of {silence:.4} {}, and the corrected model hardly less or even more: the readings may \
         belong to another motion, or hold no torques",
        campaign.scene.error_unit()
    )
}

/// Note that a few rows hold much of what a model leaves. With contact, only the train sequences are considered, since
/// others touch what the field does not know.
///
/// # Errors
/// Rows that contact cannot take.
pub(crate) fn few_rows(
    campaign: &Campaign,
    model: &Model,
    field: &[f64],
) -> Result<Option<String>, GapError> {
    let motions: Vec<&Motion> = match campaign.lacks(Need::Contact) {
        Some(_) => campaign.session(),
        None => campaign.train.iter().collect(),
    };
    let residuals = campaign.residuals(model, field, &motions)?;
    let Some(found) = outlier(&residuals, &campaign.noise) else {
        return Ok(None);
    };
    let joint = &campaign.site.robot.joints()[found.joint];
    let of = &motions[found.sequence].id;
    let (first, last) = (found.rows.start, found.rows.end - 1);
    let rows = if first == last {
        format!("row {first} of sequence {of} holds")
    } else {
        format!("rows {first} to {last} of sequence {of} hold")
    };
    let model = if model.parts.is_empty() {
        "nominal"
    } else {
        "corrected"
    };
    Ok(Some(format!(
        "{rows} {:.0} % of the squared errors of the {model} model, each joint's relative to its noise: {} is off by {} {} \
         there, elsewhere by {} (root mean square); if that is a fault of the recording, the answer may change once it is \
         mended or left out",
        100.0 * found.share,
        joint.name(),
        number(found.error),
        reading_unit(joint),
        number(found.elsewhere)
    )))
}

/// Note that a corrected model holds no known cause, if the verdict names none.
pub(crate) fn closest(kind: VerdictKind, model: &Model) -> Option<String> {
    let names: Vec<&str> = model.parts.iter().map(|(e, _)| e.name()).collect();
    (kind != VerdictKind::Effects && !names.is_empty()).then(|| {
        format!(
            "the corrected model holds the effects that come closest ({}), not a known cause: it may predict worse elsewhere",
            names.join(", ")
        )
    })
}

/// Note that shares by which joints scale the torques of the field are relative.
fn relative(campaign: &Campaign, named: &Refined) -> Option<String> {
    let reference = named.reference?;
    let p = &named.prior.parameters[reference.share];
    let joint = campaign.site.robot.joints()[p.joint?].name();
    let why = if reference.agreed {
        "with which most others agree"
    } else {
        "since they have to be to one of them"
    };
    Some(format!(
        "a gain common to all joints cannot be told from a scale of the stiffness: gains are relative to {joint}, {why} \
         ({} is 0 for that reason)",
        p.name
    ))
}

/// Note that readings are rounded, and how coarsely.
fn rounded(campaign: &Campaign) -> Option<String> {
    let rounded = &campaign.rounded;
    let coarsest = rounded.iter().map(|(_, r)| r.step).fold(0.0, f64::max);
    // To three digits.
    let unit = 10f64.powf(2.0 - coarsest.log10().floor());
    let coarsest = (coarsest * unit).round() / unit;
    let joints = campaign.site.robot.joints();
    let names: Vec<&str> = rounded.iter().map(|(j, _)| joints[*j].name()).collect();
    (!names.is_empty()).then(|| {
        format!(
            "readings come in steps of up to {coarsest} {}, more than their noise ({}): rounding errors follow the motion as \
             effects do, and small effects may stand for them",
            campaign.scene.error_unit(),
            names.join(", ")
        )
    })
}

/// Note that more acts than what is named, if the remaining error is far above the noise.
fn incomplete(noise: f64, error: f64) -> Option<String> {
    let times = error / noise.max(f64::MIN_POSITIVE);
    (times > MUCH).then(|| {
        format!(
            "the remaining error is {} that of a perfect model: more acts than is named, or the effects have other forms, and \
             their parameters absorb some of it",
            if times < 100.0 { format!("{times:.1} times") } else { "a hundred times and more".to_owned() }
        )
    })
}

/// Note that the noise is estimated to be larger than the remaining error (both in `unit`), if it is.
fn overstated(noise: f64, error: f64, unit: &str) -> Option<String> {
    (error < BELOW * noise).then(|| {
        format!(
            "the estimated noise ({} {unit}) is larger than the error ({} {unit}): readings change too quickly from sample to \
             sample to tell noise from signal, and shares of the gap come out too large; some hundred samples at rest or in slow \
             free motion would tell",
            number(noise),
            number(error)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_of_no_known_cause_is_told() {
        let effect = crate::effects::named(&["torque_bias"]).unwrap_or_default();
        let model = Model::of(&effect[0], &[0.1]);
        assert_eq!(closest(VerdictKind::Effects, &model), None);
        assert_eq!(closest(VerdictKind::Unknown, &Model::default()), None);
        for kind in [VerdictKind::Unknown, VerdictKind::NotDiagnosable] {
            let note = closest(kind, &model).unwrap_or_default();
            assert!(note.contains("(torque_bias), not a known cause"), "{note}");
        }
    }

    #[test]
    fn what_is_left_far_above_the_noise_is_told() {
        assert_eq!(incomplete(0.1, 0.11), None);
        assert_eq!(incomplete(0.0, 0.0), None);
        let note = incomplete(0.1, 0.31).unwrap_or_default();
        assert!(note.contains("3.1 times"), "{note}");
        assert!(incomplete(0.0, 1.0).unwrap_or_default().contains("hundred"));
    }

    #[test]
    fn noise_is_overstated_where_less_error_is_left() {
        assert_eq!(overstated(0.1, 0.1, "N"), None);
        assert_eq!(overstated(0.0, 0.0, "N"), None);
        let note = overstated(24.0, 3.0, "N").unwrap_or_default();
        assert!(
            note.contains("24.000 N") && note.contains("3.000 N"),
            "{note}"
        );
    }
}

use crate::console::number;
use vsf::gap::{
    Diagnosis, EffectEntry, EffectReport, Gap, Limit, MeanErrors, ParameterEstimate, Place, Role,
    Site, Verdict, VerdictKind, effects,
};

/// Headings of what would show, and of what would not.
pub const SHOWS_FROM: &str = "would not have shown below this size (the parameter that shows best, to first order; in contact it takes more)";
pub const NEVER_SHOWS: &str = "would not have shown at any plausible size, to first order";

/// Test errors beyond so many noise floors are no longer those of a perfect model.
const ROUGH: f64 = 3.0;

/// A gap of which so much is closed is explained, whatever the noise.
const CLOSED: f64 = 0.99;

/// Probability from which on it is told that an effect may be hidden.
const LEAST_HIDDEN: f64 = 0.05;

/// A claim of less probability is uncertain; an effect of more acts, whatever acts beside it.
const LIKELY: f64 = 0.5;
const CERTAIN: f64 = 0.95;

/// From so many nats on, test sequences speak for an effect.
const NATS: f64 = 3.0;

/// What is told first of the parameters of an effect: those that are so many deviations from zero, and such a part of the
/// largest of the same unit; at most so many.
const SURE: f64 = 2.7;
const LARGE: f64 = 0.1;
const MOST_FOUND: usize = 4;

/// Whether the answer claims what is less likely than not.
pub fn is_uncertain(diagnosis: &Diagnosis) -> bool {
    let verdict = &diagnosis.verdict;
    matches!(verdict.kind, VerdictKind::Effects | VerdictKind::NoGap)
        && verdict.probability < LIKELY
}

/// The answer in a sentence, and in another one that a parameter stopped at a bound.
pub fn verdict(diagnosis: &Diagnosis) -> String {
    let sentence = sentence(diagnosis);
    let stopped = at_bounds(diagnosis);
    let names = matches!(diagnosis.verdict.kind, VerdictKind::Effects) && !stopped.is_empty();
    if names {
        format!(
            "{sentence} {} stopped at a bound of what is plausible: what is named may stand for something else.",
            stopped.join(" and ")
        )
    } else {
        sentence
    }
}

fn sentence(diagnosis: &Diagnosis) -> String {
    let Diagnosis { verdict, gap, .. } = diagnosis;
    let p = percent(verdict.probability) + &whatever_else(diagnosis);
    let effects = verdict.effects.join(" and ");
    // Ending of a verb whose subject these are, and what stands for them as subject and object.
    let (s, pronoun, them) = match verdict.effects.len() {
        1 => ("s", "it", "it"),
        _ => ("", "they", "them"),
    };
    match verdict.kind {
        VerdictKind::Effects if gap.corrected_by.is_empty() => format!(
            "{effects} fit{s} best (probability {p}), but with {them} the test sequences are predicted worse."
        ),
        VerdictKind::Effects if gap.test_error_corrected == gap.test_error_nominal => format!(
            "{effects} fit{s} best (probability {p}); the test sequences do not show it: their errors stay the same."
        ),
        VerdictKind::Effects if is_uncertain(diagnosis) => {
            format!("Uncertain: {effects} fit{s} best, with a probability of {p} only.")
        }
        VerdictKind::Effects if gap.closed_fraction <= 0.0 => format!(
            "{effects} fit{s} best (probability {p}); squared errors on the test sequences do not shrink{}.",
            likelier(diagnosis)
        ),
        VerdictKind::Effects if gap.closed_interval[0] <= 0.0 => format!(
            "{effects} fit{s} best (probability {p}); whether {pronoun} close{s} any of the gap, the test sequences do not tell."
        ),
        VerdictKind::Effects if !at_bounds(diagnosis).is_empty() => {
            format!("{effects} fit{s} best (probability {p}).")
        }
        VerdictKind::Effects => format!(
            "{effects} explain{s} {}the gap (probability {p}).",
            extent(gap)
        ),
        VerdictKind::NoGap if !all_looked_for(diagnosis) => {
            let those = match diagnosis.effects.len() {
                1 => "the one effect looked for".to_owned(),
                n => format!("the {n} effects looked for"),
            };
            format!(
                "Nothing of {those} is borne out by this recording (probability that none of this acts: {p}); other effects of \
                 the catalogue were not looked for."
            )
        }
        VerdictKind::NoGap if is_uncertain(diagnosis) => format!(
            "Uncertain: no effect is borne out by this recording, but that none acts has a probability of {p} only."
        ),
        VerdictKind::NoGap => format!(
            "No gap: no effect is borne out by this recording (probability that none acts: {p}{}).",
            hidden(diagnosis)
        ),
        VerdictKind::Unknown if effects.is_empty() => {
            "Unknown: something acts that none of the effects looked for explains.".to_owned()
        }
        VerdictKind::Unknown => format!(
            "Unknown: something acts that none of the effects looked for explains; {effects} come{s} closest."
        ),
        VerdictKind::NotDiagnosable if like_field(diagnosis) => format!(
            "Not diagnosable: {effects}, or an object whose stiffness differs from place to place; this recording does not tell."
        ),
        VerdictKind::NotDiagnosable => {
            let (certain, open): (Vec<&str>, Vec<&str>) = (verdict.effect_set_95.iter())
                .map(String::as_str)
                .partition(|e| is_certain(diagnosis, e));
            let beside = if certain.is_empty() {
                "something acts".to_owned()
            } else {
                format!("beside {} something acts", certain.join(" and "))
            };
            format!(
                "Not diagnosable: {beside}, but this recording fits {} alike.",
                open.join(", ")
            )
        }
    }
}

fn is_certain(diagnosis: &Diagnosis, effect: &str) -> bool {
    let of = diagnosis.effects.iter().find(|e| e.effect == effect);
    of.is_some_and(|e| e.probability >= CERTAIN)
}

/// Which of several effects act for certain, where their whole does not.
fn whatever_else(diagnosis: &Diagnosis) -> String {
    let Verdict {
        kind,
        effects,
        probability,
        ..
    } = &diagnosis.verdict;
    let certain = effects.iter().filter(|e| is_certain(diagnosis, e));
    let certain: Vec<&str> = certain.map(String::as_str).collect();
    if *kind == VerdictKind::Effects && *probability < CERTAIN && !certain.is_empty() {
        format!("; that {} acts: 95 % or more", certain.join(" and "))
    } else {
        String::new()
    }
}

/// The amplitudes of the effects named that stopped at a bound.
fn at_bounds(diagnosis: &Diagnosis) -> Vec<&str> {
    let named = |e: &&EffectReport| diagnosis.verdict.effects.contains(&e.effect);
    let effects = diagnosis.effects.iter().filter(named);
    effects
        .flat_map(|e| e.at_bound.iter().map(String::as_str))
        .collect()
}

/// That the test sequences speak for the one effect that is named all the same.
fn likelier(diagnosis: &Diagnosis) -> String {
    let named = |e: &&EffectReport| diagnosis.verdict.effects == [e.effect.as_str()];
    let score = (diagnosis.effects.iter().find(named)).and_then(|e| e.test_score);
    match score.filter(|s| *s >= NATS) {
        Some(score) => format!(
            ", though in the contact in which effects are looked for they are {score:.0} nats likelier with it"
        ),
        None => String::new(),
    }
}

/// What the corrected model found: the largest amplitudes of each effect that is named.
pub fn found(verdict: &Verdict, corrected: &[EffectEntry], site: &Site) -> Option<String> {
    if verdict.kind != VerdictKind::Effects {
        return None;
    }
    let catalogue = effects::catalogue();
    let of = |e: &EffectEntry| {
        let effect = catalogue.iter().find(|known| known.name() == e.effect)?;
        let parameters = effect.parameters(site);
        let is_amplitude = |p: &&ParameterEstimate| {
            let known = parameters.iter().find(|known| known.name == p.name);
            known.is_some_and(|known| known.role == Role::Amplitude)
        };
        let most = |unit: &str| {
            let same = e.parameters.iter().filter(|p| p.unit == unit);
            same.fold(0.0_f64, |most, p| most.max(p.value.abs()))
        };
        let size = |p: &ParameterEstimate| p.value.abs() / most(&p.unit);
        let mut large: Vec<&ParameterEstimate> = (e.parameters.iter().filter(is_amplitude))
            .filter(|p| p.value.abs() > SURE * p.sd && size(p) >= LARGE)
            .collect();
        large.sort_by(|a, b| size(b).total_cmp(&size(a)));
        let more = if large.len() > MOST_FOUND {
            " and others"
        } else {
            ""
        };
        large.truncate(MOST_FOUND);
        let values: Vec<String> = (large.iter())
            .map(|p| format!("{} = {}", p.name, estimate(p.value, p.sd, &p.unit)))
            .collect();
        (!values.is_empty()).then(|| format!("{}: {}{more}", e.effect, values.join(", ")))
    };
    let found: Vec<String> = corrected.iter().filter_map(of).collect();
    (!found.is_empty()).then(|| found.join("; "))
}

/// That an effect may act without showing, where it is worth a word.
fn hidden(diagnosis: &Diagnosis) -> String {
    let hidden = diagnosis.verdict.hidden;
    if hidden >= LEAST_HIDDEN {
        format!(
            ", that one acts which the stiffness K takes up: {}",
            percent(hidden)
        )
    } else {
        String::new()
    }
}

/// Whether nothing of the catalogue was left out (`--effects`).
pub fn all_looked_for(diagnosis: &Diagnosis) -> bool {
    let is_there = |name: &str| diagnosis.effects.iter().any(|e| e.effect == name);
    effects::catalogue().iter().all(|e| is_there(e.name()))
}

/// How much of the gap the correction takes.
fn extent(gap: &Gap) -> &'static str {
    let left = gap.test_error_corrected > ROUGH * gap.noise_floor;
    let falls_short = left && gap.closed_fraction < CLOSED;
    if !falls_short {
        ""
    } else if gap.closed_fraction > 0.5 {
        "most of "
    } else {
        "part of "
    }
}

/// Probability from which on an effect is worth a word.
pub const LIKELY_ENOUGH: f64 = 0.01;

/// What an effect looks much like in this recording: what is far less likely, and what it is not told from.
pub fn look_alikes<'e>(all: &[EffectReport], of: &'e EffectReport) -> (Vec<&'e str>, Vec<&'e str>) {
    let is_behind = |name: &&str| {
        let other = all.iter().find(|e| e.effect == *name);
        other.is_some_and(|o| o.probability < LIKELY_ENOUGH * of.probability)
    };
    let names = of.ambiguous_with.iter().map(String::as_str);
    names.partition(is_behind)
}

/// Whether the effects named may be what the field shows.
fn like_field(diagnosis: &Diagnosis) -> bool {
    let named = |e: &&EffectReport| diagnosis.verdict.effects.contains(&e.effect);
    let mut named = diagnosis.effects.iter().filter(named).peekable();
    named.peek().is_some() && named.all(EffectReport::is_like_field)
}

/// Why a gap may grow while the mean error falls.
pub const SQUARES: &str = "What is closed is a share of the squared errors beyond noise, in which large errors \
    count more than in the mean.";

/// The errors before and after in one sentence.
pub fn errors(diagnosis: &Diagnosis) -> String {
    let gap = &diagnosis.gap;
    let unit = &gap.unit;
    let floor = if gap.noise_floor > 0.0 {
        format!(" (a perfect model: {} {unit})", number(gap.noise_floor))
    } else {
        String::new()
    };
    if gap.corrected_by.is_empty() {
        let error = number(gap.test_error_nominal);
        let left = if diagnosis.verdict.kind == VerdictKind::NoGap
            && all_looked_for(diagnosis)
            && !diagnosis.location.region.is_empty()
            && gap.test_error_nominal > ROUGH * gap.noise_floor
        {
            " What is left is places not touched before, and contact that independent points describe roughly."
        } else {
            ""
        };
        return format!("Test error {error} {unit}{floor}; nothing is corrected.{left}");
    }
    let worse = gap.test_error_corrected > gap.test_error_nominal;
    let apart = if worse == (gap.closed_fraction < 0.0) {
        String::new()
    } else {
        format!(" {SQUARES}")
    };
    format!(
        "Test error {} {unit} before, {} {unit} after{floor}: {} of the gap closed (95 %: {} to {}).{apart}",
        number(gap.test_error_nominal),
        number(gap.test_error_corrected),
        closed(gap.closed_fraction),
        closed(gap.closed_interval[0]),
        closed(gap.closed_interval[1]),
    )
}

/// A share of the gap: all of it where less is left than was taken for noise.
pub fn closed(share: f64) -> String {
    percent(share.min(1.0))
}

/// The errors with nothing touched and in contact, where there is both.
pub fn parts(gap: &Gap) -> Option<String> {
    let (free, contact) = (gap.free?, gap.contact?);
    let unit = &gap.unit;
    let of = |errors: MeanErrors| {
        if gap.corrected_by.is_empty() {
            format!("{} {unit}", number(errors.nominal))
        } else {
            format!(
                "{} {unit} before, {} {unit} after",
                number(errors.nominal),
                number(errors.corrected)
            )
        }
    };
    Some(format!(
        "In the air {}; in contact {}.",
        of(free),
        of(contact)
    ))
}

/// What the table of effects tells of one beside its name and probability: headings and values. Test errors of effects
/// are of the diagnosis' own fields; beside those of estimated ones they would mislead.
pub fn figures(gap: &Gap, e: &EffectReport) -> Vec<(String, Option<String>)> {
    let heading = str::to_owned;
    let nats = |score: f64| fixed(score, 0);
    let mut figures = vec![
        (heading("score [nats]"), Some(nats(e.score))),
        (heading("null"), e.null_score.map(nats)),
        (heading("test score"), e.test_score.map(nats)),
    ];
    if !gap.estimated {
        let error = format!("test error [{}]", gap.unit);
        figures.push((error, e.test_error.map(number)));
        figures.push((heading("closed"), e.closed_fraction.map(percent)));
    }
    if touches(gap) {
        figures.push((heading("absorbed by K"), e.absorbed_share.map(percent)));
    }
    figures
}

/// Whether there is an object: in free air there are neither links that touch it nor a stiffness.
pub fn touches(gap: &Gap) -> bool {
    gap.threshold.is_some()
}

/// What the table's headings stand for.
pub fn headings(gap: &Gap) -> String {
    let closed = if gap.estimated {
        ""
    } else {
        "; closed: share of the squared errors beyond noise"
    };
    format!(
        "score: gain of log evidence; null: score that is reached without any effect; test score: gain of log density on \
         the test sequences{closed}"
    )
}

/// A share or a probability.
pub fn percent(share: f64) -> String {
    format!("{} %", fixed(100.0 * share, 0))
}

/// A number with so many decimals; what is rounded to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.bytes().all(|b| b == b'0' || b == b'.') => zero.to_owned(),
        _ => text,
    }
}

/// The part of a recording.
pub fn part(of: &Place) -> String {
    match of {
        Place::Joint(name) | Place::Link(Some(name)) | Place::Sequence(name) => name.clone(),
        Place::Link(None) => "none".to_owned(),
        Place::Phase(phase) => phase.name().to_owned(),
        Place::Frequency(band) => {
            let [low, high] = band.map(|hertz| {
                let decimals = decimals(hertz);
                format!("{hertz:.decimals$}")
            });
            format!("{low} to {high} Hz")
        }
    }
}

/// The value of a parameter with its deviation, to two digits of that, and unit. At a bound there is
/// no deviation.
fn estimate(value: f64, std: f64, unit: &str) -> String {
    let unit = if unit == "1" {
        String::new()
    } else {
        format!(" {unit}")
    };
    if std == 0.0 {
        return format!("{}{unit}", number(value));
    }
    let decimals = decimals(std);
    format!("{} ± {std:.decimals$}{unit}", fixed(value, decimals))
}

/// A parameter of an effect, or that the recording does not tell it.
pub fn determined(effects: &[EffectReport], effect: &str, p: &ParameterEstimate) -> String {
    let value = estimate(p.value, p.sd, &p.unit);
    let of = effects.iter().find(|e| e.effect == effect);
    if of.is_some_and(|e| e.undetermined.contains(&p.name)) {
        format!("{value}, as before any reading: not determined by this recording")
    } else {
        value
    }
}

/// Decimals that show two digits of a number.
fn decimals(of: f64) -> usize {
    (1.0 - of.log10().floor()).clamp(0.0, 9.0) as usize
}

/// What an effect is.
pub fn summary(effects: &[EffectReport], name: &str) -> String {
    let of = effects.iter().find(|e| e.effect == name);
    of.map_or_else(String::new, |e| plain(&e.summary))
}

/// A text without the marks of code.
pub fn plain(text: &str) -> String {
    text.replace('`', "")
}

/// The effects that were fitted together with the field, best first.
pub fn fitted(effects: &[EffectReport]) -> impl Iterator<Item = &EffectReport> {
    effects.iter().filter(|e| is_shown(e))
}

/// The probability that none of the effects acts in a way that shows, and what to call that: all that is left of it,
/// where that is half a percent at least. Effects that act together leave none. Where there is no gap to see, effects
/// have their shares of what the stiffness hides.
pub fn none_of_these(d: &Diagnosis) -> Option<(&'static str, f64)> {
    let left = 1.0 - d.effects.iter().map(|e| e.probability).sum::<f64>();
    let shared = d.verdict.kind == VerdictKind::NoGap && all_looked_for(d);
    let label = if d.verdict.hidden > 0.0 && !shared {
        "none, or hidden by K"
    } else {
        "none"
    };
    (left >= 0.005).then_some((label, left))
}

/// Whether an effect was fitted, or may be what the field shows.
fn is_shown(e: &EffectReport) -> bool {
    !e.parameters.is_empty() || e.is_like_field()
}

/// What to call effects of which nothing shows, and that may act all the same.
pub const OUT_OF_SIGHT: &str = "not fitted, since nothing of them shows, but K may hide them";

/// These effects, each with its probability.
pub fn out_of_sight(effects: &[EffectReport]) -> Vec<String> {
    let of = |e: &EffectReport| format!("{} {}", e.effect, percent(e.probability));
    let not_fitted = effects.iter().filter(|e| !is_shown(e));
    not_fitted
        .filter(|e| e.probability >= LIKELY_ENOUGH)
        .map(of)
        .collect()
}

/// The effects that the recording can show but that screening put out of reach.
pub fn screened_out(effects: &[EffectReport]) -> impl Iterator<Item = &EffectReport> {
    let behind = |e: &&EffectReport| e.testable && e.probability < LIKELY_ENOUGH && !is_shown(e);
    effects.iter().filter(behind)
}

/// The effects that would show from some plausible size on, with the parameter that shows best and that size; and
/// those that would not.
pub fn limits(effects: &[EffectReport]) -> (Vec<(&str, &Limit, f64)>, Vec<&str>) {
    let (mut shown, mut hidden) = (Vec::new(), Vec::new());
    for e in effects {
        let Some(limit) = e.shows_from.first() else {
            continue;
        };
        match limit.value {
            Some(size) => shown.push((e.effect.as_str(), limit, size)),
            None => hidden.push(e.effect.as_str()),
        }
    }
    (shown, hidden)
}

/// A size of a parameter, to two digits.
pub fn size(size: f64, unit: &str) -> String {
    let decimals = decimals(size);
    match unit {
        "1" => format!("{size:.decimals$}"),
        unit => format!("{size:.decimals$} {unit}"),
    }
}

/// The effects that the recording cannot show, by reason.
pub fn untestable(effects: &[EffectReport]) -> Vec<(&str, Vec<&str>)> {
    let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
    for e in effects.iter().filter(|e| !e.testable) {
        let reason = e.reason.as_deref().unwrap_or("not testable");
        match reasons.iter_mut().find(|(r, _)| *r == reason) {
            Some((_, names)) => names.push(&e.effect),
            None => reasons.push((reason, vec![&e.effect])),
        }
    }
    reasons
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use vsf::data::TorqueKind;

    /// Not what may be zero, nor what is small beside others of its unit, nor what only gives an effect its form.
    #[test]
    fn the_largest_amplitudes_are_told_first() {
        let site = Site {
            robot: vsf::robots::planar_arm(5, 0.3, 0.03).unwrap().into(),
            rest: vsf::core::RestPoints::new(Vec::new()).unwrap().into(),
            gravity: vsf::core::nalgebra::Vector3::zeros(),
            torque_kind: TorqueKind::External,
            friction: 0.0,
            sequences: Vec::new(),
            duration: 1.0,
            sequence_duration: 1.0,
        };
        let parameter = |(name, value, sd, unit): &(&str, f64, f64, &str)| ParameterEstimate {
            name: (*name).to_owned(),
            value: *value,
            sd: *sd,
            unit: (*unit).to_owned(),
        };
        let entry = |effect: &str, parameters: &[(&str, f64, f64, &str)]| EffectEntry {
            effect: effect.to_owned(),
            parameters: parameters.iter().map(parameter).collect(),
        };
        let of = |kind: VerdictKind, entries: &[EffectEntry]| {
            let verdict = serde_json::json!({
                "kind": kind, "effects": [], "probability": 1.0, "effect_set_95": [],
            });
            found(&serde_json::from_value(verdict).unwrap(), entries, &site)
        };
        let effects = |entries: &[EffectEntry]| of(VerdictKind::Effects, entries);
        let bias = entry(
            "torque_bias",
            &[
                ("b_1", -2.0, 0.1, "N m"),
                ("b_2", 0.05, 0.001, "N m"),
                ("b_3", 0.5, 0.4, "N m"),
            ],
        );
        assert_eq!(
            effects(std::slice::from_ref(&bias)).unwrap(),
            "torque_bias: b_1 = -2.00 ± 0.10 N m"
        );
        let c = |name, value| (name, value, 0.01, "N m");
        let friction = entry(
            "joint_coulomb_friction",
            &[
                c("c_1", 0.2),
                c("c_2", 0.3),
                c("c_3", 0.4),
                c("c_4", 0.5),
                c("c_5", 0.6),
                ("eps", 0.02, 0.001, "rad/s"),
            ],
        );
        let both = effects(&[bias.clone(), friction]).unwrap();
        let words =
            "; joint_coulomb_friction: c_5 = 0.600 ± 0.010 N m, c_4 = 0.500 ± 0.010 N m, c_3";
        assert!(both.contains(words), "{both}");
        assert!(
            both.ends_with("c_2 = 0.300 ± 0.010 N m and others"),
            "{both}"
        );
        assert_eq!(
            effects(&[entry("torque_bias", &[("b_1", 0.0, 0.0, "N m")])]),
            None
        );
        assert_eq!(of(VerdictKind::Unknown, &[bias]), None);
    }

    #[test]
    fn digits_follow_the_deviation() {
        assert_eq!(estimate(0.65912, 0.0019, "N m"), "0.6591 ± 0.0019 N m");
        assert_eq!(estimate(12.3, 4.0, "1"), "12.3 ± 4.0");
        assert_eq!(estimate(1234.5, 200.0, "N"), "1234 ± 200 N");
        assert_eq!(estimate(0.0, 0.0, "m"), "0 m");
        assert_eq!(estimate(-0.0001, 0.05, "1"), "0.000 ± 0.050");
        let p = |name: &str| ParameterEstimate {
            name: name.to_owned(),
            value: 0.0,
            sd: 1.5,
            unit: "N m".to_owned(),
        };
        let of = EffectReport {
            undetermined: vec!["c_1".to_owned()],
            ..serde_json::from_value(serde_json::json!({
                "effect": "a", "probability": 0.5, "score": 1.0, "parameters": [], "joints": [], "test_error": null,
                "closed_fraction": null, "absorbed_share": null, "roughness": null, "ambiguous_with": [], "testable": true,
            }))
            .unwrap()
        };
        assert_eq!(
            determined(std::slice::from_ref(&of), "a", &p("c_2")),
            "0.0 ± 1.5 N m"
        );
        let untold = determined(&[of], "a", &p("c_1"));
        assert!(
            untold.contains("0.0 ± 1.5 N m")
                && untold.ends_with("not determined by this recording")
        );
        assert_eq!(percent(-0.001), "0 %");
        assert_eq!(percent(-0.01), "-1 %");
        assert_eq!(part(&Place::Frequency([0.5469, 17.5])), "0.55 to 18 Hz");
    }
}

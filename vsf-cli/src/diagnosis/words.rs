use crate::console::{fixed, number};
use vsf::gap::{
    Diagnosis, EffectEntry, EffectReport, Gap, Limit, MeanErrors, Parameter, ParameterEstimate,
    Place, Site, VerdictKind, effects,
};

/// Longer lists of parameters leave out what is near zero.
const MOST_PARAMETERS: usize = 18;

/// Headings of what would show, and of what would not.
pub const SHOWS_FROM: &str = "would not have shown below this size (the parameter that shows best, to first order; in contact it takes more)";
pub const NEVER_SHOWS: &str = "would not have shown at any plausible size, to first order";

/// Test errors beyond so many noise floors are no longer those of a perfect model.
pub const ROUGH: f64 = 3.0;

/// Whether nothing of the catalogue was left out (`--effects`).
pub fn all_looked_for(diagnosis: &Diagnosis) -> bool {
    let is_there = |name: &str| diagnosis.effects.iter().any(|e| e.effect == name);
    effects::catalogue().iter().all(|e| is_there(e.name()))
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

/// Why a gap may grow while the mean error falls.
pub const SQUARES: &str = "What is closed is a share of the squared errors beyond noise, in which large errors \
    count more than in the mean.";

/// Whose errors are left where a perfect model would err far less and no effect is found, or with those that are found the arm is
/// right in the air.
pub fn what_is_left(diagnosis: &Diagnosis) -> Option<&'static str> {
    let gap = &diagnosis.gap;
    let is_far = |error: f64| error > ROUGH * gap.noise_floor;
    let is_the_fields = match diagnosis.verdict.kind {
        VerdictKind::NoGap => gap.corrected_by.is_empty() && is_far(gap.test_error_nominal),
        VerdictKind::Effects => {
            let is_right = |free: MeanErrors| !is_far(free.corrected);
            !gap.corrected_by.is_empty()
                && gap.free.is_some_and(is_right)
                && gap.contact.is_some_and(|contact| is_far(contact.corrected))
        }
        _ => false,
    };
    let is_told =
        is_the_fields && all_looked_for(diagnosis) && !diagnosis.location.region.is_empty();
    is_told.then_some(
        "What is left is the field's: places of which train touches tell little, and contact that independent points \
         describe roughly.",
    )
}

/// What the errors are, with a capital letter.
pub fn kind_of_error(gap: &Gap) -> &'static str {
    if gap.in_sample {
        "Error of the fit"
    } else {
        "Test error"
    }
}

/// The errors before and after in one sentence.
pub fn errors(diagnosis: &Diagnosis) -> String {
    let gap = &diagnosis.gap;
    let (kind, unit) = (kind_of_error(gap), &gap.unit);
    let floor = if gap.noise_floor > 0.0 {
        let most = if gap.noise_floor_is_bound {
            "at most "
        } else {
            ""
        };
        format!(
            " (a perfect model: {most}{} {unit})",
            number(gap.noise_floor)
        )
    } else {
        String::new()
    };
    let left = what_is_left(diagnosis).map_or_else(String::new, |left| format!(" {left}"));
    if gap.corrected_by.is_empty() {
        let error = number(gap.test_error_nominal);
        return format!("{kind} {error} {unit}{floor}; nothing is corrected.{left}");
    }
    let worse = gap.test_error_corrected > gap.test_error_nominal;
    let apart = if worse == (gap.closed_fraction < 0.0) {
        String::new()
    } else {
        format!(" {SQUARES}")
    };
    format!(
        "{kind} {} {unit} before, {} {unit} after{floor}: {} of the gap closed (95 %: {} to {}).{apart}{left}",
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
    ];
    if !gap.in_sample {
        figures.push((heading("test score"), e.test_score.map(nats)));
    }
    if !gap.estimated {
        let error = format!("{} [{}]", kind_of_error(gap).to_lowercase(), gap.unit);
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
pub fn headings(diagnosis: &Diagnosis) -> String {
    let closed = if diagnosis.gap.estimated {
        ""
    } else {
        "; closed: share of the squared errors beyond noise"
    };
    let tested = if diagnosis.gap.in_sample {
        ""
    } else {
        "; test score: gain of log density on the test sequences"
    };
    let is_below = |e: &&EffectReport| {
        e.probability >= LIKELY_ENOUGH && e.null_score.is_some_and(|null| e.score < null)
    };
    let below: Vec<&EffectReport> = fitted(&diagnosis.effects).filter(is_below).collect();
    let verdict = &diagnosis.verdict;
    // Where a likely effect has a score that says nothing.
    let why = if below.is_empty() {
        ""
    } else if verdict.kind == VerdictKind::NoGap && verdict.hidden > 0.0 {
        "; where a score is below its null, the probability is hardly evidence, but a share of what the stiffness field may hide"
    } else if below.iter().all(|e| e.is_like_field()) {
        "; where a score is below its null, the effect was weighed against a stiffness that differs from place to place, not \
         against the other effects: with a uniform stiffness it explains as much, and beside such a field nothing is left for it"
    } else {
        "; where a score is below its null, the probability is that of the effect together with others: alone it does not show"
    };
    format!(
        "score: gain of log evidence; null: score that is reached without any effect{tested}{closed}{why}"
    )
}

/// A share or a probability.
pub fn percent(share: f64) -> String {
    format!("{} %", fixed(100.0 * share, 0))
}

/// A probability: no evidence makes one certain.
pub fn stated(p: f64) -> String {
    if p >= 0.995 {
        "over 99 %".to_owned()
    } else {
        percent(p)
    }
}

/// The part of a recording.
pub fn part(of: &Place) -> String {
    match of {
        Place::Joint(name) | Place::Link(Some(name)) | Place::Sequence(name) => name.clone(),
        Place::Link(None) => "none".to_owned(),
        Place::Phase(phase) => phase.name().to_owned(),
        Place::Frequency([low, high]) => {
            let hertz = |f: f64| format!("{f:.*}", decimals(f));
            if *low > 0.0 {
                format!("{} to {} Hz", hertz(*low), hertz(*high))
            } else {
                format!("below {} Hz", hertz(*high))
            }
        }
    }
}

/// The value of a parameter with its deviation, to two digits of that, and unit. At a bound there is
/// no deviation.
pub fn estimate(value: f64, std: f64, unit: &str) -> String {
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

/// A parameter of an effect, and that the recording does not tell it, or that it lies at a bound.
pub fn determined(effects: &[EffectReport], effect: &str, p: &ParameterEstimate) -> String {
    let value = estimate(p.value, p.sd, &p.unit);
    match doubt(effects, effect, &p.name) {
        Some(doubt) => format!("{value}, {doubt}"),
        None => value,
    }
}

/// What keeps a parameter from being known.
fn doubt(effects: &[EffectReport], effect: &str, name: &String) -> Option<&'static str> {
    let of = effects.iter().find(|e| e.effect == effect)?;
    if of.undetermined.contains(name) {
        Some("as before any reading: not determined by this recording")
    } else if of.at_bound.contains(name) || of.shapes_at_bound.contains(name) {
        Some("at a bound of what is plausible")
    } else {
        None
    }
}

/// The parameters of an effect that are listed one by one, and the names of the others: in long lists, which hold a place for
/// every sequence, the places within a deviation of zero that nothing keeps from being known.
pub fn listed<'a>(
    all: &[EffectReport],
    entry: &'a EffectEntry,
    site: &Site,
) -> (Vec<&'a ParameterEstimate>, Vec<&'a str>) {
    let known = parameters(&entry.effect, site);
    let is_place = |p: &ParameterEstimate| {
        (known.iter()).any(|known| known.name == p.name && known.sequence.is_some())
    };
    let is_long = entry.parameters.len() > MOST_PARAMETERS;
    let (near_zero, shown): (Vec<_>, Vec<_>) = entry.parameters.iter().partition(|p| {
        let sure = doubt(all, &entry.effect, &p.name).is_none();
        is_long && is_place(p) && p.value.abs() <= p.sd && sure
    });
    let names = near_zero.iter().map(|p| p.name.as_str()).collect();
    (shown, names)
}

/// The parameters of an effect of the catalogue at a site; none of others.
pub fn parameters(effect: &str, site: &Site) -> Vec<Parameter> {
    let known = effects::named(&[effect]).into_iter().flatten();
    known.flat_map(|e| e.parameters(site)).collect()
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
    let of = |e: &EffectReport| format!("{} {}", e.effect, stated(e.probability));
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
    use super::super::sentence::tests::{of_effect, site};
    use super::*;

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
            at_bound: vec!["a_1".to_owned()],
            shapes_at_bound: vec!["s_1".to_owned()],
            ..serde_json::from_value(of_effect("a")).unwrap()
        };
        assert_eq!(
            determined(std::slice::from_ref(&of), "a", &p("c_2")),
            "0.0 ± 1.5 N m"
        );
        for name in ["a_1", "s_1"] {
            assert_eq!(
                determined(std::slice::from_ref(&of), "a", &p(name)),
                "0.0 ± 1.5 N m, at a bound of what is plausible"
            );
        }
        let untold = determined(&[of], "a", &p("c_1"));
        assert!(
            untold.contains("0.0 ± 1.5 N m")
                && untold.ends_with("not determined by this recording")
        );
        assert_eq!(percent(-0.001), "0 %");
        assert_eq!(percent(-0.01), "-1 %");
        assert_eq!([0.994, 1.0].map(stated), ["99 %", "over 99 %"]);
        assert_eq!(part(&Place::Frequency([0.5469, 17.5])), "0.55 to 18 Hz");
        assert_eq!(part(&Place::Frequency([0.0, 0.5469])), "below 0.55 Hz");
    }

    /// Only places of sequences are summed up, and none of which something is said.
    #[test]
    fn long_lists_are_shortened() {
        let sequences: Vec<String> = ["a", "b", "c", "d", "e", "f"].map(String::from).into();
        let parameter = |name: String| ParameterEstimate {
            value: if name == "dx_a" { 0.003 } else { 0.0005 },
            name,
            sd: 0.001,
            unit: "m".to_owned(),
        };
        let list = |effect: &str, sequences: &[String]| {
            let site = site(sequences.to_owned());
            let all = effects::named(&[effect]).unwrap()[0].parameters(&site);
            let entry = EffectEntry {
                effect: effect.to_owned(),
                parameters: all.into_iter().map(|p| parameter(p.name)).collect(),
            };
            let reports = [EffectReport {
                undetermined: vec!["dy_b".to_owned()],
                ..serde_json::from_value(of_effect(effect)).unwrap()
            }];
            let (shown, near_zero) = listed(&reports, &entry, &site);
            let shown: Vec<String> = shown.iter().map(|p| p.name.clone()).collect();
            (shown.join(" "), near_zero.len())
        };
        let (shown, near_zero) = list("registration_offset", &sequences);
        assert_eq!((shown.as_str(), near_zero), ("dx dy dz dx_a dy_b", 16));
        assert_eq!(list("registration_offset", &sequences[..3]).1, 0);
        assert_eq!(list("joint_coupling", &sequences).1, 0);
    }
}

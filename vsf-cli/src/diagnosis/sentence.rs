//! The answer of a diagnosis in a sentence, and what it found.

use super::words::{ROUGH, all_looked_for, estimate, percent, stated};
use vsf::gap::{
    Diagnosis, EffectEntry, EffectReport, Gap, ParameterEstimate, Role, Site, Verdict, VerdictKind,
    effects,
};

/// A gap of which so much is closed is explained, whatever the noise.
const CLOSED: f64 = 0.99;

/// Probability from which on it is told that an effect may be hidden.
const LEAST_HIDDEN: f64 = 0.05;

/// A claim of less probability is uncertain; an effect of more acts, whatever acts beside it.
const LIKELY: f64 = 0.5;
const CERTAIN: f64 = 0.95;
/// Most effects that are told to be likely in place of those named.
const MOST_RIVALS: usize = 2;

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

/// The answer in a sentence, and in others that a parameter stopped at a bound, and that a contact threshold stands for an effect.
pub fn verdict(diagnosis: &Diagnosis) -> String {
    let mut text = sentence(diagnosis);
    let stopped = at_bounds(diagnosis);
    if matches!(diagnosis.verdict.kind, VerdictKind::Effects) && !stopped.is_empty() {
        text += &format!(
            " {} stopped at a bound of what is plausible: what is named may stand for something else.",
            stopped.join(" and ")
        );
    }
    let open = &diagnosis.verdict.or_threshold;
    if !open.is_empty() {
        text += &format!(
            " What {} would do, another contact threshold does as well, and is taken here: where the threshold is known, \
             give it (--threshold).",
            open.join(" and ")
        );
    }
    text
}

fn sentence(diagnosis: &Diagnosis) -> String {
    let Diagnosis { verdict, gap, .. } = diagnosis;
    let p = stated(verdict.probability) + &whatever_else(diagnosis);
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
            "{effects} fit{s} best (probability {p}); the test sequences do not show {them}: their errors stay the same."
        ),
        VerdictKind::Effects if is_uncertain(diagnosis) => {
            format!("Uncertain: {effects} fit{s} best, with a probability of only {p}.")
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
            let none = match diagnosis.effects.len() {
                1 => "The one effect looked for is not".to_owned(),
                n => format!("None of the {n} effects looked for is"),
            };
            format!(
                "{none} borne out by this recording (probability that nothing of this acts: {p}); other effects of the \
                 catalogue were not looked for."
            )
        }
        VerdictKind::NoGap if is_uncertain(diagnosis) => format!(
            "Uncertain: no effect is borne out by this recording, but that none acts has a probability of only {p}."
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
            match open.as_slice() {
                [] => format!("Not diagnosable: {beside}, but this recording does not tell what."),
                [one] => format!(
                    "Not diagnosable: {beside}, but this recording does not tell whether that is {one}."
                ),
                _ => format!(
                    "Not diagnosable: {beside}, but this recording fits {} alike.",
                    open.join(", ")
                ),
            }
        }
    }
}

fn is_certain(diagnosis: &Diagnosis, effect: &str) -> bool {
    let of = diagnosis.effects.iter().find(|e| e.effect == effect);
    of.is_some_and(|e| e.probability >= CERTAIN)
}

/// Where effects are not named for certain, which of them act for certain, and what may act in their place.
fn whatever_else(diagnosis: &Diagnosis) -> String {
    let Verdict {
        kind,
        effects,
        probability,
        effect_set_95,
        ..
    } = &diagnosis.verdict;
    if *kind != VerdictKind::Effects || *probability >= CERTAIN {
        return String::new();
    }
    let certain = effects.iter().filter(|e| is_certain(diagnosis, e));
    let certain: Vec<&str> = certain.map(String::as_str).collect();
    let acts = match certain[..] {
        [] => String::new(),
        _ => format!("; that {} acts: 95 % or more", certain.join(" and ")),
    };
    let may_act = |e: &&EffectReport| {
        effect_set_95.contains(&e.effect)
            && !effects.contains(&e.effect)
            && e.probability >= 1.0 - CERTAIN
    };
    let mut others: Vec<&EffectReport> = diagnosis.effects.iter().filter(may_act).collect();
    others.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let others = others.iter().take(MOST_RIVALS);
    let others = others.map(|e| format!("; {}: {}", e.effect, stated(e.probability)));
    acts + &others.collect::<String>()
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
        Some(score) if diagnosis.gap.contact.is_some() => format!(
            ", though in the contact in which effects are looked for they are {score:.0} nats likelier with it"
        ),
        Some(score) => format!(", though they are {score:.0} nats likelier with it"),
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

/// Whether the effects named may be what the field shows.
fn like_field(diagnosis: &Diagnosis) -> bool {
    let named = |e: &&EffectReport| diagnosis.verdict.effects.contains(&e.effect);
    let mut named = diagnosis.effects.iter().filter(named).peekable();
    named.peek().is_some() && named.all(EffectReport::is_like_field)
}

#[cfg(test)]
pub mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use vsf::data::TorqueKind;

    /// An effect that was not fitted.
    pub fn of_effect(name: &str) -> serde_json::Value {
        serde_json::json!({
            "effect": name, "probability": 0.0, "score": 0.0, "parameters": [], "joints": [], "test_error": null,
            "closed_fraction": null, "absorbed_share": null, "roughness": null, "ambiguous_with": [],
            "testable": true,
        })
    }

    /// A report on an arm without contact.
    pub fn report(kind: &str, probability: f64, after: f64) -> Diagnosis {
        let effects: &[&str] = if kind == "effects" { &["payload"] } else { &[] };
        let catalogue = effects::catalogue();
        let all: Vec<_> = catalogue.iter().map(|e| of_effect(e.name())).collect();
        serde_json::from_value(serde_json::json!({
            "schema": 1, "dataset": "a", "effects": all, "notes": [],
            "gap": {"test_error_nominal": 1.0, "test_error_corrected": after, "noise_floor": 0.1,
                "closed_fraction": -0.09, "closed_interval": [-0.2, 0.1], "unit": "N",
                "corrected_by": effects},
            "where": {"joint": [], "phase": [], "link": [], "sequence": [], "frequency": [], "region": []},
            "verdict": {"effects": effects, "kind": kind, "probability": probability, "effect_set_95": effects},
            "next_experiment": {"action": "", "why": ""},
        }))
        .unwrap()
    }

    #[test]
    fn how_much_is_explained_is_said() {
        for (closed, after, words) in [
            (0.995, 0.5, "payload explains the gap (probability 90 %)."),
            (
                0.7,
                0.5,
                "payload explains most of the gap (probability 90 %).",
            ),
            (
                0.3,
                0.9,
                "payload explains part of the gap (probability 90 %).",
            ),
            (0.3, 0.29, "payload explains the gap (probability 90 %)."),
        ] {
            let mut found = report("effects", 0.9, after);
            found.gap.closed_fraction = closed;
            found.gap.closed_interval = [0.1, 1.0];
            assert_eq!(verdict(&found), words);
        }
    }

    /// What test sequences leave open, or ends at a bound, is said first.
    #[test]
    fn what_is_not_sure_is_not_claimed() {
        let mut found = report("effects", 0.9, 0.5);
        (found.gap.closed_fraction, found.gap.closed_interval) = (0.43, [-0.02, 0.58]);
        let open = "payload fits best (probability 90 %); whether it closes any of the gap, the test sequences do not tell.";
        assert_eq!(verdict(&found), open);
        found.gap.closed_interval = [0.1, 0.6];
        let payload = found.effects.iter_mut().find(|e| e.effect == "payload");
        payload.unwrap().at_bound = vec!["m".to_owned()];
        let stopped = "m stopped at a bound of what is plausible: what is named may stand for something else.";
        assert_eq!(
            verdict(&found),
            format!("payload fits best (probability 90 %). {stopped}")
        );
        found.gap.closed_interval = [-0.02, 0.58];
        assert_eq!(verdict(&found), format!("{open} {stopped}"));
    }

    /// One of several effects may act for certain, whatever acts beside it.
    #[test]
    fn a_threshold_that_stands_for_an_effect_is_told() {
        let mut d = report("no_gap", 0.6, 1.0);
        let before = verdict(&d);
        d.verdict.or_threshold = vec!["geometry_padding".to_owned()];
        let told = verdict(&d);
        let more = told.strip_prefix(&before).unwrap();
        assert!(
            more.contains("geometry_padding") && more.contains("--threshold"),
            "{told}"
        );
    }

    #[test]
    fn what_acts_for_certain_is_told() {
        let mut d = report("effects", 0.55, 0.5);
        (d.gap.closed_fraction, d.gap.closed_interval) = (0.7, [0.1, 1.0]);
        let names = ["payload", "adhesion", "anisotropy"].map(str::to_owned);
        d.verdict.effects = names[..2].to_vec();
        d.verdict.effect_set_95 = names.to_vec();
        let payload = d.effects.iter_mut().find(|e| e.effect == "payload");
        payload.unwrap().probability = 0.99;
        let named = "payload and adhesion explain most of the gap (probability 55 %; that payload acts: 95 % or more).";
        assert_eq!(verdict(&d), named);
        d.verdict.kind = VerdictKind::NotDiagnosable;
        let open = "Not diagnosable: beside payload something acts, but this recording fits adhesion, anisotropy alike.";
        assert_eq!(verdict(&d), open);
        d.verdict.effect_set_95.pop();
        let one = "Not diagnosable: beside payload something acts, but this recording does not tell whether that is adhesion.";
        assert_eq!(verdict(&d), one);
        (d.verdict.kind, d.verdict.probability) = (VerdictKind::Effects, 0.45);
        let uncertain = "Uncertain: payload and adhesion fit best, with a probability of only 45 %; that payload acts: 95 % or more.";
        assert_eq!(verdict(&d), uncertain);
    }

    /// What fits nearly as well is named with it.
    #[test]
    fn what_may_act_in_its_place_is_told() {
        let mut d = report("effects", 0.65, 0.5);
        d.verdict.effects = vec!["payload".to_owned()];
        d.verdict.effect_set_95 = vec!["payload".to_owned(), "adhesion".to_owned()];
        let adhesion = d.effects.iter_mut().find(|e| e.effect == "adhesion");
        adhesion.unwrap().probability = 0.35;
        let told = verdict(&d);
        assert!(
            told.contains("(probability 65 %; adhesion: 35 %)"),
            "{told}"
        );
    }

    /// Errors of touches that were never touched before say less than densities.
    #[test]
    fn test_sequences_that_speak_for_an_effect_are_told() {
        let mut d = report("effects", 0.9, 0.9);
        let named = d
            .effects
            .iter_mut()
            .find(|e| e.effect == "payload")
            .unwrap();
        named.test_score = Some(41.6);
        assert!(verdict(&d).ends_with("they are 42 nats likelier with it."));
    }

    /// An arm without points, and these sequences.
    pub fn site(sequences: Vec<String>) -> Site {
        Site {
            robot: vsf::robots::planar_arm(5, 0.3, 0.03).unwrap().into(),
            rest: vsf::core::RestPoints::new(Vec::new()).unwrap().into(),
            gravity: vsf::core::nalgebra::Vector3::zeros(),
            torque_kind: TorqueKind::External,
            friction: 0.0,
            sequences,
            duration: 1.0,
            sequence_duration: 1.0,
        }
    }

    /// Not what may be zero, nor what is small beside others of its unit, nor what only gives an effect its form.
    #[test]
    fn the_largest_amplitudes_are_told_first() {
        let site = site(Vec::new());
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
}

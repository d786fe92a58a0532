use super::sentence::{found, is_uncertain, verdict};
use super::torques::torques;
use super::words::{
    NEVER_SHOWS, OUT_OF_SIGHT, SHOWS_FROM, SQUARES, all_looked_for, closed, determined, figures,
    fitted, headings, kind_of_error, limits, look_alikes, none_of_these, out_of_sight, part, parts,
    percent, screened_out, size, stated, summary, touches, untestable, what_is_left,
};
use crate::console::{fixed, number};
use crate::html::{Script, document, escape};
use std::fmt::Write;
use vsf::gap::{
    Diagnosis, EffectEntry, EffectReport, Limit, LocatedShare, ModelFile, Outcome,
    ParameterEstimate, VerdictKind,
};

use vsf::data::TorqueKind;

const STYLE: &str = include_str!("page.css");
/// Share from which on a part is shown.
const LEAST: f64 = 0.005;

/// The diagnosis as one page that needs nothing else: no script, no network.
pub fn page(outcome: &Outcome, model: &ModelFile, warnings: &[String]) -> anyhow::Result<String> {
    let torques = before_and_after(outcome)?;
    let found = found(
        &outcome.diagnosis.verdict,
        &model.effects,
        outcome.campaign.site(),
    );
    Ok(with(
        &outcome.diagnosis,
        found,
        warnings,
        &torques,
        &model.effects,
    ))
}

/// The same of a report alone, which has no torques to draw.
pub fn page_of_report(d: &Diagnosis, warnings: &[String]) -> String {
    with(d, None, warnings, "", &[])
}

fn with(
    d: &Diagnosis,
    found: Option<String>,
    warnings: &[String],
    torques: &str,
    corrected: &[EffectEntry],
) -> String {
    let title = format!("Sim-to-real gap of {}", d.dataset);
    let mut html = format!("<h1>{}</h1>\n", escape(&title));
    html += &answer(d, found, warnings);
    html += torques;
    html += &places(d);
    html += &effects(d);
    html += &parameters(d, corrected);
    html += &left_out(d);
    if d.verdict.kind == VerdictKind::NoGap {
        html += &unseen(d);
    }
    let next = &d.next_experiment;
    let (action, why) = (escape(&next.action), escape(&next.why));
    html += &format!("<h2>Next experiment</h2>\n<p><b>{action}</b>: {why}.</p>\n");
    if !d.notes.is_empty() {
        html += "<h2>Notes</h2>\n";
        html += &d
            .notes
            .iter()
            .map(|n| format!("<p>{}</p>\n", escape(n)))
            .collect::<String>();
    }
    document(&title, STYLE, Script::None, &html)
}

/// What may be wrong with the recording: it may be the whole gap.
fn warned(warnings: &[String]) -> String {
    let paragraph = |w: &String| format!("<p>{}</p>\n", escape(w));
    let all: String = warnings.iter().map(paragraph).collect();
    match warnings.len() {
        0 => all,
        _ => format!("<div class=\"warned\">\n<h3>Warnings: check these first</h3>\n{all}</div>\n"),
    }
}

fn answer(d: &Diagnosis, found: Option<String>, warnings: &[String]) -> String {
    let gap = &d.gap;
    let unit = escape(&gap.unit);
    let corrects = !gap.corrected_by.is_empty();
    let kind = match d.verdict.kind {
        // Named, but not borne out by the test sequences.
        VerdictKind::Effects if !corrects => "unproven",
        VerdictKind::Effects | VerdictKind::NoGap if is_uncertain(d) => "uncertain",
        VerdictKind::Effects => "effects",
        VerdictKind::NoGap if !all_looked_for(d) => "uncertain",
        VerdictKind::NoGap => "no_gap",
        VerdictKind::Unknown => "unknown",
        VerdictKind::NotDiagnosable => "not_diagnosable",
    };
    let sentence = escape(&verdict(d)).replace(" %", "&nbsp;%");
    let [low, high] = gap.closed_interval.map(closed);
    let error = |value: f64| format!("{} {unit}", number(value));
    let floor = (
        "A perfect model".to_owned(),
        error(gap.noise_floor),
        if gap.noise_floor_is_bound {
            "at most: noise and what changes from sample to sample in contact"
        } else {
            "noise alone"
        }
        .to_owned(),
    );
    let what = kind_of_error(gap);
    let numbers = if corrects {
        vec![
            (
                format!("{what}, nominal"),
                error(gap.test_error_nominal),
                String::new(),
            ),
            (
                format!("{what}, corrected"),
                error(gap.test_error_corrected),
                String::new(),
            ),
            floor,
            (
                "Gap closed".to_owned(),
                closed(gap.closed_fraction),
                format!("95 %: {low} to {high}"),
            ),
        ]
    } else {
        vec![
            (
                what.to_owned(),
                error(gap.test_error_nominal),
                "nothing is corrected".to_owned(),
            ),
            floor,
        ]
    };
    let numbers: String = (numbers.iter())
        .map(|(term, value, more)| {
            format!("<div><dt>{term}</dt><dd>{value}<small>{more}</small></dd></div>\n")
        })
        .collect();
    let small = |text: &str| format!("<p class=\"small\">{}</p>\n", escape(text));
    let squares = if corrects {
        small(SQUARES)
    } else {
        String::new()
    };
    let found = found.map_or_else(String::new, |found| {
        format!("<span class=\"found\">{}</span>", escape(&found))
    });
    let parts = parts(gap).map_or_else(String::new, |parts| small(&parts));
    let left = what_is_left(d).map_or_else(String::new, small);
    let warned = warned(warnings);
    format!(
        "<p class=\"verdict {kind}\">{sentence}{found}</p>\n{warned}\
         <dl class=\"numbers\">\n{numbers}</dl>\n{parts}{squares}{left}"
    )
}

fn before_and_after(outcome: &Outcome) -> anyhow::Result<String> {
    let Some(drawn) = torques(outcome)? else {
        return Ok(String::new());
    };
    let sequence = escape(&drawn.sequence);
    let title = if outcome.model.parts.is_empty() {
        "Torques of the nominal model"
    } else {
        "Torques before and after"
    };
    let readings = match outcome.campaign.site().torque_kind {
        TorqueKind::External => "the environment's loads on the joints",
        TorqueKind::Measured => "what actuators measured beyond the arm's own weight and inertia",
    };
    let scene = outcome.campaign.scene();
    let shaded = if scene.rest().is_empty() {
        String::new()
    } else {
        format!(
            " Shaded: in contact, with a threshold of {} mm.",
            number(1e3 * scene.contact().threshold)
        )
    };
    let mut html = format!(
        "<h2>{title}</h2>\n<p class=\"small\">The checked sequence ({sequence}) on which \
         the nominal model is worst; joints by their share of the gap. Readings are {readings}.{shaded}</p>\n\
         <div class=\"plot worst\">{}</div>\n",
        drawn.worst
    );
    if let Some(all) = &drawn.all {
        html += &format!(
            "<details><summary>All joints</summary><div class=\"plot\">{all}</div></details>\n"
        );
    }
    Ok(html)
}

fn places(d: &Diagnosis) -> String {
    let found = &d.location;
    let links: &[LocatedShare] = if touches(&d.gap) { &found.link } else { &[] };
    let kinds: [(&str, &[LocatedShare]); 5] = [
        ("Joint", &found.joint),
        ("Phase", &found.phase),
        ("Sequence", &found.sequence),
        ("Link in contact", links),
        ("Frequency", &found.frequency),
    ];
    let of = if d.gap.corrected_by.is_empty() {
        "Shares of what the nominal model leaves unexplained."
    } else {
        "Shares of the torques that the named effects change; frequency: of what the nominal \
                  model leaves unexplained."
    };
    let mut html = format!(
        "<h2>Where</h2>\n<p class=\"small\">{of} Whiskers are 95 % intervals.</p>\n<div class=\"kinds\">\n"
    );
    let shown = |p: &&LocatedShare| p.share >= LEAST;
    for (kind, parts) in kinds {
        let bars: String = (parts.iter().filter(shown))
            .map(|p| bar(&part(&p.of), p.share, Some(p.interval)))
            .collect();
        if !bars.is_empty() {
            html += &panel(kind, &bars);
        }
    }
    if let Some(first) = found.region.first() {
        let bars = found.region.iter().map(|r| {
            let [x, y, z] = r.center.map(|v| fixed(v, 3));
            bar(&format!("{x}, {y}, {z}"), r.share, None)
        });
        let title = format!(
            "Place in contact [m], within {:.0} cm",
            100.0 * first.radius
        );
        html += &panel(&title, &bars.collect::<String>());
    }
    html + "</div>\n"
}

fn panel(title: &str, bars: &str) -> String {
    format!("<div><h3>{title}</h3>\n{bars}</div>\n")
}

/// A labeled bar of a share with its interval.
fn bar(label: &str, share: f64, interval: Option<[f64; 2]>) -> String {
    let x = |share: f64| 100.0 * share.clamp(0.0, 1.0);
    let whisker = interval.filter(|[low, high]| high - low > 0.005).map_or_else(String::new, |i| {
        let [low, high] = i.map(x);
        format!(
            "<line x1=\"{low:.1}%\" x2=\"{high:.1}%\" y1=\"9\" y2=\"9\" stroke=\"#1b2430\" stroke-width=\"2\"/>"
        )
    });
    format!(
        "<div class=\"bar\"><span>{}</span><svg aria-hidden=\"true\"><rect width=\"100%\" height=\"12\" y=\"3\" \
         fill=\"#eef1f4\"/><rect width=\"{:.1}%\" height=\"12\" y=\"3\" fill=\"#56b4e9\"/>{whisker}</svg>\
         <span>{}</span></div>\n",
        escape(label),
        x(share),
        percent(share),
    )
}

fn effects(d: &Diagnosis) -> String {
    let mut html = "<h2>Effects</h2>\n".to_owned();
    let rows: String = fitted(&d.effects).map(|e| row(d, e)).collect();
    let Some(first) = fitted(&d.effects).next() else {
        return html;
    };
    let columns: Vec<String> = (figures(&d.gap, first).iter())
        .map(|(heading, _)| format!("<th>{}</th>", escape(heading)))
        .collect();
    let dashes = "<td>&ndash;</td>".repeat(columns.len());
    let left = none_of_these(d).map_or_else(String::new, |(label, left)| {
        format!(
            "<tr><td>{label}</td><td>{}</td>{dashes}<td></td><td></td></tr>\n",
            percent(left)
        )
    });
    let _ = write!(
        html,
        "<p class=\"small\">{}.</p>\n<div class=\"wide\"><table>\n<tr><th>effect</th><th>probability</th>{}\
         <th class=\"words\">joints</th><th class=\"words\">looks like</th></tr>\n{rows}{left}</table></div>\n",
        headings(d),
        columns.concat()
    );
    html
}

/// The corrected model, then every effect as it was fitted on its own.
fn parameters(d: &Diagnosis, corrected: &[EffectEntry]) -> String {
    let list = |title: &str, name: &str, open: &str, parameters: &[ParameterEstimate]| {
        let items: String = (parameters.iter())
            .map(|p| {
                let value = determined(&d.effects, name, p);
                format!("<li><b>{}</b> {}</li>\n", escape(&p.name), escape(&value))
            })
            .collect();
        let (name, what) = (escape(name), escape(&summary(&d.effects, name)));
        format!(
            "<details{open}><summary>{title}{name}</summary>\n<p class=\"small\">{what}</p>\n\
             <ul>\n{items}</ul></details>\n"
        )
    };
    let corrected =
        (corrected.iter()).map(|e| list("Corrected model: ", &e.effect, " open", &e.parameters));
    let alone = fitted(&d.effects).map(|e| list("Alone: ", &e.effect, "", &e.parameters));
    corrected.chain(alone).collect()
}

/// Effects that were not fitted.
fn left_out(d: &Diagnosis) -> String {
    let mut html = String::new();
    let hidden = escape(&out_of_sight(&d.effects).join(", "));
    if !hidden.is_empty() {
        html += &format!("<p class=\"small\">Effects {OUT_OF_SIGHT}: {hidden}.</p>\n");
    }
    let behind: Vec<&str> = screened_out(&d.effects)
        .map(|e| e.effect.as_str())
        .collect();
    if !behind.is_empty() {
        let behind = escape(&behind.join(", "));
        html += &format!("<p class=\"small behind\">Far behind: {behind}.</p>\n");
    }
    for (reason, names) in untestable(&d.effects) {
        let (reason, names) = (escape(reason), escape(&names.join(", ")));
        html += &format!("<p class=\"small\">Not testable ({reason}): {names}.</p>\n");
    }
    html
}

/// How large effects would have to be.
fn unseen(d: &Diagnosis) -> String {
    let (shown, hidden) = limits(&d.effects);
    let row = |(effect, limit, from): (&str, &Limit, f64)| {
        let [effect, name] = [effect, &limit.name].map(escape);
        let from = escape(&size(from, &limit.unit));
        format!("<tr><td>{effect}</td><td>{name}</td><td>{from}</td></tr>\n")
    };
    let rows: String = shown.into_iter().map(row).collect();
    let mut html = String::new();
    if !rows.is_empty() {
        html += &format!(
            "<details><summary>Effects {SHOWS_FROM}</summary>\n<div class=\"wide\"><table>\n\
             <tr><th>Effect</th><th>Parameter</th><th>From</th></tr>\n{rows}</table></div></details>\n"
        );
    }
    if !hidden.is_empty() {
        let hidden = escape(&hidden.join(", "));
        html += &format!("<p class=\"small\">Effects that {NEVER_SHOWS}: {hidden}.</p>\n");
    }
    html
}

fn row(d: &Diagnosis, e: &EffectReport) -> String {
    let named = d.verdict.effects.contains(&e.effect);
    let or_none = |value: Option<String>| value.unwrap_or_else(|| "&ndash;".to_owned());
    let class = if named { " class=\"named\"" } else { "" };
    let (behind, alike) = look_alikes(&d.effects, e);
    let mut like = alike.join(", ");
    if !behind.is_empty() {
        let gap = if like.is_empty() { "" } else { "; " };
        like += &format!("{gap}far less likely: {}", behind.join(", "));
    }
    let values: String = (figures(&d.gap, e).into_iter())
        .map(|(_, value)| format!("<td>{}</td>", or_none(value)))
        .collect();
    format!(
        "<tr{class}><td>{}</td><td>{}</td>{values}\
         <td class=\"words\">{}</td><td class=\"words\">{}</td></tr>\n",
        escape(&e.effect),
        stated(e.probability),
        escape(&e.joints.join(", ")),
        escape(&like),
    )
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::super::sentence::tests::report;
    use super::super::words::errors;
    use super::*;
    use vsf::gap::MeanErrors;

    #[test]
    fn warnings_stand_below_the_verdict() {
        let d = report("effects", 0.6, 0.9);
        assert!(!page_of_report(&d, &[]).contains("class=\"warned\""));
        let page = page_of_report(&d, &["check < sign".to_owned()]);
        let place = |part: &str| page.find(part).unwrap();
        assert!(place("class=\"verdict") < place("<p>check &lt; sign</p>"));
        assert!(place("<p>check &lt; sign</p>") < place("class=\"numbers\""));
    }

    #[test]
    fn what_is_less_likely_than_not_is_uncertain() {
        for (kind, probability, class, words) in [
            ("no_gap", 0.33, "uncertain", "Uncertain: no effect"),
            ("no_gap", 0.6, "no_gap", "No gap:"),
            ("effects", 0.33, "uncertain", "Uncertain: payload fits best"),
            (
                "effects",
                0.6,
                "effects",
                "payload fits best (probability 60&nbsp;%); squared errors on the test sequences do not shrink.",
            ),
        ] {
            let page = page_of_report(&report(kind, probability, 0.9), &[]);
            let verdict = format!("class=\"verdict {class}\">{words}");
            assert!(page.contains(&verdict), "{verdict}: {page}");
        }
    }

    /// What is left is that nothing acts, or that the stiffness takes it up.
    #[test]
    fn what_the_stiffness_takes_up_is_told_beside() {
        let mut d = report("no_gap", 0.6, 1.0);
        d.verdict.hidden = 0.3;
        let page = page_of_report(&d, &[]);
        let words =
            "none acts: 60&nbsp;%, that one acts which the stiffness K takes up: 30&nbsp;%).";
        assert!(page.contains(words), "{page}");
        d.verdict.hidden = 0.01;
        assert!(page_of_report(&d, &[]).contains("none acts: 60&nbsp;%)."));
    }

    /// A gap of which only some effects were looked for may be there.
    #[test]
    fn a_restricted_search_finds_no_absence_of_a_gap() {
        let mut some = report("no_gap", 0.9, 1.0);
        some.effects.truncate(2);
        let page = page_of_report(&some, &[]);
        let words = "class=\"verdict uncertain\">None of the 2 effects looked for";
        assert!(page.contains(words), "{page}");
        assert!(!page.contains("No gap"), "{page}");
    }

    /// Of an arm in free air there are no links in contact, nor a stiffness.
    #[test]
    fn nothing_is_said_of_contact_in_free_air() {
        let mut d = report("effects", 0.9, 0.5);
        let none = serde_json::json!({"link": "none", "share": 1.0, "interval": [1.0, 1.0], "excess": 0.0});
        d.location.link = vec![serde_json::from_value(none).unwrap()];
        assert!(!page_of_report(&d, &[]).contains("Link in contact"));
        d.gap.threshold = Some(0.002);
        assert!(page_of_report(&d, &[]).contains("Link in contact"));
    }

    /// A mean error that falls beside a gap that grows.
    #[test]
    fn what_is_closed_is_explained() {
        let corrected = report("effects", 0.9, 0.9);
        assert!(page_of_report(&corrected, &[]).contains(SQUARES));
        assert!(errors(&corrected).ends_with(SQUARES));
        assert!(!errors(&report("effects", 0.9, 1.1)).contains(SQUARES));
        assert!(!page_of_report(&report("no_gap", 0.9, 1.0), &[]).contains(SQUARES));
    }

    /// Where nothing is touched, or all the time, there is nothing to tell apart.
    #[test]
    fn errors_in_the_air_and_in_contact_are_told_apart() {
        let mut d = report("effects", 0.9, 0.5);
        assert_eq!(parts(&d.gap), None);
        let errors = |nominal, corrected| MeanErrors {
            nominal,
            corrected,
            samples: 10,
        };
        d.gap.free = Some(errors(2.0, 0.1));
        assert_eq!(parts(&d.gap), None);
        d.gap.contact = Some(errors(3.0, 1.5));
        let words =
            "In the air 2.000 N before, 0.1000 N after; in contact 3.000 N before, 1.500 N after.";
        assert!(page_of_report(&d, &[]).contains(words));
        d.gap.corrected_by.clear();
        assert_eq!(
            parts(&d.gap).unwrap(),
            "In the air 2.000 N; in contact 3.000 N."
        );
    }

    /// An arm that is right in the air leaves the field what is wrong in contact.
    #[test]
    fn what_is_left_beside_an_effect_is_the_fields() {
        let mut d = report("effects", 0.9, 0.5);
        let errors = |corrected| MeanErrors {
            nominal: 9.0,
            corrected,
            samples: 10,
        };
        d.gap.noise_floor = 0.1;
        let at = serde_json::json!({"center": [0.0, 0.0, 0.0], "radius": 0.1, "share": 1.0});
        d.location.region = vec![serde_json::from_value(at).unwrap()];
        for (free, contact, told) in [(0.1, 0.9, true), (0.9, 0.9, false), (0.1, 0.1, false)] {
            d.gap.free = Some(errors(free));
            d.gap.contact = Some(errors(contact));
            assert_eq!(what_is_left(&d).is_some(), told, "{free} {contact}");
        }
    }

    #[test]
    fn names_are_text() {
        assert!(!bar("<script>", 0.5, None).contains("<script"));
    }

    #[test]
    fn whiskers_stay_in_the_bar() {
        let text = bar("a", 1.2, Some([-0.5, 2.0]));
        assert!(text.contains("x1=\"0.0%\" x2=\"100.0%\""), "{text}");
        assert!(!bar("a", 0.2, Some([0.2, 0.2])).contains("<line"));
    }
}

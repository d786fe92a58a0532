use super::sentence::{found, verdict};
use super::words::{
    LIKELY_ENOUGH, NEVER_SHOWS, OUT_OF_SIGHT, SHOWS_FROM, determined, errors, figures, fitted,
    headings, limits, listed, look_alikes, none_of_these, out_of_sight, parameters, part, parts,
    percent, screened_out, size, stated, summary, touches, untestable,
};
use crate::console::{fixed, table};
use vsf::gap::{Diagnosis, Limit, LocatedShare, ModelFile, Site, VerdictKind};

/// Parts named of every kind, and the share below which a part is not worth a word.
const PARTS: usize = 4;
const LEAST: f64 = 0.05;

/// The report on the terminal, below so many warnings.
pub fn text(diagnosis: &Diagnosis, model: &ModelFile, site: &Site, warnings: usize) -> String {
    let mut text = format!("{}\n", verdict(diagnosis));
    text += &match warnings {
        0 => String::new(),
        1 => "Read the warning above first: it may tell the cause.\n".to_owned(),
        n => format!("Read the {n} warnings above first: one of them may tell the cause.\n"),
    };
    if let Some(found) = found(&diagnosis.verdict, &model.effects, site) {
        text += &format!("Found {found}.\n");
    }
    text += &format!("{}\n", errors(diagnosis));
    if let Some(parts) = parts(&diagnosis.gap) {
        text += &format!("{parts}\n");
    }
    text += &effects(diagnosis, model, site);
    if diagnosis.verdict.kind == VerdictKind::NoGap {
        text += &unseen(diagnosis);
    }
    text += &places(diagnosis);
    let next = &diagnosis.next_experiment;
    text += &format!("\nnext experiment\n  {}: {}\n", next.action, next.why);
    for note in &diagnosis.notes {
        text += &format!("\nnote: {note}\n");
    }
    text
}

fn effects(diagnosis: &Diagnosis, model: &ModelFile, site: &Site) -> String {
    let all = &diagnosis.effects;
    let or_none = |value: Option<String>| value.unwrap_or_else(|| "-".to_owned());
    let mut header = vec!["effect".to_owned(), "probability".to_owned()];
    let mut rows: Vec<Vec<String>> = Vec::new();
    for e in fitted(all) {
        let (headings, values): (Vec<_>, Vec<_>) = figures(&diagnosis.gap, e).into_iter().unzip();
        if rows.is_empty() {
            header.extend(headings);
        }
        let mut row = vec![e.effect.clone(), stated(e.probability)];
        row.extend(values.into_iter().map(or_none));
        rows.push(row);
    }
    let header: Vec<&str> = header.iter().map(String::as_str).collect();
    let mut text = String::new();
    if !rows.is_empty() {
        if let Some((label, left)) = none_of_these(diagnosis) {
            let mut row = vec![label.to_owned(), percent(left)];
            row.resize(header.len(), or_none(None));
            rows.push(row);
        }
        text += &format!("\neffects ({})\n", headings(diagnosis));
        text += &table(&header, &rows);
    }
    for e in fitted(all).filter(|e| e.probability >= LIKELY_ENOUGH) {
        let (behind, alike) = look_alikes(all, e);
        if !behind.is_empty() {
            let names = behind.join(", ");
            text += &format!(
                "  {} looks much like {names} here (far less likely)\n",
                e.effect
            );
        }
        if !alike.is_empty() {
            text += &format!("  {} is not told from {}\n", e.effect, alike.join(", "));
        }
    }
    for e in &model.effects {
        text += &format!(
            "\ncorrected model, {}: {}\n",
            e.effect,
            summary(all, &e.effect)
        );
        let (shown, near_zero) = listed(all, e, site);
        let known = parameters(&e.effect, site);
        for p in shown {
            let joint = (known.iter().find(|known| known.name == p.name))
                .and_then(|known| site.robot.joints().get(known.joint?))
                .map_or_else(String::new, |joint| format!("  ({})", joint.name()));
            let value = determined(all, &e.effect, p);
            text += &format!("  {:<8} {value}{joint}\n", p.name);
        }
        if !near_zero.is_empty() {
            text += &format!("  within a deviation of zero: {}\n", near_zero.join(", "));
        }
    }
    let hidden = out_of_sight(all);
    if !hidden.is_empty() {
        text += &format!("\n{OUT_OF_SIGHT}: {}\n", hidden.join(", "));
    }
    let names: Vec<&str> = screened_out(all).map(|e| e.effect.as_str()).collect();
    if !names.is_empty() {
        text += &format!("\nfar behind: {}\n", names.join(", "));
    }
    for (reason, names) in untestable(all) {
        text += &format!("\nnot testable ({reason}): {}\n", names.join(", "));
    }
    text
}

/// How large effects would have to be.
fn unseen(diagnosis: &Diagnosis) -> String {
    let (shown, hidden) = limits(&diagnosis.effects);
    let row = |(effect, limit, from): (&str, &Limit, f64)| {
        vec![
            effect.to_owned(),
            limit.name.clone(),
            size(from, &limit.unit),
        ]
    };
    let rows: Vec<Vec<String>> = shown.into_iter().map(row).collect();
    let mut text = String::new();
    if !rows.is_empty() {
        text += &format!("\n{SHOWS_FROM}\n");
        text += &table(&["effect", "parameter", "from"], &rows);
    }
    if !hidden.is_empty() {
        text += &format!("\n{NEVER_SHOWS}: {}\n", hidden.join(", "));
    }
    text
}

/// The parts with the largest shares, in their own order.
fn largest(parts: &[LocatedShare]) -> Vec<&LocatedShare> {
    let mut shares: Vec<f64> = parts.iter().map(|p| p.share).collect();
    shares.sort_by(|a, b| b.total_cmp(a));
    let least = shares.get(PARTS - 1).map_or(LEAST, |s| s.max(LEAST));
    parts.iter().filter(|p| p.share >= least).collect()
}

fn places(diagnosis: &Diagnosis) -> String {
    let found = &diagnosis.location;
    let mut text = "\nwhere, by share of the gap\n".to_owned();
    let kinds: [(&str, &[LocatedShare]); 5] = [
        ("joint", &found.joint),
        ("phase", &found.phase),
        ("link", &found.link),
        ("sequence", &found.sequence),
        ("frequency", &found.frequency),
    ];
    for (kind, parts) in kinds {
        let words: Vec<String> = (largest(parts).into_iter())
            .map(|p| format!("{} {}", part(&p.of), percent(p.share)))
            .collect();
        // Frequencies are those of residuals, the others those of what the effect changes.
        let of = match kind {
            "frequency" => " of what the nominal model leaves",
            _ => "",
        };
        let says = !words.is_empty() && (kind != "link" || touches(&diagnosis.gap));
        if says {
            text += &format!("  {kind:<10} {}{of}\n", words.join(", "));
        }
    }
    if let Some(region) = found.region.first() {
        let [x, y, z] = region.center.map(|v| fixed(v, 4));
        let share = percent(region.share);
        text += &format!("  {:<10} {x}, {y}, {z} m {share} of contact\n", "region");
    }
    text
}

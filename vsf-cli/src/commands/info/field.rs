//! What a field says of itself.

use super::{bounds, place};
use crate::console::{in_line, number};
use crate::contact_flags::contact_flags;
use crate::field_file::FieldFile;
use serde::Serialize;
use vsf::data::{ContactParameters, listed};

#[derive(Serialize)]
pub struct Report<'a> {
    points: usize,
    bounds: Option<[[f64; 3]; 2]>,
    touched_points: Option<usize>,
    mean_stiffness: Option<f64>,
    largest_stiffness: Option<f64>,
    recording: Option<&'a str>,
    learned_from: Option<&'a [String]>,
    prior_sd: Option<f64>,
    noise_sd: Option<&'a [f64]>,
    contact_parameters: Option<&'a ContactParameters>,
    corrected_model: Option<&'a str>,
}

pub fn describe(file: &FieldFile) -> Report<'_> {
    let (field, stored) = (&file.field, &file.stored);
    let is_touched = |i: usize| stored.touched.get(i).copied().unwrap_or(true);
    let known = field.stiffness.iter().enumerate();
    let known: Vec<f64> = known
        .filter(|(i, _)| is_touched(*i))
        .map(|(_, k)| *k)
        .collect();
    let is_known = !known.is_empty();
    Report {
        points: field.points.len(),
        bounds: bounds(&field.points),
        touched_points: (!stored.touched.is_empty()).then_some(known.len()),
        mean_stiffness: is_known.then(|| known.iter().sum::<f64>() / known.len() as f64),
        largest_stiffness: known.iter().copied().reduce(f64::max),
        recording: field.recording.as_deref(),
        learned_from: field.learned_from.as_deref(),
        prior_sd: stored.prior_sd,
        noise_sd: stored.stored_noise_sd(),
        contact_parameters: field.contact.as_ref(),
        corrected_model: field.model.as_deref(),
    }
}

pub fn text(report: &Report<'_>) -> String {
    let unsaid = || "not said".to_owned();
    let mut text = format!("field of {} points", report.points);
    if let Some(bounds) = &report.bounds {
        text += &format!(", {}", place(bounds));
    }
    let of = match report.touched_points {
        Some(touched) => format!("of {touched} touched points"),
        None => "of all points".to_owned(),
    };
    let stiffness = match (report.mean_stiffness, report.largest_stiffness) {
        (Some(mean), Some(largest)) => format!(
            "{of}: mean {} N/m, largest {} N/m",
            number(mean),
            number(largest)
        ),
        _ => of,
    };
    let learned_from = match (report.recording, report.learned_from) {
        (Some(name), Some(ids)) => format!("{}: {}", in_line(name), listed(ids)),
        (Some(name), None) => in_line(name),
        (None, Some(ids)) => listed(ids),
        (None, None) => unsaid(),
    };
    let prior = report
        .prior_sd
        .map_or_else(unsaid, |sd| format!("sd {} N/m", number(sd)));
    let noise = match report.noise_sd {
        Some(all) => {
            let all: Vec<String> = all.iter().map(|sd| number(*sd)).collect();
            format!("sd {} N m (or N)", all.join(", "))
        }
        None => unsaid(),
    };
    let contact = match report.contact_parameters {
        Some(contact) => {
            let flags = contact_flags(contact);
            let flags = flags.iter().map(|(flag, value)| format!("{flag} {value}"));
            flags.collect::<Vec<_>>().join(" ")
        }
        None => unsaid(),
    };
    text += &format!(
        "\n  stiffness {stiffness}\n  learned   {learned_from}\n  prior     {prior}\n  noise     {noise}\n  contact   \
         {contact}\n  model     {}\n",
        report
            .corrected_model
            .map_or_else(|| "none".to_owned(), shortened),
    );
    text
}

/// The effects of a model, their numbers to four digits, without the unit of those that have none.
fn shortened(model: &str) -> String {
    let word = |word: &str| {
        let parsed = word.split_once('=').and_then(|(name, value)| {
            let value = value.parse().ok()?;
            Some(format!("{name}={}", number(value)))
        });
        parsed.unwrap_or_else(|| word.to_owned())
    };
    let effect = |effect: &str| {
        let words = effect.split(' ').filter(|word| *word != "1");
        words.map(word).collect::<Vec<_>>().join(" ")
    };
    in_line(&model.split("; ").map(effect).collect::<Vec<_>>().join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_told_in_four_digits() {
        let model = "joint_coulomb_friction c_2=0.2986280661467844 N m s_2=-0.0012410849 1; latency delta=0.02 s";
        let short = "joint_coulomb_friction c_2=0.2986 N m s_2=-0.001241; latency delta=0.02000 s";
        assert_eq!(shortened(model), short);
    }
}

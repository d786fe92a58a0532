//! The words of the report.

use super::Report;
use crate::console::number;
use crate::fit::{NOISE_SD, PRIOR_SD, Threshold};
use vsf::data::listed;
use vsf::pipeline::{HyperMethod, Scene};

/// The noise of the channels in words.
pub fn noise_text(scene: &Scene, noise_sd: &[f64]) -> String {
    let sds: Vec<String> = noise_sd.iter().map(|&sd| number(sd)).collect();
    format!("{} {}", sds.join(", "), scene.error_unit())
}

/// How prior or noise were found, in words.
fn found(what: &str, given: &[&str], method: Option<HyperMethod>) -> String {
    match given {
        given if given.contains(&what) => "as given".to_owned(),
        [] => how(method).to_owned(),
        [other, ..] => format!("its ratio to {other} {}", how(method)),
    }
}

/// How prior and noise were chosen, in words.
pub fn how(method: Option<HyperMethod>) -> &'static str {
    match method {
        None => "as given",
        Some(HyperMethod::Likelihood) => "chosen by marginal likelihood",
        Some(_) => "chosen on held-out readings",
    }
}

/// The report in words; `correlates`: whether the estimator keeps correlations.
pub(super) fn text(report: &Report, scene: &Scene, correlates: bool) -> String {
    let mut text = format!(
        "estimated from {} samples of {} ({} in contact): {}\n",
        report.samples,
        match report.sequences.len() {
            1 => "one sequence".to_owned(),
            n => format!("{n} sequences"),
        },
        report.contact_samples,
        listed(&report.sequences),
    );
    text += &format!(
        "  contact     threshold {} mm\n",
        number(1e3 * report.threshold)
    );
    if !report.thresholds.is_empty() {
        let one = |t: &Threshold| format!("{} mm {}", number(1e3 * t.threshold), number(t.error));
        let all: Vec<String> = report.thresholds.iter().map(one).collect();
        text += &format!(
            "              chosen on held-out readings: {} {}\n",
            all.join(", "),
            scene.error_unit()
        );
    }
    let robust = match report.robust.as_str() {
        "none" => String::new(),
        loss => format!(", robust ({loss})"),
    };
    text += &format!(
        "  estimator   {}{robust}\n  prior       N(0, {}²) N/m, {}\n",
        report.estimator,
        number(report.prior_sd),
        found(PRIOR_SD, report.given, report.chosen_by),
    );
    let kept = if correlates {
        ""
    } else {
        ", of which this estimator keeps the variance alone"
    };
    if report.smooth_sd > 0.0 {
        text += &format!(
            "              and N(0, {}²) N/m smooth over {} m{kept}\n",
            number(report.smooth_sd),
            number(report.smooth_length),
        );
    }
    if report.level_sd > 0.0 {
        let sd = number(report.level_sd);
        text += &format!("              and N(0, {sd}²) N/m common to all points{kept}\n");
    }
    if report.vision != "none" {
        text += &format!(
            "  vision      {}, {} of its guess in the prior's mean\n",
            report.vision,
            number(report.vision_share),
        );
    }
    text += &format!(
        "  noise sd    {}, {}\n",
        noise_text(scene, report.noise_sd),
        found(NOISE_SD, report.given, report.chosen_by),
    );
    if let Some(ratio) = report.nis_ratio {
        text += &format!(
            "  innovations their squares are {} times what prior and noise allow\n",
            number(ratio)
        );
    }
    text += &format!(
        "  field       {} of {} points touched, {} of them at 0 N/m; mean over all touched {} N/m\n",
        report.touched_points,
        report.points,
        report.points_at_zero,
        number(report.mean_stiffness),
    );
    for out in &report.out {
        text += &format!("wrote {out}\n");
    }
    text
}

use crate::console::{Console, MADE_BY, texts};
use crate::diagnosis::{page, plain, text};
use crate::exit::usage;
use crate::file_kind::FileKind;
use crate::range::ending;
use crate::recording::RecordingArgs;
use anyhow::Context;
use clap::builder::{PossibleValue, PossibleValuesParser};
use std::path::PathBuf;
use std::sync::Arc;
use vsf::gap::{DiagnosisStep, Effect, ModelFile, Outcome, VerdictKind, diagnose, effects};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  vsf diagnose DATASET --effects payload,latency --html report.html \\
      --model corrected.json

Six sequences with 700 samples each take some ten seconds of two cores; recordings with ten minutes of contact, or in which \
thousands of points are touched at a time, take minutes. Robots have 48 joints at most.

In the report, `score` is the gain of log evidence over the model without effects, `null` the score that is \
reached where nothing acts (probabilities follow what is beyond), `test score` the gain of log density on \
the test sequences, `absorbed by K` how much of the effect the stiffness takes. Parameters of joints are numbered \
by their columns, from 1.

Recordings without points are those of an arm in free air; effects that a recording cannot show are listed \
as untestable. Probabilities are those of the catalogue's effects, of sets of up to four of them, and of \
no gap. With contact, errors before and after are those of the fields that `vsf estimate --threshold` gives without the corrected \
model and with it, at a contact threshold of 0.8 of the points' spacing (for models of contact at that of the search, where it predicts \
better; see threshold), where there are test sequences that no model has learned from; those of single effects (in JSON, and \
in the report where there are no such fields) are of fields that the diagnosis fits to windows of the train sequences, \
in the same way for every model. `stiffness_field`, among what an effect is not \
told from, is an object whose stiffness differs from place to place.

JSON keys: schema, dataset, gap (test_error_nominal, test_error_corrected, noise_floor, noise_floor_is_bound: whether it is at most that, as read in contact, closed_fraction: share of \
the squared errors beyond noise, closed_interval, unit, corrected_by, estimated: whether the errors are of fields of `vsf estimate`, \
in_sample: whether they are those of the fit, for want of test sequences, \
threshold, threshold_nominal: contact thresholds (m) of the corrected and of the nominal model's field, free and contact: the \
errors with nothing touched and in contact, where there is both (nominal, corrected, samples)), where (joint, phase, link, sequence and frequency, each a list of its own key, share, \
interval and excess; region: center, radius, share), effects (effect, summary, probability, score, null_score, parameters (name, \
value, std, unit), undetermined, at_bound, shapes_at_bound, joints, roughness (contact, joint, walk: what the fit takes for the roughness of the model), test_error, closed_fraction, test_score, absorbed_share, ambiguous_with, shows_from \
(name, value: the size of the parameter below which the effect would not show, null where no plausible one \
does, unit; the parameter that shows best first), testable, reason), verdict (effects, kind: effects, no_gap, unknown or not_diagnosable, probability, effect_set_95, \
hidden: the probability that an effect acts which the stiffness takes up, shared by the effects where there is no gap, or_threshold: \
effects in whose place another contact threshold is taken, where there are any), \
next_experiment (action, why), notes.")]
pub struct Args {
    /// Names of the effects that may act; the whole catalogue by default
    #[arg(long, value_delimiter = ',', value_parser = PossibleValuesParser::new(known()))]
    effects: Option<Vec<String>>,
    /// One page for people: verdict, torques before and after, where, effects, next experiment; .html
    #[arg(long, value_name = "FILE", value_parser = ending("html"))]
    html: Option<PathBuf>,
    /// The corrected model, for `vsf estimate --model` and its like; .json
    #[arg(long, value_name = "FILE", value_parser = ending("json"))]
    model: Option<PathBuf>,
    /// Seed of the intervals' bootstrap
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    recording: RecordingArgs,
}

/// The effects by name, each with what it is.
fn known() -> impl Iterator<Item = PossibleValue> {
    let value =
        |e: Arc<dyn Effect>| PossibleValue::new(e.name().to_owned()).help(plain(e.summary()));
    effects::catalogue().into_iter().map(value)
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    let candidates = match &args.effects {
        None => effects::catalogue(),
        Some(names) => {
            if let Some(k) = (1..names.len()).find(|&k| names[..k].contains(&names[k])) {
                return Err(usage(format!("--effects names {} twice", names[k])));
            }
            effects::named(names)?
        }
    };
    for (flag, path, kind) in [
        ("--html", &args.html, FileKind::Page),
        ("--model", &args.model, FileKind::Model),
    ] {
        path.iter()
            .try_for_each(|path| console.outputs.file(flag, path, Some(kind)))?;
    }
    let recording = args.recording.open_to_diagnose(console)?;
    let campaign = recording.campaign(console)?;
    let bar = console.bar(DiagnosisStep::ALL.len(), "diagnosis");
    let progress = |step: DiagnosisStep| {
        let done = DiagnosisStep::ALL.iter().position(|s| *s == step);
        bar.set_position(done.unwrap_or(0) as u64);
    };
    let mut outcome = diagnose(&campaign, &candidates, args.seed, progress)?;
    bar.finish_and_clear();
    let warnings = console.warnings();
    if args.effects.is_some() {
        outcome.diagnosis.notes.push(
            "only the effects of --effects were looked for; what others would explain may be laid to them".to_owned(),
        );
    }
    let mut model = outcome.model_file()?;
    model.made_by = Some(MADE_BY.to_owned());
    let verdict = &outcome.diagnosis.verdict;
    let unknown = verdict.kind != VerdictKind::Effects && !model.effects.is_empty();
    if let Some(path) = args.model.as_deref().filter(|_| unknown) {
        let path = path.display();
        console.warn(format!(
            "{path} holds what comes closest, not a known cause: see the verdict"
        ));
    }
    let site = outcome.campaign.site();
    let report = text(&outcome.diagnosis, &model, site, warnings.len());
    let written = write(args, &outcome, &model, &warnings, console);
    let lines = written.as_ref().map_or_else(
        |_| String::new(),
        |paths| {
            texts(paths)
                .iter()
                .map(|p| format!("wrote {p}\n"))
                .collect()
        },
    );
    // What was computed is told, whatever can be written.
    console.report(report + &lines)?;
    written.map(|_| ())
}

/// Writes results, page and model, all or none; where the latter two lie.
fn write(
    args: &Args,
    outcome: &Outcome,
    model: &ModelFile,
    warnings: &[String],
    console: &Console,
) -> anyhow::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    if let Some(path) = &args.html {
        let page = page(outcome, model, warnings);
        files.push((
            path.clone(),
            page.context("--html: a page cannot show this recording")?,
        ));
    }
    if let Some(path) = &args.model {
        files.push((path.clone(), model.to_json()));
    }
    let written = files.iter().map(|(path, _)| path.clone()).collect();
    console.json_and(&outcome.diagnosis, files)?;
    Ok(written)
}

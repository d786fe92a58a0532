use crate::console::{Console, MADE_BY, texts};
use crate::diagnosis::{page, plain, text};
use crate::exit::usage;
use crate::file_kind::FileKind;
use crate::range::{ending, seed};
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

Six sequences of 700 samples each take about ten seconds on two cores. Recordings with ten minutes of contact, \
or with thousands of points touched at a time, take minutes. Robots have 48 joints at most.

Columns of the report:
  score          gain of log evidence over the model without effects
  null           score that is reached if nothing acts; probabilities
                 depend on the score beyond it
  test score     gain of log density on the test sequences
  absorbed by K  how much of the effect the stiffness absorbs

Parameters of joints are numbered by their columns, from 1.

Recordings without points are those of an arm in free air. Effects that a recording cannot show are listed as \
untestable. Probabilities are those of the catalogue's effects, of sets of up to four of them, and of no gap.

With contact, and test sequences that no model has learned from, the errors before and after are those of the \
fields that `vsf estimate --threshold` gives without and with the corrected model. Their contact threshold is \
0.8 of the points' spacing. If the corrected model acts on contact or springs, or needs contact (as \
inertia_drag and spatial_coupling do), its field has the threshold of the search instead, and the nominal \
field the one of the two that predicts better. The errors of single effects (in JSON, and in the report if there are no such fields) are those of fields that the diagnosis fits \
to windows of the train sequences, in the same way for every model.

In `ambiguous_with`, `stiffness_field` stands for an object whose stiffness differs from place to place.

JSON keys:
  schema, dataset
  gap
      test_error_nominal, test_error_corrected
      noise_floor, noise_floor_is_bound (whether it is an upper bound, as
          read in contact)
      closed_fraction (share of the squared errors beyond noise),
          closed_interval
      unit, corrected_by
      estimated (whether the errors are those of fields of `vsf estimate`)
      in_sample (whether they are those of the fit, for lack of test
          sequences)
      threshold, threshold_nominal (contact thresholds of the fields of
          the corrected and the nominal model, m)
      free, contact (errors with nothing touched and in contact, if there
          are both: nominal, corrected, samples)
  where
      joint, phase, link, sequence, frequency (lists; each entry has a
          key of that name, share, interval and excess)
      region (center, radius, share)
  effects
      effect, summary, probability, score, null_score
      parameters (name, value, std, unit)
      undetermined, at_bound, shapes_at_bound, joints
      roughness (contact, joint, walk: what the fit takes as the
          roughness of the model)
      test_error, closed_fraction, test_score, absorbed_share,
          ambiguous_with
      shows_from (name, value, unit: smallest size of the parameter at
          which the effect would show, null if no plausible size would;
          the parameter that shows best comes first)
      testable, reason
  verdict
      effects, kind (effects, no_gap, unknown or not_diagnosable)
      probability, effect_set_95
      hidden (probability that an effect acts which the stiffness absorbs;
          shared by the effects if there is no gap)
      or_threshold (effects that another contact threshold explains as
          well; it is used instead)
  next_experiment (action, why)
  notes")]
pub struct Args {
    /// Names of the effects that may act; default: the whole catalogue
    #[arg(long, value_delimiter = ',', value_parser = PossibleValuesParser::new(known()))]
    effects: Option<Vec<String>>,
    /// File for a report page, .html: verdict, torques before and after, where, effects, next experiment
    #[arg(long, value_name = "FILE", value_parser = ending("html"))]
    html: Option<PathBuf>,
    /// File for the corrected model, .json, to be used by `vsf estimate --model` and other commands
    #[arg(long, value_name = "FILE", value_parser = ending("json"))]
    model: Option<PathBuf>,
    /// Seed of the bootstrap of the intervals
    #[arg(long, default_value_t = 0, value_parser = seed)]
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

use crate::console::{Console, read_text, texts};
use crate::corrected::knows;
use crate::diagnosis::{page, plain, text};
use crate::exit::usage;
use crate::range::ending;
use crate::recording::{Recording, RecordingArgs};
use clap::builder::{PossibleValue, PossibleValuesParser};
use std::path::PathBuf;
use std::sync::Arc;
use vsf::gap::{
    Campaign, DiagnosisStep, Effect, Estimated, Model, ModelFile, VerdictKind, diagnose, effects,
};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  vsf diagnose DATASET --effects payload,latency --html report.html --model corrected.json

In the report, `score` is the gain of log evidence over the model without effects, `null` what of it says nothing \
yet, as it is gained where nothing acts (probabilities follow what is beyond), `closed` the share of the gap on
the test sequences, `absorbed by K` how much of the effect the stiffness takes. Parameters of joints are numbered
by their columns, from 1.

Recordings without points are those of an arm in free air; effects that a recording cannot show are listed
as untestable. Probabilities are those of the catalogue's effects, of pairs of them (in free air of up to four), and of
no gap. With contact,
errors are those of a field that the diagnosis fits to windows of the train sequences, in the same way for every
model; what the fields of `vsf estimate` leave, without the corrected model and with it, is told beside them. `stiffness_field`, among what an effect is not told
from, is an object whose stiffness differs from place to place.

JSON keys: schema, dataset, gap (test_error_nominal, test_error_corrected, noise_floor, closed_fraction: share of
the squared errors beyond noise, closed_interval, unit, corrected_by, estimated: error_nominal, threshold_nominal, error_corrected, threshold_corrected), where (joint, phase, link, sequence and frequency, each a list of its own key, share,
interval and excess; region: center, radius, share), effects (effect, summary, probability, score, null_score, parameters (name,
value, std, unit), joints, test_error, closed_fraction, test_score, absorbed_share, ambiguous_with, shows_from
(name, value: the size of the parameter below which the effect would not show, null where no plausible one
does, unit; the parameter that shows best first), testable, reason), verdict (effects, kind: effects, no_gap, unknown or not_diagnosable, probability, effect_set_95),
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
    for (flag, path) in [("--html", &args.html), ("--model", &args.model)] {
        path.iter()
            .try_for_each(|path| console.outputs.file(flag, path))?;
    }
    if let Some(path) = args.model.as_deref().filter(|path| path.is_file()) {
        let earlier = read_text(path)?;
        ModelFile::from_json(&earlier).map_err(|_| {
            let path = path.display();
            usage(format!(
                "--model {path} holds something else; choose a new file, or a corrected model to replace"
            ))
        })?;
    }
    let recording = args.recording.open(console)?;
    let campaign = recording.campaign(console)?;
    let name = &recording.dataset.name;
    let bar = console.bar(DiagnosisStep::ALL.len(), "diagnosis");
    let progress = |step: DiagnosisStep| {
        let done = DiagnosisStep::ALL.iter().position(|s| *s == step);
        bar.set_position(done.unwrap_or(0) as u64);
    };
    let mut outcome = diagnose(&campaign, name, &candidates, args.seed, progress)?;
    bar.finish_and_clear();
    if args.effects.is_some() {
        outcome.diagnosis.notes.push(
            "only the effects of --effects were looked for; what others would explain may be laid to them".to_owned(),
        );
    }
    if !campaign.scene().rest().is_empty() {
        let spinner = console.spinner("fields with and without the corrected model");
        match estimated(&recording, &campaign, &outcome.model) {
            Ok(found) => outcome.diagnosis.gap.estimated = found,
            Err(e) => console.warn(format!(
                "no field could be estimated to compare with: {e:#}"
            )),
        }
        spinner.finish_and_clear();
    }
    let scene = campaign.scene();
    let mut model = ModelFile::new(campaign.site(), &outcome.model, &outcome.sd)?;
    model.recording = Some(name.clone());
    model.contact = (!scene.rest().is_empty()).then(|| scene.contact_parameters());
    let mut files = Vec::new();
    if let Some(path) = &args.html {
        files.push((path.clone(), page(&campaign, &outcome, &model)?));
    }
    if let Some(path) = &args.model {
        files.push((path.clone(), model.to_json()));
    }
    let verdict = &outcome.diagnosis.verdict;
    let unknown = verdict.kind != VerdictKind::Effects && !model.effects.is_empty();
    if let Some(path) = args.model.as_deref().filter(|_| unknown) {
        let path = path.display();
        console.warn(format!(
            "{path} holds what comes closest, not a known cause: see the verdict"
        ));
    }
    let written: Vec<PathBuf> = files.iter().map(|(path, _)| path.clone()).collect();
    console.json_and(&outcome.diagnosis, files)?;
    let lines: String = texts(&written)
        .iter()
        .map(|p| format!("wrote {p}\n"))
        .collect();
    console.report(text(&outcome.diagnosis, &model) + &lines)
}

/// What `vsf estimate` makes of the recording, with the nominal model and with the corrected one. Nothing of a model that
/// has learned from test sequences.
fn estimated(
    recording: &Recording,
    diagnosed: &Campaign,
    model: &Model,
) -> anyhow::Result<Option<Estimated>> {
    let mut tested = recording.dataset.splits.test.iter();
    if tested.any(|id| knows(model, diagnosed, id)) {
        return Ok(None);
    }
    let scene = recording.suited(diagnosed.scene())?;
    // Contacts that the diagnosis knows are not run through again.
    let suited = match scene.contact() == diagnosed.scene().contact() {
        true => diagnosed.clone(),
        false => Campaign::in_scene(&recording.dataset, scene)?,
    };
    let of = |campaign: &Campaign, model: &Model| {
        let error = campaign.estimated_error(model)?;
        Ok::<_, anyhow::Error>(error.map(|e| (e, campaign.scene().contact().threshold)))
    };
    let Some(nominal) = of(&suited, &Model::default())? else {
        return Ok(None);
    };
    let corrected = match model {
        model if model.parts.is_empty() => Some(nominal),
        model if model.follows_contact() => of(diagnosed, model)?,
        model => of(&suited, model)?,
    };
    Ok(corrected.map(|corrected| Estimated {
        error_nominal: nominal.0,
        threshold_nominal: nominal.1,
        error_corrected: corrected.0,
        threshold_corrected: corrected.1,
    }))
}

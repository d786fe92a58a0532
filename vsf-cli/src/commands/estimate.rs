pub mod text;

use crate::console::{Console, texts};
use crate::corrected::{CorrectedModel, ModelArgs};
use crate::exit::usage;
use crate::field_file::{FieldFormat, claim, save};
use crate::fit::{Compared, Threshold, compare, fit};
use crate::range::length;
use crate::recording::{RecordingArgs, SplitPart, untouched};
use crate::settings::EstimatorSettings;
use serde::{Serialize, Serializer};
use std::path::PathBuf;
use text::text;
use vsf::data::StiffnessField;
use vsf::pipeline::{
    Candidate, Estimate, EstimatorSpec, HyperMethod, PipelineError, Scene, Trace, VisionCandidate,
    VisionSpec, closer_thresholds, field_warnings, fit_warnings, health_warnings, view_warnings,
};

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The field holds the points, K (mean, N/m), K_std (standard deviation), the contact parameters, and the \
features touched, prior_sd (of all parts of the prior together) and noise_sd. For points never touched, K_std \
is that of the prior: an upper bound where their neighbors say something about their K. `vsf predict`, \
`evaluate`, `simulate`, `export` and `view` use the contact parameters of the field. They warn of flags that \
contradict these, and of a corrected model other than the one that the field was estimated with.

JSON keys:
  estimator, robust (none, huber or student-t)
  prior_sd, smooth_sd, smooth_length, level_sd, noise_sd (per channel)
  given (which of prior_sd and noise_sd)
  chosen_by (how the others were chosen: held-out or likelihood; or given)
  candidates (smooth_share, length, level_share, signal_to_noise, error
      or log_evidence)
  threshold (of contact, m)
  thresholds (those compared: threshold, error)
  sequences, samples, contact_samples, points, touched_points
  mean_stiffness (of the touched points), points_at_zero (among these)
  vision (none, a method or a file), vision_share (of its guess, in the
      prior), vision_candidates (share, error)
  nis_ratio, out")]
pub struct Args {
    /// Output for the field, by ending: .npz, .ply, .mcap, or none for a folder (new, empty, or with a field to
    /// replace); may be repeated
    #[arg(long, default_value = "field.npz")]
    out: Vec<PathBuf>,
    /// IDs of the sequences to learn from, in this order; default: the train split
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Contact thresholds to compare [m], such as 0.008,0.016: takes the first one that predicts held-out touches
    /// as well as the best, within one standard error; prior and noise are chosen for each
    ///
    /// Default: 0.8 of the points' spacing, and a quarter and a sixteenth of that (if at least 0.1 mm, and at least
    /// the error of mesh grids). These are compared only if no threshold is set (by flag, configuration, recording or
    /// model), no --model depends on contact, and `batch`, `exact` or `information` chooses prior and noise on held-out
    /// touches, with at least four touches and at most 1500 touched points.
    #[arg(long, value_delimiter = ',', value_parser = length, conflicts_with = "threshold")]
    thresholds: Option<Vec<f64>>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    recording: RecordingArgs,
    #[command(flatten)]
    estimator: EstimatorSettings,
}

#[derive(Serialize)]
struct Report<'a> {
    estimator: String,
    robust: String,
    prior_sd: f64,
    smooth_sd: f64,
    smooth_length: f64,
    level_sd: f64,
    noise_sd: &'a [f64],
    given: &'a [&'static str],
    #[serde(serialize_with = "or_given")]
    chosen_by: Option<HyperMethod>,
    candidates: &'a [Candidate],
    threshold: f64,
    thresholds: &'a [Threshold],
    sequences: Vec<&'a str>,
    samples: usize,
    contact_samples: usize,
    points: usize,
    touched_points: usize,
    mean_stiffness: f64,
    points_at_zero: usize,
    vision: String,
    vision_share: f64,
    vision_candidates: &'a [VisionCandidate],
    nis_ratio: Option<f64>,
    out: Vec<String>,
}

/// `given` where nothing was chosen.
fn or_given<S: Serializer>(method: &Option<HyperMethod>, serializer: S) -> Result<S::Ok, S::Error> {
    match method {
        Some(method) => method.serialize(serializer),
        None => serializer.serialize_str("given"),
    }
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    args.out
        .iter()
        .try_for_each(|out| FieldFormat::check_estimate(out))?;
    args.out.iter().try_for_each(|out| claim(out, console))?;
    let settings = &args.estimator;
    let spec = settings.spec()?;
    let model = args.model.open(console)?;
    let recording = args.recording.open(console)?;
    let sequences = recording.sequences(args.sequences.as_deref(), SplitPart::Train)?;
    // What is missing is told before contact takes its time.
    if let Some(file) = settings.vision_file() {
        console.outputs.keep(file)?;
    }
    let view = match settings.vision()? {
        None => None,
        Some(vision) => Some((recording.view()?.ok_or(PipelineError::NoCamera)?, vision)),
    };
    if let Some((_, VisionSpec::Learned(learned))) = &view
        && learned.names().contains(&recording.dataset.name)
    {
        console.warn(format!(
            "--vision: what it holds was learned from a recording of this name, {}, too; if that is of this object, its touches \
         count twice, and test touches that it has learned from are no test",
            recording.dataset.name
        ));
    }
    let follows = model.as_ref().is_some_and(CorrectedModel::follows_contact);
    if args.thresholds.is_some() {
        if settings.method() != HyperMethod::HeldOut {
            return Err(usage(
                "--thresholds are compared on held-out touches; leave out --hyper, or give --threshold",
            ));
        }
        if follows {
            return Err(usage(
                "--thresholds cannot be compared under this --model, whose effects are relative to the contact that they were \
                 found in; leave one of them out",
            ));
        }
    }
    let own = recording.scene_to_learn(model.as_ref(), args.thresholds.as_deref(), console)?;
    if let Some((view, _)) = &view {
        console.warn_all(view_warnings(own.rest(), view));
    }
    let traces = match &model {
        None => recording.traces(&own, &sequences, console)?,
        Some(model) => {
            let corrected = model.sequences(&recording, &own, &sequences, console)?;
            corrected.into_iter().map(|c| c.trace).collect()
        }
    };
    if let Some(error) = untouched(&own, &traces, &sequences) {
        return Err(error.into());
    }
    // The optimum chooses, so that filters that do not come near it are left with what suits the points.
    let is_left = spec.keeps_correlations()
        && settings.chooses_on_held_out()
        && !follows
        && !recording.has_threshold(model.as_ref());
    let others = match &args.thresholds {
        Some(all) => all[1..].to_vec(),
        None if is_left => closer_thresholds(&own, &traces)?,
        None => Vec::new(),
    };
    let contact = |scene: &Scene| match &model {
        None => Ok(scene.traces(&sequences, || {})?),
        Some(model) => model.traces(&recording.dataset, scene, &sequences),
    };
    let asked = args.thresholds.is_some();
    let Compared {
        scene,
        traces,
        thresholds,
        choice,
    } = compare(
        (own, traces),
        &others,
        asked,
        &sequences,
        contact,
        settings,
        console,
    )?;
    recording.compare_contact(&scene, console);
    let chosen = fit(&scene, view.as_ref(), &traces, settings, choice, console)?;
    let (belief, prior) = (&chosen.estimate.belief, &chosen.prior);
    console.warn_all(health_warnings(&chosen.estimate.health));
    if spec == EstimatorSpec::Batch {
        console.warn_all(fit_warnings(belief, &prior.hyper.noise_sd, &traces));
    }
    console.warn_all(field_warnings(belief, &traces));
    let name = &recording.dataset.name;
    let estimate = &chosen.estimate;
    let field = estimate.to_field(&scene, &prior.hyper, name, &traces)?;
    let field = StiffnessField {
        // A model without effects is the nominal one.
        model: (model.as_ref().map(CorrectedModel::text)).filter(|text| !text.is_empty()),
        ..field
    };
    for out in &args.out {
        save(&field, out)?;
    }
    let report = Report {
        estimator: settings.name(),
        robust: settings.robust_name(),
        prior_sd: prior.hyper.prior_sd,
        smooth_sd: prior.hyper.prior_sd * prior.hyper.shape.smooth_share,
        smooth_length: prior.hyper.shape.length,
        level_sd: prior.hyper.prior_sd * prior.hyper.shape.level_share,
        noise_sd: &prior.hyper.noise_sd,
        given: &prior.given,
        chosen_by: prior.method,
        candidates: &prior.candidates,
        threshold: scene.contact().threshold,
        thresholds: &thresholds,
        sequences: traces.iter().map(|t| t.id.as_str()).collect(),
        samples: traces.iter().map(|t| t.observations.len()).sum(),
        contact_samples: traces.iter().map(Trace::contact_samples).sum(),
        points: scene.rest().len(),
        touched_points: chosen.estimate.touched.iter().filter(|t| **t).count(),
        mean_stiffness: mean_stiffness(&chosen.estimate),
        points_at_zero: touched(&chosen.estimate).filter(|k| *k == 0.0).count(),
        vision: settings.vision_name(),
        vision_share: chosen.vision_share,
        vision_candidates: &chosen.vision_candidates,
        nis_ratio: chosen.estimate.health.nis_ratio(),
        out: texts(&args.out),
    };
    console.results(&report, text(&report, &scene, spec.keeps_correlations()))
}

/// Stiffness of the touched points.
fn touched(estimate: &Estimate) -> impl Iterator<Item = f64> {
    let pairs = estimate.belief.mean().iter().zip(&estimate.touched);
    pairs.filter(|(_, t)| **t).map(|(k, _)| *k)
}

fn mean_stiffness(estimate: &Estimate) -> f64 {
    touched(estimate).sum::<f64>() / touched(estimate).count().max(1) as f64
}

use crate::console::{Console, number, texts};
use crate::corrected::{CorrectedModel, ModelArgs};
use crate::exit::usage;
use crate::field_file::{FieldFormat, claim, save};
use crate::range::length;
use crate::recording::{RecordingArgs, SplitPart, traces, untouched};
use crate::settings::EstimatorSettings;
use serde::{Serialize, Serializer};
use std::path::PathBuf;
use vsf::contact::ContactConfig;
use vsf::data::StiffnessField;
use vsf::pipeline::{
    Candidate, Estimate, EstimatorSpec, Hyper, HyperChoice, HyperMethod, PipelineError, Scene,
    Trace, VisionCandidate, VisionEstimate, VisionSpec, choose_contact, choose_hyper,
    closer_thresholds, estimate, estimate_with_vision, field_warnings, fit_warnings,
    health_warnings, view_warnings,
};
use vsf::vision::RgbdView;

#[derive(Debug, clap::Args)]
#[command(after_help = "\
The field holds points, K (mean, N/m), K_std, the features touched, prior_sd (all parts of the prior together) and \
noise_sd, and the parameters of contact, which `vsf predict`, `evaluate`, `simulate`, `export` and `view` take from \
it; they warn of flags that contradict it, and of another corrected model than it was estimated with.

JSON keys: estimator, robust (none, huber or student-t), prior_sd, smooth_sd, smooth_length, level_sd, noise_sd (by channel), given \
(which of prior_sd and noise_sd), chosen_by (how the rest was: held-out, likelihood, or given), candidates (smooth_share, length, level_share, signal_to_noise, error or log_evidence), threshold (of contact, m), thresholds (those compared: threshold, error), \
sequences, samples, contact_samples, points, touched_points, mean_stiffness (over touched \
points), vision (none, a method or a file), vision_share (of its guess, in the prior), vision_candidates (share, \
error), nis_ratio, out.")]
pub struct Args {
    /// Where to write the field, by ending: .npz, .ply, .mcap, or a folder, which must be new, empty or a
    /// field to replace; may be repeated
    #[arg(long, default_value = "field.npz")]
    out: Vec<PathBuf>,
    /// IDs of the sequences to learn from, in this order; the train split by default
    #[arg(long, value_delimiter = ',')]
    sequences: Option<Vec<String>>,
    /// Contact thresholds to choose among [m], such as 0.008,0.016, by the prediction of held-out touches: the first that is as
    /// good as the best one, within a standard error, so that the one that you would rather have goes first; prior and noise are chosen
    /// for each. By default, where a batch or exact estimator takes prior and noise from held-out touches, of which there are four (each a
    /// sequence, or a part of touch_starts) and more, with up to 1500 touched points: 0.8 of the points' spacing, and a
    /// quarter and a sixteenth of it down to 0.1 mm
    #[arg(long, value_delimiter = ',', value_parser = length, conflicts_with = "threshold")]
    thresholds: Option<Vec<f64>>,
    #[command(flatten)]
    model: ModelArgs,
    #[command(flatten)]
    recording: RecordingArgs,
    #[command(flatten)]
    estimator: EstimatorSettings,
}

/// Names of what may be given or is chosen.
const PRIOR_SD: &str = "prior_sd";
const NOISE_SD: &str = "noise_sd";

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

/// A contact threshold that was compared.
#[derive(Serialize)]
struct Threshold {
    /// m.
    threshold: f64,
    /// Mean error norm on held-out touches.
    error: f64,
}

/// An estimate and where its prior and noise come from.
pub struct Chosen {
    pub estimate: Estimate,
    pub hyper: Hyper,
    /// Which of `prior_sd` and `noise_sd` were given.
    pub given: Vec<&'static str>,
    /// How the others were chosen, if there are any.
    pub method: Option<HyperMethod>,
    pub candidates: Vec<Candidate>,
    /// Share of what the camera suggests, and those tried.
    pub vision_share: f64,
    pub vision_candidates: Vec<VisionCandidate>,
}

pub fn run(args: &Args, console: &Console) -> anyhow::Result<()> {
    for out in &args.out {
        if matches!(FieldFormat::of(out)?, FieldFormat::Png | FieldFormat::Svg) {
            let out = out.display();
            return Err(usage(format!(
                "{out}: pictures are drawn by `vsf export`; give .npz, .ply, .mcap or a folder (no ending)"
            )));
        }
    }
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
    let own = recording.scene_to_learn(model.as_ref(), console)?;
    let follows = model.as_ref().is_some_and(CorrectedModel::follows_contact);
    let own = match &args.thresholds {
        Some(_) if settings.method() != HyperMethod::HeldOut => {
            return Err(usage(
                "--thresholds are compared on held-out touches; leave out --hyper, or give --threshold",
            ));
        }
        Some(_) if follows => {
            return Err(usage(
                "--thresholds cannot be compared under this --model, whose effects are relative to the contact that they were \
                 found in; leave one of them out",
            ));
        }
        Some(all) => at_threshold(&own, all[0])?,
        None => own,
    };
    if let Some((view, _)) = &view {
        console.warn_all(view_warnings(own.rest(), view));
    }
    let traces = match &model {
        None => traces(&own, &sequences, console)?,
        Some(model) => {
            let corrected = model.sequences(&recording, &own, &sequences, console)?;
            corrected.into_iter().map(|c| c.trace).collect()
        }
    };
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
        Some(model) => model.traces(&recording, scene, &sequences, console),
    };
    let asked = args.thresholds.is_some();
    let Compared {
        scene,
        traces,
        thresholds,
        choice,
    } = compare((own, traces), &others, asked, contact, settings, console)?;
    let chosen = learn(&scene, view.as_ref(), &traces, settings, choice, console)?;
    let belief = &chosen.estimate.belief;
    console.warn_all(health_warnings(&chosen.estimate.health));
    if spec == EstimatorSpec::Batch {
        console.warn_all(fit_warnings(belief, &chosen.hyper.noise_sd, &traces));
    }
    console.warn_all(field_warnings(belief, &traces));
    let name = &recording.dataset.name;
    let estimate = &chosen.estimate;
    let field = estimate.to_field(&scene, &chosen.hyper, name, &traces)?;
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
        prior_sd: chosen.hyper.prior_sd,
        smooth_sd: chosen.hyper.prior_sd * chosen.hyper.shape.smooth_share,
        smooth_length: chosen.hyper.shape.length,
        level_sd: chosen.hyper.prior_sd * chosen.hyper.shape.level_share,
        noise_sd: &chosen.hyper.noise_sd,
        given: &chosen.given,
        chosen_by: chosen.method,
        candidates: &chosen.candidates,
        threshold: scene.contact().threshold,
        thresholds: &thresholds,
        sequences: traces.iter().map(|t| t.id.as_str()).collect(),
        samples: traces.iter().map(|t| t.observations.len()).sum(),
        contact_samples: traces.iter().map(Trace::contact_samples).sum(),
        points: scene.rest().len(),
        touched_points: chosen.estimate.touched.iter().filter(|t| **t).count(),
        mean_stiffness: mean_stiffness(&chosen.estimate),
        vision: settings.vision_name(),
        vision_share: chosen.vision_share,
        vision_candidates: &chosen.vision_candidates,
        nis_ratio: chosen.estimate.health.nis_ratio(),
        out: texts(&args.out),
    };
    console.json(&report)?;
    console.report(text(&report, &scene, spec.keeps_correlations()))
}

/// A scene with its traces, and the thresholds and the prior that it was chosen by, if it was.
struct Compared {
    scene: Scene,
    traces: Vec<Trace>,
    thresholds: Vec<Threshold>,
    choice: Option<HyperChoice>,
}

fn at_threshold(scene: &Scene, threshold: f64) -> Result<Scene, PipelineError> {
    scene.with_contact(ContactConfig {
        threshold,
        ..*scene.contact()
    })
}

/// Chooses between a scene with its traces and the same with `others` for its contact threshold (m), by the prediction of held-out touches;
/// `contact` runs the sequences there. Where nobody `asked`, thresholds at which nothing is touched are left out, and one alone is
/// not told of.
fn compare(
    own: (Scene, Vec<Trace>),
    others: &[f64],
    asked: bool,
    contact: impl Fn(&Scene) -> anyhow::Result<Vec<Trace>>,
    settings: &EstimatorSettings,
    console: &Console,
) -> anyhow::Result<Compared> {
    let mut all = vec![own];
    for &threshold in others {
        let scene = at_threshold(&all[0].0, threshold)?;
        let traces = contact(&scene)?;
        match untouched(&scene, &traces) {
            None => all.push((scene, traces)),
            Some(error) if asked => {
                return Err(
                    anyhow::Error::from(error).context(format!("--thresholds: {threshold:?} m"))
                );
            }
            Some(_) => {}
        }
    }
    let contacts: Vec<&[Trace]> = all.iter().map(|(_, traces)| traces.as_slice()).collect();
    let found = if asked || contacts.len() > 1 {
        let spinner = console.spinner("choosing contact, prior and noise");
        let found = choose_contact(all[0].0.rest(), &contacts, &settings.shapes())?;
        spinner.finish_and_clear();
        Some(found)
    } else {
        None
    };
    let errors = found.iter().flat_map(|f| &f.errors);
    let tried = all
        .iter()
        .zip(errors)
        .map(|((scene, _), &error)| Threshold {
            threshold: scene.contact().threshold,
            error,
        });
    let thresholds = tried.collect();
    let (scene, traces) = all.swap_remove(found.as_ref().map_or(0, |f| f.contact));
    Ok(Compared {
        scene,
        traces,
        thresholds,
        choice: found.map(|f| f.choice),
    })
}

/// Chooses what is not given and estimates, with a view if untouched points are to be guessed by it; `choice` is of prior
/// and noise, if it has been made.
pub fn learn(
    scene: &Scene,
    view: Option<&(RgbdView, VisionSpec)>,
    traces: &[Trace],
    settings: &EstimatorSettings,
    choice: Option<HyperChoice>,
    console: &Console,
) -> anyhow::Result<Chosen> {
    if let Some(error) = untouched(scene, traces) {
        return Err(error.into());
    }
    let spec = settings.spec()?;
    let given = match &settings.noise_sd {
        None => None,
        Some(noise_sd) => Some(per_channel(noise_sd, scene.robot().joint_count())?),
    };
    let shape = settings.shape();
    let flags = [
        (PRIOR_SD, settings.prior_sd.is_some()),
        (NOISE_SD, given.is_some()),
    ];
    let named = flags.into_iter().filter(|f| f.1).map(|f| f.0).collect();
    let (hyper, method, candidates) = match (settings.prior_sd, given) {
        (Some(prior_sd), Some(noise_sd)) => {
            let hyper = Hyper {
                prior_sd,
                shape,
                noise_sd,
            };
            (hyper, None, Vec::new())
        }
        (prior_sd, noise_sd) => {
            let method = settings.method();
            let choice = match choice {
                Some(choice) => choice,
                None => {
                    let spinner = console.spinner("choosing prior and noise");
                    let choice = choose_hyper(scene.rest(), traces, &settings.shapes(), method)?;
                    spinner.finish_and_clear();
                    choice
                }
            };
            let hyper = rescaled(choice.hyper, prior_sd, noise_sd);
            (hyper, Some(method), choice.candidates)
        }
    };
    let bar = console.bar(traces.len(), "estimate");
    let progress = |done: usize| bar.set_position(done as u64);
    let found = match view {
        None => VisionEstimate {
            estimate: estimate(scene.rest(), traces, &spec, &hyper, progress)?,
            share: 0.0,
            candidates: Vec::new(),
        },
        Some((view, vision)) => {
            estimate_with_vision(scene.rest(), view, traces, &spec, &hyper, vision, progress)?
        }
    };
    bar.finish_and_clear();
    Ok(Chosen {
        estimate: found.estimate,
        hyper,
        given: named,
        method,
        candidates,
        vision_share: found.share,
        vision_candidates: found.candidates,
    })
}

/// One of the two given: their ratio, which decides the fit, stays as chosen.
fn rescaled(chosen: Hyper, prior_sd: Option<f64>, noise_sd: Option<Vec<f64>>) -> Hyper {
    let norm = |x: &[f64]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
    let factor = match (&prior_sd, &noise_sd) {
        (Some(sd), _) => sd / chosen.prior_sd,
        (_, Some(sd)) => norm(sd) / norm(&chosen.noise_sd),
        _ => 1.0,
    };
    let scaled = || chosen.noise_sd.iter().map(|v| v * factor).collect();
    Hyper {
        prior_sd: prior_sd.unwrap_or(chosen.prior_sd * factor),
        shape: chosen.shape,
        noise_sd: noise_sd.unwrap_or_else(scaled),
    }
}

/// One deviation for all channels, or one each.
fn per_channel(given: &[f64], channels: usize) -> anyhow::Result<Vec<f64>> {
    match given {
        [one] => Ok(vec![*one; channels]),
        all if all.len() == channels => Ok(all.to_vec()),
        all => Err(usage(format!(
            "--noise-sd takes 1 or {channels} numbers, {} given",
            all.len()
        ))),
    }
}

fn mean_stiffness(estimate: &Estimate) -> f64 {
    let pairs = estimate.belief.mean().iter().zip(&estimate.touched);
    let touched: Vec<f64> = pairs.filter(|(_, t)| **t).map(|(k, _)| *k).collect();
    touched.iter().sum::<f64>() / touched.len().max(1) as f64
}

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

fn text(report: &Report, scene: &Scene, correlates: bool) -> String {
    let mut text = format!(
        "estimated from {} samples of {} ({} in contact): {}\n",
        report.samples,
        match report.sequences.len() {
            1 => "one sequence".to_owned(),
            n => format!("{n} sequences"),
        },
        report.contact_samples,
        report.sequences.join(", "),
    );
    text += &format!(
        "  contact     from {} mm before the surface on\n",
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
    if report.smooth_sd > 0.0 {
        text += &format!(
            "              and N(0, {}²) N/m smooth over {} m{}\n",
            number(report.smooth_sd),
            number(report.smooth_length),
            if correlates {
                ""
            } else {
                ", of which this estimator keeps the variance alone"
            },
        );
    }
    if report.level_sd > 0.0 {
        let sd = number(report.level_sd);
        text += &format!("              and N(0, {sd}²) N/m common to all points\n");
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
        "  field       {} of {} points touched, mean stiffness there {} N/m\n",
        report.touched_points,
        report.points,
        number(report.mean_stiffness),
    );
    for out in &report.out {
        text += &format!("wrote {out}\n");
    }
    text
}

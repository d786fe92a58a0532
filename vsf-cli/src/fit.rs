//! Chooses contact, prior and noise where they are not given, and estimates.

use crate::console::Console;
use crate::exit::usage;
use crate::recording::untouched;
use crate::settings::EstimatorSettings;
use serde::Serialize;
use vsf::contact::ContactConfig;
use vsf::core::CoreError;
use vsf::data::Sequence;
use vsf::pipeline::{
    Candidate, Estimate, Hyper, HyperChoice, HyperMethod, PipelineError, Scene, Trace,
    VisionCandidate, VisionEstimate, VisionSpec, choose_contact, choose_hyper, estimate,
    estimate_with_vision,
};
use vsf::vision::RgbdView;

/// Names of what may be given or is chosen.
pub const PRIOR_SD: &str = "prior_sd";
pub const NOISE_SD: &str = "noise_sd";

/// A contact threshold that was compared.
#[derive(Serialize)]
pub struct Threshold {
    /// m.
    pub threshold: f64,
    /// Mean error norm on held-out touches.
    pub error: f64,
}

/// An estimate, and its prior and noise.
pub struct Chosen {
    pub estimate: Estimate,
    pub prior: PriorAndNoise,
    /// Share of what the camera suggests, and those tried.
    pub vision_share: f64,
    pub vision_candidates: Vec<VisionCandidate>,
}

/// A scene with its traces, and the thresholds and the prior that it was chosen by, if it was.
pub struct Compared {
    pub scene: Scene,
    pub traces: Vec<Trace>,
    pub thresholds: Vec<Threshold>,
    pub choice: Option<HyperChoice>,
}

/// The scene with another contact threshold (m).
pub fn at_threshold(scene: &Scene, threshold: f64) -> Result<Scene, PipelineError> {
    scene.with_contact(ContactConfig {
        threshold,
        ..*scene.contact()
    })
}

/// Chooses between a scene with its traces and the same with `others` for its contact threshold (m), by the prediction of held-out touches;
/// `contact` runs the sequences there. Where nobody `asked`, thresholds at which nothing is touched are left out, and one alone is
/// not told of.
pub fn compare(
    own: (Scene, Vec<Trace>),
    others: &[f64],
    asked: bool,
    sequences: &[&Sequence],
    contact: impl Fn(&Scene) -> anyhow::Result<Vec<Trace>>,
    settings: &EstimatorSettings,
    console: &Console,
) -> anyhow::Result<Compared> {
    let mut all = vec![own];
    for &threshold in others {
        let scene = at_threshold(&all[0].0, threshold)?;
        let traces = contact(&scene)?;
        match untouched(&scene, &traces, sequences) {
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

/// A prior and a noise, and where they come from.
pub struct PriorAndNoise {
    pub hyper: Hyper,
    /// Which of `prior_sd` and `noise_sd` were given.
    pub given: Vec<&'static str>,
    /// How the others were chosen, if there are any.
    pub method: Option<HyperMethod>,
    pub candidates: Vec<Candidate>,
}

/// Those of the flags; what they leave open is chosen by what sequences touch, which is to be something, unless that has been done (`choice`).
pub fn prior_and_noise(
    scene: &Scene,
    traces: &[Trace],
    settings: &EstimatorSettings,
    choice: Option<HyperChoice>,
    console: &Console,
) -> anyhow::Result<PriorAndNoise> {
    let noise_sd = match &settings.noise_sd {
        None => None,
        Some(noise_sd) => Some(per_channel(noise_sd, scene.robot().joint_count())?),
    };
    let flags = [
        (PRIOR_SD, settings.prior_sd.is_some()),
        (NOISE_SD, noise_sd.is_some()),
    ];
    let given = flags.into_iter().filter(|f| f.1).map(|f| f.0).collect();
    if let (Some(prior_sd), Some(noise_sd)) = (settings.prior_sd, &noise_sd) {
        return Ok(PriorAndNoise {
            hyper: Hyper {
                prior_sd,
                shape: settings.shape(),
                noise_sd: noise_sd.clone(),
            },
            given,
            method: None,
            candidates: Vec::new(),
        });
    }
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
    Ok(PriorAndNoise {
        hyper: rescaled(choice.hyper, settings.prior_sd, noise_sd),
        given,
        method: Some(method),
        candidates: choice.candidates,
    })
}

/// Chooses what is not given and estimates, with a view if untouched points are to be guessed by it; `choice` is of prior
/// and noise, if it has been made.
pub fn fit(
    scene: &Scene,
    view: Option<&(RgbdView, VisionSpec)>,
    traces: &[Trace],
    settings: &EstimatorSettings,
    choice: Option<HyperChoice>,
    console: &Console,
) -> anyhow::Result<Chosen> {
    let spec = settings.spec()?;
    let prior = prior_and_noise(scene, traces, settings, choice, console)?;
    let hyper = &prior.hyper;
    let bar = console.bar(traces.len(), "estimate");
    let progress = |done: usize| bar.set_position(done as u64);
    let found = match view {
        None => {
            let of_touch = estimate(scene.rest(), traces, &spec, hyper, progress);
            of_touch.map(|estimate| VisionEstimate {
                estimate,
                share: 0.0,
                candidates: Vec::new(),
            })
        }
        Some((view, vision)) => {
            estimate_with_vision(scene.rest(), view, traces, &spec, hyper, vision, progress)
        }
    };
    let found = found.map_err(|error| with_flags(error, &prior.given))?;
    bar.finish_and_clear();
    Ok(Chosen {
        estimate: found.estimate,
        prior,
        vision_share: found.share,
        vision_candidates: found.candidates,
    })
}

/// Names the flags that were given where prior and noise are too far apart for numbers to hold both.
fn with_flags(error: PipelineError, given: &[&str]) -> anyhow::Error {
    let indefinite = match &error {
        PipelineError::Core(e) | PipelineError::Sequence { source: e, .. } => {
            matches!(e, CoreError::NotPositiveDefinite { .. })
        }
        _ => false,
    };
    if !indefinite || given.is_empty() {
        return error.into();
    }
    let flags: Vec<String> = given
        .iter()
        .map(|name| format!("--{}", name.replace('_', "-")))
        .collect();
    usage(format!(
        "{}: prior and noise are further apart than numbers can tell: {error}",
        flags.join(" and ")
    ))
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
pub fn per_channel(given: &[f64], channels: usize) -> anyhow::Result<Vec<f64>> {
    match given {
        [one] => Ok(vec![*one; channels]),
        all if all.len() == channels => Ok(all.to_vec()),
        all => Err(usage(format!(
            "--noise-sd takes 1 or {channels} numbers, {} given",
            all.len()
        ))),
    }
}

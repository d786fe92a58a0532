//! What a stream begins with.

use crate::console::Console;
use crate::corrected::CorrectedModel;
use crate::exit::usage;
use crate::fit::{PriorAndNoise, per_channel, prior_and_noise};
use crate::recording::{Recording, untouched};
use crate::settings::EstimatorSettings;
use std::path::Path;
use vsf::core::median;
use vsf::data::Sequence;
use vsf::filter::FieldPrior;
use vsf::pipeline::{Hyper, PriorShape, Scene, Trace};

pub struct Start {
    pub prior: FieldPrior,
    pub hyper: Hyper,
    /// Points that were touched before.
    pub touched: Vec<bool>,
    /// Sequences of the recording that were learned from before, if that is known.
    pub learned_from: Option<Vec<String>>,
    /// Time between the samples that the noise was chosen by (s), if it was.
    pub step_of_noise: Option<f64>,
}

impl Start {
    /// With prior and noise of the flags; what they leave open is chosen by the recording's train sequences, as `vsf estimate` does.
    pub fn anew(
        settings: &EstimatorSettings,
        recording: &Recording,
        model: Option<&CorrectedModel>,
        console: &Console,
    ) -> anyhow::Result<(Scene, Self)> {
        let scene = recording.scene_to_learn(model, None, console)?;
        let traces = if settings.prior_sd.is_some() && settings.noise_sd.is_some() {
            Vec::new()
        } else {
            touches(recording, &scene, model, console)?
        };
        let PriorAndNoise { hyper, .. } =
            prior_and_noise(&scene, &traces, settings, None, console)?;
        let start = Self {
            prior: hyper.shape.prior(scene.rest(), hyper.prior_sd)?,
            hyper,
            touched: Vec::new(),
            learned_from: None,
            step_of_noise: match settings.noise_sd {
                None => step(recording),
                Some(_) => None,
            },
        };
        Ok((scene, start))
    }

    /// From an earlier field.
    pub fn go_on(
        path: &Path,
        settings: &EstimatorSettings,
        recording: &Recording,
        model: Option<&CorrectedModel>,
        console: &Console,
    ) -> anyhow::Result<(Scene, Self)> {
        if let Some(flag) = settings.flag_of_prior() {
            return Err(usage(format!(
                "{flag}: --field says what is known before; leave one of them out"
            )));
        }
        let (file, scene) = recording.field_and_scene(Some(path), model, console)?;
        let (stored, field) = (file.stored, file.field);
        let joints = scene.robot().joint_count();
        let known = (
            stored.noise_sd(joints)?,
            stored.prior_sd,
            stored.has_deviations(),
        );
        let (Some(noise_sd), Some(prior_sd), true) = known else {
            let path = path.display();
            anyhow::bail!(
                "{path}: the field does not say how sure it is (K_std, prior_sd and noise_sd); give one that `vsf estimate` or \
                 `vsf live` wrote"
            );
        };
        let noise_sd = match &settings.noise_sd {
            Some(given) => per_channel(given, joints)?,
            None => noise_sd,
        };
        let is_own = field.recording.as_ref() == Some(&recording.dataset.name);
        let start = Self {
            prior: stored.belief.into(),
            hyper: Hyper {
                prior_sd,
                shape: PriorShape::independent(),
                noise_sd,
            },
            touched: stored.touched,
            learned_from: field.learned_from.filter(|_| is_own),
            step_of_noise: None,
        };
        Ok((scene, start))
    }
}

/// Time from one sample of the train sequences to the next (s), in the median.
fn step(recording: &Recording) -> Option<f64> {
    let times = recording.dataset.train().map(|s| &s.time);
    median(
        times
            .flat_map(|t| t.windows(2))
            .map(|t| t[1] - t[0])
            .collect(),
    )
}

/// What the train sequences touch.
fn touches(
    recording: &Recording,
    scene: &Scene,
    model: Option<&CorrectedModel>,
    console: &Console,
) -> anyhow::Result<Vec<Trace>> {
    let train: Vec<&Sequence> = recording.dataset.train().collect();
    let is_read = |s: &&Sequence| s.torques.data().iter().any(|tau| *tau != 0.0);
    if !train.iter().any(is_read) {
        return Err(usage(
            "--prior-sd and --noise-sd are required: the recording has no train sequences with torques to choose them by",
        ));
    }
    let traces = match model {
        None => recording.traces(scene, &train, console)?,
        Some(model) => {
            let corrected = model.sequences(recording, scene, &train, console)?;
            corrected.into_iter().map(|c| c.trace).collect()
        }
    };
    match untouched(scene, &traces, &train) {
        Some(error) => Err(error.into()),
        None => Ok(traces),
    }
}

//! Recordings under a corrected model, as `vsf diagnose --model` writes it.

use crate::console::{Console, read_text};
use crate::recording::{Recording, untouched, warn_of_motions};
use anyhow::Context;
use std::path::PathBuf;
use vsf::data::{ContactParameters, Dataset, Sequence, listed};
use vsf::gap::{Campaign, Corrected, Corrector, EffectEntry, Model, ModelFile, effects};
use vsf::pipeline::{PipelineError, Scene, SequencePrediction, Trace, simulate};

/// The flag that takes a corrected model.
#[derive(Debug, clap::Args)]
pub struct ModelArgs {
    /// Corrected model, as written by `vsf diagnose --model`, whose effects are added to contact, springs and
    /// torques
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
}

/// Sequences with what they touch, under a corrected model if there is one.
pub struct Modeled {
    /// With the readings as they are.
    pub traces: Vec<Trace>,
    corrected: Option<Vec<Corrected>>,
    in_air: bool,
}

impl Modeled {
    /// The sequences in this order, with warnings about motions, readings and contact.
    pub fn new(
        model: Option<&CorrectedModel>,
        recording: &Recording,
        scene: &Scene,
        sequences: &[&Sequence],
        console: &Console,
    ) -> anyhow::Result<Self> {
        let corrected = match model {
            Some(model) => Some(model.sequences(recording, scene, sequences, console)?),
            None => None,
        };
        let traces = match &corrected {
            Some(all) => all
                .iter()
                .map(Corrected::recorded)
                .collect::<Result<_, _>>()?,
            None => recording.traces(scene, sequences, console)?,
        };
        console.warn_all(untouched(scene, &traces, sequences));
        Ok(Self {
            traces,
            corrected,
            in_air: scene.rest().is_empty(),
        })
    }

    /// What a field predicts of the sequences, by `of_field`, and the model with it. In free air nothing says
    /// how sure a model is: predictions have no deviations.
    pub fn predict(
        &self,
        of_field: impl Fn(&Trace) -> Result<SequencePrediction, PipelineError>,
    ) -> Result<Vec<SequencePrediction>, PipelineError> {
        let mut predictions: Vec<SequencePrediction> = match &self.corrected {
            None => self.traces.iter().map(of_field).collect::<Result<_, _>>()?,
            Some(all) => (all.iter())
                .map(|c| Ok(c.complete(of_field(&c.trace)?)))
                .collect::<Result<_, PipelineError>>()?,
        };
        if self.in_air {
            predictions.iter_mut().for_each(|p| p.sd.clear());
        }
        Ok(predictions)
    }
}

/// A corrected model that was read, not yet fitted to a robot.
pub struct CorrectedModel {
    path: PathBuf,
    file: ModelFile,
}

impl ModelArgs {
    /// The file that is given.
    pub fn path(&self) -> Option<&PathBuf> {
        self.model.as_ref()
    }

    /// Reads the file, if one is given.
    pub fn open(&self, console: &Console) -> anyhow::Result<Option<CorrectedModel>> {
        let Some(path) = self.model.clone() else {
            return Ok(None);
        };
        console.outputs.keep(&path)?;
        let place = || path.display().to_string();
        let text = read_text(&path)?;
        let file = ModelFile::from_json(&text).with_context(place)?;
        Ok(Some(CorrectedModel { path, file }))
    }
}

impl CorrectedModel {
    /// The parameters of contact that it was found with, if it says.
    pub fn contact(&self) -> Option<&ContactParameters> {
        self.file.contact.as_ref()
    }

    /// Whether its parameters are relative to that contact.
    pub fn follows_contact(&self) -> bool {
        self.file.follows_contact(&effects::catalogue())
    }

    /// Its effects that go by the torques that were read.
    pub fn following_reading(&self) -> Vec<&str> {
        self.file.following_reading(&effects::catalogue())
    }

    /// Its effects with the values of their parameters, which tell it from other models.
    pub fn text(&self) -> String {
        let effect = |entry: &EffectEntry| {
            let values = entry.parameters.iter();
            let values = values.map(|p| format!(" {}={:?} {}", p.name, p.value, p.unit));
            entry.effect.clone() + &values.collect::<String>()
        };
        let effects: Vec<String> = self.file.effects.iter().map(effect).collect();
        effects.join("; ")
    }

    /// The sequences under the model, in this order, with warnings about motions and readings. Runs
    /// over all sequences of the splits: what an effect does to the object lasts.
    pub fn sequences(
        &self,
        recording: &Recording,
        scene: &Scene,
        sequences: &[&Sequence],
        console: &Console,
    ) -> anyhow::Result<Vec<Corrected>> {
        warn_of_motions(scene, sequences, console);
        let spinner = console.spinner("corrected model");
        let (campaign, model, found) = self.run(&recording.dataset, scene, sequences)?;
        spinner.finish_and_clear();
        let (name, own) = (&recording.dataset.name, self.file.recording.as_ref());
        if let Some(other) = own.filter(|own| *own != name)
            && sequences.iter().any(|s| knows(&model, &campaign, &s.id))
        {
            console.warn(format_args!(
                "{}: has parameters of their own for the sequences of {other:?}; those of {name:?} are others, whatever \
                 their IDs",
                self.path.display()
            ));
        }
        let tested = &recording.dataset.splits.test;
        let seen: Vec<&str> = (sequences.iter().map(|s| s.id.as_str()))
            .filter(|id| tested.iter().any(|t| t == id) && knows(&model, &campaign, id))
            .collect();
        if !seen.is_empty() {
            console.warn(format_args!(
                "{}: has parameters of their own for the test sequences {}; a diagnosis learns these from \
                 readings there, so that errors are smaller than on new sequences",
                self.path.display(),
                listed(&seen)
            ));
        }
        let traces: Vec<Trace> = found.iter().map(|c| c.trace.clone()).collect();
        console.warn_all(recording.of_readings(scene, sequences, &traces));
        Ok(found)
    }

    /// Traces of sequences of a recording, or of a stream in its place, without warnings.
    pub fn traces(
        &self,
        dataset: &Dataset,
        scene: &Scene,
        sequences: &[&Sequence],
    ) -> anyhow::Result<Vec<Trace>> {
        let (.., found) = self.run(dataset, scene, sequences)?;
        Ok(found.into_iter().map(|c| c.trace).collect())
    }

    fn run(
        &self,
        dataset: &Dataset,
        scene: &Scene,
        sequences: &[&Sequence],
    ) -> anyhow::Result<(Campaign, Model, Vec<Corrected>)> {
        let dataset = with(dataset, sequences);
        let campaign = Campaign::in_scene(&dataset, scene.clone())?;
        let model = self.at(&campaign)?;
        let all = campaign.corrected(&model)?;
        let of = |s: &&Sequence| all.iter().find(|c| c.trace.id == s.id).cloned();
        let found = sequences.iter().filter_map(of).collect();
        Ok((campaign, model, found))
    }

    /// The model for a stream.
    pub fn corrector(
        &self,
        dataset: &Dataset,
        scene: &Scene,
        console: &Console,
    ) -> anyhow::Result<Corrector> {
        let all: Vec<&Sequence> = dataset.sequences.iter().collect();
        let campaign = Campaign::in_scene(&with(dataset, &all), scene.clone())?;
        let model = self.at(&campaign)?;
        if all.iter().any(|s| knows(&model, &campaign, &s.id)) {
            console.warn(format_args!(
                "{}: has parameters of their own for sequences of the recording, which a stream is not: there they are zero",
                self.path.display()
            ));
        }
        Ok(Corrector::new(campaign.site(), campaign.scene(), &model)?)
    }

    /// Warns where the model was fitted to sequences of `recording` that are to be predicted.
    pub fn compare_sequences(&self, recording: &str, ids: &[&str], console: &Console) {
        let file = &self.file;
        let same = file.recording.as_deref() == Some(recording) && !file.effects.is_empty();
        let known = |id: &&str| same && file.learned_from.iter().any(|l| l == id);
        let again: Vec<&str> = ids.iter().copied().filter(known).collect();
        if !again.is_empty() {
            console.warn(format_args!(
                "{}: the model was fitted to sequences that are predicted ({}): errors there are those of a fit",
                self.path.display(),
                listed(&again)
            ));
        }
    }

    /// The sequences with the torques that the model gives with a stiffness per rest point (N/m).
    /// Effects that follow the load take that of the nominal model.
    pub fn simulate(
        &self,
        dataset: &Dataset,
        scene: &Scene,
        stiffness: &[f64],
        sequences: &[&Sequence],
    ) -> anyhow::Result<Vec<Sequence>> {
        // All of them: what effects do to the object lasts from one to the next.
        let dataset = with(dataset, sequences);
        let all: Vec<&Sequence> = dataset.sequences.iter().collect();
        let simulated = simulate(scene, stiffness, &all, &scene.traces(&all, || {})?)?;
        let dataset = Dataset {
            sequences: simulated,
            ..dataset
        };
        // What is written is not tared: that is done where it is read.
        let campaign = Campaign::in_scene(&dataset, scene.clone().without_tare())?;
        let torques = campaign.simulated(&self.at(&campaign)?, stiffness)?;
        let ids: Vec<String> = campaign.session().iter().map(|m| m.id.clone()).collect();
        let of = |s: &&Sequence| {
            let k = ids.iter().position(|id| *id == s.id)?;
            Some(Sequence {
                torques: torques[k].clone(),
                ..(*s).clone()
            })
        };
        Ok(sequences.iter().filter_map(of).collect())
    }

    fn at(&self, campaign: &Campaign) -> anyhow::Result<Model> {
        let model = self.file.model(campaign.site(), &effects::catalogue());
        model.with_context(|| self.path.display().to_string())
    }
}

/// Whether a model has parameters for a sequence of its own that are not zero.
fn knows(model: &Model, campaign: &Campaign, id: &str) -> bool {
    let of = |s: usize| campaign.site().sequences[s] == id;
    model.parts.iter().any(|(effect, theta)| {
        let parameters = effect.parameters(campaign.site());
        let mut pairs = parameters.iter().zip(theta);
        pairs.any(|(p, value)| p.sequence.is_some_and(of) && *value != 0.0)
    })
}

/// Names of the effects in a [`CorrectedModel::text`].
pub fn effects_of(text: &str) -> String {
    let names = text
        .split("; ")
        .filter_map(|effect| effect.split(' ').next());
    match names.collect::<Vec<_>>().join(", ") {
        names if names.is_empty() => "no effect".to_owned(),
        names => names,
    }
}

/// The recording with these sequences in a split, if they are in none.
fn with(dataset: &Dataset, sequences: &[&Sequence]) -> Dataset {
    let mut dataset = dataset.clone();
    for sequence in sequences {
        let splits = &mut dataset.splits;
        if !splits.train.contains(&sequence.id) && !splits.test.contains(&sequence.id) {
            splits.test.push(sequence.id.clone());
        }
    }
    dataset
}

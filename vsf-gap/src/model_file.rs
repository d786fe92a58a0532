use crate::effect::{acting_sets, follows_contact};
use crate::{
    Diagnosis, Effect, GapError, Model, Outcome, Parameter, ParameterEstimate, Role, Site,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use vsf_data::{ContactParameters, JsonError, listed, parse_json};

/// Version of the format.
const SCHEMA: u32 = 1;
/// Beyond the bounds of any parameter.
const MOST_DEVIATION: f64 = 1e16;

/// A corrected model as a file: JSON `{"schema": 1, "joints": [..], "contact_parameters": {..}, "recording_name": "..",
/// "learned_from": [..], "made_by": "..",
/// "effects": [{"effect", "parameters": [{"name", "value", "std", "unit"}]}]}`.
///
/// The file names effects and parameters, so it applies to other recordings with the same robot. It recognizes the robot by
/// the names of its joints; without `joints` it applies to any robot. Parameters of single sequences apply to recordings
/// with sequences of these names.
///
/// ```
/// use vsf_gap::{GapError, ModelFile};
///
/// let text = r#"{"schema": 1, "effects": [{"effect": "latency", "parameters":
///     [{"name": "delta", "value": 0.02, "std": 0.001, "unit": "s"}]}]}"#;
/// let file = ModelFile::from_json(text)?;
/// assert_eq!(file.effects[0].effect, "latency");
/// assert_eq!(ModelFile::from_json(&file.to_json())?, file);
/// # Ok::<(), GapError>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object of a corrected model")]
pub struct ModelFile {
    schema: u32,
    /// Names of the robot's joints, in order; empty if unknown.
    #[serde(default)]
    pub joints: Vec<String>,
    /// The contact parameters that the model was found with, to which parameters of its effects are relative. `None` if
    /// unknown, and for arms in free air.
    #[serde(rename = "contact_parameters", default)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactParameters>,
    /// Name of the recording that the model was found in, if known. Parameters of single sequences belong to that recording
    /// alone.
    #[serde(rename = "recording_name", default)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub recording: Option<String>,
    /// IDs of the sequences of that recording that the model was fitted to, if known. Errors on them are in-sample.
    #[serde(default)]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub learned_from: Vec<String>,
    /// The program that wrote the file, if any.
    #[serde(default)]
    #[serde(skip_serializing_if = "Option::is_none")]
    pub made_by: Option<String>,
    /// The effects, in the order in which they act; empty for the nominal model.
    pub effects: Vec<EffectEntry>,
}

/// An effect of a [`ModelFile`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an effect, an object")]
pub struct EffectEntry {
    /// Its name.
    pub effect: String,
    /// Its parameters, in any order: all shapes, and at least one set of amplitudes that may act together
    /// ([`Effect::acting`]). The other amplitudes are 0.
    pub parameters: Vec<ParameterEstimate>,
}

impl ModelFile {
    /// A model at a site, found in an unknown contact.
    ///
    /// `sd` holds the standard deviations of its parameters, effect by effect.
    ///
    /// # Errors
    /// As [`ModelFile::model`]; a number of deviations other than that of the parameters.
    pub fn new(site: &Site, model: &Model, sd: &[f64]) -> Result<Self, GapError> {
        let mut left = sd.iter();
        let mut effects = Vec::new();
        for (effect, theta) in &model.parts {
            let own = effect.parameters(site);
            let stds: Vec<f64> = left.by_ref().take(own.len()).copied().collect();
            if theta.len() != own.len() || stds.len() != own.len() {
                return Err(GapError::Parameters {
                    effect: effect.name().to_owned(),
                    got: theta.len().min(stds.len()),
                    expected: own.len(),
                });
            }
            // The fewest amplitudes that may act together and have those that do; all if there are none.
            let acts = |k: &usize| {
                own[*k].role == Role::Amplitude && (theta[*k] != 0.0 || stds[*k] != 0.0)
            };
            let acting: Vec<usize> = (0..own.len()).filter(acts).collect();
            let sets = acting_sets(effect.as_ref(), site);
            let set = sets
                .iter()
                .find(|set| acting.iter().all(|k| set.contains(k)));
            let held =
                |k: usize| own[k].role == Role::Shape || set.is_none_or(|set| set.contains(&k));
            let holds: Vec<bool> = (0..own.len()).map(held).collect();
            let estimate = |((p, value), sd): ((Parameter, &f64), f64)| ParameterEstimate {
                name: p.name,
                value: *value,
                sd,
                unit: p.unit.to_owned(),
            };
            effects.push(EffectEntry {
                effect: effect.name().to_owned(),
                parameters: (own.into_iter().zip(theta).zip(stds).zip(holds))
                    .filter_map(|(own, holds)| holds.then(|| estimate(own)))
                    .collect(),
            });
        }
        let file = Self {
            schema: SCHEMA,
            joints: joints(site),
            contact: None,
            recording: None,
            learned_from: Vec::new(),
            made_by: None,
            effects,
        };
        let known: Vec<_> = model.parts.iter().map(|(e, _)| e.clone()).collect();
        file.model(site, &known)?;
        Ok(file)
    }

    /// Reads JSON.
    ///
    /// # Errors
    /// [`GapError::ModelFile`] for anything but JSON of this form; [`GapError::Data`] for invalid contact parameters. What
    /// the effects make of the parameters is checked by [`ModelFile::model`].
    pub fn from_json(text: &str) -> Result<Self, GapError> {
        let file: Self = parse_json(text.as_bytes()).map_err(|e: JsonError| {
            let is_report = serde_json::from_str::<Diagnosis>(text).is_ok();
            GapError::ModelFile(if is_report {
                "it is the report of a diagnosis; `vsf diagnose --model` writes the model"
                    .to_owned()
            } else {
                e.to_string()
            })
        })?;
        if file.schema != SCHEMA {
            let problem = format!("schema {}, this version reads {SCHEMA}", file.schema);
            return Err(GapError::ModelFile(problem));
        }
        if let Some(contact) = &file.contact {
            contact.check()?;
        }
        Ok(file)
    }

    /// Writes JSON.
    pub fn to_json(&self) -> String {
        // Texts and numbers alone: nothing that JSON cannot hold.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }

    /// [`Model::follows_contact`], with the effects found in `effects`.
    ///
    /// An effect that is not among them is unknown, and counts as following contact.
    pub fn follows_contact(&self, effects: &[Arc<dyn Effect>]) -> bool {
        self.effects.iter().any(|entry| {
            let effect = effects.iter().find(|e| e.name() == entry.effect);
            effect.is_none_or(|e| follows_contact(e.as_ref()))
        })
    }

    /// Names of its effects that [use the reading](Effect::follows_reading), looked up in `effects`.
    pub fn following_reading(&self, effects: &[Arc<dyn Effect>]) -> Vec<&str> {
        let follows = |name: &&str| {
            let effect = effects.iter().find(|e| e.name() == *name);
            effect.is_some_and(|e| e.follows_reading())
        };
        let names = self.effects.iter().map(|entry| &*entry.effect);
        names.filter(follows).collect()
    }

    /// The model of the file at a site, with its effects looked up in `effects`.
    ///
    /// # Errors
    /// - [`GapError::ModelFile`] for a robot with other joints.
    /// - [`GapError::UnknownEffect`] for an effect that is not in `effects`.
    /// - [`GapError::Model`] for an effect that is named twice, parameters that are missing, unknown, named twice, of
    ///   another unit or out of bounds, and deviations that are negative or beyond 1e16.
    pub fn model(&self, site: &Site, effects: &[Arc<dyn Effect>]) -> Result<Model, GapError> {
        let there = joints(site);
        if !self.joints.is_empty() && self.joints != there {
            let (own, there) = (listed(&self.joints), listed(&there));
            return Err(GapError::ModelFile(format!(
                "it is of a robot with the joints {own}; here they are {there}. Diagnose a recording of this robot; if \
                 only names differ, put those into `joints` of the file, in the order that is there"
            )));
        }
        let mut model = Model::default();
        for (k, entry) in self.effects.iter().enumerate() {
            let Some(effect) = effects.iter().find(|e| e.name() == entry.effect) else {
                let known: Vec<&str> = effects.iter().map(|e| e.name()).collect();
                return Err(GapError::UnknownEffect {
                    name: entry.effect.clone(),
                    known: known.join(", "),
                });
            };
            if self.effects[..k].iter().any(|e| e.effect == entry.effect) {
                return Err(entry.wrong("is named twice".to_owned()));
            }
            let theta = entry.theta(effect.as_ref(), site)?;
            effect.compensator(site, &theta)?;
            model.parts.push((effect.clone(), theta));
        }
        Ok(model)
    }
}

impl Outcome {
    /// The corrected model as a file, with the recording's name, the sequences that it was fitted to and the contact that
    /// it was found in.
    ///
    /// [`ModelFile::made_by`] is left to the program that writes the file.
    ///
    /// # Errors
    /// As [`ModelFile::new`].
    pub fn model_file(&self) -> Result<ModelFile, GapError> {
        let (campaign, scene) = (&self.campaign, self.campaign.scene());
        Ok(ModelFile {
            contact: (!scene.rest().is_empty()).then(|| scene.contact_parameters()),
            recording: Some(campaign.name().to_owned()).filter(|name| !name.is_empty()),
            learned_from: campaign.train().iter().map(|m| m.id.clone()).collect(),
            ..ModelFile::new(campaign.site(), &self.model, &self.sd)?
        })
    }
}

fn joints(site: &Site) -> Vec<String> {
    let joints = site.robot.joints().iter();
    joints.map(|j| j.name().to_owned()).collect()
}

impl EffectEntry {
    /// The values in the order of the effect's parameters.
    fn theta(&self, effect: &dyn Effect, site: &Site) -> Result<Vec<f64>, GapError> {
        let parameters = effect.parameters(site);
        let names = || {
            let names: Vec<String> = parameters.iter().map(|p| p.name.clone()).collect();
            listed(&names)
        };
        for (k, given) in self.parameters.iter().enumerate() {
            let name = &given.name;
            if parameters.iter().all(|p| p.name != *name) {
                return Err(self.wrong(format!("has no parameter {name:?}; it has {}", names())));
            }
            if self.parameters[..k].iter().any(|g| g.name == *name) {
                return Err(self.wrong(format!("parameter {name:?} is named twice")));
            }
        }
        // Of amplitudes, some that may act together; of several such sets, the one that is nearest to complete.
        let is_given = |k: &usize| {
            self.parameters
                .iter()
                .any(|g| g.name == parameters[*k].name)
        };
        let missing = |set: &Vec<usize>| set.iter().filter(|k| !is_given(k)).count();
        let sets = acting_sets(effect, site);
        let needed = sets.iter().min_by_key(|set| missing(set));
        let may_rest = |k: usize| {
            let of_set = needed.is_some_and(|set| !set.contains(&k));
            // What a sequence adds is nothing unless it is told, as for the sequences of another recording.
            parameters[k].role == Role::Amplitude && (of_set || parameters[k].sequence.is_some())
        };
        let missing = (0..parameters.len()).filter(|k| !is_given(k) && !may_rest(*k));
        let missing: Vec<&Parameter> = missing.map(|k| &parameters[k]).collect();
        if !missing.is_empty() {
            let needs_more = |p: &&&Parameter| !(p.bounds[0]..=p.bounds[1]).contains(&0.0);
            let shapes = missing.iter().filter(needs_more);
            let shapes: Vec<String> = shapes
                .map(|p| {
                    format!(
                        "{:?} from {:?} to {:?} {}",
                        p.name, p.bounds[0], p.bounds[1], p.unit
                    )
                })
                .collect();
            let values = match shapes.len() {
                0 => "0 for what does not act".to_owned(),
                n if n == missing.len() => format!("give {}", listed(&shapes)),
                _ => format!("0 for what does not act, but {}", listed(&shapes)),
            };
            let missing: Vec<String> = (missing.iter())
                .map(|p| format!("{:?} ({})", p.name, p.unit))
                .collect();
            let (are, what) = match missing.len() {
                1 => ("is", "parameter"),
                _ => ("are", "parameters"),
            };
            return Err(self.wrong(format!(
                "{what} {} {are} missing, {values}; it has {}",
                listed(&missing),
                names()
            )));
        }
        (parameters.iter())
            .map(|p| {
                let name = &p.name;
                let Some(given) = self.parameters.iter().find(|g| g.name == *name) else {
                    return Ok(0.0);
                };
                let [lo, hi] = p.bounds;
                if given.unit != p.unit {
                    let (got, unit) = (&given.unit, p.unit);
                    return Err(
                        self.wrong(format!("parameter {name:?} is in {got:?}, not {unit:?}"))
                    );
                }
                if !(lo..=hi).contains(&given.value) {
                    let (value, unit) = (given.value, p.unit);
                    return Err(self.wrong(format!(
                        "parameter {name:?} is {value:?}; it must be in {lo:?} .. {hi:?} {unit}"
                    )));
                }
                if !(0.0..=MOST_DEVIATION).contains(&given.sd) {
                    let sd = given.sd;
                    return Err(self.wrong(format!(
                        "parameter {name:?} has the deviation {sd:?}; it must be in 0 .. {MOST_DEVIATION:?}"
                    )));
                }
                Ok(given.value)
            })
            .collect()
    }

    fn wrong(&self, problem: String) -> GapError {
        GapError::Model {
            effect: self.effect.clone(),
            problem,
        }
    }
}

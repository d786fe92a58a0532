use crate::console::Console;
use crate::exit::usage;
use crate::field_file::FieldFile;
use crate::settings::{Group, SceneSettings, Sources};
use std::path::{Path, PathBuf};
use vsf::data::{Dataset, Sequence};
use vsf::pipeline::{PipelineError, Scene, SceneOptions, Trace};

/// Points of a field and of a recording may differ by rounding to f32 [m].
const SAME_POINT: f64 = 1e-5;

/// A recording and how to read it, as most commands take it.
#[derive(Debug, clap::Args)]
pub struct RecordingArgs {
    /// Folder of the recording
    pub dataset: PathBuf,
    #[command(flatten)]
    pub sources: Sources,
    #[command(flatten)]
    pub scene: SceneSettings,
}

/// An open recording.
pub struct Recording {
    pub path: PathBuf,
    pub dataset: Dataset,
    pub options: SceneOptions,
    /// Number of warnings that were printed.
    pub warnings: Vec<String>,
}

/// Which sequences to take when none are named.
#[derive(Clone, Copy)]
pub enum Default {
    Train,
    Test,
    All,
}

impl RecordingArgs {
    /// Opens the recording and prints its warnings.
    pub fn open(&self, console: &Console) -> anyhow::Result<Recording> {
        Recording::open(&self.dataset, &self.scene.resolve(&self.sources)?, console)
    }
}

impl Recording {
    /// Refuses an output folder that is the recording or lies inside it.
    pub fn keep_apart(&self, out: &Path) -> anyhow::Result<()> {
        let own = self.path.canonicalize().ok();
        let place = out.ancestors().find_map(|a| a.canonicalize().ok());
        match (own, place) {
            (Some(own), Some(place)) if place.starts_with(&own) => Err(usage(format!(
                "--out {} lies in the recording itself; choose another folder",
                out.display()
            ))),
            _ => Ok(()),
        }
    }

    /// Opens a folder and prints its warnings.
    pub fn open(path: &Path, settings: &SceneSettings, console: &Console) -> anyhow::Result<Self> {
        let options = settings.options()?;
        let (dataset, warnings) = Dataset::open(path, &settings.overrides()?)?;
        let warnings: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        warnings.iter().for_each(|w| console.warn(w));
        Ok(Self {
            path: path.to_owned(),
            dataset,
            options,
            warnings,
        })
    }

    /// The named sequences, or those of a split.
    pub fn sequences(
        &self,
        named: Option<&[String]>,
        default: Default,
    ) -> anyhow::Result<Vec<&Sequence>> {
        let dataset = &self.dataset;
        if let Some(ids) = named {
            let find = |(k, id): (usize, &String)| {
                if ids[..k].contains(id) {
                    return Err(usage(format!("--sequences names {id:?} twice")));
                }
                let known = || {
                    dataset
                        .sequences
                        .iter()
                        .map(|s| s.id.as_str())
                        .collect::<Vec<_>>()
                };
                dataset.sequence(id).ok_or_else(|| {
                    let (path, known) = (self.path.display(), known().join(", "));
                    anyhow::anyhow!("{path}: no sequence {id:?}; there are {known}")
                })
            };
            return ids.iter().enumerate().map(find).collect();
        }
        let (chosen, what): (Vec<_>, _) = match default {
            Default::Train => (dataset.train().collect(), "train"),
            Default::Test => (dataset.test().collect(), "test"),
            Default::All => (dataset.sequences.iter().collect(), "touch"),
        };
        if chosen.is_empty() {
            let path = self.path.display();
            anyhow::bail!(
                "{path}: the {what} split is empty; name sequences by --sequences, or give \
                 dataset.json a `splits` with {what} sequences"
            );
        }
        Ok(chosen)
    }

    /// The scene of the recording alone.
    pub fn scene(&self, console: &Console) -> anyhow::Result<Scene> {
        let spinner = console.spinner("reading the robot");
        let scene = Scene::open(&self.dataset, &self.options)?;
        spinner.finish_and_clear();
        Ok(scene)
    }

    /// The scene of a field in this recording: the recording's points must be the field's; without
    /// own points it takes the field's.
    pub fn scene_of(&self, field: &FieldFile, console: &Console) -> anyhow::Result<Scene> {
        let points = &field.field.points;
        if let Some(own) = &self.dataset.rest_points {
            if own.len() != points.len() {
                let (field, recording) = (points.len(), own.len());
                return Err(PipelineError::FieldSize { field, recording }.into());
            }
            let far =
                |(_, (a, b)): &(usize, (_, _))| vsf::core::nalgebra::distance(*a, *b) > SAME_POINT;
            if let Some((row, (a, b))) = own.iter().zip(points).enumerate().find(far) {
                anyhow::bail!(
                    "{}: the field belongs to other points: row {row} is {b} there and {a} in {}",
                    field.path.display(),
                    self.path.join("points.npy").display()
                );
            }
        }
        let spinner = console.spinner("reading the robot");
        let scene = Scene::with_points(&self.dataset, points.clone(), &self.options)?;
        spinner.finish_and_clear();
        Ok(scene)
    }

    /// The given field, or the one stored in the recording.
    pub fn field(&self, given: Option<&Path>, console: &Console) -> anyhow::Result<FieldFile> {
        match (given, &self.dataset.field) {
            (Some(path), _) => FieldFile::open(path, console),
            (None, Some(field)) => Ok(FieldFile {
                path: self.path.clone(),
                field: field.clone(),
            }),
            (None, None) => Err(usage("--field is required: the recording stores no field")),
        }
    }
}

/// Contacts of all sequences.
pub fn traces(
    scene: &Scene,
    sequences: &[&Sequence],
    console: &Console,
) -> anyhow::Result<Vec<Trace>> {
    let bar = console.bar(sequences.len(), "contact");
    let traces = scene.traces(sequences, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(traces)
}

use crate::config::Sources;
use crate::console::{Console, number};
use crate::contact_flags::{contact_flags, difference};
use crate::corrected::{CorrectedModel, ModelArgs};
use crate::derived::{COMPUTED, claim, keep_made, keep_robot, stems_from};
use crate::exit::usage;
use crate::explain::{blame, explain};
use crate::field_file::FieldFile;
use crate::fit::at_threshold;
use crate::settings::SceneSettings;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use vsf::contact::{CacheUse, ContactConfig};
use vsf::data::{DataWarning, Dataset, Sequence, StiffnessField};
use vsf::gap::Campaign;
use vsf::pipeline::{
    Approach, PipelineError, PipelineWarning, Scene, SceneOptions, Trace, motion_warnings,
    reading_warnings, rgbd_view, robot_of, scene_warnings, touch_warnings,
};
use vsf::robots::{RobotError, RobotModel};
use vsf::vision::RgbdView;

/// Points of a field and of a recording may differ by rounding to f32 [m].
const SAME_POINT: f64 = 1e-5;
/// So may places and turns of the robot's base [m or rad].
const SAME_POSE: f64 = 1e-5;

/// A recording and how to read it, as most commands take it.
#[derive(Debug, clap::Args)]
pub struct RecordingArgs {
    /// Folder of the recording
    pub dataset: PathBuf,
    #[command(flatten)]
    sources: Sources,
    #[command(flatten)]
    scene: SceneSettings,
}

/// A recording and a field of its points.
#[derive(Debug, clap::Args)]
pub struct FieldArgs {
    /// Field, .npz or folder; default: the one stored in the recording
    #[arg(long)]
    pub field: Option<PathBuf>,
    #[command(flatten)]
    pub model: ModelArgs,
    #[command(flatten)]
    pub recording: RecordingArgs,
}

/// An open recording.
pub struct Recording {
    pub path: PathBuf,
    pub dataset: Dataset,
    settings: SceneSettings,
}

/// Which sequences to take when none are named.
#[derive(Clone, Copy)]
pub enum SplitPart {
    Train,
    Test,
    All,
}

impl FieldArgs {
    /// Opens all, to write another recording to the folder `out`: of motions alone, readings may be missing.
    pub fn open_for(
        &self,
        out: &Path,
        console: &Console,
    ) -> anyhow::Result<(Recording, FieldFile, Scene, Option<CorrectedModel>)> {
        claim(out, console)?;
        let model = self.model.open(console)?;
        let RecordingArgs {
            dataset,
            sources,
            scene,
        } = &self.recording;
        sources.keep(console)?;
        let recording = Recording::open_but(dataset, scene, is_planned, console)?;
        keep_made("--out", out, &COMPUTED)?;
        let given = self.field.as_deref();
        let (field, scene) = recording.field_and_scene(given, model.as_ref(), console)?;
        Ok((recording, field, scene, model))
    }
}

impl RecordingArgs {
    /// Opens the recording and prints its warnings.
    pub fn open(&self, console: &Console) -> anyhow::Result<Recording> {
        self.sources.keep(console)?;
        Recording::open(&self.dataset, &self.scene, console)
    }

    /// The same as of a stream, whose motions and readings are others: those here may be planned.
    pub fn open_to_stream(&self, console: &Console) -> anyhow::Result<Recording> {
        self.sources.keep(console)?;
        Recording::open_but(&self.dataset, &self.scene, is_planned, console)
    }

    /// The same to look for causes of a gap, of which a sequence in neither split is none.
    pub fn open_to_diagnose(&self, console: &Console) -> anyhow::Result<Recording> {
        self.sources.keep(console)?;
        let unused = |w: &DataWarning| matches!(w, DataWarning::UnassignedSequences { .. });
        Recording::open_but(&self.dataset, &self.scene, unused, console)
    }
}

impl Recording {
    /// Opens a folder, in which no output may lie, and prints its warnings.
    pub fn open(path: &Path, settings: &SceneSettings, console: &Console) -> anyhow::Result<Self> {
        Self::open_but(path, settings, |_| false, console)
    }

    /// The same, without warnings that are beside the point.
    fn open_but(
        path: &Path,
        settings: &SceneSettings,
        beside: impl Fn(&DataWarning) -> bool,
        console: &Console,
    ) -> anyhow::Result<Self> {
        console.outputs.keep(path)?;
        settings.check_links()?;
        if path.is_file() {
            let path = path.display();
            anyhow::bail!(
                "{path} is a file; a recording is a folder with dataset.json and seq_<id>/ (`vsf import` makes one of a \
                 ROS 2 bag or CSV files)"
            );
        }
        let (dataset, warnings) = Dataset::open(path, &settings.metadata.overrides()?)
            .map_err(|e| blame(&settings.metadata, e))?;
        keep_robot(Some(&dataset.robot), console)?;
        console.warn_all(warnings.iter().filter(|w| !beside(w)));
        Ok(Self {
            path: path.to_owned(),
            dataset,
            settings: settings.clone(),
        })
    }

    /// The named sequences, or those of a split.
    pub fn sequences(
        &self,
        named: Option<&[String]>,
        part: SplitPart,
    ) -> anyhow::Result<Vec<&Sequence>> {
        if let Some(ids) = named {
            let dataset = &self.dataset;
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
                    usage(format!(
                        "--sequences: {path} has no sequence {id:?}; there are {known}"
                    ))
                })
            };
            return ids.iter().enumerate().map(find).collect();
        }
        self.split(part, true)
    }

    /// The sequences of a split, which flags may name where the command has any.
    pub fn split(&self, part: SplitPart, by_flags: bool) -> anyhow::Result<Vec<&Sequence>> {
        let dataset = &self.dataset;
        let (chosen, what): (Vec<_>, _) = match part {
            SplitPart::Train => (dataset.train().collect(), "train"),
            SplitPart::Test => (dataset.test().collect(), "test"),
            SplitPart::All => (dataset.sequences.iter().collect(), "touch"),
        };
        if chosen.is_empty() {
            let path = self.path.display();
            let flags = if by_flags {
                format!("name sequences by --sequences or --{what}, or ")
            } else {
                String::new()
            };
            anyhow::bail!(
                "{path}: the {what} split is empty; {flags}give dataset.json a `splits` with {what} sequences"
            );
        }
        Ok(chosen)
    }

    /// The scene of the recording alone, as fields are estimated in it: in the contact that a corrected model remembers, if
    /// there is one, or that its torques were computed in. Where no flag says from which distance on points are touched,
    /// and torques were measured, it is the one that suits their spacing, unless the model's parameters are relative to
    /// their own. Of `thresholds` to compare, the first is taken; shapes reach as far as the largest asks for, and warnings are
    /// those of all.
    pub fn scene_to_learn(
        &self,
        model: Option<&CorrectedModel>,
        thresholds: Option<&[f64]>,
        console: &Console,
    ) -> anyhow::Result<Scene> {
        let remembered = model.and_then(CorrectedModel::contact);
        let computed = (self.dataset.contact.as_ref()).filter(|_| !follows(model));
        let mut options = self.settings.options(remembered.or(computed));
        if let Some(all) = thresholds.filter(|all| !all.is_empty()) {
            options.contact.threshold = all.iter().copied().fold(0.0, f64::max);
            let scene = self.scene_by(&options, console, Scene::open)?;
            let least = all
                .iter()
                .copied()
                .fold(options.contact.threshold, f64::min);
            if least < options.contact.threshold {
                warn_of_grids(&at_threshold(&scene, least)?, &options, console);
            }
            return Ok(at_threshold(&scene, all[0])?);
        }
        self.scene_by(&options, console, |dataset, options| {
            let scene = Scene::open(dataset, options)?;
            match computed {
                _ if follows(model) || self.settings.has_threshold() => Ok(scene),
                Some(computed) => scene.with_contact(ContactConfig {
                    threshold: computed.threshold,
                    ..*scene.contact()
                }),
                None => scene.with_suited_threshold(),
            }
        })
    }

    /// Whether anything says which contact threshold to learn with, so that it is not left to the spacing of the points.
    pub fn has_threshold(&self, model: Option<&CorrectedModel>) -> bool {
        self.settings.has_threshold() || self.dataset.contact.is_some() || follows(model)
    }

    /// The same, without points if the recording has none.
    pub fn scene_to_learn_or_air(&self, console: &Console) -> anyhow::Result<Scene> {
        if self.has_points() {
            self.scene_to_learn(None, None, console)
        } else {
            self.scene_or_air(console)
        }
    }

    /// The scene of the recording alone, in the contact that its torques were computed in if they were not measured, without
    /// points if it has none.
    pub fn scene_or_air(&self, console: &Console) -> anyhow::Result<Scene> {
        if self.has_points() {
            let options = self.settings.options(self.dataset.contact.as_ref());
            self.scene_by(&options, console, Scene::open)
        } else {
            Ok(Scene::in_air(&self.dataset, self.robot()?)?)
        }
    }

    /// The given field, or the one stored in the recording, and its scene. Of a recording without points
    /// a model says all: there is nothing that a field could be of.
    pub fn field_and_scene(
        &self,
        given: Option<&Path>,
        model: Option<&CorrectedModel>,
        console: &Console,
    ) -> anyhow::Result<(FieldFile, Scene)> {
        if given.is_none() && model.is_some() && !self.has_points() {
            let nothing = FieldFile::new(self.path.clone(), StiffnessField::default())?;
            return Ok((nothing, self.scene_or_air(console)?));
        }
        let field = self.field(given, console)?;
        let scene = self.scene_of(&field, model, console)?;
        field.compare_model(model, &scene, console);
        Ok((field, scene))
    }

    /// Checks that a field is of the recording's points, if it has own ones, and warns of another recording's.
    pub fn check_field(&self, field: &FieldFile, console: &Console) -> anyhow::Result<()> {
        let points = &field.field.points;
        let place = field.path.display();
        if let Some(own) = &self.dataset.rest_points {
            if own.len() != points.len() {
                let (field, recording) = (points.len(), own.len());
                let sizes = PipelineError::FieldSize { field, recording };
                return Err(anyhow::Error::from(sizes).context(place.to_string()));
            }
            let far =
                |(_, (a, b)): &(usize, (_, _))| vsf::core::nalgebra::distance(*a, *b) > SAME_POINT;
            if let Some((row, (a, b))) = own.iter().zip(points).enumerate().find(far) {
                anyhow::bail!(
                    "{place}: the field belongs to other points: row {row} is {b:?} there and {a:?} in {}",
                    self.path.join("points.npy").display()
                );
            }
        }
        let name = &self.dataset.name;
        let origin = field.field.recording.as_ref();
        if let Some(other) = origin.filter(|origin| !stems_from(name, origin)) {
            console.warn(format!(
                "{place}: the field was estimated from the recording {other:?}, this one is {name:?}"
            ));
        }
        if let Some(was) = &field.field.base_pose {
            let moved = was.inverse() * self.dataset.base_pose;
            let (far, turned) = (moved.translation.vector.norm(), moved.rotation.angle());
            if far > SAME_POSE || turned > SAME_POSE {
                console.warn(format!(
                    "{place}: the field was estimated with the robot's base elsewhere, {} m and {} rad from where it is \
                     here (--base-pose, or base_pose of dataset.json): touches are not where they were",
                    number(far),
                    number(turned),
                ));
            }
        }
        Ok(())
    }

    /// The scene of a field in this recording, [checked](Recording::check_field): without own points it takes
    /// the field's. Contact is that of the flags, otherwise of the field, otherwise of the corrected model, otherwise the
    /// one that its torques were computed in.
    pub fn scene_of(
        &self,
        field: &FieldFile,
        model: Option<&CorrectedModel>,
        console: &Console,
    ) -> anyhow::Result<Scene> {
        self.check_field(field, console)?;
        let points = &field.field.points;
        let of_model = model.and_then(CorrectedModel::contact);
        let known = field.field.contact.as_ref().or(of_model);
        let known = known.or(self.dataset.contact.as_ref());
        let options = self.settings.options(known);
        let scene = self.scene_by(&options, console, |dataset, options| {
            Scene::with_points(dataset, points.clone(), options)
        })?;
        field.compare_contact(&scene, console);
        let guessed = self.settings.left_open();
        if known.is_none() && !guessed.is_empty() {
            let taken = contact_flags(&scene.contact_parameters());
            let taken = taken.iter().filter(|(flag, _)| guessed.contains(flag));
            let taken: Vec<String> = taken
                .map(|(flag, value)| format!("{flag} {value}"))
                .collect();
            let threshold_is_taken = guessed.contains(&"--threshold");
            let suited = match scene.with_suited_threshold() {
                Ok(suited) if threshold_is_taken && suited.contact() != scene.contact() => {
                    let suited = number(suited.contact().threshold);
                    format!(" ({suited} m suits the points)")
                }
                _ => String::new(),
            };
            console.warn(format!(
                "{}: does not say in which contact it was estimated: {} taken{suited}; give what it was estimated with",
                field.path.display(),
                match &taken[..] {
                    [one] => format!("{one} is"),
                    all => format!("{} are", all.join(" and ")),
                },
            ));
        }
        Ok(scene)
    }

    fn scene_by(
        &self,
        options: &SceneOptions,
        console: &Console,
        open: impl FnOnce(&Dataset, &SceneOptions) -> Result<Scene, PipelineError>,
    ) -> anyhow::Result<Scene> {
        let spinner = console.spinner("reading the robot");
        let scene = open(&self.dataset, options).map_err(|e| match e {
            PipelineError::Robot(e @ RobotError::UnknownLink { .. })
                if !self.settings.has_links() =>
            {
                anyhow::anyhow!("the field, model or recording (contact_parameters) remembers which links touched (--links): {e}")
            }
            other => explain(&self.settings.metadata, other),
        })?;
        spinner.finish_and_clear();
        console.warn_all(scene_warnings(&scene));
        for grid in scene.grids() {
            if let CacheUse::NotStored(why) = &grid.report.cache {
                console.warn(format!("grid not cached: {why}"));
            }
        }
        warn_of_grids(&scene, options, console);
        Ok(scene)
    }

    /// What its camera saw, if it has one.
    pub fn view(&self) -> anyhow::Result<Option<RgbdView>> {
        Ok(self.dataset.camera.as_ref().map(rgbd_view).transpose()?)
    }

    /// Whether there are points to touch, own ones or those of a stored field.
    pub fn has_points(&self) -> bool {
        self.dataset.rest_points.is_some() || self.dataset.field.is_some()
    }

    /// Contacts of all sequences, with warnings about their motions and readings.
    pub fn traces(
        &self,
        scene: &Scene,
        sequences: &[&Sequence],
        console: &Console,
    ) -> anyhow::Result<Vec<Trace>> {
        let traces = contacts(scene, sequences, console)?;
        console.warn_all(self.of_readings(scene, sequences, &traces));
        Ok(traces)
    }

    /// What looks wrong with the readings; of those that were computed in another contact not of signs, columns
    /// and offsets, which this one does not tell.
    pub fn of_readings(
        &self,
        scene: &Scene,
        sequences: &[&Sequence],
        traces: &[Trace],
    ) -> Vec<PipelineWarning> {
        let in_other_contact = self.other_contact(scene).is_some();
        let mut warnings = reading_warnings(scene, sequences, traces);
        warnings.retain(|w| !(in_other_contact && w.rests_on_contact()));
        warnings
    }

    /// Warns where readings that were computed are compared to springs in another contact.
    pub fn compare_contact(&self, scene: &Scene, console: &Console) {
        if let Some((was, is)) = self.other_contact(scene) {
            console.warn(format!(
                "{}: the torques were computed with {was} (contact_parameters of dataset.json), not {is}: errors, and \
                 fields that are estimated from them, have that difference in them",
                self.path.display()
            ));
        }
    }

    /// The contact that the torques were computed in, and how the scene differs, if it does.
    fn other_contact(&self, scene: &Scene) -> Option<(String, String)> {
        let own = (self.dataset.contact.as_ref()).filter(|_| !scene.rest().is_empty());
        own.and_then(|own| difference(&scene.as_stored_here(own), &scene.contact_parameters()))
    }

    /// The recording as a diagnosis sees it, with warnings about its motions and readings.
    pub fn campaign(&self, console: &Console) -> anyhow::Result<Campaign> {
        let sequences: Vec<&Sequence> = self.dataset.sequences.iter().collect();
        let scene = self.scene_or_air(console)?;
        let is_given = self.has_threshold(None);
        // The same as of other commands.
        let looked_at = if is_given {
            scene.clone()
        } else {
            (scene.with_suited_threshold()).unwrap_or_else(|_| scene.clone())
        };
        self.compare_contact(&looked_at, console);
        let traces = contacts(&looked_at, &sequences, console)?;
        let mut warnings = self.of_readings(&looked_at, &sequences, &traces);
        // A diagnosis tells what that is.
        use PipelineWarning::{FeltInAir, NotTared};
        warnings.retain(|w| !matches!(w, NotTared { .. } | FeltInAir { .. }));
        console.warn_all(warnings);
        console.warn_all(untouched(&looked_at, &traces, &sequences));
        let campaign = Campaign::in_scene(&self.dataset, scene)?;
        Ok(if is_given {
            campaign
        } else {
            campaign.with_suited_fields()
        })
    }

    /// Folders of `package://` names.
    pub fn packages(&self) -> BTreeMap<String, PathBuf> {
        self.settings.metadata.packages()
    }

    /// The robot alone.
    pub fn robot(&self) -> anyhow::Result<RobotModel> {
        robot_of(&self.dataset, &self.packages()).map_err(|e| explain(&self.settings.metadata, e))
    }

    /// The given field, or the one stored in the recording.
    pub fn field(&self, given: Option<&Path>, console: &Console) -> anyhow::Result<FieldFile> {
        self.stored_or(given, console)?.ok_or_else(|| {
            usage(
                "--field is required: the recording stores no field; `vsf estimate` makes one of a recording \
                 with points, and one without takes --model",
            )
        })
    }

    /// The same, if there is one.
    pub fn stored_or(
        &self,
        given: Option<&Path>,
        console: &Console,
    ) -> anyhow::Result<Option<FieldFile>> {
        match (given, &self.dataset.field) {
            (Some(path), _) => FieldFile::open(path, console).map(Some),
            (None, Some(field)) => FieldFile::new(self.path.clone(), field.clone()).map(Some),
            (None, None) => Ok(None),
        }
    }
}

/// Whether that is so of motions that are planned and not made.
fn is_planned(warning: &DataWarning) -> bool {
    matches!(warning, DataWarning::ZeroTorques { .. })
}

/// Whether contact is to be that in which a corrected model was found.
fn follows(model: Option<&CorrectedModel>) -> bool {
    model.is_some_and(|m| m.contact().is_some() && m.follows_contact())
}

/// Refuses flags that are of recordings where the input is a field.
pub fn needs_recording(input: &Path, flags: &[(&str, bool)]) -> anyhow::Result<()> {
    match flags.iter().find(|(_, given)| *given) {
        Some((flag, _)) => {
            let input = input.display();
            Err(usage(format!(
                "{flag} needs a recording; {input} is a field"
            )))
        }
        None => Ok(()),
    }
}

/// Contacts of sequences, with warnings about their motions.
fn contacts(
    scene: &Scene,
    sequences: &[&Sequence],
    console: &Console,
) -> anyhow::Result<Vec<Trace>> {
    warn_of_motions(scene, sequences, console);
    let bar = console.bar(sequences.len(), "contact");
    let traces = scene.traces(sequences, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(traces)
}

/// Warns of what looks wrong with how the arm moves, and with where it begins to touch.
pub fn warn_of_motions(scene: &Scene, sequences: &[&Sequence], console: &Console) {
    console.warn_all(motion_warnings(scene.robot(), sequences));
    console.warn_all(touch_warnings(scene, sequences));
}

/// Warns of meshes whose grids are coarser than the contact threshold.
fn warn_of_grids(scene: &Scene, options: &SceneOptions, console: &Console) {
    for grid in scene.grids() {
        let (error, threshold) = (grid.report.error.p99, scene.contact().threshold);
        if error > threshold {
            let advice = match options.grid.resolution {
                None => "are its units meters? If so, give --grid-resolution",
                Some(_) => "give a finer --grid-resolution, or none",
            };
            console.warn(format!(
                "link {:?}: the distance grid of its mesh is off by {} m (99 %), more than the \
                 contact threshold of {} m; {advice}",
                scene.robot().links()[grid.link].name(),
                number(error),
                number(threshold),
            ));
        }
    }
}

/// That the robot touches nothing in these sequences though there are points, and how near it comes.
pub fn untouched(
    scene: &Scene,
    traces: &[Trace],
    sequences: &[&Sequence],
) -> Option<PipelineError> {
    let touching = traces.iter().any(|t| t.contact_samples() > 0);
    (!touching && !scene.rest().is_empty()).then(|| PipelineError::NoContact {
        what: "chosen",
        points: scene.rest().len(),
        nearest: Approach::nearest(scene, sequences).ok().flatten(),
    })
}

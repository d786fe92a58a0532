use crate::console::{Console, create_parent};
use crate::contact_flags::difference;
use crate::corrected::{CorrectedModel, effects_of};
use crate::exit::usage;
use crate::file_kind::FileKind;
use crate::interrupt::writing;
use crate::outputs::unmarked;
use anyhow::Context;
use std::path::{Path, PathBuf};
use vsf::data::{ContactParameters, McapExport, StiffnessField, listed};
use vsf::pipeline::{Scene, StoredEstimate};

/// A field on disk, and what it says of its estimate.
pub struct FieldFile {
    pub path: PathBuf,
    pub field: StiffnessField,
    pub stored: StoredEstimate,
}

/// Kinds of files a field is written to, by their ending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldFormat {
    Npz,
    Ply,
    Mcap,
    Png,
    Svg,
    Folder,
}

impl FieldFormat {
    /// The format of a path; other endings are refused.
    pub fn of(path: &Path) -> anyhow::Result<Self> {
        match ending(path).as_deref() {
            Some("npz") => Ok(Self::Npz),
            Some("ply") => Ok(Self::Ply),
            Some("mcap") => Ok(Self::Mcap),
            Some("png") => Ok(Self::Png),
            Some("svg") => Ok(Self::Svg),
            None => Ok(Self::Folder),
            Some(other) => Err(usage(format!(
                "{}: a field is written as .npz, .ply, .mcap or a folder (no ending), and drawn by \
                 `vsf export` as .png or .svg; not as .{other}",
                path.display()
            ))),
        }
    }

    /// Refuses the place of a picture where an estimate is to be kept.
    pub fn check_estimate(out: &Path) -> anyhow::Result<()> {
        if matches!(Self::of(out)?, Self::Png | Self::Svg) {
            return Err(Self::no_estimate(out));
        }
        Ok(())
    }

    fn no_estimate(picture: &Path) -> anyhow::Error {
        usage(format!(
            "--out {}: pictures are drawn by `vsf export`; give .npz, .ply, .mcap or a folder (no ending)",
            picture.display()
        ))
    }

    /// Refuses a file that holds something else than its ending says.
    pub fn check(path: &Path) -> anyhow::Result<()> {
        let kind = Self::of(path)?.kind();
        kind.map_or(Ok(()), |kind| kind.check("--out", path))
    }

    /// What its files are; none of a folder.
    fn kind(self) -> Option<FileKind> {
        Some(match self {
            Self::Npz => FileKind::Npz,
            Self::Ply => FileKind::Ply,
            Self::Mcap => FileKind::Mcap,
            Self::Png => FileKind::Png,
            Self::Svg => FileKind::Svg,
            Self::Folder => return None,
        })
    }
}

/// What a path ends in, in lower case.
fn ending(path: &Path) -> Option<String> {
    let ending = path.extension()?;
    Some(ending.to_string_lossy().to_ascii_lowercase())
}

impl FieldFile {
    /// Whether a path is that of a field, not of a recording.
    pub fn is_at(path: &Path) -> bool {
        ending(path).as_deref() == Some("npz") || path.is_file() || path.join("K.npy").is_file()
    }

    /// Reads an `.npz` or a folder, which `--json` must not name, and prints its warnings.
    pub fn open(path: &Path, console: &Console) -> anyhow::Result<Self> {
        if let Some(kind @ ("ply" | "mcap")) = ending(path).as_deref() {
            let path = path.display();
            anyhow::bail!("{path}: a .{kind} is for looking at; give the .npz or the folder");
        }
        console.outputs.keep(path)?;
        let (field, warnings) = StiffnessField::open(path)?;
        console.warn_all(warnings);
        Self::new(path.to_owned(), field)
    }

    /// A field that is the estimate of this program or could be.
    pub fn new(path: PathBuf, field: StiffnessField) -> anyhow::Result<Self> {
        let stored = stored(&field, &path)?;
        Ok(Self {
            path,
            field,
            stored,
        })
    }

    /// Warns where the scene has other parameters of contact than the field was estimated with, which flags have
    /// changed.
    pub fn compare_contact(&self, scene: &Scene, console: &Console) {
        let Some(stored) = &self.field.contact else {
            return;
        };
        if let Some((was, is)) =
            difference(&scene.as_stored_here(stored), &scene.contact_parameters())
        {
            let path = self.path.display();
            console.warn(format!(
                "{path}: the field was estimated with {was}, not {is}; without these flags it predicts as it was \
                 estimated"
            ));
        }
    }

    /// Warns where predictions in a scene run under another corrected model than the field was estimated with.
    pub fn compare_model(&self, given: Option<&CorrectedModel>, scene: &Scene, console: &Console) {
        let path = self.path.display();
        if let Some(own) = &self.field.contact
            && let Some(model) = given
            && let Some(of_model) = model.contact()
            && let Some((was, is)) = difference(
                &ContactParameters {
                    // Effects on joint torques do not depend on the contact threshold.
                    threshold: if model.follows_contact() {
                        of_model.threshold
                    } else {
                        own.threshold
                    },
                    ..scene.as_stored_here(of_model)
                },
                &scene.as_stored_here(own),
            )
        {
            console.warn(format!(
                "{path}: the corrected model was found with {was}, the field estimated with {is}: the model's effects \
                 are relative to another contact"
            ));
        }
        let given = given.map(CorrectedModel::text).filter(|t| !t.is_empty());
        // Fields of other programs do not say.
        let is_ours = self.field.contact.is_some();
        match (&self.field.model, &given) {
            (Some(stored), None) => console.warn(format!(
                "{path}: the field was estimated with a corrected model ({}); what is predicted without that \
                 (`vsf predict --model` and its like) lacks its effects",
                effects_of(stored)
            )),
            (Some(stored), Some(given)) if stored != given => console.warn(format!(
                "{path}: the field was estimated with another corrected model ({}) than --model gives ({})",
                effects_of(stored),
                effects_of(given)
            )),
            (None, Some(given)) if is_ours => console.warn(format!(
                "{path}: the field was estimated without the corrected model ({}); if these effects acted there, its \
                 stiffness makes up for them",
                effects_of(given)
            )),
            _ => {}
        }
    }

    /// Warns where the field has learned from sequences of `recording` that it is to predict; the IDs of the others.
    pub fn compare_sequences<'a>(
        &self,
        recording: &str,
        ids: Vec<&'a str>,
        console: &Console,
    ) -> Vec<&'a str> {
        let same = self.field.recording.as_deref() == Some(recording);
        let Some(learned_from) = self.field.learned_from.as_ref().filter(|_| same) else {
            return ids;
        };
        let known = |id: &&str| learned_from.iter().any(|l| l == id);
        let (again, others): (Vec<&str>, Vec<&str>) = ids.into_iter().partition(known);
        if !again.is_empty() {
            console.warn(format!(
                "{}: the field has learned from sequences that it predicts ({}): errors there are those of a \
                 fit",
                self.path.display(),
                listed(&again)
            ));
        }
        others
    }

    /// Standard deviation of the reading of each of `channels`; 0 and a warning where the file does
    /// not say.
    pub fn noise_sd(&self, channels: usize, console: &Console) -> anyhow::Result<Vec<f64>> {
        if !self.stored.has_deviations() && !self.field.points.is_empty() {
            let path = self.path.display();
            console.warn(format!(
                "{path}: without K_std and the feature noise_sd, deviations leave that part out"
            ));
        }
        let place = || self.path.display().to_string();
        let stored = self.stored.noise_sd(channels).with_context(place)?;
        Ok(stored.unwrap_or_else(|| vec![0.0; channels]))
    }
}

/// What a field says, laid to its file where that cannot be.
fn stored(field: &StiffnessField, path: &Path) -> anyhow::Result<StoredEstimate> {
    StoredEstimate::of(field).with_context(|| path.display().to_string())
}

/// Claims the place that [`save`] is to write to.
pub fn claim(out: &Path, console: &Console) -> anyhow::Result<()> {
    if let Some(kind) = FieldFormat::of(out)?.kind() {
        return console.outputs.file_anywhere("--out", out, kind);
    }
    let is_ours = |name: &str| name.ends_with(".npy") || name == "format.json";
    console.outputs.folder("--out", out, "a field", |names| {
        let other = names.iter().find(|n| !is_ours(n));
        // Others have files of the name K.npy, too.
        other.or_else(|| unmarked(names, &["format.json"]))
    })?;
    if StiffnessField::is_edited(out) {
        return Err(usage(format!(
            "--out {}: the field there was edited since vsf wrote it, which would be lost; choose a new folder, or remove that \
             one",
            out.display()
        )));
    }
    Ok(())
}

/// Writes a field as data: `.npz`, `.ply`, `.mcap` or a folder. What could not be read back is refused.
pub fn save(field: &StiffnessField, path: &Path) -> anyhow::Result<()> {
    stored(field, path)?;
    create_parent(path)?;
    writing(|| match FieldFormat::of(path)? {
        FieldFormat::Npz => Ok(field.save_npz(path)?),
        FieldFormat::Ply => Ok(field.save_ply(path, None)?),
        FieldFormat::Mcap => {
            let export = McapExport {
                field: Some(field),
                ..McapExport::default()
            };
            Ok(export.save(path)?)
        }
        FieldFormat::Folder => Ok(field.save_folder(path)?),
        FieldFormat::Png | FieldFormat::Svg => Err(FieldFormat::no_estimate(path)),
    })
}

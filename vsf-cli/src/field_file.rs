use crate::console::{Console, check_above, check_folder, create_folder, names_folder};
use crate::corrected::{CorrectedModel, effects_of};
use crate::exit::usage;
use crate::interrupt::writing;
use std::path::{Path, PathBuf};
use vsf::core::Belief;
use vsf::data::{ContactParameters, McapExport, Sequence, StiffnessField, Table};
use vsf::pipeline::{Estimate, Hyper, Scene};

const TOUCHED: &str = "touched";
pub const PRIOR_SD: &str = "prior_sd";
pub const NOISE_SD: &str = "noise_sd";
/// Largest stiffness or deviation that is taken [N/m]: squares of it are finite.
const MOST: f64 = 1e100;

/// A field on disk. Besides mean, deviation and parameters of contact it holds the features `touched` (0 or 1), and
/// `prior_sd` and `noise_sd` (one or one per channel), the same for every point: all that a prediction with its
/// deviation needs is in one file. Checked: see [`FieldFile::new`].
pub struct FieldFile {
    pub path: PathBuf,
    pub field: StiffnessField,
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
        match path.extension().and_then(|e| e.to_str()) {
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
}

impl FieldFile {
    /// Whether a path is that of a field, not of a recording.
    pub fn is_at(path: &Path) -> bool {
        let named = path.extension().is_some_and(|e| e == "npz");
        named || path.is_file() || path.join("K.npy").is_file()
    }

    /// Reads an `.npz` or a folder, which `--json` must not name, and prints its warnings.
    pub fn open(path: &Path, console: &Console) -> anyhow::Result<Self> {
        if let Some(kind @ ("ply" | "mcap")) = path.extension().and_then(|e| e.to_str()) {
            let path = path.display();
            return Err(usage(format!(
                "{path}: a .{kind} is for looking at; give the .npz or the folder"
            )));
        }
        console.keep_input(path)?;
        let (field, warnings) = StiffnessField::open(path)?;
        warnings.iter().for_each(|w| console.warn(w));
        Self::new(path.to_owned(), field)
    }

    /// A field that is the estimate of this program or could be: stiffness >= 0, `touched` 0 or 1,
    /// and `prior_sd` and `noise_sd` > 0, the same for all points.
    pub fn new(path: PathBuf, field: StiffnessField) -> anyhow::Result<Self> {
        Self::check(&path, &field)?;
        Ok(Self { path, field })
    }

    fn check(path: &Path, field: &StiffnessField) -> anyhow::Result<()> {
        let within = |name: &str, values: &[f64]| {
            let odd = values.iter().position(|v| !(0.0..=MOST).contains(v));
            let problem =
                |row: usize| format!("row {row} is {:?}, not in 0 .. 1e100 N/m", values[row]);
            odd.map_or(Ok(()), |row| Err(wrong(path, name, &problem(row))))
        };
        within("K", &field.stiffness)?;
        within("K_std", field.sd.as_deref().unwrap_or_default())?;
        column(path, field, PRIOR_SD)?;
        for name in [PRIOR_SD, NOISE_SD] {
            let Some(table) = field.features.get(name) else {
                continue;
            };
            let first = &table.data()[..table.cols()];
            if let Some(odd) = first.iter().find(|v| !(**v > 0.0 && **v <= MOST)) {
                let problem = format!("is {odd:?}; it must be > 0 and at most 1e100");
                return Err(wrong(path, name, &problem));
            }
            let mut rows = table.iter().enumerate();
            if let Some((row, other)) = rows.find(|(_, row)| *row != first) {
                let problem =
                    format!("row {row} is {other:?} and row 0 {first:?}; all must be the same");
                return Err(wrong(path, name, &problem));
            }
        }
        if let Some(values) = column(path, field, TOUCHED)?
            && let Some(row) = values.iter().position(|v| *v != 0.0 && *v != 1.0)
        {
            let problem = format!("row {row} is {:?}, neither 0 nor 1", values[row]);
            return Err(wrong(path, TOUCHED, &problem));
        }
        Ok(())
    }

    /// The field of an estimate from the recording of that name, by the nominal model.
    pub fn of_estimate(
        scene: &Scene,
        estimate: &Estimate,
        hyper: &Hyper,
        recording: &str,
    ) -> anyhow::Result<StiffnessField> {
        let column = |values: Vec<f64>| Table::new(1, values);
        let n = scene.rest().len();
        let touched = estimate.touched.iter().map(|&t| f64::from(u8::from(t)));
        let features = [
            (TOUCHED, column(touched.collect())?),
            (PRIOR_SD, column(vec![hyper.point_sd(); n])?),
            (
                NOISE_SD,
                Table::new(hyper.noise_sd.len(), hyper.noise_sd.repeat(n))?,
            ),
        ];
        Ok(StiffnessField {
            points: scene.rest().positions().to_vec(),
            stiffness: estimate.belief.mean().to_vec(),
            sd: Some(
                estimate
                    .belief
                    .variance()
                    .iter()
                    .map(|v| v.sqrt())
                    .collect(),
            ),
            features: features.map(|(k, v)| (k.to_owned(), v)).into(),
            recording: Some(recording.to_owned()),
            contact: Some(scene.contact_parameters()),
            ..StiffnessField::default()
        })
    }

    /// Mean and variance. Where the file has no deviation, or 0, the variance is next to nothing: a
    /// belief has one.
    pub fn belief(&self) -> anyhow::Result<Belief<f64>> {
        let least = f64::MIN_POSITIVE;
        let variance = match &self.field.sd {
            Some(sd) => sd.iter().map(|s| (s * s).max(least)).collect(),
            None => vec![least; self.field.points.len()],
        };
        Ok(Belief::new(self.field.stiffness.clone(), variance)?)
    }

    /// Warns where the scene has other parameters of contact than the field was estimated with, which flags have
    /// changed.
    pub fn compare_contact(&self, scene: &Scene, console: &Console) {
        let Some(stored) = &self.field.contact else {
            return;
        };
        if let Some((was, is)) = difference(stored, &scene.contact_parameters()) {
            let path = self.path.display();
            console.warn(format!(
                "{path}: the field was estimated with {was}, not {is}; without these flags it predicts as it was \
                 estimated"
            ));
        }
    }

    /// Warns where predictions run under another corrected model than the field was estimated with.
    pub fn compare_model(&self, given: Option<&CorrectedModel>, console: &Console) {
        let path = self.path.display();
        if let (Some(own), Some(of_model)) =
            (&self.field.contact, given.and_then(CorrectedModel::contact))
            && let Some((was, is)) = difference(of_model, own)
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
                "{path}: the field was estimated with a corrected model ({}); without --model its effects are \
                 missing from predictions",
                effects_of(stored)
            )),
            (Some(stored), Some(given)) if stored != given => console.warn(format!(
                "{path}: the field was estimated with another corrected model ({}) than --model gives ({})",
                effects_of(stored),
                effects_of(given)
            )),
            (None, Some(given)) if is_ours => console.warn(format!(
                "{path}: the field was estimated without the corrected model ({}); its stiffness makes up for \
                 the same effects",
                effects_of(given)
            )),
            _ => {}
        }
    }

    /// Warns where the field has learned from sequences of `recording` that it is to predict.
    pub fn compare_sequences(&self, recording: &str, sequences: &[&Sequence], console: &Console) {
        let same = self.field.recording.as_deref() == Some(recording);
        let Some(learned_from) = self.field.learned_from.as_ref().filter(|_| same) else {
            return;
        };
        let known = |id: &&str| learned_from.lines().any(|l| l == *id);
        let ids = sequences.iter().map(|s| s.id.as_str());
        let again: Vec<&str> = ids.filter(known).collect();
        if !again.is_empty() {
            console.warn(format!(
                "{}: the field has learned from sequences that it predicts ({}): errors there are those of a \
                 fit",
                self.path.display(),
                again.join(", ")
            ));
        }
    }

    /// Standard deviation of the stiffness of a point before it was touched, all parts of the prior
    /// together, if the file says.
    pub fn prior_sd(&self) -> anyhow::Result<Option<f64>> {
        let values = column(&self.path, &self.field, PRIOR_SD)?;
        Ok(values.and_then(|v| v.first().copied()))
    }

    /// Whether the file says all that deviations of predicted readings need.
    pub fn has_deviations(&self) -> bool {
        self.field.sd.is_some() && self.field.features.contains_key(NOISE_SD)
    }

    /// Standard deviation of the reading of each of `channels`; 0 and a warning where the file does
    /// not say.
    pub fn noise_sd(&self, channels: usize, console: &Console) -> anyhow::Result<Vec<f64>> {
        let stored = self.field.features.get(NOISE_SD);
        if !self.has_deviations() && !self.field.points.is_empty() {
            let path = self.path.display();
            console.warn(format!(
                "{path}: without K_std and the feature noise_sd, deviations leave that part out"
            ));
        }
        match stored.map(|table| &table.data()[..table.cols()]) {
            None => Ok(vec![0.0; channels]),
            Some([one]) => Ok(vec![*one; channels]),
            Some(all) if all.len() == channels => Ok(all.to_vec()),
            Some(all) => {
                let problem = format!("is of {} channels, the robot has {channels}", all.len());
                Err(wrong(&self.path, NOISE_SD, &problem))
            }
        }
    }
}

/// What parameters of contact are, by their flags, and what others are in their place.
fn difference(was: &ContactParameters, is: &ContactParameters) -> Option<(String, String)> {
    let pairs = contact_flags(was).into_iter().zip(contact_flags(is));
    let (was, is): (Vec<_>, Vec<_>) = pairs
        .filter(|((_, was), (_, is))| was != is)
        .map(|((flag, was), (_, is))| (format!("{flag} {was}"), is))
        .unzip();
    (!was.is_empty()).then(|| (was.join(" "), is.join(" ")))
}

/// Parameters of contact by their flags.
fn contact_flags(contact: &ContactParameters) -> [(&'static str, String); 7] {
    let links = match &contact.links {
        Some(names) => {
            let mut names = names.clone();
            names.sort();
            names.join(",")
        }
        None => "of all links".to_owned(),
    };
    [
        ("--threshold", contact.threshold.to_string()),
        ("--friction", contact.friction.to_string()),
        ("--slip-step", contact.slip_step.to_string()),
        (
            "--max-slip-iterations",
            contact.max_slip_iterations.to_string(),
        ),
        ("--padding", contact.padding.to_string()),
        ("--subdivision", contact.subdivision.to_string()),
        ("--links", links),
    ]
}

/// The numbers of a feature with one column; there are as many as points.
fn column<'a>(
    path: &Path,
    field: &'a StiffnessField,
    name: &str,
) -> anyhow::Result<Option<&'a [f64]>> {
    match field.features.get(name) {
        Some(t) if t.cols() != 1 => {
            let problem = format!("has {} columns, expected one number per point", t.cols());
            Err(wrong(path, name, &problem))
        }
        found => Ok(found.map(Table::data)),
    }
}

fn wrong(path: &Path, name: &str, problem: &str) -> anyhow::Error {
    anyhow::anyhow!("{}: {name} {problem}", path.display())
}

/// Which points were touched; none listed where the field does not say.
pub fn touched(field: &StiffnessField) -> Vec<bool> {
    let feature = field.features.get(TOUCHED);
    feature.map_or_else(Vec::new, |t| t.data().iter().map(|&v| v != 0.0).collect())
}

/// Refuses what [`save`] would refuse in the end, before the work begins.
pub fn check_out(out: &Path) -> anyhow::Result<()> {
    let path = out.display();
    check_above("--out", out)?;
    if FieldFormat::of(out)? != FieldFormat::Folder {
        return match names_folder(out) {
            true => Err(usage(format!("--out {path}: it is a folder"))),
            false => Ok(()),
        };
    }
    let is_ours = |name: &str| name.ends_with(".npy") || name == "format.json";
    check_folder("--out", out, "a field", |names| {
        names.iter().find(|n| !is_ours(n))
    })
}

/// Writes a field as data: `.npz`, `.ply`, `.mcap` or a folder. What could not be read back is refused.
pub fn save(field: &StiffnessField, path: &Path) -> anyhow::Result<()> {
    FieldFile::check(path, field)?;
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        create_folder(parent)?;
    }
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
        FieldFormat::Png | FieldFormat::Svg => {
            let path = path.display();
            Err(usage(format!(
                "{path}: pictures are drawn by `vsf export`; give .npz, .ply, .mcap or a folder (no ending)"
            )))
        }
    })
}

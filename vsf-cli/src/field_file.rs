use crate::console::{Console, create_folder};
use crate::exit::usage;
use crate::interrupt::writing;
use std::path::{Path, PathBuf};
use vsf::core::Belief;
use vsf::data::{StiffnessField, Table};
use vsf::pipeline::{Estimate, Scene};

const TOUCHED: &str = "touched";
const PRIOR_SD: &str = "prior_sd";
const NOISE_SD: &str = "noise_sd";

/// A field on disk. Besides mean and deviation it holds the features `touched` (0 or 1), and
/// `prior_sd` and `noise_sd`, the same for every point: all that a prediction with its deviation
/// needs is in one file.
pub struct FieldFile {
    pub path: PathBuf,
    pub field: StiffnessField,
}

/// Kinds of files a field is written to, by their ending.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FieldFormat {
    Npz,
    Ply,
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
            Some("png") => Ok(Self::Png),
            Some("svg") => Ok(Self::Svg),
            None => Ok(Self::Folder),
            Some(other) => Err(usage(format!(
                "{}: a field is written as .npz, .ply, .png, .svg or a folder (no ending), not .{other}",
                path.display()
            ))),
        }
    }
}

impl FieldFile {
    /// Reads an `.npz` or a folder and prints its warnings.
    pub fn open(path: &Path, console: &Console) -> anyhow::Result<Self> {
        if path.extension().is_some_and(|e| e == "ply") {
            let path = path.display();
            return Err(usage(format!(
                "{path}: a .ply is for looking at; give the .npz or the folder"
            )));
        }
        let (field, warnings) = StiffnessField::open(path)?;
        warnings.iter().for_each(|w| console.warn(w));
        Ok(Self {
            path: path.to_owned(),
            field,
        })
    }

    /// The field of an estimate.
    pub fn of_estimate(scene: &Scene, estimate: &Estimate) -> anyhow::Result<StiffnessField> {
        let column = |values: Vec<f64>| Table::new(1, values);
        let n = scene.rest.len();
        let touched = estimate.touched.iter().map(|&t| f64::from(u8::from(t)));
        let features = [
            (TOUCHED, column(touched.collect())?),
            (PRIOR_SD, column(vec![estimate.hyper.prior_sd; n])?),
            (NOISE_SD, column(vec![estimate.hyper.noise_sd; n])?),
        ];
        Ok(StiffnessField {
            points: scene.rest.positions().to_vec(),
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
        })
    }

    /// Mean and variance; variance 0 where the file has none.
    pub fn belief(&self) -> anyhow::Result<Belief<f64>> {
        let variance = match &self.field.sd {
            Some(sd) => sd.iter().map(|s| s * s).collect(),
            None => vec![0.0; self.field.points.len()],
        };
        Ok(Belief::new(self.field.stiffness.clone(), variance)?)
    }

    /// Standard deviation of a reading, 0 and a warning where the file does not say.
    pub fn noise_sd(&self, console: &Console) -> f64 {
        let stored = self
            .field
            .features
            .get(NOISE_SD)
            .and_then(|t| t.data().first());
        if stored.is_none() || self.field.sd.is_none() {
            let path = self.path.display();
            console.warn(format!(
                "{path}: without K_std and the feature noise_sd, deviations leave that part out"
            ));
        }
        stored.copied().unwrap_or(0.0).max(0.0)
    }
}

/// Which points were touched; none listed where the field does not say.
pub fn touched(field: &StiffnessField) -> Vec<bool> {
    let feature = field.features.get(TOUCHED).filter(|t| t.cols() == 1);
    feature.map_or_else(Vec::new, |t| t.data().iter().map(|&v| v != 0.0).collect())
}

/// Writes a field as data: `.npz`, `.ply` or a folder.
pub fn save(field: &StiffnessField, path: &Path) -> anyhow::Result<()> {
    if let Some(parent) = path.parent().filter(|p| !p.as_os_str().is_empty()) {
        create_folder(parent)?;
    }
    writing(|| match FieldFormat::of(path)? {
        FieldFormat::Npz => Ok(field.save_npz(path)?),
        FieldFormat::Ply => Ok(field.save_ply(path, None)?),
        FieldFormat::Folder => Ok(field.save_folder(path)?),
        FieldFormat::Png | FieldFormat::Svg => {
            let path = path.display();
            Err(usage(format!(
                "{path}: pictures are written by `vsf export`"
            )))
        }
    })
}

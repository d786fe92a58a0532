use crate::colormap::Scale;
use crate::npy::{self, NpyError};
use crate::staged::{self, Staged};
use crate::{
    ContactParameters, DataError, DataWarning, Table, edits, files, json, npz, ply, pose,
    write_file,
};
use nalgebra::{Isometry3, Point3};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub(crate) const POINTS: &str = "points";
pub(crate) const STIFFNESS: &str = "K";
pub(crate) const SD: &str = "K_std";
/// Name of the mark that says what `K_std` is. OpenVSF writes a variance under that name, without a mark.
const SD_UNIT: &str = "K_std_unit";
const STANDARD_DEVIATION: &str = "standard_deviation";
/// Name of the mark for the recording that the field was estimated from.
const RECORDING: &str = "recording_name";
/// Name of the mark for the IDs of the sequences that the field was learned from.
const LEARNED_FROM: &str = "learned_from";
/// Name of the mark for the corrected model.
const MODEL: &str = "corrected_model";
/// Name of the mark for the parameters of contact.
const CONTACT: &str = "contact_parameters";
/// Name of the mark for the pose of the robot's base.
const BASE_POSE: &str = "base_pose";
const AXIS_MODE: &str = "axis_mode";
const ISOTROPIC: &str = "isotropic";
/// OpenVSF's pickled dictionary.
const PICKLE: &str = "features";
/// File with the marks of a field in a folder. A `.npy` file of text would break OpenVSF's reader.
const MARKS: &str = "format.json";

/// A stiffness field on disk: points and their estimated stiffness.
///
/// The layout is OpenVSF's `PointVSF`: the entries `points` (N, 3) and `K` (N,) of an `.npz` archive or of a folder of
/// `.npy` files, and further arrays with N rows as features. `K_std` is written as a standard deviation and marked as such
/// (`K_std_unit` in an archive, `format.json` in a folder). A `K_std` without the mark is not used, since OpenVSF writes
/// the variance there.
///
/// Further marks, all optional:
///
/// - `recording_name`: name of the recording;
/// - `learned_from` (a list): IDs of the sequences that the field was learned from;
/// - `corrected_model`: a corrected model;
/// - `contact_parameters` (an object): the contact parameters;
/// - `base_pose` (4x4, row major): the pose of the robot's base.
///
/// In an archive, lists and objects are JSON text.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StiffnessField {
    /// Rest positions `p_i` \[m\], world frame.
    pub points: Vec<Point3<f64>>,
    /// Mean of `K_i` [N/m], one per point. Negative values, from estimators that do not bound `K`, are kept.
    pub stiffness: Vec<f64>,
    /// Standard deviation of `K_i` [N/m], one per point.
    pub sd: Option<Vec<f64>>,
    /// Further numbers per point, by name, one row per point. Of arrays of higher rank, a row holds the numbers of a point
    /// in C order.
    pub features: BTreeMap<String, Table>,
    /// Name of the recording that the field was estimated from, if known.
    pub recording: Option<String>,
    /// IDs of the sequences of that recording that the field was learned from, if known.
    pub learned_from: Option<Vec<String>>,
    /// Description of the corrected model that explained a part of the readings, if there was one.
    pub model: Option<String>,
    /// The contact parameters that the field was estimated with, if known.
    pub contact: Option<ContactParameters>,
    /// The pose `X_WB` of the robot's base that the field was estimated with, within ±1e6 m, if known.
    ///
    /// After reading back, it may differ in the last digit.
    pub base_pose: Option<Isometry3<f64>>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(expecting = "an object of marks")]
struct Marks {
    axis_mode: Option<String>,
    #[serde(rename = "K_std_unit")]
    sd_unit: Option<String>,
    #[serde(rename = "recording_name")]
    recording: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    learned_from: Option<Vec<String>>,
    #[serde(rename = "corrected_model", skip_serializing_if = "Option::is_none")]
    model: Option<String>,
    #[serde(rename = "contact_parameters", skip_serializing_if = "Option::is_none")]
    contact: Option<ContactParameters>,
    #[serde(skip_serializing_if = "Option::is_none")]
    base_pose: Option<pose::Rows4>,
    /// Digest of a folder as it was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    digest: Option<String>,
}

/// The arrays of a field before they are interpreted, from an archive or a folder.
struct Source {
    path: PathBuf,
    /// The bytes of each `.npy`, by name without extension.
    entries: BTreeMap<String, Vec<u8>>,
    marks: Marks,
}

impl StiffnessField {
    /// Reads an `.npz` archive, stored or deflated, or a folder with `points.npy` and `K.npy`.
    ///
    /// # Errors
    /// - Damaged files, numbers that are not finite, arrays of different length.
    /// - [`DataError::AxisMode`] for a stiffness per axis.
    /// - [`DataError::PickledFeatures`] for the pickle of OpenVSF's archives, which is never executed; the message says how
    ///   to convert.
    pub fn open(path: impl AsRef<Path>) -> Result<(Self, Vec<DataWarning>), DataError> {
        let path = path.as_ref();
        let mut warnings = Vec::new();
        let source = if path.is_dir() {
            Source::folder(path, &mut warnings)?
        } else {
            Source::archive(path)?
        };
        let field = source.read(&mut warnings)?;
        field.check(path)?;
        Ok((field, warnings))
    }

    /// Writes an uncompressed `.npz` archive, completely or not at all. OpenVSF reads it, without the features.
    ///
    /// # Errors
    /// Lengths that differ; numbers that are not finite; a feature named like an entry of the format; [`DataError::Io`].
    pub fn save_npz(&self, path: impl AsRef<Path>) -> Result<(), DataError> {
        let path = path.as_ref();
        write_file(path, &self.npz(path)?)
    }

    /// The bytes of the archive; `path` is for messages.
    pub(crate) fn npz(&self, path: &Path) -> Result<Vec<u8>, DataError> {
        self.check(path)?;
        let mut entries = self.arrays();
        let marks = self.marks();
        for (name, text) in [
            (AXIS_MODE, &marks.axis_mode),
            (SD_UNIT, &marks.sd_unit),
            (RECORDING, &marks.recording),
            (MODEL, &marks.model),
        ] {
            if let Some(text) = text {
                entries.insert(name.to_owned(), npy::encode_text(text));
            }
        }
        let mut structured = |name: &str, json: Vec<u8>| {
            let text = String::from_utf8_lossy(&json);
            entries.insert(name.to_owned(), npy::encode_text(&text));
        };
        if let Some(ids) = &marks.learned_from {
            structured(LEARNED_FROM, json::encode(&entry(path, LEARNED_FROM), ids)?);
        }
        if let Some(contact) = &marks.contact {
            structured(CONTACT, json::encode(&entry(path, CONTACT), contact)?);
        }
        if let Some(rows) = &marks.base_pose {
            structured(BASE_POSE, json::encode(&entry(path, BASE_POSE), rows)?);
        }
        npz::encode(path, &entries)
    }

    fn marks(&self) -> Marks {
        Marks {
            axis_mode: Some(ISOTROPIC.to_owned()),
            sd_unit: self.sd.as_ref().map(|_| STANDARD_DEVIATION.to_owned()),
            recording: self.recording.clone(),
            learned_from: self.learned_from.clone(),
            model: self.model.clone(),
            contact: self.contact.clone(),
            base_pose: self.base_pose.as_ref().map(pose::to_rows),
            digest: None,
        }
    }

    /// Writes a folder of `.npy` files, all or none. OpenVSF reads it, with the features.
    ///
    /// So that a field never mixes with anything else, the folder must be new, or hold only files that this replaces. Files
    /// whose names begin with a dot do not count.
    ///
    /// # Errors
    /// As [`save_npz`](Self::save_npz). [`DataError::Leftover`] names what is in the way, [`DataError::Link`] a link in the
    /// place of a file.
    pub fn save_folder(&self, folder: impl AsRef<Path>) -> Result<(), DataError> {
        let folder = folder.as_ref();
        self.check(folder)?;
        let mut staged = Staged::below(folder)?;
        let path = folder.join(MARKS);
        let mut contents: BTreeMap<_, _> = (self.arrays().into_iter())
            .map(|(name, bytes)| (entry(folder, &name), bytes))
            .collect();
        let mut marks = self.marks();
        let files = contents.iter().map(|(path, bytes)| digest_of(path, bytes));
        let digest = edits::digest(&json::encode(&path, &marks)?, &files.collect());
        marks.digest = Some(digest.map_err(|e| json::failure(&path, &e))?);
        contents.insert(path.clone(), json::encode(&path, &marks)?);
        let mut there = if files::is_there(folder) {
            files::list(folder)?.into_iter()
        } else {
            Vec::new().into_iter()
        };
        if let Some(path) = there.find(|p| !is_hidden(p) && !contents.contains_key(p)) {
            return Err(DataError::Leftover { path });
        }
        // Without points it is no field: they come last.
        let points = entry(folder, POINTS);
        let (last, first): (Vec<_>, Vec<_>) = contents.iter().partition(|(p, _)| **p == points);
        for (path, bytes) in first.into_iter().chain(last) {
            staged.file(path, bytes)?;
        }
        staged.commit()
    }

    /// Whether the field in a folder was edited since [`save_folder`](Self::save_folder) wrote it, for example by hand.
    ///
    /// `format.json` holds a digest of its values and of the arrays. A field without a digest counts as edited. A folder
    /// without points, as after an interrupted write, holds no field.
    pub fn is_edited(folder: impl AsRef<Path>) -> bool {
        let folder = folder.as_ref();
        if !files::is_there(&entry(folder, POINTS)) {
            return false;
        }
        let marks = folder.join(MARKS);
        let arrays = || -> Result<edits::Files, DataError> {
            let there = files::list(folder)?.into_iter();
            there
                .filter(|path| !is_hidden(path) && *path != marks)
                .map(|path| Ok(digest_of(&path, &files::read(&path)?)))
                .collect()
        };
        match (files::read(&marks), arrays()) {
            (Ok(marks), Ok(arrays)) => !edits::agrees(&marks, &arrays),
            _ => true,
        }
    }

    /// Writes a binary PLY point cloud with the properties `x y z`, `stiffness` and, if known, `sd` (doubles), and a color.
    ///
    /// Colors are those of [`color`](crate::color): 0 N/m is dark violet, `full_scale` [N/m] and above is yellow. The
    /// default full scale is the largest stiffness.
    ///
    /// # Errors
    /// As [`save_npz`](Self::save_npz); [`DataError::Argument`] for a full scale that is not positive and finite.
    pub fn save_ply(
        &self,
        path: impl AsRef<Path>,
        full_scale: Option<f64>,
    ) -> Result<(), DataError> {
        let path = path.as_ref();
        self.check(path)?;
        ply::write(path, self, Scale::new(&self.stiffness, full_scale)?)
    }

    fn arrays(&self) -> BTreeMap<String, Vec<u8>> {
        let n = self.points.len();
        let mut arrays = BTreeMap::from([
            (
                POINTS.to_owned(),
                npy::encode(&[n, 3], &files::coordinates(&self.points)),
            ),
            (STIFFNESS.to_owned(), npy::encode(&[n], &self.stiffness)),
        ]);
        if let Some(sd) = &self.sd {
            arrays.insert(SD.to_owned(), npy::encode(&[n], sd));
        }
        for (name, table) in &self.features {
            let bytes = match table.cols() {
                1 => npy::encode(&[n], table.data()),
                cols => npy::encode(&[n, cols], table.data()),
            };
            arrays.insert(name.clone(), bytes);
        }
        arrays
    }

    pub(crate) fn check(&self, path: &Path) -> Result<(), DataError> {
        files::check_points(&entry(path, POINTS), &self.points)?;
        check_numbers(&entry(path, STIFFNESS), &self.stiffness, self.points.len())?;
        if let Some(sd) = &self.sd {
            check_numbers(&entry(path, SD), sd, self.points.len())?;
            if let Some(row) = sd.iter().position(|&v| v < 0.0) {
                return Err(DataError::NegativeDeviation {
                    path: entry(path, SD),
                    row,
                    value: sd[row],
                });
            }
        }
        if let Some(contact) = &self.contact {
            contact.check_in(path)?;
        }
        if let Some(base) = &self.base_pose {
            pose::check(base).map_err(|problem| wrong_pose(path, problem))?;
        }
        for (name, table) in &self.features {
            let reserved = [
                POINTS,
                STIFFNESS,
                SD,
                SD_UNIT,
                AXIS_MODE,
                RECORDING,
                LEARNED_FROM,
                MODEL,
                CONTACT,
                BASE_POSE,
                PICKLE,
            ];
            // Readers of folders leave hidden files alone.
            let hidden = name.starts_with('.');
            let not_a_file = hidden || name.is_empty() || name.contains(['/', '\\', '\0']);
            if not_a_file || reserved.contains(&name.as_str()) {
                return Err(DataError::FeatureName {
                    path: path.to_owned(),
                    name: name.clone(),
                });
            }
            let path = entry(path, name);
            check_rows(&path, table.rows(), self.points.len())?;
            if let Some((row, column, value)) = table.first_not_finite() {
                return Err(DataError::NotFinite {
                    path,
                    row,
                    column: format!("column {}", column + 1),
                    value,
                });
            }
        }
        Ok(())
    }
}

/// Parses a mark of an archive that is JSON text.
fn structured<T: DeserializeOwned>(
    path: &Path,
    name: &str,
    text: Option<String>,
) -> Result<Option<T>, DataError> {
    text.map(|text| json::parse(&entry(path, name), text.as_bytes()))
        .transpose()
}

fn is_hidden(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().starts_with('.')
}

/// Relative path and digest of a file in a folder.
fn digest_of(path: &Path, bytes: &[u8]) -> (PathBuf, blake3::Hash) {
    let name = path.file_name().unwrap_or_default();
    (name.into(), blake3::hash(bytes))
}

impl Source {
    fn archive(path: &Path) -> Result<Self, DataError> {
        let mut entries = npz::read(path)?;
        let mut text = |name: &str| match entries.remove(name).map(|b| npy::parse_text(&b)) {
            None => Ok(None),
            Some(Ok(text)) => Ok(Some(text)),
            Some(Err(source)) => Err(DataError::Npy {
                path: entry(path, name),
                source,
            }),
        };
        let marks = Marks {
            contact: structured(path, CONTACT, text(CONTACT)?)?,
            base_pose: structured(path, BASE_POSE, text(BASE_POSE)?)?,
            axis_mode: text(AXIS_MODE)?,
            sd_unit: text(SD_UNIT)?,
            recording: text(RECORDING)?,
            learned_from: structured(path, LEARNED_FROM, text(LEARNED_FROM)?)?,
            model: text(MODEL)?,
            digest: None,
        };
        Ok(Self {
            path: path.to_owned(),
            entries,
            marks,
        })
    }

    fn folder(path: &Path, warnings: &mut Vec<DataWarning>) -> Result<Self, DataError> {
        if !files::is_there(&entry(path, POINTS)) && !staged::hidden_in(path).is_empty() {
            return Err(DataError::Interrupted {
                path: path.to_owned(),
            });
        }
        let marks = path.join(MARKS);
        let marks = match files::read(&marks) {
            Ok(bytes) => json::parse(&marks, &bytes)?,
            Err(DataError::Missing { .. }) => Marks::default(),
            Err(e) => return Err(e),
        };
        let mut entries = BTreeMap::new();
        for file in files::list(path)?.into_iter().filter(|p| !is_hidden(p)) {
            let name = file.file_stem().unwrap_or_default().to_str();
            match name.filter(|_| has_extension(&file, "npy")) {
                Some(name) => {
                    entries.insert(name.to_owned(), files::read(&file)?);
                }
                None if has_extension(&file, "npy") || has_extension(&file, "npz") => {
                    warnings.push(DataWarning::Ignored {
                        path: file,
                        why: "features are read from .npy files with a UTF-8 name",
                    });
                }
                None => {}
            }
        }
        Ok(Self {
            path: path.to_owned(),
            entries,
            marks,
        })
    }

    fn read(mut self, warnings: &mut Vec<DataWarning>) -> Result<StiffnessField, DataError> {
        if let Some(bytes) = self.entries.get(PICKLE)
            && npy::parse(bytes) == Err(NpyError::Object)
        {
            return Err(DataError::PickledFeatures { path: self.path });
        }
        let points_path = entry(&self.path, POINTS);
        let points = files::points(&points_path, self.required(POINTS)?)?;
        let stiffness = self.stiffness(points.len())?;
        let sd = match self.entries.remove(SD) {
            Some(bytes) if self.marks.sd_unit.as_deref() == Some(STANDARD_DEVIATION) => {
                let path = entry(&self.path, SD);
                Some(files::vector(&path, files::parse_npy(&path, &bytes)?)?)
            }
            Some(_) => {
                warnings.push(DataWarning::UnmarkedDeviation {
                    path: self.path.clone(),
                });
                None
            }
            None => None,
        };
        let mut features = BTreeMap::new();
        for (name, bytes) in self.entries {
            let path = entry(&self.path, &name);
            let array = match npy::parse_with_bools(&bytes) {
                Ok(array) => array,
                Err(NpyError::Dtype(_) | NpyError::Magic) => {
                    warnings.push(DataWarning::Ignored {
                        path,
                        why: "not an array of numbers",
                    });
                    continue;
                }
                Err(source) => return Err(DataError::Npy { path, source }),
            };
            check_rows(&path, *array.shape.first().unwrap_or(&0), points.len())?;
            let mut inner = array.shape.iter().skip(1);
            let cols = match inner.try_fold(1, |n: usize, size| n.checked_mul(*size)) {
                Some(0) => {
                    let what = "the feature";
                    return Err(DataError::Empty { path, what });
                }
                Some(cols) => cols,
                None => {
                    let source = NpyError::Shape(array.shape);
                    return Err(DataError::Npy { path, source });
                }
            };
            features.insert(name, Table::new(cols, array.data)?);
        }
        let base_pose = self.marks.base_pose.map(|rows| pose::from_rows(&rows));
        Ok(StiffnessField {
            points,
            stiffness,
            sd,
            features,
            recording: self.marks.recording,
            learned_from: self.marks.learned_from,
            model: self.marks.model,
            contact: self.marks.contact,
            base_pose: base_pose
                .transpose()
                .map_err(|problem| wrong_pose(&self.path, problem))?,
        })
    }

    fn required(&mut self, name: &str) -> Result<npy::NpyArray, DataError> {
        let path = entry(&self.path, name);
        match self.entries.remove(name) {
            Some(bytes) => files::parse_npy(&path, &bytes),
            None => Err(DataError::Missing {
                path,
                what: "array (a field needs points and K)",
            }),
        }
    }

    fn stiffness(&mut self, points: usize) -> Result<Vec<f64>, DataError> {
        let array = self.required(STIFFNESS)?;
        let implied = match array.shape[..] {
            [_] | [_, 1] => ISOTROPIC,
            [_, 3] => "axis_aligned",
            [_, 3, 3] => "anisotropic",
            _ => "unknown",
        };
        let declared = self.marks.axis_mode.as_deref().unwrap_or(implied);
        if [implied, declared] != [ISOTROPIC; 2] {
            return Err(DataError::AxisMode {
                path: self.path.clone(),
                axis_mode: declared.to_owned(),
                got: array.shape,
                points,
            });
        }
        Ok(array.data)
    }
}

fn wrong_pose(path: &Path, problem: String) -> DataError {
    DataError::Metadata {
        path: path.to_owned(),
        key: BASE_POSE,
        problem,
    }
}

/// The path of an array, in a folder or in an archive.
fn entry(path: &Path, name: &str) -> PathBuf {
    path.join(format!("{name}.npy"))
}

/// Whether a folder holds a field.
pub(crate) fn is_folder(path: &Path) -> bool {
    let holds = |name: &str| entry(path, name).is_file();
    holds(POINTS) && holds(STIFFNESS)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    (path.extension()).is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

fn check_rows(path: &Path, got: usize, points: usize) -> Result<(), DataError> {
    if got == points {
        return Ok(());
    }
    Err(DataError::Rows {
        path: path.to_owned(),
        got,
        reference: POINTS.to_owned(),
        expected: points,
    })
}

fn check_numbers(path: &Path, values: &[f64], points: usize) -> Result<(), DataError> {
    check_rows(path, values.len(), points)?;
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(row) => Err(DataError::NotFinite {
            path: path.to_owned(),
            row,
            column: String::new(),
            value: values[row],
        }),
    }
}

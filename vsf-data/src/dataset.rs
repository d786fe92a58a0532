use crate::check::check_metadata;
use crate::metadata::{self, Attachment, JointType, Overrides, RobotRef, Splits, TorqueKind};
use crate::sequence::{self, Sequence};
use crate::staged::Staged;
use crate::{CameraView, ContactParameters, DataError, DataWarning, StiffnessField};
use crate::{field, files, natural, npy};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

pub(crate) const POINTS: &str = "points.npy";
pub(crate) const FIELD: &str = "vsf.npz";
pub(crate) const CAMERA: &str = "camera";

/// One recording campaign of one object: a folder of touch sequences with metadata.
///
/// The z axis of the world frame points up. Units are SI, angles in radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Name; by default that of the folder.
    pub name: String,
    /// Free text.
    pub description: String,
    /// The robot.
    pub robot: RobotRef,
    /// Meaning of the torque columns.
    pub torque_kind: TorqueKind,
    /// Sample rate \[Hz\], 1e-6 to 1e9; needed only for sequences without time stamps.
    pub rate_hz: Option<f64>,
    /// Gravity [m/s^2], world frame; default (0, 0, -9.81), length at most 100.
    pub gravity: Vector3<f64>,
    /// Pose of the robot's base in the world, `X_WB`; default identity, within ±1e6 m.
    pub base_pose: Isometry3<f64>,
    /// Smallest and largest corner of the object's bounding box \[m\], world frame.
    pub object_bbox: Option<[Point3<f64>; 2]>,
    /// Number of contact-free samples at the start of every sequence, for taring the torque sensor.
    ///
    /// Where external torques are used, their mean over these samples is subtracted. The recording itself keeps its
    /// readings.
    pub tare_samples: usize,
    /// Which sequences are for training and which for test.
    pub splits: Splits,
    /// Joint names of the columns; `None` means the robot's chain order.
    pub joints: Option<Vec<String>>,
    /// Joint types of the columns; `None` means those of the URDF.
    pub joint_types: Option<Vec<JointType>>,
    /// How the object is attached to the robot.
    pub attachment: Attachment,
    /// Rest length of a clamped specimen \[m\], positive.
    pub gauge_length: Option<f64>,
    /// The command that computed or converted the recording, such as `vsf simulate`; `None` if it was measured.
    pub made_by: Option<String>,
    /// The contact parameters that the torques were computed with, if they were not measured.
    pub contact: Option<ContactParameters>,
    /// Rest positions `p_i` \[m\], world frame.
    pub rest_points: Option<Vec<Point3<f64>>>,
    /// A stored field: `vsf.npz`, or a folder with `points.npy` and `K.npy`.
    pub field: Option<StiffnessField>,
    /// One RGB-D view of the object before contact.
    pub camera: Option<CameraView>,
    /// The touch sequences, at least one, in natural order: `seq_2` before `seq_10`.
    pub sequences: Vec<Sequence>,
    /// Keys of `dataset.json` that this version does not know, with their values as JSON text. [`save`](Self::save) writes
    /// them back.
    pub extra: BTreeMap<String, String>,
}

/// The parts of a data set beside its metadata.
pub(crate) struct Parts {
    pub sequences: Vec<Sequence>,
    pub rest_points: Option<Vec<Point3<f64>>>,
    pub field: Option<StiffnessField>,
    pub camera: Option<CameraView>,
}

impl Dataset {
    /// Folder within a recording for the files of its robot ([`save_with`](Self::save_with)).
    pub const ROBOT: &str = "robot";

    /// A recording with default metadata: all sequences are for training, torques are external, the robot is at the origin
    /// of the world, and nothing is known about the object.
    ///
    /// ```
    /// use vsf_data::{Dataset, RobotRef, Sequence, Table, TorqueKind};
    ///
    /// let angles = Table::new(3, vec![0.1, 0.2, 0.3, 0.1, 0.2, 0.4])?;
    /// let torques = Table::new(3, vec![0.0, 0.0, 0.0, 0.1, 0.0, 0.2])?;
    /// let touch = Sequence::new("first", vec![0.0, 0.01], angles, torques);
    /// let robot = RobotRef::resolve("planar_arm", ".".as_ref())?;
    /// let recording = Dataset {
    ///     torque_kind: TorqueKind::Measured,
    ///     ..Dataset::new(robot, vec![touch])
    /// };
    /// assert_eq!(recording.splits.train, ["first"]);
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    pub fn new(robot: RobotRef, sequences: Vec<Sequence>) -> Self {
        Self {
            name: String::new(),
            description: String::new(),
            robot,
            torque_kind: TorqueKind::default(),
            rate_hz: None,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            base_pose: Isometry3::identity(),
            object_bbox: None,
            tare_samples: 0,
            splits: Splits {
                train: sequences.iter().map(|s| s.id.clone()).collect(),
                test: Vec::new(),
            },
            joints: None,
            joint_types: None,
            attachment: Attachment::default(),
            gauge_length: None,
            made_by: None,
            contact: None,
            rest_points: None,
            field: None,
            camera: None,
            sequences,
            extra: BTreeMap::new(),
        }
    }

    /// Reads the folder `dir`. `overrides` take precedence over `dataset.json`.
    ///
    /// Nothing is repaired, shortened or filled in: a folder that does not follow the format is an error. So is an ID in
    /// both splits, or listed twice. If `splits` lists only one of `train` and `test`, the other is empty; without
    /// `splits`, every sequence is for training.
    ///
    /// # Errors
    /// Any [`DataError`]; it names file, sequence and row.
    pub fn open(
        dir: impl AsRef<Path>,
        overrides: &Overrides,
    ) -> Result<(Self, Vec<DataWarning>), DataError> {
        let dir = dir.as_ref();
        if !dir.is_dir() {
            return Err(DataError::Missing {
                path: dir.to_owned(),
                what: "data set folder",
            });
        }
        if metadata::is_interrupted(dir) {
            return Err(DataError::Interrupted {
                path: dir.to_owned(),
            });
        }
        let (metadata, extra) = metadata::read(dir, overrides)?;
        let mut warnings = unknown_keys(dir.join(metadata::FILE), &extra);
        check_metadata(dir, &metadata)?;
        // First of all, whether it is a recording.
        let ids = sequence_ids(dir)?;
        check_robot(dir, &metadata)?;
        let sequences = (ids.iter())
            .map(|(id, folder)| Sequence::load(folder, id, metadata.rate_hz))
            .collect::<Result<Vec<_>, _>>()?;
        warnings.extend(other_arrays(ids.iter().map(|(_, folder)| folder))?);
        let points = dir.join(POINTS);
        let rest_points = if files::is_there(&points) {
            Some(files::points(&points, files::read_npy(&points)?)?)
        } else {
            None
        };
        let mut field = None;
        if let Some(path) = stored_field(dir)? {
            let (read, more) = StiffnessField::open(path)?;
            warnings.extend(more);
            field = Some(read);
        }
        let mut camera = None;
        if files::is_there(&dir.join(CAMERA)) {
            let (read, more) = CameraView::open(dir.join(CAMERA))?;
            warnings.extend(more);
            camera = Some(read);
        }
        let parts = Parts {
            sequences,
            rest_points,
            field,
            camera,
        };
        let (dataset, more) = Self::assemble(dir, metadata, extra, parts)?;
        warnings.extend(more);
        Ok((dataset, warnings))
    }

    /// Assembles and checks the data set. Messages name files below `dir`.
    pub(crate) fn assemble(
        dir: &Path,
        metadata: Overrides,
        extra: BTreeMap<String, String>,
        parts: Parts,
    ) -> Result<(Self, Vec<DataWarning>), DataError> {
        let robot = check_robot(dir, &metadata)?.clone();
        let mut sequences = parts.sequences;
        let ids = sequences.iter().map(|s| s.id.clone()).zip(0..);
        let places: HashMap<String, usize> = ids.collect();
        let place = |key: &'static str, id: String| match places.get(&id) {
            Some(place) => Ok(*place),
            None => Err(DataError::UnknownSequence {
                path: dir.join(metadata::FILE),
                key,
                id,
            }),
        };
        for (id, starts) in metadata.touch_starts.unwrap_or_default() {
            sequences[place("touch_starts", id)?].touch_starts = starts;
        }
        for (id, tags) in metadata.sequence_tags.unwrap_or_default() {
            sequences[place("sequence_tags", id)?].tags = tags;
        }
        let plain = Self::new(robot, sequences);
        let dataset = Self {
            name: metadata.name.unwrap_or_else(|| folder_name(dir)),
            description: metadata.description.unwrap_or_default(),
            torque_kind: metadata.torque_kind.unwrap_or_default(),
            rate_hz: metadata.rate_hz,
            gravity: metadata.gravity.unwrap_or(plain.gravity),
            base_pose: metadata.base_pose.unwrap_or_default(),
            object_bbox: metadata.object_bbox,
            tare_samples: metadata.tare_samples.unwrap_or_default(),
            splits: metadata.splits.unwrap_or(plain.splits),
            joints: metadata.joints,
            joint_types: metadata.joint_types,
            attachment: metadata.attachment.unwrap_or_default(),
            gauge_length: metadata.gauge_length,
            made_by: metadata.made_by,
            contact: metadata.contact,
            rest_points: parts.rest_points,
            field: parts.field,
            camera: parts.camera,
            extra,
            ..plain
        };
        dataset.check_in(dir)?;
        let warnings = dataset.warnings(dir);
        Ok((dataset, warnings))
    }

    /// Writes the folder `dir`, and creates it if it does not exist. Time stamps are always written.
    ///
    /// Reading it back gives the same data set with bit-equal arrays. Only the poses, which are stored as 4x4 matrices, may
    /// differ in the last digit.
    ///
    /// All files are written or none, `dataset.json` last. An existing folder may be overwritten, but not if parts of
    /// another recording in it would then be read as parts of this one.
    ///
    /// # Errors
    /// - Data that [`open`](Self::open) would refuse.
    /// - [`DataError::Leftover`] for parts of another recording in the way.
    /// - [`DataError::Link`] for a link in the place of a file.
    /// - [`DataError::Io`] if the folder cannot be written.
    pub fn save(&self, dir: impl AsRef<Path>) -> Result<(), DataError> {
        self.save_with(dir, &[], &[])
    }

    /// [`save`](Self::save) with further files, such as those of the robot, given by their paths in the folder.
    ///
    /// They are written together with the recording or not at all. Files in `outdated` are removed if they exist and are
    /// not written, such as results computed from replaced sequences.
    ///
    /// # Errors
    /// As [`save`](Self::save).
    pub fn save_with(
        &self,
        dir: impl AsRef<Path>,
        files: &[(PathBuf, Vec<u8>)],
        outdated: &[PathBuf],
    ) -> Result<(), DataError> {
        let dir = dir.as_ref();
        self.check_in(dir)?;
        let mut staged = Staged::below(dir)?;
        self.check_leftovers(dir)?;
        for sequence in &self.sequences {
            sequence.stage(dir, &mut staged)?;
        }
        if let Some(points) = &self.rest_points {
            let bytes = npy::encode(&[points.len(), 3], &files::coordinates(points));
            staged.file(&dir.join(POINTS), &bytes)?;
        }
        if let Some(field) = &self.field {
            let path = dir.join(FIELD);
            staged.file(&path, &field.npz(&path)?)?;
        }
        if let Some(camera) = &self.camera {
            camera.stage(&dir.join(CAMERA), &mut staged)?;
        }
        for (name, bytes) in files {
            staged.file(&dir.join(name), bytes)?;
        }
        for name in outdated {
            staged.remove(&dir.join(name))?;
        }
        metadata::stage(dir, self.metadata(), &self.extra, &mut staged)?;
        staged.commit()
    }

    /// [`made_by`](Self::made_by) of the recording in the folder `dir`, even if writing it there was interrupted.
    ///
    /// `None` also if `dataset.json` cannot be read.
    pub fn maker(dir: impl AsRef<Path>) -> Option<String> {
        metadata::maker(dir.as_ref())
    }

    /// Whether a recording that a command made was edited since, for example by hand.
    ///
    /// `dataset.json` holds a digest of its values, of the arrays and of the robot's files. Other files in the folder do
    /// not count. A recording without a digest counts as edited.
    pub fn is_edited(dir: impl AsRef<Path>) -> bool {
        metadata::is_edited(dir.as_ref())
    }

    /// The training sequences, in the order of the split.
    pub fn train(&self) -> impl Iterator<Item = &Sequence> {
        self.of(&self.splits.train)
    }

    /// The test sequences, in the order of the split.
    pub fn test(&self) -> impl Iterator<Item = &Sequence> {
        self.of(&self.splits.test)
    }

    fn of<'a>(&'a self, ids: &'a [String]) -> impl Iterator<Item = &'a Sequence> {
        let all = self.sequences.iter().map(|s| (&*s.id, s));
        let by_id: HashMap<&str, &Sequence> = all.collect();
        ids.iter().filter_map(move |id| by_id.get(&**id).copied())
    }

    /// The sequence with this ID.
    pub fn sequence(&self, id: &str) -> Option<&Sequence> {
        self.sequences.iter().find(|s| s.id == id)
    }

    /// Number of joints `d`; 0 without sequences.
    pub fn width(&self) -> usize {
        self.sequences.first().map_or(0, Sequence::width)
    }

    /// The metadata as written to the file, without defaults.
    pub(crate) fn metadata(&self) -> Overrides {
        let by_id = |s: &Sequence| s.id.clone();
        let touch_starts: BTreeMap<_, _> = (self.sequences.iter())
            .filter(|s| s.touch_starts != [0])
            .map(|s| (by_id(s), s.touch_starts.clone()))
            .collect();
        let tags: BTreeMap<_, _> = (self.sequences.iter())
            .filter(|s| !s.tags.is_empty())
            .map(|s| (by_id(s), s.tags.clone()))
            .collect();
        Overrides {
            name: Some(self.name.clone()),
            description: Some(self.description.clone()),
            robot: Some(self.robot.clone()),
            torque_kind: Some(self.torque_kind),
            rate_hz: self.rate_hz,
            gravity: Some(self.gravity),
            base_pose: Some(self.base_pose),
            object_bbox: self.object_bbox,
            tare_samples: Some(self.tare_samples),
            splits: Some(self.splits.clone()),
            joints: self.joints.clone(),
            joint_types: self.joint_types.clone(),
            touch_starts: (!touch_starts.is_empty()).then_some(touch_starts),
            sequence_tags: (!tags.is_empty()).then_some(tags),
            attachment: Some(self.attachment),
            gauge_length: self.gauge_length,
            made_by: self.made_by.clone(),
            contact: self.contact.clone(),
        }
    }
}

/// Checks that the robot is given.
pub(crate) fn check_robot<'a>(
    dir: &Path,
    metadata: &'a Overrides,
) -> Result<&'a RobotRef, DataError> {
    metadata
        .robot
        .as_ref()
        .ok_or_else(|| DataError::MissingKey {
            path: dir.join(metadata::FILE),
            key: "robot",
            hint: "name a built-in robot such as kinova_gen3, or the path of a URDF",
        })
}

pub(crate) fn unknown_keys(path: PathBuf, extra: &BTreeMap<String, String>) -> Vec<DataWarning> {
    if extra.is_empty() {
        Vec::new()
    } else {
        vec![DataWarning::UnknownKeys {
            path,
            keys: extra.keys().cloned().collect(),
        }]
    }
}

fn folder_name(dir: &Path) -> String {
    let resolved = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let name = resolved.file_name().unwrap_or(resolved.as_os_str());
    name.to_string_lossy().into_owned()
}

/// IDs and folders of the sequences, in natural order: `seq_2` before `seq_10`.
fn sequence_ids(dir: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let ids = sequence_ids_or_none(dir)?;
    if ids.is_empty() {
        Err(DataError::NoSequences {
            path: dir.to_owned(),
        })
    } else {
        Ok(ids)
    }
}

pub(crate) fn sequence_ids_or_none(dir: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let mut ids = Vec::new();
    for path in files::list(dir)? {
        // A link that leads nowhere is a sequence that is missing, a plain file is none.
        if !path.is_dir() && path.exists() {
            continue;
        }
        let name = path.file_name().unwrap_or_default();
        let text = name.to_string_lossy();
        let Some(id) = text.strip_prefix(sequence::PREFIX) else {
            continue;
        };
        if id.is_empty() || name.to_str().is_none() {
            return Err(DataError::SequenceId {
                path: dir.to_owned(),
                id: id.to_owned(),
            });
        }
        ids.push((id.to_owned(), path));
    }
    ids.sort_by(|a, b| natural::compare(&a.0, &b.0));
    Ok(ids)
}

/// Arrays in the folders of sequences that the format does not know, for example with misspelled names.
fn other_arrays<'a>(
    folders: impl Iterator<Item = &'a PathBuf>,
) -> Result<Option<DataWarning>, DataError> {
    let mut found = Vec::new();
    for folder in folders {
        let is_other = |path: &PathBuf| {
            let name = path
                .file_name()
                .and_then(|n| n.to_str())
                .unwrap_or_default();
            let known = sequence::ARRAYS.contains(&name) || name == Sequence::DEVIATIONS;
            // Hidden ones are other programs'.
            name.to_lowercase().ends_with(".npy") && !known && !name.starts_with('.')
        };
        found.extend(files::list(folder)?.into_iter().filter(is_other));
    }
    let others = found.len().saturating_sub(1);
    let first = found.into_iter().next();
    Ok(first.map(|path| DataWarning::OtherArrays { path, others }))
}

/// The only stored field of a data set.
pub(crate) fn stored_field(dir: &Path) -> Result<Option<PathBuf>, DataError> {
    let mut fields = files::list(dir)?.into_iter().filter(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.ends_with(FIELD) || (!name.starts_with(sequence::PREFIX) && field::is_folder(path))
    });
    match (fields.next(), fields.next()) {
        (Some(first), Some(second)) => Err(DataError::AmbiguousField { first, second }),
        (first, _) => Ok(first),
    }
}

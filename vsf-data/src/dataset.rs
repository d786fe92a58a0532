use crate::metadata::{self, Attachment, JointType, Overrides, RobotRef, Splits, TorqueKind};
use crate::sequence::{self, Sequence};
use crate::{CameraView, DataError, DataWarning, StiffnessField};
use crate::{field, files, natural, npy, pose, signal};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

const POINTS: &str = "points.npy";
const FIELD: &str = "vsf.npz";
const CAMERA: &str = "camera";

/// How far outside `object_bbox` a point may lie without a warning [m]: rounding to f32.
const BOX_SLACK: f64 = 1e-6;

/// One recording campaign of one object: a folder of touch sequences with its metadata.
///
/// World frame z up, SI units, radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Name; the folder's name by default.
    pub name: String,
    /// Free text.
    pub description: String,
    /// The robot that touches.
    pub robot: RobotRef,
    /// Meaning of the torque columns.
    pub torque_kind: TorqueKind,
    /// Sample rate [Hz], positive; needed only for sequences without time stamps.
    pub rate_hz: Option<f64>,
    /// Gravity [m/s^2], world frame; default (0, 0, -9.81).
    pub gravity: Vector3<f64>,
    /// Pose of the robot's base in the world, `X_WB`; default identity.
    pub base_pose: Isometry3<f64>,
    /// Smallest and largest corner of the object's box [m], world frame.
    pub object_bbox: Option<[Point3<f64>; 2]>,
    /// Number of contact-free samples at the start of every sequence, which tare the torque
    /// sensor; see [`tare`](Self::tare).
    pub tare_samples: usize,
    /// Which sequences train and which test.
    pub splits: Splits,
    /// Joint names of the columns; `None`: the robot's chain order.
    pub joints: Option<Vec<String>>,
    /// Joint types of the columns; `None`: as the URDF says.
    pub joint_types: Option<Vec<JointType>>,
    /// How the object holds on to the robot.
    pub attachment: Attachment,
    /// Rest length of a clamped specimen [m], positive.
    pub gauge_length: Option<f64>,
    /// Rest positions `p_i` [m], world frame.
    pub rest_points: Option<Vec<Point3<f64>>>,
    /// A stored field: `vsf.npz`, or a folder with `points.npy` and `K.npy`.
    pub field: Option<StiffnessField>,
    /// One RGB-D view of the object before contact.
    pub camera: Option<CameraView>,
    /// The touch sequences, at least one; `seq_2` comes before `seq_10`.
    pub sequences: Vec<Sequence>,
    /// Keys of `dataset.json` that this version does not know, with their values as JSON text.
    /// They are written back by [`save`](Self::save).
    pub extra: BTreeMap<String, String>,
}

impl Dataset {
    /// Reads the folder `dir`. What `overrides` sets goes before what `dataset.json` says.
    ///
    /// Nothing is repaired, shortened or filled in: a folder that is not as the format says is an
    /// error. An ID in both splits is an error, as is an ID listed twice. `splits` that lists only
    /// one of `train` and `test` leaves the other empty; without `splits` every sequence trains.
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
        let (from_file, extra) = metadata::read(dir)?;
        let mut warnings = unknown_keys(dir.join(metadata::FILE), &extra);
        let metadata = overrides.clone().or(from_file);
        check_metadata(dir, &metadata)?;
        let Some(robot) = metadata.robot else {
            return Err(DataError::MissingKey {
                path: dir.join(metadata::FILE),
                key: "robot",
                hint: "name a built-in robot such as kinova_gen3, or the path of a URDF",
            });
        };
        let mut sequences = sequence_ids(dir)?
            .iter()
            .map(|(id, folder)| Sequence::load(folder, id, metadata.rate_hz))
            .collect::<Result<Vec<_>, _>>()?;
        for (id, starts) in metadata.touch_starts.unwrap_or_default() {
            named(&mut sequences, dir, "touch_starts", id)?.touch_starts = starts;
        }
        for (id, tags) in metadata.sequence_tags.unwrap_or_default() {
            named(&mut sequences, dir, "sequence_tags", id)?.tags = tags;
        }
        let points = dir.join(POINTS);
        let rest_points = match points.exists() {
            true => Some(files::points(&points, files::read_npy(&points)?)?),
            false => None,
        };
        let mut field = None;
        if let Some(path) = stored_field(dir)? {
            let (read, more) = StiffnessField::open(path)?;
            warnings.extend(more);
            field = Some(read);
        }
        let mut camera = None;
        if dir.join(CAMERA).is_dir() {
            let (read, more) = CameraView::open(dir.join(CAMERA))?;
            warnings.extend(more);
            camera = Some(read);
        }
        let dataset = Self {
            name: metadata.name.unwrap_or_else(|| folder_name(dir)),
            description: metadata.description.unwrap_or_default(),
            robot,
            torque_kind: metadata.torque_kind.unwrap_or_default(),
            rate_hz: metadata.rate_hz,
            gravity: metadata.gravity.unwrap_or(Vector3::new(0.0, 0.0, -9.81)),
            base_pose: metadata.base_pose.unwrap_or_default(),
            object_bbox: metadata.object_bbox,
            tare_samples: metadata.tare_samples.unwrap_or_default(),
            splits: metadata.splits.unwrap_or_else(|| Splits {
                train: sequences.iter().map(|s| s.id.clone()).collect(),
                test: Vec::new(),
            }),
            joints: metadata.joints,
            joint_types: metadata.joint_types,
            attachment: metadata.attachment.unwrap_or_default(),
            gauge_length: metadata.gauge_length,
            rest_points,
            field,
            camera,
            sequences,
            extra,
        };
        dataset.check(dir)?;
        warnings.extend(dataset.warnings(dir));
        Ok((dataset, warnings))
    }

    /// Writes the folder `dir`, creating it if need be. Reading it back gives the same data set
    /// with bit-equal arrays; only the poses, which go through a 4x4 matrix, may differ in the
    /// last digit. Time stamps are always written.
    ///
    /// Every file is replaced as a whole, `dataset.json` last, so that a killed process leaves
    /// whole files. A folder may be saved over, but not when parts of another recording in it
    /// would then be read as parts of this one.
    ///
    /// # Errors
    /// Data that [`open`](Self::open) would refuse, [`DataError::Leftover`] for parts of another
    /// recording in the way, [`DataError::Io`] when the folder cannot be written.
    pub fn save(&self, dir: impl AsRef<Path>) -> Result<(), DataError> {
        let dir = dir.as_ref();
        self.check(dir)?;
        files::create_folder(dir)?;
        self.check_leftovers(dir)?;
        for sequence in &self.sequences {
            sequence.save(dir)?;
        }
        if let Some(points) = &self.rest_points {
            let bytes = npy::encode(&[points.len(), 3], &files::coordinates(points));
            files::write(&dir.join(POINTS), &bytes)?;
        }
        if let Some(field) = &self.field {
            field.save_npz(dir.join(FIELD))?;
        }
        if let Some(camera) = &self.camera {
            camera.save(dir.join(CAMERA))?;
        }
        metadata::write(dir, self.metadata(), &self.extra)
    }

    /// The sequences to estimate from, in the order of the split.
    pub fn train(&self) -> impl Iterator<Item = &Sequence> {
        self.splits.train.iter().filter_map(|id| self.sequence(id))
    }

    /// The sequences to predict, in the order of the split.
    pub fn test(&self) -> impl Iterator<Item = &Sequence> {
        self.splits.test.iter().filter_map(|id| self.sequence(id))
    }

    /// The sequence with this ID.
    pub fn sequence(&self, id: &str) -> Option<&Sequence> {
        self.sequences.iter().find(|s| s.id == id)
    }

    /// Number of joints `d`; 0 without sequences.
    pub fn width(&self) -> usize {
        self.sequences.first().map_or(0, Sequence::width)
    }

    /// Subtracts from every torque column of every sequence its mean over the first
    /// [`tare_samples`](Self::tare_samples), and sets that number to 0, so that nothing is ever
    /// tared twice. Without tare samples nothing changes.
    ///
    /// For [`TorqueKind::Measured`] the mean holds gravity as well as the sensor's offset.
    ///
    /// # Errors
    /// [`DataError::Argument`] if a sequence is shorter; then no sequence is changed.
    pub fn tare(&mut self) -> Result<(), DataError> {
        if self.tare_samples == 0 {
            return Ok(());
        }
        let tared = self
            .sequences
            .iter()
            .map(|s| signal::tare(&s.torques, self.tare_samples))
            .collect::<Result<Vec<_>, _>>()?;
        for (sequence, torques) in self.sequences.iter_mut().zip(tared) {
            sequence.torques = torques;
        }
        self.tare_samples = 0;
        Ok(())
    }

    /// The metadata as the file holds it: defaults of the maps left out.
    fn metadata(&self) -> Overrides {
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
        }
    }

    /// Checks everything the format promises; names files below `dir`.
    fn check(&self, dir: &Path) -> Result<(), DataError> {
        let path = dir.join(metadata::FILE);
        check_metadata(dir, &self.metadata())?;
        if self.sequences.is_empty() {
            return Err(DataError::NoSequences {
                path: dir.to_owned(),
            });
        }
        let mut ids = BTreeSet::new();
        for sequence in &self.sequences {
            sequence.check(dir)?;
            if !ids.insert(&sequence.id) {
                return Err(duplicate(path, &sequence.id, "sequences"));
            }
            if self.tare_samples > sequence.len() {
                return Err(DataError::TareSamples {
                    path,
                    id: sequence.id.clone(),
                    tare_samples: self.tare_samples,
                    rows: sequence.len(),
                });
            }
            self.check_width(dir, sequence)?;
        }
        self.check_splits(path)?;
        if let Some(points) = &self.rest_points {
            files::check_points(&dir.join(POINTS), points)?;
        }
        if let Some(field) = &self.field {
            field.check(&dir.join(FIELD))?;
        }
        if let Some(camera) = &self.camera {
            camera.check(&dir.join(CAMERA))?;
        }
        Ok(())
    }

    fn check_width(&self, dir: &Path, sequence: &Sequence) -> Result<(), DataError> {
        let joints = self
            .joints
            .as_ref()
            .map(|j| (j.len(), "joints in dataset.json"));
        let types = self
            .joint_types
            .as_ref()
            .map(|t| (t.len(), "joint_types in dataset.json"));
        let (width, reason) = joints
            .or(types)
            .unwrap_or((self.width(), "the first sequence"));
        if sequence.width() == width {
            return Ok(());
        }
        Err(DataError::Shape {
            path: sequence.folder(dir).join("angles.npy"),
            got: vec![sequence.len(), sequence.width()],
            expected: format!("{width} columns, as {reason}"),
        })
    }

    fn check_splits(&self, path: PathBuf) -> Result<(), DataError> {
        let Splits { train, test } = &self.splits;
        if train.is_empty() && test.is_empty() {
            return Err(DataError::EmptySplit {
                path,
                split: "train",
            });
        }
        let mut listed = BTreeMap::new();
        for (split, ids) in [("train", train), ("test", test)] {
            for id in ids {
                if self.sequence(id).is_none() {
                    return Err(DataError::UnknownSequence {
                        path,
                        key: "splits",
                        id: id.clone(),
                    });
                }
                match listed.insert(id, split) {
                    None => {}
                    Some(before) if before == split => return Err(duplicate(path, id, split)),
                    Some(_) => return Err(duplicate(path, id, "splits train and test")),
                }
            }
        }
        Ok(())
    }

    fn warnings(&self, dir: &Path) -> Vec<DataWarning> {
        let mut warnings = Vec::new();
        if let (Some(points), Some([lo, hi])) = (&self.rest_points, &self.object_bbox) {
            let outside = |p: &&Point3<f64>| {
                (0..3).any(|k| p[k] < lo[k] - BOX_SLACK || p[k] > hi[k] + BOX_SLACK)
            };
            let count = points.iter().filter(outside).count();
            if count > 0 {
                warnings.push(DataWarning::PointsOutsideBox {
                    path: dir.join(POINTS),
                    count,
                    total: points.len(),
                });
            }
        }
        let Splits { train, test } = &self.splits;
        let used: BTreeSet<&String> = train.iter().chain(test).collect();
        let ids: Vec<String> = (self.sequences.iter())
            .map(|s| s.id.clone())
            .filter(|id| !used.contains(id))
            .collect();
        if !ids.is_empty() {
            warnings.push(DataWarning::UnassignedSequences {
                path: dir.join(metadata::FILE),
                ids,
            });
        }
        warnings
    }

    /// Files in `dir` that would be read with this data set but are not written by it.
    fn check_leftovers(&self, dir: &Path) -> Result<(), DataError> {
        let leftover = |path| Err(DataError::Leftover { path });
        for (id, folder) in sequence_ids_or_none(dir)? {
            let velocities = folder.join("velocities.npy");
            match self.sequence(&id) {
                None => return leftover(folder),
                Some(s) if s.velocities.is_none() && velocities.exists() => {
                    return leftover(velocities);
                }
                Some(_) => {}
            }
        }
        if self.rest_points.is_none() && dir.join(POINTS).exists() {
            return leftover(dir.join(POINTS));
        }
        if self.camera.is_none() && dir.join(CAMERA).exists() {
            return leftover(dir.join(CAMERA));
        }
        match stored_field(dir)? {
            Some(path) if self.field.is_none() || path != dir.join(FIELD) => leftover(path),
            _ => Ok(()),
        }
    }
}

/// Values that have the right type and still no meaning.
fn check_metadata(dir: &Path, metadata: &Overrides) -> Result<(), DataError> {
    let wrong = |key, problem: String| DataError::Metadata {
        path: dir.join(metadata::FILE),
        key,
        problem,
    };
    let positive = |key, value: Option<f64>| match value {
        Some(v) if !(v.is_finite() && v > 0.0) => {
            Err(wrong(key, format!("{v} must be positive and finite")))
        }
        _ => Ok(()),
    };
    positive("rate_hz", metadata.rate_hz)?;
    positive("gauge_length", metadata.gauge_length)?;
    if metadata.gravity.is_some_and(|g| !pose::is_finite(&g)) {
        return Err(wrong("gravity", "must be finite".to_owned()));
    }
    if let Some(base) = &metadata.base_pose {
        pose::check(base).map_err(|problem| wrong("base_pose", problem))?;
    }
    if let Some([lo, hi]) = &metadata.object_bbox
        && !(0..3).all(|k| lo[k].is_finite() && hi[k].is_finite() && lo[k] <= hi[k])
    {
        let problem = "must be [[xmin, ymin, zmin], [xmax, ymax, zmax]] with min <= max";
        return Err(wrong("object_bbox", problem.to_owned()));
    }
    if let Some(joints) = &metadata.joints {
        let mut seen = BTreeSet::new();
        if let Some(name) = joints.iter().find(|j| j.is_empty() || !seen.insert(*j)) {
            return Err(wrong(
                "joints",
                format!("{name:?} is empty or occurs twice"),
            ));
        }
        if let Some(types) = &metadata.joint_types
            && types.len() != joints.len()
        {
            let problem = format!("{} types for {} joints", types.len(), joints.len());
            return Err(wrong("joint_types", problem));
        }
    }
    Ok(())
}

fn duplicate(path: PathBuf, id: &str, place: &'static str) -> DataError {
    DataError::DuplicateSequence {
        path,
        id: id.to_owned(),
        place,
    }
}

pub(crate) fn unknown_keys(path: PathBuf, extra: &BTreeMap<String, String>) -> Vec<DataWarning> {
    match extra.is_empty() {
        true => Vec::new(),
        false => vec![DataWarning::UnknownKeys {
            path,
            keys: extra.keys().cloned().collect(),
        }],
    }
}

fn named<'a>(
    sequences: &'a mut [Sequence],
    dir: &Path,
    key: &'static str,
    id: String,
) -> Result<&'a mut Sequence, DataError> {
    match sequences.iter_mut().find(|s| s.id == id) {
        Some(sequence) => Ok(sequence),
        None => Err(DataError::UnknownSequence {
            path: dir.join(metadata::FILE),
            key,
            id,
        }),
    }
}

fn folder_name(dir: &Path) -> String {
    let resolved = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
    let name = resolved.file_name().unwrap_or(resolved.as_os_str());
    name.to_string_lossy().into_owned()
}

/// IDs and folders of the sequences, `seq_2` before `seq_10`.
fn sequence_ids(dir: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let ids = sequence_ids_or_none(dir)?;
    match ids.is_empty() {
        true => Err(DataError::NoSequences {
            path: dir.to_owned(),
        }),
        false => Ok(ids),
    }
}

fn sequence_ids_or_none(dir: &Path) -> Result<Vec<(String, PathBuf)>, DataError> {
    let mut ids = Vec::new();
    for path in files::list(dir)?.into_iter().filter(|p| p.is_dir()) {
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

/// The one stored field of a data set.
fn stored_field(dir: &Path) -> Result<Option<PathBuf>, DataError> {
    let mut fields = files::list(dir)?.into_iter().filter(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        path.ends_with(FIELD) || (!name.starts_with(sequence::PREFIX) && field::is_folder(path))
    });
    match (fields.next(), fields.next()) {
        (Some(first), Some(second)) => Err(DataError::AmbiguousField { first, second }),
        (first, _) => Ok(first),
    }
}

use crate::json::UniqueMap;
use crate::staged::{Staged, hidden_in};
use crate::{ContactParameters, DataError, edits, files, json, pose};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Name of the metadata file in a data set.
pub(crate) const FILE: &str = "dataset.json";

/// Meaning of the torque columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TorqueKind {
    /// `tau = sum_i J^T f_i`, with `f_i` the force of the environment on the robot and gravity already removed. The
    /// default.
    #[default]
    External,
    /// The actuator-side reading, `tau_meas = M(q) qdd + C(q, qd) qd + g(q) - tau_ext`.
    Measured,
}

/// Type of a joint, which determines the units of its columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum JointType {
    /// Angles \[rad\] and torques \[N m\].
    Revolute,
    /// Positions \[m\] and forces \[N\].
    Prismatic,
}

/// How the object is attached to the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Attachment {
    /// Contact only pushes. The default.
    #[default]
    Unilateral,
    /// A clamped specimen, which also pulls. The value is kept, but no model in this workspace uses it
    /// ([`DataWarning::ClampedSpecimen`](crate::DataWarning::ClampedSpecimen)).
    Bilateral,
}

/// Sequence IDs for training and for test. No ID occurs twice; IDs in neither list are unused.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Splits {
    /// IDs to estimate from.
    pub train: Vec<String>,
    /// IDs to predict.
    pub test: Vec<String>,
}

/// The robot of a recording.
///
/// This crate knows no robots: it keeps the name or finds the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotRef {
    /// The text in the metadata: the name of a built-in robot, or the path of a URDF.
    pub given: String,
    /// The URDF, if `given` is a path; `None` for a built-in robot.
    pub path: Option<PathBuf>,
}

impl RobotRef {
    /// Interprets `given` as the name of a built-in robot or as the path of a URDF relative to `base`.
    ///
    /// It is a path if it has a file extension or more than one component, or is `.` or `..`.
    ///
    /// # Errors
    /// [`DataError::RobotNotFound`] if it is empty, or a path at which there is no file; [`DataError::Io`] if that is a
    /// pipe or a device. Whether a built-in robot of that name exists is not checked here.
    ///
    /// ```
    /// use vsf_data::RobotRef;
    /// assert_eq!(RobotRef::resolve("kinova_gen3", ".".as_ref())?.path, None);
    /// assert!(RobotRef::resolve("no/such.urdf", ".".as_ref()).is_err());
    /// # Ok::<(), vsf_data::DataError>(())
    /// ```
    pub fn resolve(given: &str, base: &Path) -> Result<Self, DataError> {
        let as_path = Path::new(given);
        let is_path = as_path.extension().is_some()
            || given.contains(['/', '\\'])
            || matches!(given, "." | "..");
        let path = base.join(as_path);
        if is_path && path.exists() && !path.is_dir() {
            files::check_kind(&path)?;
        }
        if given.trim().is_empty() || (is_path && !path.is_file()) {
            return Err(DataError::RobotNotFound {
                given: given.to_owned(),
                path,
            });
        }
        Ok(Self {
            given: given.to_owned(),
            path: is_path.then_some(path),
        })
    }

    /// The text to write to a data set in `dir`: as given if it resolves from there to the same file, or to one that is
    /// written together with it; otherwise the absolute path.
    fn text_in(&self, dir: &Path, staged: &Staged) -> Result<String, DataError> {
        let Some(path) = &self.path else {
            return Ok(self.given.clone());
        };
        if *path == dir.join(&self.given) && staged.holds(path) {
            return Ok(self.given.clone());
        }
        let failed = |e| DataError::io("read", path, e);
        let file = path.canonicalize().map_err(failed)?;
        if dir
            .join(&self.given)
            .canonicalize()
            .is_ok_and(|p| p == file)
        {
            return Ok(self.given.clone());
        }
        let absolute = std::path::absolute(path).map_err(failed)?;
        match absolute.to_str() {
            Some(text) => Ok(text.to_owned()),
            None => Err(DataError::Metadata {
                path: dir.join(FILE),
                key: "robot",
                problem: format!("the path {} is not UTF-8", absolute.display()),
            }),
        }
    }
}

/// Metadata given by the caller, which take precedence over `dataset.json`.
///
/// What is `None` is taken from the file, or from the format's default. With `robot` and `rate_hz` set, a folder of OpenVSF
/// (no `dataset.json`, no `time.npy`) can be opened.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Overrides {
    /// Name of the data set; default the folder's name.
    pub name: Option<String>,
    /// Free text; default empty.
    pub description: Option<String>,
    /// The robot; required here or in the file.
    pub robot: Option<RobotRef>,
    /// Meaning of the torques; default external.
    pub torque_kind: Option<TorqueKind>,
    /// Sample rate \[Hz\], 1e-6 to 1e9; required for sequences without `time.npy`.
    pub rate_hz: Option<f64>,
    /// Gravity [m/s^2], world frame; default (0, 0, -9.81).
    pub gravity: Option<Vector3<f64>>,
    /// Pose of the robot's base in the world, `X_WB`; default identity, within ±1e6 m.
    pub base_pose: Option<Isometry3<f64>>,
    /// Smallest and largest corner of the object's box \[m\], world frame; default none.
    pub object_bbox: Option<[Point3<f64>; 2]>,
    /// Contact-free samples at the start of every sequence; default 0.
    pub tare_samples: Option<usize>,
    /// Training and test IDs; default all train.
    pub splits: Option<Splits>,
    /// Joint names of the columns; default the robot's chain order.
    pub joints: Option<Vec<String>>,
    /// Joint types of the columns; default from the URDF.
    pub joint_types: Option<Vec<JointType>>,
    /// Rows at which touches begin, by sequence ID; default row 0.
    pub touch_starts: Option<BTreeMap<String, Vec<usize>>>,
    /// Labels by sequence ID; default none.
    pub sequence_tags: Option<BTreeMap<String, Vec<String>>>,
    /// How the object is attached to the robot; default unilateral.
    pub attachment: Option<Attachment>,
    /// Rest length of a clamped specimen \[m\]; default none.
    pub gauge_length: Option<f64>,
    /// The command that has made the recording; default none.
    pub made_by: Option<String>,
    /// The contact parameters that the torques were computed with, the key `contact_parameters`; default none.
    pub contact: Option<ContactParameters>,
}

impl Overrides {
    /// Field by field: `self` if it is set, otherwise `other`.
    pub(crate) fn or(self, other: Self) -> Self {
        Self {
            name: self.name.or(other.name),
            description: self.description.or(other.description),
            robot: self.robot.or(other.robot),
            torque_kind: self.torque_kind.or(other.torque_kind),
            rate_hz: self.rate_hz.or(other.rate_hz),
            gravity: self.gravity.or(other.gravity),
            base_pose: self.base_pose.or(other.base_pose),
            object_bbox: self.object_bbox.or(other.object_bbox),
            tare_samples: self.tare_samples.or(other.tare_samples),
            splits: self.splits.or(other.splits),
            joints: self.joints.or(other.joints),
            joint_types: self.joint_types.or(other.joint_types),
            touch_starts: self.touch_starts.or(other.touch_starts),
            sequence_tags: self.sequence_tags.or(other.sequence_tags),
            attachment: self.attachment.or(other.attachment),
            gauge_length: self.gauge_length.or(other.gauge_length),
            made_by: self.made_by.or(other.made_by),
            contact: self.contact.or(other.contact),
        }
    }
}

/// `dataset.json` as written.
#[derive(Default, Serialize, Deserialize)]
#[serde(expecting = "an object with the keys of dataset.json")]
struct Raw {
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    description: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    torque_kind: Option<TorqueKind>,
    #[serde(skip_serializing_if = "Option::is_none")]
    rate_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gravity: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    base_pose: Option<pose::Rows4>,
    #[serde(skip_serializing_if = "Option::is_none")]
    object_bbox: Option<[[f64; 3]; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tare_samples: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    splits: Option<RawSplits>,
    #[serde(skip_serializing_if = "Option::is_none")]
    joints: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    joint_types: Option<Vec<JointType>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    touch_starts: Option<UniqueMap<Vec<usize>>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sequence_tags: Option<UniqueMap<Tags>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    attachment: Option<Attachment>,
    #[serde(skip_serializing_if = "Option::is_none")]
    gauge_length: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    made_by: Option<String>,
    #[serde(rename = "contact_parameters", skip_serializing_if = "Option::is_none")]
    contact: Option<ContactParameters>,
    /// Digest of the other values and files, in recordings that a command made.
    #[serde(skip_serializing_if = "Option::is_none")]
    digest: Option<String>,
    #[serde(flatten)]
    extra: Map<String, Value>,
}

/// A missing key is an empty split. A key that is present must list something.
#[derive(Serialize, Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "an object with lists of IDs: train, test"
)]
struct RawSplits {
    #[serde(skip_serializing_if = "Option::is_none")]
    train: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    test: Option<Vec<String>>,
}

impl RawSplits {
    fn read(self, path: &Path) -> Result<Splits, DataError> {
        let listed = |ids: Option<Vec<String>>, split| match ids {
            Some(ids) if ids.is_empty() => Err(DataError::EmptySplit {
                path: path.to_owned(),
                split,
            }),
            ids => Ok(ids.unwrap_or_default()),
        };
        Ok(Splits {
            train: listed(self.train, "train")?,
            test: listed(self.test, "test")?,
        })
    }

    fn write(splits: Splits) -> Self {
        let listed = |ids: Vec<String>| (!ids.is_empty()).then_some(ids);
        Self {
            train: listed(splits.train),
            test: listed(splits.test),
        }
    }
}

/// Labels, as a list or as an object of values. The latter is read as `key=value`.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "the tags of a sequence must be a list of strings or an object of strings, numbers and booleans"
)]
enum Tags {
    List(Vec<String>),
    Object(BTreeMap<String, TagValue>),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum TagValue {
    Text(String),
    Number(serde_json::Number),
    Bool(bool),
}

impl Tags {
    fn into_list(self) -> Vec<String> {
        let pair = |(key, value)| match value {
            TagValue::Text(v) => format!("{key}={v}"),
            TagValue::Number(v) => format!("{key}={v}"),
            TagValue::Bool(v) => format!("{key}={v}"),
        };
        match self {
            Self::List(list) => list,
            Self::Object(map) => map.into_iter().map(pair).collect(),
        }
    }
}

/// Reads `dataset.json` of the folder, if there is one, with the caller's values taking precedence. Also returns the keys
/// that it does not know.
pub(crate) fn read(
    dir: &Path,
    given: &Overrides,
) -> Result<(Overrides, BTreeMap<String, String>), DataError> {
    let path = dir.join(FILE);
    match files::read(&path) {
        Ok(bytes) => parse(&path, &bytes, dir, given),
        Err(DataError::Missing { .. }) => parse(&path, b"{}", dir, given),
        Err(e) => Err(e),
    }
}

/// The part of `dataset.json` that tells the origin of a recording.
#[derive(Deserialize)]
struct Origin {
    made_by: Option<String>,
}

impl Origin {
    fn read(path: &Path) -> Option<Self> {
        serde_json::from_slice(&files::read(path).ok()?).ok()
    }
}

/// Whether a process was killed while it replaced the recording in `dir`: its `dataset.json` then has a hidden name.
pub(crate) fn is_interrupted(dir: &Path) -> bool {
    let is_left = || hidden_in(dir).iter().any(|p| Origin::read(p).is_some());
    !files::is_there(&dir.join(FILE)) && is_left()
}

/// `made_by` of a recording, even if it is [interrupted](is_interrupted).
pub(crate) fn maker(dir: &Path) -> Option<String> {
    let path = dir.join(FILE);
    let paths = if files::is_there(&path) {
        vec![path]
    } else {
        hidden_in(dir)
    };
    paths.iter().find_map(|p| Origin::read(p)?.made_by)
}

/// Parses the bytes of `dataset.json`, with the caller's values taking precedence. Also returns the keys that it does not
/// know. `path` is for messages; a robot is looked for in `dir`.
pub(crate) fn parse(
    path: &Path,
    bytes: &[u8],
    dir: &Path,
    given: &Overrides,
) -> Result<(Overrides, BTreeMap<String, String>), DataError> {
    let raw: Raw = json::parse(path, bytes)?;
    let base_pose = raw.base_pose.map(|m| pose::from_rows(&m)).transpose();
    let metadata = Overrides {
        name: raw.name,
        description: raw.description,
        robot: match raw.robot {
            // A file that is not there any more is no harm when the caller names another.
            Some(text) if given.robot.is_none() => Some(RobotRef::resolve(&text, dir)?),
            _ => None,
        },
        torque_kind: raw.torque_kind,
        rate_hz: raw.rate_hz,
        gravity: raw.gravity.map(Vector3::from),
        base_pose: base_pose.map_err(|problem| DataError::Metadata {
            path: path.to_owned(),
            key: "base_pose",
            problem,
        })?,
        object_bbox: raw.object_bbox.map(|b| b.map(Point3::from)),
        tare_samples: raw.tare_samples,
        splits: raw.splits.map(|s| s.read(path)).transpose()?,
        joints: raw.joints,
        joint_types: raw.joint_types,
        touch_starts: raw.touch_starts.map(|m| m.0),
        sequence_tags: raw
            .sequence_tags
            .map(|m| m.0.into_iter().map(|(id, t)| (id, t.into_list())).collect()),
        attachment: raw.attachment,
        gauge_length: raw.gauge_length,
        made_by: raw.made_by,
        contact: raw.contact,
    };
    if let Some(contact) = &metadata.contact {
        contact.check_in(path)?;
    }
    Ok((given.clone().or(metadata), json::to_text(raw.extra)))
}

/// Writes `dataset.json` of the folder.
pub(crate) fn stage(
    dir: &Path,
    metadata: Overrides,
    extra: &BTreeMap<String, String>,
    staged: &mut Staged,
) -> Result<(), DataError> {
    let path = dir.join(FILE);
    let robot = match &metadata.robot {
        Some(robot) => robot.text_in(dir, staged)?,
        None => String::new(),
    };
    let mut raw = raw(&path, metadata, extra, &robot)?;
    if raw.made_by.is_some() {
        let digest = edits::digest(&json::encode(&path, &raw)?, staged.written());
        raw.digest = Some(digest.map_err(|e| json::failure(&path, &e))?);
    }
    staged.file(&path, &json::encode(&path, &raw)?)
}

/// Whether a recording was edited since a command wrote it.
pub(crate) fn is_edited(dir: &Path) -> bool {
    files::read(&dir.join(FILE)).is_ok_and(|bytes| !edits::is_as_written(dir, &bytes))
}

/// The bytes of `dataset.json` with this text for the robot; `path` is for messages.
pub(crate) fn encode(
    path: &Path,
    metadata: Overrides,
    extra: &BTreeMap<String, String>,
    robot: &str,
) -> Result<Vec<u8>, DataError> {
    json::encode(path, &raw(path, metadata, extra, robot)?)
}

fn raw(
    path: &Path,
    metadata: Overrides,
    extra: &BTreeMap<String, String>,
    robot: &str,
) -> Result<Raw, DataError> {
    Ok(Raw {
        name: metadata.name,
        description: metadata.description,
        robot: metadata.robot.map(|_| robot.to_owned()),
        torque_kind: metadata.torque_kind,
        rate_hz: metadata.rate_hz,
        gravity: metadata.gravity.map(Into::into),
        base_pose: metadata.base_pose.as_ref().map(pose::to_rows),
        object_bbox: metadata.object_bbox.map(|b| b.map(|p| p.coords.into())),
        tare_samples: metadata.tare_samples,
        splits: metadata.splits.map(RawSplits::write),
        joints: metadata.joints,
        joint_types: metadata.joint_types,
        touch_starts: metadata.touch_starts.map(UniqueMap),
        sequence_tags: metadata
            .sequence_tags
            .map(|m| UniqueMap(m.into_iter().map(|(id, t)| (id, Tags::List(t))).collect())),
        attachment: metadata.attachment,
        gauge_length: metadata.gauge_length,
        made_by: metadata.made_by,
        contact: metadata.contact,
        digest: None,
        extra: others(path, extra)?,
    })
}

/// Keys that the format does not know. Its own keys would occur twice in the file.
fn others(path: &Path, extra: &BTreeMap<String, String>) -> Result<Map<String, Value>, DataError> {
    let extra = json::from_text(path, extra)?;
    for key in extra.keys() {
        let alone = Map::from_iter([(key.clone(), Value::Null)]);
        let read: Raw = json::parse(path, &json::encode(path, &alone)?)?;
        if !read.extra.contains_key(key) {
            return Err(DataError::Argument {
                what: "extra",
                problem: format!("{key:?} is a key of the format itself; set what it stands for"),
            });
        }
    }
    Ok(extra)
}

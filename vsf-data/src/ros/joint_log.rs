use super::container::{self, Record, ZSTD, wrong};
use super::is_part;
use super::messages::{JointState, Version};
use super::topics::Topics;
use crate::{DataError, files, metadata, natural};
use nalgebra::Point3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// More bytes than this in one log are refused: compressed files can unpack to more than any memory.
const MOST: u64 = 4 << 30;

/// What a joint state, a name or an attachment takes beside its contents, in bytes.
const OVERHEAD: usize = 128;

/// Most lists of names: each message is compared with them.
const MOST_LISTS: usize = 1000;

/// Which time a joint state is taken to have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Clock {
    /// The stamp in its header: when the driver read the joints. The default.
    #[default]
    Header,
    /// When it was logged, delays of transport included; for drivers that do not stamp.
    Log,
}

/// The joint states of MCAP files, before it is known which joints make a recording.
///
/// Reads `sensor_msgs/JointState` as ROS 2 (CDR) and ROS 1 serialise it, from chunks with or without
/// zstd and lz4 compression; messages of other topics are passed over one by one. Files that
/// [`McapExport`](crate::McapExport) wrote also hold metadata, points, and the sequences with their
/// exact times.
///
/// ```no_run
/// use vsf_data::{Clock, JointLog, Overrides, RobotRef, TorqueKind};
/// # fn main() -> Result<(), vsf_data::DataError> {
/// let log = JointLog::open(&["bag_0.mcap"], None, Clock::Header)?;
/// let given = Overrides {
///     robot: Some(RobotRef::resolve("planar_arm", ".".as_ref())?),
///     torque_kind: Some(TorqueKind::Measured),
///     ..Overrides::default()
/// };
/// let joints = ["joint_1", "joint_2"].map(str::to_owned);
/// let (recording, warnings) = log.recording(&given, &joints, None)?;
/// recording.save("recording")?;
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct JointLog {
    /// The files, at least one, in the order in which they are read.
    pub(super) files: Vec<PathBuf>,
    pub(super) topic: String,
    /// The lists of names that occur: nearly always one.
    pub(super) names: Vec<Vec<String>>,
    pub(super) samples: Vec<Sample>,
    /// Parts of a recording that the messages do not hold, by their paths in its folder, in the order
    /// of the file.
    pub(super) parts: Vec<(String, Vec<u8>)>,
    /// Points in the place of those in the file.
    pub(super) points: Option<Vec<Point3<f64>>>,
    pub(super) clock: Clock,
    /// Bytes held so far, of joint states, names, topics and parts.
    held: u64,
}

/// A joint state and where it is from.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    /// Index of the file.
    pub file: usize,
    /// Which message of its topic in this file, from 0.
    pub message: u64,
    /// \[ns\]
    pub stamp: i64,
    /// Index of its list of names.
    pub names: usize,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

impl JointLog {
    /// Reads the joint states of a `topic`, by default of the only one, and of `/joint_states` in files
    /// that [`McapExport`](crate::McapExport) wrote. A folder stands for the
    /// `.mcap` files in it, as `ros2 bag record` leaves them, `bag_2` before `bag_10`; several files
    /// are read as one recording that was split.
    ///
    /// # Errors
    /// [`DataError::Mcap`] for a damaged file, no joint states, a topic of another type or
    /// serialisation, more than 4 GiB of all that is kept; [`DataError::Advised`] for several topics;
    /// [`DataError::Message`] for a message that cannot be read, and for more than 1000 different lists
    /// of names.
    pub fn open<P: AsRef<Path>>(
        paths: &[P],
        topic: Option<&str>,
        clock: Clock,
    ) -> Result<Self, DataError> {
        let mut files = Vec::new();
        for path in paths.iter().map(AsRef::as_ref) {
            match path.is_dir() {
                true => files.extend(bag(path)?),
                false => files.push(path.to_owned()),
            }
        }
        if files.is_empty() {
            return Err(DataError::Argument {
                what: "paths",
                problem: "no file".to_owned(),
            });
        }
        let mut log = Self {
            files: files.clone(),
            topic: String::new(),
            names: Vec::new(),
            samples: Vec::new(),
            parts: Vec::new(),
            points: None,
            clock,
            held: 0,
        };
        let mut topics = Topics::new(topic);
        for (file, path) in files.iter().enumerate() {
            log.read(file, path, &mut topics)?;
        }
        let exported = log.parts.iter().any(|(name, _)| name == metadata::FILE);
        match topics.done(exported) {
            Ok(topic) => log.topic = topic,
            Err((problem, None)) => return Err(log.wrong(problem)),
            Err((problem, Some(advice))) => return Err(log.wrong(problem).advise(advice)),
        }
        log.check_parts()?;
        Ok(log)
    }

    /// The topic of the joint states.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Without the velocities of the messages, as if none had been published.
    #[must_use]
    pub fn without_velocities(mut self) -> Self {
        self.samples.iter_mut().for_each(|s| s.velocity.clear());
        self
    }

    /// With these rest points of the object in the world frame \[m\], in the place of those in the file.
    #[must_use]
    pub fn with_points(mut self, points: Vec<Point3<f64>>) -> Self {
        self.points = Some(points);
        self
    }

    fn read(&mut self, file: usize, path: &Path, topics: &mut Topics) -> Result<(), DataError> {
        let whole = |problem| wrong(path, problem);
        topics.begin_file();
        let mut message = 0;
        container::read(path, |record| {
            match record {
                Record::Schema { header, data } => {
                    self.hold(topics.define(header, &data)).map_err(whole)?;
                }
                Record::Channel(channel) => self.hold(topics.open(channel)).map_err(whole)?,
                Record::Attachment { header, data, .. } if is_part(&header.name) => {
                    let size = OVERHEAD + header.name.len() + data.len();
                    self.hold(size).map_err(whole)?;
                    self.parts.push((header.name, data.into_owned()));
                }
                Record::Message { header, data } => {
                    let version = topics.version(header.channel_id);
                    let version = version.map_err(whole)?;
                    let Some(version) = version else {
                        return Ok(());
                    };
                    let time = match self.clock {
                        Clock::Header => None,
                        Clock::Log => Some(header.log_time),
                    };
                    let state = decode(&data, version, time);
                    let added = state.and_then(|state| self.push(file, message, state));
                    added.map_err(|problem| DataError::Message {
                        path: path.to_owned(),
                        topic: topics.chosen().to_owned(),
                        message,
                        problem,
                    })?;
                    message += 1;
                }
                _ => {}
            }
            Ok(())
        })
    }

    fn push(&mut self, file: usize, message: u64, state: JointState) -> Result<(), String> {
        let arrays = [&state.position, &state.velocity, &state.effort];
        self.hold(OVERHEAD + arrays.map(|a| 8 * a.len()).iter().sum::<usize>())?;
        let known = self.names.iter().position(|names| *names == state.name);
        let names = match known {
            Some(names) => names,
            None if self.names.len() == MOST_LISTS => {
                return Err(format!("more than {MOST_LISTS} different lists of names"));
            }
            None => {
                let sizes = state.name.iter().map(|name| OVERHEAD + name.len());
                self.hold(OVERHEAD + sizes.sum::<usize>())?;
                self.names.push(state.name);
                self.names.len() - 1
            }
        };
        self.samples.push(Sample {
            file,
            message,
            stamp: state.stamp,
            names,
            position: state.position,
            velocity: state.velocity,
            effort: state.effort,
        });
        Ok(())
    }

    /// Counts bytes that are kept.
    fn hold(&mut self, bytes: usize) -> Result<(), String> {
        self.held = self.held.saturating_add(bytes as u64);
        match self.held > MOST {
            true => {
                Err("there is more than the 4 GiB that fit; import a part of the files".to_owned())
            }
            false => Ok(()),
        }
    }

    /// What is wrong with the files as a whole.
    pub(super) fn wrong(&self, problem: String) -> DataError {
        wrong(&self.files[0], problem)
    }

    fn check_parts(&self) -> Result<(), DataError> {
        if self.files.len() > 1 && !self.parts.is_empty() {
            let problem = "one of the files holds a whole recording; read each of them alone";
            return Err(self.wrong(problem.to_owned()));
        }
        let mut seen = BTreeSet::new();
        match self.parts.iter().find(|(name, _)| !seen.insert(name)) {
            Some((name, _)) => Err(self.wrong(format!("{name} is attached twice"))),
            None => Ok(()),
        }
    }
}

/// The `.mcap` files in a folder.
fn bag(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut files = files::list(folder)?;
    let ends = |path: &PathBuf, end: &str| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().ends_with(end)
    };
    // What rosbag2 compressed is named when it is opened, unless it was unpacked already.
    let end = match files.iter().any(|path| ends(path, ".mcap")) {
        true => ".mcap",
        false => ".mcap.zstd",
    };
    files.retain(|path| ends(path, end));
    files.sort_by(|a, b| natural::compare(&a.to_string_lossy(), &b.to_string_lossy()));
    match files.is_empty() {
        true => Err(DataError::Missing {
            path: folder.join("*.mcap"),
            what: "file",
        }),
        false => Ok(files),
    }
}

/// A joint state, at the time of logging \[ns\] if that is given; its arrays have a number for each
/// name, or none.
fn decode(bytes: &[u8], version: Version, logged: Option<u64>) -> Result<JointState, String> {
    if version == Version::Two && bytes.starts_with(&ZSTD) {
        return Err(
            "compressed by rosbag2 (compression mode message); `ros2 bag convert` writes the bag without"
                .to_owned(),
        );
    }
    let mut state = JointState::decode(bytes, version)?;
    if let Some(time) = logged {
        let stamp = i64::try_from(time);
        state.stamp = stamp.map_err(|_| format!("it was logged at {time} ns"))?;
    }
    let arrays = [
        ("positions", &state.position),
        ("velocities", &state.velocity),
        ("efforts", &state.effort),
    ];
    let names = state.name.len();
    let odd = arrays
        .into_iter()
        .find(|(_, a)| !a.is_empty() && a.len() != names);
    match odd {
        Some((what, array)) => Err(format!("{} {what} of {names} joints", array.len())),
        None => Ok(state),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn log() -> JointLog {
        JointLog {
            files: vec!["a.mcap".into()],
            topic: String::new(),
            names: Vec::new(),
            samples: Vec::new(),
            parts: Vec::new(),
            points: None,
            clock: Clock::Header,
            held: 0,
        }
    }

    fn state(name: String) -> JointState {
        JointState {
            stamp: 0,
            name: vec![name],
            position: vec![0.0],
            velocity: vec![],
            effort: vec![0.0],
        }
    }

    #[test]
    fn what_is_kept_is_counted() {
        let mut log = log();
        log.push(0, 0, state("a".repeat(1000))).unwrap();
        let first = log.held;
        assert!(first > 1016);
        log.push(0, 1, state("a".repeat(1000))).unwrap();
        assert_eq!(log.held, first + OVERHEAD as u64 + 16);
        log.held = MOST - 500;
        log.push(0, 2, state("a".repeat(1000))).unwrap();
        let problem = log.push(0, 3, state("b".repeat(1000))).unwrap_err();
        assert!(problem.contains("more than the 4 GiB"), "{problem}");
    }

    #[test]
    fn lists_of_names_are_bounded() {
        let mut log = log();
        for k in 0..MOST_LISTS as u64 {
            log.push(0, k, state(k.to_string())).unwrap();
        }
        log.push(0, 0, state("7".to_owned())).unwrap();
        let problem = log.push(0, 0, state("x".to_owned())).unwrap_err();
        assert!(problem.contains("more than 1000 different"), "{problem}");
    }
}

use super::container::{self, Record, ZSTD, wrong};
use super::is_part;
use super::messages::{JointState, Version};
use super::topics::Topics;
use crate::csv_log::{Columns, Quantity, is_csv, numbered};
use crate::{DataError, Dataset, Sequence, files, metadata, natural};
use nalgebra::Point3;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Most bytes in one log. Compressed files can unpack to more than any memory.
const MOST: u64 = 4 << 30;

/// Size of a joint state, a name or an attachment beside its contents, in bytes.
const OVERHEAD: usize = 128;

/// Most different lists of names, since each message is compared with all of them.
const MOST_LISTS: usize = 1000;

/// The source of the time of a joint state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Clock {
    /// The stamp in its header: the time at which the driver read the joints. The default.
    #[default]
    Header,
    /// The time of logging, which includes transport delays; for drivers that set no stamp.
    Log,
}

/// The joint states of MCAP or CSV files, before it is decided which joints make a recording.
///
/// In MCAP files, `sensor_msgs/JointState` is read as serialized by ROS 2 (CDR) or ROS 1, in chunks with or without zstd
/// and lz4 compression. Messages of other topics are skipped one by one. Files that [`McapExport`](crate::McapExport) wrote
/// also hold metadata, points, and the sequences with their exact times.
///
/// CSV files (`.csv`, or `.tsv` with tabs) have one sample per line. The first line has the titles of the columns, in any
/// order: the time \[s\] (`time`, `t`, `timestamp` or `time_s`) and for each joint
///
/// | | words |
/// | --- | --- |
/// | position \[rad or m\] | `position`, `pos`, `q` |
/// | torque or force \[N m or N\] | `effort`, `torque`, `tau` |
/// | velocity \[rad/s or m/s\], which may be missing | `velocity`, `vel`, `dq`, `qd` |
///
/// before or after its name, separated by `_`, `.` or `/`: `q_elbow`, `elbow.position`. Joints may also be numbered in the
/// order of the robot, from 1 or, if there is a 0, from 0: `q1` or `q_1`, see [`names_of`](Self::names_of). All other
/// columns are ignored, and so is a `#` before titles. Times are read to the nanosecond.
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
    pub(super) source: Source,
    /// The different lists of names, nearly always one.
    pub(super) names: Vec<Vec<String>>,
    pub(super) samples: Vec<Sample>,
    /// Parts of a recording that the messages do not hold, by their paths in its folder, in the order of the file.
    pub(super) parts: Vec<(String, Vec<u8>)>,
    /// Points that replace those in the file.
    pub(super) points: Option<Vec<Point3<f64>>>,
    /// Number of bytes held so far: joint states, names, topics and parts.
    held: u64,
    /// Indices of the files whose last line is not terminated.
    pub(super) open_ended: Vec<usize>,
}

/// Kind of the files.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Source {
    Mcap {
        topic: String,
        clock: Clock,
    },
    /// The columns of each file.
    Csv(Vec<Columns>),
}

/// A joint state and its origin.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sample {
    /// Index of the file.
    pub file: usize,
    /// Index of the message in its topic in this file, from 0; for a CSV file the line, from 1.
    pub place: u64,
    /// Time stamp \[ns\].
    pub stamp: i64,
    /// Index of its list of names.
    pub names: usize,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub effort: Vec<f64>,
}

impl Sample {
    /// One number for each name, or none.
    pub fn of(&self, quantity: Quantity) -> &[f64] {
        match quantity {
            Quantity::Position => &self.position,
            Quantity::Velocity => &self.velocity,
            Quantity::Effort => &self.effort,
        }
    }
}

impl JointLog {
    /// Reads the joint states of a `topic`.
    ///
    /// The default is the only topic with joint states or, in files that [`McapExport`](crate::McapExport) wrote,
    /// `/joint_states`. A folder stands for the `.mcap` files in it, as recorded by `ros2 bag record`, in natural order
    /// (`bag_2` before `bag_10`). Several files are read as one recording that was split. Files named `.csv` or `.tsv` have
    /// neither topics nor a time of logging, and each of them begins a new sequence.
    ///
    /// # Errors
    /// - [`DataError::Mcap`] for a damaged file, no joint states, a topic of another type or serialization, or more than 4
    ///   GiB of data to keep.
    /// - [`DataError::Advised`] for several topics.
    /// - [`DataError::Message`] for a message that cannot be read, and for more than 1000 different lists of names.
    /// - [`DataError::Csv`] for columns without titles, without time or joints, or of which two are the same, and for CSV
    ///   files among others.
    /// - [`DataError::CsvLine`] for a line of another length.
    /// - [`DataError::CsvCell`] for a cell that is not a number.
    pub fn open<P: AsRef<Path>>(
        paths: &[P],
        topic: Option<&str>,
        clock: Clock,
    ) -> Result<Self, DataError> {
        let mut files = Vec::new();
        for path in paths.iter().map(AsRef::as_ref) {
            if path.is_dir() {
                files.extend(bag(path)?)
            } else {
                files.push(path.to_owned())
            }
        }
        if files.is_empty() {
            return Err(DataError::Argument {
                what: "paths",
                problem: "no file".to_owned(),
            });
        }
        let mut log = Self::unread(files.clone());
        let (texts, others): (Vec<&PathBuf>, Vec<&PathBuf>) = files.iter().partition(|f| is_csv(f));
        log.source = match (&texts[..], &others[..]) {
            ([], _) => log.read_bags(&files, topic, clock)?,
            (_, []) => log.read_texts(&files, topic, clock)?,
            ([text, ..], [other, ..]) => {
                return Err(DataError::Csv {
                    path: text.to_path_buf(),
                    problem: format!(
                        "given beside {}, which is not named .csv or .tsv; import MCAP and CSV files one kind at a time",
                        other.display()
                    ),
                });
            }
        };
        Ok(log)
    }

    /// A log of files whose samples are still to be read.
    fn unread(files: Vec<PathBuf>) -> Self {
        Self {
            files,
            source: Source::Csv(Vec::new()),
            names: Vec::new(),
            samples: Vec::new(),
            parts: Vec::new(),
            points: None,
            held: 0,
            open_ended: Vec::new(),
        }
    }

    /// The topic of the joint states; `None` for CSV files.
    pub fn topic(&self) -> Option<&str> {
        match &self.source {
            Source::Mcap { topic, .. } => Some(topic),
            Source::Csv(_) => None,
        }
    }

    /// The file of each sequence of [`recording`](Self::recording), in order.
    ///
    /// Empty for MCAP files, of which several may be one recording that was split.
    pub fn files_of(&self, recording: &Dataset) -> Vec<&Path> {
        if self.topic().is_some() {
            return Vec::new();
        }
        let mut begin = 0;
        let of = |sequence: &Sequence| {
            let sample = self.samples.get(begin)?;
            begin += sequence.len();
            Some(self.files[sample.file].as_path())
        };
        recording.sequences.iter().filter_map(of).collect()
    }

    /// Names in the files for the joints of a robot.
    ///
    /// They are numbers if the files are CSV files that name none of the joints but number as many; otherwise the given
    /// names.
    pub fn names_of(&self, joints: &[String]) -> Vec<String> {
        let is_named = || {
            self.names
                .iter()
                .flatten()
                .any(|name| joints.contains(name))
        };
        let numbers = match self.source {
            Source::Csv(_) if !is_named() => self
                .names
                .iter()
                .find_map(|names| numbered(names, joints.len())),
            _ => None,
        };
        numbers.unwrap_or_else(|| joints.to_vec())
    }

    /// Drops the velocities in the files, as if none had been recorded.
    #[must_use]
    pub fn without_velocities(mut self) -> Self {
        self.samples.iter_mut().for_each(|s| s.velocity.clear());
        self
    }

    /// Sets all torques to zero, for planned motions that were not executed.
    #[must_use]
    pub fn planned(mut self) -> Self {
        (self.samples.iter_mut()).for_each(|s| s.effort = vec![0.0; s.position.len()]);
        self
    }

    /// Sets the rest points of the object (world frame \[m\]) in place of those in the file.
    #[must_use]
    pub fn with_points(mut self, points: Vec<Point3<f64>>) -> Self {
        self.points = Some(points);
        self
    }

    fn read_bags(
        &mut self,
        files: &[PathBuf],
        topic: Option<&str>,
        clock: Clock,
    ) -> Result<Source, DataError> {
        let mut topics = Topics::new(topic);
        for (file, path) in files.iter().enumerate() {
            self.read_bag(file, path, &mut topics, clock)?;
        }
        let exported = self.parts.iter().any(|(name, _)| name == metadata::FILE);
        let topic = topics.done(exported).map_err(|(problem, advice)| {
            let error = wrong(&self.place(), problem);
            match advice {
                Some(advice) => error.advise(advice),
                None => error,
            }
        })?;
        self.check_parts()?;
        Ok(Source::Mcap { topic, clock })
    }

    fn read_bag(
        &mut self,
        file: usize,
        path: &Path,
        topics: &mut Topics,
        clock: Clock,
    ) -> Result<(), DataError> {
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
                    let time = match clock {
                        Clock::Header => None,
                        Clock::Log => Some(header.log_time),
                    };
                    let state = decode(&data, version, time);
                    let added = state.and_then(|state| {
                        let names = self.list(state.name)?;
                        self.push(Sample {
                            file,
                            place: message,
                            stamp: state.stamp,
                            names,
                            position: state.position,
                            velocity: state.velocity,
                            effort: state.effort,
                        })
                    });
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

    /// The index of a list of names; new lists are added.
    pub(super) fn list(&mut self, list: Vec<String>) -> Result<usize, String> {
        let known = self.names.iter().position(|names| *names == list);
        match known {
            Some(names) => Ok(names),
            None if self.names.len() == MOST_LISTS => {
                Err(format!("more than {MOST_LISTS} different lists of names"))
            }
            None => {
                let sizes = list.iter().map(|name| OVERHEAD + name.len());
                self.hold(OVERHEAD + sizes.sum::<usize>())?;
                self.names.push(list);
                Ok(self.names.len() - 1)
            }
        }
    }

    pub(super) fn push(&mut self, sample: Sample) -> Result<(), String> {
        let arrays = [&sample.position, &sample.velocity, &sample.effort];
        self.hold(OVERHEAD + arrays.map(|a| 8 * a.len()).iter().sum::<usize>())?;
        self.samples.push(sample);
        Ok(())
    }

    /// Counts bytes that are kept, and refuses too many.
    fn hold(&mut self, bytes: usize) -> Result<(), String> {
        self.held = self.held.saturating_add(bytes as u64);
        if self.held > MOST {
            Err("there is more than the 4 GiB that fit; import a part of the files".to_owned())
        } else {
            Ok(())
        }
    }

    /// A name for all files, for messages.
    pub(super) fn place(&self) -> PathBuf {
        let first = &self.files[0];
        match self.files.len() - 1 {
            0 => first.clone(),
            1 => PathBuf::from(format!("{} and 1 more file", first.display())),
            n => PathBuf::from(format!("{} and {n} more files", first.display())),
        }
    }

    /// An error of the files as a whole.
    pub(super) fn wrong(&self, problem: String) -> DataError {
        let path = self.place();
        match self.source {
            Source::Mcap { .. } => DataError::Mcap { path, problem },
            Source::Csv(_) => DataError::Csv { path, problem },
        }
    }

    fn check_parts(&self) -> Result<(), DataError> {
        if self.files.len() > 1 && !self.parts.is_empty() {
            let problem = "one of the files holds a whole recording; read each of them alone";
            return Err(wrong(&self.place(), problem));
        }
        let mut seen = BTreeSet::new();
        match self.parts.iter().find(|(name, _)| !seen.insert(name)) {
            Some((name, _)) => Err(wrong(&self.files[0], format!("{name} is attached twice"))),
            None => Ok(()),
        }
    }
}

/// The `.mcap` files in a folder.
fn bag(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut files = files::list(folder)?;
    let ends = |path: &PathBuf, end: &str| {
        let name = path.file_name().unwrap_or_default();
        (name.to_string_lossy().to_ascii_lowercase()).ends_with(end)
    };
    // What rosbag2 compressed is named when it is opened, unless it was unpacked already.
    let end = if files.iter().any(|path| ends(path, ".mcap")) {
        ".mcap"
    } else {
        ".mcap.zstd"
    };
    let what = if files.iter().any(|path| is_csv(path)) {
        "file; CSV files are given one by one"
    } else {
        "file"
    };
    files.retain(|path| ends(path, end));
    files.sort_by(|a, b| natural::compare(&a.to_string_lossy(), &b.to_string_lossy()));
    if files.is_empty() {
        Err(DataError::Missing {
            path: folder.join("*.mcap"),
            what,
        })
    } else {
        Ok(files)
    }
}

/// Decodes a joint state, with the time of logging \[ns\] if it is given. Its arrays have one number per name, or none.
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

    fn add(log: &mut JointLog, name: String) -> Result<(), String> {
        let names = log.list(vec![name])?;
        log.push(Sample {
            file: 0,
            place: 0,
            stamp: 0,
            names,
            position: vec![0.0],
            velocity: vec![],
            effort: vec![0.0],
        })
    }

    #[test]
    fn what_is_kept_is_counted() {
        let mut log = JointLog::unread(Vec::new());
        add(&mut log, "a".repeat(1000)).unwrap();
        let first = log.held;
        assert!(first > 1016);
        add(&mut log, "a".repeat(1000)).unwrap();
        assert_eq!(log.held, first + OVERHEAD as u64 + 16);
        log.held = MOST - 500;
        add(&mut log, "a".repeat(1000)).unwrap();
        let problem = add(&mut log, "b".repeat(1000)).unwrap_err();
        assert!(problem.contains("more than the 4 GiB"), "{problem}");
    }

    #[test]
    fn lists_of_names_are_bounded() {
        let mut log = JointLog::unread(Vec::new());
        for k in 0..MOST_LISTS as u64 {
            add(&mut log, k.to_string()).unwrap();
        }
        add(&mut log, "7".to_owned()).unwrap();
        let problem = add(&mut log, "x".to_owned()).unwrap_err();
        assert!(problem.contains("more than 1000 different"), "{problem}");
    }
}

use super::messages::{JointState, Version, defines_joint_states};
use super::{is_part, records};
use crate::{DataError, files, natural};
use mcap::records::Record;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};

/// More numbers than this in one log are refused: compressed files can unpack to more than any memory.
const MOST: usize = 1 << 29;

/// What a joint state takes beside its numbers, in numbers.
const OVERHEAD: usize = 16;

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
    /// Numbers held so far.
    held: usize,
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
    /// Reads the joint states of a `topic`, by default of the only one. A folder stands for the
    /// `.mcap` files in it, as `ros2 bag record` leaves them, `bag_2` before `bag_10`; several files
    /// are read as one recording that was split.
    ///
    /// # Errors
    /// [`DataError::Mcap`] for a damaged file, no joint states, several topics of them, a topic of
    /// another type or serialisation; [`DataError::Message`] for a message that cannot be read.
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
            topic: topic.unwrap_or_default().to_owned(),
            names: Vec::new(),
            samples: Vec::new(),
            parts: Vec::new(),
            held: 0,
        };
        let mut topics = Topics::default();
        for (file, path) in files.iter().enumerate() {
            log.read(file, path, topic, clock, &mut topics)?;
        }
        if let Some(problem) = topics.problem(topic) {
            return Err(log.wrong(problem));
        }
        log.check_parts()?;
        Ok(log)
    }

    /// The topic of the joint states.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    fn read(
        &mut self,
        file: usize,
        path: &Path,
        topic: Option<&str>,
        clock: Clock,
        topics: &mut Topics,
    ) -> Result<(), DataError> {
        // IDs are those of one file.
        topics.schemas.clear();
        topics.channels.clear();
        let mut message = 0;
        records::read(path, |record| match record {
            Record::Schema { header, data } => {
                let schema = Schema {
                    name: header.name,
                    encoding: header.encoding,
                    is_known: defines_joint_states(&data),
                };
                topics.schemas.insert(header.id, schema);
                Ok(())
            }
            Record::Channel(channel) => {
                topics.open(channel);
                Ok(())
            }
            Record::Attachment { header, data, .. } => {
                if is_part(&header.name) {
                    self.parts.push((header.name, data.into_owned()));
                }
                Ok(())
            }
            Record::Message { header, data } => {
                let Some(channel) = topics.channels.get(&header.channel_id) else {
                    let problem = format!(
                        "a message is of channel {}, which is not defined",
                        header.channel_id
                    );
                    return Err(DataError::Mcap {
                        path: path.to_owned(),
                        problem,
                    });
                };
                let Some(version) = channel.version else {
                    return Ok(());
                };
                let is_new = topics.heard.insert(channel.topic.clone());
                if topic.is_none() && is_new && topics.heard.len() == 1 {
                    self.topic = channel.topic.clone();
                }
                if channel.topic != self.topic {
                    return Ok(());
                }
                let problem = |problem| DataError::Message {
                    path: path.to_owned(),
                    topic: channel.topic.clone(),
                    message,
                    problem,
                };
                let mut state = JointState::decode(&data, version).map_err(problem)?;
                if clock == Clock::Log {
                    let stamp = i64::try_from(header.log_time);
                    let late = |_| problem(format!("it was logged at {} ns", header.log_time));
                    state.stamp = stamp.map_err(late)?;
                }
                check_lengths(&state).map_err(problem)?;
                self.held += OVERHEAD
                    + [&state.position, &state.velocity, &state.effort]
                        .map(Vec::len)
                        .iter()
                        .sum::<usize>();
                if self.held > MOST {
                    return Err(problem(
                        "there are more numbers than a recording may have; import a part"
                            .to_owned(),
                    ));
                }
                self.push(file, message, state);
                message += 1;
                Ok(())
            }
            _ => Ok(()),
        })
    }

    fn push(&mut self, file: usize, message: u64, state: JointState) {
        let known = self.names.iter().position(|names| *names == state.name);
        let names = known.unwrap_or_else(|| {
            self.names.push(state.name);
            self.names.len() - 1
        });
        self.samples.push(Sample {
            file,
            message,
            stamp: state.stamp,
            names,
            position: state.position,
            velocity: state.velocity,
            effort: state.effort,
        });
    }

    /// What is wrong with the files as a whole.
    pub(super) fn wrong(&self, problem: String) -> DataError {
        DataError::Mcap {
            path: self.files[0].clone(),
            problem,
        }
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
    files.retain(|path| path.extension().is_some_and(|e| e == "mcap"));
    files.sort_by(|a, b| natural::compare(&a.to_string_lossy(), &b.to_string_lossy()));
    match files.is_empty() {
        true => Err(DataError::Missing {
            path: folder.join("*.mcap"),
            what: "file",
        }),
        false => Ok(files),
    }
}

/// Arrays have a number for each name, or none.
fn check_lengths(state: &JointState) -> Result<(), String> {
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
        None => Ok(()),
    }
}

/// What the files say about their topics.
#[derive(Default)]
struct Topics {
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, Channel>,
    /// Types and serialisations by topic.
    all: BTreeMap<String, String>,
    /// Topics that have joint states.
    heard: BTreeSet<String>,
}

struct Schema {
    name: String,
    encoding: String,
    /// Whether the layout is that of joint states, should it be called one.
    is_known: bool,
}

struct Channel {
    topic: String,
    /// How its joint states are serialised; `None` for anything else.
    version: Option<Version>,
}

impl Topics {
    fn open(&mut self, channel: mcap::records::Channel) {
        let (mut version, mut text) = (None, "no type".to_owned());
        if let Some(schema) = self.schemas.get(&channel.schema_id) {
            let encoding = &channel.message_encoding;
            version = Version::of_joint_states(&schema.name, &schema.encoding, encoding);
            text = format!("{} in {encoding}", schema.name);
            if !schema.is_known && version.take().is_some() {
                text += ", defined in another way than by ROS";
            }
        }
        self.all.insert(channel.topic.clone(), text);
        let topic = channel.topic;
        self.channels.insert(channel.id, Channel { topic, version });
    }

    /// What keeps the files from having the joint states of a topic, by default of one alone.
    fn problem(&self, topic: Option<&str>) -> Option<String> {
        let heard: Vec<&str> = self.heard.iter().map(String::as_str).collect();
        let others = || match heard.is_empty() {
            false => format!("there are joint states on {}", some(&heard)),
            true => {
                let all = self
                    .all
                    .iter()
                    .map(|(topic, kind)| format!("{topic} ({kind})"));
                let all: Vec<String> = all.collect();
                format!("there is {}", some(&all))
            }
        };
        match (topic, &heard[..]) {
            (None, [_]) => None,
            (None, []) => Some(format!(
                "no messages of sensor_msgs/JointState; {}",
                others()
            )),
            (None, _) => Some(format!(
                "joint states on several topics, {}; give the topic of one",
                some(&heard)
            )),
            (Some(topic), heard) if heard.contains(&topic) => None,
            (Some(topic), _) => Some(match self.all.get(topic) {
                Some(kind) => format!(
                    "topic {topic} ({kind}) has no messages of sensor_msgs/JointState; {}",
                    others()
                ),
                None => format!("no topic {topic}; {}", others()),
            }),
        }
    }
}

/// Names for a message, the first of them where there are many.
pub(super) fn some<T: AsRef<str>>(names: &[T]) -> String {
    const MOST: usize = 20;
    if names.is_empty() {
        return "nothing".to_owned();
    }
    let shown: Vec<&str> = names.iter().take(MOST).map(AsRef::as_ref).collect();
    let rest = if names.len() > MOST { ", ..." } else { "" };
    shown.join(", ") + rest
}

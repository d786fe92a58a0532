use super::RECORDED;
use super::container::{self, SchemaHeader};
use super::messages::{Version, defines_joint_states};
use crate::{Advice, listed};
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Size of a type or channel beside its texts, in bytes.
const OVERHEAD: usize = 256;

/// The topics of the files, and the one that is read.
#[derive(Default)]
pub(super) struct Topics {
    /// The requested topic.
    wanted: Option<String>,
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, Channel>,
    /// Types and serializations by topic.
    all: BTreeMap<String, String>,
    /// Topics with joint states, and the first of them.
    heard: BTreeSet<String>,
    first: Option<String>,
}

#[derive(PartialEq)]
struct Schema {
    name: String,
    encoding: String,
    /// Whether the layout is that of joint states, if the type is named so.
    is_known: bool,
}

#[derive(PartialEq)]
struct Channel {
    topic: String,
    /// Serialization of its joint states; `None` for anything else.
    version: Option<Version>,
}

impl Topics {
    pub fn new(wanted: Option<&str>) -> Self {
        Self {
            wanted: wanted.map(str::to_owned),
            ..Self::default()
        }
    }

    /// Begins a file: IDs are valid within one file.
    pub fn begin_file(&mut self) {
        self.schemas.clear();
        self.channels.clear();
    }

    /// Registers a type. Returns the number of bytes kept, 0 if it is known.
    pub fn define(&mut self, header: SchemaHeader, definition: &[u8]) -> usize {
        let schema = Schema {
            name: header.name,
            encoding: header.encoding,
            is_known: defines_joint_states(definition),
        };
        if self.schemas.get(&header.id) == Some(&schema) {
            return 0;
        }
        let size = OVERHEAD + schema.name.len() + schema.encoding.len();
        self.schemas.insert(header.id, schema);
        size
    }

    /// Registers a channel. Returns the number of bytes kept, 0 if it is known.
    pub fn open(&mut self, channel: container::Channel) -> usize {
        let (mut version, mut text) = (None, "no type".to_owned());
        if let Some(schema) = self.schemas.get(&channel.schema_id) {
            let encoding = &channel.message_encoding;
            version = Version::of_joint_states(&schema.name, &schema.encoding, encoding);
            text = format!("{} in {encoding}", schema.name);
            if !schema.is_known && version.take().is_some() {
                text += ", defined in another way than by ROS";
            }
        }
        let (id, topic) = (channel.id, channel.topic);
        let channel = Channel { topic, version };
        if self.channels.get(&id) == Some(&channel) && self.all.get(&channel.topic) == Some(&text) {
            return 0;
        }
        // Also of those that have joint states.
        let size = OVERHEAD + 3 * channel.topic.len() + text.len();
        self.all.insert(channel.topic.clone(), text);
        self.channels.insert(id, channel);
        size
    }

    /// The serialization of a message on this channel, if it is a joint state of the chosen topic.
    pub fn version(&mut self, channel: u16) -> Result<Option<Version>, String> {
        let Some(Channel { topic, version }) = self.channels.get(&channel) else {
            return Err(format!(
                "a message is of channel {channel}, which is not defined"
            ));
        };
        if version.is_none() {
            return Ok(None);
        }
        if !self.heard.contains(topic) {
            self.first.get_or_insert_with(|| topic.clone());
            self.heard.insert(topic.clone());
        }
        Ok(version.filter(|_| topic == self.chosen()))
    }

    /// The requested topic, or the first one with joint states.
    pub fn chosen(&self) -> &str {
        let topic = self.wanted.as_ref().or(self.first.as_ref());
        topic.map_or("", |t| t)
    }

    /// The topic of the joint states, or why there is none. `exported` says whether [`McapExport`](crate::McapExport) wrote
    /// the files; it puts predictions on other topics.
    pub fn done(self, exported: bool) -> Result<String, (String, Option<Advice>)> {
        if exported && self.wanted.is_none() && self.chosen() == RECORDED {
            return Ok(RECORDED.to_owned());
        }
        let heard: Vec<String> = self.heard.into_iter().collect();
        let others = match &heard[..] {
            [] => {
                let all = self.all.iter();
                let all: Vec<String> = all
                    .map(|(topic, kind)| format!("{topic} ({kind})"))
                    .collect();
                format!("there is {}", listed(&all))
            }
            heard => format!("there are joint states on {}", listed(heard)),
        };
        match (self.wanted, &heard[..]) {
            (None, [only]) => Ok(only.clone()),
            (None, []) => {
                let problem = format!("no messages of sensor_msgs/JointState; {others}");
                Err((problem, None))
            }
            (None, heard) => {
                let problem = format!("joint states on several topics, {}", listed(heard));
                Err((problem, Some(Advice::Topic)))
            }
            (Some(topic), heard) if heard.contains(&topic) => Ok(topic),
            (Some(topic), _) => {
                let problem = match self.all.get(&topic) {
                    Some(kind) => format!(
                        "topic {topic} ({kind}) has no messages of sensor_msgs/JointState; {others}"
                    ),
                    None => format!("no topic {topic}; {others}"),
                };
                Err((problem, None))
            }
        }
    }
}

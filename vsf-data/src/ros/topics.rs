use super::container::{self, SchemaHeader};
use super::messages::{Version, defines_joint_states};
use std::collections::{BTreeMap, HashMap};

/// What the files say about their topics, and which one is listened to.
#[derive(Default)]
pub(super) struct Topics {
    /// The one asked for.
    wanted: Option<String>,
    schemas: HashMap<u16, Schema>,
    channels: HashMap<u16, Channel>,
    /// Types and serialisations by topic.
    all: BTreeMap<String, String>,
    /// Topics that have joint states.
    heard: Vec<String>,
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
    pub fn new(wanted: Option<&str>) -> Self {
        Self {
            wanted: wanted.map(str::to_owned),
            ..Self::default()
        }
    }

    /// IDs are those of one file.
    pub fn begin_file(&mut self) {
        self.schemas.clear();
        self.channels.clear();
    }

    pub fn define(&mut self, header: SchemaHeader, definition: &[u8]) {
        let schema = Schema {
            name: header.name,
            encoding: header.encoding,
            is_known: defines_joint_states(definition),
        };
        self.schemas.insert(header.id, schema);
    }

    pub fn open(&mut self, channel: container::Channel) {
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

    /// How a message of this channel is serialised, if it is a joint state of the chosen topic.
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
            self.heard.push(topic.clone());
        }
        Ok(version.filter(|_| topic == self.chosen()))
    }

    /// The topic asked for, or the first one with joint states.
    pub fn chosen(&self) -> &str {
        let first = || self.heard.first();
        self.wanted.as_ref().or_else(first).map_or("", |t| t)
    }

    /// The topic of the joint states, or what keeps the files from having one.
    pub fn done(mut self) -> Result<String, String> {
        self.heard.sort();
        let others = match &self.heard[..] {
            [] => {
                let all = self.all.iter();
                let all: Vec<String> = all
                    .map(|(topic, kind)| format!("{topic} ({kind})"))
                    .collect();
                format!("there is {}", some(&all))
            }
            heard => format!("there are joint states on {}", some(heard)),
        };
        match (self.wanted, &self.heard[..]) {
            (None, [only]) => Ok(only.clone()),
            (None, []) => Err(format!("no messages of sensor_msgs/JointState; {others}")),
            (None, heard) => Err(format!(
                "joint states on several topics, {}; give the topic of one",
                some(heard)
            )),
            (Some(topic), heard) if heard.contains(&topic) => Ok(topic),
            (Some(topic), _) => Err(match self.all.get(&topic) {
                Some(kind) => format!(
                    "topic {topic} ({kind}) has no messages of sensor_msgs/JointState; {others}"
                ),
                None => format!("no topic {topic}; {others}"),
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

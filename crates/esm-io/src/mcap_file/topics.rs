//! Which topics a recording has, and which of them hold clouds and motion.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::definitions::ChannelInfo;
use super::stream::{MessageStream, Wanted};
use super::summary;
use crate::error::Error;

/// A topic of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name, such as `/velodyne_points`.
    pub name: String,
    /// Its message type, such as `sensor_msgs/msg/PointCloud2`.
    pub message_type: String,
    /// Number of messages (intact ones where the recording is damaged).
    pub messages: u64,
}

/// The message types that are read, best source of motion first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum MessageKind {
    Cloud,
    Odometry,
    PoseStamped,
    Transforms,
    /// Taken when asked for only: usually a localizer's answer, not a robot's motion.
    PoseWithCovariance,
}

impl MessageKind {
    pub(crate) fn of(schema: &str) -> Option<Self> {
        // ROS 2 writes pkg/msg/Type, some converters pkg/Type.
        Some(match schema.replace("/msg/", "/").as_str() {
            "sensor_msgs/PointCloud2" => Self::Cloud,
            "nav_msgs/Odometry" => Self::Odometry,
            "geometry_msgs/PoseStamped" => Self::PoseStamped,
            "geometry_msgs/PoseWithCovarianceStamped" => Self::PoseWithCovariance,
            "tf2_msgs/TFMessage" => Self::Transforms,
            _ => return None,
        })
    }

    fn name(self) -> &'static str {
        match self {
            Self::Cloud => "sensor_msgs/msg/PointCloud2",
            Self::Odometry => "nav_msgs/msg/Odometry",
            Self::PoseStamped => "geometry_msgs/msg/PoseStamped",
            Self::Transforms => "tf2_msgs/msg/TFMessage",
            Self::PoseWithCovariance => "geometry_msgs/msg/PoseWithCovarianceStamped",
        }
    }
}

/// The channels of a recording, grouped by topic.
pub(crate) struct TopicTable {
    path: std::path::PathBuf,
    pub(crate) channels: BTreeMap<u16, ChannelInfo>,
    /// Messages by channel: as the statistics say, or as counted.
    counts: BTreeMap<u16, u64>,
    /// Whether the statistics say so.
    pub(crate) has_statistics: bool,
    /// The first definition that was left out: its place, and why.
    left_out: Option<(String, String)>,
}

impl TopicTable {
    /// Reads the summary where it is good; else goes through the file once, counting what is intact.
    pub(crate) fn read(path: &Path) -> Result<Self, Error> {
        let mut scan = MessageStream::open(path, Wanted::Nothing)?;
        if let Some(summary) = summary::read(path)? {
            let (channels, counts) = (summary.channels, summary.counts);
            return Ok(Self {
                path: path.to_owned(),
                channels,
                counts,
                has_statistics: true,
                left_out: None,
            });
        }
        while scan.next_message()?.is_some() {}
        if let (true, Some((place, what))) = (scan.channels().is_empty(), scan.left_out()) {
            let hint = "record or convert it with shorter names of topics and message types";
            return Err(Error::malformed(path, place.as_str(), what.as_str(), hint));
        }
        if scan.channels().is_empty() {
            let place = scan.first_damage().unwrap_or("the data section").to_owned();
            return Err(Error::malformed(
                path,
                place,
                "no intact message is left in the recording",
                "copy the recording again from where it was made; 'mcap recover' may help",
            ));
        }
        let (channels, counts) = (scan.channels().clone(), scan.counts().clone());
        Ok(Self {
            path: path.to_owned(),
            channels,
            counts,
            has_statistics: false,
            left_out: scan.left_out().cloned(),
        })
    }

    /// The statistics' counts by channel.
    pub(crate) fn expected(&self) -> Option<&BTreeMap<u16, u64>> {
        self.has_statistics.then_some(&self.counts)
    }

    /// All topics by name.
    pub(crate) fn topics(&self) -> Vec<Topic> {
        let mut topics: BTreeMap<&str, Topic> = BTreeMap::new();
        for (id, channel) in &self.channels {
            let topic = topics.entry(&channel.topic).or_insert_with(|| Topic {
                name: channel.topic.clone(),
                message_type: channel.schema.clone(),
                messages: 0,
            });
            topic.messages += self.counts.get(id).copied().unwrap_or(0);
        }
        topics.into_values().collect()
    }

    /// The channels that carry a topic.
    pub(crate) fn ids(&self, topic: &str) -> BTreeSet<u16> {
        self.channels.iter().filter(|(_, c)| c.topic == topic).map(|(id, _)| *id).collect()
    }

    /// The topics with messages of a kind.
    fn of_kind(&self, kind: MessageKind) -> Vec<Topic> {
        let with = |t: &Topic| t.messages > 0 && MessageKind::of(&t.message_type) == Some(kind);
        self.topics().into_iter().filter(with).collect()
    }

    /// The transforms that never change, by convention of name.
    pub(crate) fn fixed_transforms(&self) -> BTreeSet<u16> {
        let is = |c: &ChannelInfo| {
            MessageKind::of(&c.schema) == Some(MessageKind::Transforms)
                && is_static(&c.topic)
                && c.encoding == "cdr"
        };
        self.channels.iter().filter(|(_, c)| is(c)).map(|(id, _)| *id).collect()
    }

    /// The topic of the clouds: the one asked for, or the only one.
    pub(crate) fn choose_cloud(&self, asked: Option<&str>) -> Result<Topic, Error> {
        if let Some(name) = asked {
            return self.asked(name, &[MessageKind::Cloud], "--cloud-topic").map(|(t, _)| t);
        }
        let candidates = self.of_kind(MessageKind::Cloud);
        match candidates.as_slice() {
            [one] => self.asked(&one.name.clone(), &[MessageKind::Cloud], "--cloud-topic").map(|(t, _)| t),
            [] => Err(self.no_clouds()),
            _ => Err(self.ambiguous("clouds", &candidates, "--cloud-topic")),
        }
    }

    /// The topic of the motion: the one asked for, or the only one of the best kind there is.
    pub(crate) fn choose_motion(&self, asked: Option<&str>) -> Result<Option<(Topic, MessageKind)>, Error> {
        const ACCEPTED: [MessageKind; 4] = [
            MessageKind::Odometry,
            MessageKind::PoseStamped,
            MessageKind::Transforms,
            MessageKind::PoseWithCovariance,
        ];
        const FLAG: &str = "--odometry-topic";
        if let Some(name) = asked {
            return self.asked(name, &ACCEPTED, FLAG).map(Some);
        }
        for kind in &ACCEPTED[..3] {
            let mut candidates = self.of_kind(*kind);
            candidates.retain(|t| !is_static(&t.name));
            match candidates.as_slice() {
                [] => {}
                [one] => return self.asked(&one.name.clone(), &[*kind], FLAG).map(Some),
                _ => return Err(self.ambiguous("motion", &candidates, FLAG)),
            }
        }
        Ok(None)
    }

    fn asked(&self, name: &str, kinds: &[MessageKind], flag: &str) -> Result<(Topic, MessageKind), Error> {
        let topics = self.topics();
        let Some(topic) = topics.iter().find(|t| t.name == name) else {
            let what = format!("there is no topic {name}; the topics are {}", list(&topics));
            return Err(self.topic_error(what, &topics, format!("name one of them with {flag}")));
        };
        let Some(kind) = MessageKind::of(&topic.message_type).filter(|k| kinds.contains(k)) else {
            let names: Vec<&str> = kinds.iter().map(|k| k.name()).collect();
            let what = format!("the topic {name} holds {}, not {}", topic.message_type, names.join(" or "));
            return Err(self.topic_error(what, &topics, format!("name another topic with {flag}")));
        };
        if let Some(channel) = self.channels.values().find(|c| c.topic == name && c.encoding != "cdr") {
            let what = format!("the topic {name} is encoded as '{}', not as ROS 2's cdr", channel.encoding);
            return Err(self.topic_error(
                what,
                &topics,
                "convert the recording to ROS 2 messages".to_owned(),
            ));
        }
        Ok((topic.clone(), kind))
    }

    fn no_clouds(&self) -> Error {
        let topics = self.topics();
        let what = match topics.iter().find(|t| MessageKind::of(&t.message_type) == Some(MessageKind::Cloud))
        {
            Some(empty) => format!("the cloud topic {} holds no message", empty.name),
            None => format!("no topic holds {}; the topics are {}", MessageKind::Cloud.name(), list(&topics)),
        };
        self.topic_error(what, &topics, "record the lidar's PointCloud2 topic".to_owned())
    }

    fn ambiguous(&self, what: &str, candidates: &[Topic], flag: &str) -> Error {
        let what = format!("{} topics hold {what}: {}", candidates.len(), list(candidates));
        self.topic_error(what, candidates, format!("name one of them with {flag}"))
    }

    fn topic_error(&self, mut what: String, topics: &[Topic], hint: String) -> Error {
        if let Some((place, why)) = &self.left_out {
            what.push_str(&format!("; {place} was left out: {why}"));
        }
        let candidates = topics.iter().map(|t| t.name.clone()).collect();
        Error::Topic { path: self.path.clone(), what, candidates, hint }
    }
}

fn is_static(topic: &str) -> bool {
    topic.ends_with("tf_static")
}

fn list(topics: &[Topic]) -> String {
    if topics.is_empty() {
        return "none".to_owned();
    }
    let each = topics.iter().map(|t| format!("{} ({}, {} messages)", t.name, t.message_type, t.messages));
    each.collect::<Vec<_>>().join(", ")
}

//! An MCAP file as a recording.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::motion::{Answer, Kind, Motion, MotionState};
use super::poses::SweepPoses;
use super::{NamedPoses, OpenOptions, Sweep, Warning};
use crate::error::Error;
use crate::mcap_file::{Damage, MessageKind, MessageStream, Topic, TopicTable, Wanted};
use crate::pose::seconds;
use crate::ros::point_cloud2::{self, Extras};

/// How long a sweep waits for the motion after it, nanoseconds of the file's own clock: odometry that a filter publishes
/// late is late by well under a second.
const MOTION_WAIT_NS: u64 = 3_000_000_000;

/// Most sweeps that wait at once, 3 s of a 20 Hz lidar, and most points in them, 240 MB. They bound the memory.
const MAX_WAITING: usize = 60;
const MAX_WAITING_POINTS: usize = 20_000_000;

#[derive(Debug)]
pub(super) struct McapSource {
    path: PathBuf,
    table: TopicTable,
    cloud: Topic,
    motion: Option<(Topic, MessageKind)>,
    poses: Option<(PathBuf, SweepPoses)>,
    extras: Extras,
}

impl McapSource {
    pub(super) fn open(path: &Path, options: &OpenOptions, poses: NamedPoses) -> Result<Self, Error> {
        let table = TopicTable::read(path)?;
        let cloud = table.choose_cloud(options.cloud_topic.as_deref())?;
        let motion = match &poses {
            Some(_) => None,
            None => table.choose_motion(options.motion_topic.as_deref())?,
        };
        let sweeps = cloud.messages as usize;
        let poses = poses
            .map(|(file, poses)| SweepPoses::for_recording(poses, &file, sweeps).map(|p| (file, p)))
            .transpose()?;
        let extras = Extras { labels: options.labels, rings: options.rings };
        Ok(Self { path: path.to_owned(), table, cloud, motion, poses, extras })
    }

    pub(super) fn topics(&self) -> Vec<Topic> {
        self.table.topics()
    }

    pub(super) fn cloud_topic(&self) -> &str {
        &self.cloud.name
    }

    pub(super) fn motion_topic(&self) -> Option<&str> {
        self.motion.as_ref().map(|(topic, _)| topic.name.as_str())
    }

    pub(super) fn has_motion(&self) -> bool {
        self.motion.is_some() || self.poses.is_some()
    }

    pub(super) fn sweep_count(&self) -> usize {
        self.cloud.messages as usize
    }

    pub(super) fn sweeps(&self) -> Result<McapSweeps, Error> {
        let cloud_ids = self.table.ids(&self.cloud.name);
        let motion_ids = self.motion.as_ref().map(|(t, _)| self.table.ids(&t.name)).unwrap_or_default();
        let fixed_ids = match &self.motion {
            Some((_, kind)) if *kind != MessageKind::PoseStamped => self.table.fixed_transforms(),
            _ => BTreeSet::new(),
        };
        let wanted = cloud_ids.iter().chain(&motion_ids).chain(&fixed_ids).copied().collect();
        let mut stream = MessageStream::open(&self.path, Wanted::Channels(wanted))?;
        stream.know_channels(self.table.channels.clone());
        let (motion, motion_name) = match (&self.motion, &self.poses) {
            (_, Some((file, poses))) => (Motion::File(poses.clone()), file.display().to_string()),
            (Some((topic, kind)), None) => (MotionState::topic(*kind), topic.name.clone()),
            (None, None) => (Motion::None, String::new()),
        };
        Ok(McapSweeps {
            path: self.path.clone(),
            stream,
            expected: self.table.expected().cloned(),
            motion: MotionState::new(motion, !fixed_ids.is_empty()),
            cloud_name: self.cloud.name.clone(),
            extras: self.extras,
            motion_name,
            cloud_ids,
            motion_ids,
            fixed_ids,
            waiting: VecDeque::new(),
            log_time: 0,
            ended: false,
            read: 0,
            seen: BTreeMap::new(),
            refused_cloud: None,
            without: 0,
            span_ns: None,
        })
    }
}

impl std::fmt::Debug for TopicTable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TopicTable").field("topics", &self.topics()).finish()
    }
}

struct Waiting {
    log_time: u64,
    /// Its place among the clouds of the file from 0, those counted that were refused.
    index: usize,
    sweep: Sweep,
}

pub(super) struct McapSweeps {
    path: PathBuf,
    stream: MessageStream,
    expected: Option<BTreeMap<u16, u64>>,
    motion: MotionState,
    cloud_name: String,
    /// Whether points' labels are read too.
    extras: Extras,
    motion_name: String,
    cloud_ids: BTreeSet<u16>,
    motion_ids: BTreeSet<u16>,
    fixed_ids: BTreeSet<u16>,
    /// Sweeps that wait for the motion after them.
    waiting: VecDeque<Waiting>,
    /// Latest log time.
    log_time: u64,
    ended: bool,
    /// Intact clouds.
    read: usize,
    /// Messages by topic, also those that contradict themselves.
    seen: BTreeMap<String, usize>,
    /// The first cloud that contradicts itself.
    refused_cloud: Option<(String, String)>,
    without: usize,
    span_ns: Option<(i64, i64)>,
}

impl McapSweeps {
    pub(super) fn next_sweep(&mut self) -> Result<Option<Sweep>, Error> {
        loop {
            if let Some(sweep) = self.release()? {
                return Ok(Some(sweep));
            }
            if self.ended {
                return Ok(None);
            }
            match self.stream.next_message()? {
                Some(message) => self.take(message.channel, message.log_time),
                None => self.ended = true,
            }
        }
    }

    /// The first waiting sweep, once its motion is known or will not be.
    fn release(&mut self) -> Result<Option<Sweep>, Error> {
        let Some(Waiting { log_time, index, sweep }) = self.waiting.front() else { return Ok(None) };
        let overdue = self.ended
            || self.waiting.len() > MAX_WAITING
            || self.waiting.iter().map(|w| w.sweep.cloud.len()).sum::<usize>() > MAX_WAITING_POINTS
            || self.log_time.saturating_sub(*log_time) > MOTION_WAIT_NS;
        let (index, stamp_ns) = (*index, sweep.stamp_ns);
        let mut answer = self.motion.ask(index, stamp_ns, &sweep.frame_id, overdue);
        // The motion may stand farther back in the file, or have come long before and been dropped.
        let elsewhere = (overdue && !self.ended) || self.motion.overran();
        if matches!(answer, Answer::Unknown) && elsewhere && !self.motion.whole {
            let sensor = sweep.frame_id.clone();
            self.gather(&sensor)?;
            answer = self.motion.ask(index, stamp_ns, &sensor, true);
        }
        let pose = match answer {
            Answer::Wait => return Ok(None),
            Answer::Known(pose) => Some(pose),
            Answer::Unknown => None,
        };
        let Some(Waiting { mut sweep, .. }) = self.waiting.pop_front() else { return Ok(None) };
        sweep.pose_odom_sensor = pose;
        self.without += usize::from(pose.is_none());
        let (a, b) = self.span_ns.unwrap_or((sweep.stamp_ns, sweep.stamp_ns));
        self.span_ns = Some((a.min(sweep.stamp_ns), b.max(sweep.stamp_ns)));
        self.motion.forget_before(sweep.stamp_ns);
        Ok(Some(sweep))
    }

    /// Reads the whole file for its motion: sweeps wait for it in vain.
    fn gather(&mut self, sensor: &str) -> Result<(), Error> {
        let Self { path, stream, motion, motion_ids, fixed_ids, .. } = self;
        motion.gather(sensor, |each| {
            let wanted = motion_ids.union(fixed_ids).copied().collect();
            let mut again = MessageStream::open(path, Wanted::Channels(wanted))?;
            again.know_channels(stream.channels().clone());
            while let Some(message) = again.next_message()? {
                let is_motion = motion_ids.contains(&message.channel);
                each(if is_motion { Kind::Moving } else { Kind::Fixed }, again.data());
            }
            Ok(())
        })
    }

    fn take(&mut self, channel: u16, log_time: u64) {
        self.log_time = self.log_time.max(log_time);
        let data = self.stream.data();
        let is_cloud = self.cloud_ids.contains(&channel);
        let taken = if is_cloud {
            let index = self.seen.get(&self.cloud_name).copied().unwrap_or(0);
            point_cloud2::decode(data, self.extras).map(|cloud| {
                self.read += 1;
                let sweep = Sweep {
                    number: self.read,
                    stamp: seconds(cloud.header.stamp_ns),
                    stamp_ns: cloud.header.stamp_ns,
                    cloud: cloud.cloud,
                    pose_odom_sensor: None,
                    frame_id: cloud.header.frame_id,
                    dropped: cloud.dropped,
                    labels: cloud.labels,
                    rings: cloud.rings,
                };
                self.waiting.push_back(Waiting { log_time, index, sweep });
            })
        } else if self.motion_ids.contains(&channel) {
            self.motion.take(data)
        } else {
            self.motion.take_fixed(data)
        };
        let topic = self.stream.channels().get(&channel).map(|c| c.topic.clone()).unwrap_or_default();
        let seen = self.seen.entry(topic.clone()).or_default();
        *seen += 1;
        if let Err(what) = taken {
            let place = format!("message {seen} of {topic}");
            self.stream.refuse(channel, format!("{place} contradicts itself: {what}"));
            if is_cloud && self.refused_cloud.is_none() {
                self.refused_cloud = Some((place, what));
            }
        }
    }

    /// For a recording of which no cloud is left: the first that contradicts itself.
    pub(super) fn refused_cloud(&self) -> Option<Error> {
        let hint = "the program that recorded this wrote a message that contradicts itself; record or convert it anew";
        let (place, what) = self.refused_cloud.as_ref()?;
        Some(Error::malformed(&self.path, place.as_str(), what.as_str(), hint))
    }

    pub(super) fn first_damage(&self) -> Option<&str> {
        self.stream.first_damage()
    }

    fn damage(&self) -> Option<Damage> {
        self.stream.damage(self.expected.as_ref(), &|channel| self.cloud_ids.contains(&channel))
    }

    /// At the end: what was not as it should be.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let path = &self.path;
        let mut warnings = Vec::new();
        if let Some(damage) = self.damage() {
            warnings.push(Warning::Damaged { path: path.clone(), damage });
        }
        if self.motion.invalid > 0 {
            let (topic, messages) = (self.motion_name.clone(), self.motion.invalid);
            warnings.push(Warning::InvalidMotion { path: path.clone(), topic, messages });
        }
        if let Some((body, sensor)) = self.motion.assumed.clone() {
            warnings.push(Warning::AssumedMounting { path: path.clone(), body, sensor });
        }
        if let (Some(sweep_span_ns), false) = (self.span_ns, self.motion_name.is_empty())
            && self.without > 0
        {
            warnings.push(Warning::NoMotion {
                path: path.clone(),
                without: self.without,
                sweeps: self.read,
                source: self.motion_name.clone(),
                sweep_span_ns,
                motion_span_ns: self.motion.span_ns,
                out_of_order: self.motion.whole && self.motion.overran(),
            });
        }
        warnings
    }
}

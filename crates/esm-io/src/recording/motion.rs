//! The sensor's motion while an MCAP is read: from messages as they come, or from a file of poses.

use esm_core::Pose;

use super::poses::SweepPoses;
use crate::mcap_file::MessageKind;
use crate::pose::Track;
use crate::ros::frames::FrameTree;
use crate::ros::motion::{RosPose, decode_odometry, decode_pose_stamped, decode_tf};

/// Odometry samples kept: 1000 s at 100 Hz, 10 MB.
const TRACK_LIMIT: usize = 100_000;

/// Samples kept where the motion is not in time order with the clouds and all of it is gathered first: 28 h at 100 Hz,
/// 640 MB.
const WHOLE_LIMIT: usize = 10_000_000;

/// Where poses come from.
pub(super) enum Motion {
    None,
    File(SweepPoses),
    /// One topic that tells poses of one frame.
    Topic {
        kind: MessageKind,
        track: Track,
        body: String,
    },
    /// The tree of frames of `/tf`.
    Tree,
}

/// What a message is for.
pub(super) enum Kind {
    Moving,
    Fixed,
}

/// The answer to "where was this sensor then?".
pub(super) enum Answer {
    Known(Pose),
    Unknown,
    /// A message that is still to come may tell.
    Wait,
}

/// Motion and mounting of the sensor.
pub(super) struct MotionState {
    pub(super) motion: Motion,
    /// Fixed transforms, and moving ones where they are the source.
    pub(super) tree: FrameTree,
    /// Whether `/tf_static` is recorded and has not come yet.
    pub(super) awaits_fixed: bool,
    /// Messages without a valid pose.
    pub(super) invalid: usize,
    /// First and last stamp of the motion so far, nanoseconds.
    pub(super) span_ns: Option<(i64, i64)>,
    /// The body and sensor frames that nothing connects.
    pub(super) assumed: Option<(String, String)>,
    /// The whole motion is known: messages that come are checked only.
    pub(super) whole: bool,
}

impl MotionState {
    pub(super) fn new(motion: Motion, awaits_fixed: bool) -> Self {
        let span_ns = match &motion {
            Motion::File(poses) => poses.span(),
            _ => None,
        };
        Self {
            motion,
            tree: FrameTree::default(),
            awaits_fixed,
            invalid: 0,
            span_ns,
            assumed: None,
            whole: false,
        }
    }

    pub(super) fn topic(kind: MessageKind) -> Motion {
        match kind {
            MessageKind::Transforms => Motion::Tree,
            _ => Motion::Topic { kind, track: Track::new(TRACK_LIMIT), body: String::new() },
        }
    }

    /// Takes a message of `/tf_static`.
    pub(super) fn take_fixed(&mut self, message: &[u8]) -> Result<(), String> {
        decode_tf(message)?.into_iter().for_each(|t| self.tree.add_fixed(t));
        self.awaits_fixed = false;
        Ok(())
    }

    /// Takes a message of the motion's topic.
    pub(super) fn take(&mut self, message: &[u8]) -> Result<(), String> {
        match &mut self.motion {
            Motion::Tree => {
                for transform in decode_tf(message)? {
                    self.invalid += usize::from(transform.pose.is_none());
                    if self.whole {
                        continue;
                    }
                    extend(&mut self.span_ns, transform.header.stamp_ns);
                    self.tree.add_moving(transform);
                }
            }
            Motion::Topic { kind, track, body } => {
                let sample = decode_one(*kind, message)?;
                match sample.pose {
                    Some(_) if self.whole => {}
                    Some(pose) => {
                        track.push(sample.header.stamp_ns, pose);
                        extend(&mut self.span_ns, sample.header.stamp_ns);
                        *body = sample.child;
                    }
                    None => self.invalid += 1,
                }
            }
            Motion::None | Motion::File(_) => {}
        }
        Ok(())
    }

    /// Where the sensor is at a time. With `last_call` there is no more waiting.
    pub(super) fn ask(&mut self, index: usize, stamp_ns: i64, sensor: &str, last_call: bool) -> Answer {
        let pose = match &self.motion {
            Motion::None => None,
            Motion::File(poses) => poses.at(index, stamp_ns),
            Motion::Tree => {
                if !last_call && (self.awaits_fixed || !self.tree.reaches(sensor, stamp_ns)) {
                    return Answer::Wait;
                }
                self.tree.motion_at(sensor, stamp_ns)
            }
            Motion::Topic { track, body, .. } => {
                if !last_call && !track.reaches(stamp_ns) {
                    return Answer::Wait;
                }
                let mounted = if body.is_empty() || sensor.is_empty() || body == sensor {
                    Some(Pose::identity())
                } else {
                    self.tree.fixed_between(body, sensor)
                };
                if mounted.is_none() && self.awaits_fixed && !last_call {
                    return Answer::Wait;
                }
                let pose_odom_body = track.at(stamp_ns);
                if mounted.is_none() && pose_odom_body.is_some() && self.assumed.is_none() {
                    self.assumed = Some((body.clone(), sensor.to_owned()));
                }
                pose_odom_body.map(|p| p * mounted.unwrap_or_default())
            }
        };
        pose.map_or(Answer::Unknown, Answer::Known)
    }

    /// Whether samples were dropped because there were too many.
    pub(super) fn overran(&self) -> bool {
        match &self.motion {
            Motion::Topic { track, .. } => track.overran(),
            Motion::Tree => self.tree.overran(),
            Motion::None | Motion::File(_) => false,
        }
    }

    /// Gathers the whole motion, for messages that are not in time order with the clouds: `messages` hands every
    /// message of the motion's topic and of `/tf_static` to what it is given, from the file's start.
    pub(super) fn gather<E>(
        &mut self,
        sensor: &str,
        mut messages: impl FnMut(&mut dyn FnMut(Kind, &[u8])) -> Result<(), E>,
    ) -> Result<(), E> {
        // What cannot be decoded is counted where the recording is read.
        let mut all = Self::new(Motion::None, false);
        match &self.motion {
            Motion::None | Motion::File(_) => return Ok(()),
            Motion::Topic { kind, .. } => {
                let (mut track, mut body) = (Track::new(WHOLE_LIMIT), String::new());
                messages(&mut |of, message| match of {
                    Kind::Fixed => drop(all.take_fixed(message)),
                    Kind::Moving => {
                        if let Ok(RosPose { header, child, pose: Some(pose) }) = decode_one(*kind, message) {
                            track.append(header.stamp_ns, pose);
                            extend(&mut all.span_ns, header.stamp_ns);
                            body = child;
                        }
                    }
                })?;
                track.settle();
                all.motion = Motion::Topic { kind: *kind, track, body };
            }
            Motion::Tree => {
                all.motion = Motion::Tree;
                let each = |of: Kind, message: &[u8], all: &mut Self| match of {
                    Kind::Fixed => drop(all.take_fixed(message)),
                    Kind::Moving => drop(all.take(message)),
                };
                // Once for which frames carry the sensor, once for their motion.
                messages(&mut |of, message| each(of, message, &mut all))?;
                all.tree = all.tree.gathering(sensor, WHOLE_LIMIT);
                messages(&mut |of, message| each(of, message, &mut all))?;
                all.tree.settle();
            }
        }
        *self = Self { invalid: self.invalid, assumed: self.assumed.take(), whole: true, ..all };
        Ok(())
    }

    /// Drops what sweeps from this time on do not need.
    pub(super) fn forget_before(&mut self, stamp_ns: i64) {
        match &mut self.motion {
            _ if self.whole => {}
            Motion::Topic { track, .. } => track.forget_before(stamp_ns),
            Motion::Tree => self.tree.forget_before(stamp_ns),
            Motion::None | Motion::File(_) => {}
        }
    }
}

fn decode_one(kind: MessageKind, message: &[u8]) -> Result<RosPose, String> {
    match kind {
        MessageKind::Odometry => decode_odometry(message),
        _ => decode_pose_stamped(message),
    }
}

fn extend(span: &mut Option<(i64, i64)>, stamp_ns: i64) {
    let (a, b) = span.unwrap_or((stamp_ns, stamp_ns));
    *span = Some((a.min(stamp_ns), b.max(stamp_ns)));
}

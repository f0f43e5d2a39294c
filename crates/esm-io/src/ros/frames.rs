//! The tree of frames that `/tf` and `/tf_static` describe.

use std::collections::BTreeMap;

use esm_core::Pose;

use super::motion::RosPose;
use crate::pose::Track;

/// Deepest chain of frames followed: a loop ends here.
const MAX_DEPTH: usize = 64;

/// Most frames kept.
const MAX_FRAMES: usize = 512;

/// Samples kept for each moving frame: 20 s at 100 Hz.
const TRACK_LIMIT: usize = 2048;

/// Where each frame stands in its parent.
#[derive(Default)]
pub(crate) struct FrameTree {
    /// By child: the parent and pose_parent_child.
    fixed: BTreeMap<String, (String, Pose)>,
    /// By child: the parent and pose_parent_child over time.
    moving: BTreeMap<String, (String, Track)>,
}

impl FrameTree {
    /// Takes one transform of `/tf_static`.
    pub(crate) fn add_fixed(&mut self, transform: RosPose) {
        let Some(pose) = transform.pose else { return };
        if self.fixed.len() < MAX_FRAMES || self.fixed.contains_key(&transform.child) {
            self.fixed.insert(transform.child, (transform.header.frame_id, pose));
        }
    }

    /// Takes one transform of `/tf`.
    pub(crate) fn add_moving(&mut self, transform: RosPose) {
        let Some(pose) = transform.pose else { return };
        if self.moving.len() >= MAX_FRAMES && !self.moving.contains_key(&transform.child) {
            return;
        }
        let (parent, track) = self
            .moving
            .entry(transform.child)
            .or_insert_with(|| (transform.header.frame_id.clone(), Track::new(TRACK_LIMIT)));
        if *parent != transform.header.frame_id {
            // The frame was hung elsewhere: what was known of it is void.
            *parent = transform.header.frame_id;
            *track = Track::new(TRACK_LIMIT);
        }
        track.push(transform.header.stamp_ns, pose);
    }

    /// pose_a_b from fixed transforms alone; `None` where they do not connect the frames.
    pub(crate) fn fixed_between(&self, a: &str, b: &str) -> Option<Pose> {
        let chain_a = self.fixed_chain(a);
        let chain_b = self.fixed_chain(b);
        // The first common ancestor: both chains list (frame, pose_frame_start).
        chain_a.iter().find_map(|(frame, pose_frame_a)| {
            let (_, pose_frame_b) = chain_b.iter().find(|(f, _)| f == frame)?;
            Some(pose_frame_a.inverse() * pose_frame_b)
        })
    }

    fn fixed_chain<'a>(&'a self, start: &'a str) -> Vec<(&'a str, Pose)> {
        let mut chain = vec![(start, Pose::identity())];
        while let Some((frame, pose)) = chain.last().copied()
            && let Some((parent, pose_parent_frame)) = self.fixed.get(frame)
            && chain.len() < MAX_DEPTH
        {
            chain.push((parent, pose_parent_frame * pose));
        }
        chain
    }

    /// The moving frames between `sensor` and the frame its motion is told in: the nearest one called `odom`, which moves
    /// smoothly, else the root. Empty where nothing above the sensor moves.
    fn climb<'a>(&'a self, sensor: &'a str) -> Vec<&'a str> {
        let mut path = vec![sensor];
        let mut moves = false;
        while let Some(&frame) = path.last()
            && path.len() < MAX_DEPTH
        {
            if moves && is_odom(frame) {
                break;
            }
            match (self.fixed.get(frame), self.moving.get(frame)) {
                (Some((parent, _)), _) => path.push(parent),
                (None, Some((parent, _))) => {
                    moves = true;
                    path.push(parent);
                }
                (None, None) => break,
            }
        }
        if moves { path } else { Vec::new() }
    }

    /// Whether every moving frame above the sensor has a sample at or after the time.
    pub(crate) fn reaches(&self, sensor: &str, stamp_ns: i64) -> bool {
        let path = self.climb(sensor);
        let Some((_, frames)) = path.split_last() else { return false };
        frames
            .iter()
            .filter(|frame| !self.fixed.contains_key(**frame))
            .all(|frame| self.moving.get(*frame).is_some_and(|(_, track)| track.reaches(stamp_ns)))
    }

    /// pose_odom_sensor at a time; `None` where the chain has a gap there.
    pub(crate) fn motion_at(&self, sensor: &str, stamp_ns: i64) -> Option<Pose> {
        let path = self.climb(sensor);
        let (_, frames) = path.split_last()?;
        let mut pose = Pose::identity();
        for frame in frames {
            let step = match self.fixed.get(*frame) {
                Some((_, fixed)) => *fixed,
                None => self.moving.get(*frame)?.1.at(stamp_ns)?,
            };
            pose = step * pose;
        }
        Some(pose)
    }

    /// Drops what is not needed for times at or after this one.
    pub(crate) fn forget_before(&mut self, stamp_ns: i64) {
        for (_, track) in self.moving.values_mut() {
            track.forget_before(stamp_ns);
        }
    }
}

fn is_odom(frame: &str) -> bool {
    frame.rsplit('/').next() == Some("odom")
}

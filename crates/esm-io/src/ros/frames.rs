//! The tree of frames that `/tf` and `/tf_static` describe.

use std::collections::{BTreeMap, BTreeSet};

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
#[derive(Clone, Default)]
pub(crate) struct FrameTree {
    /// By child: the parent and pose_parent_child.
    fixed: BTreeMap<String, (String, Pose)>,
    /// By child: the parent and pose_parent_child over time.
    moving: BTreeMap<String, (String, Track)>,
    /// Where the whole motion is gathered at once: the frames it is gathered of, and how many samples of each.
    whole: Option<(BTreeSet<String>, usize)>,
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
        let of_use = self.whole.as_ref().is_none_or(|(frames, _)| frames.contains(&transform.child));
        if !of_use || (self.moving.len() >= MAX_FRAMES && !self.moving.contains_key(&transform.child)) {
            return;
        }
        let limit = self.whole.as_ref().map_or(TRACK_LIMIT, |(_, limit)| *limit);
        let (parent, track) = self
            .moving
            .entry(transform.child)
            .or_insert_with(|| (transform.header.frame_id.clone(), Track::new(limit)));
        if *parent != transform.header.frame_id {
            // The frame was hung elsewhere: what was known of it is void.
            *parent = transform.header.frame_id;
            *track = Track::new(limit);
        }
        match self.whole {
            Some(_) => track.append(transform.header.stamp_ns, pose),
            None => track.push(transform.header.stamp_ns, pose),
        }
    }

    /// A tree with the same fixed frames that gathers, in whatever order it comes, the whole motion of the frames above
    /// the sensor as this tree knows them; at most `limit` samples in all. [`settle`](Self::settle) makes it ready.
    pub(crate) fn gathering(&self, sensor: &str, limit: usize) -> Self {
        let path = self.climb(sensor);
        let frames: BTreeSet<String> = path.iter().map(|f| (*f).to_owned()).collect();
        let each = limit / frames.len().max(1);
        Self { fixed: self.fixed.clone(), moving: BTreeMap::new(), whole: Some((frames, each)) }
    }

    /// Puts what was gathered in order.
    pub(crate) fn settle(&mut self) {
        self.moving.values_mut().for_each(|(_, track)| track.settle());
    }

    /// Whether motion was dropped because of a limit.
    pub(crate) fn overran(&self) -> bool {
        self.moving.values().any(|(_, track)| track.overran())
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

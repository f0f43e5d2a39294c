//! Poses from a file, matched to sweeps.

use std::path::Path;

use esm_core::Pose;

use crate::error::Error;
use crate::pose::{PoseFile, StampedPose, Track};

/// How a sweep finds its pose.
#[derive(Clone, Debug)]
pub(super) enum SweepPoses {
    /// By time, between neighbours.
    ByStamp(Track),
    /// By its number from 0.
    ByIndex(Vec<Pose>),
}

impl SweepPoses {
    /// By stamp.
    pub(super) fn by_stamp(poses: Vec<StampedPose>) -> Self {
        let mut track = Track::new(poses.len());
        for p in poses {
            track.push(p.stamp_ns, p.pose);
        }
        Self::ByStamp(track)
    }

    /// For an MCAP: TUM by stamp, KITTI by order with one line a sweep.
    pub(super) fn for_recording(file: PoseFile, path: &Path, sweeps: usize) -> Result<Self, Error> {
        match file {
            PoseFile::Stamped(poses) => Ok(Self::by_stamp(poses)),
            PoseFile::Ordered(poses) if poses.len() == sweeps => Ok(Self::ByIndex(poses)),
            PoseFile::Ordered(poses) => Err(Error::malformed(
                path,
                format!("line {}", poses.len().min(sweeps) + 1),
                format!("the file has {} lines for {sweeps} sweeps", poses.len()),
                "KITTI poses have no stamps and need one line a sweep; TUM poses are matched by time",
            )),
        }
    }

    pub(super) fn at(&self, index: usize, stamp_ns: i64) -> Option<Pose> {
        match self {
            Self::ByStamp(track) => track.at(stamp_ns),
            Self::ByIndex(poses) => poses.get(index).copied(),
        }
    }

    /// First and last time, nanoseconds.
    pub(super) fn span(&self) -> Option<(i64, i64)> {
        match self {
            Self::ByStamp(track) => track.span(),
            Self::ByIndex(_) => None,
        }
    }
}

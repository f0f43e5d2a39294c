//! The truth as a file.

use std::path::Path;

use esm_io::{InputKind, OpenOptions, PoseFile, Recording};

use super::Trajectory;
use crate::error::Error;

/// Reads true poses: a TUM file, or a recording (`.mcap`) whose motion is the truth.
///
/// # Errors
/// [`Error::Input`] where there is no pose or no time stamp; the reader's.
pub fn read(path: &Path) -> Result<Trajectory, Error> {
    let is_recording = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
        && esm_io::classify(path)? == InputKind::Recording;
    Ok(Trajectory::new(if is_recording { from_recording(path)? } else { from_tum(path)? }))
}

fn from_tum(path: &Path) -> Result<Vec<(f64, esm_core::Pose)>, Error> {
    match esm_io::read_poses(path)? {
        PoseFile::Stamped(poses) => Ok(poses.iter().map(|p| (p.stamp(), p.pose)).collect()),
        PoseFile::Ordered(_) => Err(Error::input(
            path,
            "these poses have no time stamps",
            "a truth is matched by time: give a TUM file (stamp x y z qx qy qz qw)",
        )),
    }
}

fn from_recording(path: &Path) -> Result<Vec<(f64, esm_core::Pose)>, Error> {
    let recording = Recording::open(path, &OpenOptions::default())?;
    let mut poses = Vec::new();
    for sweep in recording.sweeps()? {
        let sweep = sweep?;
        poses.extend(sweep.pose_odom_sensor.map(|pose| (sweep.stamp, pose)));
    }
    if poses.is_empty() {
        let hint = "give a TUM file, or a recording with odometry";
        return Err(Error::input(path, "the recording tells no pose", hint));
    }
    Ok(poses)
}

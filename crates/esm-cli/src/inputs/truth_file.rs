//! `--truth FILE`.

use std::path::Path;

use esm_io::{InputKind, OpenOptions, PoseFile, Recording};

use super::check_regular;
use crate::outcome::Failure;
use crate::truth::Trajectory;

/// Reads true poses: a TUM file, or a recording whose motion is the truth.
pub(crate) fn read_truth(path: &Path) -> anyhow::Result<Trajectory> {
    check_regular(path)?;
    let is_recording = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
        && esm_io::classify(path)? == InputKind::Recording;
    let poses = if is_recording { from_recording(path)? } else { from_tum(path)? };
    Ok(Trajectory::new(poses))
}

fn from_tum(path: &Path) -> anyhow::Result<Vec<(f64, esm_core::Pose)>> {
    match esm_io::read_poses(path)? {
        PoseFile::Stamped(poses) => Ok(poses.iter().map(|p| (p.stamp(), p.pose)).collect()),
        PoseFile::Ordered(_) => Err(Failure::new(
            format!("{}: these poses have no time stamps", path.display()),
            "a truth is matched by time: give a TUM file (stamp x y z qx qy qz qw)",
        )
        .into()),
    }
}

fn from_recording(path: &Path) -> anyhow::Result<Vec<(f64, esm_core::Pose)>> {
    let recording = Recording::open(path, &OpenOptions::default())?;
    let mut poses = Vec::new();
    for sweep in recording.sweeps()? {
        let sweep = sweep?;
        poses.extend(sweep.pose_odom_sensor.map(|pose| (sweep.stamp, pose)));
    }
    if poses.is_empty() {
        let what = format!("{}: the recording tells no pose", path.display());
        return Err(Failure::new(what, "give a TUM file, or a recording with odometry").into());
    }
    Ok(poses)
}

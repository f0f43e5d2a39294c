//! Readers and writers for LiDAR recordings, point clouds and trajectories.
//!
//! - [`Recording`]: sweeps with the motion between them, from one `.mcap` (ROS 2: PointCloud2 with Odometry, PoseStamped or
//!   TF), a directory of scans, or a single scan; across damage, in constant memory where motion and clouds are in time order
//!   (else the motion alone is gathered first).
//! - [`read_prior_cloud`], [`read_scan`]: `.las`, `.laz`, `.pcd`, `.ply`, KITTI `.bin`.
//! - [`read_tum`], [`read_kitti_poses`], [`read_poses`]: trajectories; [`write_tum`] and [`PoseWriter`] write them.
//! - [`scan_from_bytes`], [`CloudMessage`], [`Track`]: clouds and motion that come over a network.
//! - [`LocalizationLine`]: one result as the JSON object that programs read.
//! - [`RecordingWriter`]: clouds of any fields with odometry, as MCAP, and [`KeptSweeps`], to go on after an interruption;
//!   [`write_file`]: any bytes, whole or not at all.
//!
//! Points are f32 metres, poses f64. Points that are NaN, infinite or exactly (0, 0, 0), which is how sensors write "no
//! return", are left out and counted. Every [`Error`] names the file, the place in it, and what to do; what reading could
//! get over is a [`Warning`]. No reader allocates what a header asks for before the file's size has been looked at.

#![cfg_attr(not(test), warn(clippy::unwrap_used))]

mod atomic;
mod cloud;
mod error;
mod input;
mod lines;
mod mcap_file;
mod natural;
mod plain;
mod pose;
mod recording;
mod ros;
mod scalar;

pub use atomic::write_file;
pub use cloud::{
    PriorCloud, Scan, ScanFormat, read_prior_cloud, read_scan, scan_from_bytes, scan_from_points,
};
pub use error::Error;
pub use lines::{LocalizationLine, PoseLine, StageMillis, stage_micros};
pub use mcap_file::{Damage, Lost, Topic};
pub use natural::natural_order;
pub use pose::{PoseFile, StampedPose, Track, read_kitti_poses, read_poses, read_tum, seconds, write_tum};
pub use recording::{InputKind, OpenOptions, Recording, Sweep, Sweeps, Warning, classify};
pub use ros::kept::{KeptSweep, KeptSweeps};
pub use ros::point_cloud2::{CloudMessage, PointLabel};
pub use ros::pose_writer::PoseWriter;
pub use ros::recording_writer::{CloudField, FieldType, RecordingLayout, RecordingWriter};

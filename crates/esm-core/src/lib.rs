//! Efficient Segment Matching: where am I in this map, from LiDAR alone, on a CPU.

#![cfg_attr(not(test), warn(clippy::unwrap_used))]

pub mod cloud;
pub mod describe;
pub mod error;
pub mod index;
pub mod map;
pub mod segment;

pub use cloud::{PointCloud, Pose, transform_point};
pub use error::Error;

//! The ROS 2 messages this crate understands, and their CDR encoding.

pub(crate) mod cdr;
pub(crate) mod cdr_writer;
pub(crate) mod frames;
pub(crate) mod kept;
pub(crate) mod motion;
pub(crate) mod point_cloud2;
pub(crate) mod pose_writer;
pub(crate) mod recording_writer;
mod schemas;

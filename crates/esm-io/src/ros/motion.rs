//! The messages that tell how a robot moved: `nav_msgs/msg/Odometry`, `geometry_msgs/msg/PoseStamped`,
//! `geometry_msgs/msg/PoseWithCovarianceStamped`, `tf2_msgs/msg/TFMessage`.

use esm_core::Pose;

use super::cdr::{CdrReader, Header, frame_name};
use crate::pose::pose_from;

/// Most transforms one TFMessage may hold.
const TRANSFORM_LIMIT: u32 = 100_000;

/// One pose as recorded: of the frame `child` in the frame `header.frame_id`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct RosPose {
    pub(crate) header: Header,
    /// Empty where the message does not tell.
    pub(crate) child: String,
    /// `None` where the numbers are no pose: NaN, or a quaternion of zeros.
    pub(crate) pose: Option<Pose>,
}

fn read_pose(cdr: &mut CdrReader<'_>) -> Result<Option<Pose>, String> {
    Ok(pose_from(cdr.f64s()?, cdr.f64s()?))
}

pub(crate) fn decode_odometry(message: &[u8]) -> Result<RosPose, String> {
    let mut cdr = CdrReader::new(message)?;
    let header = Header::read(&mut cdr)?;
    let child = frame_name(&cdr.string()?);
    // Covariance and twist follow and are not needed.
    Ok(RosPose { header, child, pose: read_pose(&mut cdr)? })
}

/// Also reads PoseWithCovarianceStamped, which starts with the same fields.
pub(crate) fn decode_pose_stamped(message: &[u8]) -> Result<RosPose, String> {
    let mut cdr = CdrReader::new(message)?;
    let header = Header::read(&mut cdr)?;
    Ok(RosPose { header, child: String::new(), pose: read_pose(&mut cdr)? })
}

pub(crate) fn decode_tf(message: &[u8]) -> Result<Vec<RosPose>, String> {
    let mut cdr = CdrReader::new(message)?;
    let n = cdr.u32()?;
    if n > TRANSFORM_LIMIT {
        return Err(format!("{n} transforms are declared, more than {TRANSFORM_LIMIT}"));
    }
    let mut transforms = Vec::new();
    for _ in 0..n {
        let header = Header::read(&mut cdr)?;
        let child = frame_name(&cdr.string()?);
        transforms.push(RosPose { header, child, pose: read_pose(&mut cdr)? });
    }
    Ok(transforms)
}

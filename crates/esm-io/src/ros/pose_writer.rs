//! Poses as MCAP: `geometry_msgs/msg/PoseWithCovarianceStamped`, which Foxglove and rviz show with its ellipsoid.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use esm_core::Pose;
use mcap::records::MessageHeader;
use mcap::{McapError, WriteOptions, Writer};
use nalgebra::Matrix6;

use super::schemas;
use crate::atomic::AtomicFile;
use crate::error::Error;

/// Writes poses to an MCAP file that appears when [`finish`](Self::finish) is called, and not before.
///
/// ```
/// use esm_io::PoseWriter;
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("out.mcap");
/// let mut writer = PoseWriter::create(&path, "/localization", "map")?;
/// writer.write(1_500_000_000, &esm_core::Pose::translation(1.0, 2.0, 0.0), None)?;
/// writer.finish()?;
/// assert!(path.exists());
/// # Ok(())
/// # }
/// ```
pub struct PoseWriter {
    path: PathBuf,
    writer: Writer<AtomicFile>,
    channel: u16,
    frame_id: String,
    sequence: u32,
}

impl PoseWriter {
    /// Starts a file with one topic; the poses are told in the frame `frame_id`.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: impl AsRef<Path>, topic: &str, frame_id: &str) -> Result<Self, Error> {
        let path = path.as_ref().to_owned();
        let failed = |e| write_error(&path, e);
        let options =
            WriteOptions::new().profile("ros2").library(concat!("esm-io ", env!("CARGO_PKG_VERSION")));
        let mut writer = options.create(AtomicFile::create(&path)?).map_err(failed)?;
        let schema =
            writer.add_schema(schemas::POSE_NAME, "ros2msg", schemas::POSE.as_bytes()).map_err(failed)?;
        let channel = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).map_err(failed)?;
        Ok(Self { path, writer, channel, frame_id: frame_id.to_owned(), sequence: 0 })
    }

    /// Writes one pose of the sensor at a time in nanoseconds (`int32` seconds: up to 2038).
    ///
    /// `covariance` is row-major 6 x 6, order x y z rx ry rz in m and rad, as a right perturbation in the sensor frame;
    /// ROS wants it along the axes of the map frame, so both of its halves are turned by the pose's rotation. Zeros are
    /// written without it.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write(
        &mut self,
        stamp_ns: i64,
        pose_map_sensor: &Pose,
        covariance: Option<&[f64; 36]>,
    ) -> Result<(), Error> {
        let message = encode(stamp_ns, &self.frame_id, pose_map_sensor, covariance);
        let time = stamp_ns.max(0).unsigned_abs();
        let header = MessageHeader {
            channel_id: self.channel,
            sequence: self.sequence,
            log_time: time,
            publish_time: time,
        };
        self.sequence = self.sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, &message).map_err(|e| write_error(&self.path, e))
    }

    /// Completes the file and moves it into place.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(mut self) -> Result<(), Error> {
        self.writer.finish().map_err(|e| write_error(&self.path, e))?;
        self.writer.into_inner().commit()
    }
}

pub(super) fn write_error(path: &Path, error: McapError) -> Error {
    let source = match error {
        // Nobody typed the temporary name that stands in the text.
        McapError::Io(e) => match e.to_string().split_once(" at path ") {
            Some((what, _)) => std::io::Error::new(e.kind(), what.to_owned()),
            None => e,
        },
        other => std::io::Error::other(other.to_string()),
    };
    Error::io(path, "writing", source)
}

/// The message in little-endian CDR.
fn encode(stamp_ns: i64, frame_id: &str, pose: &Pose, covariance: Option<&[f64; 36]>) -> Vec<u8> {
    let sec = stamp_ns.div_euclid(1_000_000_000).clamp(i32::MIN.into(), i32::MAX.into()) as i32;
    let nanosec = stamp_ns.rem_euclid(1_000_000_000) as u32;
    let mut out = vec![0, 1, 0, 0];
    out.extend(sec.to_le_bytes());
    out.extend(nanosec.to_le_bytes());
    out.extend((frame_id.len() as u32 + 1).to_le_bytes());
    out.extend(frame_id.as_bytes());
    out.push(0);
    // The doubles are aligned to 8 from the end of the four header bytes.
    out.resize(4 + (out.len() - 4).next_multiple_of(8), 0);
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    let covariance = covariance.map_or([0.0; 36], |c| to_map_axes(c, pose));
    for v in [t.x, t.y, t.z, q.x, q.y, q.z, q.w].iter().chain(&covariance) {
        out.extend(v.to_le_bytes());
    }
    out
}

/// Turns both halves of a covariance from the sensor's axes to the map's.
fn to_map_axes(covariance: &[f64; 36], pose: &Pose) -> [f64; 36] {
    let rotation = pose.rotation.to_rotation_matrix();
    let mut turn = Matrix6::zeros();
    turn.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation.matrix());
    turn.fixed_view_mut::<3, 3>(3, 3).copy_from(rotation.matrix());
    let turned = turn * Matrix6::from_row_slice(covariance) * turn.transpose();
    let mut out = [0.0; 36];
    out.copy_from_slice(turned.transpose().as_slice());
    out
}

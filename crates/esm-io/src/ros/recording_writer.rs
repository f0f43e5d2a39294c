//! Recordings as MCAP: `sensor_msgs/msg/PointCloud2` with `nav_msgs/msg/Odometry`, as rosbag2 records them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use esm_core::Pose;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use super::cdr_writer::CdrWriter;
use super::kept::KeptSweep;
use super::pose_writer::write_error;
use super::schemas;
use crate::atomic::AtomicFile;
use crate::error::Error;

/// Uncompressed bytes of a chunk: some sweeps, so that a torn file loses little.
const CHUNK_BYTES: u64 = 4 << 20;

/// Number types of point fields, those of `sensor_msgs/msg/PointField`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // The names say it.
pub enum FieldType {
    U8 = 2,
    U16 = 4,
    U32 = 6,
    F32 = 7,
    F64 = 8,
}

/// One field of a point record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CloudField {
    /// Its name: `x`, `y`, `z`, `intensity`.
    pub name: &'static str,
    /// Where it starts in the record, bytes.
    pub offset: u32,
    /// Its type.
    pub kind: FieldType,
}

/// Names in a recording, and the layout of its points.
#[derive(Clone, Copy, Debug)]
pub struct RecordingLayout<'a> {
    /// Topic of the clouds.
    pub cloud_topic: &'a str,
    /// Topic of the motion.
    pub odometry_topic: &'a str,
    /// Frame of the clouds, whose motion the odometry tells.
    pub sensor_frame: &'a str,
    /// Frame the odometry is told in.
    pub odom_frame: &'a str,
    /// Fields of a point record.
    pub fields: &'a [CloudField],
    /// Bytes of a point record.
    pub point_step: u32,
}

/// Writes clouds and odometry to an MCAP file that appears when [`finish`](Self::finish) is called, and not before. The same
/// calls give the same bytes.
///
/// ```
/// use esm_io::{CloudField, FieldType, OpenOptions, Recording, RecordingLayout, RecordingWriter};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("out.mcap");
/// let field = |name, offset| CloudField { name, offset, kind: FieldType::F32 };
/// let layout = RecordingLayout {
///     cloud_topic: "/points", odometry_topic: "/odometry", sensor_frame: "lidar", odom_frame: "odom",
///     fields: &[field("x", 0), field("y", 4), field("z", 8)], point_step: 12,
/// };
/// let mut writer = RecordingWriter::create(&path, &layout)?;
/// let pose = esm_core::Pose::translation(1.0, 2.0, 0.0);
/// writer.write_odometry(1_500_000_000, &pose)?;
/// let point: Vec<u8> = [3.0f32, 4.0, 5.0].iter().flat_map(|v| v.to_le_bytes()).collect();
/// writer.write_cloud(1_500_000_000, &point)?;
/// writer.finish()?;
/// let recording = Recording::open(&path, &OpenOptions::default())?;
/// let sweep = recording.sweeps()?.next().ok_or("a sweep")??;
/// assert_eq!(sweep.cloud.points(), [[3.0, 4.0, 5.0]]);
/// assert_eq!(sweep.pose_odom_sensor, Some(pose));
/// # Ok(())
/// # }
/// ```
pub struct RecordingWriter {
    path: PathBuf,
    writer: Writer<AtomicFile>,
    cloud_channel: u16,
    odometry_channel: u16,
    sensor_frame: String,
    odom_frame: String,
    fields: Vec<CloudField>,
    point_step: u32,
    sequences: [u32; 2],
}

impl RecordingWriter {
    /// Starts a file with its two topics.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(path: impl AsRef<Path>, layout: &RecordingLayout<'_>) -> Result<Self, Error> {
        Self::start(path.as_ref(), AtomicFile::create(path.as_ref())?, layout)
    }

    /// The same, and what was written stays in the file `part` beside it where this is not finished. [`KeptSweeps`](crate::KeptSweeps) reads it
    /// again. What is called so before is replaced.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create_lasting(
        path: impl AsRef<Path>,
        part: &str,
        layout: &RecordingLayout<'_>,
    ) -> Result<Self, Error> {
        Self::start(path.as_ref(), AtomicFile::create_lasting(path.as_ref(), part)?, layout)
    }

    fn start(path: &Path, file: AtomicFile, layout: &RecordingLayout<'_>) -> Result<Self, Error> {
        let path = path.to_owned();
        let failed = |e| write_error(&path, e);
        let options = WriteOptions::new()
            .profile("ros2")
            .library(concat!("esm-io ", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            // Its number of threads must not show in the bytes.
            .compression_threads(0);
        let mut writer = options.create(file).map_err(failed)?;
        let mut channel = |topic: &str, name: &str, schema: &str| {
            let schema = writer.add_schema(name, "ros2msg", schema.as_bytes())?;
            writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
        };
        let cloud_channel =
            channel(layout.cloud_topic, schemas::CLOUD_NAME, schemas::CLOUD).map_err(failed)?;
        let odometry_channel =
            channel(layout.odometry_topic, schemas::ODOMETRY_NAME, schemas::ODOMETRY).map_err(failed)?;
        Ok(Self {
            writer,
            cloud_channel,
            odometry_channel,
            sensor_frame: layout.sensor_frame.to_owned(),
            odom_frame: layout.odom_frame.to_owned(),
            fields: layout.fields.to_vec(),
            point_step: layout.point_step,
            sequences: [0; 2],
            path,
        })
    }

    /// Writes one cloud: little-endian point records one after the other. A rest shorter than a record is left out.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_cloud(&mut self, stamp_ns: i64, records: &[u8]) -> Result<(), Error> {
        let points = records.len() / self.point_step.max(1) as usize;
        let data = &records[..points * self.point_step as usize];
        let mut cdr = CdrWriter::with_capacity(data.len() + 64 + 32 * self.fields.len());
        cdr.header(stamp_ns, &self.sensor_frame);
        cdr.u32(1);
        cdr.u32(points as u32);
        cdr.u32(self.fields.len() as u32);
        for field in &self.fields {
            cdr.string(field.name);
            cdr.u32(field.offset);
            cdr.u8(field.kind as u8);
            cdr.u32(1);
        }
        cdr.u8(0);
        cdr.u32(self.point_step);
        cdr.u32(data.len() as u32);
        cdr.byte_sequence(data);
        cdr.u8(1);
        self.write(0, self.cloud_channel, stamp_ns, &cdr.finish())
    }

    /// Writes one pose of the sensor in the odometry frame; covariance and twist are zero.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_odometry(&mut self, stamp_ns: i64, pose_odom_sensor: &Pose) -> Result<(), Error> {
        let mut cdr = CdrWriter::with_capacity(760);
        cdr.header(stamp_ns, &self.odom_frame);
        cdr.string(&self.sensor_frame);
        let (t, q) = (pose_odom_sensor.translation.vector, pose_odom_sensor.rotation.coords);
        cdr.f64s(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w]);
        // Covariance of the pose, twist, covariance of the twist.
        cdr.f64s(&[0.0; 36 + 6 + 36]);
        self.write(1, self.odometry_channel, stamp_ns, &cdr.finish())
    }

    /// Writes what an interrupted run has left of a sweep: the same bytes as then.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_kept(&mut self, sweep: &KeptSweep) -> Result<(), Error> {
        self.write(1, self.odometry_channel, sweep.stamp_ns, &sweep.odometry)?;
        self.write(0, self.cloud_channel, sweep.stamp_ns, &sweep.cloud)
    }

    fn write(&mut self, topic: usize, channel_id: u16, stamp_ns: i64, message: &[u8]) -> Result<(), Error> {
        let time = stamp_ns.max(0).unsigned_abs();
        let sequence = self.sequences[topic];
        self.sequences[topic] = sequence.wrapping_add(1);
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, message).map_err(|e| write_error(&self.path, e))
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

//! Writing recordings as robots do: ROS 2 messages in MCAP, scans in directories, poses in text.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Result, Write};
use std::path::Path;

use esm_core::Pose;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::street::Sweep;

/// Writes `/points` (sensor_msgs/PointCloud2) and, where there is motion, `/odom` (nav_msgs/Odometry).
pub struct Recording {
    writer: Writer<BufWriter<File>>,
    points: u16,
    odometry: Option<u16>,
    sequence: u32,
}

fn failed(error: mcap::McapError) -> std::io::Error {
    std::io::Error::other(error)
}

impl Recording {
    /// Starts a recording of small chunks, so that a torn file loses little.
    pub fn create(path: &Path, with_odometry: bool) -> Result<Self> {
        let options = WriteOptions::new().profile("ros2").chunk_size(Some(200_000));
        let mut writer = options.create(BufWriter::new(File::create(path)?)).map_err(failed)?;
        let points = channel(&mut writer, "/points", "sensor_msgs/msg/PointCloud2")?;
        let odometry =
            with_odometry.then(|| channel(&mut writer, "/odom", "nav_msgs/msg/Odometry")).transpose()?;
        Ok(Self { writer, points, odometry, sequence: 0 })
    }

    /// Writes one cloud on a topic of its own, as of a second sensor.
    pub fn write_other(&mut self, topic: &str, stamp: f64, points: &[[f32; 3]]) -> Result<()> {
        let channel = channel(&mut self.writer, topic, "sensor_msgs/msg/PointCloud2")?;
        self.message(channel, stamp, &point_cloud(stamp, points))
    }

    /// Writes one sweep and, with odometry, its pose.
    pub fn write(&mut self, stamp: f64, points: &[[f32; 3]], pose_odom_sensor: Option<&Pose>) -> Result<()> {
        if let (Some(channel), Some(pose)) = (self.odometry, pose_odom_sensor) {
            self.message(channel, stamp, &odometry(stamp, pose))?;
        }
        self.message(self.points, stamp, &point_cloud(stamp, points))
    }

    fn message(&mut self, channel_id: u16, stamp: f64, data: &[u8]) -> Result<()> {
        self.sequence += 1;
        let time = (stamp * 1e9) as u64;
        let header =
            MessageHeader { channel_id, sequence: self.sequence, log_time: time, publish_time: time };
        self.writer.write_to_known_channel(&header, data).map_err(failed)
    }

    /// Ends the file properly.
    pub fn finish(mut self) -> Result<()> {
        self.writer.finish().map_err(failed)?;
        self.writer.into_inner().flush()
    }
}

fn channel(writer: &mut Writer<BufWriter<File>>, topic: &str, schema: &str) -> Result<u16> {
    let schema = writer.add_schema(schema, "ros2msg", b"").map_err(failed)?;
    writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).map_err(failed)
}

/// Writes a drive, its odometry told from `pose_world_odom`.
pub fn write_drive(path: &Path, drive: &[Sweep], pose_world_odom: Option<&Pose>) -> Result<()> {
    let mut recording = Recording::create(path, pose_world_odom.is_some())?;
    for sweep in drive {
        let pose = pose_world_odom.map(|odom| odom.inv_mul(&sweep.pose_world_sensor));
        recording.write(sweep.stamp, sweep.cloud.points(), pose.as_ref())?;
    }
    recording.finish()
}

/// Writes true poses as TUM.
pub fn write_truth(path: &Path, drive: &[Sweep]) -> Result<()> {
    let mut file = File::create(path)?;
    for Sweep { stamp, pose_world_sensor: pose, .. } in drive {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        writeln!(file, "{stamp:.9} {} {} {} {} {} {} {}", t.x, t.y, t.z, q.x, q.y, q.z, q.w)?;
    }
    Ok(())
}

/// Writes true poses as KITTI does: the upper rows of each pose's matrix.
pub fn write_kitti_poses(path: &Path, drive: &[Sweep]) -> Result<()> {
    let mut file = File::create(path)?;
    for sweep in drive {
        let m = sweep.pose_world_sensor.to_homogeneous();
        let row = |r: usize| (0..4).map(|c| m[(r, c)].to_string()).collect::<Vec<_>>().join(" ");
        writeln!(file, "{} {} {}", row(0), row(1), row(2))?;
    }
    Ok(())
}

/// Writes points as a binary PCD.
pub fn write_pcd(path: &Path, points: &[[f32; 3]]) -> Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let n = points.len();
    writeln!(
        file,
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary"
    )?;
    for v in points.iter().flatten() {
        file.write_all(&v.to_le_bytes())?;
    }
    file.flush()
}

/// Little-endian CDR: every value at a multiple of its size after the 4 bytes of encapsulation.
struct Cdr(Vec<u8>);

impl Cdr {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(&mut self, size: usize) {
        while !(self.0.len() - 4).is_multiple_of(size) {
            self.0.push(0);
        }
    }

    fn u32(&mut self, v: u32) {
        self.align(4);
        self.0.extend(v.to_le_bytes());
    }

    fn f64(&mut self, v: f64) {
        self.align(8);
        self.0.extend(v.to_le_bytes());
    }

    fn string(&mut self, s: &str) {
        self.u32(s.len() as u32 + 1);
        self.0.extend(s.as_bytes());
        self.0.push(0);
    }

    fn header(&mut self, stamp: f64, frame_id: &str) {
        self.u32(stamp.floor() as u32);
        self.u32((stamp.fract() * 1e9).round() as u32);
        self.string(frame_id);
    }
}

/// A PointCloud2 in CDR.
pub fn point_cloud(stamp: f64, points: &[[f32; 3]]) -> Vec<u8> {
    const FLOAT32: u8 = 7;
    let mut cdr = Cdr::new();
    cdr.header(stamp, "lidar");
    cdr.u32(1);
    cdr.u32(points.len() as u32);
    cdr.u32(3);
    for (i, name) in ["x", "y", "z"].into_iter().enumerate() {
        cdr.string(name);
        cdr.u32(4 * i as u32);
        cdr.0.push(FLOAT32);
        cdr.u32(1);
    }
    cdr.0.push(0);
    cdr.u32(12);
    cdr.u32(12 * points.len() as u32);
    cdr.u32(12 * points.len() as u32);
    cdr.0.extend(points.iter().flatten().flat_map(|v| v.to_le_bytes()));
    cdr.0.push(0);
    cdr.0
}

fn odometry(stamp: f64, pose: &Pose) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.header(stamp, "odom");
    cdr.string("lidar");
    let (t, q) = (pose.translation.vector, pose.rotation.coords);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w].into_iter().for_each(|v| cdr.f64(v));
    // Covariance, twist and its covariance.
    (0..36 + 6 + 36).for_each(|_| cdr.f64(0.0));
    cdr.0
}

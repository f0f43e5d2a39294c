//! What an interrupted run has left in its unfinished recording.

use std::path::Path;

use super::{point_cloud2, schemas};
use crate::error::Error;
use crate::mcap_file::{MessageStream, Wanted};

/// One sweep with its odometry, as it was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptSweep {
    /// Nanoseconds.
    pub stamp_ns: i64,
    pub(super) odometry: Vec<u8>,
    pub(super) cloud: Vec<u8>,
}

impl KeptSweep {
    /// The point records, one after the other; empty where the message holds none that can be read.
    pub fn records(&self) -> &[u8] {
        point_cloud2::records(&self.cloud).unwrap_or_default()
    }
}

/// The sweeps of a file that a [`RecordingWriter`](crate::RecordingWriter) has left unfinished, from the first on, up to where
/// it is torn or damaged: odometry and cloud in turn, as they were written.
///
/// ```
/// use esm_io::{CloudField, FieldType, KeptSweeps, RecordingLayout, RecordingWriter};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("out.mcap");
/// let field = |name, offset| CloudField { name, offset, kind: FieldType::F32 };
/// let layout = RecordingLayout {
///     cloud_topic: "/points", odometry_topic: "/odometry", sensor_frame: "lidar", odom_frame: "odom",
///     fields: &[field("x", 0), field("y", 4), field("z", 8)], point_step: 12,
/// };
/// let mut writer = RecordingWriter::create_lasting(&path, ".out.part", &layout)?;
/// writer.write_odometry(7, &esm_core::Pose::identity())?;
/// writer.write_cloud(7, &[1; 24])?;
/// drop(writer); // Interrupted.
/// let kept: Vec<_> = KeptSweeps::open(path.with_file_name(".out.part"))?.collect();
/// assert_eq!((kept.len(), kept[0].stamp_ns, kept[0].records()), (1, 7, &[1; 24][..]));
/// # Ok(())
/// # }
/// ```
pub struct KeptSweeps {
    stream: MessageStream,
    ended: bool,
}

impl KeptSweeps {
    /// Opens an unfinished file.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Unsupported`] and [`Error::Empty`] where it is no MCAP file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        Ok(Self { stream: MessageStream::open(path.as_ref(), Wanted::Everything)?, ended: false })
    }

    /// The next message, where it is of this type and nothing before it is damaged.
    fn message(&mut self, schema: &str) -> Option<(u64, Vec<u8>)> {
        let message = self.stream.next_message().ok()??;
        if self.stream.first_damage().is_some() {
            return None;
        }
        let channel = self.stream.channels().get(&message.channel)?;
        (channel.schema == schema).then(|| (message.log_time, self.stream.data().to_vec()))
    }

    fn sweep(&mut self) -> Option<KeptSweep> {
        let (time, odometry) = self.message(schemas::ODOMETRY_NAME)?;
        let (stamp, cloud) = self.message(schemas::CLOUD_NAME)?;
        let stamp_ns = i64::try_from(stamp).ok()?;
        (time == stamp).then_some(KeptSweep { stamp_ns, odometry, cloud })
    }
}

impl Iterator for KeptSweeps {
    type Item = KeptSweep;

    fn next(&mut self) -> Option<KeptSweep> {
        if self.ended {
            return None;
        }
        let sweep = self.sweep();
        self.ended = sweep.is_none();
        sweep
    }
}

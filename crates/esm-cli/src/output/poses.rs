//! Located poses as TUM or MCAP.

use std::io::{self, Write};
use std::path::Path;

use esm_core::Pose;

use super::file::{Format, Target, plain};
use crate::outcome::Failure;
use crate::signals::Unfinished;

const FORMATS: &[Format] = &[Format { extension: ".tum" }, Format { extension: ".mcap" }];
const TOPIC: &str = "/localization";

/// Writes poses as they come; the file appears with [`finish`](Self::finish).
pub(crate) enum PoseWriter {
    Tum(Target),
    Mcap(Box<esm_io::PoseWriter>, Unfinished),
}

impl PoseWriter {
    /// Checks the extension before any work is done.
    pub(crate) fn check_format(path: &Path) -> Result<(), Failure> {
        Format::of(path, FORMATS).map(drop)
    }

    /// Starts a file, by its extension. The poses are told in the frame `frame_id`.
    pub(crate) fn create(path: &Path, frame_id: &str) -> anyhow::Result<Self> {
        if Format::of(path, FORMATS)?.extension == ".mcap" {
            let unfinished = Unfinished::begin();
            let writer = esm_io::PoseWriter::create(path, TOPIC, frame_id).map_err(told)?;
            return Ok(Self::Mcap(Box::new(writer), unfinished));
        }
        let mut target = Target::create(path)?;
        writeln!(target, "# stamp tx ty tz qx qy qz qw (pose of the sensor in the frame '{frame_id}')")?;
        Ok(Self::Tum(target))
    }

    /// Writes one pose; `covariance` as [`esm_core::Localization`] has it.
    pub(crate) fn write(
        &mut self,
        stamp_ns: i64,
        pose: &Pose,
        covariance: Option<&[f64; 36]>,
    ) -> anyhow::Result<()> {
        match self {
            Self::Mcap(writer, _) => writer.write(stamp_ns, pose, covariance).map_err(told)?,
            Self::Tum(target) => {
                let (t, q) = (pose.translation.vector, pose.rotation.coords);
                let sign = if stamp_ns < 0 { "-" } else { "" };
                let (s, ns) =
                    (stamp_ns.unsigned_abs() / 1_000_000_000, stamp_ns.unsigned_abs() % 1_000_000_000);
                writeln!(
                    target,
                    "{sign}{s}.{ns:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
                    t.x, t.y, t.z, q.x, q.y, q.z, q.w
                )?;
            }
        }
        Ok(())
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        match self {
            Self::Tum(target) => target.finish(),
            Self::Mcap(writer, unfinished) => {
                writer.finish().map_err(told)?;
                drop(unfinished);
                Ok(())
            }
        }
    }
}

/// The writer's error, without the temporary name that the system's words may hold.
fn told(error: esm_io::Error) -> anyhow::Error {
    match error {
        esm_io::Error::Io { path, doing, source } => {
            let what = format!("{}: {doing}: {}", path.display(), plain(&source));
            io::Error::new(source.kind(), what).into()
        }
        other => other.into(),
    }
}

//! What was not as it should be, though reading went on.

use std::fmt;
use std::path::PathBuf;

use crate::mcap_file::Damage;
use crate::plain::Plain;
use crate::pose::seconds;

/// Something the user should know about a recording that could be read all the same.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Warning {
    /// Messages are missing.
    Damaged {
        /// The recording.
        path: PathBuf,
        /// What and where.
        damage: Damage,
    },
    /// Sweeps whose pose the source of motion does not tell.
    NoMotion {
        /// The recording.
        path: PathBuf,
        /// Sweeps without a pose.
        without: usize,
        /// Sweeps in all.
        sweeps: usize,
        /// The topic or file of the motion.
        source: String,
        /// First and last stamp of the sweeps, nanoseconds.
        sweep_span_ns: (i64, i64),
        /// First and last stamp of the motion, nanoseconds.
        motion_span_ns: Option<(i64, i64)>,
        /// The motion is not in time order with the clouds, and too long to be gathered beforehand.
        out_of_order: bool,
    },
    /// Motion messages that hold no pose: NaN, or a quaternion of zeros.
    InvalidMotion {
        /// The recording.
        path: PathBuf,
        /// Their topic.
        topic: String,
        /// Their number.
        messages: usize,
    },
    /// Nothing tells how the sensor is mounted: it was taken to sit where the motion is told for.
    AssumedMounting {
        /// The recording.
        path: PathBuf,
        /// The frame whose motion is told.
        body: String,
        /// The frame of the clouds.
        sensor: String,
    },
    /// Scans of another format in a directory, left out.
    IgnoredScans {
        /// The directory.
        path: PathBuf,
        /// The extension that was read.
        read: String,
        /// Extensions left out with their numbers of files.
        ignored: Vec<(String, usize)>,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged { path, damage } => write!(f, "{}: {damage}", Plain(path.display())),
            Self::NoMotion { path, without, sweeps, source, sweep_span_ns, motion_span_ns, out_of_order } => {
                let (a, b) = (seconds(sweep_span_ns.0), seconds(sweep_span_ns.1));
                write!(
                    f,
                    "{}: {} gives no pose for {without} of {sweeps} sweeps",
                    Plain(path.display()),
                    Plain(source)
                )?;
                write!(f, " (sweeps from {a:.3} to {b:.3} s, motion ")?;
                match motion_span_ns {
                    Some((a, b)) => write!(f, "from {:.3} to {:.3} s)", seconds(*a), seconds(*b))?,
                    None => write!(f, "none)")?,
                }
                if *out_of_order {
                    f.write_str("; the messages are not in time order and too many to be sorted here")?;
                    f.write_str("\nhint: sort the recording: 'mcap sort in.mcap -o out.mcap'")?;
                }
                Ok(())
            }
            Self::InvalidMotion { path, topic, messages } => {
                let (path, topic) = (Plain(path.display()), Plain(topic));
                write!(f, "{path}: {messages} messages of {topic} hold no valid pose and were left out")
            }
            Self::AssumedMounting { path, body, sensor } => write!(
                f,
                "{}: no transform between '{}' and '{}' is recorded (/tf_static); they were taken to be the same",
                Plain(path.display()),
                Plain(body),
                Plain(sensor)
            ),
            Self::IgnoredScans { path, read, ignored } => {
                let list: Vec<String> = ignored.iter().map(|(e, n)| format!("{n} .{e}")).collect();
                write!(f, "{}: read the .{read} files, ignored {}", Plain(path.display()), list.join(", "))
            }
        }
    }
}

//! TUM trajectories: `stamp x y z qx qy qz qw` a line, seconds and metres, `#` starts a comment.

use std::io::Write;
use std::path::Path;

use super::{HINT_RANGE, StampedPose, data_words, no_poses, out_of_range, parse_stamp, pose_from};
use crate::atomic::AtomicFile;
use crate::error::Error;
use crate::input::{Input, text, tokens};

const HINT_TUM: &str = "a TUM line is 'stamp x y z qx qy qz qw'";

/// Reads a TUM trajectory. Stamps must not go backwards; quaternions are normalised.
///
/// # Errors
/// [`Error::Malformed`] with the line that breaks these rules, [`Error::Empty`] where no line holds a pose,
/// [`Error::Io`].
pub fn read_tum(path: impl AsRef<Path>) -> Result<Vec<StampedPose>, Error> {
    let mut input = Input::open(path.as_ref())?;
    let mut poses: Vec<StampedPose> = Vec::new();
    let mut line = Vec::new();
    while input.next_line(&mut line)? {
        match data_words(&line) {
            0 => continue,
            8 => {}
            n => return Err(input.line_error(format!("{n} values, a TUM line has 8"), HINT_TUM)),
        }
        let mut words = tokens(&line).map(text);
        let stamp = words.next().unwrap_or_default();
        let Some(stamp_ns) = parse_stamp(&stamp) else {
            return Err(input.line_error(format!("'{stamp}' is no time in seconds"), HINT_TUM));
        };
        let mut v = [0.0; 7];
        for (slot, word) in v.iter_mut().zip(words) {
            *slot = word.parse().map_err(|_| input.line_error(format!("'{word}' is no number"), HINT_TUM))?;
        }
        if let Some(what) = out_of_range([v[0], v[1], v[2]]) {
            return Err(input.line_error(what, HINT_RANGE));
        }
        let Some(pose) = pose_from([v[0], v[1], v[2]], [v[3], v[4], v[5], v[6]]) else {
            let what = "the position is not finite or the quaternion is not of length 1";
            return Err(input.line_error(what, "the order is x y z w, the scalar last"));
        };
        if poses.last().is_some_and(|last| last.stamp_ns > stamp_ns) {
            return Err(
                input.line_error(format!("the time goes backwards to {stamp}"), "sort the lines by time")
            );
        }
        poses.push(StampedPose { stamp_ns, pose });
    }
    if poses.is_empty() { Err(no_poses(&input.path)) } else { Ok(poses) }
}

/// Writes a TUM trajectory: nine decimals of stamp and pose, to a temporary file that is moved into place when complete.
///
/// ```
/// use esm_io::{StampedPose, read_tum, write_tum};
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("poses.tum");
/// let pose = esm_core::Pose::translation(1.0, 2.0, 3.0);
/// write_tum(&path, [StampedPose { stamp_ns: 1_500_000_000, pose }])?;
/// assert_eq!(read_tum(&path)?[0].pose, pose);
/// assert_eq!(std::fs::read_to_string(&path)?.lines().next(),
///     Some("1.500000000 1.000000000 2.000000000 3.000000000 0.000000000 0.000000000 0.000000000 1.000000000"));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Io`].
pub fn write_tum(path: impl AsRef<Path>, poses: impl IntoIterator<Item = StampedPose>) -> Result<(), Error> {
    let path = path.as_ref();
    let mut file = AtomicFile::create(path)?;
    for StampedPose { stamp_ns, pose } in poses {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let sign = if stamp_ns < 0 { "-" } else { "" };
        let (s, ns) = (stamp_ns.unsigned_abs() / 1_000_000_000, stamp_ns.unsigned_abs() % 1_000_000_000);
        writeln!(
            file,
            "{sign}{s}.{ns:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w
        )
        .map_err(|e| Error::io(path, "writing", e))?;
    }
    file.commit()
}

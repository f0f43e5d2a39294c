//! Trajectories in text files: TUM and KITTI.

mod kitti;
mod track;
mod tum;

use std::path::Path;

use esm_core::Pose;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use crate::error::Error;
use crate::input::{Input, tokens};

pub use kitti::read_kitti_poses;
pub use track::Track;
pub use tum::{read_tum, write_tum};

/// One pose of a trajectory with its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Nanoseconds; exact where an f64 of seconds since 1970 would round to a quarter of a microsecond.
    pub stamp_ns: i64,
    /// Position in metres and attitude, in the frame the file is about.
    pub pose: Pose,
}

impl StampedPose {
    /// The time in seconds.
    pub fn stamp(&self) -> f64 {
        seconds(self.stamp_ns)
    }
}

/// What a pose file holds.
#[derive(Clone, Debug, PartialEq)]
pub enum PoseFile {
    /// TUM: poses with stamps.
    Stamped(Vec<StampedPose>),
    /// KITTI: one pose a sweep, in order.
    Ordered(Vec<Pose>),
}

impl PoseFile {
    /// Number of poses.
    pub fn len(&self) -> usize {
        match self {
            Self::Stamped(v) => v.len(),
            Self::Ordered(v) => v.len(),
        }
    }

    /// Whether there is no pose; the readers refuse such files.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Reads a TUM (8 numbers a line) or KITTI (12 numbers a line) trajectory, told apart by its first line.
///
/// # Errors
/// As [`read_tum`] and [`read_kitti_poses`].
pub fn read_poses(path: impl AsRef<Path>) -> Result<PoseFile, Error> {
    let path = path.as_ref();
    let mut input = Input::open(path)?;
    let mut line = Vec::new();
    while input.next_line(&mut line)? {
        match data_words(&line) {
            0 => {}
            8 => return read_tum(path).map(PoseFile::Stamped),
            12 => return read_kitti_poses(path).map(PoseFile::Ordered),
            n => {
                return Err(input.line_error(
                    format!("{n} values: a TUM line has 8 (stamp x y z qx qy qz qw), a KITTI line 12"),
                    "check that this is a file of poses",
                ));
            }
        }
    }
    Err(no_poses(path))
}

fn no_poses(path: &Path) -> Error {
    Error::empty(
        path,
        "the file holds no poses",
        "a TUM line is 'stamp x y z qx qy qz qw', a KITTI line 12 numbers",
    )
}

/// Number of values on a line; 0 for blank lines and comments.
fn data_words(line: &[u8]) -> usize {
    if line.trim_ascii_start().first() == Some(&b'#') { 0 } else { tokens(line).count() }
}

/// Nanoseconds as seconds; the nearest f64 for any time a clock shows.
pub fn seconds(ns: i64) -> f64 {
    ns.div_euclid(1_000_000_000) as f64 + ns.rem_euclid(1_000_000_000) as f64 / 1e9
}

/// Farthest position accepted, metres: beyond any map frame, and far below where f64 is coarser than a sensor.
const POSITION_LIMIT: f64 = 1e9;

/// Whether a position is finite and within 10^9 m on every axis.
pub(crate) fn in_range(t: [f64; 3]) -> bool {
    t.iter().all(|v| v.abs() <= POSITION_LIMIT)
}

/// What to say of a finite position that is not.
fn out_of_range(t: [f64; 3]) -> Option<String> {
    let out = t.iter().all(|v| v.is_finite()) && !in_range(t);
    out.then(|| {
        format!(
            "the position {} {} {} is out of range, farther than {POSITION_LIMIT:e} m",
            Far(t[0]),
            Far(t[1]),
            Far(t[2])
        )
    })
}

/// A number in as few characters as tell it.
struct Far(f64);

impl std::fmt::Display for Far {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.abs() < 1e6 { write!(f, "{}", self.0) } else { write!(f, "{:e}", self.0) }
    }
}

const HINT_RANGE: &str = "positions are metres; check the columns' order and units";

/// A pose from a position and a quaternion as programs write them: normalised here, `None` where they are no pose (not
/// finite, farther than 10^9 m, or a quaternion whose length is not near 1, such as the zeros of a filter that has not started).
pub(crate) fn pose_from(t: [f64; 3], xyzw: [f64; 4]) -> Option<Pose> {
    let q = Quaternion::new(xyzw[3], xyzw[0], xyzw[1], xyzw[2]);
    let norm = q.norm();
    let fine = in_range(t) && (0.9..1.1).contains(&norm);
    fine.then(|| Pose::from_parts(Translation3::new(t[0], t[1], t[2]), UnitQuaternion::new_normalize(q)))
}

/// Decimal seconds as nanoseconds, exact for plain decimals (further digits are cut off).
pub(crate) fn parse_stamp(word: &str) -> Option<i64> {
    let (negative, digits) = match word.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, word.strip_prefix('+').unwrap_or(word)),
    };
    let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
    let plain = |s: &str| s.bytes().all(|b| b.is_ascii_digit());
    if plain(whole) && plain(fraction) && !(whole.is_empty() && fraction.is_empty()) {
        let s: i64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
        let nanos = fraction.bytes().chain(std::iter::repeat(b'0')).take(9);
        let ns = nanos.fold(0, |ns, digit| ns * 10 + i64::from(digit - b'0'));
        let total = s.checked_mul(1_000_000_000)?.checked_add(ns)?;
        return Some(if negative { -total } else { total });
    }
    // Exponents, as numpy.savetxt writes them by default.
    let ns = word.parse::<f64>().ok()? * 1e9;
    (ns.abs() < 9.2e18).then_some(ns.round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_are_exact() {
        assert_eq!(parse_stamp("1317600335.250000001"), Some(1_317_600_335_250_000_001));
        assert_eq!(parse_stamp("-0.5"), Some(-500_000_000));
        assert_eq!(parse_stamp(".25"), Some(250_000_000));
        assert_eq!(parse_stamp("7"), Some(7_000_000_000));
        assert_eq!(parse_stamp("1.5e3"), Some(1_500_000_000_000));
        for bad in ["", ".", "-", "1e300", "nan", "x", "99999999999999", "1.2.3"] {
            assert_eq!(parse_stamp(bad), None, "{bad}");
        }
    }

    #[test]
    fn poses_need_a_unit_quaternion() {
        assert!(pose_from([0.0; 3], [0.0; 4]).is_none());
        assert!(pose_from([f64::NAN, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).is_none());
        assert!(pose_from([0.0; 3], [f64::NAN, 0.0, 0.0, 1.0]).is_none());
        assert!(pose_from([0.0, -1.1e9, 0.0], [0.0, 0.0, 0.0, 1.0]).is_none());
        let pose = pose_from([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.001]).unwrap();
        assert_eq!(pose.rotation.w, 1.0);
    }
}

//! [`Frame`]: what a robot sends in a session, as bytes.
//!
//! All numbers are little-endian. A frame begins with four letters, a u32 and the time as i64 nanoseconds:
//!
//! | letters | u32 | after the time |
//! |---|---|---|
//! | `ESMC`, a cloud | its points, n | n times x, y, z, reflectance as f32: metres in the sensor frame |
//! | `ESMO`, odometry | 0 | position x y z and quaternion x y z w as f64: `pose_odom_sensor` |

use esm_core::Pose;
use esm_io::{Scan, ScanFormat, scan_from_bytes};
use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

/// Bytes before the points of a cloud.
pub(crate) const HEAD: usize = 16;
/// Bytes of a point.
const POINT: usize = 16;
/// Bytes of odometry.
const ODOMETRY: usize = HEAD + 7 * 8;

/// Farthest position accepted, metres.
const POSITION_LIMIT: f64 = 1e9;

/// One message of a session.
///
/// ```
/// use esm_core::Pose;
/// use esm_serve::Frame;
///
/// let bytes = Frame::Cloud { stamp_ns: 5, points: vec![[1.0, 2.0, 3.0]] }.to_bytes();
/// assert_eq!(bytes.len(), 16 + 16);
/// let frame = Frame::Odometry { stamp_ns: 5, pose_odom_sensor: Pose::translation(1.0, 0.0, 0.0) };
/// assert_eq!(frame.to_bytes().len(), 72);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum Frame {
    /// One sweep.
    Cloud {
        /// Nanoseconds.
        stamp_ns: i64,
        /// Metres, sensor frame.
        points: Vec<[f32; 3]>,
    },
    /// Where the sensor is in the frame that its motion is told in.
    Odometry {
        /// Nanoseconds.
        stamp_ns: i64,
        /// The pose.
        pose_odom_sensor: Pose,
    },
}

impl Frame {
    /// The bytes to send; the reflectance is 0.
    pub fn to_bytes(&self) -> Vec<u8> {
        let head = |letters: &[u8; 4], n: u32, stamp_ns: &i64| {
            let mut bytes = letters.to_vec();
            bytes.extend(n.to_le_bytes());
            bytes.extend(stamp_ns.to_le_bytes());
            bytes
        };
        match self {
            Self::Cloud { stamp_ns, points } => {
                let mut bytes = head(b"ESMC", points.len() as u32, stamp_ns);
                bytes.reserve(POINT * points.len());
                for [x, y, z] in points {
                    [*x, *y, *z, 0.0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                }
                bytes
            }
            Self::Odometry { stamp_ns, pose_odom_sensor: pose } => {
                let mut bytes = head(b"ESMO", 0, stamp_ns);
                let (t, q) = (pose.translation.vector, pose.rotation.coords);
                [t.x, t.y, t.z, q.x, q.y, q.z, q.w].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
                bytes
            }
        }
    }
}

/// What came in, the points of a cloud still as bytes.
#[derive(Debug)]
pub(crate) enum Incoming {
    Cloud { stamp_ns: i64 },
    Odometry { stamp_ns: i64, pose_odom_sensor: Pose },
}

/// Looks at a binary message: which it is, and whether its length is as declared.
pub(crate) fn look(bytes: &[u8]) -> Result<Incoming, String> {
    let Some((head, rest)) = bytes.split_at_checked(HEAD) else {
        return Err(format!("the message has {} bytes, its head alone takes {HEAD}", bytes.len()));
    };
    let n = u32::from_le_bytes([head[4], head[5], head[6], head[7]]);
    let mut stamp = [0; 8];
    stamp.copy_from_slice(&head[8..]);
    let stamp_ns = i64::from_le_bytes(stamp);
    match &head[..4] {
        b"ESMC" if rest.len() as u64 == u64::from(n) * POINT as u64 => Ok(Incoming::Cloud { stamp_ns }),
        b"ESMC" => {
            Err(format!("{n} points of {POINT} bytes are declared, {} bytes follow the head", rest.len()))
        }
        b"ESMO" if bytes.len() != ODOMETRY => {
            Err(format!("odometry has {ODOMETRY} bytes, the message has {}", bytes.len()))
        }
        b"ESMO" => {
            let mut v = [0.0; 7];
            for (v, b) in v.iter_mut().zip(rest.chunks_exact(8)) {
                let mut number = [0; 8];
                number.copy_from_slice(b);
                *v = f64::from_le_bytes(number);
            }
            let pose_odom_sensor = pose([v[0], v[1], v[2]], [v[3], v[4], v[5], v[6]])?;
            Ok(Incoming::Odometry { stamp_ns, pose_odom_sensor })
        }
        other => Err(format!("messages begin with ESMC or ESMO, not with '{}'", other.escape_ascii())),
    }
}

/// The points of a cloud that was looked at.
pub(crate) fn points(bytes: &[u8]) -> Scan {
    let body = bytes.get(HEAD..).unwrap_or_default();
    // Whole points, as was looked at; a cloud of none is an error of files only.
    scan_from_bytes(body, ScanFormat::Bin, "message", u64::MAX).unwrap_or_default()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    odometry: TextOdometry,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TextOdometry {
    stamp: f64,
    t: [f64; 3],
    q: [f64; 4],
}

/// Reads a text message: `{"odometry": {"stamp": seconds, "t": [x, y, z], "q": [x, y, z, w]}}`.
pub(crate) fn read_text(text: &str) -> Result<Incoming, String> {
    let Text { odometry } = serde_json::from_str(text).map_err(|e| e.to_string())?;
    let ns = odometry.stamp * 1e9;
    if ns.is_nan() || ns.abs() >= i64::MAX as f64 {
        return Err(format!("the stamp {} is no time", odometry.stamp));
    }
    let pose_odom_sensor = pose(odometry.t, odometry.q)?;
    Ok(Incoming::Odometry { stamp_ns: ns.round() as i64, pose_odom_sensor })
}

fn pose(t: [f64; 3], q: [f64; 4]) -> Result<Pose, String> {
    let quaternion = Quaternion::new(q[3], q[0], q[1], q[2]);
    let norm = quaternion.norm();
    if !t.iter().all(|v| v.abs() <= POSITION_LIMIT) || !(0.9..1.1).contains(&norm) {
        return Err("the numbers of the odometry are no pose".to_owned());
    }
    // A unit quaternion goes through bit by bit, so that what is sent is what is used.
    let rotation = match (norm - 1.0).abs() < 1e-12 {
        true => UnitQuaternion::new_unchecked(quaternion),
        false => UnitQuaternion::new_normalize(quaternion),
    };
    Ok(Pose::from_parts(Translation3::new(t[0], t[1], t[2]), rotation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_is_what_comes() {
        let points_sent = vec![[1.0, -2.0, 0.5], [4.0, 5.0, 6.0]];
        let bytes = Frame::Cloud { stamp_ns: -7, points: points_sent.clone() }.to_bytes();
        assert!(matches!(look(&bytes), Ok(Incoming::Cloud { stamp_ns: -7 })));
        assert_eq!(points(&bytes).cloud.points(), points_sent);
        let pose = Pose::new([1.0, 2.0, 3.0].into(), [0.1, -0.4, 2.0].into());
        let bytes = Frame::Odometry { stamp_ns: 1 << 60, pose_odom_sensor: pose }.to_bytes();
        let Ok(Incoming::Odometry { stamp_ns, pose_odom_sensor }) = look(&bytes) else { panic!() };
        assert_eq!((stamp_ns, pose_odom_sensor), (1 << 60, pose), "bit by bit");
        let empty = Frame::Cloud { stamp_ns: 0, points: vec![] }.to_bytes();
        assert!(look(&empty).is_ok() && points(&empty).cloud.is_empty());
    }

    #[test]
    fn what_is_wrong_is_told() {
        let cloud = Frame::Cloud { stamp_ns: 0, points: vec![[1.0; 3]; 2] }.to_bytes();
        let mut hostile = cloud.clone();
        hostile[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        let odometry = Frame::Odometry { stamp_ns: 0, pose_odom_sensor: Pose::identity() }.to_bytes();
        let mut zeros = odometry.clone();
        zeros[16..].fill(0);
        for (bytes, words) in [
            (&cloud[..10], "its head alone takes 16"),
            (&cloud[..40], "2 points of 16 bytes are declared, 24 bytes follow"),
            (&hostile, "4294967295 points"),
            (&odometry[..71], "odometry has 72 bytes"),
            (&zeros, "no pose"),
            (&[0xff; 40], "begin with ESMC"),
        ] {
            let told = look(bytes).unwrap_err();
            assert!(told.contains(words), "{told}");
        }
    }

    #[test]
    fn odometry_as_text() {
        let text = r#"{"odometry": {"stamp": 1.5, "t": [1, 2, 3], "q": [0, 0, 0, 1]}}"#;
        let Ok(Incoming::Odometry { stamp_ns, pose_odom_sensor }) = read_text(text) else { panic!() };
        assert_eq!((stamp_ns, pose_odom_sensor), (1_500_000_000, Pose::translation(1.0, 2.0, 3.0)));
        for bad in ["", "{}", "7", &text.replace("1.5", "1e300"), &text.replace("0, 1]", "0, 0]")] {
            assert!(read_text(bad).is_err(), "{bad}");
        }
    }
}

//! KITTI trajectories: the upper three rows of a 4 x 4 matrix, twelve numbers a line, one line a sweep.

use std::path::Path;

use esm_core::Pose;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};

use super::{HINT_RANGE, data_words, no_poses, out_of_range};
use crate::error::Error;
use crate::input::{Input, text, tokens};

/// How far a row's products may be from a rotation's; the published files have six digits.
const ROTATION_TOLERANCE: f64 = 1e-2;

const HINT_KITTI: &str = "a KITTI line has 12 numbers: r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz";

/// Reads a KITTI trajectory, one pose a line in metres; rotations are made exactly orthonormal.
///
/// The poses are taken as they stand: KITTI's own odometry files speak of the left camera, not of the lidar.
///
/// # Errors
/// [`Error::Malformed`] with the line that is no pose, [`Error::Empty`] where there is none, [`Error::Io`].
pub fn read_kitti_poses(path: impl AsRef<Path>) -> Result<Vec<Pose>, Error> {
    let mut input = Input::open(path.as_ref())?;
    let mut poses = Vec::new();
    let mut line = Vec::new();
    while input.next_line(&mut line)? {
        match data_words(&line) {
            0 => continue,
            12 => {}
            n => return Err(input.line_error(format!("{n} values, a KITTI line has 12"), HINT_KITTI)),
        }
        let mut v = [0.0; 12];
        for (slot, word) in v.iter_mut().zip(tokens(&line).map(text)) {
            *slot =
                word.parse().map_err(|_| input.line_error(format!("'{word}' is no number"), HINT_KITTI))?;
        }
        if let Some(what) = out_of_range([v[3], v[7], v[11]]) {
            return Err(input.line_error(what, HINT_RANGE));
        }
        let r = Matrix3::new(v[0], v[1], v[2], v[4], v[5], v[6], v[8], v[9], v[10]);
        let off = (r * r.transpose() - Matrix3::identity()).abs().max();
        // A NaN compares false, so this also asks for finite numbers.
        let is_rotation = off < ROTATION_TOLERANCE && r.determinant() > 0.0;
        if !is_rotation || ![v[3], v[7], v[11]].iter().all(|t| t.is_finite()) {
            return Err(input.line_error("the matrix is no rigid motion", HINT_KITTI));
        }
        let rotation =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(nearest_rotation(r)));
        poses.push(Pose::from_parts(Translation3::new(v[3], v[7], v[11]), rotation));
    }
    if poses.is_empty() { Err(no_poses(&input.path)) } else { Ok(poses) }
}

/// The rotation nearest to a matrix that almost is one: Newton's iteration for the polar decomposition.
fn nearest_rotation(mut r: Matrix3<f64>) -> Matrix3<f64> {
    for _ in 0..6 {
        // Within the tolerance above the matrix is far from singular.
        match r.try_inverse() {
            Some(inverse) => r = (r + inverse.transpose()) * 0.5,
            None => break,
        }
    }
    r
}

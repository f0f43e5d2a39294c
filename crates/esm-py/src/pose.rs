//! Poses as arrays: 4 x 4 homogeneous matrices of float64.

use esm_core::Pose;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::input::{bad_value, exactly};
use crate::output::{fixed, table};

/// How far the rows of a rotation may be from orthonormal: matrices of float32 numbers are meant to pass.
const ORTHONORMAL: f64 = 1e-4;

/// Reads a pose, shape (4, 4).
pub(crate) fn read(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Pose> {
    from_row_major(&exactly(value, name, &[4, 4])?).map_err(|what| bad_value(name, what))
}

/// Reads a pose that may be missing.
pub(crate) fn read_option(value: Option<&Bound<'_, PyAny>>, name: &str) -> PyResult<Option<Pose>> {
    value.map(|v| read(v, name)).transpose()
}

/// A pose from 16 numbers, or what is wrong with them.
pub(crate) fn from_row_major(m: &[f64]) -> Result<Pose, String> {
    if let Some(n) = m.iter().position(|v| !v.is_finite()) {
        return Err(format!("must be finite, row {} column {} is not", n / 4, n % 4));
    }
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(format!("must end with the row 0 0 0 1, not {} {} {} {}", m[12], m[13], m[14], m[15]));
    }
    let rotation = Matrix3::new(m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]);
    let off = (rotation * rotation.transpose() - Matrix3::identity()).abs().max();
    if off > ORTHONORMAL || rotation.determinant() < 0.0 {
        return Err(format!(
            "must be a rigid motion: its upper left 3 x 3 numbers are no rotation (determinant {:.6}, {off:.1e} off)",
            rotation.determinant()
        ));
    }
    let turn = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let turn = UnitQuaternion::new_normalize(turn.into_inner());
    Ok(Pose::from_parts(Vector3::new(m[3], m[7], m[11]).into(), turn))
}

/// The 16 numbers of a pose, row by row.
pub(crate) fn row_major(pose: &Pose) -> [f64; 16] {
    let m = pose.to_homogeneous();
    std::array::from_fn(|n| m[(n / 4, n % 4)])
}

/// A pose as an array of shape (4, 4).
pub(crate) fn write<'py>(py: Python<'py>, pose: &Pose) -> PyResult<Bound<'py, PyArray2<f64>>> {
    table(py, row_major(pose).to_vec(), 4)
}

/// The same, of a result object.
pub(crate) fn fixed_pose(py: Python<'_>, pose: &Pose) -> PyResult<Py<PyAny>> {
    Ok(fixed(write(py, pose)?)?.unbind())
}

/// The same where there may be none.
pub(crate) fn fixed_option(py: Python<'_>, pose: Option<&Pose>) -> PyResult<Option<Py<PyAny>>> {
    pose.map(|p| fixed_pose(py, p)).transpose()
}

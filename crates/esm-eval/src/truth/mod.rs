//! How results are judged against the truth. The protocol, all of it:
//!
//! - the truth is interpolated at a cloud's stamp; a cloud outside it, or in a gap of it, is not counted: a gap is more
//!   than 2 s, and more than 3 times the median spacing of the truth;
//! - correct: located within 2 m and 5 degrees of the truth; false: located and not correct;
//! - localizable: the true position is within 10 m of the mapped path, or, in a map of a prior cloud, in a 5 m cell
//!   that holds points;
//! - recall: correct among the localizable clouds that hold at least 95 % of the asked travel;
//! - false ones are counted over all clouds.

mod file;
mod places;
mod tally;
mod trajectory;

pub use file::read;
pub use places::Places;
pub use tally::{Judgement, Quantiles, Tally};
pub use trajectory::Trajectory;

use esm_core::Pose;

/// Farthest a correct pose lies from the truth, metres.
pub const CORRECT_M: f64 = 2.0;
/// Farthest a correct pose is turned from the truth, degrees.
pub const CORRECT_DEG: f64 = 5.0;
/// Farthest a localizable position lies from the mapped path, metres.
pub const LOCALIZABLE_M: f64 = 10.0;
/// Share of the asked travel that a cloud must hold to count for recall.
pub const TRAVEL_SHARE: f64 = 0.95;

/// How far a pose is from the truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Metres.
    pub m: f64,
    /// Degrees.
    pub deg: f64,
}

impl PoseError {
    /// Of `pose` against `truth`, both of the same frames.
    pub fn between(pose: &Pose, truth: &Pose) -> Self {
        let m = (pose.translation.vector - truth.translation.vector).norm();
        // Through the vector part: the arc cosine of a dot product cannot resolve small angles.
        let turn = (truth.rotation.inverse() * pose.rotation).into_inner();
        let deg = (2.0 * turn.imag().norm().atan2(turn.w.abs())).to_degrees();
        Self { m, deg }
    }

    /// Whether a located pose with this error counts as correct.
    pub fn is_correct(self) -> bool {
        self.m <= CORRECT_M && self.deg <= CORRECT_DEG
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn errors_are_metres_and_degrees() {
        let truth = Pose::new(Vector3::new(1e6, 2e6, 3.0), Vector3::z() * 1.0);
        let turn = UnitQuaternion::new(Vector3::x() * 0.05);
        let pose = Pose::from_parts(
            (truth.translation.vector + Vector3::new(3.0, 4.0, 0.0)).into(),
            turn * truth.rotation,
        );
        let error = PoseError::between(&pose, &truth);
        assert!((error.m - 5.0).abs() < 1e-9);
        assert!((error.deg - 0.05f64.to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn a_quaternion_and_its_negative_are_the_same_turn() {
        let truth = Pose::rotation(Vector3::z() * 3.1);
        let negative = UnitQuaternion::new_unchecked(-truth.rotation.into_inner());
        let pose = Pose::from_parts(truth.translation, negative);
        assert!(PoseError::between(&pose, &truth).deg < 1e-9);
    }

    #[test]
    fn both_limits_count_as_correct() {
        assert!(PoseError { m: 2.0, deg: 5.0 }.is_correct());
        assert!(!PoseError { m: 2.001, deg: 0.0 }.is_correct());
        assert!(!PoseError { m: 0.0, deg: 5.001 }.is_correct());
    }
}

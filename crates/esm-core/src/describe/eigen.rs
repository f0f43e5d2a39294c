//! [`Eigen`]: the 7 eigenvalue features of SegMatch (Dube et al., ICRA 2017), scale-free shape.
//!
//! With l1 >= l2 >= l3 the eigenvalues of the segment's covariance, normalised to sum 1: linearity, planarity,
//! scattering, omnivariance, anisotropy, eigenentropy and change of curvature, by their intended formulas
//! (SegMatch's released code sorts the eigenvalues ascending, which swaps the roles in four of them).

use nalgebra::{Matrix3, SymmetricEigen};
use rayon::prelude::*;

use super::{Descriptions, Descriptor};
use crate::segment::Segment;

/// Numbers of the eigenvalue features.
pub(super) const EIGEN_DIM: usize = 7;

/// Floor of an eigenvalue in square metres: (1 mm)^2, far below the range noise of any LiDAR, keeps logarithms
/// finite on perfectly flat or straight segments.
const EIGENVALUE_FLOOR: f64 = 1e-6;

/// The 7 eigenvalue features, dimensionless.
#[derive(Clone, Copy, Debug, Default)]
pub struct Eigen;

impl Descriptor for Eigen {
    fn name(&self) -> &'static str {
        "eigen"
    }

    fn version(&self) -> u32 {
        1
    }

    fn dim(&self) -> usize {
        EIGEN_DIM
    }

    fn standardized(&self) -> bool {
        true
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        rows(EIGEN_DIM, segments, |segment, row| row.copy_from_slice(&features(eigenvalues(segment))))
    }
}

/// Fills one row a segment, in parallel; every quality is 1, because hand-made features cannot tell.
pub(super) fn rows(
    dim: usize,
    segments: &[Segment],
    fill: impl Fn(&Segment, &mut [f32]) + Sync,
) -> Descriptions {
    let mut values = vec![0.0; dim * segments.len()];
    values.par_chunks_mut(dim).zip(segments).for_each(|(row, segment)| fill(segment, row));
    Descriptions { dim, values, quality: vec![1.0; segments.len()], ..Descriptions::default() }
}

/// Covariance of the points about their mean, in square metres.
pub(super) fn covariance(segment: &Segment) -> Matrix3<f64> {
    let mean = segment.centroid.map(f64::from);
    let mut sum = Matrix3::zeros();
    for p in &segment.points {
        let d = nalgebra::Vector3::new(p[0] as f64 - mean[0], p[1] as f64 - mean[1], p[2] as f64 - mean[2]);
        sum += d * d.transpose();
    }
    sum / segment.points.len().max(1) as f64
}

/// Eigenvalues of the covariance, descending, floored.
pub(super) fn eigenvalues(segment: &Segment) -> [f64; 3] {
    let values = SymmetricEigen::new(covariance(segment)).eigenvalues;
    let mut l = [values[0], values[1], values[2]].map(|v| v.max(EIGENVALUE_FLOOR));
    l.sort_by(|a, b| b.total_cmp(a));
    l
}

/// The 7 features from the eigenvalues in square metres, descending.
pub(super) fn features(eigenvalues: [f64; 3]) -> [f32; EIGEN_DIM] {
    let sum: f64 = eigenvalues.iter().sum();
    let [l1, l2, l3] = eigenvalues.map(|l| l / sum);
    let linearity = (l1 - l2) / l1;
    let planarity = (l2 - l3) / l1;
    let scattering = l3 / l1;
    let omnivariance = (l1 * l2 * l3).cbrt();
    let anisotropy = (l1 - l3) / l1;
    let eigenentropy = -(l1 * l1.ln() + l2 * l2.ln() + l3 * l3.ln());
    let change_of_curvature = l3 / (l1 + l2 + l3);
    [linearity, planarity, scattering, omnivariance, anisotropy, eigenentropy, change_of_curvature]
        .map(|v| v as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_have_their_intended_values() {
        // l = (4, 2, 1) / 7, computed by hand.
        let f = features([4.0, 2.0, 1.0]);
        let want = [0.5, 0.25, 0.25, (8.0f64 / 343.0).cbrt(), 0.75, 0.955_699_9, 1.0 / 7.0];
        for (a, b) in f.iter().zip(want) {
            assert!((*a as f64 - b).abs() < 1e-6, "{a} {b}");
        }
    }

    #[test]
    fn a_line_is_linear_a_plate_planar_a_ball_scattered() {
        let line = features([1.0, 1e-6, 1e-6]);
        let plate = features([1.0, 1.0, 1e-6]);
        let ball = features([1.0, 1.0, 1.0]);
        assert!(line[0] > 0.99 && plate[1] > 0.99 && ball[2] > 0.99);
    }

    #[test]
    fn one_point_gives_finite_numbers() {
        let segment = Segment::from_points(vec![[1.0, 2.0, 3.0]]).unwrap();
        assert!(Eigen.describe(&[segment]).values.iter().all(|v| v.is_finite()));
    }
}

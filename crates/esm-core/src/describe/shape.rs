//! [`Shape`]: the eigenvalue features beside the segment's metric size.
//!
//! Scale-free features throw away how big an object is, and size is worth as much as shape: 13 numbers, the 7 of
//! [`Eigen`](super::Eigen), then the logs of the three standard deviations along the principal axes, of the height,
//! and of the two horizontal extents (along the principal axes of the ground projection, longer first), in metres.

use nalgebra::{Matrix2, SymmetricEigen};

use super::eigen::{EIGEN_DIM, eigenvalues, features, rows};
use super::{Descriptions, Descriptor};
use crate::segment::Segment;

const SHAPE_DIM: usize = EIGEN_DIM + 6;

/// Floor of a length before its log: half a voxel of the default 0.2 m, so that a flat object's thickness, which is
/// noise, does not dominate.
const LENGTH_FLOOR: f64 = 0.1;

/// The 7 eigenvalue features and 6 log lengths. Assumes z up.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shape;

impl Descriptor for Shape {
    fn name(&self) -> &'static str {
        "shape"
    }

    fn version(&self) -> u32 {
        1
    }

    fn dim(&self) -> usize {
        SHAPE_DIM
    }

    fn standardized(&self) -> bool {
        true
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        rows(SHAPE_DIM, segments, |segment, row| {
            let values = eigenvalues(segment);
            row[..EIGEN_DIM].copy_from_slice(&features(values));
            for (out, size) in row[EIGEN_DIM..].iter_mut().zip(log_lengths(segment, values)) {
                *out = size as f32;
            }
        })
    }
}

/// The 6 log sizes of a segment: deviations along the principal axes (longest first), height, horizontal extents.
pub(super) fn log_sizes(segment: &Segment) -> [f64; 6] {
    log_lengths(segment, eigenvalues(segment))
}

fn log_lengths(segment: &Segment, eigenvalues: [f64; 3]) -> [f64; 6] {
    let [long, wide] = horizontal_extents(segment);
    let height = (segment.max[2] - segment.min[2]) as f64;
    let [a, b, c] = eigenvalues.map(f64::sqrt);
    [a, b, c, height, long, wide].map(|length| (length + LENGTH_FLOOR).ln())
}

/// Extents in metres along the principal axes of the points' ground projection, longer first.
fn horizontal_extents(segment: &Segment) -> [f64; 2] {
    let (cx, cy) = (segment.centroid[0] as f64, segment.centroid[1] as f64);
    let mut c = Matrix2::zeros();
    for p in &segment.points {
        let d = nalgebra::Vector2::new(p[0] as f64 - cx, p[1] as f64 - cy);
        c += d * d.transpose();
    }
    let axes = SymmetricEigen::new(c).eigenvectors;
    let mut extents = [0, 1].map(|a| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for p in &segment.points {
            let t = axes[(0, a)] * (p[0] as f64 - cx) + axes[(1, a)] * (p[1] as f64 - cy);
            (low, high) = (low.min(t), high.max(t));
        }
        (high - low).max(0.0)
    });
    extents.sort_by(|a, b| b.total_cmp(a));
    extents
}

#[cfg(test)]
mod tests {
    use super::*;

    fn box_of(length: f32, width: f32, height: f32, yaw: f32) -> Segment {
        let (sin, cos) = yaw.sin_cos();
        let mut points = Vec::new();
        for i in 0..=20 {
            for j in 0..=10 {
                for k in 0..=10 {
                    let (x, y) = (length * (i as f32 / 20.0 - 0.5), width * (j as f32 / 10.0 - 0.5));
                    points.push([cos * x - sin * y, sin * x + cos * y, height * k as f32 / 10.0]);
                }
            }
        }
        Segment::from_points(points).unwrap()
    }

    #[test]
    fn sizes_are_metric() {
        let d = Shape.describe(&[box_of(4.0, 2.0, 1.5, 0.3)]);
        let lengths: Vec<f64> = d.values[EIGEN_DIM..].iter().map(|v| v.exp() as f64 - LENGTH_FLOOR).collect();
        for (got, want) in lengths[3..].iter().zip([1.5, 4.0, 2.0]) {
            assert!((got - want).abs() < 1e-3, "{lengths:?}");
        }
    }

    #[test]
    fn yaw_changes_nothing() {
        let d = Shape.describe(&[box_of(4.0, 2.0, 1.5, 0.0), box_of(4.0, 2.0, 1.5, 1.1)]);
        for (a, b) in d.values[..13].iter().zip(&d.values[13..]) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }
}

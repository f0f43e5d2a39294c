//! [`PointCloud`]: points of one frame, finite by construction.

use nalgebra::Isometry3;

use crate::error::Error;

/// A rigid motion in f64, named by its frames: `pose_map_sensor` maps sensor coordinates to map coordinates.
pub type Pose = Isometry3<f64>;

/// Points in metres in one frame. Every coordinate is finite: the constructors see to it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    points: Vec<[f32; 3]>,
}

impl PointCloud {
    /// Wraps points that must all be finite.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`] with the index of the first point that holds a NaN or an infinity.
    pub fn try_new(points: Vec<[f32; 3]>) -> Result<Self, Error> {
        match points.iter().position(|p| !is_finite(p)) {
            Some(index) => Err(Error::NonFinitePoint { index }),
            None => Ok(Self { points }),
        }
    }

    /// Keeps the finite points, in their order, and says how many were dropped.
    pub fn from_finite(mut points: Vec<[f32; 3]>) -> (Self, usize) {
        let before = points.len();
        points.retain(is_finite);
        let dropped = before - points.len();
        (Self { points }, dropped)
    }

    /// The points, `[x, y, z]` in metres.
    pub fn points(&self) -> &[[f32; 3]] {
        &self.points
    }

    /// The points, by value.
    pub fn into_points(self) -> Vec<[f32; 3]> {
        self.points
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there is no point at all.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }
}

fn is_finite(p: &[f32; 3]) -> bool {
    p.iter().all(|v| v.is_finite())
}

/// Applies a pose to one point: computed in f64, rounded once.
pub fn transform_point(pose_a_b: &Pose, point_b: [f32; 3]) -> [f32; 3] {
    let p = pose_a_b * nalgebra::Point3::new(point_b[0] as f64, point_b[1] as f64, point_b[2] as f64);
    [p.x as f32, p.y as f32, p.z as f32]
}

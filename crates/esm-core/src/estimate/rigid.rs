//! Rigid alignment of matched points: the `Estimator` of the pose search.

use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::cloud::Pose;

/// A matched pair: where the segment is in the live cloud and where its counterpart is in the map, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Centroid in the sensor frame.
    pub live: [f32; 3],
    /// Centroid in the map frame.
    pub map: [f32; 3],
}

/// Fits a pose to matched pairs.
pub trait Estimator: Sync {
    /// Pairs a minimal sample needs.
    fn sample_size(&self) -> usize;
    /// Least-squares `pose_map_sensor`; `None` where the pairs do not fix one (too few, coincident, collinear).
    fn estimate(&self, pairs: &[Pair]) -> Option<Pose>;
}

/// All six degrees of freedom, from three pairs that are not collinear (Umeyama 1991, without scale).
#[derive(Clone, Copy, Debug, Default)]
pub struct SixDof;

/// Yaw and translation, from two pairs that do not stand above each other: both frames have z up.
#[derive(Clone, Copy, Debug, Default)]
pub struct FourDof;

/// Second singular value of the pairs' scatter, relative to the first, below which they count as collinear.
const COLLINEAR: f64 = 1e-6;

impl Estimator for SixDof {
    fn sample_size(&self) -> usize {
        3
    }

    fn estimate(&self, pairs: &[Pair]) -> Option<Pose> {
        if pairs.len() < self.sample_size() {
            return None;
        }
        let (mean_live, mean_map) = means(pairs);
        let mut h = Matrix3::zeros();
        for p in pairs {
            h += (vector(p.live) - mean_live) * (vector(p.map) - mean_map).transpose();
        }
        let svd = h.svd(true, true);
        let (u, v) = (svd.u?, svd.v_t?.transpose());
        if svd.singular_values[1] <= COLLINEAR * svd.singular_values[0] {
            return None;
        }
        // A reflection fits planar points as well as a rotation does: take the rotation.
        let flip =
            Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (v * u.transpose()).determinant().signum()));
        let rotation = Rotation3::from_matrix_unchecked(v * flip * u.transpose());
        let translation = mean_map - rotation * mean_live;
        Some(Pose::from_parts(
            Translation3::from(translation),
            UnitQuaternion::from_rotation_matrix(&rotation),
        ))
    }
}

impl Estimator for FourDof {
    fn sample_size(&self) -> usize {
        2
    }

    fn estimate(&self, pairs: &[Pair]) -> Option<Pose> {
        if pairs.len() < self.sample_size() {
            return None;
        }
        let (mean_live, mean_map) = means(pairs);
        let (mut dot, mut cross) = (0.0, 0.0);
        for p in pairs {
            let (a, b) = (vector(p.live) - mean_live, vector(p.map) - mean_map);
            dot += a.x * b.x + a.y * b.y;
            cross += a.x * b.y - a.y * b.x;
        }
        if dot.hypot(cross) < 1e-9 {
            return None;
        }
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), cross.atan2(dot));
        Some(Pose::from_parts(Translation3::from(mean_map - rotation * mean_live), rotation))
    }
}

pub(super) fn vector(p: [f32; 3]) -> Vector3<f64> {
    Vector3::new(p[0] as f64, p[1] as f64, p[2] as f64)
}

fn means(pairs: &[Pair]) -> (Vector3<f64>, Vector3<f64>) {
    let n = pairs.len() as f64;
    let (mut live, mut map) = (Vector3::zeros(), Vector3::zeros());
    for p in pairs {
        live += vector(p.live);
        map += vector(p.map);
    }
    (live / n, map / n)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cloud::transform_point;

    fn pairs(pose: &Pose, live: &[[f32; 3]]) -> Vec<Pair> {
        live.iter().map(|&l| Pair { live: l, map: transform_point(pose, l) }).collect()
    }

    proptest! {
        #[test]
        fn a_known_pose_is_recovered(
            t in prop::array::uniform3(-500.0f64..500.0),
            r in prop::array::uniform3(-3.0f64..3.0),
            live in prop::collection::vec(prop::array::uniform3(-50.0f32..50.0), 4..20),
        ) {
            let pose = Pose::new(Vector3::from(t), Vector3::from(r));
            if let Some(found) = SixDof.estimate(&pairs(&pose, &live)) {
                prop_assert!(found.rotation.angle_to(&pose.rotation) < 1e-3);
                let p = [1.0, 2.0, 3.0];
                let (a, b) = (vector(transform_point(&found, p)), vector(transform_point(&pose, p)));
                prop_assert!((a - b).norm() < 2e-2);
            }
            let yaw = Pose::new(Vector3::from(t), Vector3::new(0.0, 0.0, r[2]));
            let found = FourDof.estimate(&pairs(&yaw, &live[..2])).unwrap();
            prop_assert!(found.rotation.angle_to(&yaw.rotation) < 1e-2);
        }
    }

    #[test]
    fn degenerate_samples_yield_no_model() {
        let pose = Pose::translation(1.0, 2.0, 3.0);
        let line = pairs(&pose, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert!(SixDof.estimate(&line).is_none());
        assert!(SixDof.estimate(&line[..2]).is_none());
        let stacked = pairs(&pose, &[[0.0, 0.0, 0.0], [0.0, 0.0, 4.0]]);
        assert!(FourDof.estimate(&stacked).is_none());
        let same = pairs(&pose, &[[1.0, 1.0, 0.0]; 3]);
        assert!(SixDof.estimate(&same).is_none() && FourDof.estimate(&same[..2]).is_none());
    }
}

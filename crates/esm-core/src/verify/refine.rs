//! Refinement of a pose on points: Gauss-Newton on point-to-Gaussian distances (the normal distributions transform
//! of Biber and Strasser 2003, Magnusson 2009), robust against what has changed.

use nalgebra::{Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

use super::surface::{LEVELS_M, Surface};
use crate::cloud::Pose;

/// The coarse and the fine level of the surface.
const COARSE: usize = 0;
const FINE: usize = LEVELS_M.len() - 1;
/// Iterations a level at most. A sensor that leans by ten degrees needs a dozen coarse ones: places are found upright.
const ITERATIONS: [usize; LEVELS_M.len()] = [20, 10];
/// A level is settled when a step moves less than this, metres and radians.
const SETTLED: [f64; LEVELS_M.len()] = [1e-3, 1e-4];
/// Points that are enough for the coarse level.
const COARSE_POINTS: usize = 500;
/// Mahalanobis distance at which a point's weight has fallen to a quarter (Geman-McClure).
const KERNEL: f64 = 3.0;
/// Neighbouring points of a cloud see the same surface and the same errors: this many count as one measurement. Fitted, with the
/// defaults of [`OdometryConfig`](crate::OdometryConfig), on clouds of simulated tuning worlds (seeds 120 and 122).
const CORRELATED_POINTS: f64 = 6.5;

/// A refined pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Pose of the live sensor in the map.
    pub pose_map_sensor: Pose,
    /// Covariance of what the points tell, order x y z rx ry rz in m and rad, of a right perturbation in the sensor frame; `None` where the
    /// points do not fix the pose.
    pub covariance: Option<Matrix6<f64>>,
    /// Root mean square distance to the map's surface, in standard deviations, of the points that count.
    pub residual: f64,
}

/// Refines `pose_map_sensor` so that `points_sensor` come to lie on the map's surface: [`approach`], then [`settle`].
pub fn refine(surface: &Surface, points_sensor: &[[f32; 3]], pose_map_sensor: &Pose) -> Refined {
    settle(surface, points_sensor, &approach(surface, points_sensor, pose_map_sensor))
}

/// The first part of the refinement, from a metre and ten degrees to some centimetres, on the coarse level and few points.
pub fn approach(surface: &Surface, points_sensor: &[[f32; 3]], pose_map_sensor: &Pose) -> Pose {
    let step = (points_sensor.len() / COARSE_POINTS).max(1);
    descend(surface, COARSE, &vectors(points_sensor, step), pose_map_sensor)
}

/// The second part, on the fine level, from where [`approach`] ends.
pub fn settle(surface: &Surface, points_sensor: &[[f32; 3]], pose_map_sensor: &Pose) -> Refined {
    let pose = descend(surface, FINE, &vectors(points_sensor, 1), pose_map_sensor);
    rate(surface, points_sensor, &pose)
}

/// How well a pose stands as it is.
pub fn rate(surface: &Surface, points_sensor: &[[f32; 3]], pose_map_sensor: &Pose) -> Refined {
    let system = System::new(surface, FINE, &vectors(points_sensor, 1), pose_map_sensor);
    Refined {
        pose_map_sensor: *pose_map_sensor,
        covariance: system.covariance(),
        residual: system.residual(),
    }
}

fn vectors(points: &[[f32; 3]], step: usize) -> Vec<Vector3<f64>> {
    points.iter().step_by(step).map(|p| Vector3::from(*p).cast()).collect()
}

fn descend(surface: &Surface, level: usize, points: &[Vector3<f64>], from: &Pose) -> Pose {
    let mut pose = *from;
    for _ in 0..ITERATIONS[level] {
        let Some(step) = System::new(surface, level, points, &pose).step() else { break };
        pose = perturb(&pose, &step);
        if step.norm() < SETTLED[level] {
            break;
        }
    }
    pose
}

/// The normal equations of one Gauss-Newton step.
struct System {
    h: Matrix6<f64>,
    g: Vector6<f64>,
    weight: f64,
    squared: f64,
}

impl System {
    fn new(surface: &Surface, level: usize, points: &[Vector3<f64>], pose: &Pose) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        let r: &Matrix3<f64> = rotation.matrix();
        // Blocks of the normal equations for a perturbation along the map's axes about the sensor: J = [I | -[q]x] with q = R p is
        // cheap there; all points share the rotation into the sensor frame.
        let (mut tt, mut tr, mut rr) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        let (mut gt, mut gr) = (Vector3::zeros(), Vector3::zeros());
        let (mut weight, mut squared) = (0.0, 0.0);
        for p in points {
            let q = r * p;
            let at = q + pose.translation.vector;
            let Some(gaussian) = surface.nearest(level, &at) else { continue };
            let e = at - gaussian.mean;
            let b = gaussian.information * e;
            let s = e.dot(&b);
            let w = (KERNEL * KERNEL / (KERNEL * KERNEL + s)).powi(2);
            let m = gaussian.information * w;
            let b = b * w;
            // M [q]x, column by column: M is symmetric.
            let skew = q.cross_matrix();
            let ms = m * skew;
            tt += m;
            tr -= ms;
            rr += skew.tr_mul(&ms);
            gt += b;
            gr += q.cross(&b);
            weight += w;
            squared += w * s;
        }
        let turned = |m: Matrix3<f64>| r.tr_mul(&m) * r;
        let (tt, tr, rr) = (turned(tt), turned(tr), turned(rr));
        let mut h = Matrix6::zeros();
        h.fixed_view_mut::<3, 3>(0, 0).copy_from(&tt);
        h.fixed_view_mut::<3, 3>(0, 3).copy_from(&tr);
        h.fixed_view_mut::<3, 3>(3, 0).copy_from(&tr.transpose());
        h.fixed_view_mut::<3, 3>(3, 3).copy_from(&rr);
        let (gt, gr) = (r.tr_mul(&gt), r.tr_mul(&gr));
        Self { h, g: Vector6::new(gt.x, gt.y, gt.z, gr.x, gr.y, gr.z), weight, squared }
    }

    fn step(&self) -> Option<Vector6<f64>> {
        let step = -(self.h.cholesky()?.solve(&self.g));
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    fn residual(&self) -> f64 {
        if self.weight > 0.0 { (self.squared / self.weight).sqrt() } else { f64::INFINITY }
    }

    fn covariance(&self) -> Option<Matrix6<f64>> {
        let inverse = self.h.cholesky()?.inverse();
        let scale = (self.squared / self.weight.max(1.0)).max(1.0) * CORRELATED_POINTS;
        inverse.iter().all(|v| v.is_finite()).then_some(inverse * scale)
    }
}

/// pose * Exp(step) with step = (translation, rotation vector) in the sensor frame.
fn perturb(pose: &Pose, step: &Vector6<f64>) -> Pose {
    let translation = Translation3::new(step[0], step[1], step[2]);
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
    let mut moved = pose * Pose::from_parts(translation, rotation);
    moved.rotation.renormalize();
    moved
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::cloud::transform_point;
    use crate::map::tile_of;
    use crate::verify::surface::Tile;

    /// A street: ground, two facades with a bend, side walls and poles, in the map frame.
    fn street() -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let (mut objects, mut ground) = (Vec::new(), Vec::new());
        for i in 0..200 {
            for j in 0..60 {
                let (x, y) = (i as f32 * 0.2, j as f32 * 0.2 - 6.0);
                ground.push([x, y, 0.01 * x]);
            }
            for k in 0..15 {
                objects.push([i as f32 * 0.2, 6.0 + (i / 50) as f32, k as f32 * 0.2 + 0.3]);
                objects.push([i as f32 * 0.2, -6.0, k as f32 * 0.2 + 0.3]);
                if i % 25 == 0 {
                    objects.push([i as f32 * 0.2, 4.0, k as f32 * 0.2 + 0.3]);
                    // Side walls between the houses.
                    objects.extend(
                        (0..20).map(|j| [i as f32 * 0.2, -6.0 - j as f32 * 0.2, k as f32 * 0.2 + 0.3]),
                    );
                }
            }
        }
        (objects, ground)
    }

    /// The points in their tiles, as the map would hold them.
    fn surface_of(structure: &[[f32; 3]], ground: &[[f32; 3]]) -> Surface {
        let in_tile =
            |points: &[[f32; 3]], key| points.iter().copied().filter(|p| tile_of(*p) == key).collect();
        let tiles = (-3..9)
            .flat_map(|y| (-3..9).map(move |x| [x, y]))
            .map(|key| {
                let (structure, ground): (Vec<_>, Vec<_>) = (in_tile(structure, key), in_tile(ground, key));
                Some(Arc::new(Tile::new(key, &structure, &ground)))
            })
            .collect();
        Surface::new([-3, -3], 12, tiles)
    }

    #[test]
    fn a_known_pose_is_found_from_half_a_metre_and_two_degrees() {
        let (objects, ground) = street();
        let surface = surface_of(&objects, &ground);
        let truth = Pose::new(Vector3::new(20.0, 0.5, 1.7), Vector3::new(0.01, 0.02, 0.4));
        let live: Vec<[f32; 3]> =
            objects.iter().chain(&ground).step_by(7).map(|p| transform_point(&truth.inverse(), *p)).collect();
        let guess = Pose::new(Vector3::new(20.4, 0.2, 1.9), Vector3::new(0.0, 0.0, 0.435));
        let found = refine(&surface, &live, &guess);
        let error = truth.inv_mul(&found.pose_map_sensor);
        assert!(error.translation.vector.norm() < 0.05, "{error}");
        assert!(error.rotation.angle() < 0.003, "{error}");
        assert!(found.covariance.is_some());
    }

    #[test]
    fn a_sensor_that_leans_by_ten_degrees_is_found_from_upright() {
        let (objects, ground) = street();
        let surface = surface_of(&objects, &ground);
        let truth = Pose::new(Vector3::new(20.0, 0.5, 1.7), Vector3::new(0.14, 0.1, 0.4));
        let live: Vec<[f32; 3]> =
            objects.iter().chain(&ground).step_by(7).map(|p| transform_point(&truth.inverse(), *p)).collect();
        let guess = Pose::new(Vector3::new(20.2, 0.3, 1.5), Vector3::new(0.0, 0.0, 0.38));
        let error = truth.inv_mul(&refine(&surface, &live, &guess).pose_map_sensor);
        assert!(error.translation.vector.norm() < 0.05, "{error}");
        assert!(error.rotation.angle() < 0.003, "{error}");
    }

    #[test]
    fn without_a_map_the_pose_stays_and_has_no_covariance() {
        let pose = Pose::translation(1.0, 2.0, 3.0);
        let found = refine(&Surface::new([0, 0], 0, Vec::new()), &[[1.0, 0.0, 0.0]], &pose);
        assert_eq!((found.pose_map_sensor, found.covariance), (pose, None));
    }
}

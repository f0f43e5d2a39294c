//! Free space: live rays that pass through what the map holds as solid speak against a place, however well its points fit.

use nalgebra::{Point3, Vector3};

use super::surface::Surface;
use crate::accumulate::LiveCloud;
use crate::cloud::Pose;

/// Rays to points nearer than this tell little, metres.
const NEAR_M: f32 = 3.0;
/// Farther than this nothing is looked at, metres: bounds the effort, and what a wrong angle may do.
const FAR_M: f64 = 30.0;
/// A ray may meet what its point lies on this much before the point, and what carries the sensor after it, metres.
const MARGIN_M: f64 = 1.0;
/// What is thinner than this along the ray, metres (standard deviation), is a surface and stops it: leaves and bushes are
/// thicker, and so is ground that is grazed.
const THIN_M: f64 = 0.1;
/// It is met within this Mahalanobis distance (squared) of its middle. A wall that fills its voxel is met in a quarter of it: near
/// the rim it may as well end (with 3.0, which is all of it, right places were hardly better than false ones).
const WITHIN: f64 = 1.0;

/// A live ray in the sensor frame, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the sensor was.
    pub from: Point3<f64>,
    /// What it saw.
    pub to: Point3<f64>,
}

/// An even sample of a cloud's rays, `most` of them; none where it is not known where its points were seen from.
pub fn rays(live: &LiveCloud, most: usize) -> Vec<Ray> {
    let points = live.cloud.points();
    let known = live.viewpoints.iter().map(|v| v.points).sum::<usize>().min(points.len());
    let step = known.div_ceil(most.max(1)).max(1);
    let (mut sample, mut first) = (Vec::with_capacity(known / step + 1), 0);
    for view in &live.viewpoints {
        let end = (first + view.points).min(known);
        for p in (first.next_multiple_of(step)..end).step_by(step).map(|i| points[i]) {
            let d = [0, 1, 2].map(|a| p[a] - view.origin_sensor[a]);
            if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > NEAR_M * NEAR_M {
                sample
                    .push(Ray { from: Point3::from(view.origin_sensor).cast(), to: Point3::from(p).cast() });
            }
        }
        first = end;
    }
    sample
}

/// Share of the rays that pass through surfaces of the map well before they reach what they saw, 0 to 1; 0 without rays.
///
/// What has gone since the map was made (a parked car, leaves) lets some rays through; a place that is a false one sends
/// them through walls. What has come hides, and speaks against nothing.
pub fn free_space_violated(surface: &Surface, rays: &[Ray], pose_map_sensor: &Pose) -> f64 {
    let through = rays.iter().filter(|ray| is_through(surface, ray, pose_map_sensor)).count();
    through as f64 / rays.len().max(1) as f64
}

fn is_through(surface: &Surface, ray: &Ray, pose_map_sensor: &Pose) -> bool {
    let from = (pose_map_sensor * ray.from).coords;
    let way = (pose_map_sensor * ray.to).coords - from;
    let length = way.norm();
    let direction = way / length;
    let (start, end) = (MARGIN_M, length.min(FAR_M) - MARGIN_M);
    let edge = Surface::FINEST_M;
    // The voxels along the way, one after the other (Amanatides and Woo 1987).
    let at = from + direction * start;
    let mut voxel = [0, 1, 2].map(|a| (at[a] / edge).floor() as i32);
    let (mut next, mut delta) = ([f64::INFINITY; 3], [f64::INFINITY; 3]);
    for a in 0..3 {
        if direction[a] != 0.0 {
            let border = f64::from(voxel[a] + i32::from(direction[a] > 0.0)) * edge;
            next[a] = start + (border - at[a]) / direction[a];
            delta[a] = edge / direction[a].abs();
        }
    }
    let mut s = start;
    while s < end {
        if let Some(gaussian) = surface.gaussian(voxel) {
            let thin = gaussian.information * direction;
            let along = direction.dot(&thin);
            // Where the ray comes nearest to the middle, in Mahalanobis distance.
            let nearest = thin.dot(&(gaussian.mean - from)) / along;
            if along > 1.0 / (THIN_M * THIN_M) && nearest > start && nearest < end {
                let e: Vector3<f64> = from + direction * nearest - gaussian.mean;
                if e.dot(&(gaussian.information * e)) < WITHIN {
                    return true;
                }
            }
        }
        let a = if next[0] <= next[1] && next[0] <= next[2] { 0 } else { 1 + usize::from(next[2] < next[1]) };
        s = next[a];
        voxel[a] += if direction[a] > 0.0 { 1 } else { -1 };
        next[a] += delta[a];
    }
    false
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::verify::surface::Tile;

    /// A wall across the way at x = 5 m, 4 m wide, and a loose bush beyond it.
    fn surface() -> Surface {
        let wall = (0..40).flat_map(|j| (0..30).map(move |k| [5.05, j as f32 * 0.1 + 3.0, k as f32 * 0.1]));
        let bush = (0..600).map(|i| {
            let spread = |m: usize| (i * m % 97) as f32 / 97.0 * 2.0;
            [7.0 + spread(7), 7.0 + spread(31), spread(53)]
        });
        let structure: Vec<[f32; 3]> = wall.chain(bush).collect();
        Surface::new([0, 0], 1, vec![Some(Arc::new(Tile::new([0, 0], &structure, &[])))])
    }

    fn violated(from: [f64; 3], to: [f64; 3]) -> bool {
        free_space_violated(&surface(), &[Ray { from: from.into(), to: to.into() }], &Pose::identity()) > 0.5
    }

    #[test]
    fn only_rays_through_the_wall_count() {
        assert!(violated([1.0, 5.0, 1.5], [9.0, 6.0, 1.5]), "through it");
        assert!(violated([9.0, 6.0, 1.5], [1.0, 5.0, 1.5]), "from behind");
        assert!(!violated([1.0, 5.4, 1.5], [5.0, 5.5, 1.5]), "up to it");
        assert!(!violated([1.0, 5.4, 1.5], [5.6, 5.5, 1.5]), "to half a metre behind it");
        assert!(!violated([1.0, 1.0, 1.5], [9.0, 2.0, 1.5]), "past it");
        assert!(!violated([1.0, 5.0, 6.0], [9.0, 6.0, 6.0]), "above it");
        assert!(!violated([6.5, 9.0, 0.5], [9.9, 6.0, 1.5]), "through leaves");
    }

    #[test]
    fn the_pose_moves_the_rays() {
        let ray = [Ray { from: Point3::new(0.0, 0.0, 0.0), to: Point3::new(0.0, -8.0, 0.0) }];
        let at = |x: f64, yaw: f64| Pose::new(Vector3::new(x, 4.5, 1.5), Vector3::z() * yaw);
        assert_eq!(free_space_violated(&surface(), &ray, &at(1.0, std::f64::consts::FRAC_PI_2)), 1.0);
        assert_eq!(free_space_violated(&surface(), &ray, &at(1.0, -std::f64::consts::FRAC_PI_2)), 0.0);
        assert_eq!(free_space_violated(&surface(), &[], &at(1.0, 0.0)), 0.0);
    }

    #[test]
    fn rays_start_where_their_sweep_was() {
        use crate::accumulate::{AccumulateConfig, Accumulator};
        use crate::cloud::PointCloud;
        let mut accumulator = Accumulator::new(AccumulateConfig::default()).unwrap();
        let sweep = PointCloud::try_new(vec![[10.0, 0.0, 0.0], [1.5, 0.0, 0.0]]).unwrap();
        accumulator.push(0.0, &sweep, Some(Pose::identity()));
        let live = accumulator.push(1.0, &sweep, Some(Pose::translation(2.0, 0.0, 0.0))).unwrap();
        let found: Vec<(f64, f64)> = rays(&live, 100).iter().map(|r| (r.from.x, r.to.x)).collect();
        assert_eq!(found, [(-2.0, 8.0), (0.0, 10.0)], "what is near is left out");
    }
}

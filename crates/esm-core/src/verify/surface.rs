//! [`Surface`]: the map's points near a place, as Gaussians in voxels (for refinement) and occupied voxels (for
//! verification).

use nalgebra::{Matrix3, Vector3};
use rustc_hash::{FxHashMap, FxHashSet};

/// Voxel edges of the Gaussians, metres, coarse first: the coarse level catches errors of a metre, the fine one
/// settles the pose.
pub(super) const LEVELS_M: [f32; 2] = [2.0, 1.0];

/// Edge of the occupied voxels, metres: a live point counts as found when its voxel or a neighbour is occupied, so
/// within 0.3 to 0.6 m.
const OCCUPIED_M: f32 = 0.3;

/// Edge of the columns that tell where the map has been seen at all, metres.
const COLUMN_M: f32 = 2.0;

/// Points a Gaussian needs.
const MIN_POINTS: u32 = 4;

/// Standard deviation added to every Gaussian, metres: range noise and the map's own blur.
const NOISE_M: f64 = 0.05;

/// Points of one voxel, summed up.
#[derive(Clone, Copy, Debug)]
pub struct Gaussian {
    /// Mean, metres.
    pub mean: Vector3<f64>,
    /// Inverse covariance, 1/m^2.
    pub information: Matrix3<f64>,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    n: u32,
    sum: Vector3<f64>,
    outer: Matrix3<f64>,
}

type Key = [i32; 3];

/// The map near a place.
pub struct Surface {
    levels: [FxHashMap<Key, Gaussian>; LEVELS_M.len()],
    occupied: FxHashSet<Key>,
    columns: FxHashSet<[i32; 2]>,
}

impl Surface {
    /// From points of objects and of the ground, metres. Order matters only to the last bit of the sums, so it must be
    /// the same for the same map.
    pub fn new(objects: &[[f32; 3]], ground: &[[f32; 3]]) -> Self {
        let levels = LEVELS_M.map(|edge| gaussians(objects.iter().chain(ground), edge));
        let occupied = objects.iter().map(|p| key(*p, OCCUPIED_M)).collect();
        let columns = objects.iter().chain(ground).map(|p| column(*p)).collect();
        Self { levels, occupied, columns }
    }

    /// The Gaussian nearest to `p` (by Mahalanobis distance, among its voxel and the six beside it) at a level.
    pub fn nearest(&self, level: usize, p: &Vector3<f64>) -> Option<&Gaussian> {
        const BESIDE: [Key; 7] =
            [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let k = key([p.x as f32, p.y as f32, p.z as f32], LEVELS_M[level]);
        let mut best: Option<(f64, &Gaussian)> = None;
        for d in BESIDE {
            if let Some(g) = self.levels[level].get(&[k[0] + d[0], k[1] + d[1], k[2] + d[2]]) {
                let r = p - g.mean;
                let distance = r.dot(&(g.information * r));
                if best.is_none_or(|b| distance < b.0) {
                    best = Some((distance, g));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Whether an object of the map is within reach of `p`.
    pub fn is_occupied(&self, p: [f32; 3]) -> bool {
        let k = key(p, OCCUPIED_M);
        (-1..=1).any(|x| {
            (-1..=1).any(|y| (-1..=1).any(|z| self.occupied.contains(&[k[0] + x, k[1] + y, k[2] + z])))
        })
    }

    /// Whether the map holds anything at all above or below `p`.
    pub fn is_seen(&self, p: [f32; 3]) -> bool {
        self.columns.contains(&column(p))
    }
}

fn gaussians<'a>(points: impl Iterator<Item = &'a [f32; 3]>, edge: f32) -> FxHashMap<Key, Gaussian> {
    let mut sums: FxHashMap<Key, Sums> = FxHashMap::default();
    for p in points {
        let k = key(*p, edge);
        let corner = Vector3::new(k[0] as f64, k[1] as f64, k[2] as f64) * f64::from(edge);
        // Relative to the voxel's corner: far from the origin the squares would cancel.
        let d = Vector3::new(p[0] as f64, p[1] as f64, p[2] as f64) - corner;
        let s = sums.entry(k).or_default();
        s.n += 1;
        s.sum += d;
        s.outer += d * d.transpose();
    }
    sums.into_iter()
        .filter(|(_, s)| s.n >= MIN_POINTS)
        .filter_map(|(k, s)| {
            let n = f64::from(s.n);
            let mean = s.sum / n;
            let covariance = s.outer / n - mean * mean.transpose();
            let information = (covariance + Matrix3::identity() * NOISE_M.powi(2)).try_inverse()?;
            let corner = Vector3::new(k[0] as f64, k[1] as f64, k[2] as f64) * f64::from(edge);
            Some((k, Gaussian { mean: mean + corner, information }))
        })
        .collect()
}

fn key(p: [f32; 3], edge: f32) -> Key {
    p.map(|v| (v / edge).floor() as i32)
}

fn column(p: [f32; 3]) -> [i32; 2] {
    [(p[0] / COLUMN_M).floor() as i32, (p[1] / COLUMN_M).floor() as i32]
}

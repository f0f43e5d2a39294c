//! [`Surface`]: the map's points near a place, as Gaussians in voxels (for refinement) and occupied voxels (for
//! verification), in tiles that are made once and shared.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::map::TILE_M;

/// Voxel edges of the Gaussians, metres, coarse first: the coarse level catches errors of a metre, the fine one
/// settles the pose. All edges here divide the tile, so that no voxel lies in two tiles.
pub(super) const LEVELS_M: [f32; 2] = [2.0, 1.0];

/// Edge of the occupied voxels, metres: a live point counts as found when its voxel or a neighbour is occupied, so
/// within 0.25 to 0.5 m.
const OCCUPIED_M: f32 = 0.25;

/// Edge of the columns that tell where the map has been seen at all, metres.
const COLUMN_M: f32 = 2.0;

/// Points a Gaussian needs.
const MIN_POINTS: u32 = 4;

/// Standard deviation added to every Gaussian, metres: range noise and the map's own blur.
const NOISE_M: f64 = 0.05;

/// A tile's column and row.
pub(super) type TileKey = [i32; 2];

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

/// The map's surface within one tile.
pub struct Tile {
    levels: [FxHashMap<Key, Gaussian>; LEVELS_M.len()],
    occupied: FxHashSet<Key>,
    columns: FxHashSet<[i32; 2]>,
}

impl Tile {
    /// From the points above the ground and the ground's, metres.
    pub(super) fn new(structure: &[[f32; 3]], ground: &[[f32; 3]]) -> Self {
        let levels = LEVELS_M.map(|edge| gaussians(structure.iter().chain(ground), edge));
        let occupied = structure.iter().map(|p| key(*p, OCCUPIED_M)).collect();
        let columns =
            structure.iter().chain(ground).map(|p| [cell(p[0], COLUMN_M), cell(p[1], COLUMN_M)]).collect();
        Self { levels, occupied, columns }
    }
}

/// The map near a place.
pub struct Surface {
    first: TileKey,
    width: i32,
    tiles: Vec<Option<Arc<Tile>>>,
}

impl Surface {
    /// A square of `width` x `width` tiles, row by row from the tile `first`.
    pub(super) fn new(first: TileKey, width: i32, tiles: Vec<Option<Arc<Tile>>>) -> Self {
        Self { first, width, tiles }
    }

    /// The tile that holds a voxel of the given edge.
    fn tile(&self, x: i32, y: i32, edge: f32) -> Option<&Tile> {
        let cells = (TILE_M / edge) as i32;
        let (x, y) = (x.div_euclid(cells) - self.first[0], y.div_euclid(cells) - self.first[1]);
        if !(0..self.width).contains(&x) || !(0..self.width).contains(&y) {
            return None;
        }
        self.tiles[(y * self.width + x) as usize].as_deref()
    }

    /// The Gaussian nearest to `p` (by Mahalanobis distance, among its voxel and the six beside it) at a level.
    pub fn nearest(&self, level: usize, p: &Vector3<f64>) -> Option<&Gaussian> {
        const BESIDE: [Key; 7] =
            [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let k = key([p.x as f32, p.y as f32, p.z as f32], LEVELS_M[level]);
        let mut best: Option<(f64, &Gaussian)> = None;
        for d in BESIDE {
            let k = [k[0] + d[0], k[1] + d[1], k[2] + d[2]];
            let tile = self.tile(k[0], k[1], LEVELS_M[level]);
            if let Some(g) = tile.and_then(|t| t.levels[level].get(&k)) {
                let r = p - g.mean;
                let distance = r.dot(&(g.information * r));
                if best.is_none_or(|b| distance < b.0) {
                    best = Some((distance, g));
                }
            }
        }
        best.map(|b| b.1)
    }

    /// Whether something of the map stands within reach of `p`.
    pub fn is_occupied(&self, p: [f32; 3]) -> bool {
        let k = key(p, OCCUPIED_M);
        (-1..=1).any(|x| {
            (-1..=1).any(|y| {
                self.tile(k[0] + x, k[1] + y, OCCUPIED_M)
                    .is_some_and(|t| (-1..=1).any(|z| t.occupied.contains(&[k[0] + x, k[1] + y, k[2] + z])))
            })
        })
    }

    /// Whether the map holds anything at all above or below `p`.
    pub fn is_seen(&self, p: [f32; 3]) -> bool {
        let column = [cell(p[0], COLUMN_M), cell(p[1], COLUMN_M)];
        self.tile(column[0], column[1], COLUMN_M).is_some_and(|t| t.columns.contains(&column))
    }
}

fn gaussians<'a>(points: impl Iterator<Item = &'a [f32; 3]>, edge: f32) -> FxHashMap<Key, Gaussian> {
    let mut sums: FxHashMap<Key, Sums> = FxHashMap::default();
    for p in points {
        let k = key(*p, edge);
        let corner = corner(k, edge);
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
            Some((k, Gaussian { mean: mean + corner(k, edge), information }))
        })
        .collect()
}

fn corner(k: Key, edge: f32) -> Vector3<f64> {
    Vector3::new(k[0] as f64, k[1] as f64, k[2] as f64) * f64::from(edge)
}

fn cell(v: f32, edge: f32) -> i32 {
    (v / edge).floor() as i32
}

fn key(p: [f32; 3], edge: f32) -> Key {
    p.map(|v| cell(v, edge))
}

//! [`Surface`]: the map's points near a place, as Gaussians in voxels (for refinement) and occupied voxels (for
//! verification), in tiles that are made once and shared.

use std::sync::Arc;

use super::grid::{Grid, Key, cells};
use nalgebra::{Matrix3, Vector3};

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
    corner: Vector3<f64>,
    sum: Vector3<f64>,
    outer: Matrix3<f64>,
}

/// The map's surface within one tile.
pub struct Tile {
    levels: [Gaussians; LEVELS_M.len()],
    occupied: Bits,
    /// One layer of columns.
    columns: Bits,
}

impl Tile {
    /// From the points above the ground and the ground's, metres, that lie in the tile.
    pub(super) fn new(tile: TileKey, structure: &[[f32; 3]], ground: &[[f32; 3]]) -> Self {
        let all = || structure.iter().chain(ground);
        Self {
            levels: LEVELS_M.map(|edge| Gaussians::new(tile, edge, all())),
            occupied: Bits::new(tile, OCCUPIED_M, structure.iter().map(|p| key(*p, OCCUPIED_M))),
            columns: Bits::new(tile, COLUMN_M, all().map(|p| column(*p))),
        }
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

    /// The tile that holds a voxel of which `cells` make a tile's side.
    #[inline]
    fn tile(&self, x: i32, y: i32, cells: i32) -> Option<&Tile> {
        let (x, y) = (x.div_euclid(cells) - self.first[0], y.div_euclid(cells) - self.first[1]);
        if !(0..self.width).contains(&x) || !(0..self.width).contains(&y) {
            return None;
        }
        self.tiles[(y * self.width + x) as usize].as_deref()
    }

    /// Edge of the finest voxels, metres.
    pub(super) const FINEST_M: f64 = LEVELS_M[LEVELS_M.len() - 1] as f64;

    /// The Gaussian of a voxel of the finest level.
    pub(super) fn gaussian(&self, voxel: Key) -> Option<&Gaussian> {
        const FINEST: usize = LEVELS_M.len() - 1;
        self.tile(voxel[0], voxel[1], cells(LEVELS_M[FINEST])).and_then(|t| t.levels[FINEST].get(voxel))
    }

    /// The Gaussian nearest to `p` (by Mahalanobis distance, among its voxel and the six beside it) at a level.
    pub fn nearest(&self, level: usize, p: &Vector3<f64>) -> Option<&Gaussian> {
        const BESIDE: [Key; 7] =
            [[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let k = key([p.x as f32, p.y as f32, p.z as f32], LEVELS_M[level]);
        let cells = cells(LEVELS_M[level]);
        let here = self.tile(k[0], k[1], cells);
        // Most voxels have all their neighbours in their own tile.
        let inner = [0, 1].iter().all(|a| (1..cells - 1).contains(&k[*a].rem_euclid(cells)));
        let mut best: Option<(f64, &Gaussian)> = None;
        for d in BESIDE {
            let k = [k[0] + d[0], k[1] + d[1], k[2] + d[2]];
            let tile = if inner { here } else { self.tile(k[0], k[1], cells) };
            if let Some(g) = tile.and_then(|t| t.levels[level].get(k)) {
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
        let (k, cells) = (key(p, OCCUPIED_M), cells(OCCUPIED_M));
        (-1..=1).any(|x| {
            (-1..=1).any(|y| {
                let (x, y) = (k[0] + x, k[1] + y);
                self.tile(x, y, cells).is_some_and(|t| (-1..=1).any(|z| t.occupied.get([x, y, k[2] + z])))
            })
        })
    }

    /// Whether the map holds anything at all above or below `p`.
    pub fn is_seen(&self, p: [f32; 3]) -> bool {
        let column = column(p);
        self.tile(column[0], column[1], cells(COLUMN_M)).is_some_and(|t| t.columns.get(column))
    }
}

/// The voxels of a tile that hold points.
#[derive(Default)]
struct Bits {
    grid: Grid,
    words: Vec<u64>,
}

impl Bits {
    fn new(tile: TileKey, edge: f32, keys: impl Iterator<Item = Key> + Clone) -> Self {
        let grid = Grid::around(tile, edge, keys.clone());
        let mut words = vec![0u64; grid.len().div_ceil(64)];
        for i in keys.filter_map(|k| grid.index(k)) {
            words[i / 64] |= 1 << (i % 64);
        }
        Self { grid, words }
    }

    #[inline]
    fn get(&self, key: Key) -> bool {
        self.grid.index(key).is_some_and(|i| self.words[i / 64] >> (i % 64) & 1 == 1)
    }
}

/// The Gaussians of a tile at one level.
struct Gaussians {
    grid: Grid,
    /// Of each voxel: the number of its Gaussian, from 1, or 0 where there is none.
    numbers: Vec<u32>,
    all: Vec<Gaussian>,
}

impl Gaussians {
    fn new<'a>(tile: TileKey, edge: f32, points: impl Iterator<Item = &'a [f32; 3]> + Clone) -> Self {
        let grid = Grid::around(tile, edge, points.clone().map(|p| key(*p, edge)));
        let mut sums = vec![Sums::default(); grid.len()];
        for p in points {
            let k = key(*p, edge);
            let Some(i) = grid.index(k) else { continue };
            let s = &mut sums[i];
            s.corner = corner(k, edge);
            // Relative to the voxel's corner: far from the origin the squares would cancel.
            let d = Vector3::new(p[0] as f64, p[1] as f64, p[2] as f64) - s.corner;
            s.n += 1;
            s.sum += d;
            s.outer += d * d.transpose();
        }
        let (mut numbers, mut all) = (vec![0; sums.len()], Vec::new());
        for (number, gaussian) in numbers.iter_mut().zip(&sums).filter_map(|(n, s)| Some((n, s.gaussian()?)))
        {
            all.push(gaussian);
            *number = all.len() as u32;
        }
        Self { grid, numbers, all }
    }

    #[inline]
    fn get(&self, key: Key) -> Option<&Gaussian> {
        let number = self.numbers[self.grid.index(key)?];
        self.all.get(number.wrapping_sub(1) as usize)
    }
}

impl Sums {
    fn gaussian(&self) -> Option<Gaussian> {
        if self.n < MIN_POINTS {
            return None;
        }
        let n = f64::from(self.n);
        let mean = self.sum / n;
        let covariance = self.outer / n - mean * mean.transpose();
        let information = (covariance + Matrix3::identity() * NOISE_M.powi(2)).try_inverse()?;
        Some(Gaussian { mean: mean + self.corner, information })
    }
}

fn corner(k: Key, edge: f32) -> Vector3<f64> {
    Vector3::new(k[0] as f64, k[1] as f64, k[2] as f64) * f64::from(edge)
}

fn cell(v: f32, edge: f32) -> i32 {
    (v / edge).floor() as i32
}

fn column(p: [f32; 3]) -> Key {
    [cell(p[0], COLUMN_M), cell(p[1], COLUMN_M), 0]
}

fn key(p: [f32; 3], edge: f32) -> Key {
    p.map(|v| cell(v, edge))
}

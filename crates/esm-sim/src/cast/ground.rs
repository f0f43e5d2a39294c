//! The terrain of a tile: a grid of heights that rays walk over, cell by cell.
//!
//! Rays of a LiDAR graze the ground, and boxes about terrain cells stop few of them: walking the grid and telling the BVH
//! of what stands on it how far it has to look takes a third less time than cells as leaves of that BVH.

use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;

use super::shape::{Ray, triangle};
use crate::world::Class;

/// Metres by which cells are looked at too early: more than f32 is off within a tile.
const SLACK: f32 = 1e-3;

/// A square of terrain heights, metres about the tile's origin.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ground {
    cells: usize,
    size: f32,
    heights: Vec<f32>,
    classes: Vec<Class>,
    /// The highest corner of each cell, and of all.
    tops: Vec<f32>,
    top: f32,
}

impl Ground {
    /// `cells` a side of `size` metres, with `(cells + 1)^2` heights, rows along y, and a class for each cell.
    pub(crate) fn new(cells: usize, size: f32, heights: Vec<f32>, classes: Vec<Class>) -> Self {
        debug_assert_eq!(heights.len(), (cells + 1) * (cells + 1));
        debug_assert_eq!(classes.len(), cells * cells);
        let mut ground = Self { cells, size, heights, classes, tops: Vec::new(), top: f32::NEG_INFINITY };
        ground.tops = (0..cells * cells)
            .map(|cell| ground.corners(cell).iter().map(|c| c.z).fold(f32::NEG_INFINITY, f32::max))
            .collect();
        ground.top = ground.tops.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        ground
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.classes.len()
    }

    pub(super) fn class(&self, cell: usize) -> Class {
        self.classes[cell]
    }

    pub(super) fn normal(&self, cell: usize) -> Vector {
        let [a, b, c, _] = self.corners(cell);
        (b - a).cross(c - a).normalize_or_zero()
    }

    pub(super) fn aabb(&self) -> Aabb {
        let low = self.heights.iter().copied().fold(f32::INFINITY, f32::min);
        let side = self.cells as f32 * self.size;
        Aabb::new(Vector::new(0.0, 0.0, low), Vector::new(side, side, self.top))
    }

    /// Corners of a cell: (0,0) (1,0) (0,1) (1,1).
    #[inline]
    fn corners(&self, cell: usize) -> [Vector; 4] {
        let (i, j) = (cell % self.cells, cell / self.cells);
        let at = |i: usize, j: usize| {
            let z = self.heights[j * (self.cells + 1) + i];
            Vector::new(i as f32 * self.size, j as f32 * self.size, z)
        };
        [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)]
    }

    /// Distance to the hit in one cell.
    #[inline]
    pub(super) fn cast_cell(&self, ray: &Ray, cell: usize, limit: f32) -> Option<f32> {
        let [a, b, c, d] = self.corners(cell);
        triangle(ray, a, b, c).or_else(|| triangle(ray, b, d, c)).filter(|t| *t < limit)
    }

    /// The first cell a ray hits below `limit`, and the distance: cells in the order in which the ray crosses them
    /// (Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", 1987), those it passes above left out.
    pub(super) fn cast(&self, ray: &Ray, limit: f32) -> Option<(usize, f32)> {
        if self.cells == 0 {
            return None;
        }
        let (o, d, side) = (ray.origin, ray.dir, self.cells as f32 * self.size);
        let (mut enter, mut leave) = (0.0f32, limit);
        for (o, d) in [(o.x, d.x), (o.y, d.y)] {
            if d == 0.0 {
                if o < -SLACK || o > side + SLACK {
                    return None;
                }
                continue;
            }
            let (a, b) = (-o / d, (side - o) / d);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        let above = o.z - self.top - SLACK;
        if d.z < 0.0 {
            enter = enter.max(-above / d.z);
        } else if above > 0.0 {
            return None;
        }
        if enter > leave + SLACK {
            return None;
        }
        let walk = |o: f32, d: f32| {
            let i = (((o + d * enter) / self.size) as i32).clamp(0, self.cells as i32 - 1);
            let edge = (i + i32::from(d > 0.0)) as f32 * self.size;
            let (next, step) =
                if d == 0.0 { (f32::INFINITY, f32::INFINITY) } else { ((edge - o) / d, self.size / d.abs()) };
            (i, if d > 0.0 { 1 } else { -1 }, next, step)
        };
        let (mut i, step_i, mut next_x, dx) = walk(o.x, d.x);
        let (mut j, step_j, mut next_y, dy) = walk(o.y, d.y);
        let inside = 0..self.cells as i32;
        let mut t = enter;
        while inside.contains(&i) && inside.contains(&j) {
            let cell = j as usize * self.cells + i as usize;
            let end = next_x.min(next_y);
            let low = o.z + d.z * if d.z < 0.0 { end.min(leave) } else { t };
            if low <= self.tops[cell] + SLACK
                && let Some(hit) = self.cast_cell(ray, cell, limit)
            {
                return Some((cell, hit));
            }
            if end > leave + SLACK {
                return None;
            }
            if next_x < next_y {
                (i, next_x) = (i + step_i, next_x + dx);
            } else {
                (j, next_y) = (j + step_j, next_y + dy);
            }
            t = end;
        }
        None
    }
}

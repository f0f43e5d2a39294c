//! [`Grid`]: the voxels of one tile as a table without holes. Verification asks for millions of voxels a second: a hash map
//! answers several times slower.

use super::surface::TileKey;
use crate::map::TILE_M;

/// A voxel's column, row and layer.
pub(super) type Key = [i32; 3];

/// Layers more than this far above or below the middle one hold nothing: bounds the table where stray points lie deep below
/// the ground, metres.
const REACH_M: f32 = 200.0;

/// Where the voxels of a tile are in a table.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Grid {
    low: Key,
    side: i32,
    layers: i32,
}

impl Grid {
    /// For the voxels of edge `edge` in a tile that hold `keys`.
    pub(super) fn around(tile: TileKey, edge: f32, keys: impl Iterator<Item = Key>) -> Self {
        let side = cells(edge);
        let mut layers: Vec<i32> = keys.map(|k| k[2]).collect();
        if layers.is_empty() {
            return Self::default();
        }
        let half = layers.len() / 2;
        let middle = *layers.select_nth_unstable(half).1;
        let reach = (REACH_M / edge) as i32;
        let near = layers.iter().copied().filter(|z| z.abs_diff(middle) <= reach.unsigned_abs());
        let (low, high) = near.fold((middle, middle), |(low, high), z| (low.min(z), high.max(z)));
        Self { low: [tile[0] * side, tile[1] * side, low], side, layers: high - low + 1 }
    }

    /// How many voxels there are.
    pub(super) fn len(&self) -> usize {
        (self.side * self.side * self.layers) as usize
    }

    /// The place of a voxel in the table; `None` outside the tile or its layers.
    #[inline]
    pub(super) fn index(&self, key: Key) -> Option<usize> {
        let [x, y, z] = [0, 1, 2].map(|a| key[a].wrapping_sub(self.low[a]) as u32);
        let side = self.side as u32;
        (x < side && y < side && z < self.layers as u32).then(|| ((z * side + y) * side + x) as usize)
    }
}

/// Voxels along the side of a tile.
pub(super) fn cells(edge: f32) -> i32 {
    (TILE_M / edge) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_voxel_of_the_tile_has_a_place_of_its_own() {
        let keys = [[-20, 10, -3], [-11, 19, 4]];
        let grid = Grid::around([-2, 1], 1.0, keys.into_iter());
        assert_eq!(grid.len(), 10 * 10 * 8);
        let mut places: Vec<usize> = (-20..-10)
            .flat_map(|x| (10..20).flat_map(move |y| (-3..5).map(move |z| [x, y, z])))
            .map(|k| grid.index(k).unwrap())
            .collect();
        places.sort_unstable();
        assert_eq!(places, (0..800).collect::<Vec<_>>());
        for outside in [[-21, 10, 0], [-10, 10, 0], [-20, 9, 0], [-20, 20, 0], [-20, 10, -4], [-20, 10, 5]] {
            assert_eq!(grid.index(outside), None, "{outside:?}");
        }
    }

    #[test]
    fn a_stray_point_far_below_does_not_grow_the_table() {
        let keys = (0..100).map(|i| [0, 0, i % 5]).chain([[0, 0, i32::MIN / 2], [0, 0, i32::MAX]]);
        let grid = Grid::around([0, 0], 0.25, keys);
        assert_eq!(grid.len(), 40 * 40 * 5);
        assert_eq!(Grid::around([0, 0], 0.25, std::iter::empty()).len(), 0);
        assert_eq!(Grid::default().index([0, 0, 0]), None);
    }
}

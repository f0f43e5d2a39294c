//! The part of a world that is near.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::cast::{Scene, TileScene};
use crate::world::{TILE_M, World, tile_of};

/// The tiles in use, made when they come near and forgotten behind.
pub struct Tiles<'a> {
    world: &'a World,
    made: BTreeMap<(i32, i32), Arc<TileScene>>,
}

impl<'a> Tiles<'a> {
    /// None yet.
    pub fn new(world: &'a World) -> Self {
        Self { world, made: BTreeMap::new() }
    }

    /// The scene of all tiles within `range` metres of any of some places.
    pub fn scene(&mut self, places: &[Vector3<f64>], range: f64) -> Scene {
        let mut wanted = BTreeSet::new();
        for p in places {
            let (low, high) = (tile_of(p.x - range, p.y - range), tile_of(p.x + range, p.y + range));
            for i in low.0..=high.0 {
                for j in low.1..=high.1 {
                    // Nearest point of the tile.
                    let off = |v: f64, t: i32| {
                        let a = f64::from(t) * TILE_M;
                        v - v.clamp(a, a + TILE_M)
                    };
                    if off(p.x, i).hypot(off(p.y, j)) <= range {
                        wanted.insert((i, j));
                    }
                }
            }
        }
        self.made.retain(|tile, _| wanted.contains(tile));
        let missing: Vec<(i32, i32)> =
            wanted.iter().filter(|t| !self.made.contains_key(t)).copied().collect();
        let new: Vec<TileScene> = missing.par_iter().map(|t| self.world.tile(*t)).collect();
        self.made.extend(missing.into_iter().zip(new.into_iter().map(Arc::new)));
        let origin = places.first().copied().unwrap_or_default();
        Scene::new(origin, self.made.values().cloned())
    }
}

//! What the map holds near a place, tile by tile, made when first needed.

use std::sync::{Arc, Mutex};

use rustc_hash::FxHashMap;

use super::surface::{Surface, Tile, TileKey};
use crate::error::Error;
use crate::map::{Map, TILE_M, tile_of};

/// Tiles kept for reuse: a robot moves on slowly, so the next cloud mostly needs the same ones. Bounds the memory to
/// some 60 MB.
const CACHED: usize = 1024;

/// Finds the map's surface near any place.
pub struct Surroundings {
    map: Arc<Map>,
    runs: FxHashMap<TileKey, Runs>,
    reach_tiles: i32,
    cache: Mutex<Cache>,
}

/// Which runs of the map's points lie in a tile.
#[derive(Clone, Default)]
struct Runs {
    ground: Vec<u32>,
    structure: Vec<u32>,
}

#[derive(Default)]
struct Cache {
    tiles: FxHashMap<TileKey, (u64, Arc<Tile>)>,
    clock: u64,
}

impl Surroundings {
    /// `reach_m`: how far from the sensor a live cloud reaches.
    pub fn new(map: Arc<Map>, reach_m: f64) -> Self {
        let mut runs: FxHashMap<TileKey, Runs> = FxHashMap::default();
        for (i, run) in map.ground_tiles().iter().enumerate() {
            runs.entry(tile_of(run.min)).or_default().ground.push(i as u32);
        }
        for (i, run) in map.structure_tiles().iter().enumerate() {
            runs.entry(tile_of(run.min)).or_default().structure.push(i as u32);
        }
        let reach_tiles = (reach_m / f64::from(TILE_M)).ceil() as i32;
        Self { map, runs, reach_tiles, cache: Mutex::default() }
    }

    /// The surface around a place (metres, relative to the map's origin).
    ///
    /// # Errors
    /// [`Error::MapFile`] where the map's points there are damaged.
    pub fn surface(&self, place: [f32; 3]) -> Result<Surface, Error> {
        let [x, y] = tile_of(place);
        let first = [x - self.reach_tiles, y - self.reach_tiles];
        let width = 2 * self.reach_tiles + 1;
        let mut tiles = Vec::with_capacity((width * width) as usize);
        for dy in 0..width {
            for dx in 0..width {
                tiles.push(self.tile([first[0] + dx, first[1] + dy])?);
            }
        }
        Ok(Surface::new(first, width, tiles))
    }

    fn tile(&self, key: TileKey) -> Result<Option<Arc<Tile>>, Error> {
        let Some(runs) = self.runs.get(&key) else { return Ok(None) };
        if let Ok(mut cache) = self.cache.lock() {
            cache.clock += 1;
            let now = cache.clock;
            if let Some((used, tile)) = cache.tiles.get_mut(&key) {
                *used = now;
                return Ok(Some(Arc::clone(tile)));
            }
        }
        let tile = Arc::new(self.build(key, runs)?);
        if let Ok(mut cache) = self.cache.lock() {
            let now = cache.clock;
            if cache.tiles.len() >= CACHED {
                // Drop the older half at once: rare, and cheaper than order on every use.
                let mut used: Vec<u64> = cache.tiles.values().map(|t| t.0).collect();
                let (_, &mut median, _) = used.select_nth_unstable(CACHED / 2);
                cache.tiles.retain(|_, t| t.0 > median);
            }
            cache.tiles.insert(key, (now, Arc::clone(&tile)));
        }
        Ok(Some(tile))
    }

    fn build(&self, key: TileKey, runs: &Runs) -> Result<Tile, Error> {
        let (mut points, mut structure, mut ground) = (Vec::new(), Vec::new(), Vec::new());
        for &i in &runs.structure {
            self.map.structure_tile_points_into(i as usize, &mut points)?;
            structure.extend_from_slice(&points);
        }
        for &i in &runs.ground {
            self.map.ground_tile_points_into(i as usize, &mut points)?;
            ground.extend_from_slice(&points);
        }
        Ok(Tile::new(key, &structure, &ground))
    }
}

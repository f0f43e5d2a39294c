//! What the map holds near a place: its segments and ground, found by a coarse grid.

use std::sync::{Arc, Mutex};

use rustc_hash::FxHashMap;

use super::surface::Surface;
use crate::error::Error;
use crate::map::Map;

/// Edge of the grid's cells, metres: places within one cell share their surroundings.
const CELL_M: f32 = 20.0;

/// Surfaces kept for reuse: a robot moves on slowly, so the next cloud mostly needs the same.
const CACHED: usize = 8;

type Cached = ((i32, i32), Arc<Surface>);

/// Finds the map's surface near any place, and keeps the last few.
pub struct Surroundings {
    map: Arc<Map>,
    segments: FxHashMap<(i32, i32), Vec<u32>>,
    ground: FxHashMap<(i32, i32), Vec<u32>>,
    reach_m: f32,
    /// Least recently used first.
    cache: Mutex<Vec<Cached>>,
}

impl Surroundings {
    /// Bins the map's segments and ground tiles. `reach_m`: how far from the sensor a live cloud reaches.
    pub fn new(map: Arc<Map>, reach_m: f32) -> Self {
        let mut segments: FxHashMap<(i32, i32), Vec<u32>> = FxHashMap::default();
        let mut ground: FxHashMap<(i32, i32), Vec<u32>> = FxHashMap::default();
        for (i, s) in map.segments().iter().enumerate() {
            segments.entry(cell(s.centroid)).or_default().push(i as u32);
        }
        for (i, run) in map.ground_tiles().iter().enumerate() {
            ground.entry(cell(run.min)).or_default().push(i as u32);
        }
        Self { map, segments, ground, reach_m, cache: Mutex::new(Vec::new()) }
    }

    /// The surface around a place (metres, relative to the map's origin).
    ///
    /// # Errors
    /// [`Error::MapFile`] where the map's points there are damaged.
    pub fn surface(&self, place: [f32; 3]) -> Result<Arc<Surface>, Error> {
        let key = cell(place);
        if let Ok(mut cache) = self.cache.lock()
            && let Some(i) = cache.iter().position(|c| c.0 == key)
        {
            let hit = cache.remove(i);
            let surface = Arc::clone(&hit.1);
            cache.push(hit);
            return Ok(surface);
        }
        let surface = Arc::new(self.build(key)?);
        if let Ok(mut cache) = self.cache.lock() {
            if cache.len() >= CACHED {
                cache.remove(0);
            }
            cache.push((key, Arc::clone(&surface)));
        }
        Ok(surface)
    }

    fn build(&self, key: (i32, i32)) -> Result<Surface, Error> {
        let rings = (self.reach_m / CELL_M).ceil() as i32;
        let (mut points, mut objects, mut ground) = (Vec::new(), Vec::new(), Vec::new());
        for x in key.0 - rings..=key.0 + rings {
            for y in key.1 - rings..=key.1 + rings {
                for &i in self.segments.get(&(x, y)).into_iter().flatten() {
                    self.map.segment_points_into(i as usize, &mut points)?;
                    objects.extend_from_slice(&points);
                }
                for &i in self.ground.get(&(x, y)).into_iter().flatten() {
                    self.map.ground_tile_points_into(i as usize, &mut points)?;
                    ground.extend_from_slice(&points);
                }
            }
        }
        Ok(Surface::new(&objects, &ground))
    }
}

fn cell(p: [f32; 3]) -> (i32, i32) {
    ((p[0] / CELL_M).floor() as i32, (p[1] / CELL_M).floor() as i32)
}

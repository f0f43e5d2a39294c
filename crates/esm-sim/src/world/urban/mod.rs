//! A town: a bent lattice of streets with gaps, houses along them, gardens behind walls and hedges, parked cars.

mod kerb;
mod lattice;
mod lot;
mod row;

use rustc_hash::FxHashMap;

use super::terrain::Terrain;
use super::visit::Visit;
use super::{Class, Object, tile_of};
use crate::hash::Key;
use crate::motion::Path;
pub(super) use lattice::LANES_M;
pub(crate) use lattice::REVISIT_SHARE;
use lattice::{BLOCK, exists, route, street};
use row::Row;

/// No house nearer to a crossing, metres.
const CORNER: f64 = 15.0;
/// How far from its street an anchor may lie, metres.
const REACH: f64 = 34.0;
/// Room of parked cars beside the carriageway, metres.
const STRIP: f64 = 2.0;

/// Widths of a street, metres from its middle.
#[derive(Clone, Copy, Debug)]
struct Section {
    half_road: f64,
    /// How many of its kerb sides have parked cars on them: right, left.
    parking: [bool; 2],
    pavement: f64,
}

impl Section {
    fn new(key: Key) -> Self {
        let mut draw = key.with(50).draw();
        let half_road = f64::from(draw.range(3.1, 3.7));
        let parking = [draw.chance(0.5), draw.chance(0.5)];
        Self { half_road, parking, pavement: f64::from(draw.range(1.0, 1.9)) }
    }

    /// Where the pavement begins.
    fn kerb(&self, left: bool) -> f64 {
        self.half_road + if self.parking[usize::from(left)] { STRIP } else { 0.0 }
    }

    /// The property line.
    fn front(&self, left: bool) -> f64 {
        self.kerb(left) + self.pavement
    }
}

/// A street between two crossings.
struct Street {
    key: Key,
    path: Path,
    cell: (i32, i32),
    /// 0 or 1: numbers of streets that start at the same crossing stay apart.
    side: u32,
    section: Section,
}

pub(super) struct Urban {
    terrain: Terrain,
    streets: Vec<Street>,
    /// Streets whose objects may stand in a tile.
    near: FxHashMap<(i32, i32), Vec<u32>>,
    route: Path,
    visit: Visit,
}

impl Urban {
    pub(super) fn new(key: Key, length_m: f64, visit: Visit) -> Self {
        let terrain =
            Terrain { key: key.with(1), layers: &[(420.0, 7.0), (160.0, 1.6), (47.0, 0.12), (5.0, 0.015)] };
        let half = ((length_m / BLOCK).sqrt() * 0.75).ceil() as i32 + 1;
        let (corners, route) = route(key, length_m, half);
        let (mut streets, mut near) = (Vec::new(), FxHashMap::default());
        let low = corners.iter().fold((0, 0), |a, c| (a.0.min(c.0), a.1.min(c.1)));
        let high = corners.iter().fold((0, 0), |a, c| (a.0.max(c.0), a.1.max(c.1)));
        for i in low.0 - 2..=high.0 + 2 {
            for j in low.1 - 2..=high.1 + 2 {
                for side in 0..2u32 {
                    if !exists(key, i, j, side) {
                        continue;
                    }
                    let path = street(key, i, j, side);
                    let n = streets.len() as u32;
                    let mut tiles: Vec<(i32, i32)> = Vec::new();
                    for p in path.points() {
                        // Steps below the side of a tile miss none.
                        for dx in [-1.0, -0.5, 0.0, 0.5, 1.0] {
                            for dy in [-1.0, -0.5, 0.0, 0.5, 1.0] {
                                tiles.push(tile_of(p[0] + dx * REACH, p[1] + dy * REACH));
                            }
                        }
                    }
                    tiles.sort_unstable();
                    tiles.dedup();
                    for tile in tiles {
                        near.entry(tile).or_insert_with(Vec::new).push(n);
                    }
                    let key = key.with(10 + u64::from(side)).cell(i.into(), j.into());
                    let section = Section::new(key);
                    streets.push(Street { key, path, cell: (i, j), side, section });
                }
            }
        }
        Self { terrain, streets, near, route, visit }
    }

    pub(super) fn route(&self) -> &Path {
        &self.route
    }

    /// The pavements, from corner to corner.
    pub(super) fn walks(&self) -> Vec<Path> {
        // Between the kerb and the lamps.
        let ends = CORNER - 5.0;
        let sides = |s: &Street| {
            let middle = s.path.smoothed(ends, s.path.length() - ends, 1.0);
            let off = |left| s.section.kerb(left) + 0.45 * s.section.pavement;
            [middle.offset(off(true)), middle.offset(-off(false))]
        };
        self.streets.iter().flat_map(sides).collect()
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.terrain.height(x, y, 0.0, 1.0)
    }

    pub(super) fn ground(&self, x: f64, y: f64) -> Class {
        let near = self.near.get(&tile_of(x, y)).map_or(&[][..], Vec::as_slice);
        let mut ground = Class::Grass;
        for n in near {
            let Street { path, section, .. } = &self.streets[*n as usize];
            let d = path.distance(x, y);
            if d > section.front(true).max(section.front(false)) {
                continue;
            }
            let left = is_left(path, x, y);
            if d < section.kerb(left) {
                return Class::Road;
            }
            if d < section.front(left) {
                ground = Class::Pavement;
            }
        }
        ground
    }

    pub(super) fn objects(&self, tile: (i32, i32)) -> Vec<Object> {
        let near = self.near.get(&tile).map_or(&[][..], Vec::as_slice);
        let mut objects = Vec::new();
        for n in near {
            let mut row =
                Row { town: self, street: &self.streets[*n as usize], tile, count: 0, objects: &mut objects };
            for left in [true, false] {
                row.side(left);
            }
        }
        objects
    }
}

/// Whether a point lies to the left of a path, by the path's nearest corner.
fn is_left(path: &Path, x: f64, y: f64) -> bool {
    let points = path.points();
    let off = |p: &[f64; 2]| (p[0] - x).hypot(p[1] - y);
    let near = points.iter().enumerate().min_by(|a, b| off(a.1).total_cmp(&off(b.1))).map_or(0, |(n, _)| n);
    let (a, b) = (points[near.saturating_sub(1)], points[(near + 1).min(points.len() - 1)]);
    (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0.0
}

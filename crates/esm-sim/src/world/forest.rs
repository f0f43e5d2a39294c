//! Woods: rolling ground, stands of several species, a trail that loops, tracks that cross it, clearings.

use nalgebra::Vector3;

use super::plants::{bush, log, rock, sapling, stump, undergrowth, young_conifer};
use super::terrain::Terrain;
use super::tree::{Room, Species, tree};
use super::visit::Visit;
use super::{Class, Object, TILE_M, new_object_id, object_id};
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::motion::Path;
use crate::noise::{smoothstep, value};

/// Cells in which at most one tree is born, metres.
const TREE_CELL: f64 = 1.6;

/// Everything a wood is made from.
pub(super) struct Forest {
    key: Key,
    terrain: Terrain,
    route: Path,
    tracks: Vec<Path>,
    visit: Visit,
    cover: &'static Cover,
}

/// How much of the land is wooded.
pub(super) struct Cover {
    /// The noise of -1.35 to 1.35 at which clearings begin, and above which they are open.
    clearing: (f64, f64),
    /// Share of the low plants that grow, of those of a wood.
    low: f32,
}

/// Closed stands with clearings.
pub(super) const WOOD: Cover = Cover { clearing: (0.42, 0.6), low: 1.0 };
/// Meadows in which trees stand in groups.
pub(super) const COPSE: Cover = Cover { clearing: (-0.36, -0.06), low: 0.4 };

/// Makes a thing at a place (x, y) from how much it has grown and what is drawn for it; `None` where nothing stands.
type Maker<'a> = &'a dyn Fn(f64, f64, f32, &mut Draw) -> Option<(Class, Vec<Shape>)>;

/// A tree that might stand.
struct Candidate {
    key: Key,
    x: f64,
    y: f64,
    priority: f32,
}

impl Forest {
    pub(super) fn new(key: Key, length_m: f64, visit: Visit, cover: &'static Cover) -> Self {
        let layers = &[(230.0, 7.0), (90.0, 2.6), (31.0, 0.7), (9.0, 0.16), (3.7, 0.07)];
        let terrain = Terrain { key: key.with(1), layers };
        // Above 700 m the trail winds so much that a plain ring would hide that it loops: it crosses itself.
        let route = trail(key.with(2), length_m);
        let radius = length_m / std::f64::consts::TAU;
        let mut draw = key.with(3).draw();
        let tracks = (0..2 + (length_m / 700.0) as u64)
            .map(|n| {
                let turn = f64::from(draw.range(0.0, std::f32::consts::TAU));
                let off = f64::from(draw.range(-0.8, 0.8)) * radius;
                let (c, s) = (turn.cos(), turn.sin());
                let reach = 1.6 * radius + 60.0;
                let steps = (reach / 3.0) as i64;
                Path::new((-steps..=steps).map(|k| {
                    let t = k as f64 * 3.0;
                    let w = off + 14.0 * value(key.with(40 + n), t / 60.0, 0.0);
                    [c * t - s * w, s * t + c * w]
                }))
            })
            .collect();
        Self { key, terrain, route, tracks, visit, cover }
    }

    pub(super) fn route(&self) -> &Path {
        &self.route
    }

    /// The tracks that cross the trail.
    pub(super) fn walks(&self) -> Vec<Path> {
        self.tracks.clone()
    }

    /// Distance to the nearest trail or track; infinite beyond 8 m.
    fn off_track(&self, x: f64, y: f64) -> f64 {
        self.tracks.iter().map(|t| t.distance(x, y) + 0.4).fold(self.route.distance(x, y), f64::min)
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        let d = self.off_track(x, y);
        // Wheels have worn the trail smooth and a little deep.
        let worn = 1.0 - smoothstep(0.8, 3.5, d.min(10.0));
        self.terrain.height(x, y, 20.0, 1.0 - 0.85 * worn) - 0.12 * worn
    }

    pub(super) fn ground(&self, x: f64, y: f64) -> Class {
        if self.off_track(x, y) < 1.3 {
            Class::Track
        } else if self.openness(x, y) > 0.5 {
            Class::Grass
        } else {
            Class::Litter
        }
    }

    /// 1 in a clearing, 0 in the wood.
    fn openness(&self, x: f64, y: f64) -> f64 {
        let n =
            value(self.key.with(4), x / 46.0, y / 46.0) + 0.35 * value(self.key.with(5), x / 15.0, y / 15.0);
        smoothstep(self.cover.clearing.0, self.cover.clearing.1, n)
    }

    fn candidate(&self, i: i64, j: i64) -> Option<Candidate> {
        let key = self.key.with(6).cell(i, j);
        let mut draw = key.draw();
        let (x, y) = (
            (i as f64 + f64::from(draw.unit())) * TREE_CELL,
            (j as f64 + f64::from(draw.unit())) * TREE_CELL,
        );
        let priority = draw.unit();
        let clear = 1.5 + 0.9 * f64::from(draw.unit());
        let stands = draw.unit() > self.openness(x, y) as f32 * 0.97 && self.off_track(x, y) > clear;
        stands.then_some(Candidate { key, x, y, priority })
    }

    /// Room a tree takes, metres: stands are dense or thin.
    fn spacing(&self, x: f64, y: f64) -> f64 {
        2.7 + 1.3 * value(self.key.with(7), x / 33.0, y / 33.0)
    }

    /// Trees of a tile: a candidate stands where it comes first among all within its room (Matérn's second hard-core
    /// process), which needs no neighbour tiles and leaves no grid.
    fn trees(&self, tile: (i32, i32)) -> Vec<Candidate> {
        let reach = 3;
        let cells = |t: i32| {
            let low = f64::from(t) * TILE_M / TREE_CELL;
            low.floor() as i64 - reach..=(low + TILE_M / TREE_CELL).ceil() as i64 + reach
        };
        let width = cells(tile.0).count();
        let all: Vec<Option<Candidate>> = cells(tile.1)
            .flat_map(|j| cells(tile.0).map(move |i| (i, j)))
            .map(|(i, j)| self.candidate(i, j))
            .collect();
        let mut kept = Vec::new();
        for (n, c) in all.iter().enumerate() {
            let Some(c) = c else { continue };
            if super::tile_of(c.x, c.y) != tile {
                continue;
            }
            let room = self.spacing(c.x, c.y);
            let (row, column) = ((n / width) as i64, (n % width) as i64);
            let beaten =
                (-reach..=reach).flat_map(|dj| (-reach..=reach).map(move |di| (di, dj))).any(|(di, dj)| {
                    let (r, q) = (row + dj, column + di);
                    if (di, dj) == (0, 0) || r < 0 || q < 0 || q >= width as i64 {
                        return false;
                    }
                    let other = all.get(r as usize * width + q as usize).and_then(Option::as_ref);
                    other.is_some_and(|o| o.priority < c.priority && (o.x - c.x).hypot(o.y - c.y) < room)
                });
            if !beaten {
                kept.push(Candidate { ..*c });
            }
        }
        kept
    }

    fn species(&self, c: &Candidate, draw: &mut Draw) -> Species {
        let stand = value(self.key.with(8), c.x / 55.0, c.y / 55.0) as f32 + 0.25 * draw.normal();
        let other = value(self.key.with(9), c.x / 70.0, c.y / 70.0) as f32 + 0.25 * draw.normal();
        match (stand > 0.12, other > 0.0, other > 0.35) {
            (true, true, _) => Species::Spruce,
            (true, false, _) => Species::Pine,
            (false, _, true) => Species::Birch,
            (false, true, false) => Species::Beech,
            (false, false, _) => Species::Oak,
        }
    }

    pub(super) fn objects(&self, tile: (i32, i32)) -> Vec<Object> {
        let mut objects = Vec::new();
        let season = self.visit.season;
        for (n, c) in self.trees(tile).into_iter().enumerate() {
            let mut draw = c.key.with(1).draw();
            let species = self.species(&c, &mut draw);
            // Diameters of an uneven-aged wood: many thin, few thick.
            let dbh = (0.23 * (0.42 * draw.normal()).exp()).clamp(0.07, 0.75);
            let height = species.height(dbh) * draw.range(0.85, 1.15);
            let (id, key) = (object_id(tile, n as u32), c.key.with(2));
            if self.visit.keeps(c.key) {
                let mut now = self.visit.own(c.key).draw();
                let shapes = tree(species, dbh, height, Room::Stand, season, &mut key.draw(), &mut now);
                objects.push(self.object(id, Class::Tree, c.x, c.y, shapes));
            } else if draw.chance(0.5) {
                // Felled: its stump has a number of its own.
                let id = new_object_id(tile, self.visit, n as u32);
                objects.push(self.object(id, Class::Stump, c.x, c.y, stump(&mut key.draw())));
            }
        }
        let mut count = 0x1000;
        let mut scatter = |layer: u64, most: usize, min_off: f64, of: Maker<'_>| {
            for n in 0..most {
                count += 1;
                let key = self.key.with(layer).cell(tile.0.into(), tile.1.into()).with(n as u64);
                // What is gone came back elsewhere: as many new ones as were lost.
                let (key, id) = match self.visit.keeps(key) {
                    true => (key, object_id(tile, count)),
                    false => (self.visit.own(key), new_object_id(tile, self.visit, count)),
                };
                let mut draw = key.draw();
                let x = (f64::from(tile.0) + f64::from(draw.unit())) * TILE_M;
                let y = (f64::from(tile.1) + f64::from(draw.unit())) * TILE_M;
                if self.off_track(x, y) < min_off || key.with(0x10).unit() > self.cover.low {
                    continue;
                }
                if let Some((class, shapes)) = of(x, y, self.visit.growth(key), &mut draw) {
                    objects.push(self.object(id, class, x, y, shapes));
                }
            }
        };
        scatter(20, 40, 1.6, &|x, y, growth, d| {
            // Bushes grow at the edges and in patches.
            let patch = value(self.key.with(21), x / 19.0, y / 19.0) as f32;
            let edge = if self.off_track(x, y) < 6.0 { 0.25 } else { 0.0 };
            let size = d.range(0.75, 1.5).powi(2) * growth;
            let evergreen = d.chance(0.4);
            (d.range(-1.2, 0.8) < patch + edge).then(|| (Class::Bush, bush(size, evergreen, season, d)))
        });
        scatter(22, 55, 0.9, &|x, y, _, d| {
            let patch = value(self.key.with(23), x / 12.0, y / 12.0) as f32;
            let size = d.range(0.4, 1.3);
            (d.range(-0.9, 1.2) < patch).then(|| (Class::Undergrowth, undergrowth(size, season, d)))
        });
        scatter(24, 26, 1.2, &|x, y, _, d| {
            // Conifers come up under conifers.
            let shade = value(self.key.with(8), x / 55.0, y / 55.0) as f32;
            let young = d.range(-0.6, 0.6) < shade;
            let stands = d.chance(0.6);
            stands.then(|| (Class::Bush, if young { young_conifer(d) } else { sapling(season, d) }))
        });
        scatter(25, 3, 3.5, &|_, _, _, d| d.chance(0.5).then(|| (Class::Log, log(d))));
        scatter(26, 3, 1.2, &|_, _, _, d| d.chance(0.5).then(|| (Class::Stump, stump(d))));
        scatter(27, 2, 1.5, &|_, _, _, d| d.chance(0.35).then(|| (Class::Rock, rock(d))));
        objects
    }

    fn object(&self, id: u32, class: Class, x: f64, y: f64, shapes: Vec<Shape>) -> Object {
        Object { id, class, anchor: Vector3::new(x, y, self.height(x, y)), shapes }
    }
}

/// A closed trail about the origin: a ring whose radius swings, scaled to its length.
fn trail(key: Key, length_m: f64) -> Path {
    let mut draw = key.draw();
    let waves: Vec<(f64, f64, f64)> = (2..=9)
        .map(|n| {
            let size = 0.75 / f64::from(n) * f64::from(draw.range(0.3, 1.0));
            (f64::from(n), size, f64::from(draw.range(0.0, std::f32::consts::TAU)))
        })
        .collect();
    let ring = |scale: f64| {
        let steps = (length_m / 1.5) as usize + 16;
        (0..=steps).map(move |k| k as f64 / steps as f64 * std::f64::consts::TAU).map({
            let waves = waves.clone();
            move |a| {
                let r = scale
                    * (1.0 + waves.iter().map(|(n, size, phase)| size * (n * a + phase).sin()).sum::<f64>())
                        .max(0.15);
                [r * a.cos(), r * a.sin()]
            }
        })
    };
    // Smoothing shortens it: three rounds bring its length to the one asked for.
    let mut scale = length_m / 8.0;
    let mut path = Path::default();
    for _ in 0..3 {
        let rough = Path::new(ring(scale));
        path = rough.smoothed(0.0, rough.length(), 4.0);
        scale *= 1.002 * length_m / path.length().max(1.0);
    }
    path
}

//! Worlds: objects with a number and a class on a terrain, made tile by tile from a seed.

mod alike;
mod aside;
mod building;
mod class;
mod forest;
mod furniture;
mod park;
mod plants;
mod terrain;
mod tree;
mod urban;
mod vehicle;
mod visit;

use nalgebra::Vector3;

use crate::cast::{Ground, Shape, TileScene};
use crate::hash::Key;
use crate::motion::Path;

pub use class::Class;
pub(crate) use furniture::striding;
pub(crate) use urban::REVISIT_SHARE;
pub(crate) use vehicle::vehicle;
pub use visit::{Season, Visit};

/// Side of a tile, metres.
pub const TILE_M: f64 = 32.0;

/// One thing of the world.
#[derive(Clone, Debug)]
pub struct Object {
    /// Its number: the same in every visit, unique in the world, never 0.
    pub id: u32,
    /// What it is.
    pub class: Class,
    /// Where it stands, map frame, metres.
    pub anchor: Vector3<f64>,
    /// Its pieces, metres about the anchor, axes of the map frame.
    pub shapes: Vec<Shape>,
}

/// A kind of world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum WorldKind {
    /// Woods on rolling ground with a trail that loops.
    Forest,
    /// A city park in a ring of facades.
    Park,
    /// Streets of houses.
    Urban,
    /// Meadows with copses, scrub and a trail that loops.
    Copse,
    /// Trees of one clone in rows.
    Plantation,
    /// Rows of bays with cars of few models.
    CarPark,
    /// Parallel streets of one house built again and again.
    Terraces,
}

/// A world at one visit.
pub struct World {
    layout: Layout,
    visit: Visit,
}

/// Who meets the sensor on its own way.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Moving {
    /// Cars and cyclists; the other lane is so many metres to the left of the sensor's.
    Roads {
        /// Metres.
        oncoming_m: f64,
    },
    /// Nobody but those on [`World::walks`] and [`World::drives`]; the other lane is so many metres to the left.
    Aisles {
        /// Metres.
        oncoming_m: f64,
    },
    /// Walkers and dogs.
    Trails,
    /// Nobody but those on [`World::walks`].
    Paths,
}

enum Layout {
    Forest(forest::Forest),
    Park(park::Park),
    Urban(urban::Urban),
    Alike(alike::Site),
}

impl World {
    /// The world of a seed at a visit, large enough for a route of `length_m` metres.
    pub fn new(kind: WorldKind, seed: u64, length_m: f64, visit: Visit) -> Self {
        let key = Key::new(seed).with(kind as u64);
        let layout = match kind {
            WorldKind::Forest => Layout::Forest(forest::Forest::new(key, length_m, visit, &forest::WOOD)),
            WorldKind::Copse => Layout::Forest(forest::Forest::new(key, length_m, visit, &forest::COPSE)),
            WorldKind::Park => Layout::Park(park::Park::new(key, length_m, visit)),
            WorldKind::Urban => Layout::Urban(urban::Urban::new(key, length_m, visit)),
            WorldKind::Plantation => Layout::Alike(alike::plantation(key, length_m, visit)),
            WorldKind::CarPark => Layout::Alike(alike::car_park(key, length_m, visit)),
            WorldKind::Terraces => Layout::Alike(alike::terraces(key, length_m, visit)),
        };
        Self { layout, visit }
    }

    /// The way through it that the sensor takes, `length_m` metres or a little more.
    pub fn route(&self) -> &Path {
        match &self.layout {
            Layout::Forest(w) => w.route(),
            Layout::Park(w) => w.route(),
            Layout::Urban(w) => w.route(),
            Layout::Alike(w) => w.route(),
        }
    }

    /// The visit.
    pub fn visit(&self) -> Visit {
        self.visit
    }

    /// Ways that people stroll on.
    pub(crate) fn walks(&self) -> Vec<Path> {
        match &self.layout {
            Layout::Forest(w) => w.walks(),
            Layout::Park(w) => w.walks(),
            Layout::Urban(w) => w.walks(),
            Layout::Alike(w) => w.walks(),
        }
    }

    /// Closed ways that cars circle on.
    pub(crate) fn drives(&self) -> Vec<Path> {
        match &self.layout {
            Layout::Park(w) => w.drives(),
            Layout::Alike(w) => w.drives(),
            Layout::Forest(_) | Layout::Urban(_) => Vec::new(),
        }
    }

    /// Who meets the sensor on its way.
    pub(crate) fn moving(&self) -> Moving {
        match &self.layout {
            Layout::Forest(_) => Moving::Trails,
            Layout::Park(_) => Moving::Paths,
            Layout::Alike(w) => w.moving(),
            Layout::Urban(_) => Moving::Roads { oncoming_m: urban::LANES_M },
        }
    }

    /// How far to the left of the sensor's lane the other one is, where there are lanes, metres.
    pub(crate) fn lanes_m(&self) -> Option<f64> {
        match self.moving() {
            Moving::Roads { oncoming_m } | Moving::Aisles { oncoming_m } => Some(oncoming_m),
            Moving::Trails | Moving::Paths => None,
        }
    }

    /// Whether a way may lead over a place: where there are lanes, over roads; elsewhere, over all but roads.
    fn drivable(&self, x: f64, y: f64) -> bool {
        self.lanes_m().is_some() == (self.ground(x, y) == Class::Road)
    }

    /// The way `left_m` metres beside another, to its left as it runs, as near to that as the ground allows.
    pub(crate) fn aside(&self, way: &Path, left_m: f64) -> Path {
        aside::aside(self, way, left_m)
    }

    /// Height of the ground, metres.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        match &self.layout {
            Layout::Forest(w) => w.height(x, y),
            Layout::Park(w) => w.height(x, y),
            Layout::Urban(w) => w.height(x, y),
            Layout::Alike(w) => w.height(x, y),
        }
    }

    /// What the ground is made of.
    pub fn ground(&self, x: f64, y: f64) -> Class {
        match &self.layout {
            Layout::Forest(w) => w.ground(x, y),
            Layout::Park(w) => w.ground(x, y),
            Layout::Urban(w) => w.ground(x, y),
            Layout::Alike(w) => w.ground(x, y),
        }
    }

    /// The objects whose anchors lie in a tile, in a fixed order.
    pub fn objects(&self, tile: (i32, i32)) -> Vec<Object> {
        match &self.layout {
            Layout::Forest(w) => w.objects(tile),
            Layout::Park(w) => w.objects(tile),
            Layout::Urban(w) => w.objects(tile),
            Layout::Alike(w) => w.objects(tile),
        }
    }

    /// A tile with its ground, ready for rays.
    pub fn tile(&self, tile: (i32, i32)) -> TileScene {
        let (x0, y0) = (f64::from(tile.0) * TILE_M, f64::from(tile.1) * TILE_M);
        let cells = match self.layout {
            Layout::Forest(_) => 20,
            Layout::Park(_) | Layout::Urban(_) | Layout::Alike(_) => 16,
        };
        let size = TILE_M / cells as f64;
        // Heights are told about the ground at the corner: f32 stays exact on mountains too.
        let origin = Vector3::new(x0, y0, self.height(x0, y0).round());
        let (mut heights, mut classes) = (Vec::new(), Vec::new());
        for j in 0..=cells {
            for i in 0..=cells {
                let (x, y) = (x0 + i as f64 * size, y0 + j as f64 * size);
                heights.push((self.height(x, y) - origin.z) as f32);
                if i < cells && j < cells {
                    classes.push(self.ground(x + 0.5 * size, y + 0.5 * size));
                }
            }
        }
        let ground = Ground::new(cells, size as f32, heights, classes);
        TileScene::build(origin, &self.objects(tile), ground)
    }
}

/// The tile a point lies in.
pub fn tile_of(x: f64, y: f64) -> (i32, i32) {
    ((x / TILE_M).floor() as i32, (y / TILE_M).floor() as i32)
}

/// An object's number from its place of birth: a cell of 256 x 256 about the origin, which wraps far outside of any
/// preset, and a count below 0x8000 in it.
fn object_id(cell: (i32, i32), count: u32) -> u32 {
    let byte = |v: i32| (v.rem_euclid(256)).cast_unsigned();
    (byte(cell.0) << 24) | (byte(cell.1) << 16) | ((count & 0x7FFF) + 1)
}

/// The number of what is new at a visit, from a count below 0x1FFF.
fn new_object_id(cell: (i32, i32), visit: Visit, count: u32) -> u32 {
    object_id(cell, 0) + 0x8000 + (u32::from(visit.number & 3) << 13) + (count & 0x1FFF) - 1
}

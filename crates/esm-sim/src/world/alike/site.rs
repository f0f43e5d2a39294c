//! What the worlds that look alike are put up with: a grid of their own on the map, and a list of things by tile.

use nalgebra::Vector3;

use crate::cast::Shape;
use crate::hash::Key;
use crate::motion::Path;
use crate::world::terrain::Terrain;
use crate::world::visit::Visit;
use crate::world::{Class, Moving, Object, new_object_id, object_id, tile_of};

/// Things a page of numbers holds.
const PAGE: u32 = 0x1000;

/// A pattern's own axes on the map: u along its rows, v across them, to the left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    turn: f64,
    /// The place of the pattern that lies on the map's origin.
    middle: [f64; 2],
}

impl Frame {
    /// Turned at random: nothing is in line with tiles or voxels.
    pub(super) fn new(key: Key, middle: [f64; 2]) -> Self {
        Self { turn: f64::from(key.with(0xF4A3).unit()) * std::f64::consts::TAU, middle }
    }

    /// A place on the map.
    pub(super) fn at(&self, u: f64, v: f64) -> [f64; 2] {
        let ((s, c), (u, v)) = (self.turn.sin_cos(), (u - self.middle[0], v - self.middle[1]));
        [c * u - s * v, s * u + c * v]
    }

    /// A place of the map in the pattern.
    pub(super) fn of(&self, x: f64, y: f64) -> [f64; 2] {
        let (s, c) = self.turn.sin_cos();
        [c * x + s * y + self.middle[0], c * y - s * x + self.middle[1]]
    }

    /// A direction on the map; 0 is along the rows.
    pub(super) fn yaw(&self, of: f64) -> f32 {
        (self.turn + of) as f32
    }

    pub(super) fn path(&self, corners: &[[f64; 2]]) -> Path {
        Path::new(corners.iter().map(|[u, v]| self.at(*u, *v)))
    }
}

/// Corners of a way up one row and down the next: along `u` between two ends, at each of some places across.
pub(super) fn serpentine([from, to]: [f64; 2], across: &[f64]) -> Vec<[f64; 2]> {
    let legs = across.iter().enumerate();
    legs.flat_map(|(n, v)| if n % 2 == 0 { [[from, *v], [to, *v]] } else { [[to, *v], [from, *v]] }).collect()
}

/// How many legs of a serpentine make a way of `length_m` metres, with a margin for bends that are cut: one leg and the way to
/// the next are `each_m`.
pub(super) fn legs(length_m: f64, each_m: f64) -> usize {
    ((1.1 * length_m + 60.0) / each_m).ceil().max(2.0) as usize
}

type Make = Box<dyn Fn() -> Vec<Shape> + Send + Sync>;

/// What stands somewhere; its shapes are made when they are asked for.
struct Thing {
    tile: (i32, i32),
    id: u32,
    class: Class,
    at: [f64; 2],
    shapes: Make,
}

/// What a visit's redrawing of a place holds.
pub(super) struct Put {
    pub(super) class: Class,
    pub(super) at: [f64; 2],
    pub(super) shapes: Make,
}

/// How a world lies: all but what stands there.
pub(super) struct Ground {
    pub(super) terrain: Terrain,
    pub(super) route: Path,
    pub(super) walks: Vec<Path>,
    pub(super) drives: Vec<Path>,
    pub(super) moving: Moving,
    /// What a place is made of.
    pub(super) of: Box<dyn Fn(f64, f64) -> Class + Send + Sync>,
}

/// A world as a list of what stands where.
pub(in crate::world) struct Site {
    ground: Ground,
    visit: Visit,
    /// Numbers given to what lasts, and to what is new at the visit.
    count: u32,
    new: u32,
    /// By tile, once [`done`](Self::done).
    things: Vec<Thing>,
}

impl Site {
    pub(super) fn new(ground: Ground, visit: Visit) -> Self {
        Self { ground, visit, count: 0, new: 0, things: Vec::new() }
    }

    pub(super) fn visit(&self) -> Visit {
        self.visit
    }

    /// The next number of what lasts: all that might stand counts, whether it does or not, so numbers hold over the visits.
    fn next(&mut self) -> u32 {
        self.count += 1;
        object_id((((self.count - 1) / PAGE) as i32, 0), (self.count - 1) % PAGE)
    }

    /// The next number of what is of this visit alone.
    fn next_new(&mut self) -> u32 {
        self.new += 1;
        new_object_id((((self.new - 1) / PAGE) as i32, 0), self.visit, (self.new - 1) % PAGE)
    }

    fn push(&mut self, id: u32, class: Class, at: [f64; 2], shapes: Make) {
        self.things.push(Thing { tile: tile_of(at[0], at[1]), id, class, at, shapes });
    }

    /// What is there at every visit.
    pub(super) fn fixed(
        &mut self,
        class: Class,
        at: [f64; 2],
        shapes: impl Fn() -> Vec<Shape> + Send + Sync + 'static,
    ) {
        let id = self.next();
        self.push(id, class, at, Box::new(shapes));
    }

    /// What lasts, and is gone at a visit at times; whether it stands.
    pub(super) fn lasting(
        &mut self,
        key: Key,
        class: Class,
        at: [f64; 2],
        shapes: impl Fn() -> Vec<Shape> + Send + Sync + 'static,
    ) -> bool {
        let (id, stands) = (self.next(), self.visit.keeps(key));
        if stands {
            self.push(id, class, at, Box::new(shapes));
        }
        stands
    }

    /// What is of this visit alone.
    pub(super) fn fresh(
        &mut self,
        class: Class,
        at: [f64; 2],
        shapes: impl Fn() -> Vec<Shape> + Send + Sync + 'static,
    ) {
        let id = self.next_new();
        self.push(id, class, at, Box::new(shapes));
    }

    /// A place whose content comes and goes: what is drawn for it from its key, or, once that has changed, from a key of the
    /// visit.
    pub(super) fn loose(&mut self, key: Key, of: impl FnOnce(Key) -> Option<Put>) {
        let kept = self.visit.keeps_loose(key);
        let old = self.next();
        let id = if kept { old } else { self.next_new() };
        if let Some(put) = of(if kept { key } else { self.visit.own(key) }) {
            self.push(id, put.class, put.at, put.shapes);
        }
    }

    /// Sorted by tile, which everything else asks for.
    pub(super) fn done(mut self) -> Self {
        self.things.sort_by_key(|t| (t.tile, t.id));
        self
    }

    pub(in crate::world) fn route(&self) -> &Path {
        &self.ground.route
    }

    pub(in crate::world) fn walks(&self) -> Vec<Path> {
        self.ground.walks.clone()
    }

    pub(in crate::world) fn drives(&self) -> Vec<Path> {
        self.ground.drives.clone()
    }

    pub(in crate::world) fn moving(&self) -> Moving {
        self.ground.moving
    }

    pub(in crate::world) fn height(&self, x: f64, y: f64) -> f64 {
        self.ground.terrain.height(x, y, 0.0, 1.0)
    }

    pub(in crate::world) fn ground(&self, x: f64, y: f64) -> Class {
        (self.ground.of)(x, y)
    }

    pub(in crate::world) fn objects(&self, tile: (i32, i32)) -> Vec<Object> {
        let start = self.things.partition_point(|t| t.tile < tile);
        let here = self.things[start..].iter().take_while(|t| t.tile == tile);
        here.map(|t| {
            let [x, y] = t.at;
            let anchor = Vector3::new(x, y, self.height(x, y));
            Object { id: t.id, class: t.class, anchor, shapes: (t.shapes)() }
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_lead_there_and_back() {
        let frame = Frame::new(Key::new(5), [40.0, -3.0]);
        let [x, y] = frame.at(12.0, 34.0);
        let [u, v] = frame.of(x, y);
        assert!((u - 12.0).abs() < 1e-9 && (v - 34.0).abs() < 1e-9);
        let [[a, b], [c, d]] = [frame.at(0.0, 0.0), frame.at(1.0, 0.0)];
        assert!(((d - b).atan2(c - a) as f32 - frame.yaw(0.0)).sin().abs() < 1e-6);
    }
}

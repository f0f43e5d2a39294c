//! What stands along one street, placed and numbered.

use nalgebra::Vector3;

use super::{Street, Urban};
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::world::{Class, Object, new_object_id, object_id, tile_of};

/// Objects along one street, those of one tile kept.
pub(super) struct Row<'a> {
    pub(super) town: &'a Urban,
    pub(super) street: &'a Street,
    pub(super) tile: (i32, i32),
    pub(super) count: u32,
    pub(super) objects: &'a mut Vec<Object>,
}

/// A place beside a street.
#[derive(Clone, Copy)]
pub(super) struct Place {
    pub(super) x: f64,
    pub(super) y: f64,
    /// Direction of the street, and towards it from here.
    pub(super) along: f32,
    pub(super) inward: f32,
}

impl Row<'_> {
    pub(super) fn place(&self, left: bool, s: f64, off: f64) -> Place {
        let p = self.street.path.at(s);
        let heading = self.street.path.heading(s, 3.0);
        let turn = if left { std::f64::consts::FRAC_PI_2 } else { -std::f64::consts::FRAC_PI_2 };
        let out = heading + turn;
        let (x, y) = (p[0] + off * out.cos(), p[1] + off * out.sin());
        Place { x, y, along: heading as f32, inward: (out + std::f64::consts::PI) as f32 }
    }

    /// The next number: every thing that might stand counts, whether it does or not, so numbers hold over the visits.
    pub(super) fn next_id(&mut self, new: bool) -> u32 {
        self.count += 1;
        let count = self.count + 0x1000 * self.street.side;
        match new {
            true => new_object_id(self.street.cell, self.town.visit, count),
            false => object_id(self.street.cell, count),
        }
    }

    /// Whether this tile owns what stands here.
    pub(super) fn owns(&self, at: Place) -> bool {
        tile_of(at.x, at.y) == self.tile
    }

    /// Puts an object up if this tile owns it; its shapes are made only then.
    pub(super) fn put(&mut self, id: u32, class: Class, at: Place, shapes: impl FnOnce() -> Vec<Shape>) {
        if tile_of(at.x, at.y) == self.tile {
            let anchor = Vector3::new(at.x, at.y, self.town.height(at.x, at.y));
            self.objects.push(Object { id, class, anchor, shapes: shapes() });
        }
    }

    /// The same for something that lasts; where it is gone in this visit, nothing stands.
    pub(super) fn lasting(
        &mut self,
        key: Key,
        class: Class,
        at: Place,
        shapes: impl FnOnce(&mut Draw) -> Vec<Shape>,
    ) {
        let id = self.next_id(false);
        if self.town.visit.keeps(key) {
            self.put(id, class, at, || shapes(&mut key.with(1).draw()));
        }
    }

    /// For cars and bins: another one stands elsewhere near where the first has gone.
    pub(super) fn loose(
        &mut self,
        key: Key,
        left: bool,
        s: f64,
        off: f64,
        class: Class,
        of: impl FnOnce(f32, &mut Draw) -> Vec<Shape>,
    ) {
        let (old, new) = (self.next_id(false), self.next_id(true));
        let visit = self.town.visit;
        if visit.keeps_loose(key) {
            let at = self.place(left, s, off);
            self.put(old, class, at, || of(at.along, &mut key.with(1).draw()));
            return;
        }
        let own = visit.own(key);
        let mut draw = own.draw();
        // Places fall empty and are taken again.
        if draw.chance(0.7) {
            let at = self.place(
                left,
                s + f64::from(draw.range(-1.2, 1.2)),
                off + f64::from(draw.range(-0.2, 0.2)),
            );
            self.put(new, class, at, || of(at.along, &mut own.with(1).draw()));
        }
    }
}

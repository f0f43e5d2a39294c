//! Along the kerb: parked cars, lamps, signs, cabinets, bollards, street trees, people.

use nalgebra::Vector3;

use super::CORNER;
use super::row::Row;
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::world::Class;
use crate::world::furniture::{bollard, cabinet, lamp, person, sign};
use crate::world::tree::street_tree;
use crate::world::vehicle::vehicle;

impl Row<'_> {
    pub(super) fn kerb_side(&mut self, left: bool, key: Key, length: f64) {
        let mut draw = key.draw();
        if self.street.section.parking[usize::from(left)] {
            self.parked(left, key, length, &mut draw);
        }
        self.kerb_stones(left, length);
        self.pavement_things(left, key, length, &mut draw);
    }

    /// Cars in the strip beside the carriageway, with gaps as drivers leave them.
    fn parked(&mut self, left: bool, key: Key, length: f64, draw: &mut Draw) {
        let taken = draw.range(0.15, 0.75);
        let mut s = CORNER - 2.0;
        let mut n = 0;
        while s < length - CORNER + 2.0 {
            n += 1;
            if draw.chance(taken) {
                let (car, van) = (key.with(100 + n), draw.chance(0.12));
                let turned = draw.chance(0.3);
                let class = if van { Class::Van } else { Class::Car };
                let off = self.street.section.half_road + 1.1 + 0.12 * f64::from(draw.normal());
                self.loose(car, left, s + 2.6, off, class, |along, d| {
                    let nose = if turned { along } else { along + std::f32::consts::PI };
                    vehicle(van, nose + 0.03 * d.normal(), d)
                });
            }
            s += f64::from(draw.range(5.3, 7.6));
        }
    }

    /// The pavement's edge, in straight pieces.
    fn kerb_stones(&mut self, left: bool, length: f64) {
        let pieces = ((length - 2.0 * 8.0) / 4.0).max(0.0) as usize;
        let off = self.street.section.kerb(left) + 0.06;
        for k in 0..pieces {
            let s = 8.0 + 4.0 * (k as f64 + 0.5);
            let (id, at) = (self.next_id(false), self.place(left, s, off));
            self.put(id, Class::Pavement, at, || {
                vec![Shape::cuboid(Vector3::zeros(), Vector3::new(2.02, 0.075, 0.12), at.along)]
            });
        }
    }

    fn pavement_things(&mut self, left: bool, key: Key, length: f64, draw: &mut Draw) {
        let section = self.street.section;
        let (kerb, front) = (section.kerb(left), section.front(left));
        let mut s = f64::from(draw.range(8.0, 16.0));
        let mut n = 0;
        let trees = draw.chance(0.45);
        while s < length - 8.0 {
            n += 1;
            let thing = key.with(300 + n);
            let at_kerb = self.place(left, s, kerb + f64::from(draw.range(0.2, 0.45)));
            let at_back = self.place(left, s, front - f64::from(draw.range(0.15, 0.5)));
            let inward = at_kerb.inward;
            match draw.unit() {
                u if u < 0.2 => self.lasting(thing, Class::Pole, at_back, |d| lamp(inward, d)),
                u if u < 0.34 => self.lasting(thing, Class::Sign, at_kerb, |d| sign(at_kerb.along, d)),
                u if u < 0.4 => self.lasting(thing, Class::Bin, at_back, |d| cabinet(inward, d)),
                u if u < 0.43 => {
                    for k in 0..draw.count(2, 5) {
                        let at = self.place(left, s + 1.6 * k as f64, kerb + 0.3);
                        self.lasting(thing.with(k as u64), Class::Pole, at, bollard);
                    }
                }
                _ if trees => {
                    let visit = self.town.visit;
                    self.lasting(thing, Class::Tree, at_kerb, |d| {
                        street_tree(visit.season, d, &mut visit.own(thing).draw())
                    });
                }
                _ => {}
            }
            if draw.chance(0.2) {
                // People of this visit only.
                let id = self.next_id(true);
                let own = self.town.visit.own(thing.with(9));
                let mut d = own.draw();
                let off = kerb + section.pavement * f64::from(d.range(0.3, 0.7));
                let at = self.place(left, s + f64::from(d.range(-9.0, 9.0)), off);
                let yaw = at.along + if d.chance(0.5) { 0.0 } else { std::f32::consts::PI };
                self.put(id, Class::Person, at, || person(yaw, d.range(0.85, 1.08), &mut d));
            }
            s += f64::from(draw.range(5.0, 15.0));
        }
    }
}

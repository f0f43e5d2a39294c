//! Lots along a street: houses and what lies around them, and lots that were never built on.

use nalgebra::Vector3;

use super::CORNER;
use super::row::Row;
use crate::hash::{Draw, Key};
use crate::world::Class;
use crate::world::building::{House, creeper, house, shed};
use crate::world::furniture::{bin, fence, wall};
use crate::world::plants::{bush, column, hedge, tuft};
use crate::world::tree::{garden_tree, street_tree};
use crate::world::vehicle::vehicle;

/// One lot's measures, metres: along the street, and out from its middle.
#[derive(Clone, Copy)]
struct Lot {
    left: bool,
    s: f64,
    width: f64,
    /// Room beside the house, at the far end.
    gap: f64,
    /// The property line and the house's front; without a house, the depth that is planted.
    front: f64,
    back: f64,
    key: Key,
}

/// What bounds gardens along a street.
#[derive(Clone, Copy)]
enum Boundary {
    Wall,
    Hedge,
    Fence,
    Shrubs,
    Open,
}

impl Boundary {
    fn of(draw: &mut Draw) -> Self {
        match draw.unit() {
            u if u < 0.2 => Self::Wall,
            u if u < 0.56 => Self::Hedge,
            u if u < 0.7 => Self::Fence,
            u if u < 0.96 => Self::Shrubs,
            _ => Self::Open,
        }
    }
}

impl Row<'_> {
    pub(super) fn side(&mut self, left: bool) {
        let key = self.street.key.with(100 + u64::from(left));
        let mut draw = key.draw();
        let length = self.street.path.length();
        let front = self.street.section.front(left);
        let terrace = draw.chance(0.4);
        let setback = if terrace { f64::from(draw.range(0.0, 2.2)) } else { f64::from(draw.range(1.6, 4.8)) };
        let floors = draw.count(1, 3);
        let boundary = Boundary::of(&mut draw);
        let mut s = CORNER;
        // The corners: gardens of the houses of the other street.
        for (n, from) in [(0, front + 4.5), (1, length - CORNER)] {
            let width = CORNER - front - 4.5;
            let lot = Lot { left, s: from, width, gap: 0.0, front, back: front + 6.0, key: key.with(20 + n) };
            self.bound(lot, boundary);
            self.plants(lot);
        }
        let mut n = 0;
        while s < length - CORNER {
            let house_key = key.with(1000 + n);
            let mut draw = house_key.draw();
            n += 1;
            let width = f64::from(draw.range(5.5, if terrace { 9.0 } else { 13.5 }));
            if s + width > length - CORNER + 3.0 {
                break;
            }
            let gap = if terrace && draw.chance(0.85) { 0.0 } else { f64::from(draw.range(1.2, 5.5)) };
            let back = front + setback + if terrace { 0.0 } else { f64::from(draw.range(-0.8, 1.6)) };
            let mut lot = Lot { left, s, width, gap, front, back, key: house_key };
            let kind = if draw.chance(0.7) { boundary } else { Boundary::of(&mut draw) };
            if draw.chance(0.14) {
                lot.back = front + 11.0;
                self.bound(lot, kind);
                self.plants(lot);
                self.thicket(lot, front + 9.0);
            } else {
                self.house(lot, floors, &mut draw);
                if back - front > 1.2 {
                    self.bound(lot, kind);
                }
                self.plants(lot);
                self.beside(lot);
                self.thicket(lot, back + 11.5);
            }
            s += width + gap;
        }
        self.kerb_side(left, key.with(2), length);
    }

    fn house(&mut self, lot: Lot, floors: usize, draw: &mut Draw) {
        let at = self.place(lot.left, lot.s + 0.5 * lot.width, lot.back);
        let depth = draw.range(7.0, 10.5);
        let floors = (floors + usize::from(draw.chance(0.2))).min(4);
        let (walls, glass, green) = (self.next_id(false), self.next_id(false), lot.key.with(4));
        let width = lot.width as f32;
        if self.owns(at) {
            let mut d = lot.key.with(1).draw();
            let built = if width > 7.5 && d.chance(0.45) {
                // Two volumes, one of which stands out.
                let first = width * d.range(0.35, 0.65);
                let step = d.range(0.3, 1.6) * if d.chance(0.5) { 1.0 } else { -1.0 };
                let by = |x: f32, y: f32| {
                    let (s, c) = at.inward.sin_cos();
                    Vector3::new(c * x - s * y, s * x + c * y, 0.0)
                };
                let one = house(first, depth + step.max(0.0), floors, at.inward, &mut d);
                let other = house(width - first, depth, floors, at.inward, &mut d);
                let none = House { walls: Vec::new(), glass: Vec::new() };
                none.joined(one, by(step, 0.5 * (first - width))).joined(other, by(0.0, 0.5 * first))
            } else {
                house(width, depth, floors, at.inward, &mut d)
            };
            self.put(walls, Class::Building, at, || built.walls);
            self.put(glass, Class::Window, at, || built.glass);
        }
        if draw.chance(0.18) {
            let season = self.town.visit.season;
            self.lasting(green, Class::Bush, at, |d| creeper(width, at.inward, season, d));
        }
    }

    /// The boundary towards the pavement, with a gate.
    fn bound(&mut self, lot: Lot, kind: Boundary) {
        let mut draw = lot.key.with(2).draw();
        let visit = self.town.visit;
        let gate = f64::from(if draw.chance(0.3) { draw.range(2.2, 3.2) } else { draw.range(0.8, 1.3) })
            .min(0.5 * lot.width);
        // Neighbours do not build on one line.
        let off = lot.front + f64::from(draw.range(0.1, 0.45));
        let at = self.place(lot.left, lot.s, off);
        let far =
            self.place(lot.left, lot.s + lot.width + lot.gap - gate, off + f64::from(draw.range(-0.1, 0.1)));
        let (dx, dy) = (far.x - at.x, far.y - at.y);
        let (run, yaw) = (dx.hypot(dy) as f32, dy.atan2(dx) as f32);
        let (key, growth) = (lot.key.with(3), visit.growth(lot.key));
        match kind {
            Boundary::Wall => {
                let height = draw.range(0.5, 1.9);
                self.lasting(key, Class::Wall, at, |d| wall(run, yaw, height, d));
            }
            Boundary::Hedge => {
                let (height, width) = (draw.range(0.9, 2.5), draw.range(0.6, 1.2));
                let at = self.place(lot.left, lot.s, off + 0.5 * f64::from(width));
                self.lasting(key, Class::Hedge, at, |d| hedge(run, yaw, height, width, growth, d));
            }
            Boundary::Fence => {
                let height = draw.range(0.9, 1.9);
                self.lasting(key, Class::Fence, at, |d| fence(run, yaw, height, d));
            }
            Boundary::Shrubs => {
                let mut s = 0.4;
                let mut n = 0;
                while s < f64::from(run) {
                    let shrub = key.with(10 + n);
                    n += 1;
                    let mut draw = shrub.draw();
                    let (size, evergreen) = (draw.range(0.5, 1.3), draw.chance(0.5));
                    let out = off + 0.5 * f64::from(size) + f64::from(draw.range(0.1, 0.9));
                    let at = self.place(lot.left, lot.s + s, out);
                    let grown = size * visit.growth(shrub);
                    self.lasting(shrub, Class::Bush, at, |d| bush(grown, evergreen, visit.season, d));
                    s += f64::from(draw.range(0.7, 2.0) * (0.4 + size));
                }
            }
            Boundary::Open => {}
        }
    }

    /// Bushes, flowers, conifers and small trees before the house.
    fn plants(&mut self, lot: Lot) {
        let mut draw = lot.key.with(5).draw();
        let visit = self.town.visit;
        let yard = (lot.back - lot.front - 0.8).max(0.0);
        let area = yard * (lot.width + lot.gap);
        // Where something grows: half of it lines the boundary or the house.
        let somewhere = |draw: &mut Draw| {
            let s = lot.s + f64::from(draw.unit()) * (lot.width + lot.gap);
            let t = draw.unit();
            let t = if draw.chance(0.5) { (8.0 * (t - 0.5)).tanh() * 0.5 + 0.5 } else { t };
            (s, lot.front + 0.9 + f64::from(t) * (yard - 0.7).max(0.1))
        };
        for n in 0..((area / 6.0) * f64::from(draw.range(0.4, 1.7))).round().min(14.0) as u64 {
            let (s, off) = somewhere(&mut draw);
            let (size, evergreen) = (draw.range(0.6, 1.25).powi(2) * 0.9 + 0.1, draw.chance(0.5));
            let (key, at) = (lot.key.with(100 + n), self.place(lot.left, s, off));
            let size = size * visit.growth(key);
            self.lasting(key, Class::Bush, at, |d| bush(size, evergreen, visit.season, d));
        }
        for n in 0..((area / 14.0) * f64::from(draw.range(0.0, 1.5))).round().min(5.0) as u64 {
            let (s, off) = somewhere(&mut draw);
            let at = self.place(lot.left, s, off);
            self.lasting(lot.key.with(180 + n), Class::Undergrowth, at, tuft);
        }
        if yard > 0.8 && draw.chance(0.3) {
            let (s, off) = somewhere(&mut draw);
            let (height, at) = (draw.range(1.2, 5.0), self.place(lot.left, s, off));
            for n in 0..draw.count(1, 3) as u64 {
                let at = if n == 0 { at } else { self.place(lot.left, s + 1.3 * n as f64, off) };
                self.lasting(lot.key.with(140 + n), Class::Tree, at, |d| {
                    column(height * d.range(0.8, 1.1), d)
                });
            }
        }
        for n in 0..3 {
            if yard > 1.6 && draw.chance(0.45) {
                let (s, off) = somewhere(&mut draw);
                let (key, at) = (lot.key.with(150 + n), self.place(lot.left, s, off));
                self.lasting(key, Class::Tree, at, |d| {
                    garden_tree(visit.season, d, &mut visit.own(key).draw())
                });
            }
        }
        if draw.chance(0.4) {
            let s = lot.s + f64::from(draw.range(0.5, 2.0));
            let off = lot.front + f64::from(draw.range(-0.5, 0.9));
            self.loose(lot.key.with(160), lot.left, s, off, Class::Bin, bin);
        }
    }

    /// Between two houses: a gate, a garage or a hedge; a car in the drive.
    fn beside(&mut self, lot: Lot) {
        if lot.gap < 1.5 {
            return;
        }
        let mut draw = lot.key.with(6).draw();
        let (visit, key) = (self.town.visit, lot.key.with(30));
        let run = lot.gap as f32;
        let s = lot.s + lot.width;
        let off = lot.back - f64::from(draw.range(0.4, 3.0));
        let at = self.place(lot.left, s, off);
        match draw.unit() {
            u if u < 0.2 => self.lasting(key, Class::Fence, at, |d| fence(run, at.along, 1.8, d)),
            u if u < 0.35 => self.lasting(key, Class::Wall, at, |d| wall(run, at.along, 2.0, d)),
            u if u < 0.6 => {
                let growth = visit.growth(key);
                self.lasting(key, Class::Hedge, at, |d| hedge(run, at.along, 2.1, 0.9, growth, d));
            }
            u if u < 0.92 => {
                let at = self.place(lot.left, s + 0.5 * lot.gap, off);
                self.lasting(key, Class::Building, at, |d| shed((run - 0.3).min(3.4), at.inward, d));
            }
            _ => {}
        }
        if lot.gap > 2.6 && off - lot.front > 4.8 && draw.chance(0.55) {
            // Its nose or its tail to the house.
            let yaw = at.inward + if draw.chance(0.6) { std::f32::consts::PI } else { 0.0 };
            let place = (s + 0.5 * lot.gap, off - 2.8);
            self.loose(lot.key.with(31), lot.left, place.0, place.1, Class::Car, |_, d| {
                vehicle(false, yaw, d)
            });
        }
    }

    /// What closes the view behind: trees over the roofs, tall shrubs, a hedge between the gardens.
    fn thicket(&mut self, lot: Lot, from: f64) {
        let mut draw = lot.key.with(7).draw();
        let visit = self.town.visit;
        let width = lot.width + lot.gap;
        if draw.chance(0.5) {
            let key = lot.key.with(40);
            let off = (from + 5.0 * f64::from(draw.unit())).min(super::REACH - 2.0);
            let at = self.place(lot.left, lot.s + width * f64::from(draw.unit()), off);
            self.lasting(key, Class::Tree, at, |d| street_tree(visit.season, d, &mut visit.own(key).draw()));
        }
        // A hedge between the gardens.
        let (key, at) = (lot.key.with(41), self.place(lot.left, lot.s, from - 1.5));
        let (run, height) = ((width + 0.5) as f32, draw.range(1.6, 2.8));
        if draw.chance(0.75) {
            self.lasting(key, Class::Hedge, at, |d| hedge(run, at.along, height, 1.1, visit.growth(key), d));
        }
        for n in 0..draw.count(1, 4) as u64 {
            let key = lot.key.with(50 + n);
            let off = (from + 6.0 * f64::from(draw.unit())).min(super::REACH - 2.0);
            let at = self.place(lot.left, lot.s + width * f64::from(draw.unit()), off);
            let size = draw.range(0.8, 2.2) * visit.growth(key);
            self.lasting(key, Class::Bush, at, |d| bush(size, true, visit.season, d));
        }
    }
}

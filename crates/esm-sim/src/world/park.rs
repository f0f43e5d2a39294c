//! A city park: lawns and paths, lone and grouped trees, hedges, benches, lamps, statues, low walls, a ring of facades.

use nalgebra::Vector3;

use super::building::house;
use super::furniture::{bench, bin, fence, lamp, person, statue, wall};
use super::plants::{bush, hedge};
use super::terrain::Terrain;
use super::tree::{Room, Species, tree};
use super::vehicle::vehicle;
use super::visit::Visit;
use super::{Class, Object, new_object_id, object_id, tile_of};
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::motion::Path;
use crate::noise::value;

/// From the lawn's edge to the facades: railing, pavement, street with parked cars, pavement.
const STREET: f64 = 17.0;
/// No smaller park, metres: lawns, beds and statues need room beside the paths.
const LEAST_SIDE: f64 = 80.0;

pub(super) struct Park {
    key: Key,
    terrain: Terrain,
    route: Path,
    paths: Vec<Path>,
    /// Half sides of the lawn, metres.
    half: [f64; 2],
    visit: Visit,
    /// All objects, sorted by tile: a park is small.
    objects: Vec<((i32, i32), Object)>,
}

impl Park {
    pub(super) fn new(key: Key, length_m: f64, visit: Visit) -> Self {
        let terrain =
            Terrain { key: key.with(1), layers: &[(160.0, 2.2), (45.0, 0.5), (11.0, 0.08), (2.3, 0.02)] };
        // A walk around and a diagonal through make up the route. However short the route, the park is one.
        let side = (length_m / 4.6).max(LEAST_SIDE);
        let half = [0.6 * side, 0.5 * side];
        let ring = |inset: f64, n: u64| {
            Path::new((0..=160).map(|k| {
                let a = f64::from(k) / 160.0 * std::f64::consts::TAU;
                // A superellipse: a rectangle with round corners, bent a little.
                let p = |v: f64| v.signum() * v.abs().powf(0.55);
                let sway = 1.0 + 0.05 * value(key.with(n), 3.0 * a.cos(), 3.0 * a.sin());
                [(half[0] - inset) * sway * p(a.cos()), (half[1] - inset) * sway * p(a.sin())]
            }))
        };
        let outer = ring(6.0, 2);
        let cross = |n: u64, from: [f64; 2], to: [f64; 2]| {
            Path::new((0..=60).map(|k| {
                let t = f64::from(k) / 60.0;
                let off = 7.0 * value(key.with(n), 3.0 * t, 0.5) * (t * (1.0 - t) * 4.0);
                let d = [to[0] - from[0], to[1] - from[1]];
                let norm = d[0].hypot(d[1]);
                [from[0] + t * d[0] - off * d[1] / norm, from[1] + t * d[1] + off * d[0] / norm]
            }))
        };
        let (x, y) = (half[0] - 8.0, half[1] - 8.0);
        let first = cross(3, [-0.86 * x, -0.86 * y], [0.86 * x, 0.86 * y]);
        let second = cross(4, [-0.86 * x, 0.86 * y], [0.86 * x, -0.86 * y]);
        // The route: diagonal, then around, until the length is reached.
        let mut corners = first.points().to_vec();
        let start =
            outer.points().iter().enumerate().map(|(n, p)| (n, (p[0] - 0.86 * x).hypot(p[1] - 0.86 * y)));
        let start = start.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0, |(n, _)| n);
        let ring_points = &outer.points()[..outer.points().len() - 1];
        corners.extend(ring_points.iter().cycle().skip(start).take(ring_points.len() + 40));
        let rough = Path::new(corners);
        let route = rough.smoothed(0.0, rough.length(), 4.0);
        let paths = vec![outer, first, second];
        let mut park = Self { key, terrain, route, paths, half, visit, objects: Vec::new() };
        park.objects = park.everything();
        park
    }

    pub(super) fn route(&self) -> &Path {
        &self.route
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.terrain.height(x, y, 0.0, 1.0)
    }

    /// Both sides of the paths.
    pub(super) fn walks(&self) -> Vec<Path> {
        self.paths.iter().flat_map(|p| [p.offset(1.35), p.offset(-1.35)]).collect()
    }

    /// The street around, a lane each way between the parked cars.
    pub(super) fn drives(&self) -> Vec<Path> {
        let lap = |out: f64| {
            let [x, y] = [self.half[0] + out, self.half[1] + out];
            let corners = [[-x, -y], [x, -y], [x, y], [-x, y]];
            let twice = Path::new(corners.into_iter().cycle().take(9));
            // From the middle of a side once around: where the way closes it is straight.
            let (once, start) = (0.5 * twice.length(), x);
            twice.smoothed(start, start + once, 5.0)
        };
        vec![lap(9.9), lap(7.1).reversed()]
    }

    /// How far outside of the lawn; negative inside.
    fn outside(&self, x: f64, y: f64) -> f64 {
        (x.abs() - self.half[0]).max(y.abs() - self.half[1])
    }

    fn to_path(&self, x: f64, y: f64) -> f64 {
        self.paths.iter().map(|p| p.distance(x, y)).fold(f64::INFINITY, f64::min)
    }

    pub(super) fn ground(&self, x: f64, y: f64) -> Class {
        match self.outside(x, y) {
            d if d > 13.5 || (0.3..3.5).contains(&d) => Class::Pavement,
            d if d > 0.0 => Class::Road,
            _ if self.to_path(x, y) < 1.6 => Class::Pavement,
            _ => Class::Grass,
        }
    }

    pub(super) fn objects(&self, tile: (i32, i32)) -> Vec<Object> {
        let start = self.objects.partition_point(|(t, _)| *t < tile);
        self.objects[start..].iter().take_while(|(t, _)| *t == tile).map(|(_, o)| o.clone()).collect()
    }

    fn everything(&self) -> Vec<((i32, i32), Object)> {
        let mut all = Fill { park: self, count: 0, objects: Vec::new() };
        all.lawn();
        all.path_side();
        for side in 0..4 {
            all.edge(side);
        }
        let mut objects = all.objects;
        objects.sort_by_key(|(tile, o)| (*tile, o.id));
        objects
    }
}

struct Fill<'a> {
    park: &'a Park,
    count: u32,
    objects: Vec<((i32, i32), Object)>,
}

impl Fill<'_> {
    fn put(&mut self, key: Key, class: Class, x: f64, y: f64, of: impl FnOnce(&mut Draw) -> Vec<Shape>) {
        self.count += 1;
        if !self.park.visit.keeps(key) {
            return;
        }
        // Counts go on over the pages of ids, one page after the other.
        let id = object_id(((self.count >> 12) as i32, 0), self.count & 0xFFF);
        let anchor = Vector3::new(x, y, self.park.height(x, y));
        self.objects.push((tile_of(x, y), Object { id, class, anchor, shapes: of(&mut key.with(1).draw()) }));
    }

    /// Things of this visit alone, or moved since.
    fn loose(
        &mut self,
        key: Key,
        class: Class,
        at: impl FnOnce(&mut Draw) -> [f64; 2],
        of: impl FnOnce(&mut Draw) -> Vec<Shape>,
    ) {
        self.count += 1;
        let visit = self.park.visit;
        let kept = visit.keeps_loose(key) && class != Class::Person;
        let own = if kept { key } else { visit.own(key) };
        let [x, y] = at(&mut own.draw());
        let page = (self.count >> 12) as i32;
        let count = self.count & 0xFFF;
        let id = if kept { object_id((page, 0), count) } else { new_object_id((page, 0), visit, count) };
        let anchor = Vector3::new(x, y, self.park.height(x, y));
        self.objects.push((tile_of(x, y), Object { id, class, anchor, shapes: of(&mut own.with(1).draw()) }));
    }

    /// Trees alone and in groups, bushes in beds, statues, hedges.
    fn lawn(&mut self) {
        let park = self.park;
        let visit = park.visit;
        let key = park.key.with(10);
        let [hx, hy] = park.half;
        let tries = (4.0 * hx * hy / 42.0) as u64;
        let mut stems: Vec<[f64; 2]> = Vec::new();
        for n in 0..tries {
            let key = key.with(n);
            let mut d = key.draw();
            let (x, y) =
                (f64::from(d.range(-1.0, 1.0)) * (hx - 2.0), f64::from(d.range(-1.0, 1.0)) * (hy - 2.0));
            let grove = value(park.key.with(11), x / 24.0, y / 24.0) as f32;
            let room = if grove > 0.3 { 3.2 } else { 7.5 };
            let crowded = stems.iter().any(|s| (s[0] - x).hypot(s[1] - y) < room);
            if park.to_path(x, y) < 2.6 || crowded || d.range(-1.0, 0.7) > grove {
                continue;
            }
            stems.push([x, y]);
            let species =
                [Species::Oak, Species::Beech, Species::Beech, Species::Birch, Species::Pine][d.index(5)];
            let dbh = d.range(0.18, 0.75);
            let height = species.height(dbh) * d.range(0.75, 1.0);
            self.put(key, Class::Tree, x, y, |s| {
                tree(species, dbh, height, Room::Open, visit.season, s, &mut visit.own(key).draw())
            });
        }
        for n in 0..tries {
            let key = park.key.with(12).with(n);
            let mut d = key.draw();
            let (x, y) =
                (f64::from(d.range(-1.0, 1.0)) * (hx - 1.5), f64::from(d.range(-1.0, 1.0)) * (hy - 1.5));
            let bed = value(park.key.with(13), x / 13.0, y / 13.0) as f32
                + if park.outside(x, y) > -5.0 { 0.5 } else { 0.0 };
            if park.to_path(x, y) < 2.2 || d.range(0.0, 1.4) > bed {
                continue;
            }
            let (size, evergreen) = (d.range(0.4, 1.4) * visit.growth(key), d.chance(0.5));
            self.put(key, Class::Bush, x, y, |d| bush(size, evergreen, visit.season, d));
        }
        for n in 0..4 {
            let key = park.key.with(14).with(n);
            let mut d = key.draw();
            let (x, y) = (f64::from(d.range(-0.7, 0.7)) * hx, f64::from(d.range(-0.7, 0.7)) * hy);
            let yaw = d.range(0.0, std::f32::consts::TAU);
            if park.to_path(x, y) > 3.5 {
                self.put(key, Class::Statue, x, y, |d| statue(yaw, d));
            }
        }
        for n in 0..6 {
            let key = park.key.with(15).with(n);
            let mut d = key.draw();
            let (x, y) = (f64::from(d.range(-0.8, 0.8)) * hx, f64::from(d.range(-0.8, 0.8)) * hy);
            let (yaw, length) =
                (if d.chance(0.5) { 0.0f32 } else { std::f32::consts::FRAC_PI_2 }, d.range(5.0, 14.0));
            let end = |t: f32| (x + f64::from(t * length * yaw.cos()), y + f64::from(t * length * yaw.sin()));
            if [0.0, 0.25, 0.5, 0.75, 1.0].iter().all(|t| park.to_path(end(*t).0, end(*t).1) > 2.4) {
                let (height, growth) = (d.range(0.8, 1.8), visit.growth(key));
                if d.chance(0.65) {
                    self.put(key, Class::Hedge, x, y, |d| hedge(length, yaw, height, 0.9, growth, d));
                } else {
                    self.put(key, Class::Wall, x, y, |d| wall(length, yaw, 0.6 * height, d));
                }
            }
        }
    }

    /// Benches, lamps, bins and people along the paths.
    fn path_side(&mut self) {
        let park = self.park;
        for (n, path) in park.paths.iter().enumerate() {
            let mut s = 5.0;
            let mut k = 0;
            while s < path.length() - 5.0 {
                let key = park.key.with(20 + n as u64).with(k);
                k += 1;
                let mut d = key.draw();
                let (p, h) = (path.at(s), path.heading(s, 1.0));
                let side = if d.chance(0.5) { 1.0 } else { -1.0 };
                let out = h + side * std::f64::consts::FRAC_PI_2;
                let at = |off: f64| [p[0] + off * out.cos(), p[1] + off * out.sin()];
                let inward = (out + std::f64::consts::PI) as f32;
                let [x, y] = at(2.3);
                match d.unit() {
                    u if u < 0.35 => self.put(key, Class::Bench, x, y, |d| bench(inward, d)),
                    u if u < 0.7 => self.put(key, Class::Pole, x, y, |d| lamp(inward, d)),
                    u if u < 0.8 => self.loose(
                        key,
                        Class::Bin,
                        |d| at(2.2 + f64::from(d.range(0.0, 0.5))),
                        |d| bin(inward, d),
                    ),
                    _ => {
                        let along = h as f32;
                        self.loose(
                            key,
                            Class::Person,
                            |d| at(f64::from(d.range(-1.2, 1.2))),
                            |d| person(along, d.range(0.9, 1.06), d),
                        );
                    }
                }
                s += f64::from(d.range(5.0, 14.0));
            }
        }
    }

    /// One side of the square: railing or wall, trees and cars along the street, facades behind.
    fn edge(&mut self, side: u64) {
        let park = self.park;
        let [hx, hy] = park.half;
        let (length, off, yaw) = match side {
            0 => (2.0 * hx, hy, 0.0f64),
            1 => (2.0 * hy, hx, std::f64::consts::FRAC_PI_2),
            2 => (2.0 * hx, hy, std::f64::consts::PI),
            _ => (2.0 * hy, hx, -std::f64::consts::FRAC_PI_2),
        };
        // Runs from -length/2 to length/2 along `yaw`, `off` metres to its right: outside is to the right.
        let (c, s) = (yaw.cos(), yaw.sin());
        let at = |t: f64, out: f64| [t * c + (off + out) * s, t * s - (off + out) * c];
        let (along, inward) = (yaw as f32, (yaw + std::f64::consts::FRAC_PI_2) as f32);
        let key = park.key.with(30 + side);
        let mut draw = key.draw();
        let mut t = -0.5 * length;
        let mut n = 0;
        while t < 0.5 * length - 1.0 {
            n += 1;
            let run = f64::from(draw.range(5.0, 11.0)).min(0.5 * length - t);
            let [x, y] = at(t, 0.0);
            // Gates where the paths lead out.
            if park.to_path(x, y) > 2.0 {
                let solid = side.is_multiple_of(2);
                let class = if solid { Class::Wall } else { Class::Fence };
                self.put(key.with(n), class, x, y, |d| {
                    if solid { wall(run as f32, along, 0.9, d) } else { fence(run as f32, along, 1.2, d) }
                });
            }
            t += run + if draw.chance(0.2) { 3.0 } else { 0.0 };
        }
        let mut t = -0.5 * length;
        while t < 0.5 * length {
            n += 1;
            for (out, share) in [(4.6, 0.6), (12.4, 0.75)] {
                if draw.chance(share) {
                    let (van, nose) = (
                        draw.chance(0.12),
                        along + if draw.chance(0.5) { 0.0 } else { std::f32::consts::PI },
                    );
                    let class = if van { Class::Van } else { Class::Car };
                    self.loose(
                        key.with(1000 + n).with(out as u64),
                        class,
                        |d| at(t + f64::from(d.range(-0.8, 0.8)), out),
                        |d| vehicle(van, nose + 0.02 * d.normal(), d),
                    );
                }
            }
            if draw.chance(0.3) {
                let [x, y] = at(t, 14.4);
                self.put(key.with(2000 + n), Class::Pole, x, y, |d| lamp(inward + std::f32::consts::PI, d));
            }
            t += f64::from(draw.range(5.6, 7.5));
        }
        let mut t = -0.5 * length - STREET + 2.0;
        while t < 0.5 * length + STREET - 6.0 {
            n += 1;
            let width = draw.range(6.0, 15.0);
            let [x, y] = at(t + 0.5 * f64::from(width), STREET);
            let (depth, floors) = (draw.range(9.0, 14.0), draw.count(3, 5));
            let built = house(width, depth, floors, inward, &mut key.with(3000 + n).draw());
            let (walls, glass) = (built.walls, built.glass);
            // Facades last.
            self.put_lasting(Class::Building, x, y, walls);
            self.put_lasting(Class::Window, x, y, glass);
            t += f64::from(width) + if draw.chance(0.15) { 4.0 } else { 0.0 };
        }
    }

    fn put_lasting(&mut self, class: Class, x: f64, y: f64, shapes: Vec<Shape>) {
        self.count += 1;
        let id = object_id(((self.count >> 12) as i32, 0), self.count & 0xFFF);
        let anchor = Vector3::new(x, y, self.park.height(x, y));
        self.objects.push((tile_of(x, y), Object { id, class, anchor, shapes }));
    }
}

//! A town: a bent lattice of streets with gaps, houses along them, gardens behind walls and hedges, parked cars.

use nalgebra::Vector3;
use rustc_hash::FxHashMap;

use super::building::house;
use super::furniture::{bin, fence, lamp, person, sign, wall};
use super::plants::{bush, hedge};
use super::terrain::Terrain;
use super::tree::{Species, tree};
use super::vehicle::vehicle;
use super::visit::Visit;
use super::{Class, Object, new_object_id, object_id, tile_of};
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::motion::Path;

/// Mean distance of crossings, metres.
const BLOCK: f64 = 88.0;
/// Half the width of the carriageway, metres.
const HALF_ROAD: f64 = 3.8;
/// From the middle of the road to the middle of a lane, metres.
const LANE: f64 = 1.6;
/// From this share of its length on, the route goes over streets that it has used before.
pub(crate) const REVISIT_SHARE: f64 = 0.8;
/// Between the middles of the two lanes, metres.
pub(super) const LANES_M: f64 = 2.0 * LANE;
/// From the middle of the road to the property line, metres: parking and pavement lie between.
const FRONT: f64 = 8.2;
/// No house nearer to a crossing, metres.
const CORNER: f64 = 18.0;
/// How far from its street an anchor may lie, metres.
const REACH: f64 = 24.0;

/// A street between two crossings.
struct Street {
    key: Key,
    path: Path,
    cell: (i32, i32),
    /// 0 or 1: numbers of streets that start at the same crossing stay apart.
    side: u32,
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
                        for dx in [-REACH, 0.0, REACH] {
                            for dy in [-REACH, 0.0, REACH] {
                                tiles.push(tile_of(p[0] + dx, p[1] + dy));
                            }
                        }
                    }
                    tiles.sort_unstable();
                    tiles.dedup();
                    for tile in tiles {
                        near.entry(tile).or_insert_with(Vec::new).push(n);
                    }
                    let key = key.with(10 + u64::from(side)).cell(i.into(), j.into());
                    streets.push(Street { key, path, cell: (i, j), side });
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
        let off = HALF_ROAD + 3.1;
        let ends = CORNER - 5.0;
        let sides = |s: &Street| {
            let middle = s.path.smoothed(ends, s.path.length() - ends, 1.0);
            [middle.offset(off), middle.offset(-off)]
        };
        self.streets.iter().flat_map(sides).collect()
    }

    pub(super) fn height(&self, x: f64, y: f64) -> f64 {
        self.terrain.height(x, y, 0.0, 1.0)
    }

    pub(super) fn ground(&self, x: f64, y: f64) -> Class {
        match self.to_street(x, y) {
            d if d < HALF_ROAD + 2.2 => Class::Road,
            d if d < FRONT => Class::Pavement,
            _ => Class::Grass,
        }
    }

    /// Distance to the middle of the nearest street; infinite beyond 8 m.
    fn to_street(&self, x: f64, y: f64) -> f64 {
        let near = self.near.get(&tile_of(x, y)).map_or(&[][..], Vec::as_slice);
        near.iter().map(|n| self.streets[*n as usize].path.distance(x, y)).fold(f64::INFINITY, f64::min)
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

/// Objects along one street, those of one tile kept.
struct Row<'a> {
    town: &'a Urban,
    street: &'a Street,
    tile: (i32, i32),
    count: u32,
    objects: &'a mut Vec<Object>,
}

/// A place beside a street.
#[derive(Clone, Copy)]
struct Place {
    x: f64,
    y: f64,
    /// Direction of the street, and towards it from here.
    along: f32,
    inward: f32,
}

impl Row<'_> {
    fn place(&self, left: bool, s: f64, off: f64) -> Place {
        let p = self.street.path.at(s);
        let heading = self.street.path.heading(s, 3.0);
        let turn = if left { std::f64::consts::FRAC_PI_2 } else { -std::f64::consts::FRAC_PI_2 };
        let out = heading + turn;
        let (x, y) = (p[0] + off * out.cos(), p[1] + off * out.sin());
        Place { x, y, along: heading as f32, inward: (out + std::f64::consts::PI) as f32 }
    }

    /// The next number: every thing that might stand counts, whether it does or not, so numbers hold over the visits.
    fn next_id(&mut self, new: bool) -> u32 {
        self.count += 1;
        let count = self.count + 0x1000 * self.street.side;
        match new {
            true => new_object_id(self.street.cell, self.town.visit, count),
            false => object_id(self.street.cell, count),
        }
    }

    /// Puts an object up if this tile owns it; its shapes are made only then.
    fn put(&mut self, id: u32, class: Class, at: Place, shapes: impl FnOnce() -> Vec<Shape>) {
        if tile_of(at.x, at.y) == self.tile {
            let anchor = Vector3::new(at.x, at.y, self.town.height(at.x, at.y));
            self.objects.push(Object { id, class, anchor, shapes: shapes() });
        }
    }

    /// The same for something that lasts; where it is gone in this visit, nothing stands.
    fn lasting(&mut self, key: Key, class: Class, at: Place, shapes: impl FnOnce(&mut Draw) -> Vec<Shape>) {
        let id = self.next_id(false);
        if self.town.visit.keeps(key) {
            self.put(id, class, at, || shapes(&mut key.with(1).draw()));
        }
    }

    /// For cars and bins: another one stands elsewhere near where the first has gone.
    fn loose(
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

    fn side(&mut self, left: bool) {
        let key = self.street.key.with(100 + u64::from(left));
        let mut draw = key.draw();
        let length = self.street.path.length();
        let terrace = draw.chance(0.4);
        let setback = if terrace { f64::from(draw.range(0.6, 3.0)) } else { f64::from(draw.range(3.0, 7.0)) };
        let floors = draw.count(1, 3);
        let boundary = draw.index(3);
        let mut s = CORNER;
        let mut n = 0;
        while s < length - CORNER {
            let house_key = key.with(1000 + n);
            let mut draw = house_key.draw();
            n += 1;
            let width = f64::from(draw.range(5.2, if terrace { 8.0 } else { 12.5 }));
            if s + width > length - CORNER + 3.0 {
                break;
            }
            let gap = if terrace && draw.chance(0.85) { 0.0 } else { f64::from(draw.range(1.6, 6.0)) };
            let back = FRONT + setback + if terrace { 0.0 } else { f64::from(draw.range(-1.0, 2.0)) };
            let at = self.place(left, s + 0.5 * width, back);
            let depth = draw.range(7.0, 10.5);
            let floors = (floors + usize::from(draw.chance(0.2))).min(4);
            let (walls, glass) = (self.next_id(false), self.next_id(false));
            if tile_of(at.x, at.y) == self.tile {
                let built = house(width as f32, depth, floors, at.inward, &mut house_key.with(1).draw());
                self.put(walls, Class::Building, at, || built.walls);
                self.put(glass, Class::Window, at, || built.glass);
            }
            self.garden(left, s, width, gap, back, boundary, house_key);
            s += width + gap;
        }
        self.kerb_side(left, key.with(2), length);
    }

    /// Between a house and the pavement: what bounds the garden, what grows in it, the gap beside the house.
    #[allow(clippy::too_many_arguments)] // One lot's measures.
    fn garden(&mut self, left: bool, s: f64, width: f64, gap: f64, back: f64, boundary: usize, key: Key) {
        let mut draw = key.with(2).draw();
        let visit = self.town.visit;
        let yard = back - FRONT;
        if yard > 1.5 && draw.chance(0.85) {
            let kind = if draw.chance(0.75) { boundary } else { draw.index(3) };
            let gate = f64::from(draw.range(1.0, 3.0)).min(0.5 * width);
            let at = self.place(left, s, FRONT + 0.2);
            let run = (width + gap - gate) as f32;
            let height = draw.range(0.7, 1.5);
            let growth = visit.growth(key);
            match kind {
                0 => self.lasting(key.with(3), Class::Wall, at, |d| wall(run, at.along, height, d)),
                1 => self.lasting(key.with(3), Class::Hedge, at, |d| {
                    hedge(run, at.along, height + 0.3, 0.8, growth, d)
                }),
                _ => self.lasting(key.with(3), Class::Fence, at, |d| fence(run, at.along, height, d)),
            }
        }
        for n in 0..draw.count(0, if yard > 3.0 { 3 } else { 1 }) as u64 {
            let at = self.place(
                left,
                s + f64::from(draw.unit()) * width,
                FRONT + 0.9 + f64::from(draw.unit()) * (yard - 1.6).max(0.1),
            );
            let (size, evergreen) = (draw.range(0.35, 1.0), draw.chance(0.5));
            let bush_key = key.with(10 + n);
            let size = size * visit.growth(bush_key);
            self.lasting(bush_key, Class::Bush, at, |d| bush(size, evergreen, visit.season, d));
        }
        if yard > 3.5 && draw.chance(0.35) {
            let at = self.place(left, s + f64::from(draw.unit()) * width, FRONT + 0.5 * yard);
            self.tree(key.with(20), at, &mut draw);
        }
        if gap > 2.0 {
            let at = self.place(left, s + width, back - 0.4);
            let run = gap as f32;
            self.lasting(key.with(30), Class::Fence, at, |d| fence(run, at.along, 1.7, d));
            if gap > 3.6 && yard > 4.0 {
                // A car in the drive, its nose to the house.
                let (key, off) = (key.with(31), back - 2.8);
                let inward = at.inward;
                self.loose(key, left, s + width + 0.5 * gap, off, Class::Car, |_, d| {
                    vehicle(false, inward, d)
                });
            }
        }
        // Behind the houses: trees over the roofs.
        if draw.chance(0.4) {
            let at = self.place(left, s + 0.5 * width, back + 13.0);
            self.tree(key.with(40), at, &mut draw);
        }
        if draw.chance(0.45) {
            let (key, class) = (key.with(50), Class::Bin);
            let s = s + f64::from(draw.range(0.5, 2.0));
            self.loose(key, left, s, FRONT + f64::from(draw.range(-0.7, 0.8)), class, bin);
        }
    }

    fn tree(&mut self, key: Key, at: Place, draw: &mut Draw) {
        let visit = self.town.visit;
        let species = [Species::Oak, Species::Beech, Species::Birch, Species::Pine][draw.index(4)];
        let dbh = draw.range(0.12, 0.4);
        let height = (species.height(dbh) * draw.range(0.65, 0.95)).min(16.0);
        self.lasting(key, Class::Tree, at, |d| {
            tree(species, dbh, height, visit.season, d, &mut visit.own(key).draw())
        });
    }

    /// Along the kerb: cars, lamps, signs, street trees, people.
    fn kerb_side(&mut self, left: bool, key: Key, length: f64) {
        let mut draw = key.draw();
        let parking = draw.chance(0.75).then(|| draw.range(0.35, 0.85));
        let mut s = CORNER - 4.0;
        let mut n = 0;
        while s < length - CORNER + 4.0 {
            n += 1;
            if parking.is_some_and(|share| draw.chance(share)) {
                let (car, van) = (key.with(100 + n), draw.chance(0.12));
                let turned = draw.chance(0.3);
                let class = if van { Class::Van } else { Class::Car };
                let off = HALF_ROAD + 1.05 + 0.15 * f64::from(draw.normal());
                self.loose(car, left, s + 2.6, off, class, |along, d| {
                    let nose = if turned { along } else { along + std::f32::consts::PI };
                    vehicle(van, nose + 0.03 * d.normal(), d)
                });
            }
            s += f64::from(draw.range(5.3, 7.2));
        }
        // Kerb stones: the pavement's edge, in straight pieces.
        let pieces = ((length - 2.0 * 8.0) / 4.0).max(0.0) as usize;
        for k in 0..pieces {
            let s = 8.0 + 4.0 * (k as f64 + 0.5);
            let (id, at) = (self.next_id(false), self.place(left, s, HALF_ROAD + 2.3 + 0.06));
            self.put(id, Class::Pavement, at, || {
                vec![Shape::cuboid(Vector3::new(0.0, 0.0, 0.0), Vector3::new(2.02, 0.075, 0.12), at.along)]
            });
        }
        let mut s = f64::from(draw.range(10.0, 25.0));
        let mut n = 0;
        let trees = draw.chance(0.4);
        while s < length - 8.0 {
            n += 1;
            let thing = key.with(300 + n);
            let at = self.place(left, s, FRONT - f64::from(draw.range(0.3, 1.0)));
            let inward = at.inward;
            match draw.unit() {
                u if u < 0.45 => self.lasting(thing, Class::Pole, at, |d| lamp(inward, d)),
                u if u < 0.65 => self.lasting(thing, Class::Sign, at, |d| sign(at.along, d)),
                _ if trees => self.tree(thing, at, &mut draw),
                _ => {}
            }
            if draw.chance(0.3) {
                // People of this visit only.
                let id = self.next_id(true);
                let own = self.town.visit.own(thing.with(9));
                let mut d = own.draw();
                let at = self.place(left, s + f64::from(d.range(-9.0, 9.0)), f64::from(d.range(6.5, 7.6)));
                let yaw = at.along + if d.chance(0.5) { 0.0 } else { std::f32::consts::PI };
                self.put(id, Class::Person, at, || person(yaw, d.range(0.85, 1.08), &mut d));
            }
            s += f64::from(draw.range(9.0, 24.0));
        }
    }
}

/// Crossings: a lattice that has been pulled about.
fn crossing(key: Key, i: i32, j: i32) -> [f64; 2] {
    let mut draw = key.with(2).cell(i.into(), j.into()).draw();
    let off = |d: &mut Draw| f64::from(d.range(-0.16, 0.16)) * BLOCK;
    [f64::from(i) * BLOCK + off(&mut draw), f64::from(j) * BLOCK + off(&mut draw)]
}

/// Streets run right (0) or up (1) from a crossing. Some are missing, at most two at any crossing, never opposite ones.
fn exists(key: Key, i: i32, j: i32, side: u32) -> bool {
    let place = (i + 2 * j).rem_euclid(5);
    let may_miss = if side == 0 { place == 0 } else { place == 2 };
    !(may_miss && key.with(3 + u64::from(side)).cell(i.into(), j.into()).unit() < 0.6)
}

/// A street's middle, bent.
fn street(key: Key, i: i32, j: i32, side: u32) -> Path {
    let (a, b) =
        (crossing(key, i, j), if side == 0 { crossing(key, i + 1, j) } else { crossing(key, i, j + 1) });
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let bend = 0.22 * f64::from(key.with(5 + u64::from(side)).cell(i.into(), j.into()).unit() - 0.5);
    let c = [0.5 * (a[0] + b[0]) - bend * dy, 0.5 * (a[1] + b[1]) + bend * dx];
    Path::new((0..=24).map(|k| {
        let t = f64::from(k) / 24.0;
        let (p, q, r) = ((1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t);
        [p * a[0] + q * c[0] + r * b[0], p * a[1] + q * c[1] + r * b[1]]
    }))
}

/// A drive over the streets that stays within `half` crossings of the start and keeps to the right. It prefers streets it has
/// not used and never turns back, up to a block before [`REVISIT_SHARE`] of its length; from there on it prefers those it
/// has used, in any direction, and turns back where there is no other way to one. Returns the crossings it passes and the way.
fn route(key: Key, length_m: f64, half: i32) -> (Vec<(i32, i32)>, Path) {
    let mut draw = key.with(7).draw();
    let (mut at, mut from) = ((0, 0), (0, 0));
    let mut crossings = vec![at];
    let mut used: FxHashMap<(i32, i32, u32), u32> = FxHashMap::default();
    let mut points: Vec<[f64; 2]> = Vec::new();
    let mut length = 0.0;
    // A margin: smoothing and the lane cut corners.
    while length < 1.08 * length_m + 60.0 {
        let revisit = length > REVISIT_SHARE * 1.03 * length_m - BLOCK;
        let best = [(1, 0), (0, 1), (-1, 0), (0, -1)]
            .into_iter()
            .filter_map(|(di, dj)| {
                let to = (at.0 + di, at.1 + dj);
                let (low, side) = (if di + dj > 0 { at } else { to }, u32::from(dj != 0));
                let turns_back = to == from && crossings.len() > 1;
                let fits = (!turns_back || revisit) && exists(key, low.0, low.1, side);
                fits.then(|| {
                    let again = used.get(&(low.0, low.1, side)).copied().unwrap_or(0) as f32;
                    let outside = (to.0.abs() - half).max(to.1.abs() - half).max(0) as f32;
                    let known = match (revisit, again) {
                        (false, _) => again,
                        (true, 0.0) => 3.0,
                        (true, _) => 0.3 * again + 1.5 * f32::from(u8::from(turns_back)),
                    };
                    (known + 5.0 * outside + 0.9 * draw.unit(), to, low, side)
                })
            })
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, to, low, side)) = best else { break };
        let path = street(key, low.0, low.1, side);
        length += path.length();
        let forward = low == at;
        let mut corners = path.points().to_vec();
        if !forward {
            corners.reverse();
        }
        points.extend(corners);
        *used.entry((low.0, low.1, side)).or_default() += 1;
        (from, at) = (at, to);
        crossings.push(at);
    }
    let middle = Path::new(points);
    let rough = middle.smoothed(0.0, middle.length(), 7.0);
    let lane = Path::new((0..=rough.length() as usize).map(|k| {
        let (p, h) = (rough.at(k as f64), rough.heading(k as f64, 2.0));
        [p[0] + LANE * h.sin(), p[1] - LANE * h.cos()]
    }));
    (crossings, lane.smoothed(0.0, lane.length(), 2.0))
}

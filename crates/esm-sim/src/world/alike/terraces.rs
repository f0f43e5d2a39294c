//! Parallel streets of terraced houses, all of them one house, with one wall, one porch, one bin and one lamp post.

use nalgebra::Vector3;

use super::site::{Frame, Ground, Put, Site, legs, serpentine};
use super::terrace::{HOUSE_M, Style, glass, walls};
use crate::cast::Shape;
use crate::hash::Key;
use crate::motion::Path;
use crate::world::building::{house, shed};
use crate::world::furniture::{bin, lamp, wall};
use crate::world::plants::{bush, hedge};
use crate::world::terrain::Terrain;
use crate::world::tree::street_tree;
use crate::world::vehicle::vehicle;
use crate::world::visit::Visit;
use crate::world::{Class, Moving};

/// From the middle of a street, metres: to the middle of a lane, to the cars' strip, to the kerb, to the garden walls, to the
/// fronts, to the walls of the yards; and to the next street.
const LANE_M: f64 = 1.6;
const STRIP_M: f64 = 3.2;
const KERB_M: f64 = 5.2;
const WALL_M: f64 = 6.9;
const FRONT_M: f64 = 8.9;
const YARD_M: f64 = 25.0;
const STREET_M: f64 = 52.0;
/// From the first and last house to the middle of the street across, metres.
const ACROSS_M: f64 = 12.0;
/// Houses between two lamp posts of a street, sides taking turns.
const HOUSES_A_LAMP: usize = 3;
/// Share of the houses with a car before them, and the models there are.
const TAKEN: f32 = 0.4;
const MODELS: usize = 6;
/// One house in so many is not like the others, or its garden is not.
const ONE_ODD_OF: f32 = 45.0;
/// Streets beside those that are driven.
const BESIDE: usize = 1;

/// How the streets lie.
#[derive(Clone, Copy)]
struct Plan {
    key: Key,
    frame: Frame,
    style: Style,
    houses: usize,
}

/// A side of a street: where its middle lies, and 1 or -1, the side of it.
#[derive(Clone, Copy)]
struct Side {
    v: f64,
    out: f64,
    /// Out of the houses, into the street.
    inward: f32,
}

impl Plan {
    fn length(&self) -> f64 {
        f64::from(HOUSE_M) * self.houses as f64
    }

    fn side(&self, street: usize, left: bool) -> Side {
        let out = if left { 1.0 } else { -1.0 };
        let inward = self.frame.yaw(-out * std::f64::consts::FRAC_PI_2);
        Side { v: STREET_M * street as f64, out, inward }
    }
}

impl Side {
    /// So far out from the street's middle.
    fn off(&self, metres: f64) -> f64 {
        self.v + self.out * metres
    }
}

pub(in crate::world) fn terraces(key: Key, length_m: f64, visit: Visit) -> Site {
    let houses = (0.17 * length_m / f64::from(HOUSE_M)).round().clamp(16.0, 34.0) as usize;
    let length = f64::from(HOUSE_M) * houses as f64;
    let legs = legs(length_m, length + 2.0 * ACROSS_M + STREET_M);
    let streets = legs + 2 * BESIDE;
    let frame = Frame::new(key, [0.5 * length, 0.5 * STREET_M * (streets - 1) as f64]);
    let plan = Plan { key, frame, style: Style::new(&mut key.with(3).draw()), houses };
    let across: Vec<f64> = (0..legs).map(|n| STREET_M * (n + BESIDE) as f64).collect();
    let ends = [-ACROSS_M, length + ACROSS_M];
    let rough = frame.path(&serpentine(ends, &across));
    let middle = rough.smoothed(0.0, rough.length(), 6.0);
    let lane = middle.offset(-LANE_M);
    let route = lane.smoothed(0.0, lane.length(), 2.0);
    let walks: Vec<Path> = (0..streets)
        .flat_map(|n| {
            [1.0, -1.0].map(|side| STREET_M * n as f64 + side * 0.45 * (KERB_M + WALL_M) + side * 0.3)
        })
        .map(|v| frame.path(&[[-2.0, v], [length + 2.0, v]]))
        .collect();
    let last = STREET_M * (streets - 1) as f64;
    let ground = Ground {
        terrain: Terrain { key: key.with(1), layers: &[(420.0, 1.8), (5.0, 0.012)] },
        route,
        walks,
        drives: Vec::new(),
        moving: Moving::Roads { oncoming_m: 2.0 * LANE_M },
        of: Box::new(move |x, y| {
            let [u, v] = frame.of(x, y);
            let along = (v - STREET_M * (v / STREET_M).round().clamp(0.0, (streets - 1) as f64)).abs();
            let cross = (u - ends[0]).abs().min((u - ends[1]).abs());
            let inside = (ends[0]..ends[1]).contains(&u);
            let between = (-WALL_M..last + WALL_M).contains(&v);
            match (if inside { along } else { f64::INFINITY }).min(if between {
                cross
            } else {
                f64::INFINITY
            }) {
                d if d < KERB_M => Class::Road,
                d if d < WALL_M => Class::Pavement,
                _ => Class::Grass,
            }
        }),
    };
    let mut site = Site::new(ground, visit);
    for street in 0..streets {
        for left in [true, false] {
            let side = plan.side(street, left);
            for n in 0..houses {
                let own = key.with(10 + u64::from(left)).cell(street as i64, n as i64);
                lot(&mut site, &plan, side, n, own);
                if (n + if left { 0 } else { HOUSES_A_LAMP }) % (2 * HOUSES_A_LAMP) == HOUSES_A_LAMP / 2 {
                    let at = frame.at(f64::from(HOUSE_M) * n as f64, side.off(WALL_M - 0.25));
                    site.lasting(own.with(20), Class::Pole, at, move || {
                        lamp(side.inward, &mut key.with(21).draw())
                    });
                }
            }
            kerb(&mut site, &plan, side);
        }
    }
    ends_of(&mut site, &plan, ends, last);
    site.done()
}

/// One house with all that belongs to it.
fn lot(site: &mut Site, plan: &Plan, side: Side, n: usize, own: Key) {
    let Plan { key, frame, style, .. } = *plan;
    let visit = site.visit();
    let width = f64::from(HOUSE_M);
    let (from, middle) = (width * n as f64, width * (n as f64 + 0.5));
    let (inward, along) = (side.inward, frame.yaw(0.0));
    // Seen from the house left is against the rows' direction on their left side.
    let door = middle + side.out * style.door_m();
    let odd = (own.with(1).unit() < 1.0 / ONE_ODD_OF).then(|| own.with(2).draw().index(5));
    let at = frame.at(middle, side.off(FRONT_M));
    if odd == Some(0) {
        // Pulled down: a garage at the back of an empty lot.
        let at = frame.at(middle, side.off(FRONT_M + 6.0));
        site.fixed(Class::Building, at, move || shed(3.2, inward, &mut own.with(3).draw()));
        let at = frame.at(middle, side.off(FRONT_M + 3.0));
        site.lasting(own.with(4), Class::Bush, at, move || {
            bush(1.2 * visit.growth(own), true, visit.season, &mut own.with(5).draw())
        });
    } else {
        site.fixed(Class::Building, at, move || walls(&style, inward, odd == Some(1)));
        site.fixed(Class::Window, at, move || glass(&style, inward));
    }
    // The garden wall up to the door's path, and that to the neighbour.
    let before = if door > middle { [from, door - 0.6] } else { [door + 0.6, from + width] };
    let (run, at) = ((before[1] - before[0]) as f32, frame.at(before[0], side.off(WALL_M + 0.2)));
    if odd == Some(2) {
        site.lasting(own.with(6), Class::Hedge, at, move || {
            hedge(run, along, 1.7, 0.8, visit.growth(own), &mut own.with(7).draw())
        });
    } else {
        site.lasting(own.with(6), Class::Wall, at, move || wall(run, along, 0.85, &mut key.with(22).draw()));
    }
    let at = frame.at(from, side.off(WALL_M + 0.4));
    let outward = inward + std::f32::consts::PI;
    site.fixed(Class::Wall, at, move || wall(1.5, outward, 0.75, &mut key.with(23).draw()));
    let at = frame.at(from, side.off(YARD_M));
    site.fixed(Class::Wall, at, move || wall(HOUSE_M, along, 1.9, &mut key.with(24).draw()));
    if odd == Some(3) {
        let at = frame.at(from + 0.4, side.off(KERB_M + 0.4));
        site.lasting(own.with(8), Class::Tree, at, move || {
            street_tree(visit.season, &mut own.with(9).draw(), &mut visit.own(own).draw())
        });
    }
    // The bin beside the door; on other days it stands on the pavement, or nowhere.
    site.loose(own.with(11), |now| {
        let mut draw = now.draw();
        let moved = now != own.with(11);
        let (u, off) = if moved {
            (middle + f64::from(draw.range(-2.4, 2.4)), WALL_M - 0.5)
        } else {
            (door - (door - middle).signum() * 1.2, FRONT_M - 0.5)
        };
        let at = frame.at(u + 0.04 * f64::from(draw.normal().clamp(-2.0, 2.0)), side.off(off));
        let turned = if moved { 0.2 * draw.normal() } else { 0.02 * draw.normal() };
        let shapes = Box::new(move || bin(inward + turned, &mut key.with(25).draw()));
        (!moved || draw.chance(0.7)).then_some(Put { class: Class::Bin, at, shapes })
    });
    // A car before it.
    site.loose(own.with(12), |now| {
        let mut draw = now.draw();
        let taken = draw.chance(if odd == Some(4) { 0.0 } else { TAKEN });
        let model = key.with(26).with(draw.index(MODELS) as u64);
        let yaw = along + if (side.out > 0.0) == draw.chance(0.8) { std::f32::consts::PI } else { 0.0 };
        let yaw = yaw + 0.015 * draw.normal();
        let u = middle + 0.2 * f64::from(draw.normal().clamp(-2.0, 2.0));
        let off = STRIP_M + 1.1 + 0.06 * f64::from(draw.normal().clamp(-2.0, 2.0));
        let shapes = Box::new(move || vehicle(false, yaw, &mut model.draw()));
        taken.then_some(Put { class: Class::Car, at: frame.at(u, side.off(off)), shapes })
    });
    if odd == Some(4) {
        // Building material under a sheet, where a car would stand.
        let at = frame.at(middle, side.off(STRIP_M + 1.0));
        site.lasting(own.with(13), Class::Bin, at, move || {
            let mut draw = own.with(14).draw();
            let half = Vector3::new(draw.range(1.2, 1.9), draw.range(0.6, 0.8), draw.range(0.4, 0.8));
            let pile = Vector3::new(0.6 * half.x, 0.7 * half.y, draw.range(0.2, 0.5));
            vec![
                Shape::cuboid(Vector3::z() * half.z, half, along),
                Shape::cuboid(Vector3::z() * (2.0 * half.z), pile, along + draw.range(-0.3, 0.3)),
            ]
        });
    }
}

/// The pavement's edge.
fn kerb(site: &mut Site, plan: &Plan, side: Side) {
    let pieces = ((plan.length() + 8.0) / 4.0) as usize;
    let along = plan.frame.yaw(0.0);
    for k in 0..pieces {
        let at = plan.frame.at(4.0 * k as f64 - 2.0, side.off(KERB_M + 0.06));
        site.fixed(Class::Pavement, at, move || {
            vec![Shape::cuboid(Vector3::zeros(), Vector3::new(2.02, 0.075, 0.12), along)]
        });
    }
}

/// Beyond the streets across: houses that are all different, with bushes before them.
fn ends_of(site: &mut Site, plan: &Plan, ends: [f64; 2], last: f64) {
    let Plan { key, frame, .. } = *plan;
    let visit = site.visit();
    for (end, (u, out)) in [(ends[0], -1.0), (ends[1], 1.0)].into_iter().enumerate() {
        let inward = frame.yaw(if out < 0.0 { 0.0 } else { std::f64::consts::PI });
        let mut v = -20.0;
        let mut n = 0;
        while v < last + 20.0 {
            let own = key.with(40 + end as u64).with(n);
            let mut draw = own.draw();
            n += 1;
            let width = draw.range(6.0, 13.0);
            let setback = f64::from(draw.range(0.5, 4.0));
            let at = frame.at(u + out * (WALL_M + setback), v + 0.5 * f64::from(width));
            let floors = draw.count(1, 3);
            let built = move || house(width, 9.0, floors, inward, &mut own.with(1).draw());
            site.fixed(Class::Building, at, move || built().walls);
            site.fixed(Class::Window, at, move || built().glass);
            for k in 0..draw.count(0, 3) as u64 {
                let bed = own.with(10 + k);
                let at = frame.at(
                    u + out * (WALL_M + 0.5 + 0.5 * f64::from(draw.unit())),
                    v + f64::from(width * draw.unit()),
                );
                site.lasting(bed, Class::Bush, at, move || {
                    let mut draw = bed.with(1).draw();
                    bush(draw.range(0.5, 1.2) * visit.growth(bed), draw.chance(0.5), visit.season, &mut draw)
                });
            }
            v += f64::from(width) + f64::from(draw.range(0.0, 5.0));
        }
    }
}

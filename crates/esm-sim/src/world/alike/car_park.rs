//! A car park: rows of bays, cars of few models, lamp posts at one spacing.

use nalgebra::Vector3;

use super::site::{Frame, Ground, Put, Site, legs, serpentine};
use crate::cast::Shape;
use crate::hash::{Draw, Key};
use crate::world::furniture::{cabinet, fence, lamp};
use crate::world::terrain::Terrain;
use crate::world::tree::{Room, Species, street_tree, tree};
use crate::world::vehicle::vehicle;
use crate::world::visit::Visit;
use crate::world::{Class, Moving};

type V = Vector3<f32>;

/// A bay's width and depth, metres.
const BAY_M: [f64; 2] = [2.5, 5.0];
/// From the middle of an aisle to the bays at its sides, metres.
const HALF_AISLE_M: f64 = 3.2;
/// Between the middles of two aisles, metres: an aisle and two bays nose to nose.
const AISLE_M: f64 = 2.0 * (HALF_AISLE_M + BAY_M[1]);
/// From the middle of an aisle to that of a lane, metres.
const LANE_M: f64 = 1.6;
/// Bays between two lamp posts, and between two shelters of trolleys.
const BAYS_A_LAMP: usize = 8;
const BAYS_A_SHELTER: usize = 24;
/// Share of the bays that are taken.
const TAKEN: f32 = 0.72;
/// Models of cars, and the share of the last one, a van.
const MODELS: usize = 5;
const VANS: f32 = 0.06;
/// How far off a bay's middle a car stands, one deviation, metres; how far it is turned, radians.
const PARKED_M: f32 = 0.08;
const TURNED: f32 = 0.012;
/// Something odd takes one bay in so many.
const ONE_ODD_OF: f32 = 280.0;
/// Aisles beyond the last that is driven.
const AISLES_BEYOND: usize = 3;
/// Middles of the roads along the ends of the rows, metres from them.
const END_ROAD_M: f64 = 5.8;
/// How far the asphalt reaches beyond the bays, and where across the shop's front is, metres.
const EDGE_M: f64 = 9.4;
const SHOP_M: f64 = -14.0;

/// How the rows lie.
#[derive(Clone, Copy)]
struct Plan {
    key: Key,
    frame: Frame,
    bays: usize,
    aisles: usize,
}

impl Plan {
    /// Metres of a row.
    fn length(&self) -> f64 {
        BAY_M[0] * self.bays as f64
    }

    /// Metres across, from the first bays' backs to the last ones'.
    fn width(&self) -> f64 {
        AISLE_M * self.aisles as f64
    }

    /// The middle of an aisle.
    fn aisle(&self, n: usize) -> f64 {
        AISLE_M * (n as f64 + 0.5)
    }
}

pub(in crate::world) fn car_park(key: Key, length_m: f64, visit: Visit) -> Site {
    let bays =
        BAYS_A_LAMP * (0.28 * length_m / (BAY_M[0] * BAYS_A_LAMP as f64)).round().clamp(5.0, 10.0) as usize;
    let row = BAY_M[0] * bays as f64;
    let legs = legs(length_m, row + 2.0 * (END_ROAD_M + AISLE_M));
    // The first aisle lies at the edge, the others in the middle of the rest.
    let driven: Vec<usize> = (0..legs).map(|n| if n == 0 { 0 } else { 2 * n + 1 }).collect();
    let aisles = 2 * legs + AISLES_BEYOND;
    let mut plan = Plan { key, frame: Frame::new(key, [0.0, 0.0]), bays, aisles };
    plan.frame = Frame::new(key, [0.5 * plan.length(), 0.5 * plan.width()]);
    let across: Vec<f64> = driven.iter().map(|n| plan.aisle(*n)).collect();
    let [from, to] = [-END_ROAD_M, row + END_ROAD_M];
    let rough = plan.frame.path(&serpentine([from, to], &across));
    let middle = rough.smoothed(0.0, rough.length(), 6.0);
    let lane = middle.offset(-LANE_M);
    let route = lane.smoothed(0.0, lane.length(), 2.0);
    let walks = (0..aisles).filter(|n| !driven.contains(n)).map(|n| {
        let v = plan.aisle(n) + 1.0;
        plan.frame.path(&[[2.0, v], [row - 2.0, v]])
    });
    let ring = plan.frame.path(
        &[[from, -4.0], [to, -4.0], [to, plan.width() + 4.0], [from, plan.width() + 4.0]]
            .repeat(2)
            .into_iter()
            .chain([[from, -4.0]])
            .collect::<Vec<_>>(),
    );
    // Closed where it is straight.
    let once = 0.5 * ring.length();
    let lap = ring.smoothed(0.5 * row, 0.5 * row + once, 5.0);
    let frame = plan.frame;
    let [length, width] = [plan.length(), plan.width()];
    let ground = Ground {
        terrain: Terrain { key: key.with(1), layers: &[(420.0, 1.4), (5.0, 0.012)] },
        route,
        walks: walks.collect(),
        drives: vec![lap],
        moving: Moving::Aisles { oncoming_m: 2.0 * LANE_M },
        of: Box::new(move |x, y| {
            let [u, v] = frame.of(x, y);
            let (out_u, out_v) = ((-u).max(u - length), (-v).max(v - width));
            match (out_u.max(out_v) < EDGE_M, v < 0.0 && v > SHOP_M && out_u < EDGE_M) {
                (true, _) => Class::Road,
                (false, true) => Class::Pavement,
                (false, false) => Class::Grass,
            }
        }),
    };
    let mut site = Site::new(ground, visit);
    bays_of(&mut site, &plan);
    between(&mut site, &plan);
    around(&mut site, &plan);
    site.done()
}

/// Whether a shelter takes a bay: every so many, in every other pair of rows.
fn is_shelter(pair: usize, bay: usize) -> bool {
    pair % 2 == 1 && bay % BAYS_A_SHELTER == BAYS_A_SHELTER / 2
}

/// The cars, and the odd things.
fn bays_of(site: &mut Site, plan: &Plan) {
    let (key, frame) = (plan.key, plan.frame);
    for aisle in 0..plan.aisles {
        for (side, out) in [(0, -1.0), (1, 1.0)] {
            for bay in 0..plan.bays {
                let own = key.with(10).cell((2 * aisle + side) as i64, bay as i64);
                let place = [
                    BAY_M[0] * (bay as f64 + 0.5),
                    plan.aisle(aisle) + out * (HALF_AISLE_M + 0.5 * BAY_M[1]),
                ];
                if is_shelter(aisle + side, bay) {
                    continue;
                }
                if own.with(9).unit() < 1.0 / ONE_ODD_OF {
                    odd(site, own.with(8), frame, place);
                    continue;
                }
                let nose_in = frame.yaw(out * std::f64::consts::FRAC_PI_2);
                site.loose(own, |own| {
                    let mut draw = own.draw();
                    let taken = draw.chance(TAKEN);
                    let van = draw.chance(VANS);
                    let model = if van { MODELS - 1 } else { draw.index(MODELS - 1) };
                    let model = key.with(11).with(model as u64);
                    let yaw = nose_in + if draw.chance(0.25) { std::f32::consts::PI } else { 0.0 };
                    let yaw = yaw + TURNED * draw.normal();
                    let off = [draw.normal(), 1.5 * draw.normal()]
                        .map(|n| f64::from(PARKED_M * n.clamp(-2.5, 2.5)));
                    let at = frame.at(place[0] + off[0], place[1] + off[1]);
                    let shapes = Box::new(move || vehicle(van, yaw, &mut model.draw()));
                    taken.then_some(Put { class: if van { Class::Van } else { Class::Car }, at, shapes })
                });
            }
        }
    }
}

/// A skip, a big tree in a bed, cabinets that charge cars, a heap of pallets.
fn odd(site: &mut Site, key: Key, frame: Frame, [u, v]: [f64; 2]) {
    let (visit, at) = (site.visit(), frame.at(u, v));
    let mut draw = key.draw();
    let yaw = frame.yaw(f64::from(draw.range(-0.15, 0.15)));
    match draw.unit() {
        u if u < 0.3 => {
            site.lasting(key, Class::Bin, at, move || skip(yaw, &mut key.with(1).draw()));
        }
        u if u < 0.6 => {
            site.lasting(key, Class::Tree, at, move || {
                street_tree(visit.season, &mut key.with(1).draw(), &mut visit.own(key).draw())
            });
        }
        _ => {
            site.lasting(key, Class::Bin, at, move || {
                let mut draw = key.with(1).draw();
                let along = V::new(yaw.cos(), yaw.sin(), 0.0);
                (-1..=1)
                    .flat_map(|n| {
                        cabinet(yaw, &mut draw).into_iter().map(move |s| s.moved(along * (0.8 * n as f32)))
                    })
                    .collect()
            });
        }
    }
}

fn skip(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let half = V::new(draw.range(0.8, 1.1), draw.range(1.6, 2.2), draw.range(0.5, 0.8));
    let rubble = V::new(0.8 * half.x, 0.6 * half.y, draw.range(0.15, 0.4));
    vec![
        Shape::cuboid(V::z() * half.z, half, yaw),
        Shape::cuboid(V::z() * (2.0 * half.z), rubble, yaw + draw.range(-0.5, 0.5)),
    ]
}

/// Between two rows nose to nose: lamp posts and shelters; at their ends: islands with a tree. All alike.
fn between(site: &mut Site, plan: &Plan) {
    let (visit, key, frame) = (site.visit(), plan.key, plan.frame);
    for pair in 1..plan.aisles {
        let v = AISLE_M * pair as f64;
        let yaw = frame.yaw(0.0);
        for bay in (BAYS_A_LAMP / 2..plan.bays).step_by(BAYS_A_LAMP) {
            let (own, at) = (key.with(20).cell(pair as i64, bay as i64), frame.at(BAY_M[0] * bay as f64, v));
            site.lasting(own, Class::Pole, at, move || {
                let mut post = lamp(yaw + std::f32::consts::FRAC_PI_2, &mut key.with(21).draw());
                post.push(Shape::cuboid(V::z() * 0.3, V::new(0.22, 0.22, 0.4), yaw));
                post
            });
        }
        for bay in (0..plan.bays).filter(|bay| is_shelter(pair, *bay)) {
            let at = frame.at(BAY_M[0] * (bay as f64 + 0.5), v);
            site.fixed(Class::Fence, at, move || shelter(yaw));
        }
        for (n, u) in [(0, -1.4), (1, plan.length() + 1.4)] {
            let (own, at) = (key.with(22).cell(pair as i64, n), frame.at(u, v));
            site.fixed(Class::Pavement, at, move || {
                vec![Shape::cuboid(V::zeros(), V::new(0.9, 4.4, 0.12), yaw)]
            });
            site.lasting(own, Class::Tree, at, move || {
                let mut now = visit.own(own).draw();
                tree(Species::Birch, 0.12, 6.0, Room::Open, visit.season, &mut key.with(23).draw(), &mut now)
            });
        }
    }
}

/// Where trolleys are kept, over two bays nose to nose.
fn shelter(yaw: f32) -> Vec<Shape> {
    let (along, across) = (V::new(yaw.cos(), yaw.sin(), 0.0), V::new(-yaw.sin(), yaw.cos(), 0.0));
    let (w, d) = (0.5 * BAY_M[0] as f32 - 0.1, BAY_M[1] as f32 - 0.6);
    let mut shapes = vec![Shape::cuboid(V::z() * 2.35, V::new(w + 0.1, d, 0.05), yaw)];
    for side in [-1.0, 1.0] {
        for n in -1..=1 {
            let foot = along * (side * w) + across * (0.95 * d * n as f32);
            shapes.push(Shape::frustum(foot, foot + V::z() * 2.3, 0.04, 0.04));
        }
        for z in [0.45, 0.95] {
            let rail = along * (side * w) + V::z() * z;
            shapes.push(Shape::frustum(rail - across * (0.95 * d), rail + across * (0.95 * d), 0.03, 0.03));
        }
    }
    // A row of trolleys.
    shapes.push(Shape::cuboid(along * (0.4 * w) + V::z() * 0.55, V::new(0.28, 0.7 * d, 0.45), yaw));
    shapes
}

/// The shop along the first row, fences and shrubs elsewhere.
fn around(site: &mut Site, plan: &Plan) {
    let (visit, key, frame) = (site.visit(), plan.key, plan.frame);
    let [length, width] = [plan.length(), plan.width()];
    let out = frame.yaw(std::f64::consts::FRAC_PI_2);
    // Its front, bay of a pillar after bay of a pillar, with an entrance somewhere.
    let pillars = (length / 6.0) as usize;
    let entrance = key.with(30).draw().count(1, pillars.saturating_sub(2).max(1));
    for n in 0..pillars {
        let at = frame.at(6.0 * (n as f64 + 0.5), SHOP_M);
        site.fixed(Class::Building, at, move || shop(out, n == entrance));
    }
    let along = frame.yaw(0.0);
    for (n, [from, to], yaw) in [
        (0, [[-10.0, width + 10.0], [length + 10.0, width + 10.0]], along),
        (1, [[-10.0, -8.0], [-10.0, width + 10.0]], out),
        (2, [[length + 10.0, -8.0], [length + 10.0, width + 10.0]], out),
    ] {
        let run = (to[0] - from[0]).hypot(to[1] - from[1]);
        let pieces = (run / 8.0) as u64;
        for k in 0..pieces {
            let own = key.with(31 + n).with(k);
            let t = k as f64 / pieces as f64;
            let (u, v) = (from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]));
            let piece = (run / pieces as f64) as f32;
            let at = frame.at(u, v);
            site.lasting(own, Class::Fence, at, move || fence(piece, yaw, 1.6, &mut key.with(35).draw()));
            let mut draw = own.with(1).draw();
            // Behind it, as it comes.
            let beyond = [(0.0, 3.0), (-3.0, 0.0), (3.0, 0.0)][n as usize];
            let further = f64::from(draw.range(1.0, 3.0));
            let at = frame.at(u + further * beyond.0, v + further * beyond.1);
            if draw.chance(0.3) {
                site.lasting(own.with(2), Class::Tree, at, move || {
                    street_tree(visit.season, &mut own.with(3).draw(), &mut visit.own(own).draw())
                });
            }
        }
    }
}

/// Six metres of a shop's front: the anchor is its middle on the ground, `out` points to the cars.
fn shop(out: f32, entrance: bool) -> Vec<Shape> {
    let (x, y) = (V::new(out.cos(), out.sin(), 0.0), V::new(-out.sin(), out.cos(), 0.0));
    let cuboid = |at: [f32; 3], half: [f32; 3]| {
        Shape::cuboid(x * at[0] + y * at[1] + V::z() * at[2], half.into(), out)
    };
    let mut shapes = vec![
        cuboid([-6.0, 0.0, 2.5], [6.0, 3.0, 4.0]),
        cuboid([0.15, -3.0, 3.0], [0.25, 0.25, 3.5]),
        cuboid([0.1, 0.0, 5.4], [0.3, 3.0, 0.5]),
    ];
    if entrance {
        shapes.push(cuboid([1.8, 0.0, 3.6], [1.8, 2.6, 0.15]));
        for side in [-2.3, 2.3] {
            let foot = x * 3.3 + y * side;
            shapes.push(Shape::frustum(foot, foot + V::z() * 3.5, 0.12, 0.12));
        }
    }
    shapes
}

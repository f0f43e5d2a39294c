//! A plantation of poplars: one clone, planted in one week, pruned alike.

use super::site::{Frame, Ground, Site, legs, serpentine};
use crate::hash::Key;
use crate::motion::Path;
use crate::world::building::shed;
use crate::world::furniture::fence;
use crate::world::plants::{bush, hedge, log, rock, stump, undergrowth};
use crate::world::terrain::Terrain;
use crate::world::tree::{Room, Species, street_tree, tree};
use crate::world::visit::Visit;
use crate::world::{Class, Moving};

/// Between two rows, and between two trees of a row, metres.
const ROW_M: f64 = 5.0;
const STEP_M: f64 = 4.0;
/// How far off its place a tree stands, one deviation, metres.
const PLANTED_M: f32 = 0.03;
/// How unlike each other the trees are in diameter and height, one deviation, share.
const UNLIKE: f32 = 0.025;
/// How many ways the clone has branched.
const FORMS: usize = 3;
/// Rows between two tracks.
const ROWS_A_TRACK: usize = 4;
/// Trees that died young, one in so many; in place of how many something odd stands.
const ONE_DEAD_OF: f32 = 600.0;
const ONE_ODD_OF: f32 = 450.0;
/// Rows beyond the last track: more than is seen through.
const ROWS_BEYOND: usize = 12;

/// Metres of the plantation along its rows.
fn row_length(length_m: f64) -> f64 {
    STEP_M * (0.25 * length_m / STEP_M).round().clamp(25.0, 55.0)
}

pub(in crate::world) fn plantation(key: Key, length_m: f64, visit: Visit) -> Site {
    let length = row_length(length_m);
    let track_m = ROW_M * ROWS_A_TRACK as f64;
    let legs = legs(length_m, length + 16.0 + track_m);
    let rows = ROWS_A_TRACK * (legs - 1) + ROWS_BEYOND;
    let width = ROW_M * (rows - 1) as f64;
    let frame = Frame::new(key, [0.5 * length, 0.5 * width]);
    // First beside the first row, then between rows.
    let across: Vec<f64> =
        (0..legs).map(|n| if n == 0 { -4.0 } else { 0.5 * ROW_M + track_m * (n - 1) as f64 }).collect();
    let ends = [-8.0, length + 8.0];
    let rough = frame.path(&serpentine(ends, &across));
    let route = rough.smoothed(0.0, rough.length(), 4.0);
    let headlands: Vec<Path> =
        [-11.0, length + 11.0].map(|u| frame.path(&[[u, -6.0], [u, width + 6.0]])).into();
    let worn = route.clone();
    let ground = Ground {
        terrain: Terrain { key: key.with(1), layers: &[(380.0, 1.6), (41.0, 0.06), (3.7, 0.03)] },
        route,
        walks: headlands,
        drives: Vec::new(),
        moving: Moving::Trails,
        of: Box::new(move |x, y| if worn.distance(x, y) < 1.2 { Class::Track } else { Class::Grass }),
    };
    let mut site = Site::new(ground, visit);
    planted(&mut site, key, frame, rows, length);
    weeds(&mut site, key, frame, length, width);
    edges(&mut site, key, frame, length, width);
    site.done()
}

/// The trees, and what stands where one is missing.
fn planted(site: &mut Site, key: Key, frame: Frame, rows: usize, length: f64) {
    let visit = site.visit();
    for row in 0..rows {
        for n in 0..=(length / STEP_M).round() as usize {
            let own = key.with(10).cell(row as i64, n as i64);
            let mut draw = own.draw();
            let off = [draw.normal(), draw.normal()].map(|o| f64::from(PLANTED_M * o.clamp(-2.5, 2.5)));
            let at = frame.at(STEP_M * n as f64 + off[0], ROW_M * row as f64 + off[1]);
            let alike = |unlike: f32| 1.0 + UNLIKE * unlike.clamp(-2.5, 2.5);
            let (dbh, height) = (0.2 * alike(draw.normal()), 14.0 * alike(draw.normal()));
            let form = key.with(11).with(draw.index(FORMS) as u64);
            if draw.chance(1.0 / ONE_DEAD_OF) {
                continue;
            }
            if draw.chance(1.0 / ONE_ODD_OF) {
                odd(site, own.with(2), at);
                continue;
            }
            let stands = site.lasting(own, Class::Tree, at, move || {
                let mut now = visit.own(own).draw();
                tree(Species::Poplar, dbh, height, Room::Open, visit.season, &mut form.draw(), &mut now)
            });
            if !stands && own.with(3).unit() < 0.5 {
                site.fresh(Class::Stump, at, move || stump(&mut own.with(4).draw()));
            }
        }
    }
}

/// What breaks the pattern: an old tree that was left, a boulder, bushes that nobody cut, a stack of stems.
fn odd(site: &mut Site, key: Key, at: [f64; 2]) {
    let visit = site.visit();
    match key.unit() {
        u if u < 0.3 => {
            let species = if u < 0.15 { Species::Oak } else { Species::Pine };
            site.lasting(key, Class::Tree, at, move || {
                let (mut own, mut now) = (key.with(1).draw(), visit.own(key).draw());
                let dbh = own.range(0.3, 0.6);
                tree(species, dbh, 0.8 * species.height(dbh), Room::Open, visit.season, &mut own, &mut now)
            });
        }
        u if u < 0.5 => site.fixed(Class::Rock, at, move || rock(&mut key.with(1).draw())),
        u if u < 0.75 => {
            site.lasting(key, Class::Bush, at, move || {
                let mut draw = key.with(1).draw();
                bush(draw.range(0.8, 1.5) * visit.growth(key), draw.chance(0.4), visit.season, &mut draw)
            });
        }
        _ => {
            site.lasting(key, Class::Log, at, move || {
                let mut draw = key.with(1).draw();
                (0..4).flat_map(|_| log(&mut draw)).collect()
            });
        }
    }
}

/// Grass is mown: what grows is of the year.
fn weeds(site: &mut Site, key: Key, frame: Frame, length: f64, width: f64) {
    let (visit, count) = (site.visit(), (length * width / 160.0) as u64);
    for n in 0..count {
        let own = visit.own(key.with(20).with(n));
        let mut draw = own.draw();
        let at = frame.at(length * f64::from(draw.unit()), width * f64::from(draw.unit()));
        if site.route().distance(at[0], at[1]) > 1.0 {
            site.fresh(Class::Undergrowth, at, move || {
                let mut draw = own.with(1).draw();
                undergrowth(draw.range(0.4, 1.0), visit.season, &mut draw)
            });
        }
    }
}

/// What lies around: a fence and a wood along the first row, the yard before the rows, meadows behind them.
fn edges(site: &mut Site, key: Key, frame: Frame, length: f64, width: f64) {
    let visit = site.visit();
    let along = frame.yaw(0.0);
    for n in 0..((length + 24.0) / 8.0) as u64 {
        let (own, at) = (key.with(30).with(n), frame.at(-12.0 + 8.0 * n as f64, -9.0));
        site.lasting(own, Class::Fence, at, move || fence(8.0, along, 1.2, &mut own.with(1).draw()));
    }
    for n in 0..((length + 50.0) * 14.0 / 22.0) as u64 {
        let own = key.with(31).with(n);
        let mut draw = own.draw();
        let at =
            frame.at(f64::from(draw.unit()) * (length + 50.0) - 25.0, -11.5 - 14.0 * f64::from(draw.unit()));
        if draw.chance(0.6) {
            site.lasting(own, Class::Tree, at, move || {
                street_tree(visit.season, &mut own.with(1).draw(), &mut visit.own(own).draw())
            });
        } else {
            site.lasting(own, Class::Bush, at, move || {
                let mut draw = own.with(1).draw();
                bush(draw.range(0.7, 1.8) * visit.growth(own), draw.chance(0.4), visit.season, &mut draw)
            });
        }
    }
    // Both ends: bushes and trees as they come, sheds and stacks on the yard's side, hedges on the other.
    for (end, [from, to]) in [[-30.0, -15.0], [length + 15.0, length + 34.0]].into_iter().enumerate() {
        for n in 0..(width / 7.0) as u64 {
            let own = key.with(40 + end as u64).with(n);
            let mut draw = own.draw();
            let at = frame.at(
                from + (to - from) * f64::from(draw.unit()),
                f64::from(draw.range(-10.0, 10.0)) + width * f64::from(draw.unit()),
            );
            let yaw = frame.yaw(f64::from(draw.range(-0.2, 0.2)));
            let of = move || own.with(1).draw();
            match draw.unit() {
                u if u < 0.35 => {
                    site.lasting(own, Class::Bush, at, move || {
                        let (mut draw, grown) = (of(), visit.growth(own));
                        bush(draw.range(0.7, 1.7) * grown, draw.chance(0.4), visit.season, &mut draw)
                    });
                }
                u if u < 0.65 => {
                    site.lasting(own, Class::Tree, at, move || {
                        street_tree(visit.season, &mut of(), &mut visit.own(own).draw())
                    });
                }
                u if u < 0.8 && end == 0 => {
                    site.fixed(Class::Building, at, move || shed(4.5, yaw, &mut of()));
                }
                u if u < 0.8 => {
                    let across = yaw + std::f32::consts::FRAC_PI_2;
                    site.lasting(own, Class::Hedge, at, move || {
                        hedge(9.0, across, 1.8, 1.0, visit.growth(own), &mut of())
                    });
                }
                _ => {
                    site.lasting(own, Class::Log, at, move || {
                        let mut draw = of();
                        (0..3).flat_map(|_| log(&mut draw)).collect()
                    });
                }
            }
        }
    }
}

//! Who is about at a visit.

use std::sync::Arc;

use super::body::{Body, car, cyclist, dog, walker};
use super::way::{Pace, REACH_M};
use super::{Class, Mover};
use crate::hash::{Draw, Key};
use crate::motion::{Path, Trajectory};
use crate::world::{Moving, World};

/// No streets are fuller than this.
const MOST: f64 = 20.0;
/// Seconds between the places at which the sensor's way is looked at.
const LOOK_S: f64 = 0.25;
/// Who keeps farther from the sensor than this all the time is not worth being made, metres.
const NEVER_SEEN_M: f64 = 100.0;

/// Adds movers, those left out that nobody would see or that would come too near.
struct Crew<'a> {
    trajectory: &'a Trajectory<'a>,
    /// Where the sensor is every [`LOOK_S`] from `from_s` on.
    sensor: Vec<[f64; 2]>,
    from_s: f64,
    page: u32,
    count: u32,
    list: Vec<Mover>,
}

/// Someone on a way: how, and how far from the sensor's middle they keep.
struct Role {
    class: Class,
    left_m: f64,
    pace: Pace,
    clearance_m: f64,
}

pub(super) fn populate(
    world: &World,
    trajectory: &Trajectory<'_>,
    (from_s, to_s): (f64, f64),
    density: f64,
    key: Key,
) -> Vec<Mover> {
    if density.is_nan() || density <= 0.0 {
        return Vec::new();
    }
    let density = density.min(MOST);
    let looks = ((to_s - from_s).max(0.0) / LOOK_S).ceil() as usize;
    let sensor =
        (0..=looks).map(|n| trajectory.path().at(trajectory.travelled(from_s + n as f64 * LOOK_S))).collect();
    let page = u32::from(world.visit().number & 3);
    let mut crew = Crew { trajectory, sensor, from_s, page, count: 0, list: Vec::new() };
    for (n, way) in world.walks().into_iter().enumerate() {
        crew.walk(Arc::new(way), density, &mut key.with(1).with(n as u64).draw());
    }
    for (n, way) in world.drives().into_iter().enumerate() {
        crew.laps(Arc::new(way), density, &mut key.with(2).with(n as u64).draw());
    }
    let route = Arc::new(trajectory.lane().unwrap_or(trajectory.path()).clone());
    let (first, last) = (trajectory.travelled(from_s), trajectory.travelled(to_s));
    match world.moving() {
        Moving::Roads { oncoming_m } => {
            crew.road(&route, (first, last), density, oncoming_m, &key.with(3));
        }
        Moving::Trails => crew.trail(&route, (first, last), density, &key.with(4)),
        Moving::Aisles { .. } | Moving::Paths => {}
    }
    crew.list
}

/// A whole number whose mean is `mean`.
fn about(mean: f64, draw: &mut Draw) -> usize {
    mean.floor() as usize + usize::from(draw.chance(mean.fract() as f32))
}

impl Crew<'_> {
    /// Puts a mover in, if its pace keeps it clear of the sensor and within sight of it.
    fn add(&mut self, way: &Arc<Path>, role: Role, of: impl FnOnce(u32) -> (Vec<Body>, f64)) {
        self.count += 1;
        let id = ((self.page << 14) | (self.count & 0x3FFF)) << 16;
        if id == 0 {
            return;
        }
        let Role { class, left_m, pace, clearance_m } = role;
        let mut mover = Mover { id, class, way: way.clone(), left_m, pace, gait: Vec::new(), stride_m: 1.0 };
        let nearest = self.nearest(&mover);
        if (clearance_m..NEVER_SEEN_M).contains(&nearest) {
            (mover.gait, mover.stride_m) = of(id);
            self.list.push(mover);
        }
    }

    /// How near it comes to the sensor. Between two looks both go straight on.
    fn nearest(&self, mover: &Mover) -> f64 {
        let (first, last) = mover.pace.span();
        let index = |t: f64| ((t - self.from_s) / LOOK_S).clamp(0.0, self.sensor.len() as f64);
        let range = index(first).floor() as usize..(index(last).ceil() as usize + 1).min(self.sensor.len());
        let mut before: Option<[f64; 2]> = None;
        let mut nearest = f64::INFINITY;
        for n in range {
            let place = mover.place(self.trajectory, self.from_s + n as f64 * LOOK_S);
            let Some(place) = place else {
                before = None;
                continue;
            };
            let now = [place.x - self.sensor[n][0], place.y - self.sensor[n][1]];
            nearest = nearest.min(now[0].hypot(now[1]));
            if let Some(a) = before {
                let d = [now[0] - a[0], now[1] - a[1]];
                let t = -(a[0] * d[0] + a[1] * d[1]) / (d[0] * d[0] + d[1] * d[1]).max(1e-9);
                let t = t.clamp(0.0, 1.0);
                nearest = nearest.min((a[0] + t * d[0]).hypot(a[1] + t * d[1]));
            }
            before = Some(now);
        }
        nearest
    }

    /// People who stroll to and fro on a way made for them.
    fn walk(&mut self, way: Arc<Path>, density: f64, draw: &mut Draw) {
        if way.length() < 12.0 {
            return;
        }
        for _ in 0..about(way.length() / 110.0 * density, draw) {
            let pace =
                Pace::Shuttle { speed: f64::from(draw.range(0.9, 1.7)), phase: f64::from(draw.unit()) };
            let left_m = f64::from(draw.range(-0.3, 0.3));
            let role = Role { class: Class::Walker, left_m, pace, clearance_m: 0.75 };
            self.add(&way, role, |id| walker(id, draw));
        }
    }

    /// Cars that circle on a closed street, all at one speed: none runs into another.
    fn laps(&mut self, way: Arc<Path>, density: f64, draw: &mut Draw) {
        let speed = f64::from(draw.range(5.5, 8.5));
        let cars = about(way.length() / 90.0 * density, draw);
        for n in 0..cars {
            let start = (n as f64 + 0.5 * f64::from(draw.unit())) * way.length() / cars as f64;
            let class = car_or_van(draw);
            let role = Role { class, left_m: 0.0, pace: Pace::Laps { speed, start }, clearance_m: 2.2 };
            self.add(&way, role, |id| (car(id, class, draw), 1.0));
        }
    }

    /// Meetings along the sensor's way: about every `every` metres times one over the density, with a share of chance.
    fn meetings(
        &mut self,
        (first, last): (f64, f64),
        every: f64,
        density: f64,
        key: Key,
        mut of: impl FnMut(&mut Self, f64, f64, &mut Draw),
    ) {
        let gap = every / density;
        // Those met soon after the end are seen before it.
        let stations = ((last - first + 0.5 * REACH_M).max(0.0) / gap).ceil() as u64;
        for n in 0..stations {
            let mut draw = key.with(n).draw();
            let meet = first + (n as f64 + 0.15 + 0.7 * f64::from(draw.unit())) * gap;
            let when = self.trajectory.time_at(meet);
            of(self, meet, when, &mut draw);
        }
    }

    /// On a road: cars in the other lane, one ahead or behind for a while, cyclists at both edges.
    fn road(&mut self, route: &Arc<Path>, span: (f64, f64), density: f64, oncoming_m: f64, key: &Key) {
        let driven = self.trajectory.path();
        let other = Arc::new(route.offset(oncoming_m));
        let edges = [Arc::new(route.offset(-1.75)), Arc::new(route.offset(oncoming_m + 1.5))];
        self.meetings(span, 130.0, density, key.with(1), |crew, meet, when, draw| {
            let (class, speed) = (car_or_van(draw), -f64::from(draw.range(7.3, 9.3)));
            let pace = Pace::Once { speed, meet: abeam(driven, &other, meet), when, sway: 0.0 };
            let left_m = f64::from(draw.range(-0.2, 0.2));
            let role = Role { class, left_m, pace, clearance_m: 2.2 };
            crew.add(&other, role, |id| (car(id, class, draw), 1.0));
        });
        self.meetings(span, 520.0, density, key.with(2), |crew, _, when, draw| {
            let class = car_or_van(draw);
            let gap = f64::from(draw.range(15.0, 28.0)) * if draw.chance(0.6) { 1.0 } else { -1.0 };
            let pace = Pace::Company { gap, when, widen: f64::from(draw.range(0.3, 0.7)) };
            let role = Role { class, left_m: 0.0, pace, clearance_m: 8.0 };
            crew.add(route, role, |id| (car(id, class, draw), 1.0));
        });
        self.meetings(span, 350.0, density, key.with(3), |crew, meet, when, draw| {
            // Those who ride the same way are overtaken: they keep to the kerb.
            let (speed, edge) = match draw.chance(0.5) {
                true => (f64::from(draw.range(3.0, 5.5)), &edges[0]),
                false => (-f64::from(draw.range(3.5, 6.5)), &edges[1]),
            };
            let pace = Pace::Once { speed, meet: abeam(driven, edge, meet), when, sway: 0.0 };
            let role = Role { class: Class::Cyclist, left_m: 0.0, pace, clearance_m: 1.1 };
            crew.add(edge, role, |id| cyclist(id, draw));
        });
    }

    /// On a trail: walkers who are met or overtaken on their own side, some with a dog.
    fn trail(&mut self, route: &Arc<Path>, span: (f64, f64), density: f64, key: &Key) {
        let driven = self.trajectory.lane().map(|_| self.trajectory.path());
        self.meetings(span, 220.0, density, key.with(1), |crew, meet, when, draw| {
            let meet = driven.map_or(meet, |driven| abeam(driven, route, meet));
            let same_way = draw.chance(0.25);
            let speed =
                if same_way { f64::from(draw.range(0.5, 0.8)) } else { -f64::from(draw.range(1.0, 1.6)) };
            // Everybody keeps to one side of the trail.
            let left_m = f64::from(draw.range(1.25, 1.45)) * if same_way { -1.0 } else { 1.0 };
            let pace = Pace::Once { speed, meet, when, sway: 0.0 };
            let role = Role { class: Class::Walker, left_m, pace, clearance_m: 0.7 };
            crew.add(route, role, |id| walker(id, draw));
            if draw.chance(0.5) {
                let pace = Pace::Once { speed, meet: meet + 1.6 * speed.signum(), when, sway: 0.9 };
                let left_m = left_m + 0.45 * left_m.signum();
                let role = Role { class: Class::Dog, left_m, pace, clearance_m: 0.7 };
                crew.add(route, role, |id| dog(id, draw));
            }
        });
    }
}

/// The metres along a way beside another that are abeam of `s` metres along that one.
fn abeam(route: &Path, beside: &Path, s: f64) -> f64 {
    let at = route.at(s);
    // Bends make one of them longer; far off, the route may pass the same place again.
    let middle = s * beside.length() / route.length().max(1.0);
    let places = (-80..=80).map(|k| (middle + f64::from(k)).clamp(0.0, beside.length()));
    let off = |t: f64| {
        let p = beside.at(t);
        (p[0] - at[0]).hypot(p[1] - at[1])
    };
    places.min_by(|a, b| off(*a).total_cmp(&off(*b))).unwrap_or(middle)
}

fn car_or_van(draw: &mut Draw) -> Class {
    if draw.chance(0.15) { Class::MovingVan } else { Class::MovingCar }
}

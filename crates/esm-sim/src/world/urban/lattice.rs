//! The lattice of streets, and the drive over it.

use rustc_hash::FxHashMap;

use crate::hash::{Draw, Key};
use crate::motion::Path;

/// Mean distance of crossings, metres.
pub(super) const BLOCK: f64 = 88.0;
/// From the middle of the road to the middle of a lane, metres.
const LANE: f64 = 1.6;
/// Between the middles of the two lanes, metres.
pub(in crate::world) const LANES_M: f64 = 2.0 * LANE;
/// From this share of its length on, the route goes over streets that it has used before.
pub(crate) const REVISIT_SHARE: f64 = 0.8;

/// Crossings: a lattice that has been pulled about.
fn crossing(key: Key, i: i32, j: i32) -> [f64; 2] {
    let mut draw = key.with(2).cell(i.into(), j.into()).draw();
    let off = |d: &mut Draw| f64::from(d.range(-0.16, 0.16)) * BLOCK;
    [f64::from(i) * BLOCK + off(&mut draw), f64::from(j) * BLOCK + off(&mut draw)]
}

/// Streets run right (0) or up (1) from a crossing. Some are missing, at most two at any crossing, never opposite ones.
pub(super) fn exists(key: Key, i: i32, j: i32, side: u32) -> bool {
    let place = (i + 2 * j).rem_euclid(5);
    let may_miss = if side == 0 { place == 0 } else { place == 2 };
    !(may_miss && key.with(3 + u64::from(side)).cell(i.into(), j.into()).unit() < 0.6)
}

/// A street's middle, bent.
pub(super) fn street(key: Key, i: i32, j: i32, side: u32) -> Path {
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
pub(super) fn route(key: Key, length_m: f64, half: i32) -> (Vec<(i32, i32)>, Path) {
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

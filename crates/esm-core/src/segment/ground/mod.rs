//! Which points are ground: a surface of local planes, found from coarse to fine, and a band above it.

mod grid;
mod plane;

use super::GroundConfig;
use grid::{Grid, NONE, Pyramid};
use plane::{Correction, Plane};

/// Edge of the finest grid cell.
const FINEST_EDGE: f64 = 0.5;
/// Level whose cells (4 m) look for the lowest dense layer.
const SEED_LEVEL: usize = 3;
/// Levels of the pyramid: 0.5 m to 32 m.
const LEVELS: usize = 7;

/// A point that may lie on the ground, with a weight.
#[derive(Clone, Copy, Debug)]
struct Seed {
    p: [f64; 3],
    /// Cells of the finest grid that agree with it.
    support: u32,
}

/// One flag a point: whether it lies on the ground.
///
/// Points are in metres with z up (to a few degrees) and finite. No sensor height is assumed. The flags do not depend on
/// the order of the points.
pub fn ground_flags(points: &[[f32; 3]], config: &GroundConfig) -> Vec<bool> {
    let (layer, need_frac, gate_slope) = (0.5, 0.15, 0.15);
    let (smax, band) = (f64::from(config.max_slope), f64::from(config.band));
    let mut flags = vec![false; points.len()];
    let pyramid = Pyramid::new(points, FINEST_EDGE, LEVELS);
    let grids = &pyramid.grids;
    let fine = &grids[0];
    if fine.len() == 0 {
        return flags;
    }
    // lows
    let lows: Vec<[f64; 3]> = (0..fine.len())
        .map(|c| {
            let ids = &pyramid.order[pyramid.starts[c] as usize..pyramid.starts[c + 1] as usize];
            let mut best = points[ids[0] as usize];
            for &i in &ids[1..] {
                let p = points[i as usize];
                if (p[2], p[0], p[1]) < (best[2], best[0], best[1]) {
                    best = p;
                }
            }
            best.map(f64::from)
        })
        .collect();
    // seeds at SEED_LEVEL
    let sg = &grids[SEED_LEVEL];
    let mut members: Vec<(u32, f64, u32)> = (0..fine.len())
        .map(|c| {
            let mut a = c as u32;
            for l in 0..SEED_LEVEL {
                a = grids[l].parents[a as usize];
            }
            (a, lows[c][2], c as u32)
        })
        .collect();
    members.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut seeds: Vec<Option<Seed>> = vec![None; sg.len()];
    for run in members.chunk_by(|a, b| a.0 == b.0) {
        let n = run.len();
        let need = ((need_frac * n as f64).ceil() as usize).max(3).min(n);
        let mut found = None;
        for need in [need, 2.min(n), 1] {
            let mut end = 0;
            for s in 0..n {
                while end < n && run[end].1 <= run[s].1 + layer {
                    end += 1;
                }
                if end - s >= need {
                    found = Some((s, end));
                    break;
                }
            }
            if found.is_some() {
                break;
            }
        }
        if let Some((s, e)) = found {
            let mut p = [0.0; 3];
            for m in &run[s..e] {
                for a in 0..3 {
                    p[a] += lows[m.2 as usize][a];
                }
            }
            seeds[run[0].0 as usize] =
                Some(Seed { p: p.map(|v| v / (e - s) as f64), support: (e - s) as u32 });
        }
    }
    // outliers below, then objects above
    let dist = |a: &Seed, b: &Seed| (a.p[0] - b.p[0]).hypot(a.p[1] - b.p[1]);
    let kept: Vec<Option<Seed>> = (0..sg.len())
        .map(|c| {
            let s = seeds[c]?;
            let (mut n, mut high) = (0, 0);
            sg.for_around(c, 2, |o| {
                if let (Some(t), true) = (seeds[o], o != c) {
                    n += 1;
                    if t.p[2] - s.p[2] > 0.3 + smax * dist(&s, &t) {
                        high += 1;
                    }
                }
            });
            (high < 2 || high * 2 < n).then_some(s)
        })
        .collect();
    let kept: Vec<Option<Seed>> = (0..sg.len())
        .map(|c| {
            let s = kept[c]?;
            let mut low = 0;
            sg.for_around(c, 2, |o| {
                if let Some(t) = kept[o] {
                    if s.p[2] - t.p[2] > 0.3 + smax * dist(&s, &t) {
                        low += if t.support > 2 { 2 } else { 1 };
                    }
                }
            });
            (low < 2).then_some(s)
        })
        .collect();
    // Aggregate upwards: lowest kept child.
    let mut up: Vec<Vec<Option<Seed>>> = vec![kept];
    for l in SEED_LEVEL..LEVELS - 1 {
        let last = &up[up.len() - 1];
        let mut next: Vec<Option<Seed>> = vec![None; grids[l + 1].len()];
        for (c, s) in last.iter().enumerate() {
            if let Some(s) = s {
                let q = &mut next[grids[l].parents[c] as usize];
                if q.is_none_or(|q| s.p[2] < q.p[2]) {
                    *q = Some(*s);
                }
            }
        }
        up.push(next);
    }
    // Top: constant-slope planes
    let mut planes: Vec<Plane> = Vec::new();
    for l in (0..LEVELS).rev() {
        let grid = &grids[l];
        let base = |c: usize| -> Plane {
            let centre = grid.centre(c);
            if l == LEVELS - 1 {
                // lowest seed among 3x3 or else lowest low
                let (mut z, mut n) = (0.0, 0.0);
                let mut r = 1;
                while n == 0.0 && r <= 64 {
                    grid.for_around(c, r, |o| {
                        if let Some(s) = up[l - SEED_LEVEL][o] {
                            z += s.p[2];
                            n += 1.0;
                        }
                    });
                    r *= 4;
                }
                Plane { centre, height: if n > 0.0 { z / n } else { f64::MAX.sqrt() }, slope: [0.0; 2] }
            } else {
                blend(&grids[l + 1], &planes, centre)
            }
        };
        let bases: Vec<Plane> = (0..grid.len()).map(base).collect();
        let items: Vec<Option<[f64; 3]>> = if l == LEVELS - 1 {
            up[l - SEED_LEVEL].iter().map(|s| s.map(|s| s.p)).collect()
        } else if l >= SEED_LEVEL {
            let gate = 0.15 + gate_slope * grid.edge;
            up[l - SEED_LEVEL]
                .iter()
                .enumerate()
                .map(|(c, s)| {
                    s.map(|s| s.p).filter(|p| {
                        let r = p[2] - bases[c].at([p[0], p[1]]);
                        r <= gate && r >= -2.0 * gate
                    })
                })
                .collect()
        } else {
            let gate = 0.15 + gate_slope * grid.edge;
            let mut items: Vec<Option<([f64; 3], f64)>> = vec![None; grid.len()];
            for (f, p) in lows.iter().enumerate() {
                let mut c = f as u32;
                for lv in 0..l {
                    c = grids[lv].parents[c as usize];
                }
                let r = p[2] - bases[c as usize].at([p[0], p[1]]);
                if r <= gate && r >= -2.0 * gate && items[c as usize].is_none_or(|q| r < q.1) {
                    items[c as usize] = Some((*p, r));
                }
            }
            items.into_iter().map(|i| i.map(|i| i.0)).collect()
        };
        let gate = if l == LEVELS - 1 { 1e9 } else { 0.15 + gate_slope * grid.edge };
        planes = (0..grid.len())
            .map(|c| {
                let mut plane = bases[c];
                let per_edge = 1.0 / grid.edge;
                for it in 0..3 {
                    let mut fit = Correction::default();
                    grid.for_around(c, 1, |o| {
                        if let Some(p) = items[o] {
                            let r = p[2] - plane.at([p[0], p[1]]);
                            let w = if it == 0 {
                                1.0
                            } else if r > gate * 0.3 {
                                0.1
                            } else {
                                1.0
                            };
                            if r.abs() < gate * 3.0 {
                                fit.add(
                                    (p[0] - plane.centre[0]) * per_edge,
                                    (p[1] - plane.centre[1]) * per_edge,
                                    r,
                                    w,
                                );
                            }
                        }
                    });
                    let [a, b, cc] = fit.solve(0.1, 1.0);
                    plane.height += a;
                    plane.slope[0] += b * per_edge;
                    plane.slope[1] += cc * per_edge;
                }
                plane
            })
            .collect();
    }
    for c in 0..fine.len() {
        let ids = &pyramid.order[pyramid.starts[c] as usize..pyramid.starts[c + 1] as usize];
        for &i in ids {
            let p = points[i as usize].map(f64::from);
            let h = p[2] - blend(fine, &planes, [p[0], p[1]]).height;
            flags[i as usize] = h <= band && h >= -band * 2.0;
        }
    }
    flags
}

/// The plane at a place, blended from the up to four cells around it.
fn blend(grid: &Grid, planes: &[Plane], xy: [f64; 2]) -> Plane {
    let u = xy.map(|v| v / grid.edge - 0.5);
    let k = u.map(crate::segment::radix::floor_i64);
    let f = [u[0] - k[0] as f64, u[1] - k[1] as f64];
    let (mut w, mut height, mut slope) = (0.0, 0.0, [0.0; 2]);
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let found = grid.find(k[0] + dx, k[1] + dy);
        if found == NONE {
            continue;
        }
        let weight = (if dx == 0 { 1.0 - f[0] } else { f[0] }) * (if dy == 0 { 1.0 - f[1] } else { f[1] });
        let plane = &planes[found as usize];
        w += weight;
        height += weight * plane.at(xy);
        slope[0] += weight * plane.slope[0];
        slope[1] += weight * plane.slope[1];
    }
    // The cell that holds the place is one of the four, with a weight of at least a quarter.
    Plane { centre: xy, height: height / w, slope: slope.map(|s| s / w) }
}

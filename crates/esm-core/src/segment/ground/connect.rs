//! Which patches are ground: patches that continue each other form surfaces, and a surface that drops off all around
//! (a roof, a crown) or hangs alone below its surroundings (stray returns) is not ground.

use super::grid::Grid;
use super::patch::Patch;
use crate::segment::disjoint_sets::DisjointSets;

/// Cells to either side in which patches are compared: gaps of one cell do not cut a surface.
const RADIUS: i64 = 2;
/// Lows from which on a patch's slope is believed.
const SLOPE_SUPPORT: u32 = 4;
/// Height by which neighbours may miss each other's prediction, metres, and its growth with their distance.
const STEP: f64 = 0.2;
const STEP_PER_METRE: f64 = 0.15;
/// Surfaces of at most so many patches are strays where at least `STRAY_HIGHER` of the neighbouring patches, and the
/// share `STRAY_HIGHER_SHARE` of them, are higher.
const STRAY_CELLS: usize = 6;
const STRAY_HIGHER: usize = 3;
const STRAY_HIGHER_SHARE: f64 = 0.6;
/// Surfaces of at least so many square metres are ground even where they drop off all around.
const LARGE: f64 = 2500.0;
/// Share of a surface's rim that drops off, at which it is no ground.
const DROP_SHARE: f64 = 0.6;

/// Whether each patch is ground.
pub(super) fn ground_patches(grid: &Grid, patches: &[Patch], max_slope: f64) -> Vec<bool> {
    let n = grid.len();
    let mut sets = DisjointSets::new(n);
    for c in 0..n {
        grid.for_around(c, RADIUS, |o| {
            if o > c && step(&patches[c], &patches[o], max_slope) == Step::None {
                let (a, b) = (sets.find(c as u32), sets.find(o as u32));
                if a != b {
                    sets.unite(a, b);
                }
            }
        });
    }
    let surface: Vec<usize> = (0..n).map(|c| sets.find(c as u32) as usize).collect();
    let mut size = vec![0usize; n];
    for &s in &surface {
        size[s] += 1;
    }

    // Strays: small, and most of what is around is higher.
    let (mut higher, mut others) = (vec![0usize; n], vec![0usize; n]);
    for c in 0..n {
        let s = surface[c];
        if size[s] <= STRAY_CELLS {
            grid.for_around(c, RADIUS, |o| {
                if surface[o] != s {
                    others[s] += 1;
                    higher[s] += usize::from(step(&patches[c], &patches[o], max_slope) == Step::Up);
                }
            });
        }
    }
    let outvoted = |s: usize| higher[s] as f64 >= STRAY_HIGHER_SHARE * others[s] as f64;
    let stray: Vec<bool> =
        (0..n).map(|s| size[s] <= STRAY_CELLS && higher[s] >= STRAY_HIGHER && outvoted(s)).collect();

    // Roofs and crowns: most of the rim has lower ground beside it.
    let (mut rim, mut drops) = (vec![0usize; n], vec![0usize; n]);
    for c in 0..n {
        let s = surface[c];
        let (mut inside, mut drop) = (0, false);
        grid.for_around(c, 1, |o| inside += usize::from(surface[o] == s));
        if inside == 9 {
            continue;
        }
        grid.for_around(c, RADIUS, |o| {
            let t = surface[o];
            drop |= t != s && !stray[t] && step(&patches[c], &patches[o], max_slope) == Step::Down;
        });
        rim[s] += 1;
        drops[s] += usize::from(drop);
    }
    let large = (LARGE / (grid.edge * grid.edge)) as usize;
    let is_ground =
        |s: usize| !stray[s] && (size[s] >= large || drops[s] as f64 <= DROP_SHARE * rim[s] as f64);
    surface.iter().map(|&s| is_ground(s)).collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Step {
    None,
    Up,
    Down,
}

/// How `b` continues `a`: by the trapezoid rule, a smooth surface rises by its mean slope times the distance.
fn step(a: &Patch, b: &Patch, max_slope: f64) -> Step {
    let d = [b.plane.centre[0] - a.plane.centre[0], b.plane.centre[1] - a.plane.centre[1]];
    let distance = d[0].hypot(d[1]);
    let rise = b.plane.height - a.plane.height;
    let slope = |p: &Patch| p.plane.slope[0] * d[0] + p.plane.slope[1] * d[1];
    let expected = match (a.support >= SLOPE_SUPPORT, b.support >= SLOPE_SUPPORT) {
        (true, true) => 0.5 * (slope(a) + slope(b)),
        (true, false) => slope(a),
        (false, true) => slope(b),
        (false, false) => 0.0,
    };
    let limit = max_slope * distance;
    let miss = rise - expected.clamp(-limit, limit);
    let allowed = STEP + STEP_PER_METRE * distance;
    if miss > allowed {
        Step::Up
    } else if miss < -allowed {
        Step::Down
    } else {
        Step::None
    }
}

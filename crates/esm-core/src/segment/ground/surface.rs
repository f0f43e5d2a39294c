//! The ground surface: planes of the ground patches, filled in where there are none, then refined level by level.

use super::connect::ground_patches;
use super::grid::{Grid, NONE, Pyramid};
use super::patch::{Patch, patches};
use super::plane::{Correction, Plane};
use crate::segment::radix::floor_i64;

/// Level of the patches: cells of 4 m.
pub(super) const PATCH_LEVEL: usize = 3;
/// Levels of the pyramid: cells of 0.5 m to 64 m.
pub(super) const LEVELS: usize = 8;

/// Farthest a low may be above the plane its coarser level predicts, metres: `GATE + GATE_PER_EDGE * edge`; twice that
/// below, since what lies lower is the better ground.
const GATE: f64 = 0.15;
const GATE_PER_EDGE: f64 = 0.15;
/// Lows that stick out of a fit by more than this share of the gate count little in the next one.
const OUTSTANDING: f64 = 0.3;
const OUTSTANDING_WEIGHT: f64 = 0.1;
/// Share of the gate within which a low speaks for one side of a step.
const SIDE_GATE: f64 = 0.5;
/// Pull of each correction towards none, in lows: a cell with a single low follows it in height but not in slope.
const PULL_HEIGHT: f64 = 0.1;
const PULL_SLOPE: f64 = 1.0;
const ITERATIONS: usize = 3;

/// Planes of the finest grid's cells, fitted to their lows (one a cell); `None` where nothing is ground.
pub(super) fn fit(pyramid: &Pyramid, lows: &[[f64; 3]], max_slope: f64) -> Option<Vec<Plane>> {
    let grids = &pyramid.grids;
    // Ancestors of each finest cell on the levels up to the patches'.
    let mut ancestors: Vec<Vec<u32>> = vec![(0..lows.len() as u32).collect()];
    for level in 0..PATCH_LEVEL {
        let next = ancestors[level].iter().map(|&c| grids[level].parents[c as usize]).collect();
        ancestors.push(next);
    }
    let patch_grid = &grids[PATCH_LEVEL];
    let patches = patches(patch_grid, lows, &ancestors[PATCH_LEVEL]);
    let is_ground = ground_patches(patch_grid, &patches, max_slope);
    let mut planes = filled(pyramid, &patches, &is_ground)?;
    for level in (0..PATCH_LEVEL).rev() {
        planes = refined(&grids[level], &grids[level + 1], &planes, lows, &ancestors[level]);
    }
    Some(planes)
}

/// A plane for every cell of the patch level: the patch's own, else what coarser levels say.
fn filled(pyramid: &Pyramid, patches: &[Patch], is_ground: &[bool]) -> Option<Vec<Plane>> {
    let grids = &pyramid.grids[PATCH_LEVEL..];
    // Up: means of what the children know, brought to the cell's centre.
    let known = patches
        .iter()
        .zip(is_ground)
        .enumerate()
        .map(|(c, (patch, is_ground))| is_ground.then(|| patch.plane.moved_to(grids[0].centre(c))));
    let mut levels: Vec<Vec<Option<Plane>>> = vec![known.collect()];
    for (level, grid) in grids.iter().enumerate().skip(1) {
        let mut sums = vec![(0.0, Plane::default()); grid.len()];
        for (c, plane) in levels[level - 1].iter().enumerate() {
            let Some(plane) = plane else { continue };
            let parent = grids[level - 1].parents[c] as usize;
            let (n, sum) = &mut sums[parent];
            *n += 1.0;
            sum.height += plane.height;
            for a in 0..2 {
                sum.slope[a] += plane.slope[a];
                sum.centre[a] += plane.centre[a];
            }
        }
        let mean = |(n, s): (f64, Plane)| {
            let mean = |v: [f64; 2]| v.map(|v| v / n);
            (n > 0.0).then(|| Plane { height: s.height / n, slope: mean(s.slope), centre: mean(s.centre) })
        };
        levels.push(sums.into_iter().map(mean).collect());
    }
    // Down: each cell that knows nothing takes over from its coarser level.
    let top = levels.pop()?;
    let lowest = top.iter().flatten().copied().min_by(|a, b| a.height.total_cmp(&b.height))?;
    let mut planes: Vec<Plane> =
        top.into_iter().map(|p| p.unwrap_or(Plane { slope: [0.0; 2], ..lowest })).collect();
    for (level, known) in levels.into_iter().enumerate().rev() {
        let blended = known.iter().enumerate().map(|(c, plane)| {
            plane.unwrap_or_else(|| blend(&grids[level + 1], &planes, grids[level].centre(c)))
        });
        planes = blended.collect();
    }
    Some(planes)
}

/// Planes of a finer level: what the coarser one predicts, corrected by the lows near that prediction.
fn refined(
    grid: &Grid,
    coarser: &Grid,
    coarse_planes: &[Plane],
    lows: &[[f64; 3]],
    cell_of_low: &[u32],
) -> Vec<Plane> {
    let gate = GATE + GATE_PER_EDGE * grid.edge;
    let mut planes: Vec<Plane> =
        (0..grid.len()).map(|c| blend(coarser, coarse_planes, grid.centre(c))).collect();
    choose_sides(grid, coarser, coarse_planes, &mut planes, lows, cell_of_low, SIDE_GATE * gate);
    // The lowest low of each cell that passes the gate.
    let mut best: Vec<Option<(f64, [f64; 3])>> = vec![None; grid.len()];
    for (p, &c) in lows.iter().zip(cell_of_low) {
        let r = p[2] - planes[c as usize].at([p[0], p[1]]);
        let best = &mut best[c as usize];
        if r <= gate && r >= -2.0 * gate && best.is_none_or(|(b, _)| r < b) {
            *best = Some((r, *p));
        }
    }
    let per_edge = 1.0 / grid.edge;
    let mut near = Vec::with_capacity(9);
    for (c, plane) in planes.iter_mut().enumerate() {
        near.clear();
        grid.for_around(c, 1, |o| near.extend(best[o].map(|(_, p)| p)));
        for iteration in 0..ITERATIONS {
            let mut fit = Correction::default();
            for p in &near {
                let r = p[2] - plane.at([p[0], p[1]]);
                if r.abs() < 3.0 * gate {
                    let outstanding = iteration > 0 && r > OUTSTANDING * gate;
                    let weight = if outstanding { OUTSTANDING_WEIGHT } else { 1.0 };
                    let [dx, dy] = [0, 1].map(|a| (p[a] - plane.centre[a]) * per_edge);
                    fit.add(dx, dy, r, weight);
                }
            }
            plane.correct(fit.solve(PULL_HEIGHT, PULL_SLOPE), per_edge);
        }
    }
    planes
}

/// Beside a step in the ground the blend lies between the two sides: where most lows miss it and more of them are on one
/// neighbour's plane, that plane is taken instead.
fn choose_sides(
    grid: &Grid,
    coarser: &Grid,
    coarse_planes: &[Plane],
    planes: &mut [Plane],
    lows: &[[f64; 3]],
    cell_of_low: &[u32],
    gate: f64,
) {
    let on = |plane: &Plane, p: &[f64; 3]| (p[2] - plane.at([p[0], p[1]])).abs() <= gate;
    let mut count = vec![[0u32; 2]; grid.len()];
    for (p, &c) in lows.iter().zip(cell_of_low) {
        count[c as usize][0] += 1;
        count[c as usize][1] += u32::from(on(&planes[c as usize], p));
    }
    let mut missed: Vec<(u32, [f64; 3])> = Vec::new();
    for (p, &c) in lows.iter().zip(cell_of_low) {
        let [all, hit] = count[c as usize];
        if 2 * hit < all && all > 1 {
            missed.push((c, *p));
        }
    }
    missed.sort_by_key(|m| m.0);
    for run in missed.chunk_by(|a, b| a.0 == b.0) {
        let c = run[0].0 as usize;
        let mut best = (count[c][1] + 1, planes[c]);
        coarser.for_around(grid.parents[c] as usize, 1, |o| {
            let hits = run.iter().filter(|m| on(&coarse_planes[o], &m.1)).count() as u32;
            if hits > best.0 {
                best = (hits, coarse_planes[o].moved_to(planes[c].centre));
            }
        });
        planes[c] = best.1;
    }
}

/// The plane at a place, blended from the up to four cells around it.
pub(super) fn blend(grid: &Grid, planes: &[Plane], xy: [f64; 2]) -> Plane {
    let u = xy.map(|v| v / grid.edge - 0.5);
    let k = u.map(floor_i64);
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

//! Ways beside the route, as far off it as the ground allows.

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::{Class, Moving, TILE_M, World, tile_of};
use crate::cast::Footprint;
use crate::drive::MOST_ASIDE_M;
use crate::motion::Path;

/// Metres along the way between two choices.
const STEP_M: f64 = 1.0;
/// Metres between the distances from the way that are chosen from.
const LANE_M: f64 = 0.25;
/// Choices that may lie between those of two steps: about 37 degrees.
const SWERVE: usize = 3;
/// What a metre of swerving costs, in metres driven a metre off the distance that was asked for: nobody turns into a side
/// street for its width.
const SWERVE_COST: f64 = 5.0;
/// What stands is in the way between these heights above the ground, metres.
const BODY_M: [f64; 2] = [0.3, 2.2];
/// Twigs thinner than this give way, radius in metres.
const TWIG_M: f64 = 0.02;
/// Cells that what stands is sorted into, metres.
const CELL_M: f64 = 2.0;
/// Radius of the bends, metres.
const BEND_M: f64 = 2.0;

/// What drives or walks: half its width with its wandering about the way, and half of what must be road, metres.
struct Width {
    clear: f64,
    wheels: f64,
}

/// The way `left_m` metres beside another, to its left as it runs. Where that is no ground to drive on (in streets: not the
/// carriageway), or too near to something solid, it keeps as near to that distance as it can, between it and the way itself,
/// which is always free; it does not swerve for short gaps.
pub(super) fn aside(world: &World, way: &Path, left_m: f64) -> Path {
    let left_m = left_m.clamp(-MOST_ASIDE_M, MOST_ASIDE_M);
    let count = (left_m.abs() / LANE_M).round() as usize;
    let steps = (way.length() / STEP_M).round().max(1.0) as usize;
    let step = way.length() / steps as f64;
    let off = |j: usize| LANE_M * j as f64 * left_m.signum();
    let base: Vec<[f64; 2]> = (0..=steps).map(|k| way.at(k as f64 * step)).collect();
    let place = |k: usize, j: usize| {
        let h = way.heading(k as f64 * step, 1.5);
        [base[k][0] - off(j) * h.sin(), base[k][1] + off(j) * h.cos()]
    };
    let width = match world.moving() {
        Moving::Roads { .. } => Width { clear: 1.4, wheels: 0.9 },
        Moving::Aisles { .. } => Width { clear: 1.2, wheels: 0.9 },
        Moving::Trails | Moving::Paths => Width { clear: 0.8, wheels: 0.0 },
    };
    let obstacles = Obstacles::around(world, &base, left_m.abs() + width.clear);
    let free = |k: usize, j: usize| {
        let (p, out) = (place(k, j), off(j).abs());
        let h = way.heading(k as f64 * step, 1.5);
        // Inside of a bend too sharp for it, another piece of the way is nearer than its own.
        let reach = (4.0 * out / step).ceil() as usize;
        let near = &base[k.saturating_sub(reach)..=(k + reach).min(steps)];
        near.iter().all(|b| (b[0] - p[0]).hypot(b[1] - p[1]) > 0.98 * out - 0.02)
            && [-1.0, 0.0, 1.0].iter().all(|side| {
                let w = side * width.wheels;
                world.drivable(p[0] - w * h.sin(), p[1] + w * h.cos())
            })
            && obstacles.clear(p, width.clear)
    };
    let allowed: Vec<Vec<bool>> =
        (0..=steps).into_par_iter().map(|k| (0..=count).map(|j| j == 0 || free(k, j)).collect()).collect();
    let chosen = cheapest(&allowed, count);
    let beside = Path::new(chosen.iter().enumerate().map(|(k, j)| place(k, *j)));
    beside.smoothed(0.0, beside.length(), BEND_M)
}

/// For every step the choice of the cheapest sequence (Viterbi); of equal ones that nearer to the way.
fn cheapest(allowed: &[Vec<bool>], count: usize) -> Vec<usize> {
    let short = |j: usize| LANE_M * (count - j) as f64;
    let mut cost: Vec<f64> =
        (0..=count).map(|j| if allowed[0][j] { short(j) } else { f64::INFINITY }).collect();
    let mut from: Vec<Vec<usize>> = Vec::with_capacity(allowed.len());
    for here in &allowed[1..] {
        let best = |j: usize| {
            let reach = j.saturating_sub(SWERVE)..=(j + SWERVE).min(count);
            let swerved = |i: usize| cost[i] + SWERVE_COST * LANE_M * i.abs_diff(j) as f64;
            reach.map(|i| (swerved(i), i)).fold((f64::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a })
        };
        let next: Vec<(f64, usize)> =
            (0..=count).map(|j| if here[j] { best(j) } else { (f64::INFINITY, 0) }).collect();
        cost = next.iter().enumerate().map(|(j, (c, _))| c + short(j)).collect();
        from.push(next.into_iter().map(|(_, i)| i).collect());
    }
    // The way itself is free everywhere, so some choice is finite.
    let mut j = (0..=count).fold(0, |a, b| if cost[b] < cost[a] { b } else { a });
    let mut chosen = vec![j];
    for back in from.iter().rev() {
        j = back[j];
        chosen.push(j);
    }
    chosen.reverse();
    chosen
}

/// What stands near a way, by cells of the plan.
struct Obstacles {
    plans: Vec<Footprint>,
    cells: FxHashMap<(i32, i32), Vec<u32>>,
}

fn cell_of([x, y]: [f64; 2]) -> (i32, i32) {
    ((x / CELL_M).floor() as i32, (y / CELL_M).floor() as i32)
}

impl Obstacles {
    /// What stands within `reach` metres of any of some places.
    fn around(world: &World, places: &[[f64; 2]], reach: f64) -> Self {
        // What is anchored in the next tile may reach into this one: walls and houses do.
        let reach = reach + 0.5 * TILE_M;
        let mut tiles: Vec<(i32, i32)> = Vec::new();
        for p in places.iter().step_by((0.25 * TILE_M / STEP_M) as usize).chain(places.last()) {
            let (low, high) = (tile_of(p[0] - reach, p[1] - reach), tile_of(p[0] + reach, p[1] + reach));
            tiles.extend((low.0..=high.0).flat_map(|i| (low.1..=high.1).map(move |j| (i, j))));
        }
        tiles.sort_unstable();
        tiles.dedup();
        let plans: Vec<Vec<Footprint>> = tiles.par_iter().map(|tile| Self::of_tile(world, *tile)).collect();
        let mut all = Self { plans: plans.into_iter().flatten().collect(), cells: FxHashMap::default() };
        for (n, plan) in all.plans.iter().enumerate() {
            let [low, high] = plan.bounds();
            let (low, high) = (cell_of(low), cell_of(high));
            for cell in (low.0..=high.0).flat_map(|i| (low.1..=high.1).map(move |j| (i, j))) {
                all.cells.entry(cell).or_default().push(n as u32);
            }
        }
        all
    }

    fn of_tile(world: &World, tile: (i32, i32)) -> Vec<Footprint> {
        let mut plans = Vec::new();
        for object in world.objects(tile) {
            // Leaves give way but for those of hedges and bushes.
            let dense = matches!(object.class, Class::Bush | Class::Hedge);
            let solid = object.shapes.iter().filter(|s| dense || !s.is_medium());
            let plan = solid.map(|s| s.footprint([object.anchor.x, object.anchor.y]));
            plans.extend(plan.filter(|p| {
                p.span[1] > BODY_M[0]
                    && p.span[0] < BODY_M[1]
                    && (p.thick > TWIG_M || object.class == Class::Fence)
            }));
        }
        plans
    }

    /// Whether nothing stands within some metres of a place.
    fn clear(&self, p: [f64; 2], metres: f64) -> bool {
        let (low, high) = (cell_of([p[0] - metres, p[1] - metres]), cell_of([p[0] + metres, p[1] + metres]));
        let mut cells = (low.0..=high.0).flat_map(|i| (low.1..=high.1).map(move |j| (i, j)));
        cells.all(|cell| {
            let near = self.cells.get(&cell).map_or(&[][..], Vec::as_slice);
            near.iter().all(|n| self.plans[*n as usize].distance(p) >= metres)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Around a wall on the wished line, and not into a gap that is too short.
    #[test]
    fn the_cheapest_choices() {
        let (steps, count) = (80, 8);
        let mut allowed = vec![vec![true; count + 1]; steps];
        for row in &mut allowed[30..50] {
            row[5..].fill(false);
        }
        let chosen = cheapest(&allowed, count);
        assert_eq!((chosen[0], chosen[29 - 4], chosen[40], chosen[79]), (8, 8, 4, 8));
        assert!(chosen.windows(2).all(|w| w[0].abs_diff(w[1]) <= SWERVE));
        for row in &mut allowed {
            row[1..].fill(false);
        }
        for row in &mut allowed[40..44] {
            row.fill(true);
        }
        assert_eq!(cheapest(&allowed, count), vec![0; steps]);
    }
}

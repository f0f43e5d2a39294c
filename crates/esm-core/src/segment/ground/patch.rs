//! Patches: in each cell of a few metres, the plane through its lowest dense layer.

use super::grid::{Grid, NONE};
use super::plane::{Correction, Plane};

/// Thickness of the layer that starts a patch, metres: rough grass on a slope that one cell does not resolve.
const LAYER: f64 = 0.5;
/// Share of a cell's lows that make a layer dense. Strays below the ground are fewer; under trees, even from the air,
/// more lows than this reach the ground.
const DENSE_SHARE: f64 = 0.15;
/// Lows that make a layer dense in any case, where a cell has that many.
const DENSE_COUNT: usize = 3;
/// Farthest a low may be from the plane it belongs to, metres, fit by fit.
const FIT_BANDS: [f64; 5] = [0.5, 0.4, 0.3, 0.25, 0.25];
/// Pull of each correction towards none, in lows: slight, since a layer cut out of a slope starts as a narrow strip.
const PULL_HEIGHT: f64 = 0.01;
const PULL_SLOPE: f64 = 0.02;
/// Steepest patch, rise over run.
const STEEPEST: f64 = 1.5;

/// The lowest layer of a cell. `plane.centre` is the layer's mean x, y.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Patch {
    pub(super) plane: Plane,
    /// Lows in the layer; 0 where the cell has no patch.
    pub(super) support: u32,
}

/// One patch for each cell of `grid`; `cell_of_low` names the cell of each low.
pub(super) fn patches(grid: &Grid, lows: &[[f64; 3]], cell_of_low: &[u32]) -> Vec<Patch> {
    // Counting sort of the lows by cell.
    let mut starts = vec![0u32; grid.len() + 1];
    for &c in cell_of_low {
        debug_assert_ne!(c, NONE);
        starts[c as usize + 1] += 1;
    }
    for c in 0..grid.len() {
        starts[c + 1] += starts[c];
    }
    let mut sorted = vec![[0.0; 3]; lows.len()];
    let mut next = starts.clone();
    for (low, &c) in lows.iter().zip(cell_of_low) {
        sorted[next[c as usize] as usize] = *low;
        next[c as usize] += 1;
    }
    (0..grid.len())
        .map(|c| patch(&mut sorted[starts[c] as usize..starts[c + 1] as usize], grid.edge))
        .collect()
}

fn patch(lows: &mut [[f64; 3]], edge: f64) -> Patch {
    lows.sort_unstable_by(|a, b| {
        a[2].total_cmp(&b[2]).then(a[0].total_cmp(&b[0])).then(a[1].total_cmp(&b[1]))
    });
    let layer = lowest_dense_layer(lows);
    let n = layer.len() as f64;
    let mean: [f64; 3] = std::array::from_fn(|a| layer.iter().map(|p| p[a]).sum::<f64>() / n);
    let mut plane = Plane { centre: [mean[0], mean[1]], height: mean[2], slope: [0.0; 2] };
    let mut support = layer.len() as u32;
    if support < 3 {
        return Patch { plane, support };
    }
    for band in FIT_BANDS {
        let (mut fit, mut sum, mut count) = (Correction::default(), [0.0; 2], 0u32);
        for p in lows.iter() {
            let r = p[2] - plane.at([p[0], p[1]]);
            if r.abs() <= band {
                fit.add((p[0] - plane.centre[0]) / edge, (p[1] - plane.centre[1]) / edge, r, 1.0);
                sum = [sum[0] + p[0], sum[1] + p[1]];
                count += 1;
            }
        }
        if count < 3 {
            break;
        }
        plane.correct(fit.solve(PULL_HEIGHT, PULL_SLOPE), 1.0 / edge);
        let steep = plane.slope[0].hypot(plane.slope[1]);
        if steep > STEEPEST {
            plane.slope = plane.slope.map(|s| s * STEEPEST / steep);
        }
        plane = plane.moved_to([sum[0] / f64::from(count), sum[1] / f64::from(count)]);
        support = count;
    }
    Patch { plane, support }
}

/// The lowest run of at most [`LAYER`] in height that is dense; else the lowest pair, else the lowest point.
fn lowest_dense_layer(lows: &[[f64; 3]]) -> &[[f64; 3]] {
    let n = lows.len();
    let dense = ((DENSE_SHARE * n as f64).ceil() as usize).max(DENSE_COUNT);
    for need in [dense, 2, 1] {
        let mut end = 0;
        for start in 0..n {
            while end < n && lows[end][2] <= lows[start][2] + LAYER {
                end += 1;
            }
            if end - start >= need {
                return &lows[start..end];
            }
        }
    }
    lows
}

//! Which points are ground: a surface of local planes, found from coarse to fine, and a band above it.
//!
//! 1. The lowest point of each 0.5 m cell is its *low* (`grid`).
//! 2. In each 4 m cell, the lowest dense layer of lows makes a *patch*, a plane (`patch`): what lies below it are
//!    strays, what lies above are objects, or the crowns of a forest.
//! 3. Patches that continue each other, whatever their slope, form surfaces; those that drop off all around are roofs
//!    and crowns, those alone below everything around are strays; the rest is ground (`connect`).
//! 4. The patches' planes, filled in where there are none, are corrected by the lows near them in cells of 2, 1 and
//!    0.5 m (`surface`).
//!
//! No sensor height, no rings and no viewpoint are assumed, so that single sweeps, accumulated clouds and whole prior
//! maps all serve. Time and memory are linear in the number of points.

mod connect;
mod grid;
mod patch;
mod plane;
mod surface;

use super::GroundConfig;
use grid::Pyramid;

/// Edge of the finest grid cell, metres.
const FINEST_EDGE: f64 = 0.5;
/// Height up to which points above the band tell that an object stands in a cell, metres.
const OBJECT_TOP: f64 = 1.5;
/// Points above the band for each one within it, from which on an object stands there.
const OBJECT_SHARE: f64 = 0.5;
/// Points lower than this many bands below the surface are no ground: strays, or a level beneath.
const BANDS_BELOW: f64 = 2.0;

/// One flag a point: whether it is ground.
///
/// Points are in metres, finite, with z up to within some ten degrees. The flags do not depend on the order of the
/// points. A point more than `2^31` half metres from the origin is not ground.
///
/// ```
/// use esm_core::segment::{GroundConfig, ground_flags};
/// let mut points: Vec<[f32; 3]> = (0..400).map(|i| [(i % 20) as f32, (i / 20) as f32, 0.0]).collect();
/// points.push([10.2, 10.2, 1.0]);
/// let flags = ground_flags(&points, &GroundConfig::default());
/// assert!(flags[..400].iter().all(|f| *f));
/// assert!(!flags[400]);
/// ```
pub fn ground_flags(points: &[[f32; 3]], config: &GroundConfig) -> Vec<bool> {
    let mut flags = vec![false; points.len()];
    let pyramid = Pyramid::new(points, FINEST_EDGE, surface::LEVELS);
    let fine = &pyramid.grids[0];
    let members = |c: usize| &pyramid.order[pyramid.starts[c] as usize..pyramid.starts[c + 1] as usize];
    let lows: Vec<[f64; 3]> = (0..fine.len()).map(|c| low(points, members(c))).collect();
    let Some(planes) = surface::fit(&pyramid, &lows, f64::from(config.max_slope)) else { return flags };

    let (band, contact_band) = (f64::from(config.band), f64::from(config.contact_band));
    let below = -BANDS_BELOW * band;
    let mut heights = Vec::new();
    for c in 0..fine.len() {
        heights.clear();
        heights.extend(members(c).iter().map(|&i| {
            let [x, y, z] = points[i as usize].map(f64::from);
            z - surface::blend(fine, &planes, [x, y]).height
        }));
        let count = |low: f64, high: f64| heights.iter().filter(|h| **h > low && **h <= high).count() as f64;
        let object = count(band, OBJECT_TOP) >= OBJECT_SHARE * count(below, band);
        let top = if object { contact_band.min(band) } else { band };
        for (&i, h) in members(c).iter().zip(&heights) {
            flags[i as usize] = *h <= top && *h >= below;
        }
    }
    flags
}

/// The lowest of the points; ties by x, then y, so that the order of the points does not matter.
fn low(points: &[[f32; 3]], members: &[u32]) -> [f64; 3] {
    let mut low = [f32::INFINITY; 3];
    for &i in members {
        let [x, y, z] = points[i as usize];
        if (z, x, y) < (low[2], low[0], low[1]) {
            low = [x, y, z];
        }
    }
    low.map(f64::from)
}

#[cfg(test)]
mod tests;

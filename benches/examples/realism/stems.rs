//! Stems at breast height: circles through clusters of a thin slice.

use esm_core::segment::euclidean_clusters;
use nalgebra::{Matrix3, Vector3};

/// The slice, metres above the ground.
pub(crate) const SLICE_M: std::ops::Range<f64> = 1.0..1.6;
/// Gap between the points of one stem, metres.
const TOLERANCE_M: f32 = 0.15;
const FEWEST: usize = 15;

/// A stem, metres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stem {
    pub(crate) x: f64,
    pub(crate) y: f64,
    pub(crate) diameter: f64,
}

/// Clusters of the slice that are round: what remains is mostly undergrowth. Stems that touch it are missed, on both sides of
/// a comparison alike.
pub(crate) fn stems(slice: &[[f32; 3]]) -> Vec<Stem> {
    euclidean_clusters(slice, TOLERANCE_M, FEWEST, slice.len().max(FEWEST))
        .into_iter()
        .filter_map(|cluster| {
            let points: Vec<[f64; 2]> = cluster
                .into_iter()
                .map(|i| [f64::from(slice[i as usize][0]), f64::from(slice[i as usize][1])])
                .collect();
            circle(&points)
        })
        .collect()
}

/// The circle of least squares (Kasa, "A circle fitting procedure and its error analysis", 1976); `None` where points stray
/// from it or see less than a third of it.
fn circle(points: &[[f64; 2]]) -> Option<Stem> {
    let n = points.len() as f64;
    let (mx, my) =
        (points.iter().map(|p| p[0]).sum::<f64>() / n, points.iter().map(|p| p[1]).sum::<f64>() / n);
    let (mut a, mut b) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    for p in points {
        let row = Vector3::new(p[0] - mx, p[1] - my, 1.0);
        a += row * row.transpose();
        b += row * (row.x * row.x + row.y * row.y);
    }
    let solved = a.lu().solve(&b)?;
    let (cx, cy) = (0.5 * solved.x, 0.5 * solved.y);
    let radius = (solved.z + cx * cx + cy * cy).max(0.0).sqrt();
    let off: f64 =
        points.iter().map(|p| ((p[0] - mx - cx).hypot(p[1] - my - cy) - radius).powi(2)).sum::<f64>() / n;
    let mut seen = [false; 12];
    for p in points {
        let turn = (p[1] - my - cy).atan2(p[0] - mx - cx) / std::f64::consts::TAU + 0.5;
        seen[((turn * 12.0) as usize).min(11)] = true;
    }
    let round = off.sqrt() < (0.25 * radius).min(0.04) && seen.iter().filter(|s| **s).count() >= 4;
    ((0.03..0.6).contains(&radius) && round).then_some(Stem {
        x: mx + cx,
        y: my + cy,
        diameter: 2.0 * radius,
    })
}

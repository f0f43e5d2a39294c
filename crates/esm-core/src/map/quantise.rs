//! Points to 16 bits an axis and back: 6 bytes a point instead of 12, within half a quantum.

use super::problem::Problem;
use super::records::PointRun;
use crate::error::Error;

/// Finest step, metres: a quarter of the range noise of the best LiDAR in use (about 2 cm). A run wider than
/// 65,535 steps (327 m) gets the step that just spans it.
pub const QUANTUM_M: f32 = 0.005;

/// Farthest a coordinate may lie from the map's origin, metres. f32 resolves 6 cm there; a map is meant to be far
/// smaller, and the bound keeps all later arithmetic finite.
pub(super) const MAX_COORDINATE_M: f32 = 1.0e6;

/// Coarsest step that a run inside the bound can need, with room for rounding.
pub(super) const MAX_QUANTUM_M: f32 = 2.0 * MAX_COORDINATE_M / 65_535.0 * 1.001;

/// Appends `points` (metres, relative to the map's origin) to `store` and returns the run that finds them again.
pub(super) fn encode(points: &[[f32; 3]], store: &mut Vec<[u16; 3]>) -> Result<PointRun, Error> {
    let data_error = |what: String| Problem::invalid(what).in_data();
    let first = *points.first().ok_or_else(|| data_error("a run of points holds none".into()))?;
    let len = u32::try_from(points.len())
        .map_err(|_| data_error(format!("a run holds {} points", points.len())))?;
    let (mut min, mut max) = (first, first);
    for (index, p) in points.iter().enumerate() {
        if !p.iter().all(|v| v.is_finite()) {
            return Err(Error::NonFinitePoint { index });
        }
        if p.iter().any(|v| v.abs() > MAX_COORDINATE_M) {
            return Err(Error::MapData {
                what: format!(
                    "point {index} of a run lies at {p:?}, more than {MAX_COORDINATE_M} m from the origin"
                ),
                hint: "choose the map's origin near its points",
            });
        }
        for a in 0..3 {
            min[a] = min[a].min(p[a]);
            max[a] = max[a].max(p[a]);
        }
    }
    let extent = (0..3).map(|a| max[a] - min[a]).fold(0.0, f32::max);
    let quantum = QUANTUM_M.max(extent / 65_535.0);
    let start = store.len() as u64;
    // In f64: the quotient of an f32 difference may miss the nearest step. The cast saturates at 65,535.
    let step = |v: f32, low: f32| ((v as f64 - low as f64) / quantum as f64).round() as u16;
    store.extend(points.iter().map(|p| [step(p[0], min[0]), step(p[1], min[1]), step(p[2], min[2])]));
    Ok(PointRun { start, len, quantum, min, reserved: 0 })
}

/// Replaces `points` by the decoded ones, metres, relative to the map's origin.
pub(super) fn decode(run: &PointRun, stored: &[[u16; 3]], points: &mut Vec<[f32; 3]>) {
    points.clear();
    let value = |q: u16, low: f32| (low as f64 + run.quantum as f64 * q as f64) as f32;
    points.extend(
        stored.iter().map(|q| [value(q[0], run.min[0]), value(q[1], run.min[1]), value(q[2], run.min[2])]),
    );
}

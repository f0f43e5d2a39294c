//! Smooth random fields over the plane: value noise with quintic blending (Perlin, "Improving noise", 2002).

use crate::hash::Key;

/// A field in [-1, 1] that varies over about one unit of its arguments.
pub(crate) fn value(key: Key, x: f64, y: f64) -> f64 {
    let (x0, y0) = (x.floor(), y.floor());
    let fade = |t: f64| t * t * t * (t * (t * 6.0 - 15.0) + 10.0);
    let (u, v) = (fade(x - x0), fade(y - y0));
    let at = |i: i64, j: i64| f64::from(key.cell(x0 as i64 + i, y0 as i64 + j).unit()) * 2.0 - 1.0;
    let low = at(0, 0) * (1.0 - u) + at(1, 0) * u;
    let high = at(0, 1) * (1.0 - u) + at(1, 1) * u;
    low * (1.0 - v) + high * v
}

/// Hermite step from 0 at `a` to 1 at `b`.
pub(crate) fn smoothstep(a: f64, b: f64, x: f64) -> f64 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

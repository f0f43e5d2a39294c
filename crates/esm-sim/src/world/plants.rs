//! What grows and lies below the trees: bushes, ferns, saplings, logs, stumps, boulders, hedges.

use nalgebra::Vector3;

use super::visit::Season;
use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

fn around(draw: &mut Draw) -> V {
    let turn = draw.range(0.0, std::f32::consts::TAU);
    V::new(turn.cos(), turn.sin(), 0.0)
}

/// A bush of several interleaved shrubs: stems that lean out of the middle, and along them sprays of foliage that are long
/// rather than round, so that no ball shows and shoots stick out.
pub(super) fn bush(size: f32, evergreen: bool, season: Season, draw: &mut Draw) -> Vec<Shape> {
    let leaf = if evergreen { 1.0 } else { 0.25 + 0.75 * season.broadleaf() };
    let density = draw.range(1.5, 4.0) * leaf;
    let (stems, squat) = (draw.count(3, 6), draw.range(0.55, 1.0));
    let mut shapes = Vec::new();
    for n in 0..stems {
        let foot = around(draw) * (0.45 * size * draw.unit());
        let height = size * draw.range(0.55, 1.3);
        let lean = around(draw) * (size * draw.range(0.1, 0.7));
        let tip = foot + lean + V::z() * (height * squat);
        if n < 3 {
            shapes.push(Shape::frustum(foot - V::z() * 0.2, tip, draw.range(0.008, 0.025), 0.004));
        }
        for _ in 0..draw.count(2, 3) {
            let t = draw.range(0.25, 1.0);
            let at = foot + (tip - foot) * t + around(draw) * (0.22 * size * draw.unit());
            let shoot =
                (tip - foot).normalize() + V::new(draw.normal(), draw.normal(), 0.6 * draw.normal()) * 0.6;
            let long = size * draw.range(0.22, 0.46);
            shapes.push(Shape::clump(
                at,
                shoot,
                long,
                long * draw.range(0.35, 0.7),
                density * draw.range(0.6, 1.5),
            ));
        }
    }
    shapes
}

/// A young conifer in the shade of others: whorls of branches that stick out, ragged and thin.
pub(super) fn young_conifer(draw: &mut Draw) -> Vec<Shape> {
    let height = draw.range(1.0, 4.5);
    let tip = V::new(0.05 * draw.normal(), 0.05 * draw.normal(), 1.0) * height;
    let mut shapes = vec![Shape::frustum(-V::z() * 0.1, tip, 0.012 * height + 0.006, 0.004)];
    let (wide, density) = (height * draw.range(0.18, 0.32), draw.range(1.2, 2.6));
    for n in 0..draw.count(7, 12) {
        let t = 0.1 + 0.085 * n as f32 * draw.range(0.85, 1.15);
        let reach = wide * (1.05 - t).max(0.15) * draw.range(0.6, 1.3);
        let out = around(draw) + V::z() * draw.range(-0.3, 0.2);
        let at = tip * t.min(1.0) + out * (0.55 * reach);
        shapes.push(Shape::clump(at, out, 0.6 * reach + 0.05, 0.3 * reach + 0.06, density));
    }
    shapes
}

/// A patch of ferns, nettles or brambles.
pub(super) fn undergrowth(size: f32, season: Season, draw: &mut Draw) -> Vec<Shape> {
    let stand = season.ground_layer();
    (0..draw.count(1, 4))
        .map(|_| {
            let (out, height) =
                (around(draw) * (size * 0.6 * draw.unit()), draw.range(0.2, 0.6) * (0.4 + 0.6 * stand));
            let up = V::new(0.1 * draw.normal(), 0.1 * draw.normal(), 1.0);
            let width = size * draw.range(0.35, 0.6);
            Shape::clump(out + V::z() * (0.3 * height), up, 0.7 * height, width, draw.range(0.8, 2.2) * stand)
        })
        .collect()
}

/// A fallen stem with stubs of branches and, at times, its upturned roots.
pub(super) fn log(draw: &mut Draw) -> Vec<Shape> {
    let (length, radius) = (draw.range(2.0, 9.0), draw.range(0.09, 0.28));
    let (along, tilt) = (around(draw), draw.range(-0.08, 0.08));
    let a = along * (-0.5 * length) + V::z() * (radius * 0.8);
    let b = along * (0.5 * length) + V::z() * (radius * 0.6 + tilt * length);
    let middle = (a + b) * 0.5 + V::z() * draw.range(-0.05, 0.1);
    let mut shapes = vec![
        Shape::frustum(a, middle, radius, 0.8 * radius),
        Shape::frustum(middle, b, 0.8 * radius, 0.5 * radius),
    ];
    for _ in 0..draw.count(1, 6) {
        let foot = a + (b - a) * draw.range(0.3, 1.0);
        let tip = foot + (around(draw) + V::z() * draw.range(0.2, 1.3)) * draw.range(0.2, 0.9);
        shapes.push(Shape::frustum(foot, tip, 0.2 * radius, 0.01));
    }
    if draw.chance(0.3) {
        shapes.push(Shape::spheroid(a + V::z() * radius, along, 0.25, draw.range(0.5, 1.0)));
    }
    shapes
}

/// A stump, cut or broken.
pub(super) fn stump(draw: &mut Draw) -> Vec<Shape> {
    let (radius, height) = (draw.range(0.12, 0.4), draw.range(0.2, 0.9));
    let mut shapes = vec![
        Shape::frustum(-V::z() * 0.3, V::z() * 0.1, 1.5 * radius, 1.15 * radius),
        Shape::frustum(V::z() * 0.08, V::z() * height, 1.12 * radius, radius),
    ];
    for _ in 0..draw.count(2, 5) {
        let out = around(draw);
        shapes.push(Shape::frustum(
            V::z() * 0.15,
            out * (2.0 * radius) - V::z() * 0.05,
            0.35 * radius,
            0.1 * radius,
        ));
    }
    if draw.chance(0.35) {
        let splinter = around(draw) * (0.5 * radius);
        shapes.push(Shape::frustum(
            splinter + V::z() * (height - 0.05),
            splinter + V::z() * (1.6 * height),
            0.4 * radius,
            0.02,
        ));
    }
    shapes
}

/// A young tree: a whip with a little foliage.
pub(super) fn sapling(season: Season, draw: &mut Draw) -> Vec<Shape> {
    let height = draw.range(1.2, 4.0);
    let tip = V::new(0.12 * draw.normal(), 0.12 * draw.normal(), 1.0) * height;
    let mut shapes = vec![Shape::frustum(-V::z() * 0.1, tip, 0.012 * height.sqrt() + 0.004, 0.004)];
    let density = (0.3 + 0.7 * season.broadleaf()) * 1.3;
    for _ in 0..draw.count(2, 5) {
        let at = tip * draw.range(0.4, 1.0) + around(draw) * (0.12 * height);
        shapes.push(Shape::clump(at, V::z(), 0.13 * height, 0.16 * height, density));
    }
    shapes
}

/// A boulder, partly in the ground.
pub(super) fn rock(draw: &mut Draw) -> Vec<Shape> {
    let size = draw.range(0.2, 0.7);
    (0..draw.count(1, 3))
        .map(|_| {
            let at = around(draw) * (0.4 * size) + V::z() * (0.15 * size);
            let axis = V::new(draw.normal(), draw.normal(), 0.6 * draw.normal());
            Shape::spheroid(at, axis, size * draw.range(0.6, 1.0), size * draw.range(0.4, 0.7))
        })
        .collect()
}

/// A hedge from the anchor along `yaw`: a thin core with stems, and shoots of unlike size that make its faces rough; clipped
/// ones less so than those that grow as they like. Here and there one has died and leaves a gap.
pub(super) fn hedge(
    length: f32,
    yaw: f32,
    height: f32,
    width: f32,
    growth: f32,
    draw: &mut Draw,
) -> Vec<Shape> {
    let (along, across) = (V::new(yaw.cos(), yaw.sin(), 0.0), V::new(-yaw.sin(), yaw.cos(), 0.0));
    let wild = draw.range(0.08, 0.4);
    let density = draw.range(2.0, 5.0);
    let mut shapes = Vec::new();
    let mut s = 0.0;
    while s < length {
        let piece = draw.range(0.5, 1.1).min(length - s).max(0.2);
        let thin = draw.chance(0.06);
        let h = height * growth * (1.0 + wild * draw.range(-0.5, 0.5)) * if thin { 0.45 } else { 1.0 };
        let w = 0.5 * width * draw.range(0.8, 1.2);
        let foot = along * (s + 0.5 * piece) + across * (wild * draw.range(-0.4, 0.4));
        let core = V::new(0.5 * piece + 0.05, 0.5 * w, 0.42 * h);
        shapes.push(Shape::hedge(foot + V::z() * (0.44 * h), core, yaw, density));
        for _ in 0..draw.count(2, 4) {
            let up = draw.range(0.15, 0.95);
            let at = foot
                + along * (piece * draw.range(-0.5, 0.5))
                + across * (w * draw.range(-0.75, 0.75))
                + V::z() * (h * up);
            let axis = V::new(draw.normal(), draw.normal(), 1.0 + draw.unit());
            let size = draw.range(0.18, 0.36) * (0.6 + wild + 0.4 * h) * growth;
            shapes.push(Shape::clump(at, axis, 1.25 * size, 0.8 * size, density * draw.range(0.7, 1.6)));
        }
        s += piece;
    }
    shapes
}

/// A conifer of gardens: a column or a cone, green from the ground up.
pub(super) fn column(height: f32, draw: &mut Draw) -> Vec<Shape> {
    let wide = height * draw.range(0.11, 0.24);
    let cone = draw.unit();
    let lean = V::new(0.04 * draw.normal(), 0.04 * draw.normal(), 1.0);
    let mut shapes = vec![Shape::frustum(-V::z() * 0.2, lean * (0.8 * height), 0.07, 0.02)];
    let tiers = draw.count(4, 8);
    for n in 0..tiers {
        let t = (n as f32 + 0.5) / tiers as f32;
        let r =
            wide * (1.0 - cone * 0.85 * t) * draw.range(0.8, 1.2) * if n + 1 == tiers { 0.7 } else { 1.0 };
        let at = lean * (height * t) + around(draw) * (0.3 * r * draw.unit());
        shapes.push(Shape::clump(at, V::z(), 0.85 * height / tiers as f32, r, draw.range(2.0, 4.5)));
    }
    shapes
}

/// Flowers, tubs, ornamental grass: knee-high things of gardens.
pub(super) fn tuft(draw: &mut Draw) -> Vec<Shape> {
    let (wide, height) = (draw.range(0.2, 0.5), draw.range(0.3, 0.9));
    let mut shapes = Vec::new();
    if draw.chance(0.3) {
        shapes.push(Shape::frustum(V::zeros(), V::z() * (0.5 * height), 0.6 * wide, 0.8 * wide));
    }
    for _ in 0..draw.count(1, 3) {
        let at = around(draw) * (0.4 * wide * draw.unit()) + V::z() * (0.6 * height);
        shapes.push(Shape::clump(at, V::z(), 0.5 * height, wide, draw.range(1.5, 4.0)));
    }
    shapes
}

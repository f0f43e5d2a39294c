//! What towns and parks put up: poles, signs, bins, benches, statues, walls, fences, people.

use nalgebra::Vector3;

use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

fn dir(yaw: f32) -> V {
    V::new(yaw.cos(), yaw.sin(), 0.0)
}

/// A street lamp; `yaw` points over the road.
pub(super) fn lamp(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let (height, lean) = (draw.range(4.5, 8.5), V::new(draw.normal(), draw.normal(), 0.0) * 0.008);
    let top = V::z() * height + lean * height;
    let mut shapes = vec![
        Shape::frustum(-V::z() * 0.2, V::z() * 1.1, 0.11, 0.1),
        Shape::frustum(V::z(), top, 0.07, 0.045),
    ];
    if height > 6.0 {
        let arm = top + dir(yaw) * draw.range(0.8, 1.8) + V::z() * 0.3;
        shapes.push(Shape::frustum(top, arm, 0.035, 0.03));
        shapes.push(Shape::cuboid(arm, V::new(0.3, 0.12, 0.06), yaw));
    } else {
        shapes.push(Shape::frustum(top, top + V::z() * 0.45, 0.12, 0.22));
    }
    shapes
}

/// A traffic sign, its face along `yaw`.
pub(super) fn sign(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let height = draw.range(2.2, 3.0);
    let tilt = yaw + 0.15 * draw.normal();
    let mut shapes = vec![Shape::frustum(-V::z() * 0.1, V::z() * height, 0.035, 0.035)];
    for n in 0..draw.count(1, 2) {
        let half = V::new(0.012, draw.range(0.22, 0.4), draw.range(0.2, 0.35));
        shapes.push(Shape::cuboid(V::z() * (height - 0.3 - 0.7 * n as f32) + dir(tilt) * 0.05, half, tilt));
    }
    shapes
}

/// A cabinet of the power or telephone company, its doors to `yaw`.
pub(super) fn cabinet(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let half = V::new(draw.range(0.13, 0.25), draw.range(0.3, 0.8), draw.range(0.4, 0.75));
    let lid = V::new(half.x + 0.03, half.y + 0.03, 0.03);
    let mut shapes =
        vec![Shape::cuboid(V::z() * half.z, half, yaw), Shape::cuboid(V::z() * (2.0 * half.z), lid, yaw)];
    if draw.chance(0.3) {
        let side = dir(yaw + std::f32::consts::FRAC_PI_2) * (half.y + 0.35);
        shapes.push(Shape::cuboid(side + V::z() * (0.8 * half.z), half * 0.8, yaw));
    }
    shapes
}

/// A bollard or a short post.
pub(super) fn bollard(draw: &mut Draw) -> Vec<Shape> {
    let (height, radius) = (draw.range(0.7, 1.1), draw.range(0.045, 0.11));
    vec![
        Shape::frustum(-V::z() * 0.1, V::z() * height, radius, 0.9 * radius),
        Shape::spheroid(V::z() * height, V::z(), 0.6 * radius, 1.1 * radius),
    ]
}

/// A wheeled bin.
pub(super) fn bin(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let (w, h) = (draw.range(0.24, 0.34), draw.range(0.9, 1.1));
    vec![
        Shape::cuboid(V::z() * (0.5 * h), V::new(w, w * 1.1, 0.5 * h - 0.03), yaw),
        Shape::cuboid(V::z() * h - dir(yaw) * 0.03, V::new(w + 0.04, w * 1.1 + 0.03, 0.04), yaw),
        Shape::cuboid(V::z() * (h - 0.05) + dir(yaw) * (w + 0.07), V::new(0.03, w, 0.03), yaw),
    ]
}

/// A bench, open to `yaw`.
pub(super) fn bench(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let half = draw.range(0.7, 1.0);
    let (f, s) = (dir(yaw), dir(yaw + std::f32::consts::FRAC_PI_2));
    let mut shapes = vec![
        Shape::cuboid(V::z() * 0.44, V::new(0.2, half, 0.025), yaw),
        Shape::cuboid(V::z() * 0.7 - f * 0.24, V::new(0.03, half, 0.09), yaw),
        Shape::cuboid(V::z() * 0.9 - f * 0.27, V::new(0.03, half, 0.06), yaw),
    ];
    for side in [-1.0, 1.0] {
        let at = s * (side * (half - 0.12));
        shapes.push(Shape::cuboid(at + V::z() * 0.2 + f * 0.12, V::new(0.04, 0.04, 0.25), yaw));
        shapes.push(Shape::cuboid(at + V::z() * 0.45 - f * 0.24, V::new(0.04, 0.04, 0.5), yaw));
    }
    shapes
}

/// A figure on a pedestal with steps.
pub(super) fn statue(yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let (w, h) = (draw.range(0.6, 1.1), draw.range(1.6, 3.2));
    let mut shapes = vec![
        Shape::cuboid(V::z() * 0.1, V::new(2.0 * w, 2.0 * w, 0.25), yaw),
        Shape::cuboid(V::z() * 0.35, V::new(1.5 * w, 1.5 * w, 0.25), yaw),
        Shape::cuboid(V::z() * (0.5 * h + 0.5), V::new(w, w, 0.5 * h), yaw),
        Shape::cuboid(V::z() * (h + 0.55), V::new(1.15 * w, 1.15 * w, 0.1), yaw),
    ];
    let scale = draw.range(1.1, 1.6);
    shapes.extend(person(yaw, scale, draw).into_iter().map(|s| s.moved(V::z() * (h + 0.6))));
    shapes
}

/// A person, 1.75 m times `scale`.
pub(super) fn person(yaw: f32, scale: f32, draw: &mut Draw) -> Vec<Shape> {
    striding(yaw, scale, draw.range(-0.3, 0.3))
}

/// The same in the middle of a step of so many metres.
pub(crate) fn striding(yaw: f32, scale: f32, step: f32) -> Vec<Shape> {
    let (f, s) = (dir(yaw), dir(yaw + std::f32::consts::FRAC_PI_2));
    let p = |z: f32| V::z() * (z * scale);
    vec![
        Shape::frustum(
            f * (step * scale) + s * 0.1 * scale,
            p(0.85) + s * (0.09 * scale),
            0.06 * scale,
            0.09 * scale,
        ),
        Shape::frustum(
            f * (-step * scale) - s * 0.1 * scale,
            p(0.85) - s * (0.09 * scale),
            0.06 * scale,
            0.09 * scale,
        ),
        Shape::spheroid(p(1.15), V::z(), 0.38 * scale, 0.21 * scale),
        Shape::spheroid(p(1.64), V::z(), 0.13 * scale, 0.1 * scale),
        Shape::frustum(
            p(1.4) + s * (0.22 * scale),
            p(0.85) + (s * 0.27 + f * step) * scale,
            0.05 * scale,
            0.04 * scale,
        ),
        Shape::frustum(
            p(1.4) - s * (0.22 * scale),
            p(0.85) - (s * 0.27 + f * step) * scale,
            0.05 * scale,
            0.04 * scale,
        ),
    ]
}

/// A garden wall from the anchor along `yaw`, with piers and a coping.
pub(super) fn wall(length: f32, yaw: f32, height: f32, draw: &mut Draw) -> Vec<Shape> {
    let along = dir(yaw);
    let thick = draw.range(0.1, 0.2);
    let middle = along * (0.5 * length);
    let mut shapes = vec![
        Shape::cuboid(
            middle + V::z() * (0.5 * height - 0.15),
            V::new(0.5 * length, thick, 0.5 * height + 0.15),
            yaw,
        ),
        Shape::cuboid(middle + V::z() * (height + 0.04), V::new(0.5 * length, thick + 0.04, 0.04), yaw),
    ];
    let piers = (length / draw.range(2.5, 5.0)).max(1.0) as usize;
    for n in 0..=piers {
        let at = along * (length * n as f32 / piers as f32);
        let tall = height + draw.range(0.1, 0.3);
        shapes.push(Shape::cuboid(
            at + V::z() * (0.5 * tall - 0.1),
            V::new(0.2, thick + 0.09, 0.5 * tall + 0.1),
            yaw,
        ));
    }
    shapes
}

/// A fence of posts, rails and pales from the anchor along `yaw`; pales leave gaps.
pub(super) fn fence(length: f32, yaw: f32, height: f32, draw: &mut Draw) -> Vec<Shape> {
    let along = dir(yaw);
    let mut shapes = Vec::new();
    let solid = draw.chance(0.4);
    let gap = if solid { 0.12 } else { draw.range(0.14, 0.24) };
    let pales = (length / gap) as usize;
    for n in 0..=pales {
        let h = height * draw.range(0.96, 1.03);
        let at = along * (n as f32 * gap) + V::z() * (0.5 * h);
        shapes.push(Shape::cuboid(at, V::new(if solid { 0.055 } else { 0.04 }, 0.012, 0.5 * h), yaw));
    }
    for z in [0.25, 0.8] {
        let half = V::new(0.5 * length, 0.02, 0.03);
        shapes.push(Shape::cuboid(along * (0.5 * length) + V::z() * (z * height), half, yaw));
    }
    for n in 0..=(length / 2.2) as usize {
        shapes.push(Shape::cuboid(
            along * (n as f32 * 2.2) + V::z() * (0.5 * height),
            V::new(0.05, 0.05, 0.54 * height),
            yaw,
        ));
    }
    shapes
}

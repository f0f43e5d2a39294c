//! Cars and vans: bodies of boxes, slanted glass, wheels.

use nalgebra::{Rotation3, Vector3};

use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

/// A car (or a van) about its middle on the ground, its nose along `yaw`. The side profile is drawn as a polygon and made
/// of slanted panels, so that bonnet, windscreen and boot show.
pub(crate) fn vehicle(van: bool, yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let turn = Rotation3::from_axis_angle(&V::z_axis(), yaw);
    let (length, width) = if van {
        (draw.range(4.6, 6.0), draw.range(1.85, 2.05))
    } else {
        (draw.range(3.6, 4.9), draw.range(1.65, 1.85))
    };
    let roof = if van { draw.range(1.9, 2.6) } else { draw.range(1.38, 1.72) };
    let (l, w) = (0.5 * length, 0.5 * width);
    let sill = draw.range(0.22, 0.32);
    let bonnet = if van { draw.range(1.0, 1.25) } else { draw.range(0.78, 0.95) };
    let screen = if van { l - draw.range(0.6, 1.0) } else { l - draw.range(0.9, 1.25) };
    let roof_front = screen - draw.range(0.45, 0.8);
    let hatch = draw.chance(0.55);
    let roof_back = if van || hatch { -l + draw.range(0.1, 0.4) } else { -l + draw.range(0.9, 1.3) };
    let waist = if van { roof - 0.1 } else { bonnet + draw.range(0.05, 0.15) };
    let boot = if van || hatch { -l + 0.05 } else { -l + draw.range(0.35, 0.55) };
    // Upper outline from nose to tail: forward, up, half width.
    let inset = if van { 0.97 } else { draw.range(0.8, 0.88) };
    let outline = [
        (l, sill + 0.15, 0.93 * w),
        (l - 0.06, bonnet - 0.15, 0.97 * w),
        (screen, bonnet, w),
        (roof_front, roof - 0.03, inset * w),
        (roof_back, roof, inset * w),
        (boot, waist, 0.98 * w),
        (-l, waist - 0.15, 0.97 * w),
        (-l, sill + 0.15, 0.94 * w),
    ];
    let mut shapes = Vec::new();
    let p = |x: f32, y: f32, z: f32| turn * V::new(x, y, z);
    for pair in outline.windows(2) {
        let ((x0, z0, w0), (x1, z1, w1)) = (pair[0], pair[1]);
        let (a, b, c, d) = (p(x0, w0, z0), p(x0, -w0, z0), p(x1, w1, z1), p(x1, -w1, z1));
        shapes.push(Shape::triangle(a, b, c));
        shapes.push(Shape::triangle(b, d, c));
        // The flanks, down to the sill.
        for side in [-1.0, 1.0] {
            let (e, f) = (p(x0, side * w0, z0), p(x1, side * w1, z1));
            let (g, h) = (p(x0, side * 0.97 * w, sill), p(x1, side * 0.97 * w, sill));
            shapes.push(Shape::triangle(e, f, g));
            shapes.push(Shape::triangle(f, h, g));
        }
    }
    let radius = if van { draw.range(0.32, 0.36) } else { draw.range(0.29, 0.34) };
    for (x, side) in [(0.62 * l, -1.0), (0.62 * l, 1.0), (-0.6 * l, -1.0), (-0.6 * l, 1.0)] {
        shapes.push(Shape::frustum(
            p(x, side * (w - 0.22), radius),
            p(x, side * (w + 0.01), radius),
            radius,
            radius,
        ));
    }
    for side in [-1.0, 1.0] {
        let mirror = p(screen - 0.25, side * (w + 0.1), bonnet + 0.15);
        shapes.push(Shape::cuboid(mirror, V::new(0.06, 0.1, 0.07), yaw));
    }
    // The floor, seen through between the wheels.
    shapes.push(Shape::cuboid(p(0.0, 0.0, sill), V::new(0.97 * l, 0.85 * w, 0.05), yaw));
    shapes
}

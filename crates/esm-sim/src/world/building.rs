//! Houses with relief: recessed windows and doors, bays, steps, sills, gutters, downpipes, chimneys, pitched roofs.

use nalgebra::{Rotation3, Vector3};

use super::visit::Season;
use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

/// Thickness of the front wall, which is how deep windows lie, metres.
const RELIEF: f32 = 0.16;

/// Walls, and the glass in them.
pub(super) struct House {
    pub(super) walls: Vec<Shape>,
    pub(super) glass: Vec<Shape>,
}

impl House {
    /// Both as one, the other one shifted.
    pub(super) fn joined(mut self, other: Self, by: V) -> Self {
        self.walls.extend(other.walls.iter().map(|s| s.moved(by)));
        self.glass.extend(other.glass.iter().map(|s| s.moved(by)));
        self
    }
}

/// Pieces in the house's own frame: x out to the street, y along the facade, z up.
struct Builder {
    turn: Rotation3<f32>,
    yaw: f32,
    walls: Vec<Shape>,
    glass: Vec<Shape>,
}

impl Builder {
    fn cuboid(&self, low: V, high: V) -> Shape {
        Shape::cuboid(self.turn * ((low + high) * 0.5), (high - low) * 0.5, self.yaw)
    }

    fn wall(&mut self, low: [f32; 3], high: [f32; 3]) {
        let shape = self.cuboid(low.into(), high.into());
        self.walls.push(shape);
    }

    fn pane(&mut self, low: [f32; 3], high: [f32; 3]) {
        let shape = self.cuboid(low.into(), high.into());
        self.glass.push(shape);
    }

    fn quad(&mut self, a: [f32; 3], b: [f32; 3], c: [f32; 3], d: [f32; 3]) {
        let [a, b, c, d] = [a, b, c, d].map(|p| self.turn * V::from(p));
        self.walls.push(Shape::triangle(a, b, c));
        self.walls.push(Shape::triangle(a, c, d));
    }

    fn pipe(&mut self, a: [f32; 3], b: [f32; 3], radius: f32) {
        self.walls.push(Shape::frustum(self.turn * V::from(a), self.turn * V::from(b), radius, radius));
    }
}

/// A house whose anchor is the middle of its front at the ground; `yaw` points from the front to the street.
pub(super) fn house(width: f32, depth: f32, floors: usize, yaw: f32, draw: &mut Draw) -> House {
    let turn = Rotation3::from_axis_angle(&V::z_axis(), yaw);
    let mut b = Builder { turn, yaw, walls: Vec::new(), glass: Vec::new() };
    let half = 0.5 * width;
    let storey = draw.range(2.6, 3.4);
    let plinth = draw.range(0.1, 0.7);
    let eaves = plinth + storey * floors as f32;
    // The body, its front set back by the relief.
    b.wall([-depth, -half, -1.5], [-RELIEF, half, eaves]);
    b.wall([-RELIEF, -half, -1.5], [0.04, half, plinth]);
    facade(&mut b, half, plinth, storey, floors, draw);
    roof(&mut b, half, depth, eaves, draw);
    // Gutter and downpipes.
    b.pipe([0.22, -half, eaves - 0.06], [0.22, half, eaves - 0.06], 0.06);
    for side in [-1.0, 1.0] {
        if draw.chance(0.7) {
            let y = side * (half - draw.range(0.1, 0.3));
            b.pipe([0.08, y, 0.0], [0.08, y, eaves - 0.1], 0.045);
        }
    }
    // A lower wing or garage behind or beside.
    if draw.chance(0.4) {
        let (w, d, h) = (draw.range(2.2, 3.6), draw.range(2.5, 5.0), draw.range(2.2, 3.0));
        let y = draw.range(-half + 0.5, half - w);
        b.wall([-depth - d, y, -1.5], [-depth, y + w, h]);
    }
    House { walls: b.walls, glass: b.glass }
}

/// The front: axes of windows shared by the floors, one of them with the door, some with a bay.
fn facade(b: &mut Builder, half: f32, plinth: f32, storey: f32, floors: usize, draw: &mut Draw) {
    let axes = ((2.0 * half) / draw.range(2.3, 3.4)).floor().max(1.0) as usize;
    let pitch = 2.0 * half / axes as f32;
    let window = (draw.range(0.8, 1.35)).min(pitch - 0.5).max(0.4);
    let (sill, head) = (draw.range(0.6, 0.95), draw.range(0.25, 0.5));
    let door = draw.index(axes);
    let bay = (draw.chance(0.45) && axes > 1).then(|| (door + 1 + draw.index(axes - 1)) % axes);
    let bay_floors = draw.count(1, floors.min(2));
    let ledges = draw.chance(0.7);
    let shutters = if draw.chance(0.35) { 0.45 * window } else { 0.0 };
    let balcony = draw.chance(0.35).then(|| draw.index(axes));
    for floor in 0..floors {
        let base = plinth + storey * floor as f32;
        let mut left = -half;
        for axis in 0..axes {
            let middle = -half + pitch * (axis as f32 + 0.5);
            let is_door = floor == 0 && axis == door;
            let wide = if is_door { 1.0f32.min(pitch - 0.3) } else { window };
            let (low, high) = (middle - 0.5 * wide, middle + 0.5 * wide);
            let (z0, z1) = if is_door { (base, base + 2.15) } else { (base + sill, base + storey - head) };
            // The pier before it, and the wall below and above.
            b.wall([-RELIEF, left, base], [0.0, low, base + storey]);
            if z0 > base {
                b.wall([-RELIEF, low, base], [0.0, high, z0]);
            }
            b.wall([-RELIEF, low, z1], [0.0, high, base + storey]);
            left = high;
            if bay == Some(axis) && floor < bay_floors {
                bay_window(b, middle, 0.5 * pitch - 0.1, base, storey, draw);
                continue;
            }
            if is_door {
                entrance(b, middle, wide, plinth, z1, draw);
                continue;
            }
            if floor > 0 && balcony == Some(axis) {
                platform(b, middle, 0.5 * pitch.min(3.0) + 0.3, base, draw);
            }
            b.pane([-RELIEF - 0.01, low, z0], [-RELIEF + 0.02, high, z1]);
            // Frame, glazing bars, sill.
            b.wall([-RELIEF, low, z0], [-RELIEF + 0.06, low + 0.06, z1]);
            b.wall([-RELIEF, high - 0.06, z0], [-RELIEF + 0.06, high, z1]);
            let bar = 0.5 * (z0 + z1);
            b.wall([-RELIEF, low, bar - 0.03], [-RELIEF + 0.05, high, bar + 0.03]);
            for side in [-1.0, 1.0] {
                // Folded back against the wall, not quite.
                let y = middle + side * (0.5 * (wide + shutters) + 0.03);
                if shutters > 0.0 && z0 > base {
                    b.wall([0.0, y - 0.5 * shutters, z0], [draw.range(0.04, 0.14), y + 0.5 * shutters, z1]);
                }
            }
            if ledges {
                b.wall([0.0, low - 0.08, z0 - 0.08], [0.1, high + 0.08, z0]);
                b.wall([0.0, low - 0.1, z1], [0.04, high + 0.1, z1 + 0.18]);
            }
        }
        b.wall([-RELIEF, left, base], [0.0, half, base + storey]);
        if ledges && floor > 0 {
            b.wall([0.0, -half, base - 0.09], [0.05, half, base + 0.05]);
        }
    }
}

/// A balcony: a slab with a railing of bars or boards.
fn platform(b: &mut Builder, middle: f32, half: f32, base: f32, draw: &mut Draw) {
    let out = draw.range(0.7, 1.5);
    let (l, r) = (middle - half, middle + half);
    b.wall([0.0, l, base - 0.15], [out, r, base]);
    b.pipe([out, l, base + 0.95], [out, r, base + 0.95], 0.03);
    if draw.chance(0.5) {
        b.wall([out - 0.04, l, base + 0.05], [out, r, base + 0.85]);
    }
    for n in 0..=8 {
        let y = l + (r - l) * n as f32 / 8.0;
        b.pipe([out, y, base], [out, y, base + 0.95], 0.015);
    }
}

/// A door in its recess, with steps and at times a porch.
fn entrance(b: &mut Builder, middle: f32, wide: f32, plinth: f32, head: f32, draw: &mut Draw) {
    b.wall([-RELIEF, middle - 0.5 * wide, plinth], [-RELIEF + 0.05, middle + 0.5 * wide, head]);
    let steps = (plinth / 0.17).ceil().max(1.0) as usize;
    for n in 0..steps {
        let out = 0.3 * (steps - n) as f32;
        let top = plinth * (n + 1) as f32 / steps as f32;
        b.wall([0.0, middle - 0.5 * wide - 0.2, -0.6], [out, middle + 0.5 * wide + 0.2, top]);
    }
    if draw.chance(0.4) {
        let out = draw.range(0.5, 1.2);
        b.wall([0.0, middle - 0.5 * wide - 0.25, head + 0.1], [out, middle + 0.5 * wide + 0.25, head + 0.25]);
        if out > 0.8 {
            for side in [-1.0, 1.0] {
                let y = middle + side * (0.5 * wide + 0.15);
                b.pipe([out - 0.1, y, 0.0], [out - 0.1, y, head + 0.1], 0.06);
            }
        }
    }
}

/// A bay with slanted cheeks.
fn bay_window(b: &mut Builder, middle: f32, half: f32, base: f32, storey: f32, draw: &mut Draw) {
    let out = draw.range(0.5, 0.9);
    let front = (half - 0.55 * out).max(0.3);
    let bottom = if base < 1.0 { -0.8 } else { base };
    for (z0, z1) in [(bottom, base + 0.8), (base + storey - 0.35, base + storey)] {
        let (l, r) = (middle - half, middle + half);
        b.quad([0.0, l, z0], [out, middle - front, z0], [out, middle - front, z1], [0.0, l, z1]);
        b.quad(
            [out, middle - front, z0],
            [out, middle + front, z0],
            [out, middle + front, z1],
            [out, middle - front, z1],
        );
        b.quad([out, middle + front, z0], [0.0, r, z0], [0.0, r, z1], [out, middle + front, z1]);
        b.quad([0.0, l, z1], [out, middle - front, z1], [out, middle + front, z1], [0.0, r, z1]);
    }
    for y in [-front, front, 0.0] {
        b.wall([out - 0.07, middle + y - 0.05, base + 0.8], [out, middle + y + 0.05, base + storey - 0.35]);
    }
    b.pane([out - 0.09, middle - front, base + 0.8], [out - 0.07, middle + front, base + storey - 0.35]);
}

/// A pitched roof: its ridge along the street or across it, hipped or with gables; a chimney or two.
fn roof(b: &mut Builder, half: f32, depth: f32, eaves: f32, draw: &mut Draw) {
    let over = draw.range(0.15, 0.4);
    let (x0, x1, y0, y1) = (-depth - over, over, -half - 0.05, half + 0.05);
    let rise = draw.range(0.55, 1.0);
    let kind = draw.unit();
    let (xm, ym) = (-0.5 * depth, 0.0);
    if kind < 0.15 {
        // Flat behind a parapet.
        b.wall([-0.25, -half, eaves], [0.05, half, eaves + draw.range(0.3, 0.9)]);
    } else if kind < 0.75 {
        let top = eaves + rise * 0.5 * depth;
        let hip = if kind < 0.4 { 0.0 } else { (0.6 * half).min(0.5 * depth) };
        let (ra, rb) = ([xm, y0 + hip, top], [xm, y1 - hip, top]);
        b.quad([x1, y0, eaves], [x1, y1, eaves], rb, ra);
        b.quad([x0, y0, eaves], [x0, y1, eaves], rb, ra);
        b.quad([x0, y0, eaves], [x1, y0, eaves], ra, ra);
        b.quad([x0, y1, eaves], [x1, y1, eaves], rb, rb);
    } else {
        // The gable looks at the street.
        let top = eaves + rise * half;
        let (ra, rb) = ([0.0, ym, top], [x0, ym, top]);
        b.quad([x1, y0, eaves], ra, rb, [x0, y0, eaves]);
        b.quad([x1, y1, eaves], ra, rb, [x0, y1, eaves]);
        b.quad([0.0, y0, eaves], [0.0, y1, eaves], ra, ra);
        b.quad([x0, y0, eaves], [x0, y1, eaves], rb, rb);
    }
    for side in [-1.0, 1.0] {
        if draw.chance(0.45) {
            let (y, h) =
                (side * (half - 0.5), eaves + rise * 0.5 * depth.min(2.0 * half) + draw.range(0.4, 1.2));
            b.wall([xm - 0.5, y - 0.3, eaves], [xm + 0.4, y + 0.3, h]);
        }
    }
}

/// A garage or a shed whose anchor is the middle of its front; `yaw` points out of its door.
pub(super) fn shed(width: f32, yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let turn = Rotation3::from_axis_angle(&V::z_axis(), yaw);
    let mut b = Builder { turn, yaw, walls: Vec::new(), glass: Vec::new() };
    let (half, depth, height) = (0.5 * width, draw.range(2.2, 5.5), draw.range(2.0, 2.7));
    let door = draw.range(0.6, 0.9) * half;
    b.wall([-depth, -half, -1.0], [-0.12, half, height]);
    b.wall([-0.12, -half, -1.0], [0.0, -door, height]);
    b.wall([-0.12, door, -1.0], [0.0, half, height]);
    b.wall([-0.12, -door, 0.85 * height], [0.0, door, height]);
    let (over, rise) = (draw.range(0.1, 0.3), draw.range(0.05, 0.9));
    let (ra, rb) = ([over, 0.0, height + rise], [-depth - over, 0.0, height + rise]);
    let at = |x: f32, y: f32| [x, y * (half + over), height - 0.05];
    b.quad(at(over, -1.0), ra, rb, at(-depth - over, -1.0));
    b.quad(at(over, 1.0), ra, rb, at(-depth - over, 1.0));
    b.quad(at(over, -1.0), at(over, 1.0), ra, ra);
    b.walls
}

/// Ivy, roses or vine on a front of some width; the anchor is the house's.
pub(super) fn creeper(width: f32, yaw: f32, season: Season, draw: &mut Draw) -> Vec<Shape> {
    let turn = Rotation3::from_axis_angle(&V::z_axis(), yaw);
    let leaf = if draw.chance(0.5) { 1.0 } else { 0.3 + 0.7 * season.broadleaf() };
    let (from, height) = (width * draw.range(-0.4, 0.4), draw.range(1.2, 4.5));
    (0..draw.count(6, 16))
        .map(|_| {
            let z = height * draw.unit();
            let y = from + draw.normal() * (0.3 + 0.2 * z);
            let at = turn * V::new(draw.range(0.02, 0.15), y.clamp(-0.5 * width, 0.5 * width), z);
            let axis = turn * V::new(0.1, draw.normal(), draw.normal());
            Shape::clump(at, axis, draw.range(0.3, 0.7), draw.range(0.15, 0.35), 4.0 * leaf)
        })
        .collect()
}

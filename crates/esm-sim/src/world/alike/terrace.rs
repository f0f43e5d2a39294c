//! The one house of a terrace, to be built again and again: a bay, a door under a porch, three windows above, a ridge along
//! the street, a chimney on the party wall.

use nalgebra::{Rotation3, Vector3};

use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

/// Width of every house, metres.
pub(super) const HOUSE_M: f32 = 5.5;
/// Depth, metres.
const DEPTH_M: f32 = 8.0;
/// How deep windows and doors lie, metres.
const RECESS_M: f32 = 0.14;

/// What the builder of a terrace has settled, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    plinth: f32,
    storey: f32,
    /// How far bays and porches stand out.
    bay: f32,
    porch: f32,
    /// Slope of the roof.
    rise: f32,
    /// The side of the door, seen from the house: 1 left, -1 right.
    hand: f32,
}

impl Style {
    pub(super) fn new(draw: &mut Draw) -> Self {
        Self {
            plinth: draw.range(0.2, 0.5),
            storey: draw.range(2.7, 3.0),
            bay: draw.range(0.5, 0.8),
            porch: draw.range(0.8, 1.2),
            rise: draw.range(0.6, 0.9),
            hand: if draw.chance(0.5) { 1.0 } else { -1.0 },
        }
    }

    /// Where along the front the door is, metres from its middle, to the left seen from the house.
    pub(super) fn door_m(&self) -> f64 {
        f64::from(self.hand * DOOR_M)
    }
}

/// From the middle of the front to that of the door and of the bay, metres.
const DOOR_M: f32 = 1.85;
const BAY_M: f32 = -0.85;

/// Pieces in the house's own frame: x out to the street, y along the front, z up.
struct Mason {
    turn: Rotation3<f32>,
    yaw: f32,
    shapes: Vec<Shape>,
}

impl Mason {
    fn block(&mut self, low: [f32; 3], high: [f32; 3]) {
        // Handed houses turn left and right.
        let (low, high) = (V::from(low), V::from(high));
        let (low, high) = (low.inf(&high), low.sup(&high));
        self.shapes.push(Shape::cuboid(self.turn * ((low + high) * 0.5), (high - low) * 0.5, self.yaw));
    }

    fn quad(&mut self, corners: [[f32; 3]; 4]) {
        let [a, b, c, d] = corners.map(|p| self.turn * V::from(p));
        self.shapes.push(Shape::triangle(a, b, c));
        self.shapes.push(Shape::triangle(a, c, d));
    }
}

/// Its walls; the anchor is the middle of its front at the ground, `yaw` points to the street. `odd` gives it a closed porch and
/// a dormer that the others do not have.
pub(super) fn walls(style: &Style, yaw: f32, odd: bool) -> Vec<Shape> {
    let mut m = Mason { turn: Rotation3::from_axis_angle(&V::z_axis(), yaw), yaw, shapes: Vec::new() };
    let (half, eaves) = (0.5 * HOUSE_M, style.plinth + 2.0 * style.storey);
    m.block([-DEPTH_M, -half, -1.0], [-RECESS_M, half, eaves]);
    m.block([-RECESS_M, -half, -1.0], [0.03, half, style.plinth]);
    front(&mut m, style, half, eaves);
    // Bay: a front and two slanted cheeks, below and above the glass.
    let (middle, out) = (style.hand * BAY_M, style.bay);
    for (z0, z1) in [(-0.6, style.plinth + 0.7), (style.plinth + 2.1, style.plinth + style.storey - 0.1)] {
        let (l, r) = ([0.0, middle - 1.1], [0.0, middle + 1.1]);
        let (fl, fr) = ([out, middle - 0.7], [out, middle + 0.7]);
        for (a, b) in [(l, fl), (fl, fr), (fr, r)] {
            m.quad([[a[0], a[1], z0], [b[0], b[1], z0], [b[0], b[1], z1], [a[0], a[1], z1]]);
        }
        m.quad([[0.0, l[1], z1], [out, fl[1], z1], [out, fr[1], z1], [0.0, r[1], z1]]);
    }
    for y in [-0.7, 0.0, 0.7] {
        m.block(
            [out - 0.07, middle + y - 0.05, style.plinth + 0.7],
            [out, middle + y + 0.05, style.plinth + 2.1],
        );
    }
    porch(&mut m, style, odd);
    // Gutter, downpipe, roof, chimney.
    m.block([0.05, -half, eaves - 0.1], [0.2, half, eaves]);
    m.block([0.0, style.hand * (half - 0.15), 0.0], [0.08, style.hand * (half - 0.07), eaves]);
    let (ridge, top) = (-0.5 * DEPTH_M, eaves + style.rise * 0.5 * DEPTH_M);
    for x in [0.25, -DEPTH_M - 0.25] {
        m.quad([[x, -half, eaves], [x, half, eaves], [ridge, half, top], [ridge, -half, top]]);
    }
    for y in [-half, half] {
        m.quad([[0.25, y, eaves], [-DEPTH_M - 0.25, y, eaves], [ridge, y, top], [ridge, y, top]]);
    }
    m.block(
        [ridge - 0.5, style.hand * half - 0.35, eaves],
        [ridge + 0.4, style.hand * half + 0.35, top + 0.9],
    );
    if odd {
        m.block([ridge, -1.0, eaves + 0.4], [-0.7, 1.0, top - 0.1]);
    }
    m.shapes
}

/// The front wall with its openings: door and bay below, three windows above, their sills and lintels.
fn front(m: &mut Mason, style: &Style, half: f32, eaves: f32) {
    let (plinth, first) = (style.plinth, style.plinth + style.storey);
    let (door, bay) = (style.hand * DOOR_M, style.hand * BAY_M);
    let around = |m: &mut Mason, from: f32, to: f32, openings: &[(f32, f32, f32, f32)]| {
        let mut left = -half;
        for (middle, wide, z0, z1) in openings {
            let (low, high) = (middle - 0.5 * wide, middle + 0.5 * wide);
            m.block([-RECESS_M, left, from], [0.0, low, to]);
            if *z0 > from {
                m.block([-RECESS_M, low, from], [0.0, high, *z0]);
                m.block([0.0, low - 0.08, z0 - 0.1], [0.09, high + 0.08, *z0]);
            }
            m.block([-RECESS_M, low, *z1], [0.0, high, to]);
            left = high;
        }
        m.block([-RECESS_M, left, from], [0.0, half, to]);
    };
    let mut ground = [(door, 0.95, plinth, plinth + 2.1), (bay, 1.7, plinth + 0.7, plinth + 2.1)];
    ground.sort_by(|a, b| a.0.total_cmp(&b.0));
    around(m, plinth, first, &ground);
    let windows = [-1.75, 0.0, 1.75].map(|y| (y, 0.95, first + 0.8, first + 2.2));
    around(m, first, eaves, &windows);
    m.block([0.0, -half, first - 0.08], [0.05, half, first + 0.06]);
    for (y, wide, z0, z1) in windows {
        m.block(
            [-RECESS_M, y - 0.5 * wide, 0.5 * (z0 + z1) - 0.03],
            [-0.08, y + 0.5 * wide, 0.5 * (z0 + z1) + 0.03],
        );
    }
}

/// A step, two posts and a roof before the door; closed by walls where it is odd.
fn porch(m: &mut Mason, style: &Style, odd: bool) {
    let (middle, out, head) = (style.hand * DOOR_M, style.porch, style.plinth + 2.25);
    let (low, high) = (middle - 0.75, middle + 0.75);
    m.block([0.0, low, -0.5], [out + 0.25, high, style.plinth * 0.5]);
    m.block([0.0, low - 0.1, head], [out + 0.12, high + 0.1, head + 0.16]);
    for y in [low + 0.08, high - 0.08] {
        m.block([out - 0.12, y - 0.06, 0.0], [out, y + 0.06, head]);
        if odd {
            m.block([0.0, y - 0.05, 0.0], [out, y + 0.05, head]);
        }
    }
    if odd {
        m.block([out - 0.08, low, 0.0], [out, high, head]);
    }
}

/// Its panes.
pub(super) fn glass(style: &Style, yaw: f32) -> Vec<Shape> {
    let mut m = Mason { turn: Rotation3::from_axis_angle(&V::z_axis(), yaw), yaw, shapes: Vec::new() };
    let first = style.plinth + style.storey;
    for y in [-1.75f32, 0.0, 1.75] {
        m.block([-RECESS_M - 0.01, y - 0.48, first + 0.8], [-RECESS_M + 0.02, y + 0.48, first + 2.2]);
    }
    let bay = style.hand * BAY_M;
    m.block(
        [style.bay - 0.09, bay - 0.7, style.plinth + 0.7],
        [style.bay - 0.07, bay + 0.7, style.plinth + 2.1],
    );
    m.shapes
}

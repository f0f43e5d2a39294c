//! Cars and vans: lofted bodies of many makes, glass that beams go through, seats behind it, wheels, mirrors.

use nalgebra::{Rotation3, Vector3};

use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

/// What kind of body a car has.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Body {
    Saloon,
    Hatchback,
    Estate,
    OffRoad,
    /// Closed behind the front seats.
    Van,
    /// A cab before a box.
    Truck,
}

/// Measures of one vehicle, metres: x forward from its middle, z up from the ground.
struct Make {
    body: Body,
    /// Half length and half width.
    l: f32,
    w: f32,
    sill: f32,
    /// Height of the bonnet's front, of the bonnet at the windscreen, of the waist line, of the roof.
    nose: f32,
    bonnet: f32,
    waist: f32,
    roof: f32,
    /// Where the windscreen starts, where the roof starts and ends, where the boot or the tail starts.
    screen: f32,
    roof_front: f32,
    roof_back: f32,
    boot: f32,
    /// Half width of the roof.
    roof_w: f32,
    /// How much nose and tail are drawn in, seen from above.
    round: f32,
    wheel: f32,
}

impl Make {
    fn new(van: bool, draw: &mut Draw) -> Self {
        let body = match (van, draw.unit()) {
            (true, u) if u < 0.8 => Body::Van,
            (true, _) => Body::Truck,
            (false, u) if u < 0.25 => Body::Saloon,
            (false, u) if u < 0.6 => Body::Hatchback,
            (false, u) if u < 0.85 => Body::Estate,
            _ => Body::OffRoad,
        };
        // Length, width, roof, bonnet's length, its height.
        let (length, width, roof, front, bonnet) = match body {
            Body::Saloon => ((4.2, 5.0), (1.68, 1.88), (1.38, 1.48), (1.0, 1.4), (0.84, 0.95)),
            Body::Hatchback => ((3.4, 4.3), (1.58, 1.8), (1.4, 1.58), (0.7, 1.1), (0.85, 0.98)),
            Body::Estate => ((4.1, 4.9), (1.68, 1.86), (1.42, 1.72), (0.8, 1.25), (0.86, 1.0)),
            Body::OffRoad => ((4.0, 4.8), (1.76, 1.95), (1.62, 1.88), (0.9, 1.2), (1.0, 1.16)),
            Body::Van => ((4.5, 6.4), (1.8, 2.1), (1.85, 2.7), (0.4, 0.9), (1.05, 1.3)),
            Body::Truck => ((5.0, 7.5), (1.95, 2.3), (2.3, 3.2), (0.1, 0.4), (1.1, 1.4)),
        };
        let mut of = |(a, b): (f32, f32)| draw.range(a, b);
        let (l, w, roof, front, bonnet) =
            (0.5 * of(length), 0.5 * of(width), of(roof), of(front), of(bonnet));
        let slant = if matches!(body, Body::Van | Body::Truck) { of((0.2, 0.55)) } else { of((0.55, 0.95)) };
        let screen = l - front;
        let (roof_back, boot) = match body {
            Body::Saloon => (-l + of((1.0, 1.4)), -l + of((0.4, 0.65))),
            Body::Hatchback => (-l + of((0.35, 0.6)), -l + of((0.06, 0.2))),
            Body::Estate | Body::OffRoad => (-l + of((0.15, 0.45)), -l + of((0.03, 0.15))),
            Body::Van | Body::Truck => (-l + 0.08, -l + 0.02),
        };
        let waist = bonnet + of((0.02, 0.14));
        let inset = if matches!(body, Body::Van | Body::Truck) { of((0.93, 0.99)) } else { of((0.76, 0.88)) };
        Self {
            body,
            l,
            w,
            sill: of((0.2, 0.34)),
            nose: bonnet - of((0.1, 0.28)),
            bonnet,
            waist,
            roof,
            screen,
            roof_front: screen - slant,
            roof_back,
            boot,
            roof_w: inset * w,
            round: of((0.1, 0.24)),
            wheel: of(if van { (0.32, 0.4) } else { (0.28, 0.36) }),
        }
    }

    /// Half width of the body at x: drawn in towards nose and tail.
    fn half_width(&self, x: f32) -> f32 {
        self.w * (1.0 - self.round * (x / self.l).abs().powi(5))
    }

    /// Height of the body's upper edge below the windows.
    fn belt(&self, x: f32) -> f32 {
        let between =
            |x0: f32, z0: f32, x1: f32, z1: f32| z0 + (z1 - z0) * ((x - x0) / (x1 - x0)).clamp(0.0, 1.0);
        let tail = self.waist + 0.03;
        if x > self.screen {
            between(self.l, self.nose, self.screen, self.bonnet)
        } else if x > self.roof_back {
            between(self.screen, self.bonnet, self.roof_back, self.waist)
        } else {
            between(self.boot, tail, -self.l, tail - 0.2)
        }
    }

    /// Height of the roof line, and of glass that slants to it; the belt where there is none.
    fn top(&self, x: f32) -> f32 {
        let t = if x > self.roof_front {
            (self.screen - x) / (self.screen - self.roof_front)
        } else {
            (x - self.boot) / (self.roof_back - self.boot)
        };
        let crown = 0.04 * (1.0 - (x / self.l).powi(2));
        self.belt(x) + (self.roof + crown - self.belt(x)) * t.clamp(0.0, 1.0)
    }

    /// Whether the sides above the belt are sheet metal at x.
    fn closed(&self, x: f32) -> bool {
        matches!(self.body, Body::Van | Body::Truck) && x < self.roof_front - 0.9
    }
}

/// Pieces about the middle of the vehicle on the ground.
struct Builder {
    turn: Rotation3<f32>,
    shapes: Vec<Shape>,
}

impl Builder {
    fn quad(&mut self, a: V, b: V, c: V, d: V) {
        let [a, b, c, d] = [a, b, c, d].map(|p| self.turn * p);
        self.shapes.push(Shape::triangle(a, b, c));
        self.shapes.push(Shape::triangle(a, c, d));
    }

    fn rod(&mut self, a: V, b: V, radius: f32) {
        self.shapes.push(Shape::frustum(self.turn * a, self.turn * b, radius, radius));
    }
}

/// A car (or a van) about its middle on the ground, its nose along `yaw`. No two are alike: measures, roof lines and
/// furnishings are drawn. Beams go in and out through the windows, and some stop in what is behind them.
pub(crate) fn vehicle(van: bool, yaw: f32, draw: &mut Draw) -> Vec<Shape> {
    let make = Make::new(van, draw);
    let mut b = Builder { turn: Rotation3::from_axis_angle(&V::z_axis(), yaw), shapes: Vec::new() };
    shell(&mut b, &make);
    greenhouse(&mut b, &make);
    inside(&mut b, &make, yaw, draw);
    let l = make.l;
    for x in [l - 0.45 - make.wheel, -l + draw.range(0.35, 0.8) + make.wheel] {
        for side in [-1.0, 1.0] {
            let at = |y: f32| V::new(x, side * y, make.wheel);
            b.rod(at(make.w - 0.24), at(make.w - 0.01), make.wheel);
        }
    }
    for side in [-1.0, 1.0] {
        let at = b.turn * V::new(make.screen - 0.3, side * (make.w + 0.1), make.waist + 0.1);
        b.shapes.push(Shape::spheroid(at, b.turn * V::y(), 0.12, 0.085));
    }
    if draw.chance(if van { 0.25 } else { 0.12 }) {
        // Rails or a rack on the roof.
        for side in [-1.0, 1.0] {
            let y = side * (make.roof_w - 0.08);
            let z = make.roof + draw.range(0.05, 0.12);
            b.rod(V::new(make.roof_front - 0.2, y, z), V::new(make.roof_back + 0.1, y, z), 0.02);
        }
    }
    b.shapes
}

/// The sheet metal below the windows, bonnet and boot included: cross sections at stations from nose to tail.
fn shell(b: &mut Builder, make: &Make) {
    let l = make.l;
    let mut stations =
        vec![l, l - 0.06, l - 0.2, l - 0.5, make.screen, 0.0, make.roof_back, make.boot, -l + 0.08, -l];
    stations.sort_by(|a, b| b.total_cmp(a));
    // Seen from the front: drawn in at the sill, widest at two thirds, drawn in again at the belt.
    let section = |x: f32, side: f32| -> [V; 4] {
        let (w, belt) = (make.half_width(x), make.belt(x));
        let end = 1.0 - 0.25 * ((x.abs() - (l - 0.1)) / 0.1).clamp(0.0, 1.0);
        let bulge = make.sill + 0.62 * (belt - make.sill);
        [
            V::new(x, side * 0.92 * w * end, make.sill),
            V::new(x, side * w * end, bulge),
            V::new(x, side * 0.965 * w * end, belt),
            V::new(x, 0.0, belt + 0.035),
        ]
    };
    for pair in stations.windows(2) {
        let covered = pair[0] > make.screen - 1e-3 || pair[1] < make.boot + 1e-3;
        if pair[0] - pair[1] < 1e-3 {
            continue;
        }
        for side in [-1.0, 1.0] {
            let (p, q) = (section(pair[0], side), section(pair[1], side));
            for n in 0..if covered { 3 } else { 2 } {
                b.quad(p[n], p[n + 1], q[n + 1], q[n]);
            }
        }
    }
    for x in [l, -l] {
        let (p, q) = (section(x, -1.0), section(x, 1.0));
        b.quad(p[0], p[2], q[2], q[0]);
    }
    // The floor, seen through between the wheels.
    let s = 0.9 * make.w;
    let at = |x: f32, y: f32| V::new(x, y, make.sill);
    b.quad(at(0.95 * l, s), at(0.95 * l, -s), at(-0.95 * l, -s), at(-0.95 * l, s));
}

/// Roof, pillars, and the metal sides of vans.
fn greenhouse(b: &mut Builder, make: &Make) {
    let edge = |x: f32, side: f32| {
        // Glass and pillars lean in from the belt to the roof.
        let lean = ((make.top(x) - make.belt(x)) / (make.roof - make.waist)).clamp(0.0, 1.0);
        let w = 0.965 * make.half_width(x);
        V::new(x, side * (w + (make.roof_w.min(w) - w) * lean), make.top(x) - 0.05)
    };
    let belt = |x: f32, side: f32| V::new(x, side * 0.965 * make.half_width(x), make.belt(x));
    let (front, back) = (make.roof_front, make.roof_back);
    let stations = [front, front + 0.33 * (back - front), front + 0.67 * (back - front), back];
    for pair in stations.windows(2) {
        for side in [-1.0, 1.0] {
            let (p, q) = (edge(pair[0], side), edge(pair[1], side));
            let crown = |x: f32| V::new(x, 0.0, make.top(x) + 0.02);
            b.quad(p, crown(pair[0]), crown(pair[1]), q);
            if make.closed(pair[1]) {
                let from = pair[0].min(front - 0.9).max(pair[1]);
                b.quad(belt(from, side), edge(from, side), q, belt(pair[1], side));
            }
        }
    }
    if matches!(make.body, Body::Van | Body::Truck) {
        b.quad(belt(back, -1.0), edge(back, -1.0), edge(back, 1.0), belt(back, 1.0));
    }
    // Pillars: beside the windscreen, between the doors, beside the rear window.
    for side in [-1.0, 1.0] {
        b.rod(belt(make.screen, side), edge(front, side), 0.045);
        let door = front - 0.45 * (front - back).min(2.6);
        b.rod(belt(door, side), edge(door, side), 0.06);
        b.rod(belt(make.boot.min(back), side), edge(back, side), 0.09);
    }
}

/// Seats and dashboard, the glass that stops a few beams, dust and curtains that stop others.
fn inside(b: &mut Builder, make: &Make, yaw: f32, draw: &mut Draw) {
    let mut row = |x: f32, half: f32| {
        for y in [-0.38 * make.w, 0.38 * make.w] {
            let at = b.turn * V::new(x, y, make.waist + 0.03);
            b.shapes.push(Shape::cuboid(at, V::new(0.07, half, 0.24), yaw));
            let head = b.turn * V::new(x - 0.03, y, make.waist + 0.36);
            b.shapes.push(Shape::spheroid(head, V::z(), 0.1, 0.11));
        }
    };
    let seats = make.roof_front - draw.range(0.25, 0.55);
    row(seats, 0.24);
    if !matches!(make.body, Body::Van | Body::Truck) {
        row(seats - draw.range(0.75, 0.95), 0.3);
    }
    let z = 0.5 * (make.waist + make.roof) - 0.03;
    let half = 0.5 * (make.roof - make.waist) - 0.05;
    let last = if make.closed(-make.l) { make.roof_front - 0.9 } else { make.roof_back };
    let (middle, reach) = (0.5 * (make.roof_front + last), 0.5 * (make.roof_front - last));
    // Panes in the doors: about a third of the beams return from them.
    for side in [-1.0, 1.0] {
        let at = b.turn * V::new(middle, side * (0.5 * (make.w + make.roof_w) - 0.05), z);
        b.shapes.push(Shape::hedge(at, V::new(reach, 0.02, half), yaw, draw.range(8.0, 24.0)));
    }
    let at = b.turn * V::new(middle, 0.0, z);
    b.shapes.push(Shape::clump(at, b.turn * V::x(), reach + 0.5, half + 0.15, draw.range(0.3, 0.9)));
}

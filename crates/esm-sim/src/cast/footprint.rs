//! What shapes cover of the plan: how far a place is from what stands there.

use super::shape::{Kind, Shape, from_parry};

/// The plan of one shape: all that lies within `radius` of a convex hull of up to four corners, metres.
#[derive(Clone, Debug)]
pub(crate) struct Footprint {
    /// In order around the hull.
    corners: Vec<[f64; 2]>,
    radius: f64,
    /// Lowest and highest point, metres above the object's anchor.
    pub(crate) span: [f64; 2],
    /// Half of its thinnest measure, metres: twigs and wires are thin.
    pub(crate) thick: f64,
}

impl Shape {
    /// Its plan, moved by `by`; spheroids may cover a little less than that.
    pub(crate) fn footprint(&self, by: [f64; 2]) -> Footprint {
        let (corners, radius, thick) = match self.0 {
            Kind::Frustum { base, axis, length, r0, r1 } => {
                (vec![base, base + axis * length], r0.max(r1), r0.max(r1))
            }
            Kind::Slab { center, x, y, half, .. } => {
                let (x, y) = (x * half.x, y * half.y);
                let around = [center + x + y, center - x + y, center - x - y, center + x - y];
                (around.to_vec(), 0.0, half.min_element())
            }
            Kind::Spheroid { center, axis, along, across, .. } => {
                // Flat ones are wide across their axis, long ones along it.
                let reach = axis * (along - across).max(0.0);
                (vec![center - reach, center + reach], across, along.min(across))
            }
            Kind::Triangle { a, b, c } => (vec![a, b, c], 0.0, f32::INFINITY),
        };
        let bounds = self.aabb();
        let flat = |v| {
            let v = from_parry(v).cast::<f64>();
            [v.x + by[0], v.y + by[1]]
        };
        Footprint {
            corners: corners.into_iter().map(flat).collect(),
            radius: radius.into(),
            span: [bounds.mins.z.into(), bounds.maxs.z.into()],
            thick: thick.into(),
        }
    }
}

impl Footprint {
    /// The box around it.
    pub(crate) fn bounds(&self) -> [[f64; 2]; 2] {
        let end = |sign: f64, pick: fn(f64, f64) -> f64| {
            [0, 1].map(|i| {
                let ends = self.corners.iter().map(|c| c[i]);
                ends.fold(-sign * f64::INFINITY, pick) + sign * self.radius
            })
        };
        [end(-1.0, f64::min), end(1.0, f64::max)]
    }

    /// Metres from it to a place, 0 on it.
    pub(crate) fn distance(&self, [x, y]: [f64; 2]) -> f64 {
        let n = self.corners.len();
        let (mut nearest, mut left, mut right) = (f64::INFINITY, true, true);
        for k in 0..n {
            let (a, b) = (self.corners[k], self.corners[(k + 1) % n]);
            let (d, w) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
            let square = d[0] * d[0] + d[1] * d[1];
            let t = if square > 0.0 { ((w[0] * d[0] + w[1] * d[1]) / square).clamp(0.0, 1.0) } else { 0.0 };
            nearest = nearest.min((w[0] - t * d[0]).hypot(w[1] - t * d[1]));
            let side = d[0] * w[1] - d[1] * w[0];
            (left, right) = (left && side > 0.0, right && side < 0.0);
        }
        if n > 2 && (left || right) { 0.0 } else { (nearest - self.radius).max(0.0) }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn distances_to_plans() {
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-5, "{a} {b}");
        let turned = Shape::cuboid(Vector3::z(), Vector3::new(1.0, 1.0, 1.0), std::f32::consts::FRAC_PI_4)
            .footprint([10.0, 0.0]);
        near(turned.distance([10.0, 0.0]), 0.0);
        near(turned.distance([10.0 + 2f64.sqrt(), 0.0]), 0.0);
        near(turned.distance([13.0, 0.0]), 3.0 - 2f64.sqrt());
        near(turned.span[0] + turned.span[1], 2.0);
        let trunk = Shape::frustum(Vector3::zeros(), Vector3::z() * 3.0, 0.3, 0.1).footprint([0.0; 2]);
        near(trunk.distance([0.0, 2.0]), 1.7);
        let log = Shape::frustum(Vector3::zeros(), Vector3::x() * 3.0, 0.2, 0.1).footprint([0.0; 2]);
        near(log.distance([2.0, 1.0]), 0.8);
        let ball = Shape::spheroid(Vector3::zeros(), Vector3::y(), 2.0, 0.5).footprint([0.0; 2]);
        near(ball.distance([0.0, 4.0]), 2.0);
        near(ball.distance([1.5, 0.0]), 1.0);
        let [low, high] = ball.bounds();
        near(low[1] + high[0], -1.5);
    }
}

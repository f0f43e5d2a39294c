//! What rays can hit. The one file that converts between nalgebra (ours) and glam (parry's).

use nalgebra::Vector3;
use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;

use crate::hash::Key;

/// Density of a solid.
const SOLID: f32 = f32::INFINITY;

/// Side of the tufts that foliage is cut into, metres: a spray of leaves.
const TUFT_M: f32 = 0.14;
/// Share of the tufts in the middle of a clump that hold leaves.
const FILLED: f32 = 0.6;

/// To parry's vector.
#[inline]
pub(super) fn to_parry(v: Vector3<f32>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

/// From parry's vector.
#[inline]
pub(super) fn from_parry(v: Vector) -> Vector3<f32> {
    Vector3::new(v.x, v.y, v.z)
}

/// A half line with the random stream of its pulse.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub(super) origin: Vector,
    pub(super) dir: Vector,
    pub(super) key: Key,
}

impl Ray {
    /// From `origin` in metres along `dir`, which is normalised here; `None` where it has no direction or is not finite.
    /// `key` decides where foliage stops it.
    pub fn try_new(origin: Vector3<f32>, dir: Vector3<f32>, key: Key) -> Option<Self> {
        let norm = dir.norm();
        let usable = norm > f32::MIN_POSITIVE && norm.is_finite() && origin.iter().all(|v| v.is_finite());
        usable.then(|| Self { origin: to_parry(origin), dir: to_parry(dir / norm), key })
    }

    pub(super) fn to_query(self) -> parry3d::query::Ray {
        parry3d::query::Ray::new(self.origin, self.dir)
    }

    pub(super) fn moved(self, by: Vector) -> Self {
        Self { origin: self.origin + by, ..self }
    }
}

/// One piece of an object, in metres about the object's anchor, z up.
///
/// Solids are hit where the ray meets their surface. Media stop a ray inside them after a free path drawn from the
/// exponential distribution of their density (Beer and Lambert); clumps are densest in their middle. Each medium draws for itself from the ray's key and its
/// own number, and the nearest hit wins. That is the exact law for media that overlap, whatever the order of visits.
#[derive(Clone, Copy, Debug)]
pub struct Shape(pub(super) Kind);

#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Frustum { base: Vector, axis: Vector, length: f32, r0: f32, r1: f32 },
    Slab { center: Vector, x: Vector, y: Vector, half: Vector, density: f32 },
    Spheroid { center: Vector, axis: Vector, along: f32, across: f32, density: f32 },
    Triangle { a: Vector, b: Vector, c: Vector },
}

impl Shape {
    /// A cone frustum with flat ends, from `a` with radius `ra` to `b` with radius `rb`. Ends closer than 1 mm are moved
    /// apart upwards.
    pub fn frustum(a: Vector3<f32>, b: Vector3<f32>, ra: f32, rb: f32) -> Self {
        let (v, length) = ((b - a), (b - a).norm());
        let (axis, length) = if length > 1e-3 { (v / length, length) } else { (Vector3::z(), 1e-3) };
        Self(Kind::Frustum {
            base: to_parry(a),
            axis: to_parry(axis),
            length,
            r0: ra.max(1e-3),
            r1: rb.max(1e-3),
        })
    }

    /// A box about `center`, turned about z by `yaw` (radians), with half sides `half`.
    pub fn cuboid(center: Vector3<f32>, half: Vector3<f32>, yaw: f32) -> Self {
        Self::slab(center, half, yaw, SOLID)
    }

    /// A box of foliage; `density` in hits a metre.
    pub fn hedge(center: Vector3<f32>, half: Vector3<f32>, yaw: f32, density: f32) -> Self {
        Self::slab(center, half, yaw, density)
    }

    fn slab(center: Vector3<f32>, half: Vector3<f32>, yaw: f32, density: f32) -> Self {
        let (s, c) = yaw.sin_cos();
        let (x, y) = (Vector::new(c, s, 0.0), Vector::new(-s, c, 0.0));
        let half = to_parry(half.map(|h| h.max(1e-3)));
        Self(Kind::Slab { center: to_parry(center), x, y, half, density })
    }

    /// A solid spheroid: half length `along` its axis, radius `across`.
    pub fn spheroid(center: Vector3<f32>, axis: Vector3<f32>, along: f32, across: f32) -> Self {
        Self::clump(center, axis, along, across, SOLID)
    }

    /// A spheroid of foliage; `density` in hits a metre, on the mean of a chord through its middle.
    pub fn clump(center: Vector3<f32>, axis: Vector3<f32>, along: f32, across: f32, density: f32) -> Self {
        let axis = axis.try_normalize(1e-6).unwrap_or_else(Vector3::z);
        let (along, across) = (along.max(1e-3), across.max(1e-3));
        Self(Kind::Spheroid { center: to_parry(center), axis: to_parry(axis), along, across, density })
    }

    /// A triangle, hit from both sides.
    pub fn triangle(a: Vector3<f32>, b: Vector3<f32>, c: Vector3<f32>) -> Self {
        Self(Kind::Triangle { a: to_parry(a), b: to_parry(b), c: to_parry(c) })
    }

    /// Whether rays may pass through.
    pub fn is_medium(&self) -> bool {
        match self.0 {
            Kind::Slab { density, .. } | Kind::Spheroid { density, .. } => density.is_finite(),
            _ => false,
        }
    }

    pub(crate) fn moved(mut self, by: Vector3<f32>) -> Self {
        let by = to_parry(by);
        match &mut self.0 {
            Kind::Frustum { base: p, .. }
            | Kind::Slab { center: p, .. }
            | Kind::Spheroid { center: p, .. } => *p += by,
            Kind::Triangle { a, b, c } => [a, b, c].into_iter().for_each(|p| *p += by),
        }
        self
    }

    pub(super) fn aabb(&self) -> Aabb {
        match self.0 {
            Kind::Frustum { base, axis, length, r0, r1 } => {
                // A disc of radius r about an axis n reaches r sqrt(1 - n_i^2) along axis i.
                let reach = (Vector::ONE - axis * axis).max(Vector::ZERO).map(f32::sqrt);
                let end = base + axis * length;
                Aabb::new(
                    (base - reach * r0).min(end - reach * r1),
                    (base + reach * r0).max(end + reach * r1),
                )
            }
            Kind::Slab { center, x, y, half, .. } => {
                let reach = x.abs() * half.x + y.abs() * half.y + Vector::new(0.0, 0.0, half.z);
                Aabb::new(center - reach, center + reach)
            }
            Kind::Spheroid { center, axis, along, across, .. } => {
                let n2 = axis * axis;
                let reach = (n2 * (along * along) + (Vector::ONE - n2) * (across * across)).map(f32::sqrt);
                Aabb::new(center - reach, center + reach)
            }
            Kind::Triangle { a, b, c } => Aabb::new(a.min(b).min(c), a.max(b).max(c)),
        }
    }

    /// Distance to the hit, below `limit`; `number` tells media of one tile apart.
    #[inline]
    pub(super) fn cast(&self, ray: &Ray, limit: f32, number: u32) -> Option<f32> {
        let t = match self.0 {
            Kind::Frustum { base, axis, length, r0, r1 } => frustum(ray, base, axis, length, r0, r1),
            Kind::Triangle { a, b, c } => triangle(ray, a, b, c),
            Kind::Slab { center, x, y, half, density } => {
                let w = ray.origin - center;
                let o = Vector::new(w.dot(x), w.dot(y), w.z);
                let d = Vector::new(ray.dir.dot(x), ray.dir.dot(y), ray.dir.z);
                let inv = d.map(|v| 1.0 / if v.abs() < 1e-9 { 1e-9f32.copysign(v) } else { v });
                let (low, high) = ((-half - o) * inv, (half - o) * inv);
                inside(low.min(high).max_element(), low.max(high).min_element(), density, ray.key, number)
            }
            Kind::Spheroid { center, axis, along, across, density } => {
                // Scaled to a unit sphere about the point of closest approach: short vectors keep f32 exact enough.
                let nearest = (center - ray.origin).dot(ray.dir);
                let scale = |v: Vector| v / across + axis * (v.dot(axis) * (1.0 / along - 1.0 / across));
                let (o, d) = (scale(ray.origin + ray.dir * nearest - center), scale(ray.dir));
                let (a, b, c) = (d.dot(d), o.dot(d), o.dot(o) - 1.0);
                let root = b * b - a * c;
                if root < 0.0 {
                    return None;
                }
                let root = root.sqrt();
                let (enter, leave) = (nearest + (-b - root) / a, nearest + (-b + root) / a);
                if density == SOLID {
                    inside(enter, leave, density, ray.key, number)
                } else {
                    // Square of the distance to the middle, 1 at the rim.
                    let rho2 = |t: f32| {
                        let p = o + d * (t - nearest);
                        p.dot(p)
                    };
                    // What the clump is made of tells it from others, and stays from visit to visit.
                    let own = Key::new((u64::from(along.to_bits()) << 32) | u64::from(across.to_bits()));
                    let from = ray.origin - center;
                    let leaves = |t: f32| {
                        let cell = ((from + ray.dir * t) * (1.0 / TUFT_M)).floor();
                        let part = |v: f32, n: u32| u64::from((v as i32 as u32) & 0xFFFF) << n;
                        own.with(part(cell.x, 0) | part(cell.y, 16) | part(cell.z, 32)).unit()
                    };
                    let key = ray.key.with(u64::from(number));
                    clump(enter.max(0.0), leave, density, |t| leaves(t) > 1.0 - FILLED * (1.0 - rho2(t)), key)
                }
            }
        }?;
        (t < limit).then_some(t)
    }

    /// The outward or facing normal at a point of the surface; media have none of their own and face the ray.
    pub(super) fn normal(&self, at: Vector, ray: &Ray) -> Vector {
        match self.0 {
            _ if self.is_medium() => -ray.dir,
            Kind::Frustum { base, axis, length, r0, r1 } => {
                let w = at - base;
                let h = w.dot(axis);
                let radial = w - axis * h;
                if h < 1e-3 || h > length - 1e-3 {
                    return if h < 0.5 * length { -axis } else { axis };
                }
                (radial.normalize_or_zero() - axis * ((r1 - r0) / length)).normalize_or_zero()
            }
            Kind::Slab { center, x, y, half, .. } => {
                let w = at - center;
                let local = Vector::new(w.dot(x), w.dot(y), w.z) / half;
                let a = local.abs();
                if a.x >= a.y && a.x >= a.z {
                    x * local.x.signum()
                } else if a.y >= a.z {
                    y * local.y.signum()
                } else {
                    Vector::new(0.0, 0.0, local.z.signum())
                }
            }
            Kind::Spheroid { center, axis, along, across, .. } => {
                let w = at - center;
                let h = w.dot(axis);
                ((w - axis * h) / (across * across) + axis * (h / (along * along))).normalize_or_zero()
            }
            Kind::Triangle { a, b, c } => (b - a).cross(c - a).normalize_or_zero(),
        }
    }
}

/// The hit in an interval of a convex body: its start for solids, a free path later for media.
#[inline]
fn inside(enter: f32, leave: f32, density: f32, key: Key, number: u32) -> Option<f32> {
    if enter > leave || leave <= 0.0 {
        return None;
    }
    if density == SOLID {
        return Some(if enter > 0.0 { enter } else { leave });
    }
    let enter = enter.max(0.0);
    let t = enter - key.with(u64::from(number)).unit().ln() / density;
    (t < leave).then_some(t)
}

/// The hit in a clump: delta tracking (Woodcock et al., "Techniques used in the GEM code", ANL-7050, 1965). Steps are drawn for
/// the densest there can be, and a hit counts where leaves are. A clump is cut into tufts that hold leaves or not, so its gaps
/// are the same for every ray and in every sweep, as those of real foliage are; the share of tufts with leaves falls with
/// 1 - rho^2 towards the rim, so no outline shows. Its mean over chords through the middle is 2/3 of that in the middle.
#[inline]
fn clump(enter: f32, leave: f32, density: f32, leaves: impl Fn(f32) -> bool, key: Key) -> Option<f32> {
    let step = -FILLED / (1.5 * density);
    let mut t = enter;
    // Denser clumps are hit after a few steps: the bound is never met in practice.
    for n in 0..64 {
        t += step * key.with(n).unit().ln();
        if t >= leave {
            return None;
        }
        if leaves(t) {
            return Some(t);
        }
    }
    Some(t)
}

#[inline]
fn frustum(ray: &Ray, base: Vector, axis: Vector, length: f32, r0: f32, r1: f32) -> Option<f32> {
    let d = ray.dir;
    let nearest = (base + axis * (0.5 * length) - ray.origin).dot(d);
    let w = ray.origin + d * nearest - base;
    let (dz, wz) = (d.dot(axis), w.dot(axis));
    let slope = (r1 - r0) / length;
    let radius = r0 + slope * wz;
    let a = 1.0 - dz * dz * (1.0 + slope * slope);
    let b = w.dot(d) - wz * dz - slope * dz * radius;
    let c = w.dot(w) - wz * wz - radius * radius;
    let mut best = f32::INFINITY;
    let mut try_root = |t: f32| {
        let h = wz + t * dz;
        if h >= 0.0 && h <= length && t + nearest > 0.0 && t < best {
            best = t;
        }
    };
    let root = b * b - a * c;
    if a.abs() > 1e-6 {
        if root < 0.0 && a > 0.0 {
            return None;
        }
        let root = root.max(0.0).sqrt();
        try_root((-b - root) / a);
        try_root((-b + root) / a);
    }
    // The flat ends.
    if dz.abs() > 1e-6 {
        for (h, r) in [(0.0, r0), (length, r1)] {
            let t = (h - wz) / dz;
            let off = w + d * t - axis * h;
            if off.dot(off) <= r * r && t + nearest > 0.0 && t < best {
                best = t;
            }
        }
    }
    (best < f32::INFINITY).then_some(best + nearest)
}

/// Möller and Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.
#[inline]
pub(super) fn triangle(ray: &Ray, a: Vector, b: Vector, c: Vector) -> Option<f32> {
    let (e1, e2) = (b - a, c - a);
    let p = ray.dir.cross(e2);
    let det = e1.dot(p);
    if det.abs() < 1e-12 {
        return None;
    }
    let inv = 1.0 / det;
    let s = ray.origin - a;
    let u = s.dot(p) * inv;
    let q = s.cross(e1);
    let v = ray.dir.dot(q) * inv;
    // A hair wider than the triangle: no ray slips between two neighbours.
    const EDGE: f32 = 1e-5;
    if u < -EDGE || v < -EDGE || u + v > 1.0 + EDGE {
        return None;
    }
    let t = e2.dot(q) * inv;
    (t > 0.0).then_some(t)
}

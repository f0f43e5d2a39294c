//! The movers about one sweep, and those that the beams of one firing can meet.

use nalgebra::Vector3;

use super::body::Body;
use super::{Mover, Movers};
use crate::cast::{Hit, Ray};
use crate::hash::Key;

/// Seconds between the times at which places are worked out; between them movers go straight on.
const KNOT_S: f64 = 0.0125;
/// Farther away than this nothing of a mover is looked for, metres.
const SIGHT_M: f64 = 90.0;
/// Room for the width of beams and for rounding, metres.
const SLACK_M: f32 = 0.15;

type V = Vector3<f32>;

/// The movers near the sensor in the time of a sweep.
#[derive(Default)]
pub(crate) struct Crowd<'a> {
    list: Vec<Passing<'a>>,
    pieces: usize,
}

struct Passing<'a> {
    mover: &'a Mover,
    knots: Vec<Knot>,
}

struct Knot {
    /// About the scene's origin.
    at: V,
    yaw: f32,
    along: f64,
}

/// A mover at the time of a firing.
pub(crate) struct Present<'a> {
    mover: &'a Mover,
    body: &'a Body,
    at: V,
    sin_cos: (f32, f32),
    /// Middle of the ball around it, from the sensor.
    middle: V,
}

impl<'a> Crowd<'a> {
    /// Who is near in the `active_s` seconds before `stamp_s`; `sensor` and `origin` (that of the scene) in the map frame.
    pub(crate) fn new(
        movers: &'a Movers<'_>,
        stamp_s: f64,
        active_s: f64,
        sensor: Vector3<f64>,
        range_m: f64,
        origin: Vector3<f64>,
    ) -> Self {
        let pieces = (active_s / KNOT_S).ceil().max(1.0) as usize;
        let reach = range_m.min(SIGHT_M);
        let passing = |mover: &'a Mover| {
            let (first, last) = mover.pace.span();
            if stamp_s < first || stamp_s - active_s > last {
                return None;
            }
            let here = mover.place(&movers.trajectory, stamp_s)?;
            if (here.x - sensor.x).hypot(here.y - sensor.y) > reach {
                return None;
            }
            let knot = |n: usize| {
                let t = stamp_s - active_s * (1.0 - n as f64 / pieces as f64);
                let p = mover.place(&movers.trajectory, t)?;
                let z = movers.world.height(p.x, p.y);
                let at = (Vector3::new(p.x, p.y, z) - origin).cast::<f32>();
                Some(Knot { at, yaw: p.yaw as f32, along: p.along })
            };
            // Who comes or goes within the sweep is far away: it is left out.
            let knots = (0..=pieces).map(knot).collect::<Option<Vec<Knot>>>()?;
            Some(Passing { mover, knots })
        };
        Self { list: movers.list.iter().filter_map(passing).collect(), pieces }
    }

    /// Whether nobody is near.
    pub(crate) fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Whom the beams of a firing can meet, into `present`. `share` (0 to 1) tells the time within the sweep, `first` and
    /// `last` the outermost beams; `from` is the sensor about the scene's origin.
    pub(crate) fn firing(
        &'a self,
        share: f64,
        from: V,
        (first, last): (V, V),
        present: &mut Vec<Present<'a>>,
    ) {
        present.clear();
        // All beams of a firing lie in a plane through the sensor, on one side of it.
        let normal = first.cross(&last).try_normalize(0.05);
        let ahead = (first + last).try_normalize(0.05).unwrap_or(first);
        let piece = share * self.pieces as f64;
        let k = (piece as usize).min(self.pieces - 1);
        let t = (piece - k as f64) as f32;
        for passing in &self.list {
            let (a, b) = (&passing.knots[k], &passing.knots[k + 1]);
            let at = a.at + (b.at - a.at) * t;
            let body = passing.mover.body(a.along + (b.along - a.along) * f64::from(t));
            let rough = at + V::z() * body.middle.z - from;
            let room = body.radius + body.middle.xy().norm() + SLACK_M;
            let aside = normal.is_some_and(|n| n.dot(&rough).abs() > room);
            // Beams to far below and above still look ahead of the plane that `ahead` stands on.
            if aside || ahead.dot(&rough) < -room {
                continue;
            }
            let sin_cos = (a.yaw + wrapped(b.yaw - a.yaw) * t).sin_cos();
            let middle = at + turned(body.middle, sin_cos) - from;
            present.push(Present { mover: passing.mover, body, at, sin_cos, middle });
        }
    }
}

impl Present<'_> {
    /// Where a ray meets it within `limit` metres: `origin` about the scene's origin, `dir` of any length.
    #[inline]
    pub(crate) fn cast(&self, origin: V, dir: V, key: Key, limit: f32) -> Option<Hit> {
        let dir = dir.normalize();
        let (t, radius) = (self.middle.dot(&dir), self.body.radius);
        if t < -radius || t - radius > limit || self.middle.norm_squared() - t * t > radius * radius + 1e-3 {
            return None;
        }
        let (s, c) = self.sin_cos;
        let back = |v: V| turned(v, (-s, c));
        let ray = Ray::try_new(back(origin - self.at), back(dir), key)?;
        let hit = self.body.scene().cast(&ray, limit)?;
        Some(Hit { object_id: self.mover.id, class: self.mover.class, ..hit })
    }
}

fn turned(v: V, (s, c): (f32, f32)) -> V {
    V::new(c * v.x - s * v.y, s * v.x + c * v.y, v.z)
}

/// An angle brought within half a turn.
fn wrapped(angle: f32) -> f32 {
    angle - (angle / std::f32::consts::TAU).round() * std::f32::consts::TAU
}

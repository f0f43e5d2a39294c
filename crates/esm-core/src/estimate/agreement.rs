//! When two candidate matches can be true together: the test of one pair.

use super::candidate::{ANY_TURN, Candidate};

/// When two matches agree: their segments lie as far apart in the live cloud as in the map, and, where gravity is known,
/// stand at the same relative height and have the same extents on a turn that the two of them allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Largest difference of the two lengths, metres.
    pub resolution_m: f32,
    /// Largest tilt between the live up axis and the map's, radians; bounds the difference of relative heights.
    /// `None` where the live cloud's up axis is unknown.
    pub max_tilt_rad: Option<f32>,
}

/// Turns about the up axis are told apart by this many bins of a full circle: one bit each.
pub(super) const TURNS: f32 = 64.0;
/// Two matches of one pose err sideways by at most this many times the resolution: each end of the pair may be off.
const SIDEWAYS: f32 = 2.0;

impl Agreement {
    /// Whether two matches agree. Neither two of one live segment nor two of one map segment do.
    pub fn holds(&self, a: &Candidate, b: &Candidate) -> bool {
        a.live != b.live && a.map != b.map && self.fits(a, b)
    }

    /// The same for any two matches: by where their segments are and how large.
    pub(super) fn fits(&self, a: &Candidate, b: &Candidate) -> bool {
        self.bounds(a.pair.live, b.pair.live).hold(difference(a.pair.map, b.pair.map))
            && self.extents_allow(a, b)
    }

    /// Whether the segments of both have the same extents on one turn that their places allow.
    pub(super) fn extents_allow(&self, a: &Candidate, b: &Candidate) -> bool {
        let both = self.alone(a) & self.alone(b);
        both == ANY_TURN || both & self.turns(a, b).bits() != 0
    }

    /// The turns that a match allows by itself.
    pub(super) fn alone(&self, a: &Candidate) -> u64 {
        if self.max_tilt_rad.is_some() { a.turns } else { ANY_TURN }
    }

    /// What a pair of map segments must keep to when their live segments lie at `a` and `b`.
    #[inline(always)]
    pub(super) fn bounds(&self, a: [f32; 3], b: [f32; 3]) -> Bounds {
        let d = difference(a, b);
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        let low = (length - self.resolution_m).max(0.0);
        let high = length + self.resolution_m;
        // Tilting by an angle raises a segment at distance d by at most d * angle.
        let rise = self.max_tilt_rad.map_or(f32::INFINITY, |tilt| self.resolution_m + tilt * length);
        Bounds { low: low * low, high: high * high, lowest: d[2] - rise, highest: d[2] + rise }
    }

    /// The turns about the up axis, one bit each, from the live frame to the map's that two agreeing matches allow; all
    /// where gravity is unknown. All matches that one pose explains have a turn in common.
    pub(super) fn turns(&self, a: &Candidate, b: &Candidate) -> Turns {
        let Some(tilt) = self.max_tilt_rad else { return Turns::ALL };
        let (l, m) = (difference(b.pair.live, a.pair.live), difference(b.pair.map, a.pair.map));
        let sideways = SIDEWAYS * self.resolution_m + tilt * l[2].abs();
        let length = (l[0] * l[0] + l[1] * l[1]).sqrt();
        if sideways >= length {
            return Turns::ALL;
        }
        let turn = arc(l[0] * m[0] + l[1] * m[1], l[0] * m[1] - l[1] * m[0]);
        // asin(x) <= x (1 + 0.571 x^2) for x up to 1: a bound is wanted here, not the value.
        let x = sideways / length;
        let spread = x * (1.0 + 0.571 * x * x);
        let bins = TURNS / std::f32::consts::TAU;
        // Half a circle more keeps both ends positive.
        let middle = turn * bins + 1.5 * TURNS;
        let (first, last) = ((middle - spread * bins) as u32, (middle + spread * bins) as u32);
        Turns::new(first, last)
    }
}

/// Bounds of the squared distance of two map segments, and of how much higher the first stands than the second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    pub(super) low: f32,
    pub(super) high: f32,
    pub(super) lowest: f32,
    pub(super) highest: f32,
}

impl Bounds {
    /// `m`: from the second map segment to the first.
    #[inline(always)]
    pub(super) fn hold(&self, m: [f32; 3]) -> bool {
        let squared = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
        // Without short circuits: neither is likely, and a jump that is guessed wrong costs more than the comparisons.
        (squared >= self.low) & (squared <= self.high) & (m[2] >= self.lowest) & (m[2] <= self.highest)
    }
}

/// A range of bins of the circle, packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Turns {
    first: u8,
    /// Bins after the first.
    more: u8,
}

impl Turns {
    pub(super) const ALL: Self = Self { first: 0, more: 63 };

    /// From one bin to another, counted on beyond the circle.
    fn new(first: u32, last: u32) -> Self {
        match last - first {
            more if more >= 63 => Self::ALL,
            more => Self { first: (first % 64) as u8, more: more as u8 },
        }
    }

    /// One bit a bin.
    #[inline(always)]
    pub(super) fn bits(self) -> u64 {
        (u64::MAX >> (63 - self.more)).rotate_left(u32::from(self.first))
    }
}

#[inline(always)]
pub(super) fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The angle of a direction, radians, -pi to pi, to within 0.0003: a tenth of what a bin may be off (Abramowitz and Stegun
/// 4.4.47, shortened).
fn arc(x: f32, y: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let longer = ax.max(ay);
    if longer == 0.0 {
        return 0.0;
    }
    let a = ax.min(ay) / longer;
    let s = a * a;
    let mut r = ((-0.046_496_475 * s + 0.159_314_22) * s - 0.327_622_76) * s * a + a;
    if ay > ax {
        r = std::f32::consts::FRAC_PI_2 - r;
    }
    if x < 0.0 {
        r = std::f32::consts::PI - r;
    }
    if y < 0.0 { -r } else { r }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::cloud::{Pose, transform_point};
    use crate::estimate::rigid::Pair;

    #[test]
    fn the_arc_is_the_arc_tangent() {
        for i in 0..3600 {
            let angle = (i as f32 - 1799.5) / 1800.0 * std::f32::consts::PI;
            assert!((arc(7.0 * angle.cos(), 7.0 * angle.sin()) - angle).abs() < 3e-4, "{angle}");
        }
        assert_eq!(arc(0.0, 0.0), 0.0);
    }

    proptest! {
        #[test]
        fn all_matches_of_one_pose_agree_and_have_its_turn_in_common(
            yaw in -3.1f64..3.1,
            t in prop::array::uniform3(-300.0f64..300.0),
            live in prop::collection::vec((prop::array::uniform3(-60.0f32..60.0), prop::array::uniform3(-0.2f32..0.2)), 2..20),
        ) {
            let agreement = Agreement { resolution_m: 0.75, max_tilt_rad: Some(0.1) };
            let pose = Pose::new(t.into(), [0.0, 0.0, yaw].into());
            let candidates: Vec<Candidate> = live
                .iter()
                .enumerate()
                .map(|(i, (l, e))| {
                    let m = transform_point(&pose, *l);
                    let pair = Pair { live: *l, map: [m[0] + e[0], m[1] + e[1], m[2] + e[2]] };
                    Candidate { live: i as u32, map: i as u32, distance: 0.0, quality: 1.0, pair, turns: ANY_TURN }
                })
                .collect();
            let bin = ((yaw as f32 / std::f32::consts::TAU + 1.5) * TURNS) as u32 % 64;
            for a in &candidates {
                for b in &candidates {
                    if a.live != b.live {
                        prop_assert!(agreement.holds(a, b));
                        prop_assert!(agreement.turns(a, b).bits() & (1 << bin) != 0);
                        prop_assert_eq!(agreement.turns(a, b), agreement.turns(b, a));
                    }
                }
            }
        }
    }
}

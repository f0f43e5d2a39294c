//! A bounded piece of a trajectory that is asked for poses between its samples.

use std::collections::VecDeque;

use esm_core::Pose;
use nalgebra::Translation3;

/// Longest gap between two samples that is interpolated across, nanoseconds: at the 2 s of a slow key-frame trajectory a
/// car's straight line between samples is still within a metre.
pub(crate) const MAX_GAP_NS: i64 = 2_000_000_000;

/// Farthest that motion is carried on past the first or last sample, nanoseconds: one sweep of a 10 Hz lidar.
pub(crate) const MAX_EXTRAPOLATION_NS: i64 = 100_000_000;

/// Poses in order of time, oldest dropped beyond a limit.
///
/// ```
/// use esm_core::Pose;
/// use esm_io::Track;
///
/// let mut track = Track::new(100);
/// track.push(0, Pose::translation(0.0, 0.0, 0.0));
/// track.push(1_000_000_000, Pose::translation(2.0, 0.0, 0.0));
/// assert_eq!(track.at(500_000_000).map(|p| p.translation.x), Some(1.0));
/// assert!(track.at(5_000_000_000).is_none());
/// ```
#[derive(Clone, Debug)]
pub struct Track {
    samples: VecDeque<(i64, Pose)>,
    limit: usize,
    /// A sample was dropped because of the limit.
    overran: bool,
}

impl Track {
    /// An empty track of at most `limit` samples.
    pub fn new(limit: usize) -> Self {
        Self { samples: VecDeque::new(), limit: limit.max(2), overran: false }
    }

    /// Adds a sample; one at the same time replaces the older.
    pub fn push(&mut self, stamp_ns: i64, pose: Pose) {
        let at = self.samples.partition_point(|s| s.0 < stamp_ns);
        match self.samples.get_mut(at) {
            Some(same) if same.0 == stamp_ns => same.1 = pose,
            _ => self.samples.insert(at, (stamp_ns, pose)),
        }
        if self.samples.len() > self.limit {
            self.samples.pop_front();
            self.overran = true;
        }
    }

    /// Adds a sample without looking where it belongs; one beyond the limit is left out. To be followed by
    /// [`settle`](Self::settle).
    pub(crate) fn append(&mut self, stamp_ns: i64, pose: Pose) {
        if self.samples.len() < self.limit {
            self.samples.push_back((stamp_ns, pose));
        } else {
            self.overran = true;
        }
    }

    /// Puts appended samples in order; of several at one time the last added stays.
    pub(crate) fn settle(&mut self) {
        let mut samples = Vec::from(std::mem::take(&mut self.samples));
        samples.reverse();
        samples.sort_by_key(|s| s.0);
        samples.dedup_by_key(|s| s.0);
        self.samples = samples.into();
    }

    /// Whether samples were dropped because of the limit.
    pub(crate) fn overran(&self) -> bool {
        self.overran
    }

    /// Whether a sample at or after the time has come, so that waiting longer would not change the answer of
    /// [`at`](Self::at).
    pub fn reaches(&self, stamp_ns: i64) -> bool {
        // Before the first sample two of them are needed to carry the motion back.
        let (Some((first, last)), n) = (self.span(), self.samples.len()) else { return false };
        last >= stamp_ns && (first <= stamp_ns || n > 1)
    }

    /// Drops what is not needed for times at or after this one.
    pub fn forget_before(&mut self, stamp_ns: i64) {
        // Two samples before it stay: they carry the motion on where nothing follows.
        while self.samples.get(2).is_some_and(|s| s.0 <= stamp_ns) {
            self.samples.pop_front();
        }
    }

    /// First and last time, nanoseconds.
    pub fn span(&self) -> Option<(i64, i64)> {
        Some((self.samples.front()?.0, self.samples.back()?.0))
    }

    /// The pose at a time: linear in position and angle between its neighbours, carried on at constant velocity for at
    /// most 0.1 s past the ends; `None` in gaps longer than 2 s and beyond.
    pub fn at(&self, stamp_ns: i64) -> Option<Pose> {
        let after = self.samples.partition_point(|s| s.0 < stamp_ns);
        let neighbours = |i: usize| Some((self.samples.get(i.checked_sub(1)?)?, self.samples.get(i)?));
        match self.samples.get(after) {
            Some(s) if s.0 == stamp_ns => return Some(s.1),
            Some(_) if after > 0 => {
                let (a, b) = neighbours(after)?;
                if within(a.0, b.0, MAX_GAP_NS) {
                    return Some(between(a, b, stamp_ns));
                }
            }
            _ => {}
        }
        // Before the first sample, after the last, or inside a gap: the nearer side carries on.
        let side = |nearest: usize, pair: usize| {
            let sample = self.samples.get(nearest)?;
            let near = within(sample.0, stamp_ns, MAX_EXTRAPOLATION_NS);
            let carried = neighbours(pair).filter(|(a, b)| within(a.0, b.0, MAX_GAP_NS));
            near.then(|| carried.map_or(sample.1, |(a, b)| between(a, b, stamp_ns)))
        };
        let before = after.checked_sub(1);
        let to_before = before.and_then(|i| self.samples.get(i)).map(|s| s.0.abs_diff(stamp_ns));
        let to_after = self.samples.get(after).map(|s| s.0.abs_diff(stamp_ns));
        match (to_before, to_after) {
            (Some(p), Some(q)) if p > q => side(after, after + 1),
            (Some(_), _) => side(before?, before?),
            (None, _) => side(after, after + 1),
        }
    }
}

fn within(a: i64, b: i64, limit: i64) -> bool {
    a.abs_diff(b) <= limit.unsigned_abs()
}

/// The motion from `a` to `b` at a time in between, or carried on outside.
fn between(a: &(i64, Pose), b: &(i64, Pose), stamp_ns: i64) -> Pose {
    let u = (stamp_ns as i128 - a.0 as i128) as f64 / (b.0 as i128 - a.0 as i128) as f64;
    let t = a.1.translation.vector.lerp(&b.1.translation.vector, u);
    let turn = a.1.rotation.rotation_to(&b.1.rotation);
    Pose::from_parts(Translation3::from(t), turn.powf(u) * a.1.rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    const MS: i64 = 1_000_000;

    fn pose(x: f64, yaw: f64) -> Pose {
        Pose::new(Vector3::new(x, 0.0, 0.0), Vector3::z() * yaw)
    }

    fn track(samples: &[(i64, f64, f64)]) -> Track {
        let mut track = Track::new(100);
        for &(t, x, yaw) in samples {
            track.push(t * MS, pose(x, yaw));
        }
        track
    }

    fn assert_near(a: Option<Pose>, b: Pose) {
        let a = a.unwrap();
        assert!((a.translation.vector - b.translation.vector).norm() < 1e-12, "{a} {b}");
        assert!(a.rotation.angle_to(&b.rotation) < 1e-7, "{a} {b}");
    }

    #[test]
    fn interpolates_position_and_angle() {
        let t = track(&[(0, 0.0, 0.0), (1000, 4.0, 0.4)]);
        assert_near(t.at(0), pose(0.0, 0.0));
        assert_near(t.at(250 * MS), pose(1.0, 0.1));
        assert_near(t.at(1000 * MS), pose(4.0, 0.4));
    }

    #[test]
    fn the_short_way_round() {
        let t = track(&[(0, 0.0, 3.0), (1000, 0.0, -3.0)]);
        let turned = t.at(500 * MS).unwrap().rotation;
        assert!(
            turned.angle_to(&UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI))
                < 1e-7
        );
    }

    #[test]
    fn carries_on_for_one_sweep_only() {
        let t = track(&[(0, 0.0, 0.0), (100, 1.0, 0.0), (200, 2.0, 0.0)]);
        assert_near(t.at(-50 * MS), pose(-0.5, 0.0));
        assert_near(t.at(300 * MS), pose(3.0, 0.0));
        assert!(t.at(301 * MS).is_none());
        assert!(t.at(-101 * MS).is_none());
        // A single sample stands still.
        assert_near(track(&[(0, 7.0, 0.1)]).at(60 * MS), pose(7.0, 0.1));
        assert!(Track::new(5).at(0).is_none());
    }

    #[test]
    fn gaps_stay_gaps() {
        let t = track(&[(0, 0.0, 0.0), (1000, 1.0, 0.0), (4000, 9.0, 0.0), (5000, 10.0, 0.0)]);
        assert!(t.at(2500 * MS).is_none());
        assert_near(t.at(1050 * MS), pose(1.05, 0.0));
        assert_near(t.at(3950 * MS), pose(8.95, 0.0));
    }

    #[test]
    fn order_of_arrival_does_not_matter_and_memory_is_bounded() {
        let mut t = track(&[(200, 2.0, 0.0), (0, 0.0, 0.0), (100, 5.0, 0.0), (100, 1.0, 0.0)]);
        assert_near(t.at(150 * MS), pose(1.5, 0.0));
        t.forget_before(150 * MS);
        assert_near(t.at(150 * MS), pose(1.5, 0.0));
        for i in 3..10_000 {
            t.push(i * 100 * MS, pose(i as f64, 0.0));
        }
        assert_eq!(t.samples.len(), 100);
        t.forget_before(i64::MAX);
        assert_eq!(t.samples.len(), 2);
    }

    #[test]
    fn appended_samples_settle_in_order() {
        let mut t = Track::new(5);
        for (ms, x) in [(200, 2.0), (0, 0.0), (100, 5.0), (300, 3.0), (100, 1.0), (900, 9.0)] {
            t.append(ms * MS, pose(x, 0.0));
        }
        assert!(t.overran());
        t.settle();
        let same = track(&[(0, 0.0, 0.0), (100, 1.0, 0.0), (200, 2.0, 0.0), (300, 3.0, 0.0)]);
        assert_eq!(t.samples, same.samples);
        assert!(!same.overran());
    }

    #[test]
    fn extreme_times_do_not_overflow() {
        let mut t = Track::new(5);
        t.push(i64::MIN, pose(0.0, 0.0));
        t.push(i64::MAX, pose(1.0, 0.0));
        assert!(t.at(0).is_none());
        assert!(t.reaches(i64::MAX));
    }
}

//! [`Trajectory`]: poses over time.

use esm_core::Pose;

/// Stamps this far outside the first and last pose still count as inside, seconds: stamps are stored in nanoseconds by
/// some formats and in decimal seconds by others.
const STAMP_SLACK_S: f64 = 1e-3;
/// Nothing is interpolated between poses farther apart in time than this, seconds, ...
const MAX_GAP_S: f64 = 2.0;
/// ... or than this many times their usual (median) spacing, whichever is more: some truths are sparse throughout.
const MAX_GAP_SPACINGS: f64 = 3.0;

/// Poses ordered by time.
#[derive(Clone, Debug)]
pub struct Trajectory {
    poses: Vec<(f64, Pose)>,
    /// Longest time between two poses that is interpolated, seconds.
    max_gap_s: f64,
}

impl Trajectory {
    /// From stamped poses in any order; where a stamp occurs twice the first pose counts.
    pub fn new(mut poses: Vec<(f64, Pose)>) -> Self {
        poses.retain(|(stamp, _)| stamp.is_finite());
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        poses.dedup_by(|later, first| later.0 == first.0);
        let mut spacings: Vec<f64> = poses.windows(2).map(|p| p[1].0 - p[0].0).collect();
        spacings.sort_by(f64::total_cmp);
        let median = spacings.get(spacings.len().saturating_sub(1) / 2).copied().unwrap_or_default();
        Self { poses, max_gap_s: MAX_GAP_S.max(MAX_GAP_SPACINGS * median) }
    }

    /// The pose at a time: the position linearly, the turn spherically between the two poses around it. `None` outside
    /// the first and the last pose and in a gap between two: more than 2 s, and more than 3 times the usual spacing.
    pub fn at(&self, stamp: f64) -> Option<Pose> {
        let after = self.poses.partition_point(|(s, _)| *s <= stamp);
        match (after.checked_sub(1).map(|i| self.poses[i]), self.poses.get(after)) {
            (Some((s0, p0)), Some((s1, p1))) if s1 - s0 > self.max_gap_s => {
                if stamp - s0 <= STAMP_SLACK_S {
                    Some(p0)
                } else {
                    (s1 - stamp <= STAMP_SLACK_S).then_some(*p1)
                }
            }
            (Some((s0, p0)), Some((s1, p1))) => {
                let share = (stamp - s0) / (s1 - s0);
                // Opposite turns have no one way between them: then the nearer of the two.
                let nearer = if share < 0.5 { p0 } else { *p1 };
                Some(p0.try_lerp_slerp(p1, share, 1e-9).unwrap_or(nearer))
            }
            (Some((last, pose)), None) => (stamp - last <= STAMP_SLACK_S).then_some(pose),
            (None, Some((first, pose))) => (first - stamp <= STAMP_SLACK_S).then_some(*pose),
            (None, None) => None,
        }
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.poses.len()
    }

    /// Whether there is no pose.
    pub fn is_empty(&self) -> bool {
        self.poses.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn quarter_turn() -> Trajectory {
        let end = Pose::new(Vector3::new(10.0, 0.0, 0.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
        Trajectory::new(vec![(110.0, end), (100.0, Pose::identity())])
    }

    #[test]
    fn between_two_poses_both_position_and_turn_are_interpolated() {
        let pose = quarter_turn().at(103.0).unwrap();
        assert!((pose.translation.x - 3.0).abs() < 1e-9);
        assert!((pose.rotation.angle() - 0.3 * std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn at_a_pose_it_is_that_pose() {
        assert_eq!(quarter_turn().at(100.0).unwrap(), Pose::identity());
        assert!((quarter_turn().at(110.0).unwrap().translation.x - 10.0).abs() < 1e-12);
    }

    /// A metre a second, a pose every `spacing_s` from 0 to 100 s but between 20 and 60 s.
    fn with_gap(spacing_s: f64) -> Trajectory {
        let stamps = (0..).map(|i| f64::from(i) * spacing_s).take_while(|t| *t <= 100.0);
        let poses = stamps.filter(|t| *t <= 20.0 || *t >= 60.0);
        Trajectory::new(poses.map(|t| (t, Pose::translation(t, 0.0, 0.0))).collect())
    }

    #[test]
    fn gaps_are_not_interpolated() {
        for spacing_s in [0.25, 2.0, 10.0] {
            let t = with_gap(spacing_s);
            for stamp in [20.1, 40.0, 59.9] {
                assert!(t.at(stamp).is_none(), "{stamp} of {spacing_s}");
            }
            for stamp in [1.1, 20.0, 60.0, 71.3] {
                assert!((t.at(stamp).unwrap().translation.x - stamp).abs() < 1e-9, "{stamp} of {spacing_s}");
            }
            assert_eq!(t.at(20.0005).unwrap().translation.x, 20.0, "rounding of stamps is forgiven");
            assert_eq!(t.at(59.9995).unwrap().translation.x, 60.0, "rounding of stamps is forgiven");
        }
        assert!(with_gap(20.0).at(40.0).is_some(), "twice the usual spacing is no gap");
    }

    #[test]
    fn outside_there_is_no_truth() {
        let t = quarter_turn();
        assert!(t.at(99.9).is_none() && t.at(110.1).is_none());
        assert!(t.at(110.0005).is_some(), "rounding of stamps is forgiven");
        assert!(t.at(f64::NAN).is_none());
        assert!(Trajectory::new(Vec::new()).at(0.0).is_none());
    }
}

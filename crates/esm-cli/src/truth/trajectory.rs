//! [`Trajectory`]: poses over time.

use esm_core::Pose;

/// Stamps this far outside the first and last pose still count as inside, seconds: stamps are stored in nanoseconds by
/// some formats and in decimal seconds by others.
const STAMP_SLACK_S: f64 = 1e-3;

/// Poses ordered by time.
#[derive(Clone, Debug)]
pub struct Trajectory {
    poses: Vec<(f64, Pose)>,
}

impl Trajectory {
    /// From stamped poses in any order; where a stamp occurs twice the first pose counts.
    pub fn new(mut poses: Vec<(f64, Pose)>) -> Self {
        poses.retain(|(stamp, _)| stamp.is_finite());
        poses.sort_by(|a, b| a.0.total_cmp(&b.0));
        poses.dedup_by(|later, first| later.0 == first.0);
        Self { poses }
    }

    /// The pose at a time: the position linearly, the turn spherically between the two poses around it. `None` outside
    /// the first and the last pose.
    pub fn at(&self, stamp: f64) -> Option<Pose> {
        let after = self.poses.partition_point(|(s, _)| *s <= stamp);
        match (after.checked_sub(1).map(|i| self.poses[i]), self.poses.get(after)) {
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

    #[test]
    fn outside_there_is_no_truth() {
        let t = quarter_turn();
        assert!(t.at(99.9).is_none() && t.at(110.1).is_none());
        assert!(t.at(110.0005).is_some(), "rounding of stamps is forgiven");
        assert!(t.at(f64::NAN).is_none());
        assert!(Trajectory::new(Vec::new()).at(0.0).is_none());
    }
}

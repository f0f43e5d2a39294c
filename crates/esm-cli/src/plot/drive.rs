//! [`Drive`]: where every cloud of a run belongs in the picture.

use esm_core::{Localization, Pose, Verdict};

use crate::truth::Judgement;

/// What was said about a cloud, as far as a picture can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Found {
    NotLocated,
    Ambiguous,
    Located,
    False,
}

/// One cloud in the picture.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    /// x and y in the map frame, metres.
    pub(crate) at: [f64; 2],
    pub(crate) found: Found,
    /// Where a false pose says it is.
    pub(crate) claimed: Option<[f64; 2]>,
    /// Centroids of the matched map segments.
    pub(crate) matched: Vec<[f64; 2]>,
    /// Starts a new line: it does not follow the place before.
    pub(crate) starts: bool,
}

struct Cloud {
    stretch: usize,
    pose_odom_sensor: Option<Pose>,
    /// Where it is for sure: the truth, or a located pose.
    known: Option<Pose>,
    found: Found,
    claimed: Option<[f64; 2]>,
    matched: Vec<[f64; 2]>,
}

/// Gathers the clouds of a run.
#[derive(Default)]
pub(crate) struct Drive {
    clouds: Vec<Cloud>,
}

impl Drive {
    /// Adds the next cloud. `stretch` numbers the unbroken parts of the odometry.
    pub(crate) fn push(
        &mut self,
        result: &Localization,
        stretch: usize,
        pose_odom_sensor: Option<Pose>,
        judgement: Option<&Judgement>,
    ) {
        let wrong = judgement.and_then(|j| j.is_correct(result.verdict)) == Some(false);
        let found = match result.verdict {
            Verdict::Located if wrong => Found::False,
            Verdict::Located => Found::Located,
            Verdict::Ambiguous => Found::Ambiguous,
            Verdict::NotFound => Found::NotLocated,
        };
        let located = result.pose_map_sensor.filter(|_| result.verdict == Verdict::Located);
        let truth = judgement.and_then(|j| j.truth);
        self.clouds.push(Cloud {
            stretch,
            pose_odom_sensor,
            known: truth.or(located.filter(|_| !wrong)),
            found,
            claimed: located.filter(|_| wrong).map(|p| flat(&p)),
            matched: match found {
                Found::Located => {
                    result.matches.iter().map(|m| [m.map_centroid_map[0], m.map_centroid_map[1]]).collect()
                }
                _ => Vec::new(),
            },
        });
    }

    /// The clouds that have a place: known ones there, the others by the odometry from the nearest known one of the same
    /// stretch.
    pub(crate) fn places(&self) -> Vec<Place> {
        let mut last: Option<usize> = None;
        let placed = self.clouds.iter().enumerate().filter_map(|(i, cloud)| Some((i, cloud, self.place(i)?)));
        placed
            .map(|(i, cloud, at)| {
                let follows = last.is_some_and(|l| l + 1 == i && self.clouds[l].stretch == cloud.stretch);
                last = Some(i);
                Place {
                    at,
                    found: cloud.found,
                    claimed: cloud.claimed,
                    matched: cloud.matched.clone(),
                    starts: !follows,
                }
            })
            .collect()
    }

    /// Clouds that nothing places.
    pub(crate) fn unplaced(&self) -> usize {
        (0..self.clouds.len()).filter(|&i| self.place(i).is_none()).count()
    }

    fn place(&self, index: usize) -> Option<[f64; 2]> {
        let cloud = &self.clouds[index];
        if let Some(pose) = &cloud.known {
            return Some(flat(pose));
        }
        let pose_odom_sensor = cloud.pose_odom_sensor?;
        let anchors = |c: &&Cloud| c.known.is_some() && c.pose_odom_sensor.is_some();
        let same = |c: &&Cloud| c.stretch == cloud.stretch;
        let before = self.clouds[..index].iter().rev().take_while(same).position(|c| anchors(&c));
        let after = self.clouds[index + 1..].iter().take_while(same).position(|c| anchors(&c));
        let anchor = match (before, after) {
            (Some(b), Some(a)) if a < b => index + 1 + a,
            (Some(b), _) => index - 1 - b,
            (None, Some(a)) => index + 1 + a,
            (None, None) => return None,
        };
        let anchor = &self.clouds[anchor];
        let pose_map_odom = anchor.known? * anchor.pose_odom_sensor?.inverse();
        Some(flat(&(pose_map_odom * pose_odom_sensor)))
    }
}

fn flat(pose: &Pose) -> [f64; 2] {
    [pose.translation.x, pose.translation.y]
}

#[cfg(test)]
mod tests {
    use esm_core::Timings;

    use super::*;

    fn result(verdict: Verdict, x: f64) -> Localization {
        Localization {
            stamp: 0.0,
            verdict,
            reason: None,
            pose_map_sensor: (verdict == Verdict::Located).then(|| Pose::translation(x, 0.0, 0.0)),
            covariance: None,
            travel_m: 0.0,
            segments: 0,
            described: 0,
            inliers: 0,
            score: 0.0,
            overlap: 0.0,
            seen: 0.0,
            free_space_violated: 0.0,
            runner_up: 0.0,
            runner_up_pose_map_sensor: None,
            matches: Vec::new(),
            timings: Timings::default(),
        }
    }

    #[test]
    fn what_was_not_located_is_placed_by_the_odometry_of_its_own_stretch() {
        let mut drive = Drive::default();
        let odom = |x: f64| Some(Pose::translation(x, 0.0, 0.0));
        drive.push(&result(Verdict::NotFound, 0.0), 0, odom(0.0), None);
        drive.push(&result(Verdict::Located, 102.0), 0, odom(2.0), None);
        drive.push(&result(Verdict::NotFound, 0.0), 0, odom(5.0), None);
        drive.push(&result(Verdict::NotFound, 0.0), 1, odom(5.0), None);
        drive.push(&result(Verdict::NotFound, 0.0), 1, None, None);
        let places = drive.places();
        let xs: Vec<f64> = places.iter().map(|p| p.at[0]).collect();
        assert_eq!(xs, [100.0, 102.0, 105.0]);
        assert_eq!(places.iter().map(|p| p.starts).collect::<Vec<_>>(), [true, false, false]);
        assert_eq!(drive.unplaced(), 2);
    }

    #[test]
    fn a_false_pose_is_drawn_where_the_robot_was_and_points_to_where_it_claims_to_be() {
        let mut drive = Drive::default();
        let judgement = Judgement {
            truth: Some(Pose::translation(7.0, 0.0, 0.0)),
            localizable: Some(true),
            error: Some(crate::truth::PoseError { m: 93.0, deg: 0.0 }),
        };
        drive.push(&result(Verdict::Located, 100.0), 0, None, Some(&judgement));
        let place = &drive.places()[0];
        assert_eq!((place.at[0], place.found, place.claimed), (7.0, Found::False, Some([100.0, 0.0])));
    }
}

//! From verified places to a verdict: is the best one to be believed, and is it the only one?

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::cloud::Pose;
use crate::estimate::{Candidate, Support};
use crate::localization::Verdict;
use crate::verify::{Verified, VerifyConfig};

/// A place with its evidence, after verification. Its pose is relative to the map's origin.
pub(crate) struct Place {
    pub(crate) pose_map_sensor: Pose,
    pub(crate) support: Support,
    pub(crate) verified: Verified,
}

impl Place {
    /// Matched segments, weighted by the share of points that are really there.
    pub(crate) fn score(&self) -> f64 {
        self.support.inliers.len() as f64 * self.verified.overlap
    }
}

/// Copies of a place lie at most this far apart, metres and radians: what a mapping drive that returned was off by.
const COPY_M: f64 = 5.0;
const COPY_RAD: f64 = 0.1;
/// Share of a copy's matches that may lie where the best place has matches of its own.
const COPY_SHARED: f64 = 0.3;
/// A copy with more than this share of the best place's score is a rival all the same: which of the two is meant by a
/// pose in this map can't be told.
const COPY_MAX_SCORE: f64 = 0.8;

/// What is to be said about a cloud.
pub(crate) struct Judged<'a> {
    pub(crate) verdict: Verdict,
    pub(crate) reason: Option<String>,
    /// Of the best place.
    pub(crate) covariance: Option<Matrix6<f64>>,
    /// The best other place.
    pub(crate) runner_up: Option<&'a Place>,
}

/// Judges the places of a cloud, best first.
pub(crate) fn judge<'a>(places: &'a [Place], candidates: &[Candidate], config: &VerifyConfig) -> Judged<'a> {
    let runner_up = places.get(1);
    let mut judged = Judged { verdict: Verdict::NotFound, reason: None, covariance: None, runner_up };
    let Some(best) = places.first() else { return judged };
    judged.covariance = best.verified.refined.covariance;
    judged.reason = doubt(best, config);
    if judged.reason.is_some() {
        return judged;
    }
    judged.verdict = Verdict::Located;
    let is_copy = |other: &&Place| is_copy(best, other, candidates);
    let rival = |other: &&Place| !(is_copy(other) && other.score() <= COPY_MAX_SCORE * best.score());
    if let Some(rival) = places[1..].iter().find(rival)
        && rival.score() > config.max_runner_up * best.score()
    {
        judged.verdict = Verdict::Ambiguous;
        judged.reason = Some(format!(
            "another place scores {:.1} against {:.1}: verify.max_runner_up = {}",
            rival.score(),
            best.score(),
            config.max_runner_up
        ));
    }
    if let Some(copy) = runner_up.filter(is_copy) {
        judged.covariance = judged.covariance.map(|c| c + disagreement(best, copy));
    }
    judged
}

/// Why the best place is not to be believed, if so.
fn doubt(best: &Place, c: &VerifyConfig) -> Option<String> {
    let (inliers, v) = (best.support.inliers.len(), &best.verified);
    if inliers < c.min_inliers {
        Some(format!("{inliers} consistent matches: verify.min_inliers = {}", c.min_inliers))
    } else if v.seen < c.min_seen {
        Some(format!("{:.0} % of the cloud lies where the map is empty", 100.0 * (1.0 - v.seen)))
    } else if v.overlap < c.min_overlap {
        Some(format!(
            "{:.0} % of the points fit the map: verify.min_overlap = {}",
            100.0 * v.overlap,
            c.min_overlap
        ))
    } else if best.score() < c.min_score {
        Some(format!("score {:.1}: verify.min_score = {}", best.score(), c.min_score))
    } else if v.refined.covariance.is_none() {
        Some("the points do not fix a pose".to_owned())
    } else {
        None
    }
}

/// Whether the map holds one place twice, a little apart, because the drive that made it came back with some error.
///
/// Then every live segment has two counterparts side by side. Where a place only looks like the next one, as a row of
/// trees does one tree further on, the other pose matches the same map segments with their neighbours: there its
/// matches lie where the best pose has matches too.
fn is_copy(best: &Place, other: &Place, candidates: &[Candidate]) -> bool {
    let apart = (best.pose_map_sensor.translation.vector - other.pose_map_sensor.translation.vector).norm();
    let turned = best.pose_map_sensor.rotation.angle_to(&other.pose_map_sensor.rotation);
    if apart > COPY_M || turned > COPY_RAD {
        return false;
    }
    let at = |place: &Place| -> Vec<Vector3<f32>> {
        place.support.inliers.iter().map(|i| Vector3::from(candidates[*i as usize].pair.map)).collect()
    };
    let (mine, near) = (at(best), (apart / 2.0) as f32);
    let theirs = at(other);
    let shared = theirs.iter().filter(|t| mine.iter().any(|m| (*m - **t).norm() < near)).count();
    (shared as f64) < COPY_SHARED * theirs.len() as f64
}

/// What the distance to a copy adds to the covariance: the variance of a choice between the two by their scores.
fn disagreement(best: &Place, copy: &Place) -> Matrix6<f64> {
    let chance = copy.score() / (best.score() + copy.score());
    let offset = best.pose_map_sensor.inverse_transform_vector(
        &(copy.pose_map_sensor.translation.vector - best.pose_map_sensor.translation.vector),
    );
    let mut covariance = Matrix6::zeros();
    let block: Matrix3<f64> = offset * offset.transpose() * chance;
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&block);
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Pair;
    use crate::verify::Refined;

    /// Live segments on a grid of `pitch` metres with their counterparts, and again `offset` beside them.
    fn twice(n: i32, pitch: f32, offset: f32) -> (Vec<Candidate>, Vec<Place>) {
        let mut candidates = Vec::new();
        let mut inliers = [Vec::new(), Vec::new()];
        for i in 0..n * n {
            let live = [(i % n) as f32 * pitch, (i / n) as f32 * pitch, 0.0];
            for (copy, inliers) in inliers.iter_mut().enumerate() {
                inliers.push(candidates.len() as u32);
                let map = [live[0] + copy as f32 * offset, live[1], 0.0];
                let (live_index, map_index) = (i as u32, (2 * i) as u32 + copy as u32);
                let pair = Pair { live, map };
                candidates.push(Candidate {
                    live: live_index,
                    map: map_index,
                    distance: 0.0,
                    quality: 1.0,
                    pair,
                });
            }
        }
        let [first, mut second] = inliers;
        second.truncate(second.len() * 7 / 10);
        let place = |x: f32, inliers: Vec<u32>| Place {
            pose_map_sensor: Pose::translation(f64::from(x), 0.0, 0.0),
            support: Support { weight: inliers.len() as f64, inliers },
            verified: Verified {
                refined: Refined {
                    pose_map_sensor: Pose::translation(f64::from(x), 0.0, 0.0),
                    covariance: Some(Matrix6::identity() * 1e-4),
                    residual: 1.0,
                },
                overlap: 1.0,
                seen: 1.0,
            },
        };
        (candidates, vec![place(0.0, first), place(offset, second)])
    }

    #[test]
    fn a_place_that_the_map_holds_twice_is_no_rival_but_widens_the_covariance() {
        let (candidates, places) = twice(5, 7.0, 2.1);
        let judged = judge(&places, &candidates, &VerifyConfig::default());
        assert_eq!(judged.verdict, Verdict::Located);
        let sigma = judged.covariance.unwrap()[(0, 0)].sqrt();
        assert!((1.0..2.0).contains(&sigma), "{sigma}");
    }

    #[test]
    fn a_row_of_trees_one_further_on_is_a_rival() {
        let (candidates, places) = twice(5, 3.0, 3.0);
        let judged = judge(&places, &candidates, &VerifyConfig::default());
        assert_eq!(judged.verdict, Verdict::Ambiguous);
        assert!(judged.reason.unwrap().contains("verify.max_runner_up"));
    }
}

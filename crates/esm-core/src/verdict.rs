//! From verified places to a verdict: is the best one to be believed, and is it the only one?

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::cloud::Pose;
use crate::estimate::{Candidate, Support};
use crate::localization::Verdict;
use crate::verify::{Verified, VerifyConfig, chance_false};

/// A place with its evidence, after verification. Its pose is relative to the map's origin.
pub(crate) struct Place {
    pub(crate) pose_map_sensor: Pose,
    pub(crate) support: Support,
    pub(crate) verified: Verified,
    /// Centroids of the map segments that are matched there, metres.
    pub(crate) at: Vec<Vector3<f32>>,
    /// Matched segments, weighted by the share of points that are really there.
    pub(crate) score: f64,
}

impl Place {
    /// A place that matches speak for.
    pub(crate) fn new(support: Support, verified: Verified, candidates: &[Candidate]) -> Self {
        let at: Vec<_> =
            support.inliers.iter().map(|i| Vector3::from(candidates[*i as usize].pair.map)).collect();
        let score = at.len() as f64 * verified.overlap;
        Self { pose_map_sensor: verified.refined.pose_map_sensor, support, verified, at, score }
    }

    /// The same place a step further on, where the map repeats `share` of what is matched here.
    pub(crate) fn shifted(
        &self,
        step: Vector3<f32>,
        share: f64,
        support: Support,
        verified: Verified,
    ) -> Self {
        let at = self.at.iter().map(|p| p + step).collect();
        let score = (self.at.len() as f64 * share * verified.overlap).min(self.score);
        Self { pose_map_sensor: verified.refined.pose_map_sensor, support, verified, at, score }
    }

    /// That the best place of a cloud with this evidence is a false one, 0 to 1.
    pub(crate) fn chance_false(&self) -> f64 {
        chance_false(self.support.inliers.len(), self.verified.overlap)
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
pub(crate) struct Judged {
    pub(crate) verdict: Verdict,
    pub(crate) reason: Option<String>,
    /// The place that is meant.
    pub(crate) best: Option<usize>,
    /// Of that place.
    pub(crate) covariance: Option<Matrix6<f64>>,
    /// The best other place.
    pub(crate) runner_up: Option<usize>,
}

impl Judged {
    /// The same, but nothing is believed.
    pub(crate) fn disbelieved(self, reason: &str) -> Self {
        Self { verdict: Verdict::NotFound, reason: Some(reason.to_owned()), covariance: None, ..self }
    }
}

/// Judges the places of a cloud, best first.
pub(crate) fn judge(places: &[Place], config: &VerifyConfig) -> Judged {
    let runner_up = (places.len() > 1).then_some(1);
    let mut judged =
        Judged { verdict: Verdict::NotFound, reason: None, best: None, covariance: None, runner_up };
    let Some(best) = places.first() else { return judged };
    judged.best = Some(0);
    judged.reason = doubt(best, config);
    if judged.reason.is_some() {
        return judged;
    }
    judged.verdict = Verdict::Located;
    judged.covariance = covariance(0, places);
    if let Some(rival) = rival(0, places)
        && rival.score > config.max_runner_up * best.score
    {
        judged.verdict = Verdict::Ambiguous;
        judged.reason = Some(format!(
            "another place scores {:.1} against {:.1}: verify.max_runner_up = {}",
            rival.score, best.score, config.max_runner_up
        ));
    }
    judged
}

/// The best place that a cloud at `meant` may be mistaken for.
pub(crate) fn rival(meant: usize, places: &[Place]) -> Option<&Place> {
    let best = &places[meant];
    let others = places.iter().enumerate().filter(|(i, _)| *i != meant).map(|(_, p)| p);
    others
        .filter(|p| !(is_copy(best, p) && p.score <= COPY_MAX_SCORE * best.score))
        .max_by(|a, b| a.score.total_cmp(&b.score))
}

/// The covariance of a place; that of its copies in the map included.
pub(crate) fn covariance(meant: usize, places: &[Place]) -> Option<Matrix6<f64>> {
    let best = &places[meant];
    let others = places.iter().enumerate().filter(|(i, _)| *i != meant).map(|(_, p)| p);
    let copies = others.filter(|p| is_copy(best, p));
    let spread: Matrix6<f64> = copies.map(|p| disagreement(best, p)).sum();
    best.verified.refined.covariance.map(|c| c + spread)
}

/// Why a place is not to be believed, if so.
fn doubt(place: &Place, c: &VerifyConfig) -> Option<String> {
    let v = &place.verified;
    let per_thousand = 1000.0 * place.chance_false();
    if v.seen < c.min_seen {
        Some(format!("{:.0} % of the cloud lies where the map is empty", 100.0 * (1.0 - v.seen)))
    } else if per_thousand > c.max_false_per_thousand {
        Some(format!(
            "{} consistent matches and {:.0} % of the points fit, which {per_thousand:.2} false places in a thousand clouds do \
             too: verify.max_false_per_thousand = {}",
            place.support.inliers.len(),
            100.0 * v.overlap,
            c.max_false_per_thousand
        ))
    } else if v.free_space_violated > c.max_free_space_violated {
        Some(format!(
            "{:.0} % of the rays pass through what the map holds as solid: verify.max_free_space_violated = {}",
            100.0 * v.free_space_violated,
            c.max_free_space_violated
        ))
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
fn is_copy(best: &Place, other: &Place) -> bool {
    let apart = (best.pose_map_sensor.translation.vector - other.pose_map_sensor.translation.vector).norm();
    let turned = best.pose_map_sensor.rotation.angle_to(&other.pose_map_sensor.rotation);
    if apart > COPY_M || turned > COPY_RAD {
        return false;
    }
    let near = (apart / 2.0) as f32;
    let shared = other.at.iter().filter(|t| best.at.iter().any(|m| (*m - **t).norm() < near)).count();
    (shared as f64) < COPY_SHARED * other.at.len() as f64
}

/// What the distance to a copy adds to the covariance: the variance of a choice between the two by their scores.
fn disagreement(best: &Place, copy: &Place) -> Matrix6<f64> {
    let chance = copy.score / (best.score + copy.score);
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
    fn twice(n: i32, pitch: f32, offset: f32) -> Vec<Place> {
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
                    turns: u64::MAX,
                });
            }
        }
        let [first, mut second] = inliers;
        second.truncate(second.len() * 7 / 10);
        let place = |x: f32, inliers: Vec<u32>| {
            let pose_map_sensor = Pose::translation(f64::from(x), 0.0, 0.0);
            let covariance = Some(Matrix6::identity() * 1e-4);
            let refined = Refined { pose_map_sensor, covariance, residual: 1.0 };
            let support = Support { weight: inliers.len() as f64, inliers };
            Place::new(
                support,
                Verified { refined, overlap: 1.0, seen: 1.0, free_space_violated: 0.0 },
                &candidates,
            )
        };
        vec![place(0.0, first), place(offset, second)]
    }

    #[test]
    fn a_place_that_the_map_holds_twice_is_no_rival_but_widens_the_covariance() {
        let places = twice(5, 7.0, 2.1);
        let judged = judge(&places, &VerifyConfig::default());
        assert_eq!(judged.verdict, Verdict::Located);
        let sigma = judged.covariance.unwrap()[(0, 0)].sqrt();
        assert!((1.0..2.0).contains(&sigma), "{sigma}");
    }

    #[test]
    fn a_place_that_is_seen_through_is_not_believed_where_asked_for() {
        let mut places = twice(5, 7.0, 2.1);
        places[0].verified.free_space_violated = 0.3;
        assert_eq!(judge(&places, &VerifyConfig::default()).verdict, Verdict::Located, "unless asked for");
        let strict = VerifyConfig { max_free_space_violated: 0.15, ..VerifyConfig::default() };
        let judged = judge(&places, &strict);
        assert_eq!(judged.verdict, Verdict::NotFound);
        assert!(judged.reason.unwrap().contains("30 % of the rays"));
    }

    #[test]
    fn a_row_of_trees_one_further_on_is_a_rival() {
        let places = twice(5, 3.0, 3.0);
        let judged = judge(&places, &VerifyConfig::default());
        assert_eq!(judged.verdict, Verdict::Ambiguous);
        assert!(judged.reason.unwrap().contains("verify.max_runner_up"));
    }
}

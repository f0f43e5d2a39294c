//! [`Localizer`]: the pipeline on one page.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::Vector3;

use crate::accumulate::LiveCloud;
use crate::budget::Budget;
use crate::cloud::Pose;
use crate::config::Config;
use crate::describe::{self, Descriptions, Descriptor};
use crate::error::Error;
use crate::estimate::{Candidate, Consensus, Hypothesis, NearCentroids, compare_extents, same_place, search};
use crate::index::Index;
use crate::localization::{Localization, MatchedSegment, Timings, Verdict};
use crate::map::Map;
use crate::matching::{MatchConfig, candidates, judged, leading};
use crate::segment::{Segment, Segmentation, segment};
use crate::verdict::{Judged, Place, judge};
use crate::verify::{LivePoints, Shifts, Surroundings, approach, rate, rays, settle, verify, weigh};

/// Places with less than this share of the best one's score are no rivals (`verify.max_runner_up` is twice that by default).
const WORTH_SETTLING: f64 = 0.25;

/// Finds live clouds in a prior map. Every cloud stands for itself: nothing is kept from one to the next (but how long it took, where
/// there is a [budget](crate::BudgetConfig)).
pub struct Localizer {
    map: Arc<Map>,
    descriptor: Arc<dyn Descriptor>,
    index: Index,
    surroundings: Surroundings,
    shifts: Shifts,
    budget: Budget,
    config: Config,
}

/// A cloud that was looked for, before the verdict.
pub(crate) struct Look {
    pub(crate) cloud: Segmentation,
    /// Of its segments, the first so many were described.
    described: usize,
    pub(crate) candidates: Vec<Candidate>,
    /// Best first, relative to the map's origin.
    pub(crate) places: Vec<Place>,
    timings: Timings,
}

impl Localizer {
    /// A localizer for a map, which must hold the configured descriptor.
    ///
    /// # Errors
    /// [`Error::Config`], [`Error::DescriptorMismatch`].
    pub fn new(map: Arc<Map>, config: &Config) -> Result<Self, Error> {
        Self::with_descriptor(map, config, describe::by_name(&config.descriptor)?)
    }

    /// The same with a descriptor of your own in the place of the configured one: the one the map was built with.
    ///
    /// # Errors
    /// [`Error::Config`], [`Error::DescriptorMismatch`].
    pub fn with_descriptor(
        map: Arc<Map>,
        config: &Config,
        descriptor: Arc<dyn Descriptor>,
    ) -> Result<Self, Error> {
        config.check()?;
        map.check_descriptor(&*descriptor)?;
        let (dim, searched) = (descriptor.dim(), descriptor.searched());
        let index = Index::new(&leading(map.descriptors(), dim, searched), searched, config.matching.search);
        let surroundings = Surroundings::new(Arc::clone(&map), config.accumulate.max_range_m);
        let shifts = Shifts::new(&map);
        let matching = config.matching.of(&*descriptor)?;
        Ok(Self {
            map,
            descriptor,
            index,
            surroundings,
            shifts,
            budget: Budget::new(&config.budget),
            config: Config { matching, ..config.clone() },
        })
    }

    /// The map in use.
    pub fn map(&self) -> &Arc<Map> {
        &self.map
    }

    /// Finds the cloud in the map: segment, describe, match, estimate, verify (paper, section III).
    ///
    /// # Errors
    /// [`Error::MapFile`] where points of the map that are needed turn out to be damaged.
    pub fn localize(&self, live: &LiveCloud) -> Result<Localization, Error> {
        let look = self.look(live, &[])?;
        let judged = judge(&look.places, &self.config.verify);
        Ok(self.answer(live, look, judged))
    }

    /// Everything up to the verdict. Besides the places that the matches speak for, those of `expected_map_sensor` are
    /// verified.
    pub(crate) fn look(&self, live: &LiveCloud, expected_map_sensor: &[Pose]) -> Result<Look, Error> {
        let mut clock = Clock::new(live.elapsed);
        let mut cloud = segment(&live.cloud, &self.config.segment);
        clock.lap(|t| &mut t.segmentation);
        let described = self.describe(&mut cloud.segments, || clock.elapsed());
        clock.lap(|t| &mut t.descriptor);
        clock.split_preprocessing(described.preprocessing);
        let count = described.quality.len();
        let (mut candidates, judging) = self.candidates(&cloud.segments[..count], &described);
        clock.lap(|t| &mut t.matching);
        clock.timings.judging = judging;
        let mapped = self.map.segments();
        compare_extents(&mut candidates, &cloud.segments, |m| mapped[m as usize].extent, &self.config.pose);
        let mut hypotheses = search(&candidates, &self.config.pose, self.config.seed).places;
        clock.lap(|t| &mut t.pose);
        let mut consensus = NearCentroids::new(&candidates, self.config.pose.inlier_m as f32, 0.0);
        hypotheses.extend(expected_map_sensor.iter().map(|pose_map_sensor| {
            let pose_map_sensor = self.to_origin_frame(pose_map_sensor);
            Hypothesis { pose_map_sensor, support: consensus.support(&pose_map_sensor) }
        }));
        let points =
            LivePoints::new(&cloud, &self.config.verify).with_rays(rays(live, self.config.verify.rays));
        let places = self.verify(&points, &candidates, hypotheses)?;
        clock.lap(|t| &mut t.verification);
        let timings = clock.timings;
        self.budget.note(timings.matching + timings.pose + timings.verification);
        Ok(Look { cloud, described: count, candidates, places, timings })
    }

    /// The first segments, those that there is time for, on the map's scale.
    fn describe(&self, segments: &mut [Segment], elapsed: impl Fn() -> Duration) -> Descriptions {
        let mut described = self.budget.describe(&*self.descriptor, segments, elapsed);
        if let Some(standardizer) = self.map.standardizer() {
            standardizer.apply(&mut described.values);
        }
        described
    }

    /// The candidates of the search, judged where the descriptor has someone to; and the time that took.
    fn candidates(&self, segments: &[Segment], described: &Descriptions) -> (Vec<Candidate>, Duration) {
        let config = &self.config.matching;
        let Some(judge) = self.descriptor.judge() else {
            return (candidates(segments, described, &self.map, &self.index, config), Duration::ZERO);
        };
        // The limit is for what the pose search gets.
        let all = MatchConfig { max_candidates: usize::MAX, ..config.clone() };
        let found = candidates(segments, described, &self.map, &self.index, &all);
        let start = Instant::now();
        let kept = judged(found, judge, described, &self.map, config.max_candidates);
        (kept, start.elapsed())
    }

    /// Refines each place on points and counts its support again; places that come to coincide are one. Best first.
    fn verify(
        &self,
        live: &LivePoints,
        candidates: &[Candidate],
        hypotheses: Vec<Hypothesis>,
    ) -> Result<Vec<Place>, Error> {
        let config = &self.config.pose;
        let mut consensus = NearCentroids::new(candidates, config.inlier_m as f32, 0.0);
        let mut near = Vec::with_capacity(hypotheses.len());
        for hypothesis in hypotheses {
            let at = hypothesis.pose_map_sensor.translation.vector.map(|v| v as f32);
            let surface = self.surroundings.surface([at.x, at.y, at.z])?;
            let pose_map_sensor = approach(&surface, live.all(), &hypothesis.pose_map_sensor);
            let verified = weigh(&surface, live, rate(&surface, live.all(), &pose_map_sensor));
            near.push((surface, Place::new(consensus.support(&pose_map_sensor), verified, candidates)));
        }
        let best = near.iter().map(|(_, p)| p.score).fold(0.0, f64::max);
        let mut places: Vec<Place> = Vec::new();
        for (surface, mut place) in near {
            // What is far behind stays so: no need to know to the centimetre where it is.
            if place.score >= WORTH_SETTLING * best {
                let verified = weigh(&surface, live, settle(&surface, live.all(), &place.pose_map_sensor));
                let support = consensus.support(&verified.refined.pose_map_sensor);
                place = Place::new(support, verified, candidates);
            }
            let twin =
                |p: &&mut Place| same_place(&p.pose_map_sensor, &place.pose_map_sensor, config.distinct_m);
            match places.iter_mut().find(twin) {
                Some(known) if known.score < place.score => *known = place,
                Some(_) => {}
                None => places.push(place),
            }
        }
        if let Some(twin) = self.twin(&places, candidates, live, &mut consensus)? {
            let at = twin.pose_map_sensor;
            match places.iter_mut().find(|p| same_place(&p.pose_map_sensor, &at, config.distinct_m)) {
                Some(known) => known.score = known.score.max(twin.score),
                None => places.push(twin),
            }
        }
        places.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(places)
    }

    /// The best place a step further on, where the map repeats itself so that it could be meant as well.
    fn twin(
        &self,
        places: &[Place],
        candidates: &[Candidate],
        live: &LivePoints,
        consensus: &mut NearCentroids<'_>,
    ) -> Result<Option<Place>, Error> {
        let least = self.config.verify.max_runner_up;
        let Some(best) = places.iter().max_by(|a, b| a.score.total_cmp(&b.score)) else { return Ok(None) };
        let mapped: Vec<u32> = best.support.inliers.iter().map(|i| candidates[*i as usize].map).collect();
        let Some(shift) = self.shifts.best(&self.map, &mapped, self.config.pose.distinct_m) else {
            return Ok(None);
        };
        if shift.share < least {
            return Ok(None);
        }
        let step = Vector3::from(shift.step);
        let mut pose = best.pose_map_sensor;
        pose.translation.vector += step.cast::<f64>();
        let at = pose.translation.vector.cast::<f32>();
        let verified = verify(&self.surroundings.surface([at.x, at.y, at.z])?, live, &pose);
        if same_place(&verified.refined.pose_map_sensor, &best.pose_map_sensor, self.config.pose.distinct_m) {
            return Ok(None);
        }
        let support = consensus.support(&verified.refined.pose_map_sensor);
        Ok(Some(best.shifted(step, shift.share, support, verified)))
    }

    /// What is said about the cloud once it is judged.
    pub(crate) fn answer(&self, live: &LiveCloud, look: Look, judged: Judged) -> Localization {
        let Look { cloud, described, candidates, places, timings } = look;
        let runner_up = judged.runner_up.map(|i| &places[i]);
        let mut answer = Localization {
            stamp: live.stamp,
            verdict: judged.verdict,
            reason: judged.reason,
            pose_map_sensor: None,
            covariance: None,
            travel_m: live.travel_m,
            segments: cloud.segments.len(),
            described,
            inliers: 0,
            score: 0.0,
            overlap: 0.0,
            seen: 0.0,
            free_space_violated: 0.0,
            runner_up: runner_up.map_or(0.0, |p| p.score),
            runner_up_pose_map_sensor: runner_up.map(|p| self.to_map_frame(&p.pose_map_sensor)),
            matches: Vec::new(),
            timings,
        };
        let Some(best) = judged.best.map(|i| &places[i]) else {
            answer.reason = Some(self.nothing_found(&cloud, described));
            return answer;
        };
        (answer.inliers, answer.score) = (best.support.inliers.len(), best.score);
        (answer.overlap, answer.seen) = (best.verified.overlap, best.verified.seen);
        answer.free_space_violated = best.verified.free_space_violated;
        if answer.verdict != Verdict::NotFound {
            answer.pose_map_sensor = Some(self.to_map_frame(&best.pose_map_sensor));
            let motion = self.config.odometry.covariance(live);
            answer.covariance = judged.covariance.map(|c| c + motion).map(|c| {
                let mut rows = [0.0; 36];
                (0..36).for_each(|i| rows[i] = c[(i / 6, i % 6)]);
                rows
            });
            answer.matches = self.matches(&candidates, best);
        }
        answer
    }

    fn nothing_found(&self, cloud: &Segmentation, described: usize) -> String {
        match cloud.segments.len() {
            0 if cloud.voxelled == 0 => "the cloud is empty".to_owned(),
            0 => "no segments in the cloud".to_owned(),
            n if n > described => format!(
                "no {} of the {described} segments that budget.ms left of {n} agree on a place",
                self.config.pose.min_inliers
            ),
            n => format!("no {} of the {n} segments agree on a place", self.config.pose.min_inliers),
        }
    }

    fn matches(&self, candidates: &[Candidate], place: &Place) -> Vec<MatchedSegment> {
        let origin = self.map.origin();
        place
            .support
            .inliers
            .iter()
            .map(|i| {
                let c = &candidates[*i as usize];
                let m = c.pair.map;
                MatchedSegment {
                    live: c.live as usize,
                    map: c.map as usize,
                    live_centroid_sensor: c.pair.live,
                    map_centroid_map: [0, 1, 2].map(|a| origin[a] + f64::from(m[a])),
                }
            })
            .collect()
    }

    pub(crate) fn to_map_frame(&self, pose_origin_sensor: &Pose) -> Pose {
        let o = self.map.origin();
        Pose::translation(o[0], o[1], o[2]) * pose_origin_sensor
    }

    fn to_origin_frame(&self, pose_map_sensor: &Pose) -> Pose {
        let o = self.map.origin();
        Pose::translation(-o[0], -o[1], -o[2]) * pose_map_sensor
    }

    /// The configuration in use.
    pub(crate) fn config(&self) -> &Config {
        &self.config
    }
}

/// Measures the stages one after the other.
struct Clock {
    timings: Timings,
    last: Instant,
}

impl Clock {
    fn new(accumulation: Duration) -> Self {
        Self { timings: Timings { accumulation, ..Timings::default() }, last: Instant::now() }
    }

    /// Since the newest sweep came.
    fn elapsed(&self) -> Duration {
        self.timings.total() + self.last.elapsed()
    }

    fn lap(&mut self, stage: impl Fn(&mut Timings) -> &mut Duration) {
        let now = Instant::now();
        *stage(&mut self.timings) = now - self.last;
        self.last = now;
    }

    /// Takes the preparation out of the time of the descriptor.
    fn split_preprocessing(&mut self, preprocessing: Duration) {
        self.timings.preprocessing = preprocessing;
        self.timings.descriptor = self.timings.descriptor.saturating_sub(preprocessing);
    }
}

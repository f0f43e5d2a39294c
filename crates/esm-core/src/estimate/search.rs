//! The pose search: candidate matches in, a few distinct places with their support out.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::candidate::Candidate;
use super::clique::max_clique;
use super::consensus::{Consensus, NearCentroids, Support};
use super::consistency::{Agreement, ConsistencyGraph};
use super::rigid::{Estimator, FourDof, Pair, SixDof, vector};
use super::sampler::{Prosac, Ransac, Sampler};
use crate::cloud::{Pose, transform_point};
use crate::error::{Error, require};

/// How the best group of consistent matches is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// PROSAC: samples in the order of quality (the paper's).
    Prosac,
    /// RANSAC: uniform samples, for comparison.
    Ransac,
    /// The maximum clique of the consistency graph: no sampling, no luck.
    #[default]
    Clique,
}

/// Configuration of the pose search.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseConfig {
    /// How the best group of consistent matches is found.
    pub method: Method,
    /// Two matches agree when their lengths in live cloud and map differ by at most this, metres. (SegMatch: 0.4 m,
    /// SegMap: 0.6 m.)
    pub resolution_m: f64,
    /// A match supports a pose when its centroids lie this near, metres.
    pub inlier_m: f64,
    /// Whether the live z axis points up but for `max_tilt_deg`: two matches then fix a pose instead of three.
    pub gravity: bool,
    /// Largest tilt of the live z axis against the map's, degrees (with `gravity`).
    pub max_tilt_deg: f64,
    /// Matches that a place must have to be considered at all.
    pub min_inliers: usize,
    /// Distinct places that are passed on to verification.
    pub hypotheses: usize,
    /// Places nearer than this to each other, metres, are one place.
    pub distinct_m: f64,
    /// Chance that a candidate agrees with a wrong pose (PROSAC's beta).
    pub beta: f64,
    /// Most samples drawn for one place (PROSAC and RANSAC).
    pub max_draws: usize,
    /// Most branches visited for one place (clique).
    pub max_branches: usize,
}

impl Default for PoseConfig {
    fn default() -> Self {
        Self {
            method: Method::default(),
            resolution_m: 0.5,
            inlier_m: 0.8,
            gravity: true,
            max_tilt_deg: 6.0,
            min_inliers: 4,
            hypotheses: 4,
            distinct_m: 2.0,
            beta: 0.01,
            max_draws: 100_000,
            max_branches: 20_000,
        }
    }
}

impl PoseConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        require(positive(self.resolution_m), "pose.resolution_m", self.resolution_m, "more than 0 m")?;
        require(positive(self.inlier_m), "pose.inlier_m", self.inlier_m, "more than 0 m")?;
        require(
            (0.0..=45.0).contains(&self.max_tilt_deg),
            "pose.max_tilt_deg",
            self.max_tilt_deg,
            "0 to 45 deg",
        )?;
        require(self.min_inliers >= 3, "pose.min_inliers", self.min_inliers, "3 or more")?;
        require((1..=64).contains(&self.hypotheses), "pose.hypotheses", self.hypotheses, "1 to 64")?;
        require(positive(self.distinct_m), "pose.distinct_m", self.distinct_m, "more than 0 m")?;
        require(self.beta > 0.0 && self.beta < 1.0, "pose.beta", self.beta, "between 0 and 1")?;
        require(self.max_draws >= 1, "pose.max_draws", self.max_draws, "1 or more")
    }

    fn agreement(&self) -> Agreement {
        Agreement {
            resolution_m: self.resolution_m as f32,
            max_tilt_rad: self.gravity.then(|| self.max_tilt_deg.to_radians() as f32),
        }
    }
}

/// A place the cloud may have been taken at.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Pose of the live sensor in the map.
    pub pose_map_sensor: Pose,
    /// The matches that agree with it.
    pub support: Support,
}

/// The distinct places with the most support, best first. `candidates` must be sorted best first.
pub fn search(candidates: &[Candidate], config: &PoseConfig, seed: u64) -> Vec<Hypothesis> {
    let graph = ConsistencyGraph::new(candidates, config.agreement());
    // A group of s matches that all agree lies in the (s-1)-core: what is outside cannot support a place.
    let cores = graph.cores();
    let mut allowed: Vec<bool> =
        cores.numbers.iter().map(|c| *c as usize + 1 >= config.min_inliers).collect();
    let mut places: Vec<Hypothesis> = Vec::new();
    // Groups that settle on a known place, or on none, are spent without a gain: the effort on them is bounded too.
    for _ in 0..2 * config.hypotheses {
        if places.len() == config.hypotheses {
            break;
        }
        let pool: Vec<u32> = (0..candidates.len() as u32).filter(|v| allowed[*v as usize]).collect();
        if pool.len() < config.min_inliers {
            break;
        }
        let group = match config.method {
            Method::Clique => {
                max_clique(&graph, &cores, &allowed, config.min_inliers - 1, config.max_branches).members
            }
            Method::Prosac | Method::Ransac => sampled_group(candidates, &graph, &pool, config, seed),
        };
        if group.len() < config.min_inliers {
            break;
        }
        // Whatever comes of the group, it is not looked at again.
        group.iter().for_each(|v| allowed[*v as usize] = false);
        let Some(place) = settle(candidates, &group, config) else { continue };
        let near = |other: &Hypothesis| {
            same_place(&other.pose_map_sensor, &place.pose_map_sensor, config.distinct_m)
        };
        let known = places.iter().any(near);
        withdraw(&mut allowed, candidates, &place.pose_map_sensor, config.distinct_m);
        if !known && place.support.inliers.len() >= config.min_inliers {
            places.push(place);
        }
    }
    places.sort_by(|a, b| {
        let key = |h: &Hypothesis| (h.support.inliers.len(), h.support.weight);
        key(b).partial_cmp(&key(a)).unwrap_or(std::cmp::Ordering::Equal)
    });
    places
}

/// Whether two poses are one place for all that matters here.
pub fn same_place(a: &Pose, b: &Pose, distinct_m: f64) -> bool {
    (a.translation.vector - b.translation.vector).norm() < distinct_m
        && a.rotation.angle_to(&b.rotation) < 0.3
}

fn tilt(config: &PoseConfig) -> f32 {
    if config.gravity { config.max_tilt_deg.to_radians() as f32 } else { 0.0 }
}

/// Every match that a found place explains is spent: what is left speaks for other places only.
fn withdraw(allowed: &mut [bool], candidates: &[Candidate], pose_map_sensor: &Pose, reach_m: f64) {
    for (spent, c) in allowed.iter_mut().zip(candidates) {
        let at = vector(transform_point(pose_map_sensor, c.pair.live));
        *spent &= (at - vector(c.pair.map)).norm() > reach_m;
    }
}

/// Fits a pose to a group, gathers all matches that agree with it, and fits again until nothing changes.
fn settle(candidates: &[Candidate], group: &[u32], config: &PoseConfig) -> Option<Hypothesis> {
    const ROUNDS: usize = 4;
    let mut consensus = NearCentroids::new(candidates, config.inlier_m as f32, 0.0);
    let mut best: Option<Hypothesis> = None;
    let mut members = group.to_vec();
    for _ in 0..ROUNDS {
        let pose_map_sensor = fit(candidates, &members, config)?;
        let support = consensus.support(&pose_map_sensor);
        let better = best.as_ref().is_none_or(|b| support.beats(&b.support));
        if !better {
            break;
        }
        members.clone_from(&support.inliers);
        best = Some(Hypothesis { pose_map_sensor, support });
        if members.len() < config.min_inliers {
            break;
        }
    }
    best
}

/// Six degrees where the matches fix them and the tilt is plausible, else four where gravity is known.
fn fit(candidates: &[Candidate], members: &[u32], config: &PoseConfig) -> Option<Pose> {
    let pairs: Vec<Pair> = members.iter().map(|v| candidates[*v as usize].pair).collect();
    let six = SixDof.estimate(&pairs);
    if !config.gravity {
        return six;
    }
    let upright = |p: &Pose| {
        let up = p.rotation * Vector3::z();
        up.z.clamp(-1.0, 1.0).acos() <= config.max_tilt_deg.to_radians()
    };
    six.filter(upright).or_else(|| FourDof.estimate(&pairs))
}

/// The best supported sample of the pool.
fn sampled_group(
    candidates: &[Candidate],
    graph: &ConsistencyGraph,
    pool: &[u32],
    config: &PoseConfig,
    seed: u64,
) -> Vec<u32> {
    let members: Vec<Candidate> = pool.iter().map(|v| candidates[*v as usize]).collect();
    let estimator: &dyn Estimator = if config.gravity { &FourDof } else { &SixDof };
    let m = estimator.sample_size();
    let mut sampler: Box<dyn Sampler> = match config.method {
        Method::Ransac => Box::new(Ransac::new(pool.len(), m, config.max_draws, seed)),
        _ => Box::new(Prosac::new(pool.len(), m, config.beta, config.max_draws, seed)),
    };
    let mut consensus = NearCentroids::new(&members, config.inlier_m as f32, tilt(config));
    let possible = |sample: &[usize]| {
        sample.iter().enumerate().all(|(i, a)| sample[..i].iter().all(|b| graph.agree(pool[*a], pool[*b])))
    };
    let best = best_sample(&mut *sampler, estimator, &mut consensus, &members, &possible);
    best.inliers.iter().map(|i| pool[*i as usize]).collect()
}

/// Draws, rejects what is impossible, fits, counts, and keeps the best: Sampler x Estimator x Consensus.
pub fn best_sample(
    sampler: &mut dyn Sampler,
    estimator: &dyn Estimator,
    consensus: &mut dyn Consensus,
    candidates: &[Candidate],
    possible: &dyn Fn(&[usize]) -> bool,
) -> Support {
    let mut sample = vec![0; estimator.sample_size()];
    let mut pairs = Vec::with_capacity(sample.len());
    let mut best = Support::default();
    while sampler.draw(&mut sample) {
        if !possible(&sample) {
            continue;
        }
        pairs.clear();
        pairs.extend(sample.iter().map(|i| candidates[*i].pair));
        let Some(pose) = estimator.estimate(&pairs) else { continue };
        let support = consensus.support(&pose);
        if support.beats(&best) {
            let mut inlier = vec![false; candidates.len()];
            support.inliers.iter().for_each(|i| inlier[*i as usize] = true);
            sampler.observe(&inlier);
            best = support;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::sort_by_quality;

    /// 40 live segments, of which every second is in the map where `pose` puts it; each has 20 candidates, mostly
    /// wrong ones scattered over a square kilometre.
    fn scene(pose: &Pose) -> Vec<Candidate> {
        let mut state = 12345u64;
        let mut random = move |scale: f32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 40) as f32 / (1u64 << 24) as f32 - 0.5) * scale
        };
        let mut candidates = Vec::new();
        for live in 0..40u32 {
            let at = [random(80.0), random(80.0), random(4.0)];
            for k in 0..20u32 {
                let right = k == live % 20 && live % 2 == 0;
                let map = if right {
                    transform_point(pose, [at[0] + random(0.2), at[1] + random(0.2), at[2] + random(0.2)])
                } else {
                    [random(1000.0), random(1000.0), random(4.0)]
                };
                let pair = Pair { live: at, map };
                candidates.push(Candidate {
                    live,
                    map: live * 20 + k,
                    distance: k as f32,
                    quality: 1.0,
                    pair,
                });
            }
        }
        sort_by_quality(&mut candidates);
        candidates
    }

    #[test]
    fn every_method_finds_the_place() {
        let pose = Pose::new(Vector3::new(120.0, -300.0, 1.0), Vector3::new(0.02, -0.01, 2.0));
        let candidates = scene(&pose);
        for method in [Method::Clique, Method::Prosac, Method::Ransac] {
            for gravity in [true, false] {
                let config = PoseConfig { method, gravity, ..Default::default() };
                let places = search(&candidates, &config, 3);
                assert!(!places.is_empty(), "{method:?}");
                let best = &places[0];
                assert!(best.support.inliers.len() >= 20, "{method:?} {}", best.support.inliers.len());
                assert!(same_place(&best.pose_map_sensor, &pose, 0.3), "{method:?}");
                assert_eq!(places, search(&candidates, &config, 3));
            }
        }
    }

    #[test]
    fn no_candidates_no_places() {
        assert!(search(&[], &PoseConfig::default(), 0).is_empty());
    }
}

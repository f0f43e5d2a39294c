//! The pose search: candidate matches in, a few distinct places with their support out.

use super::beta::measured_beta;
use super::candidate::Candidate;
use super::clique::Cliques;
use super::config::{Method, PoseConfig};
use super::consensus::NearCentroids;
use super::consistency::ConsistencyGraph;
use super::groups::largest_group;
use super::rigid::vector;
use super::sampled::{put_in_order, sampled_group};
use super::settle::{Hypothesis, same_place, settle};
use super::stats::SearchStats;
use super::turns::{anywhere, cores};
use crate::cloud::{Pose, transform_point};

/// What a pose search found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// The distinct places with the most support, best first.
    pub places: Vec<Hypothesis>,
    /// What it took.
    pub stats: SearchStats,
}

/// The distinct places with the most support, best first. `candidates` must be sorted best first
/// ([`sort_by_quality`](super::sort_by_quality)).
///
/// ```
/// use esm_core::estimate::{ANY_TURN, Candidate, Pair, PoseConfig, search};
/// // Five segments, each with the right match 10 m east of it and a wrong one.
/// let live = [[0.0, 0.0, 0.0], [9.0, 1.0, 0.5], [-4.0, 12.0, 1.0], [7.0, -8.0, 0.0], [-11.0, -3.0, 2.0]];
/// let candidates: Vec<Candidate> = (0..10)
///     .map(|i| {
///         let at: [f32; 3] = live[i % 5];
///         let map = if i < 5 { [at[0] + 10.0, at[1], at[2]] } else { [i as f32 * 31.0, at[1] * 7.0, at[2]] };
///         let pair = Pair { live: at, map };
///         Candidate { live: i as u32 % 5, map: i as u32, distance: 0.0, quality: 1.0, pair, turns: ANY_TURN }
///     })
///     .collect();
/// let found = search(&candidates, &PoseConfig::default(), 0);
/// assert_eq!(found.places[0].support.inliers, [0, 1, 2, 3, 4]);
/// assert!((found.places[0].pose_map_sensor.translation.x - 10.0).abs() < 1e-3);
/// ```
pub fn search(candidates: &[Candidate], config: &PoseConfig, seed: u64) -> Found {
    let graph = config.needs_graph().then(|| ConsistencyGraph::new(candidates, config.agreement()));
    search_with(graph.as_ref(), candidates, config, seed)
}

/// The same on a graph of the candidates that is there already.
pub fn search_in(
    graph: &ConsistencyGraph,
    candidates: &[Candidate],
    config: &PoseConfig,
    seed: u64,
) -> Found {
    search_with(Some(graph), candidates, config, seed)
}

fn search_with(
    graph: Option<&ConsistencyGraph>,
    candidates: &[Candidate],
    config: &PoseConfig,
    seed: u64,
) -> Found {
    let mut groups = Groups::new(graph, candidates, config, seed);
    let mut consensus = NearCentroids::new(candidates, config.inlier_m as f32, 0.0);
    let mut places: Vec<Hypothesis> = Vec::new();
    // Groups that settle on a known place, or on none, are spent without a gain: the effort on them is bounded too.
    for _ in 0..2 * config.hypotheses {
        if places.len() == config.hypotheses {
            break;
        }
        let group = groups.next();
        if group.len() < config.min_inliers {
            break;
        }
        // Whatever comes of the group, it is not looked at again.
        groups.spend(&group);
        let Some(place) = settle(candidates, &mut consensus, &group, config) else { continue };
        let near = |other: &Hypothesis| {
            same_place(&other.pose_map_sensor, &place.pose_map_sensor, config.distinct_m)
        };
        let known = places.iter().any(near);
        groups.withdraw(&place.pose_map_sensor);
        if !known && place.support.inliers.len() >= config.min_inliers {
            places.push(place);
        }
    }
    places.sort_by(|a, b| {
        let key = |h: &Hypothesis| (h.support.inliers.len(), h.support.weight);
        key(b).partial_cmp(&key(a)).unwrap_or(std::cmp::Ordering::Equal)
    });
    Found { places, stats: groups.stats }
}

/// The largest groups of consistent matches, one after the other, by the configured method.
struct Groups<'a> {
    /// Not needed by sampling without pruning.
    graph: Option<&'a ConsistencyGraph>,
    candidates: &'a [Candidate],
    config: &'a PoseConfig,
    seed: u64,
    /// By candidate: not spent yet.
    allowed: Vec<bool>,
    cliques: Option<Cliques<'a>>,
    stats: SearchStats,
}

impl<'a> Groups<'a> {
    fn new(
        graph: Option<&'a ConsistencyGraph>,
        candidates: &'a [Candidate],
        config: &'a PoseConfig,
        seed: u64,
    ) -> Self {
        let mut allowed = vec![true; candidates.len()];
        let (mut stats, mut cliques) = (SearchStats::default(), None);
        if let Some(graph) = graph {
            // A group of s matches that all agree lies in the (s-1)-core: what is outside cannot support a place.
            let turns = if config.prune { cores(graph, config.min_inliers) } else { anywhere(graph) };
            for (v, turns) in turns.iter().enumerate() {
                allowed[graph.candidate(v as u32) as usize] = *turns != 0;
            }
            (stats.pair_tests, stats.edges) = (graph.pair_tests(), graph.edges());
            cliques = (config.method == Method::Clique).then(|| Cliques::new(graph, turns));
        }
        stats.kept = allowed.iter().filter(|a| **a).count();
        Self { graph, candidates, config, seed, allowed, cliques, stats }
    }

    /// The next group, as candidate indices; one smaller than `min_inliers` where there is none left.
    fn next(&mut self) -> Vec<u32> {
        let config = self.config;
        self.stats.groups += 1;
        let first = self.stats.groups == 1;
        if let Some(cliques) = &mut self.cliques {
            let found = cliques.largest(&self.allowed, config.min_inliers - 1, config.max_branches);
            self.stats.branches += found.branches;
            self.stats.unproven += usize::from(!found.proven);
            if first {
                self.stats.first_branches = found.branches;
            }
            return found.members;
        }
        let mut pool: Vec<u32> =
            (0..self.candidates.len() as u32).filter(|c| self.allowed[*c as usize]).collect();
        if pool.len() < config.min_inliers {
            return Vec::new();
        }
        put_in_order(&mut pool, self.candidates, config.order);
        match (config.method, self.graph) {
            (Method::Plain, Some(graph)) => largest_group(graph, &pool),
            _ => self.sampled(&pool, first),
        }
    }

    fn sampled(&mut self, pool: &[u32], first: bool) -> Vec<u32> {
        let members: Vec<Candidate> = pool.iter().map(|c| self.candidates[*c as usize]).collect();
        if first && self.config.method == Method::Prosac {
            let given = self.config.beta;
            self.stats.beta =
                if given > 0.0 { given } else { measured_beta(&members, self.config, self.seed) };
        }
        let found = sampled_group(&members, self.config, self.stats.beta, self.seed);
        self.stats.samples += found.samples;
        self.stats.pair_tests += found.pair_tests;
        if first {
            self.stats.first_samples = found.samples;
        }
        let mut group: Vec<u32> = found.support.inliers.iter().map(|i| pool[*i as usize]).collect();
        group.sort_unstable();
        group
    }

    fn spend(&mut self, group: &[u32]) {
        for c in group {
            self.allowed[*c as usize] = false;
        }
    }

    /// Every match that a found place explains is spent: what is left speaks for other places only.
    fn withdraw(&mut self, pose_map_sensor: &Pose) {
        for (c, allowed) in self.candidates.iter().zip(&mut self.allowed).filter(|(_, allowed)| **allowed) {
            let at = vector(transform_point(pose_map_sensor, c.pair.live));
            *allowed = (at - vector(c.pair.map)).norm() > self.config.distinct_m;
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::estimate::{Pair, sort_by_quality};

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
                    turns: u64::MAX,
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
        for method in [Method::Clique, Method::Prosac, Method::Ransac, Method::Plain] {
            for (gravity, prune) in [(true, true), (false, true), (true, false)] {
                let config = PoseConfig { method, gravity, prune, ..Default::default() };
                let Found { places, .. } = search(&candidates, &config, 3);
                assert!(!places.is_empty(), "{method:?}");
                let best = &places[0];
                assert!(best.support.inliers.len() >= 20, "{method:?} {}", best.support.inliers.len());
                assert!(same_place(&best.pose_map_sensor, &pose, 0.3), "{method:?}");
                assert_eq!(places, search(&candidates, &config, 3).places);
            }
        }
    }

    #[test]
    fn no_candidates_no_places() {
        for method in [Method::Clique, Method::Prosac, Method::Ransac, Method::Plain] {
            let config = PoseConfig { method, ..Default::default() };
            assert!(search(&[], &config, 0).places.is_empty());
        }
    }
}

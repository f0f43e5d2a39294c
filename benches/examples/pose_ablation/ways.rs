//! The ways to search, and a run of one of them over a recording.

use std::sync::Arc;
use std::time::Instant;

use esm_core::describe::Descriptor;
use esm_core::estimate::{Method, Order, PoseConfig, compare_extents, search};
use esm_core::index::Index;
use esm_core::segment::segment;
use esm_core::{Config, Error, Localizer, Map, Pose, Verdict, matching};

use crate::recording::Recorded;

/// One way to search.
pub(crate) struct Way {
    pub(crate) name: &'static str,
    method: Method,
    order: Order,
    prune: bool,
}

/// Sampling from all matches, as the paper's, and from those that consistency leaves; groups and cliques.
pub(crate) fn all() -> Vec<Way> {
    let way = |name, method, order, prune| Way { name, method, order, prune };
    vec![
        way("RANSAC", Method::Ransac, Order::Quality, false),
        way("PROSAC by distance", Method::Prosac, Order::Distance, false),
        way("PROSAC by quality", Method::Prosac, Order::Quality, false),
        way("RANSAC in the cores", Method::Ransac, Order::Quality, true),
        way("PROSAC by distance in the cores", Method::Prosac, Order::Distance, true),
        way("PROSAC by quality in the cores", Method::Prosac, Order::Quality, true),
        way("plain groups by distance", Method::Plain, Order::Distance, true),
        way("plain groups by quality", Method::Plain, Order::Quality, true),
        way("clique", Method::Clique, Order::Quality, true),
    ]
}

/// What a way did with one cloud.
pub(crate) struct Outcome {
    /// Matches of the best place, and whether that is where the cloud was taken.
    pub(crate) inliers: usize,
    pub(crate) first_right: bool,
    /// Whether any place is.
    pub(crate) any_right: bool,
    pub(crate) verdict: Verdict,
    /// Of the pose that is reported, if any.
    pub(crate) verified_right: bool,
    /// Samples drawn or branches visited for the first place.
    pub(crate) effort: usize,
    pub(crate) matches: usize,
    pub(crate) pair_tests: u64,
    /// Pairs that agree, and matches that may belong to a place.
    pub(crate) edges: usize,
    pub(crate) kept: usize,
    pub(crate) ms: f64,
}

/// A way's outcomes, in the order of the clouds.
pub(crate) struct Row {
    pub(crate) candidates: &'static str,
    pub(crate) way: &'static str,
    pub(crate) outcomes: Vec<Outcome>,
}

pub(crate) fn run(
    candidates: &'static str,
    way: &Way,
    config: &Config,
    map: &Arc<Map>,
    descriptor: &Arc<dyn Descriptor>,
    clouds: &[Recorded],
) -> Result<Row, Error> {
    let mut config = config.clone();
    config.pose =
        PoseConfig { method: way.method, order: way.order, prune: way.prune, ..config.pose.clone() };
    let index = Index::new(map.descriptors(), descriptor.dim(), config.matching.search);
    let localizer = Localizer::with_descriptor(Arc::clone(map), &config, Arc::clone(descriptor))?;
    let origin = map.origin();
    let mut outcomes = Vec::with_capacity(clouds.len());
    for cloud in clouds {
        let segments = segment(&cloud.live.cloud, &config.segment).segments;
        let mut described = descriptor.describe(&segments);
        if let Some(standardizer) = map.standardizer() {
            standardizer.apply(&mut described.values);
        }
        let mut matches = matching::candidates(&segments, &described, map, &index, &config.matching);
        let start = Instant::now();
        compare_extents(&mut matches, &segments, |m| map.segments()[m as usize].extent, &config.pose);
        let found = search(&matches, &config.pose, config.seed);
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let right: Vec<bool> = found
            .places
            .iter()
            .map(|p| {
                cloud.is_right(&(Pose::translation(origin[0], origin[1], origin[2]) * p.pose_map_sensor))
            })
            .collect();
        let answer = localizer.localize(&cloud.live)?;
        outcomes.push(Outcome {
            inliers: found.places.first().map_or(0, |p| p.support.inliers.len()),
            first_right: right.first() == Some(&true),
            any_right: right.contains(&true),
            verdict: answer.verdict,
            verified_right: answer.pose_map_sensor.is_some_and(|p| cloud.is_right(&p)),
            effort: found.stats.first_samples + found.stats.first_branches,
            matches: matches.len(),
            pair_tests: found.stats.pair_tests,
            edges: found.stats.edges,
            kept: found.stats.kept,
            ms,
        });
    }
    Ok(Row { candidates, way: way.name, outcomes })
}

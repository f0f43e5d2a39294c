//! The recognizer that remembers beside the search that does not, cloud after cloud of a recording: the same places, and what
//! is saved.
//!
//! `incremental MAP.esm LIVE.mcap TRUTH.tum [--accumulate D] [--keep SHARE]`
//!
//! Both get the same candidates, in the frame of the odometry. A segment is the same as one of the cloud before where its
//! centroid is the nearest one, both ways, within half a metre. Fails where anything that was found differs but the number of
//! pair tests. With `--keep` a segment that has changed by no more than this share of its points since it was described, and
//! has moved by no more than a tenth of a metre, keeps that description, its matches and its centroid, as in SegMap. Prints a
//! Markdown table.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use esm_core::estimate::{Candidate, ConsistencyGraph, IncrementalRecognizer, Pair, search, sort_by_quality};
use esm_core::index::Index;
use esm_core::segment::{Segment, segment};
use esm_core::{Accumulator, Config, Map, Pose, describe, matching, transform_point};
use esm_io::{OpenOptions, Recording, Track, read_tum};

/// Farthest that a segment's centroid moves from cloud to cloud, metres.
const SAME_M: f32 = 0.5;

/// Farthest that a kept segment is from where it was described, metres.
const KEPT_M: f32 = 0.1;

/// A segment as it was when it was described.
#[derive(Clone)]
struct Described {
    points: usize,
    centroid: [f32; 3],
    matches: Vec<Candidate>,
}

/// Numbers that segments keep.
#[derive(Default)]
struct Identities {
    last: Vec<([f32; 3], u64)>,
    next: u64,
}

impl Identities {
    fn of(&mut self, centroids: &[[f32; 3]]) -> Vec<u64> {
        let squared = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>();
        let nearest = |at: &[f32; 3], among: &[[f32; 3]]| {
            (0..among.len()).min_by(|a, b| squared(at, &among[*a]).total_cmp(&squared(at, &among[*b])))
        };
        let old: Vec<[f32; 3]> = self.last.iter().map(|l| l.0).collect();
        let identities = centroids
            .iter()
            .enumerate()
            .map(|(i, at)| {
                let same = nearest(at, &old).filter(|o| {
                    squared(at, &old[*o]) <= SAME_M * SAME_M && nearest(&old[*o], centroids) == Some(i)
                });
                same.map_or_else(
                    || {
                        self.next += 1;
                        self.next
                    },
                    |o| self.last[o].1,
                )
            })
            .collect::<Vec<_>>();
        self.last = centroids.iter().copied().zip(identities.iter().copied()).collect();
        identities
    }
}

/// What one cloud took.
#[derive(Default)]
struct Row {
    matches: usize,
    segments: usize,
    segments_kept: f64,
    described: usize,
    right: bool,
    pairs: f64,
    edges: f64,
    matches_kept: f64,
    batch_tests: f64,
    fresh_tests: f64,
    repeated_tests: f64,
    batch_ms: f64,
    incremental_ms: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (mut paths, mut config, mut keep) = (Vec::<PathBuf>::new(), Config::default(), None::<f64>);
    let mut given = std::env::args().skip(1);
    while let Some(arg) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{arg} wants a value"));
        match arg.as_str() {
            "--accumulate" => config.accumulate.distance_m = value()?.parse()?,
            "--keep" => keep = Some(value()?.parse()?),
            path => paths.push(path.into()),
        }
    }
    let [map, live, truth] = paths.as_slice() else {
        return Err("usage: incremental MAP.esm LIVE.mcap TRUTH.tum [--accumulate D] [--keep SHARE]".into());
    };
    let mut track = Track::new(usize::MAX);
    for pose in read_tum(truth)? {
        track.push(pose.stamp_ns, pose.pose);
    }
    let map = Arc::new(Map::open(map)?);
    let descriptor = describe::by_name(&map.descriptor_info().name)?;
    let index = Index::new(map.descriptors(), descriptor.dim(), config.matching.search);
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let mut robot = IncrementalRecognizer::new(&config.pose, config.seed);
    let (mut identities, mut rows, mut seen) = (Identities::default(), Vec::new(), Vec::<u64>::new());
    let mut remembered = BTreeMap::<u64, Described>::new();
    for sweep in Recording::open(live, &OpenOptions::default())?.sweeps()? {
        let sweep = sweep?;
        let Some(cloud) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
            continue;
        };
        let pose_odom_sensor = cloud.pose_odom_sensor.ok_or("a cloud without odometry")?;
        let segments = segment(&cloud.cloud, &config.segment).segments;
        let centroids: Vec<_> =
            segments.iter().map(|s| transform_point(&pose_odom_sensor, s.centroid)).collect();
        let own = identities.of(&centroids);
        remembered.retain(|identity, _| own.contains(identity));
        let changed: Vec<usize> = (0..segments.len())
            .filter(|i| {
                let as_before = |d: &Described| {
                    let share = (segments[*i].points.len() as f64 / d.points as f64 - 1.0).abs();
                    let moved = (0..3).map(|a| (centroids[*i][a] - d.centroid[a]).powi(2)).sum::<f32>();
                    keep.is_some_and(|keep| share <= keep && moved <= KEPT_M * KEPT_M)
                };
                !remembered.get(&own[*i]).is_some_and(as_before)
            })
            .collect();
        let new: Vec<Segment> = changed.iter().map(|i| segments[*i].clone()).collect();
        let mut described = descriptor.describe(&new);
        if let Some(standardizer) = map.standardizer() {
            standardizer.apply(&mut described.values);
        }
        for i in &changed {
            let (points, centroid) = (segments[*i].points.len(), centroids[*i]);
            remembered.insert(own[*i], Described { points, centroid, matches: Vec::new() });
        }
        for c in matching::candidates(&new, &described, &map, &index, &config.matching) {
            if let Some(d) = remembered.get_mut(&own[changed[c.live as usize]]) {
                d.matches.push(c);
            }
        }
        let mut candidates = Vec::new();
        for (live, identity) in own.iter().enumerate() {
            let d = &remembered[identity];
            let at = d.centroid;
            candidates.extend(d.matches.iter().map(|c| Candidate {
                live: live as u32,
                pair: Pair { live: at, ..c.pair },
                ..*c
            }));
        }
        sort_by_quality(&mut candidates);

        let start = Instant::now();
        let graph = ConsistencyGraph::new(&candidates, config.pose.agreement());
        let batch_ms = start.elapsed().as_secs_f64() * 1e3;
        let mut again = robot.clone();
        let start = Instant::now();
        let same = again.graph(&candidates, &own);
        let incremental_ms = start.elapsed().as_secs_f64() * 1e3;
        let mut found = robot.search(&candidates, &own);
        let want = search(&candidates, &config.pose, config.seed);
        found.stats.pair_tests = want.stats.pair_tests;
        if !same.same_as(&graph) || found != want {
            return Err(format!("{}: not what the batch finds", cloud.stamp).into());
        }
        let reuse = robot.reuse();
        let share = |part: usize, of: usize| part as f64 / of.max(1) as f64;
        let kept = own.iter().filter(|i| seen.contains(i)).count();
        let origin = map.origin();
        let right = found.places.first().is_some_and(|p| {
            let pose_map_odom = Pose::translation(origin[0], origin[1], origin[2]) * p.pose_map_sensor;
            track.at(sweep.stamp_ns).is_some_and(|truth| {
                let off = truth.inv_mul(&(pose_map_odom * pose_odom_sensor));
                off.translation.vector.norm() <= 2.0 && off.rotation.angle().to_degrees() <= 5.0
            })
        });
        rows.push(Row {
            segments: segments.len(),
            described: changed.len(),
            right,
            pairs: reuse.pairs as f64,
            edges: graph.edges() as f64,
            matches: candidates.len(),
            segments_kept: share(kept, own.len()),
            matches_kept: share(reuse.kept, candidates.len()),
            batch_tests: want.stats.pair_tests as f64,
            fresh_tests: reuse.fresh_tests as f64,
            repeated_tests: reuse.repeated_tests as f64,
            batch_ms,
            incremental_ms,
        });
        seen = own;
    }
    let mean = |of: &dyn Fn(&Row) -> f64| rows.iter().map(of).sum::<f64>() / rows.len().max(1) as f64;
    writeln!(
        std::io::stdout(),
        "{} clouds, all with the same graph and the same places, the first of them right in {}\n\n\
         | segments | seen before | described | matches | kept | pairs that agree | remembered | pair tests, batch | fresh \
         | repeated | graph, batch, ms | incremental, ms |\n\
         |--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|\n\
         | {:.0} | {:.0} % | {:.0} | {:.0} | {:.0} % | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {:.2} | {:.2} |",
        rows.len(),
        rows.iter().filter(|r| r.right).count(),
        mean(&|r| r.segments as f64),
        100.0 * mean(&|r| r.segments_kept),
        mean(&|r| r.described as f64),
        mean(&|r| r.matches as f64),
        100.0 * mean(&|r| r.matches_kept),
        mean(&|r| r.edges),
        mean(&|r| r.pairs),
        mean(&|r| r.batch_tests),
        mean(&|r| r.fresh_tests),
        mean(&|r| r.repeated_tests),
        mean(&|r| r.batch_ms),
        mean(&|r| r.incremental_ms),
    )?;
    Ok(())
}

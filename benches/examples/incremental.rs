//! The recognizer that remembers beside the search that does not, cloud after cloud of a recording: the same places, and what
//! is saved.
//!
//! `incremental MAP.esm LIVE.mcap [--accumulate D] [--descriptor NAME]`
//!
//! Both get the same candidates, in the frame of the odometry. A segment is the same as one of the cloud before where its
//! centroid is the nearest one, both ways, within half a metre. Fails where anything that was found differs but the number of
//! pair tests. Prints a Markdown table.

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use esm_core::estimate::{Candidate, ConsistencyGraph, IncrementalRecognizer, Pair, search};
use esm_core::index::Index;
use esm_core::segment::segment;
use esm_core::{Accumulator, Config, Map, describe, matching, transform_point};
use esm_io::{OpenOptions, Recording};

/// Farthest that a segment's centroid moves from cloud to cloud, metres.
const SAME_M: f32 = 0.5;

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
    segments_kept: f64,
    matches_kept: f64,
    batch_tests: f64,
    fresh_tests: f64,
    repeated_tests: f64,
    batch_ms: f64,
    incremental_ms: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let (mut paths, mut config) = (Vec::<PathBuf>::new(), Config::default());
    let mut given = std::env::args().skip(1);
    while let Some(arg) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{arg} wants a value"));
        match arg.as_str() {
            "--accumulate" => config.accumulate.distance_m = value()?.parse()?,
            path => paths.push(path.into()),
        }
    }
    let [map, live] = paths.as_slice() else {
        return Err("usage: incremental MAP.esm LIVE.mcap [--accumulate D]".into());
    };
    let map = Arc::new(Map::open(map)?);
    let descriptor = describe::by_name(&map.descriptor_info().name)?;
    let index = Index::new(map.descriptors(), descriptor.dim(), config.matching.search);
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let mut robot = IncrementalRecognizer::new(&config.pose, config.seed);
    let (mut identities, mut rows, mut seen) = (Identities::default(), Vec::new(), Vec::<u64>::new());
    for sweep in Recording::open(live, &OpenOptions::default())?.sweeps()? {
        let sweep = sweep?;
        let Some(cloud) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
            continue;
        };
        let pose_odom_sensor = cloud.pose_odom_sensor.ok_or("a cloud without odometry")?;
        let segments = segment(&cloud.cloud, &config.segment).segments;
        let mut described = descriptor.describe(&segments);
        if let Some(standardizer) = map.standardizer() {
            standardizer.apply(&mut described.values);
        }
        let candidates: Vec<Candidate> =
            matching::candidates(&segments, &described, &map, &index, &config.matching)
                .into_iter()
                .map(|c| {
                    let live = transform_point(&pose_odom_sensor, c.pair.live);
                    Candidate { pair: Pair { live, ..c.pair }, ..c }
                })
                .collect();
        let centroids: Vec<_> =
            segments.iter().map(|s| transform_point(&pose_odom_sensor, s.centroid)).collect();
        let own = identities.of(&centroids);

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
        rows.push(Row {
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
        "{} clouds, all with the same graph and the same places\n\n\
         | matches | segments seen before | matches kept | pair tests, batch | fresh | repeated | graph, batch, ms | incremental, ms |\n\
         |--:|--:|--:|--:|--:|--:|--:|--:|\n\
         | {:.0} | {:.0} % | {:.0} % | {:.0} | {:.0} | {:.0} | {:.2} | {:.2} |",
        rows.len(),
        mean(&|r| r.matches as f64),
        100.0 * mean(&|r| r.segments_kept),
        100.0 * mean(&|r| r.matches_kept),
        mean(&|r| r.batch_tests),
        mean(&|r| r.fresh_tests),
        mean(&|r| r.repeated_tests),
        mean(&|r| r.batch_ms),
        mean(&|r| r.incremental_ms),
    )?;
    Ok(())
}

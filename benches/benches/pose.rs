//! The pose search on fixed candidates: 46 live segments with 25 candidates each (the paper's timing case) spread over maps
//! of 3,000, 30,000 and 300,000 segments, one in 25 square metres: the map grows in area. A third of the live segments have
//! their counterpart among the candidates. `dense` has 200 live segments with 25 candidates each on one hectare, as a dense
//! wood has. One thread, as all of the pose search.

#![allow(missing_docs)] // Criterion's macros.

use std::time::Duration;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use esm_core::estimate::{ANY_TURN, Candidate, Method, Pair, PoseConfig, search, sort_by_quality};
use esm_core::{Pose, transform_point};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const METHODS: [(&str, Method); 4] = [
    ("clique", Method::Clique),
    ("prosac", Method::Prosac),
    ("ransac", Method::Ransac),
    ("plain", Method::Plain),
];

/// Candidates of a cloud of 80 m across in a square map.
fn candidates(live: u32, k: u32, side: f32) -> Vec<Candidate> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut up_to = |most: f32| (random.next_u32() >> 8) as f32 / (1 << 24) as f32 * most;
    let middle = f64::from(side) / 2.0;
    let pose_map_sensor = Pose::new([middle, middle, 1.0].into(), [0.0, 0.0, 2.0].into());
    let mut all = Vec::new();
    for l in 0..live {
        let at = [up_to(80.0) - 40.0, up_to(80.0) - 40.0, up_to(4.0)];
        for i in 0..k {
            let map = if l % 3 == 0 && i == l % k {
                transform_point(&pose_map_sensor, at).map(|v| v + up_to(0.3) - 0.15)
            } else {
                [up_to(side), up_to(side), up_to(4.0)]
            };
            let (distance, quality) = (up_to(1.0), up_to(1.0));
            let pair = Pair { live: at, map };
            let map = l * k + i;
            all.push(Candidate { live: l, map, distance, quality, pair, turns: ANY_TURN });
        }
    }
    sort_by_quality(&mut all);
    all
}

fn pose(c: &mut Criterion) {
    let cases = [
        ("3 k", candidates(46, 25, 274.0)),
        ("30 k", candidates(46, 25, 866.0)),
        ("300 k", candidates(46, 25, 2739.0)),
        ("dense", candidates(200, 25, 100.0)),
    ];
    for (name, method) in METHODS {
        let mut group = c.benchmark_group(format!("pose, {name}"));
        group.sample_size(20);
        group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(800));
        for (map, candidates) in &cases {
            let config = PoseConfig { method, ..PoseConfig::default() };
            group.bench_function(BenchmarkId::from_parameter(map), |b| {
                b.iter(|| search(candidates, &config, 0))
            });
        }
        group.finish();
    }
}

criterion_group!(benches, pose);
criterion_main!(benches);

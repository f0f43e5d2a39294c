//! Refinement and verification of a place, on one core: a simulated street (preset `train-urban`, seed 100, a scale of 0.04), the cloud
//! of its last 20 m of live travel in the map of its first visit, from half a metre and two degrees beside the truth.

#![allow(missing_docs, clippy::unwrap_used)] // Criterion's macros; a benchmark may stop at the first error.

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, criterion_group, criterion_main};
use esm_core::segment::segment;
use esm_core::verify::{LivePoints, Surroundings, free_space_violated, rays, refine, verify};
use esm_core::{Accumulator, Config, LiveCloud, Map, MapBuilder, Pose};
use esm_io::{OpenOptions, Recording, read_tum};
use nalgebra::Vector3;

/// The map, the last live cloud and its true pose.
fn street() -> (Map, LiveCloud, Pose) {
    let folder = tempfile::tempdir().unwrap();
    let preset = esm_sim::preset("train-urban").unwrap();
    esm_sim::simulate(&preset, 100, 0.04, folder.path(), &mut |_| true).unwrap();
    let config = Config { descriptor: "shape".into(), ..Config::default() };
    let open = |name: &str| {
        let recording = Recording::open(folder.path().join(name), &OpenOptions::default()).unwrap();
        recording.sweeps().unwrap().map(Result::unwrap)
    };
    let truth = |name: &str| read_tum(folder.path().join(name)).unwrap();
    let mut builder = MapBuilder::new(&config).unwrap();
    for (sweep, pose) in open("map.mcap").zip(truth("map_truth.tum")) {
        builder.push_sweep(sweep.stamp, &sweep.cloud, &pose.pose).unwrap();
    }
    let mut accumulator = Accumulator::new(config.accumulate).unwrap();
    let live =
        open("live.mcap").filter_map(|s| accumulator.push(s.stamp, &s.cloud, s.pose_odom_sensor)).last();
    let map = builder.finish().unwrap();
    let o = map.origin();
    let pose_origin_sensor =
        Pose::translation(-o[0], -o[1], -o[2]) * truth("live_truth.tum").last().unwrap().pose;
    (map, live.unwrap(), pose_origin_sensor)
}

fn place(c: &mut Criterion) {
    let (map, live, truth) = street();
    let config = Config::default();
    let at = truth.translation.vector.map(|v| v as f32);
    let start = truth * Pose::new(Vector3::new(0.4, -0.3, 0.1), Vector3::new(0.005, -0.005, 0.035));
    let map = Arc::new(map);
    let reach_m = config.accumulate.max_range_m;
    let surroundings = Surroundings::new(Arc::clone(&map), reach_m);
    let surface = surroundings.surface(at.into()).unwrap();
    let cloud = segment(&live.cloud, &config.segment);
    let points = LivePoints::new(&cloud, &config.verify);
    let found = verify(&surface, &points, &start);
    let error = truth.inv_mul(&found.refined.pose_map_sensor);
    assert!(error.translation.vector.norm() < 0.5 && found.overlap > 0.7, "{error} {}", found.overlap);

    let mut group = c.benchmark_group("a place of 20 m of street");
    group.sample_size(20);
    group.bench_function("surface, tiles kept", |b| {
        b.iter(|| surroundings.surface(black_box(at.into())).unwrap())
    });
    group.bench_function("surface, tiles made", |b| {
        b.iter(|| Surroundings::new(Arc::clone(&map), reach_m).surface(black_box(at.into())).unwrap())
    });
    group.bench_function("sample", |b| b.iter(|| LivePoints::new(black_box(&cloud), &config.verify)));
    group.bench_function("refine", |b| b.iter(|| refine(&surface, points.all(), black_box(&start))));
    group.bench_function("verify (refine, overlap)", |b| {
        b.iter(|| verify(&surface, &points, black_box(&start)))
    });
    let sample = rays(&live, 600);
    group.bench_function("sample 600 rays", |b| b.iter(|| rays(black_box(&live), 600)));
    group.bench_function("free space, 600 rays", |b| {
        b.iter(|| free_space_violated(&surface, &sample, black_box(&truth)))
    });
    group.finish();
}

criterion_group!(benches, place);
criterion_main!(benches);

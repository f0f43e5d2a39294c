//! The stages of segmentation on a live cloud of 20 m of travel: a real one where the shared data is at hand, and a
//! made-up street.

#![allow(missing_docs, clippy::unwrap_used)] // Criterion's macros; a benchmark may stop at the first error.

use criterion::{Criterion, criterion_group, criterion_main};
use esm_benches::{kitti_map, live_cloud, objects, street};
use esm_core::PointCloud;
use esm_core::segment::{SegmentConfig, euclidean_clusters, ground_flags, segment, voxel_filter};

fn stages(c: &mut Criterion, name: &str, cloud: &PointCloud) {
    let config = SegmentConfig::default();
    let voxels = voxel_filter(cloud.points(), config.voxel);
    let objects = objects(cloud, &config);
    let mut group = c.benchmark_group(name);
    let title = |stage: &str, n: usize| format!("{stage}, {n} points");
    group.bench_function(title("voxels", cloud.len()), |b| {
        b.iter(|| voxel_filter(cloud.points(), config.voxel))
    });
    group.bench_function(title("ground", voxels.len()), |b| b.iter(|| ground_flags(&voxels, &config.ground)));
    group.bench_function(title("clusters", objects.len()), |b| {
        b.iter(|| euclidean_clusters(&objects, config.tolerance, config.min_points, config.max_points))
    });
    group.bench_function(title("all", cloud.len()), |b| b.iter(|| segment(cloud, &config)));
    group.finish();
}

fn benches(c: &mut Criterion) {
    stages(c, "segment, street", &street());
    if let Some(recording) = kitti_map() {
        for sweep in [300, 1100] {
            stages(c, &format!("segment, KITTI 00 sweep {sweep}"), &live_cloud(&recording, sweep).unwrap());
        }
    }
}

criterion_group!(group, benches);
criterion_main!(group);

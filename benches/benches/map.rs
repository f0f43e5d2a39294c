//! Opening, verifying and reading a map file of 100,000 segments with 13-d descriptors and 20 points each (24 MB). The
//! file is in the page cache, as after the first use.

#![allow(missing_docs, clippy::unwrap_used)] // Criterion's macros; a benchmark may stop at the first error.

use criterion::{Criterion, criterion_group, criterion_main};
use esm_core::map::{DescriptorInfo, Map, MapData};
use esm_core::segment::Segment;

const SEGMENTS: usize = 100_000;
const POINTS: usize = 20;
const DIM: usize = 13;

fn data() -> MapData {
    let info = DescriptorInfo { name: "shape".into(), version: 1, dim: DIM as u32 };
    let mut data = MapData::new([0.0; 3], info);
    for s in 0..SEGMENTS {
        let (x, y) = ((s % 300) as f32 * 3.0, (s / 300) as f32 * 3.0);
        let at = |i: usize| [x + (i * 7 % 13) as f32 * 0.1, y + (i * 5 % 11) as f32 * 0.1, i as f32 * 0.02];
        data.push_segment(&Segment::from_points((0..POINTS).map(at).collect()).unwrap(), 1).unwrap();
        data.descriptors.extend((0..DIM).map(|d| ((s * 31 + d * 17) % 101) as f32 / 50.0 - 1.0));
        data.quality.push(1.0);
    }
    data
}

fn map(c: &mut Criterion) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("map.esm");
    let memory = Map::from_data(data()).unwrap();
    memory.write(&file).unwrap();
    let opened = Map::open(&file).unwrap();
    let mut group = c.benchmark_group("map, 100,000 segments");
    group.sample_size(20);
    group.bench_function("open", |b| b.iter(|| Map::open(&file).unwrap()));
    group.bench_function("open and verify points", |b| {
        b.iter(|| Map::open(&file).unwrap().verify_points().unwrap())
    });
    group.bench_function("write", |b| b.iter(|| memory.write(&file).unwrap()));
    group.bench_function("read all points", |b| {
        let mut points = Vec::new();
        b.iter(|| {
            (0..opened.len())
                .map(|i| {
                    opened.segment_points_into(i, &mut points).unwrap();
                    points.len()
                })
                .sum::<usize>()
        })
    });
    group.finish();
}

criterion_group!(benches, map);
criterion_main!(benches);

//! What goes in comes out, bit by bit.

use esm_core::map::{DescriptorInfo, Map, MapData, Standardizer};
use esm_core::segment::Segment;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::{Scratch, large_data, small_data};

/// Everything the accessors give, equal. f32 by `==`, as no NaN can be in a map; -0.0 is told apart by the file's bytes.
fn assert_same(a: &Map, b: &Map) {
    assert_eq!(a.len(), b.len());
    assert_eq!(a.origin(), b.origin());
    assert_eq!(a.frame_id(), b.frame_id());
    assert_eq!(a.descriptor_info(), b.descriptor_info());
    assert_eq!(a.standardizer(), b.standardizer());
    assert_eq!(a.segments(), b.segments());
    assert_eq!(a.descriptors(), b.descriptors());
    assert_eq!(a.quality(), b.quality());
    assert_eq!(a.runs(), b.runs());
    assert_eq!(a.ground_tiles(), b.ground_tiles());
    assert_eq!(a.structure_tiles(), b.structure_tiles());
    assert_eq!(a.point_count(), b.point_count());
    assert_eq!(a.path(), b.path());
    assert_eq!(a.coverage(), b.coverage());
    assert_eq!(a.bounds(), b.bounds());
    assert_eq!((a.settings(), a.source()), (b.settings(), b.source()));
    assert_eq!((a.sections(), a.file_size()), (b.sections(), b.file_size()));
    let (mut p, mut q) = (Vec::new(), Vec::new());
    for i in 0..a.len() {
        assert_eq!(a.segment_points(i).unwrap(), b.segment_points(i).unwrap());
    }
    for i in 0..a.ground_tiles().len() {
        a.ground_tile_points_into(i, &mut p).unwrap();
        b.ground_tile_points_into(i, &mut q).unwrap();
        assert_eq!(p, q);
    }
    for i in 0..a.structure_tiles().len() {
        a.structure_tile_points_into(i, &mut p).unwrap();
        b.structure_tile_points_into(i, &mut q).unwrap();
        assert_eq!(p, q);
    }
}

fn points() -> impl Strategy<Value = Vec<[f32; 3]>> {
    let near = prop_oneof![4 => -40.0f32..40.0, 1 => -3000.0f32..3000.0, 1 => Just(0.0), 1 => Just(-0.0)];
    vec([near.clone(), near.clone(), near], 1..40)
}

prop_compose! {
    fn any_data()(
        origin in [-1e7f64..1e7, -1e7f64..1e7, -1e3f64..1e4],
        dim in 1u32..20,
        segments in vec((points(), any::<u32>()), 1..12),
        ground in vec(points(), 0..5),
        (numbers, quality) in (vec(-50f32..50.0, 12 * 20), vec(0f32..=1.0, 12)),
        statistics in proptest::option::of((vec(-9f32..9.0, 20), vec(0f32..9.0, 20))),
        path in vec([-1e7f64..1e7, -1e7f64..1e7, -1e3f64..1e4], 0..9),
        coverage in vec([any::<i32>(), any::<i32>()], 0..9),
        (name, frame, source) in ("[a-z]{1,64}", "\\PC{0,60}", "\\PC{0,60}"),
        (version, settings) in (any::<u32>(), any::<String>()),
    ) -> (MapData, Vec<Vec<[f32; 3]>>) {
        let mut data = MapData::new(origin, DescriptorInfo { name, version, dim });
        for (points, observations) in &segments {
            data.push_segment(&Segment::from_points(points.clone()).unwrap(), *observations).unwrap();
        }
        for points in &ground {
            data.push_ground_tile(points).unwrap();
            data.push_structure_tile(points).unwrap();
        }
        let (n, d) = (segments.len(), dim as usize);
        data.descriptors = numbers[..n * d].to_vec();
        data.quality = quality[..n].to_vec();
        data.standardizer =
            statistics.map(|(m, s)| Standardizer { mean: m[..d].to_vec(), inv_std: s[..d].to_vec() });
        (data.path, data.coverage, data.settings, data.frame_id, data.source) =
            (path, coverage, settings, frame, source);
        (data, segments.into_iter().map(|(p, _)| p).collect())
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_map_comes_back((data, segments) in any_data()) {
        let (low, high) = data.bounds;
        let mut cells = data.coverage.clone();
        let given = data.clone();
        let map = Map::from_data(data).unwrap();
        prop_assert_eq!(map.descriptors(), &given.descriptors);
        prop_assert_eq!(map.segments(), &given.segments);
        prop_assert_eq!(map.path(), &given.path);
        cells.sort_unstable();
        cells.dedup();
        prop_assert_eq!(map.coverage(), &cells);

        for (i, points) in segments.iter().enumerate() {
            let run = map.runs()[i];
            for (p, q) in points.iter().zip(map.segment_points(i).unwrap()) {
                for a in 0..3 {
                    let rounding = 4.0 * f32::EPSILON as f64 * (p[a].abs() as f64 + 65_535.0 * run.quantum as f64);
                    prop_assert!((p[a] as f64 - q[a] as f64).abs() <= run.quantum as f64 / 2.0 + rounding);
                    let absolute = map.origin()[a] + p[a] as f64;
                    prop_assert!(low[a] <= absolute && absolute <= high[a]);
                }
            }
        }

        let scratch = Scratch::new();
        map.write(&scratch.path()).unwrap();
        let bytes = std::fs::read(scratch.path()).unwrap();
        prop_assert_eq!(map.file_size(), bytes.len() as u64);
        let opened = Map::open(&scratch.path()).unwrap();
        assert_same(&map, &opened);
        opened.verify_points().unwrap();
        // Over the file it is mapped from.
        opened.write(&scratch.path()).unwrap();
        prop_assert!(std::fs::read(scratch.path()).unwrap() == bytes);
        assert_same(&map, &opened);
        prop_assert_eq!(scratch.names(), ["map.esm"]);
    }
}

#[test]
fn point_blocks_of_every_length_come_back() {
    // 6 bytes a point: 10,922 points end 4 bytes before a block's end, 10,944 are the first that fill 64 bytes exactly.
    for points in [10_912, 10_922, 10_923, 21_845, 32_768, 32_769] {
        let mut data = small_data();
        data.push_ground_tile(&vec![[1.0, 2.0, 3.0]; points - data.points.len()]).unwrap();
        let map = Map::from_data(data).unwrap();
        let scratch = Scratch::new();
        map.write(&scratch.path()).unwrap();
        let opened = Map::open(&scratch.path()).unwrap();
        opened.verify_points().unwrap();
        assert_same(&map, &opened);
    }
}

#[test]
fn the_bytes_do_not_depend_on_threads() {
    let file = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| crate::bytes_of(large_data(300, 200, 4)))
    };
    let one = file(1);
    assert!(one.len() > 5 * 65_536);
    assert!(one == file(4));
}

#[test]
fn threads_may_share_a_map() {
    use rayon::prelude::*;
    let data = large_data(400, 150, 2);
    let memory = Map::from_data(data.clone()).unwrap();
    let scratch = Scratch::new();
    memory.write(&scratch.path()).unwrap();
    let opened = Map::open(&scratch.path()).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
    pool.install(|| {
        (0..opened.len()).into_par_iter().for_each(|i| {
            assert_eq!(opened.segment_points(i).unwrap(), memory.segment_points(i).unwrap());
        });
        opened.verify_points().unwrap();
    });
}

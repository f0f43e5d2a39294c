//! What a builder may not hand over, and how exact points are.

use esm_core::Error;
use esm_core::map::{DescriptorInfo, Map, MapData, QUANTUM_M, Standardizer};
use esm_core::segment::{Context, Segment};

use crate::{large_data, small_data};

#[test]
fn data_that_does_not_fit_together_is_refused() {
    type Case = (&'static str, fn(&mut MapData), &'static str);
    let cases: &[Case] = &[
        ("dim", |d| d.descriptor.dim = 0, "0 numbers a row, 1 to 4096 are possible"),
        ("rows", |d| d.descriptors.truncate(5), "it holds 5 descriptor numbers, 2 segments of 3 need"),
        ("quality count", |d| d.quality.push(1.0), "it holds 3 qualities for 2 segments"),
        ("quality", |d| d.quality[1] = -0.1, "quality 1 is out of range: -0.1"),
        ("descriptor", |d| d.descriptors[4] = f32::NAN, "descriptor number 4 is out of range: NaN"),
        ("runs", |d| d.runs.truncate(1), "it holds 1 point runs for 2 segments"),
        ("points", |d| d.points.truncate(4), "segment's point run 1 is out of range"),
        ("ground", |d| d.points.truncate(6), "ground tile's point run 0 is out of range"),
        ("centroid", |d| d.segments[0].centroid[2] = f32::INFINITY, "segment 0 is out of range"),
        ("bounds", |d| d.bounds.1[0] = -1e6, "the bounds are upside down on axis 0"),
        ("origin", |d| d.origin[0] = f64::NAN, "corner (origin, lower and upper bound) 0 is out of range"),
        ("path", |d| d.path[1][1] = f64::NAN, "path position 1 is out of range"),
        ("name", |d| d.descriptor.name.clear(), "the descriptor name has 0 bytes, 1 to 64 are possible"),
        ("frame", |d| d.frame_id = "a\nb".into(), "the frame name holds a control character"),
        ("source", |d| d.source = "x".repeat(5000), "the source name has 5000 bytes, 0 to 4096 are possible"),
        ("settings", |d| d.settings = " ".repeat((1 << 20) + 1), "the build settings have 1048577 bytes"),
        (
            "mean",
            |d| d.standardizer = Some(Standardizer { mean: vec![0.0], inv_std: vec![1.0] }),
            "hold 1 means and 1 spreads for 3 dimensions",
        ),
    ];
    Map::from_data(small_data()).unwrap();
    for (name, change, expected) in cases {
        let mut data = small_data();
        change(&mut data);
        let error = Map::from_data(data).unwrap_err();
        assert!(matches!(error, Error::MapData { .. }), "{name}: {error}");
        assert!(error.to_string().contains(expected), "{name}: {error}");
    }
    let empty = MapData::new([0.0; 3], DescriptorInfo { name: "shape".into(), version: 1, dim: 3 });
    let error = Map::from_data(empty).unwrap_err();
    assert!(error.to_string().starts_with("the map holds no segments\nhint: "), "{error}");
}

#[test]
fn points_that_cannot_be_kept_are_refused_and_change_nothing() {
    let mut data = small_data();
    let before = data.clone();
    let error = data.push_ground_tile(&[[0.0; 3], [0.0, f32::NAN, 0.0]]).unwrap_err();
    assert!(error.to_string().contains("point 1 is not finite"), "{error}");
    let error = data.push_ground_tile(&[[0.0, 0.0, 2e6]]).unwrap_err();
    assert!(error.to_string().contains("point 0 of a run lies at [0.0, 0.0, 2000000.0]"), "{error}");
    assert!(error.to_string().contains("hint: choose the map's origin near its points"), "{error}");
    let error = data.push_ground_tile(&[]).unwrap_err();
    assert!(error.to_string().contains("a run of points holds none"), "{error}");
    let none = Segment {
        points: vec![],
        centroid: [0.0; 3],
        min: [0.0; 3],
        max: [0.0; 3],
        context: Context::default(),
    };
    assert!(data.push_segment(&none, 1).is_err());
    assert!(data == before);
}

#[test]
fn asking_for_what_is_not_there_is_an_error() {
    let map = Map::from_data(small_data()).unwrap();
    let error = map.segment_points(2).unwrap_err();
    assert!(error.to_string().contains("segment 2 was asked for, there are 2"), "{error}");
    let error = map.ground_tile_points_into(usize::MAX, &mut vec![]).unwrap_err();
    assert!(error.to_string().contains("was asked for, there are 1"), "{error}");
    assert!(map.descriptor(2).is_empty());
}

#[test]
fn wide_runs_get_a_coarser_step_that_spans_them() {
    let mut data = small_data();
    data.push_ground_tile(&[[-1000.0, 0.0, 0.0], [1000.0, 3.0, -4.0], [0.003, 1.0, 0.0]]).unwrap();
    let map = Map::from_data(data).unwrap();
    assert_eq!(map.ground_tiles()[0].quantum, QUANTUM_M);
    let run = map.ground_tiles()[1];
    assert!((run.quantum - 2000.0 / 65_535.0).abs() < 1e-6);
    let mut points = Vec::new();
    map.ground_tile_points_into(1, &mut points).unwrap();
    assert_eq!((points[0][0], points[1][2]), (-1000.0, -4.0));
    assert!((points[1][0] - 1000.0).abs() < 1e-3);
    assert!((points[2][0] - 0.003).abs() <= run.quantum / 2.0 && points[0][2].abs() <= run.quantum / 2.0);
}

#[test]
fn another_descriptor_is_refused() {
    struct Other(&'static str, u32, usize);
    impl esm_core::describe::Descriptor for Other {
        fn name(&self) -> &'static str {
            self.0
        }
        fn version(&self) -> u32 {
            self.1
        }
        fn dim(&self) -> usize {
            self.2
        }
        fn describe(&self, _: &[Segment]) -> esm_core::describe::Descriptions {
            esm_core::describe::Descriptions::default()
        }
    }
    let map = Map::from_data(small_data()).unwrap();
    map.check_descriptor(&Other("shape", 2, 3)).unwrap();
    for other in [Other("eigen", 2, 3), Other("shape", 1, 3), Other("shape", 2, 4)] {
        let error = map.check_descriptor(&other).unwrap_err().to_string();
        assert!(
            error.contains("the map holds 'shape (version 2, 3 numbers)' descriptors, asked for '"),
            "{error}"
        );
        // This library makes no `shape` of version 2 either.
        assert!(error.ends_with("\nhint: rebuild the map"), "{error}");
    }
    let shape = esm_core::describe::by_name("shape").unwrap();
    let map = Map::from_data(large_data(4, 8, shape.dim())).unwrap();
    assert_eq!(map.descriptor_info().version, shape.version());
    let error = map.check_descriptor(&Other("eigen", 1, 7)).unwrap_err().to_string();
    assert!(error.ends_with("\nhint: use --descriptor shape, or rebuild the map"), "{error}");
}

#[test]
fn statistics_standardise_and_survive_constant_dimensions() {
    let rows = [1.0, 5.0, 1e-30, 3.0, 5.0, 1e-30, 8.0, 5.0, 1e-30];
    let statistics = Standardizer::fit(&rows, 3);
    assert_eq!(statistics.mean, [4.0, 5.0, 1e-30]);
    assert_eq!(statistics.inv_std[1..], [0.0, 0.0]);
    let mut scaled = rows;
    statistics.apply(&mut scaled);
    let column: Vec<f64> = scaled.iter().step_by(3).map(|&v| v as f64).collect();
    assert!(column.iter().sum::<f64>().abs() < 1e-6);
    assert!((column.iter().map(|v| v * v).sum::<f64>() / 3.0 - 1.0).abs() < 1e-6);
    assert_eq!(Standardizer::fit(&[], 2), Standardizer { mean: vec![0.0; 2], inv_std: vec![0.0; 2] });
}

//! The readers on real recordings. The expected numbers were computed by other programs: Python's mcap and
//! mcap-ros2-support, laspy with lazrs, and numpy on the bytes of PCD and KITTI files.

use esm_core::PointCloud;
use esm_io::{OpenOptions, Recording, read_prior_cloud, read_scan};

use crate::support::{read_all, shared_data};

/// Sums of x, y and z.
fn sums(origin: [f64; 3], cloud: &PointCloud) -> [f64; 3] {
    let add = |s: [f64; 3], p: &[f32; 3]| [0, 1, 2].map(|i| s[i] + origin[i] + f64::from(p[i]));
    cloud.points().iter().fold([0.0; 3], add)
}

fn assert_sums(name: &str, got: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for (g, e) in got.iter().zip(expected) {
        assert!((g - e).abs() <= tolerance, "{name}: {got:?}, expected {expected:?}");
    }
}

#[test]
fn kitti_mcap_recordings() {
    let Some(data) = shared_data() else { return };
    let expected = [
        (
            "map",
            1340,
            8_544_838,
            [-12_506_279.703_239, 2_610_901.068_472, -5_919_619.046_77],
            2_507.619_630_8,
        ),
        (
            "query",
            260,
            1_667_604,
            [-2_733_751.550_793, -1_337_161.431_356, -1_161_019.449_474],
            519.721_111_3,
        ),
    ];
    for (name, clouds, points, sum, travel) in expected {
        let path = data.join(format!("kitti00/{name}.mcap"));
        let recording = Recording::open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(recording.sweep_count_hint(), Some(clouds));
        assert_eq!(recording.cloud_topic(), Some("/velodyne_points"));
        assert_eq!(recording.motion_topic(), Some("/odometry"));
        assert!(recording.has_motion());

        let all = read_all(&path, &OpenOptions::default());
        assert_eq!((all.error, all.warnings), (None, vec![]));
        assert_eq!(all.sweeps.len(), clouds);
        assert_eq!(all.sweeps.iter().map(|s| s.cloud.len()).sum::<usize>(), points);
        let each = all.sweeps.iter().map(|s| sums([0.0; 3], &s.cloud));
        assert_sums(name, each.fold([0.0; 3], |a, b| [0, 1, 2].map(|i| a[i] + b[i])), sum, 1e-4);
        let position = |i: usize| all.sweeps[i].pose_odom_sensor.unwrap().translation.vector;
        let steps = (1..clouds).map(|i| (position(i) - position(i - 1)).norm());
        assert!((steps.sum::<f64>() - travel).abs() < 1e-6);
        for (i, sweep) in all.sweeps.iter().enumerate() {
            assert_eq!((sweep.number, sweep.frame_id.as_str(), sweep.dropped), (i + 1, "velodyne", 0));
        }
        let first = if name == "map" { 1_317_600_000_250_000_000 } else { 1_317_600_335_250_000_000 };
        assert_eq!(all.sweeps[0].stamp_ns, first);
        assert_eq!(all.sweeps[0].stamp, if name == "map" { 1_317_600_000.25 } else { 1_317_600_335.25 });
    }
}

#[test]
fn laz_surveys() {
    let Some(data) = shared_data() else { return };
    let expected = [
        ("forest/mixed_conifer_als", 37_657, [18_124_509_887.0, 143_584_872_818.76, 452_435.01]),
        ("forest/pine_plot_tls", 114_024, [619_077.636_7, 559_328.935_6, 6_280_492.302_7]),
        ("forest/pine_tls", 73_851, [2_292.965_698_2, -3_048.169_947_7, 726_972.482_579]),
        ("forest/plot_als", 29_915, [14_079_223_573.3, 113_983_203_022.69, 68_694_044.93]),
        ("forest/plot_mls", 301_477, [141_887_437_977.374, 1_148_698_530_720.414_6, 691_195_553.355_3]),
        ("forest/plot_tls", 400_754, [-71_135_261.179_25, -51_220_282.438_75, 5_658_263.463_25]),
        ("forest/plot_uas", 390_877, [183_962_318_734.04, 1_489_333_641_683.81, 898_576_527.17]),
        ("forest/spruce_tls", 83_392, [-7_886.385_601_7, 710.215_954, 678_080.810_144]),
        ("kitti00/dense_first_827m", 1_829_423, [153_336_026.63, 422_844_880.72, -1_950_583.69]),
    ];
    for (name, points, sum) in expected {
        let prior = read_prior_cloud(data.join(format!("{name}.laz"))).unwrap();
        assert_eq!(prior.cloud.len() + prior.dropped, points, "{name}");
        assert!(prior.dropped <= 1, "{name}: {}", prior.dropped);
        // Each point may be off by half a step of its f32: far below the file's own 0.1 mm to 10 mm within 1000 m of the
        // origin, where the coordinates themselves would be off by up to 0.25 m.
        let tolerance = 1e-5 * points as f64 + 1e-9 * f64::abs(sum[1]);
        assert_sums(name, sums(prior.origin, &prior.cloud), sum, tolerance);
    }
}

#[test]
fn pcd_and_kitti_scans() {
    let Some(data) = shared_data() else { return };
    let map = read_prior_cloud(data.join("vlp16_smoke/map.pcd")).unwrap();
    assert_eq!((map.cloud.len(), map.dropped, map.origin), (25_479, 0, [0.0; 3]));
    assert_sums(
        "map.pcd",
        sums([0.0; 3], &map.cloud),
        [-39_930.201_776, 182_346.755_644, 12_006.738_301],
        1e-5,
    );

    let all = read_all(&data.join("vlp16_smoke/scans"), &OpenOptions::default());
    assert_eq!((all.error, all.warnings, all.sweeps.len()), (None, vec![], 20));
    for (i, sweep) in all.sweeps.iter().enumerate() {
        assert_eq!((sweep.number, sweep.stamp), (i + 1, i as f64));
        assert!((10_000..13_000).contains(&sweep.cloud.len()));
        assert_eq!(sweep.pose_odom_sensor, None);
    }
    let sum = sums([0.0; 3], &all.sweeps[0].cloud);
    assert_sums("000000.pcd", sum, [-3_587.743_078, 34_821.317_766, 3_134.167_823], 1e-5);

    let scan = read_scan(data.join("kitti_scans/00/000000.bin")).unwrap();
    assert_eq!((scan.cloud.len(), scan.dropped), (124_668, 0));
    let sum = sums([0.0; 3], &scan.cloud);
    assert_sums("000000.bin", sum, [-178_942.814_468, 127_768.874_212, -150_940.371_017], 1e-5);
}

#[test]
fn a_part_of_a_kitti_drive_finds_its_pose_by_number() {
    let Some(data) = shared_data() else { return };
    let dir = data.join("kitti_scans/05");
    let options = OpenOptions { poses: Some(dir.join("poses.txt")), ..OpenOptions::default() };
    let all = read_all(&dir, &options);
    assert_eq!((all.error, all.sweeps.len()), (None, 1));
    let pose = all.sweeps[0].pose_odom_sensor.unwrap();
    assert!(pose.translation.vector.norm() < 1e-9 && pose.rotation.angle() < 1e-6);
}

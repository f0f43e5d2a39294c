//! Whole recordings: the same bytes with any number of threads, and readable.

use std::path::Path;

use esm_io::{OpenOptions, Recording, read_tum};
use esm_sim::{Error, preset, simulate};

fn simulate_with(threads: usize, name: &str, scale: f64, dir: &Path) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| simulate(&preset(name).unwrap(), 42, scale, dir, &mut |_| true)).unwrap();
}

#[test]
fn bytes_do_not_depend_on_threads() {
    for (name, scale) in [
        ("train-forest", 0.006),
        ("george-square", 0.01),
        ("kitti", 0.005),
        ("plantation", 0.006),
        ("car-park", 0.008),
        ("terraces", 0.008),
    ] {
        let [one, four] = [1, 4].map(|threads| {
            let dir = tempfile::tempdir().unwrap();
            simulate_with(threads, name, scale, dir.path());
            dir
        });
        for file in ["map.mcap", "live.mcap", "map_truth.tum", "live_truth.tum", "preset.toml"] {
            let [a, b] = [&one, &four].map(|dir| std::fs::read(dir.path().join(file)).unwrap());
            assert!(!a.is_empty() && a == b, "{name}: {file} differs");
        }
    }
}

#[test]
fn recordings_can_be_read_back() {
    let dir = tempfile::tempdir().unwrap();
    simulate_with(2, "cornbury", 0.02, dir.path());
    for visit in ["map", "live"] {
        let truth = read_tum(dir.path().join(format!("{visit}_truth.tum"))).unwrap();
        let recording =
            Recording::open(dir.path().join(format!("{visit}.mcap")), &OpenOptions::default()).unwrap();
        let mut sweeps = recording.sweeps().unwrap();
        let all: Vec<_> = sweeps.by_ref().map(|s| s.unwrap()).collect();
        assert_eq!(sweeps.warnings(), []);
        assert_eq!(all.len(), truth.len());
        let first = truth[0].pose;
        assert!(all.len() > 8, "{} sweeps", all.len());
        for (sweep, truth) in all.iter().zip(&truth) {
            assert_eq!((sweep.stamp_ns, sweep.frame_id.as_str()), (truth.stamp_ns, "lidar"));
            assert!(sweep.cloud.len() > 20_000 && sweep.dropped == 0, "{} points", sweep.cloud.len());
            // 8 m of travel: odometry cannot have drifted far, and it starts at identity.
            let odometry = sweep.pose_odom_sensor.unwrap();
            let moved = first.inverse() * truth.pose;
            let off = (odometry.translation.vector - moved.translation.vector).norm();
            assert!(off < 0.5, "{off} m off after {} m", moved.translation.vector.norm());
        }
    }
}

#[test]
fn refusals() {
    let dir = tempfile::tempdir().unwrap();
    let cornbury = preset("cornbury").unwrap();
    for scale in [0.0, f64::NAN, 100.0] {
        let error = simulate(&cornbury, 1, scale, dir.path(), &mut |_| true).unwrap_err();
        assert!(matches!(error, Error::Scale { .. }) && error.to_string().contains("hint: "), "{error}");
    }
    let error = simulate(&cornbury, 1, 0.01, dir.path(), &mut |_| false).unwrap_err();
    assert!(matches!(error, Error::Interrupted), "{error}");
    std::fs::remove_dir_all(dir.path()).unwrap();
    std::fs::create_dir(dir.path()).unwrap();
    let file = dir.path().join("file");
    std::fs::write(&file, "x").unwrap();
    let error = simulate(&cornbury, 1, 0.01, &file.join("sub"), &mut |_| true).unwrap_err();
    assert!(error.to_string().contains("hint: "), "{error}");
}

//! The readers on real recordings. Expected numbers were counted by other programs (Python's struct and zstandard on the
//! MCAP records, a LAS header dump, file sizes).

mod support;

use esm_io::{OpenOptions, Recording, Warning, read_prior_cloud, read_scan};
use support::shared_data;

#[test]
fn kitti_mcap_recordings() {
    let Some(data) = shared_data() else { return };
    for (name, sweeps) in [("map.mcap", 1340), ("query.mcap", 260)] {
        let recording = Recording::open(data.join("kitti00").join(name), &OpenOptions::default()).unwrap();
        assert_eq!(recording.sweep_count_hint(), Some(sweeps));
        assert_eq!(recording.cloud_topic(), Some("/velodyne_points"));
        assert_eq!(recording.motion_topic(), Some("/odometry"));
        let mut read = recording.sweeps().unwrap();
        let (mut n, mut points, mut travel) = (0, 0, 0.0);
        let mut last: Option<(f64, esm_core::Pose)> = None;
        for sweep in &mut read {
            let sweep = sweep.unwrap();
            n += 1;
            assert_eq!(sweep.number, n);
            assert!((3_000..15_000).contains(&sweep.cloud.len()), "{}", sweep.cloud.len());
            points += sweep.cloud.len();
            let pose = sweep.pose_odom_sensor.unwrap();
            if let Some((stamp, before)) = last {
                assert!(sweep.stamp > stamp);
                travel += (pose.translation.vector - before.translation.vector).norm();
            }
            last = Some((sweep.stamp, pose));
        }
        println!("{name}: {n} sweeps, {points} points, {travel:.1} m, {:?}", read.warnings());
        assert_eq!(n, sweeps);
        assert!(read.warnings().iter().all(|w| matches!(w, Warning::AssumedMounting { .. })));
    }
}

#[test]
fn surveys_and_scans() {
    let Some(data) = shared_data() else { return };
    for (file, points) in [("vlp16_smoke/map.pcd", 25479), ("kitti00/dense_first_827m.laz", 0)] {
        let prior = read_prior_cloud(data.join(file)).unwrap();
        println!(
            "{file}: {} points, {} dropped, origin {:?}",
            prior.cloud.len(),
            prior.dropped,
            prior.origin
        );
        if points > 0 {
            assert_eq!(prior.cloud.len() + prior.dropped, points);
        }
    }
    for entry in std::fs::read_dir(data.join("forest")).unwrap() {
        let path = entry.unwrap().path();
        let prior = read_prior_cloud(&path).unwrap();
        println!("{}: {} points, origin {:?}", path.display(), prior.cloud.len(), prior.origin);
    }
    for n in 0..=10 {
        let path = data.join(format!("kitti_scans/{n:02}/000000.bin"));
        let scan = read_scan(&path).unwrap();
        let size = std::fs::metadata(&path).unwrap().len() as usize;
        assert_eq!(scan.cloud.len() + scan.dropped, size / 16);
    }
    let recording = Recording::open(data.join("vlp16_smoke/scans"), &OpenOptions::default()).unwrap();
    assert_eq!(recording.sweep_count_hint(), Some(20));
    for (i, sweep) in recording.sweeps().unwrap().enumerate() {
        let sweep = sweep.unwrap();
        assert_eq!((sweep.number, sweep.stamp), (i + 1, i as f64));
        println!("vlp16 {i}: {} points, {} dropped", sweep.cloud.len(), sweep.dropped);
    }
}

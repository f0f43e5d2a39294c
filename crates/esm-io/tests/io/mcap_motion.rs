//! The motion of the sensor: interpolation, mounting, transforms, and bounded waiting.

use esm_core::Pose;
use esm_io::{OpenOptions, Sweep, Warning};
use nalgebra::Vector3;

use crate::bytes_cdr::{CloudMessage, odometry, pose_stamped, tf, yaw};
use crate::bytes_mcap::{CLOUD, Mcap, ODOMETRY, POSE, TF};
use crate::support::{ReadAll, TestFile, read_all};

const MS: i64 = 1_000_000;

fn cloud(ms: i64, frame: &str) -> Vec<u8> {
    CloudMessage::plain(ms * MS, frame, &[[1.0; 3]]).encode()
}

fn odom(ms: i64, child: &str, x: f64, angle: f64) -> Vec<u8> {
    odometry(ms * MS, "odom", child, [x, 0.0, 0.0], yaw(angle))
}

fn read(mcap: &Mcap) -> ReadAll {
    let file = TestFile::new("r.mcap", mcap.finished());
    let all = read_all(&file.path, &OpenOptions::default());
    assert_eq!(all.error, None);
    all
}

#[track_caller]
fn assert_pose(sweep: &Sweep, expected: Option<Pose>) {
    match (sweep.pose_odom_sensor, expected) {
        (Some(a), Some(b)) => {
            assert!((a.to_homogeneous() - b.to_homogeneous()).abs().max() < 1e-9, "{a} {b}")
        }
        (a, b) => assert_eq!(a, b, "sweep {}", sweep.number),
    }
}

fn at(x: f64, y: f64, angle: f64) -> Option<Pose> {
    Some(Pose::new(Vector3::new(x, y, 0.0), Vector3::z() * angle))
}

/// Clouds at 0, 100, 200 ... ms, odometry at 50, 150 ..., in order of time.
fn interleaved() -> Mcap {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    for i in 0..5 {
        mcap.message(1, 100 * i, &cloud(100 * i as i64, "lidar"));
        let t = 100 * i as i64 + 50;
        mcap.message(2, t as u64, &odom(t, "lidar", t as f64 / 100.0, t as f64 / 1000.0));
    }
    mcap
}

#[test]
fn sweeps_wait_for_the_motion_after_them() {
    let all = read(&interleaved());
    assert_eq!(all.warnings, Vec::<String>::new());
    for (i, sweep) in all.sweeps.iter().enumerate() {
        // The first lies 50 ms before all motion and is carried back.
        assert_pose(sweep, at(i as f64, 0.0, i as f64 / 10.0));
    }
}

#[test]
fn beyond_the_motion_there_is_none() {
    let mut mcap = interleaved();
    mcap.message(1, 900, &cloud(900, "lidar"));
    let all = read(&mcap);
    assert_pose(&all.sweeps[5], None);
    assert_eq!(
        all.warnings,
        [
            "r.mcap: /odom gives no pose for 1 of 6 sweeps (sweeps from 0.000 to 0.900 s, motion from 0.050 to 0.450 s)"
        ]
    );
}

/// Motion that comes later than sweeps wait for it is gathered from the whole file beforehand.
#[test]
fn motion_that_comes_late_is_found() {
    for delay in [2_000u64, 4_000, 60_000] {
        let mut mcap = Mcap::new();
        mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY).channel(3, "/clock", "x/msg/Clock");
        let mut messages = Vec::new();
        for i in 0..100u64 {
            let t = 100 * i as i64;
            messages.push((100 * i, 1, cloud(t, "lidar")));
            messages.push((100 * i + delay, 2, odom(t, "lidar", i as f64, 0.0)));
        }
        messages.sort_by_key(|m| m.0);
        for (time, channel, data) in messages {
            mcap.message(channel, time * MS as u64, &data);
        }
        assert_all_known(&read(&mcap), 100, 0.0);
    }
}

#[track_caller]
fn assert_all_known(all: &ReadAll, n: usize, y: f64) {
    assert_eq!((all.sweeps.len(), all.warnings.as_slice()), (n, [].as_slice()));
    for (i, sweep) in all.sweeps.iter().enumerate() {
        assert_pose(sweep, at(i as f64, y, 0.0));
    }
}

/// All clouds first and all motion after them, in any order, with log times and without, in chunks and without.
#[test]
fn clouds_first_and_motion_after_them() {
    for (log, backwards, chunks) in [(100, false, false), (0, false, true), (100, true, true)] {
        for topic in [ODOMETRY, TF] {
            let mut mcap = Mcap::new();
            mcap.channel(1, "/points", CLOUD).channel(2, "/motion", topic).channel(3, "/tf_static", TF);
            let chunk = |mcap: &mut Mcap, i: usize| {
                if chunks && i % 50 == 49 {
                    mcap.end_chunk().begin_chunk();
                }
            };
            if chunks {
                mcap.begin_chunk();
            }
            for i in 0..200 {
                mcap.message(1, (log * i * MS) as u64, &cloud(100_000 + 100 * i, "lidar"));
                chunk(&mut mcap, i as usize);
            }
            for k in 0..200 {
                let i = if backwards { 199 - k } else { k };
                let t = 100_000 + 100 * i;
                let message = match topic {
                    TF => tf(&[
                        (t * MS, "odom", "base_link", [i as f64, 0.0, 0.0], yaw(0.0)),
                        (t * MS, "base_link", "wheel", [0.0, 0.0, 9.0], yaw(i as f64)),
                    ]),
                    _ => odom(t, "base_link", i as f64, 0.0),
                };
                mcap.message(2, (log * i * MS) as u64, &message);
                chunk(&mut mcap, k as usize);
            }
            mcap.message(3, 0, &tf(&[(0, "base_link", "lidar", [0.0, 1.0, 0.0], yaw(0.0))]));
            if chunks {
                mcap.end_chunk();
            }
            assert_all_known(&read(&mcap), 200, 1.0);
        }
    }
}

/// More motion before the clouds than is remembered: it is gathered anew.
#[test]
fn motion_first_and_clouds_after_it() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/tf", TF);
    for i in 0..5000 {
        let pose = (10 * i * MS, "odom", "lidar", [i as f64 / 10.0, 0.0, 0.0], yaw(0.0));
        mcap.message(2, 0, &tf(&[pose]));
    }
    for i in 0..500 {
        mcap.message(1, 0, &cloud(100 * i, "lidar"));
    }
    assert_all_known(&read(&mcap), 500, 0.0);
}

/// A recording whose motion stops is read to its end, and what is missing is told once.
#[test]
fn motion_that_stops_stays_missing() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    for i in 0..200u64 {
        mcap.message(1, 100 * i * MS as u64, &cloud(100 * i as i64, "lidar"));
        if i < 100 {
            mcap.message(2, 100 * i * MS as u64, &odom(100 * i as i64, "lidar", i as f64, 0.0));
        }
        if i == 50 {
            mcap.message(2, 100 * i * MS as u64, &[]);
        }
    }
    let all = read(&mcap);
    let with = all.sweeps.iter().filter(|s| s.pose_odom_sensor.is_some()).count();
    assert_eq!((all.sweeps.len(), with), (200, 101));
    assert_eq!(
        all.warnings,
        [
            "r.mcap: the recording is damaged: message 52 of /odom contradicts itself: the message has 0 bytes, fewer \
             than CDR's header; every intact message was used, lost are 1 message, among them 0 clouds",
            "r.mcap: /odom gives no pose for 99 of 200 sweeps (sweeps from 0.000 to 19.900 s, motion from 0.000 to \
             9.900 s)"
        ]
    );
}

#[test]
fn too_much_motion_out_of_order_names_its_cause() {
    let warning = Warning::NoMotion {
        path: "r.mcap".into(),
        without: 3,
        sweeps: 9,
        source: "/odom".to_owned(),
        sweep_span_ns: (0, 1_000_000_000),
        motion_span_ns: None,
        out_of_order: true,
    };
    assert_eq!(
        warning.to_string(),
        "r.mcap: /odom gives no pose for 3 of 9 sweeps (sweeps from 0.000 to 1.000 s, motion none); the messages are \
         not in time order and too many to be sorted here\nhint: sort the recording: 'mcap sort in.mcap -o out.mcap'"
    );
}

#[test]
fn the_mounting_comes_from_fixed_transforms() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY).channel(3, "/tf_static", TF);
    mcap.message(1, 0, &cloud(0, "lidar"));
    mcap.message(2, 1, &odom(0, "base_link", 10.0, std::f64::consts::FRAC_PI_2));
    // Latched transforms come when the recorder gets them: here after the first cloud and its motion. The sensor hangs
    // on a mast, the mast on the base.
    let base_mast = (0, "/base_link", "mast", [1.0, 0.0, 0.0], yaw(0.0));
    let mast_lidar = (0, "mast", "lidar", [1.0, 0.0, 0.0], yaw(-std::f64::consts::FRAC_PI_2));
    mcap.message(3, 2, &tf(&[base_mast, mast_lidar]));
    mcap.message(1, 3, &cloud(10, "lidar"));
    mcap.message(2, 4, &odom(10, "base_link", 20.0, 0.0));
    let all = read(&mcap);
    assert_eq!(all.warnings, Vec::<String>::new());
    assert_pose(&all.sweeps[0], at(10.0, 2.0, 0.0));
    assert_pose(&all.sweeps[1], at(22.0, 0.0, -std::f64::consts::FRAC_PI_2));
}

#[test]
fn an_unknown_mounting_is_assumed_and_told() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    mcap.message(1, 0, &cloud(0, "lidar")).message(2, 1, &odom(0, "base_link", 10.0, 0.5));
    let all = read(&mcap);
    assert_pose(&all.sweeps[0], at(10.0, 0.0, 0.5));
    let warning = "r.mcap: no transform between 'base_link' and 'lidar' is recorded (/tf_static); they were taken to be \
                   the same";
    assert_eq!(all.warnings, [warning]);
}

#[test]
fn poses_without_a_child_are_the_sensors() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/pose", POSE);
    mcap.message(1, 0, &cloud(5, "lidar"));
    mcap.message(2, 1, &pose_stamped(0, "map", [1.0, 2.0, 0.0], yaw(0.0)));
    mcap.message(2, 1, &pose_stamped(10 * MS, "map", [3.0, 2.0, 0.0], yaw(0.2)));
    let all = read(&mcap);
    assert_eq!(all.warnings, Vec::<String>::new());
    assert_pose(&all.sweeps[0], at(2.0, 2.0, 0.1));
}

#[test]
fn transforms_are_followed_up_to_odom() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/tf", TF).channel(3, "/tf_static", TF);
    mcap.message(3, 0, &tf(&[(0, "base_link", "lidar", [0.0, 1.0, 0.0], yaw(0.0))]));
    for i in 0..4 {
        let t = 100 * i as i64 * MS;
        // map -> odom jumps and is left out; a wheel turns beside the chain.
        let odom_base = (t, "odom", "base_link", [i as f64, 0.0, 0.0], yaw(0.0));
        let map_odom = (t, "map", "odom", [1000.0 * i as f64, 0.0, 0.0], yaw(1.0));
        let wheel = (t, "base_link", "wheel", [0.0, 0.0, 9.0], yaw(i as f64));
        mcap.message(2, 100 * i as u64, &tf(&[odom_base, wheel])).message(
            2,
            100 * i as u64,
            &tf(&[map_odom]),
        );
        mcap.message(1, 100 * i as u64, &cloud(100 * i as i64 + 50, "lidar"));
    }
    let all = read(&mcap);
    assert_eq!(all.warnings, Vec::<String>::new());
    for (i, sweep) in all.sweeps.iter().enumerate() {
        assert_pose(sweep, at(i as f64 + 0.5, 1.0, 0.0));
    }
}

#[test]
fn transforms_that_do_not_reach_the_sensor_tell_nothing() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/tf", TF);
    mcap.message(
        2,
        0,
        &tf(&[
            (0, "odom", "base_link", [0.0; 3], yaw(0.0)),
            (0, "a", "b", [0.0; 3], yaw(0.0)),
            (0, "b", "a", [0.0; 3], yaw(0.0)),
        ]),
    );
    mcap.message(1, 0, &cloud(0, "lidar"));
    // A loop of frames ends.
    mcap.message(1, 0, &cloud(0, "a"));
    let all = read(&mcap);
    assert_eq!(all.sweeps.len(), 2);
    assert_pose(&all.sweeps[0], None);
    assert!(all.warnings[0].starts_with("r.mcap: /tf gives no pose for"), "{:?}", all.warnings);
}

#[test]
fn messages_without_a_pose_are_left_out_and_counted() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    mcap.message(2, 0, &odometry(0, "odom", "lidar", [0.0; 3], [0.0; 4]));
    mcap.message(2, 0, &odometry(0, "odom", "lidar", [f64::NAN, 0.0, 0.0], yaw(0.0)));
    mcap.message(2, 0, &odom(40, "lidar", 1e308, 0.0));
    mcap.message(1, 0, &cloud(50, "lidar"));
    mcap.message(2, 0, &odom(0, "lidar", 1.0, 0.0)).message(2, 0, &odom(100, "lidar", 2.0, 0.0));
    let all = read(&mcap);
    assert_pose(&all.sweeps[0], at(1.5, 0.0, 0.0));
    assert_eq!(all.warnings, ["r.mcap: 3 messages of /odom hold no valid pose and were left out"]);
}

#[test]
fn cut_motion_messages_name_themselves() {
    let whole = odom(0, "lidar", 1.0, 0.0);
    for cut in [0, 3, 20, 60] {
        let mut mcap = Mcap::new();
        mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
        mcap.message(1, 0, &cloud(0, "lidar")).message(2, 0, &whole).message(2, 0, &whole[..cut]);
        let file = TestFile::new("r.mcap", mcap.finished());
        let all = read_all(&file.path, &OpenOptions::default());
        assert_eq!((all.sweeps.len(), all.error), (1, None));
        assert_pose(&all.sweeps[0], at(1.0, 0.0, 0.0));
        let [warning] = all.warnings.as_slice() else { panic!("{:?}", all.warnings) };
        let start = "r.mcap: the recording is damaged: message 2 of /odom contradicts itself: the message ";
        assert!(warning.starts_with(start), "{warning}");
        let end = "; every intact message was used, lost are 1 message, among them 0 clouds";
        assert!(warning.ends_with(end), "{warning}");
    }
}

#[test]
fn poses_from_files() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    for i in 0..3 {
        mcap.message(1, i, &cloud(100 * i as i64, "lidar")).message(
            2,
            i,
            &odom(100 * i as i64, "lidar", 7.0, 0.0),
        );
    }
    let file = TestFile::new("r.mcap", mcap.finished());
    let read_with = |text: &str| {
        let poses = TestFile::new("poses.txt", text);
        let options = OpenOptions { poses: Some(poses.path.clone()), ..OpenOptions::default() };
        let mut all = read_all(&file.path, &options);
        let dir = format!("{}/", poses.path.parent().unwrap().display());
        all.warnings.iter_mut().for_each(|w| *w = w.replace(&dir, ""));
        all.error = all.error.map(|e| e.replace(&dir, ""));
        all
    };
    let all = read_with("0 1 0 0 0 0 0 1\n0.2 3 0 0 0 0 0 1\n");
    assert_eq!(all.warnings, Vec::<String>::new());
    for (i, sweep) in all.sweeps.iter().enumerate() {
        assert_pose(sweep, at(i as f64 + 1.0, 0.0, 0.0));
    }
    let kitti = |n: i32| (0..n).map(|i| format!("1 0 0 {i} 0 1 0 0 0 0 1 0\n")).collect::<String>();
    for (i, sweep) in read_with(&kitti(3)).sweeps.iter().enumerate() {
        assert_pose(sweep, at(i as f64, 0.0, 0.0));
    }
    assert_eq!(
        read_with(&kitti(5)).error.unwrap(),
        "poses.txt: line 4: the file has 5 lines for 3 sweeps\nhint: KITTI poses have no stamps and need \
         one line a sweep; TUM poses are matched by time"
    );
    let all = read_with("1000 1 0 0 0 0 0 1\n");
    assert_eq!(
        all.warnings,
        [
            "r.mcap: poses.txt gives no pose for 3 of 3 sweeps (sweeps from 0.000 to 0.200 s, motion from 1000.000 to \
          1000.000 s)"
        ]
    );
}

/// Memory is bounded by limits, not by the length: what waits and what is remembered stays the same.
#[test]
fn long_recordings_read_the_same_as_short_ones() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
    for c in 0..30 {
        mcap.begin_chunk();
        for i in 100 * c..100 * c + 100 {
            mcap.message(2, (10 * i) as u64 * MS as u64, &odom(10 * i, "lidar", i as f64, 0.0));
            if i % 10 == 5 {
                mcap.message(1, (10 * i) as u64 * MS as u64, &cloud(10 * i + 5, "lidar"));
            }
        }
        mcap.end_chunk();
    }
    let all = read(&mcap);
    assert_eq!((all.sweeps.len(), all.warnings), (300, vec![]));
    for (n, sweep) in all.sweeps.iter().enumerate() {
        assert_pose(sweep, at(10.0 * n as f64 + 5.5, 0.0, 0.0));
    }
}

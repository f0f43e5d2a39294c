//! TUM and KITTI trajectories, and poses written as MCAP.

use esm_core::Pose;
use esm_io::{
    OpenOptions, PoseFile, PoseWriter, Recording, StampedPose, read_kitti_poses, read_poses, read_tum,
    write_tum,
};
use nalgebra::{Matrix6, Vector3};
use proptest::prelude::*;

use crate::bytes_cdr::CloudMessage;
use crate::bytes_mcap::{CLOUD, Mcap};
use crate::support::{TestFile, read_all};

fn pose(x: f64, yaw: f64) -> Pose {
    Pose::new(Vector3::new(x, 2.0, -3.0), Vector3::new(0.1, -0.2, yaw))
}

#[test]
fn tum_with_comments_and_blank_lines() {
    let file = TestFile::new(
        "t.tum",
        "# stamp x y z qx qy qz qw\n\n1317600335.250000000 1 2 3 0 0 0 1\r\n  1317600335.25 4 5 6 0 0 0.999 0\n\
         1.3176003355e9\t7 8 9 0 0 0 -1\n",
    );
    let poses = read_tum(&file.path).unwrap();
    let stamps: Vec<i64> = poses.iter().map(|p| p.stamp_ns).collect();
    assert_eq!(stamps, [1_317_600_335_250_000_000, 1_317_600_335_250_000_000, 1_317_600_335_500_000_000]);
    assert_eq!(poses[0].pose, Pose::translation(1.0, 2.0, 3.0));
    assert_eq!(poses[0].stamp(), 1_317_600_335.25);
    assert!((poses[1].pose.rotation.angle() - std::f64::consts::PI).abs() < 1e-12);
    assert_eq!(read_poses(&file.path).unwrap(), PoseFile::Stamped(poses));
}

#[test]
fn kitti_rows_become_rotations() {
    let file = TestFile::new("p.txt", "1 0 0 4 0 1 0 5 0 0 1 6\n0 -1.001 0 1 1 0 0 2 0 0 0.999 3\n");
    let poses = read_kitti_poses(&file.path).unwrap();
    assert_eq!(poses[0], Pose::translation(4.0, 5.0, 6.0));
    let quarter = Pose::new(Vector3::new(1.0, 2.0, 3.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
    assert!((poses[1].to_homogeneous() - quarter.to_homogeneous()).abs().max() < 1e-12);
    assert_eq!(read_poses(&file.path).unwrap().len(), 2);
}

#[test]
fn broken_trajectories() {
    let tum = "hint: a TUM line is 'stamp x y z qx qy qz qw'";
    let kitti = "hint: a KITTI line has 12 numbers: r11 r12 r13 tx r21 r22 r23 ty r31 r32 r33 tz";
    let far =
        "is out of range, farther than 1e9 m\nhint: positions are metres; check the columns' order and units";
    let cases = [
        (
            "# nothing\n",
            "the file holds no poses\nhint: a TUM line is 'stamp x y z qx qy qz qw', a KITTI line 12 numbers",
        ),
        (
            "",
            "the file holds no poses\nhint: a TUM line is 'stamp x y z qx qy qz qw', a KITTI line 12 numbers",
        ),
        (
            "1 2 3\n",
            "line 1: 3 values: a TUM line has 8 (stamp x y z qx qy qz qw), a KITTI line 12\nhint: check that this is a file of poses",
        ),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n", &format!("line 2: 7 values, a TUM line has 8\n{tum}")),
        ("now 0 0 0 0 0 0 1\n", &format!("line 1: 'now' is no time in seconds\n{tum}")),
        ("1 0 0 zero 0 0 0 1\n", &format!("line 1: 'zero' is no number\n{tum}")),
        (
            "1 0 0 0 0 0 0 0\n",
            "line 1: the position is not finite or the quaternion is not of length 1\nhint: the order is x y z w, the scalar last",
        ),
        (
            "1 0 0 nan 0 0 0 1\n",
            "line 1: the position is not finite or the quaternion is not of length 1\nhint: the order is x y z w, the scalar last",
        ),
        (
            "2 0 0 0 0 0 0 1\n\n1.5 0 0 0 0 0 0 1\n",
            "line 3: the time goes backwards to 1.5\nhint: sort the lines by time",
        ),
        (
            "1 0 0 0 0 1 0 0 0 0 1\n",
            "line 1: 11 values: a TUM line has 8 (stamp x y z qx qy qz qw), a KITTI line 12\nhint: check that this is a file of poses",
        ),
        (
            "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1\n",
            &format!("line 2: 11 values, a KITTI line has 12\n{kitti}"),
        ),
        ("1 0 0 0 0 1 0 0 0 0 one 0\n", &format!("line 1: 'one' is no number\n{kitti}")),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", &format!("line 1: the matrix is no rigid motion\n{kitti}")),
        ("2 0 0 0 0 1 0 0 0 0 1 0\n", &format!("line 1: the matrix is no rigid motion\n{kitti}")),
        ("1 0 0 inf 0 1 0 0 0 0 1 0\n", &format!("line 1: the matrix is no rigid motion\n{kitti}")),
        ("1 0 0 5 0 1 0 -2.5e9 0 0 1 0\n", &format!("line 1: the position 5 -2.5e9 0 {far}")),
        ("1 0 0 0 0 0 0 1\n2 1e308 0.5 0 0 0 0 1\n", &format!("line 2: the position 1e308 0.5 0 {far}")),
        ("nan 0 0 0 0 1 0 0 0 0 1 0\n", &format!("line 1: the matrix is no rigid motion\n{kitti}")),
    ];
    for (text, message) in cases {
        let file = TestFile::new("p.txt", text);
        assert_eq!(file.message(&read_poses(&file.path).unwrap_err()), format!("p.txt: {message}"));
    }
}

#[test]
fn writing_replaces_a_file_whole() {
    let file = TestFile::new("out.tum", "old");
    let poses = [1_317_600_335_250_000_001, 1_317_600_335_750_000_000]
        .map(|t| StampedPose { stamp_ns: t, pose: pose(1.0, 0.5) });
    write_tum(&file.path, poses).unwrap();
    let back = read_tum(&file.path).unwrap();
    for (a, b) in poses.iter().zip(&back) {
        assert_eq!(a.stamp_ns, b.stamp_ns);
        assert!((a.pose.to_homogeneous() - b.pose.to_homogeneous()).abs().max() < 2e-9);
    }
    let left: Vec<_> = std::fs::read_dir(file.path.parent().unwrap()).unwrap().collect();
    assert_eq!(left.len(), 1, "no temporary file stays behind");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(&file.path).unwrap().permissions().mode();
        assert_eq!(mode & 0o600, 0o600);
    }
    let missing = file.path.parent().unwrap().join("no/out.tum");
    let error = write_tum(&missing, poses).unwrap_err();
    assert_eq!(
        file.message(&error),
        "no/out.tum: creating: entity not found\n\
         hint: check the spelling; relative paths start at the working directory"
    );
}

#[test]
fn poses_as_mcap_are_read_by_name_of_topic() {
    let file = TestFile::new("out.mcap", "");
    let mut writer = PoseWriter::create(&file.path, "/localization", "map").unwrap();
    let covariance = Matrix6::from_fn(|r, c| if r == c { 1.0 + r as f64 } else { 0.25 });
    let mut row_major = [0.0; 36];
    row_major.copy_from_slice(covariance.as_slice());
    writer.write(5_000_000_123, &pose(4.0, 1.0), Some(&row_major)).unwrap();
    writer.write(6_000_000_000, &pose(5.0, 1.0), None).unwrap();
    writer.finish().unwrap();

    // Its clouds are missing: the listing proves topic, type and number of messages.
    let error = Recording::open(&file.path, &OpenOptions::default()).unwrap_err();
    assert_eq!(
        file.message(&error),
        "out.mcap: no topic holds sensor_msgs/msg/PointCloud2; the topics are /localization \
         (geometry_msgs/msg/PoseWithCovarianceStamped, 2 messages)\nhint: record the lidar's PointCloud2 topic"
    );
    // The library's own reader gives the message back; its fields are taken apart here, byte by byte.
    let bytes = std::fs::read(&file.path).unwrap();
    let messages: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages[0].log_time, 5_000_000_123);
    let schema = messages[0].channel.schema.as_ref().unwrap();
    assert_eq!(
        (schema.name.as_str(), schema.encoding.as_str()),
        ("geometry_msgs/msg/PoseWithCovarianceStamped", "ros2msg")
    );
    let data = &messages[0].data;
    assert_eq!(&data[..20], b"\x00\x01\x00\x00\x05\x00\x00\x00\x7b\x00\x00\x00\x04\x00\x00\x00map\x00");
    let f64_at = |i: usize| f64::from_le_bytes(data[20 + 8 * i..][..8].try_into().unwrap());
    assert_eq!(data.len(), 20 + 8 * 43);
    assert_eq!([f64_at(0), f64_at(1), f64_at(2)], [4.0, 2.0, -3.0]);
    let written = pose(4.0, 1.0);
    assert!((f64_at(6) - written.rotation.w).abs() < 1e-15);
    // Turned to the map's axes: the position's block is R C R', entry by entry.
    let r = written.rotation.to_rotation_matrix();
    let block = r.matrix() * covariance.fixed_view::<3, 3>(0, 0) * r.matrix().transpose();
    let mixed = r.matrix() * covariance.fixed_view::<3, 3>(0, 3) * r.matrix().transpose();
    for (row, column) in [(0, 0), (0, 1), (2, 1), (2, 2)] {
        assert!((f64_at(7 + 6 * row + column) - block[(row, column)]).abs() < 1e-12);
        assert!((f64_at(7 + 6 * row + column + 3) - mixed[(row, column)]).abs() < 1e-12);
    }
}

#[test]
fn a_writer_that_is_dropped_leaves_nothing() {
    let file = TestFile::new("other", "");
    let path = file.path.with_file_name("out.mcap");
    let mut writer = PoseWriter::create(&path, "/localization", "map").unwrap();
    writer.write(1, &pose(0.0, 0.0), None).unwrap();
    drop(writer);
    assert_eq!(std::fs::read_dir(file.path.parent().unwrap()).unwrap().count(), 1);
}

#[test]
fn own_poses_can_be_the_motion_when_asked_for() {
    let path = TestFile::new("out.mcap", "");
    let mut writer = PoseWriter::create(&path.path, "/localization", "map").unwrap();
    writer.write(1_000_000_000, &pose(4.0, 1.0), None).unwrap();
    writer.finish().unwrap();
    let bytes = std::fs::read(&path.path).unwrap();
    let message = mcap::MessageStream::new(&bytes).unwrap().next().unwrap().unwrap();

    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).channel(
        2,
        "/localization",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
    );
    mcap.message(1, 1, &CloudMessage::plain(1_000_000_000, "lidar", &[[1.0; 3]]).encode());
    mcap.message(2, 1, &message.data);
    let file = TestFile::new("r.mcap", mcap.finished());
    let all = read_all(&file.path, &OpenOptions::default());
    assert_eq!(all.sweeps[0].pose_odom_sensor, None);
    let options = OpenOptions { motion_topic: Some("/localization".to_owned()), ..OpenOptions::default() };
    let all = read_all(&file.path, &options);
    assert_eq!((all.error, all.warnings), (None, vec![]));
    let got = all.sweeps[0].pose_odom_sensor.unwrap();
    assert!((got.to_homogeneous() - pose(4.0, 1.0).to_homogeneous()).abs().max() < 1e-15);
}

proptest! {
    #[test]
    fn tum_round_trip(poses in proptest::collection::vec((any::<u32>(), -1e6..1e6f64, -3.0..3.0f64), 1..20)) {
        let mut stamp = -5_000_000_000;
        let poses: Vec<_> = poses.iter().map(|&(step, x, yaw)| {
            stamp += i64::from(step);
            StampedPose { stamp_ns: stamp, pose: pose(x, yaw) }
        }).collect();
        let file = TestFile::new("t.tum", "");
        write_tum(&file.path, poses.iter().copied()).unwrap();
        let back = read_tum(&file.path).unwrap();
        prop_assert_eq!(back.len(), poses.len());
        for (a, b) in poses.iter().zip(&back) {
            prop_assert_eq!(a.stamp_ns, b.stamp_ns);
            prop_assert!((a.pose.translation.vector - b.pose.translation.vector).norm() < 2e-9);
            prop_assert!(a.pose.rotation.angle_to(&b.pose.rotation) < 1e-8);
        }
    }

    #[test]
    fn noise_never_panics(text in "([0-9.eE+-]{0,4}[ \n]){0,60}") {
        let file = TestFile::new("p.txt", text);
        let _ = read_poses(&file.path);
    }
}

//! The choice of topics, and files that are no recording.

use esm_io::{Error, OpenOptions, Recording};

use crate::bytes_cdr::{CloudMessage, odometry, pose_stamped, tf, yaw};
use crate::bytes_mcap::{CLOUD, MAGIC, Mcap, ODOMETRY, POSE, TF, record};
use crate::support::{TestFile, read_all};

fn cloud() -> Vec<u8> {
    CloudMessage::plain(1_000_000_000, "lidar", &[[1.0; 3]]).encode()
}

/// A file with these topics, each with one message that fits its type.
fn with_topics(topics: &[(&str, &str)]) -> Mcap {
    let mut mcap = Mcap::new();
    for (i, (topic, schema)) in topics.iter().enumerate() {
        let id = i as u16 + 1;
        let t = [i as f64, 0.0, 0.0];
        let message = match *schema {
            CLOUD => cloud(),
            ODOMETRY => odometry(1_000_000_000, "odom", "lidar", t, yaw(0.0)),
            POSE => pose_stamped(1_000_000_000, "odom", t, yaw(0.0)),
            TF if *topic == "/tf_static" => tf(&[(0, "lidar", "camera", t, yaw(0.0))]),
            TF => tf(&[(1_000_000_000, "odom", "lidar", t, yaw(0.0))]),
            _ => vec![],
        };
        mcap.channel(id, topic, schema).message(id, 1, &message);
    }
    mcap
}

fn open(
    mcap: &Mcap,
    cloud: Option<&str>,
    motion: Option<&str>,
) -> Result<(String, Option<String>), (String, Vec<String>)> {
    let options = OpenOptions {
        cloud_topic: cloud.map(str::to_owned),
        motion_topic: motion.map(str::to_owned),
        poses: None,
        ..OpenOptions::default()
    };
    // With and without a summary the answer is the same.
    let answers = [mcap.finished(), mcap.without_summary(), mcap.unfinished()].map(|bytes| {
        let file = TestFile::new("r.mcap", bytes);
        match Recording::open(&file.path, &options) {
            Ok(r) => Ok((r.cloud_topic().unwrap().to_owned(), r.motion_topic().map(str::to_owned))),
            Err(e) => {
                let candidates =
                    if let Error::Topic { candidates, .. } = &e { candidates.clone() } else { vec![] };
                Err((file.message(&e), candidates))
            }
        }
    });
    assert_eq!(answers[0], answers[1]);
    assert_eq!(answers[0], answers[2]);
    answers[0].clone()
}

#[test]
fn the_only_candidate_is_taken() {
    let mcap = with_topics(&[("/camera", "sensor_msgs/msg/Image"), ("/points", CLOUD), ("/odom", ODOMETRY)]);
    assert_eq!(open(&mcap, None, None), Ok(("/points".to_owned(), Some("/odom".to_owned()))));
    let mcap = with_topics(&[("/points", "sensor_msgs/PointCloud2")]);
    assert_eq!(open(&mcap, None, None), Ok(("/points".to_owned(), None)));
}

#[test]
fn odometry_before_poses_before_transforms() {
    let all = [("/points", CLOUD), ("/tf", TF), ("/tf_static", TF), ("/pose", POSE), ("/odom", ODOMETRY)];
    for (n, expected) in
        [(5, Some("/odom")), (4, Some("/pose")), (3, Some("/tf")), (2, Some("/tf")), (1, None)]
    {
        assert_eq!(open(&with_topics(&all[..n]), None, None).unwrap().1.as_deref(), expected);
    }
    assert_eq!(open(&with_topics(&all), None, Some("/tf")).unwrap().1.as_deref(), Some("/tf"));
    // The flag is obeyed in what comes out, too: each message tells its own x.
    let file = TestFile::new("r.mcap", with_topics(&all).finished());
    for (topic, x) in [("/tf", 1.0), ("/pose", 3.0), ("/odom", 4.0)] {
        let options = OpenOptions { motion_topic: Some(topic.to_owned()), ..OpenOptions::default() };
        let all = read_all(&file.path, &options);
        assert_eq!(all.sweeps[0].pose_odom_sensor.unwrap().translation.x, x);
    }
}

#[test]
fn several_candidates_are_listed_with_the_flag() {
    let mcap = with_topics(&[("/rear", CLOUD), ("/front", CLOUD), ("/b", ODOMETRY), ("/a", ODOMETRY)]);
    assert_eq!(
        open(&mcap, None, None),
        Err((
            "r.mcap: 2 topics hold clouds: /front (sensor_msgs/msg/PointCloud2, 1 messages), /rear \
             (sensor_msgs/msg/PointCloud2, 1 messages)\nhint: name one of them with --cloud-topic"
                .to_owned(),
            vec!["/front".to_owned(), "/rear".to_owned()]
        ))
    );
    assert_eq!(
        open(&mcap, Some("/rear"), None).unwrap_err().0,
        "r.mcap: 2 topics hold motion: /a (nav_msgs/msg/Odometry, 1 messages), /b (nav_msgs/msg/Odometry, 1 messages)\n\
         hint: name one of them with --odometry-topic"
    );
    assert_eq!(open(&mcap, Some("/rear"), Some("/b")), Ok(("/rear".to_owned(), Some("/b".to_owned()))));
    // A file of poses makes the choice of a motion needless.
    let file = TestFile::new("r.mcap", mcap.finished());
    let poses = TestFile::new("p.tum", "1 9 0 0 0 0 0 1\n");
    let options = OpenOptions {
        cloud_topic: Some("/front".to_owned()),
        motion_topic: None,
        poses: Some(poses.path.clone()),
        ..OpenOptions::default()
    };
    let all = read_all(&file.path, &options);
    assert_eq!(all.sweeps[0].pose_odom_sensor.unwrap().translation.x, 9.0);
}

#[test]
fn a_topic_by_two_publishers_is_one_topic() {
    let mut mcap = with_topics(&[("/points", CLOUD)]);
    mcap.channel(7, "/points", CLOUD).message(7, 2, &cloud());
    let file = TestFile::new("r.mcap", mcap.finished());
    assert_eq!(read_all(&file.path, &OpenOptions::default()).sweeps.len(), 2);
}

#[test]
fn topics_without_messages_are_no_candidates() {
    let mut mcap = with_topics(&[("/points", CLOUD)]);
    mcap.channel(7, "/silent", CLOUD).channel(8, "/odom", ODOMETRY);
    assert_eq!(open(&mcap, None, None), Ok(("/points".to_owned(), None)));
    let mut silent = Mcap::new();
    silent.channel(1, "/points", CLOUD);
    assert_eq!(
        open(&silent, None, None).unwrap_err().0,
        "r.mcap: the cloud topic /points holds no message\nhint: record the lidar's PointCloud2 topic"
    );
}

#[test]
fn wrong_names_and_types() {
    let mcap = with_topics(&[("/points", CLOUD), ("/odom", ODOMETRY)]);
    assert_eq!(
        open(&mcap, Some("/point"), None).unwrap_err().0,
        "r.mcap: there is no topic /point; the topics are /odom (nav_msgs/msg/Odometry, 1 messages), /points \
         (sensor_msgs/msg/PointCloud2, 1 messages)\nhint: name one of them with --cloud-topic"
    );
    assert_eq!(
        open(&mcap, Some("/odom"), None).unwrap_err().0,
        "r.mcap: the topic /odom holds nav_msgs/msg/Odometry, not sensor_msgs/msg/PointCloud2\n\
         hint: name another topic with --cloud-topic"
    );
    assert_eq!(
        open(&mcap, None, Some("/points")).unwrap_err().0,
        "r.mcap: the topic /points holds sensor_msgs/msg/PointCloud2, not nav_msgs/msg/Odometry or \
         geometry_msgs/msg/PoseStamped or tf2_msgs/msg/TFMessage or geometry_msgs/msg/PoseWithCovarianceStamped\n\
         hint: name another topic with --odometry-topic"
    );
    let mut ros1 = Mcap::new();
    ros1.channel_encoded(1, "/points", "sensor_msgs/PointCloud2", "ros1").message(1, 1, &[0; 9]);
    assert_eq!(
        open(&ros1, None, None).unwrap_err().0,
        "r.mcap: the topic /points is encoded as 'ros1', not as ROS 2's cdr\n\
         hint: convert the recording to ROS 2 messages"
    );
    assert_eq!(
        open(&with_topics(&[("/odom", ODOMETRY)]), None, None).unwrap_err().0,
        "r.mcap: no topic holds sensor_msgs/msg/PointCloud2; the topics are /odom (nav_msgs/msg/Odometry, 1 messages)\n\
         hint: record the lidar's PointCloud2 topic"
    );
}

#[test]
fn files_that_are_no_mcap() {
    let fails = |bytes: &[u8], message: &str| {
        let file = TestFile::new("r.mcap", bytes);
        let error = Recording::open(&file.path, &OpenOptions::default()).unwrap_err();
        assert_eq!(file.message(&error), message);
    };
    fails(
        b"",
        "r.mcap: the file is empty (0 bytes)\nhint: the copy may be incomplete; compare the file's size with the \
         original's",
    );
    let not = "r.mcap: does not start with MCAP's magic bytes\n\
               hint: check that this is an MCAP recording and that its copy is complete";
    fails(b"some text", not);
    fails(&MAGIC[..7], not);
    fails(
        b"#ROSBAG V2.0\n",
        "r.mcap: is a ROS 1 bag, not MCAP\nhint: convert it: 'mcap convert in.bag out.mcap', then to ROS 2 messages",
    );
    fails(
        b"SQLite format 3\0",
        "r.mcap: is a ROS 2 bag of the sqlite3 kind, not MCAP\nhint: convert it: 'ros2 bag convert' with storage_id: mcap",
    );
    fails(
        MAGIC,
        "r.mcap: the file ends at byte 8 without its closing records: no intact message is left in the recording\n\
         hint: copy the recording again from where it was made; 'mcap recover' may help",
    );
}

#[test]
fn unknown_compression_is_named() {
    let mut mcap = Mcap::new();
    mcap.begin_chunk().channel(1, "/points", CLOUD).message(1, 1, &cloud()).end_chunk_as("snappy", true);
    for bytes in [mcap.finished(), mcap.unfinished()] {
        let file = TestFile::new("r.mcap", bytes);
        assert_eq!(
            read_all(&file.path, &OpenOptions::default()).error.unwrap(),
            "r.mcap: chunk at byte 36: chunks are compressed with 'snappy', which is not known\n\
             hint: known are zstd, lz4 and none; convert with 'mcap compress --compression zstd'"
        );
    }
}

#[test]
fn records_of_other_kinds_are_passed_over() {
    // A private record, an attachment larger than any limit on messages would like, metadata: all skipped.
    let mut mcap = with_topics(&[("/points", CLOUD)]);
    mcap.bytes.extend(record(0x99, b"private"));
    mcap.bytes.extend(record(0x09, &vec![1; 3_000_000]));
    mcap.bytes.extend(record(0x0C, &[0; 8]));
    mcap.message(1, 2, &cloud());
    for bytes in [mcap.finished(), mcap.without_summary()] {
        let file = TestFile::new("r.mcap", bytes);
        let all = read_all(&file.path, &OpenOptions::default());
        assert_eq!((all.sweeps.len(), all.warnings, all.error), (2, vec![], None));
    }
}

/// Intact files with names that are not kept: the cause is told, and the other topics are read.
#[test]
fn long_names_are_named_as_the_cause() {
    let long = "/".repeat(2000);
    let build = |cloud: &str, other: &str, chunked: bool| {
        let mut mcap = Mcap::new();
        if chunked {
            mcap.begin_chunk();
        }
        mcap.channel(1, cloud, CLOUD);
        if !other.is_empty() {
            mcap.channel(2, other, ODOMETRY).message(2, 1, b"x");
        }
        mcap.message(1, 1, &CloudMessage::plain(1, "lidar", &[[1.0; 3]]).encode());
        if chunked {
            mcap.end_chunk();
        }
        TestFile::new("r.mcap", mcap.finished())
    };
    let why = "a name of 2000 bytes is longer than 1024";
    for (chunked, alone, second) in
        [(false, "at byte 93", "at byte 179"), (true, "in the chunk at byte 36", "in the chunk at byte 36")]
    {
        let file = build(&long, "", chunked);
        let error = Recording::open(&file.path, &OpenOptions::default()).unwrap_err();
        assert_eq!(
            file.message(&error),
            format!(
                "r.mcap: the definition {alone}: {why}\nhint: record or convert it with shorter names of topics and \
                 message types"
            )
        );
        let file = build(&long, "/odom", chunked);
        let error = Recording::open(&file.path, &OpenOptions::default()).unwrap_err();
        let text = file.message(&error);
        let left_out = format!("; the definition {alone} was left out: {why}\nhint: ");
        assert!(
            text.starts_with("r.mcap: no topic holds sensor_msgs/msg/PointCloud2")
                && text.contains(&left_out),
            "{text}"
        );
        let file = build("/points", &long, chunked);
        let all = read_all(&file.path, &OpenOptions::default());
        assert_eq!((all.error, all.sweeps.len()), (None, 1));
        let start =
            format!("r.mcap: the recording is damaged: the definition {second} cannot be used: {why}; ");
        assert!(all.warnings[0].starts_with(&start), "{:?}", all.warnings);
    }
}

/// Names from a file cannot write to the terminal what they like.
#[test]
fn control_characters_in_names_are_escaped() {
    let (points, odom) = ("/points\u{1b}[2J", "/odom\r\n");
    let mut mcap = Mcap::new();
    mcap.channel(1, points, CLOUD).channel(2, odom, ODOMETRY);
    let cloud = |stamp| CloudMessage::plain(stamp, "li\u{7}dar", &[[1.0; 3]]).encode();
    mcap.message(1, 1, &cloud(1)).message(1, 1, &[]).message(1, 1, &cloud(900_000_000));
    mcap.message(2, 1, &odometry(1, "odom", "base\tlink", [0.0; 3], yaw(0.0)));
    let file = TestFile::new("r.mcap", mcap.finished());
    let all = read_all(&file.path, &OpenOptions::default());
    let [damage, mounting, motion] = all.warnings.as_slice() else { panic!("{:?}", all.warnings) };
    assert!(damage.contains(r"message 2 of /points\u{1b}[2J contradicts itself"), "{damage}");
    assert!(mounting.contains(r"between 'base\tlink' and 'li\u{7}dar' is recorded"), "{mounting}");
    assert!(motion.contains(r"/odom\r\n gives no pose for 1 of 2 sweeps"), "{motion}");
    let options = OpenOptions { cloud_topic: Some("/x".to_owned()), ..OpenOptions::default() };
    let error = Recording::open(&file.path, &options).unwrap_err();
    assert_eq!(
        file.message(&error),
        r"r.mcap: there is no topic /x; the topics are /odom\r\n (nav_msgs/msg/Odometry, 1 messages), "
            .to_owned()
            + r"/points\u{1b}[2J (sensor_msgs/msg/PointCloud2, 3 messages)"
            + "\nhint: name one of them with --cloud-topic"
    );
}

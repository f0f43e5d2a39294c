//! PointCloud2 in every layout, and what is refused.

use esm_io::OpenOptions;
use proptest::prelude::*;

use crate::bytes_cdr::CloudMessage;
use crate::bytes_mcap::{CLOUD, Mcap};
use crate::support::{ReadAll, TestFile, read_all};

/// A recording of one message on /points.
fn read_message(message: &[u8]) -> ReadAll {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD).message(1, 1, message);
    let file = TestFile::new("r.mcap", mcap.without_summary());
    read_all(&file.path, &OpenOptions::default())
}

#[track_caller]
fn fails(cloud: &CloudMessage, what: &str) {
    let all = read_message(&cloud.encode());
    assert_eq!(
        all.error.unwrap(),
        format!(
            "r.mcap: message 1 of /points: {what}\nhint: the program that recorded this wrote a message that contradicts \
             itself; record or convert it anew"
        )
    );
}

fn plain() -> CloudMessage {
    CloudMessage::plain(1_317_600_335_250_000_001, "/lidar", &[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
}

#[test]
fn plain_layout_with_invalid_returns() {
    let nan = f32::NAN;
    let points =
        [[1.0, 2.0, 3.0], [nan, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, f32::INFINITY, 0.0], [0.0, -0.5, 0.0]];
    let all = read_message(&CloudMessage::plain(1_317_600_335_250_000_001, "/lidar", &points).encode());
    assert_eq!((all.error, all.warnings), (None, vec![]));
    let sweep = &all.sweeps[0];
    assert_eq!(sweep.cloud.points(), [[1.0, 2.0, 3.0], [0.0, -0.5, 0.0]]);
    assert_eq!((sweep.number, sweep.dropped, sweep.frame_id.as_str()), (1, 3, "lidar"));
    assert_eq!(sweep.stamp_ns, 1_317_600_335_250_000_001);
    assert_eq!(sweep.pose_odom_sensor, None);
}

#[test]
fn row_step_of_zero_and_of_one_row_is_not_believed() {
    for row_step in [0, 7, u32::MAX] {
        let cloud = CloudMessage { row_step, ..plain() };
        assert_eq!(read_message(&cloud.encode()).sweeps[0].cloud.len(), 2);
    }
}

#[test]
fn messages_that_contradict_themselves() {
    fails(
        &CloudMessage { data: plain().data[..23].to_vec(), ..plain() },
        "1 x 2 points of 12 bytes need 24 bytes of data, 23 are there".replace("1 x 2", "2 x 1").as_str(),
    );
    fails(
        &CloudMessage { width: u32::MAX, height: u32::MAX, row_step: 0, ..plain() },
        "4294967295 x 4294967295 points of 12 bytes need 18446744073709551615 bytes of data, 24 are there",
    );
    fails(&CloudMessage { point_step: 11, ..plain() }, "point_step is 11, the coordinates reach to byte 12");
    fails(&CloudMessage { point_step: 0, ..plain() }, "point_step is 0, the coordinates reach to byte 12");
    fails(
        &CloudMessage { height: 2, width: 1, row_step: 11, ..plain() },
        "row_step is 11, 1 points of 12 bytes need 12",
    );
    let mut cloud = plain();
    cloud.fields[2].0 = "intensity".to_owned();
    fails(&cloud, "the fields are [x, y, intensity]: x, y and z are needed");
    cloud = plain();
    cloud.fields[1].2 = 9;
    fails(&cloud, "field y has the datatype 9, which is not known");
    cloud = plain();
    cloud.fields[1].1 = u32::MAX;
    fails(&cloud, "point_step is 12, the coordinates reach to byte 4294967299");
}

/// One such message among good ones is left out, counted and named; places in files of poses stay what they were.
#[test]
fn one_bad_message_does_not_end_the_recording() {
    let mut unknown_type = plain();
    unknown_type.fields[1].2 = 9;
    let bad = [
        (
            CloudMessage { point_step: 0, ..plain() }.encode(),
            "point_step is 0, the coordinates reach to byte 12",
        ),
        (
            CloudMessage { width: u32::MAX, ..plain() }.encode(),
            "4294967295 x 1 points of 12 bytes need 51539607540 bytes of data, 24 are there",
        ),
        (unknown_type.encode(), "field y has the datatype 9, which is not known"),
        (Vec::new(), "the message has 0 bytes, fewer than CDR's header"),
    ];
    for (bad, what) in bad {
        let mut mcap = Mcap::new();
        mcap.channel(1, "/points", CLOUD);
        for message in [&plain().encode(), &bad, &plain().encode()] {
            mcap.message(1, 1, message);
        }
        let poses = TestFile::new(
            "p.txt",
            "1 0 0 1 0 1 0 0 0 0 1 0\n1 0 0 2 0 1 0 0 0 0 1 0\n1 0 0 3 0 1 0 0 0 0 1 0\n",
        );
        for bytes in [mcap.finished(), mcap.without_summary()] {
            let file = TestFile::new("r.mcap", bytes);
            let options = OpenOptions { poses: Some(poses.path.clone()), ..OpenOptions::default() };
            let all = read_all(&file.path, &options);
            assert_eq!(all.error, None);
            let told: Vec<_> = all
                .sweeps
                .iter()
                .map(|s| (s.number, s.cloud.len(), s.pose_odom_sensor.unwrap().translation.x))
                .collect();
            assert_eq!(told, [(1, 2, 1.0), (2, 2, 3.0)]);
            let warning = format!(
                "r.mcap: the recording is damaged: message 2 of /points contradicts itself: {what}; every intact \
                 message was used, lost are 1 message, among them 1 cloud"
            );
            assert_eq!(all.warnings, [warning]);
        }
    }
}

#[test]
fn cut_messages_name_themselves() {
    let whole = plain().encode();
    // Without the last byte only is_dense is missing, which is not needed.
    for cut in 0..whole.len() - 1 {
        let error = read_message(&whole[..cut]).error.unwrap();
        assert!(error.starts_with("r.mcap: message 1 of /points: the message "), "{cut}: {error}");
        assert!(error.contains("\nhint: "));
    }
    assert_eq!(read_message(&whole[..whole.len() - 1]).sweeps.len(), 1);
}

#[test]
fn empty_clouds_count_but_do_not_make_a_recording() {
    let mut mcap = Mcap::new();
    let empty = CloudMessage { width: 0, fields: vec![], data: vec![], ..plain() };
    mcap.channel(1, "/points", CLOUD).message(1, 1, &empty.encode());
    let file = TestFile::new("r.mcap", mcap.finished());
    let all = read_all(&file.path, &OpenOptions::default());
    assert_eq!(all.sweeps.len(), 1);
    assert_eq!(
        all.error.unwrap(),
        "r.mcap: the only cloud holds no usable point (0 invalid ones)\nhint: check the recording in a viewer"
    );
    mcap.message(1, 2, &plain().encode());
    let file = TestFile::new("r.mcap", mcap.finished());
    let all = read_all(&file.path, &OpenOptions::default());
    assert_eq!((all.sweeps.len(), all.error), (2, None));
}

/// A layout: type and gap before each of x, y, z, their order, byte orders, gaps after points and rows.
#[derive(Clone, Debug)]
struct Layout {
    types: [u8; 3],
    gaps: [usize; 4],
    order: [usize; 3],
    row_gap: usize,
    big_data: bool,
    big_cdr: bool,
}

fn layouts() -> impl Strategy<Value = Layout> {
    let order = Just([0usize, 1, 2]).prop_shuffle();
    let parts = (proptest::array::uniform3(1..=8u8), proptest::array::uniform4(0..9usize), order, 0..20usize);
    (parts, any::<bool>(), any::<bool>()).prop_map(|((types, gaps, order, row_gap), big_data, big_cdr)| {
        Layout { types, gaps, order, row_gap, big_data, big_cdr }
    })
}

/// A small whole number as the datatype has it, and what it is then.
fn encode(datatype: u8, v: i32, big: bool) -> (Vec<u8>, f32) {
    let (mut bytes, value) = match datatype {
        1 => (vec![v as i8 as u8], f32::from(v as i8)),
        2 => (vec![v as u8], f32::from(v as u8)),
        3 => ((v as i16).to_le_bytes().to_vec(), f32::from(v as i16)),
        4 => ((v as u16).to_le_bytes().to_vec(), f32::from(v as u16)),
        5 => (v.to_le_bytes().to_vec(), v as f32),
        6 => ((v as u32).to_le_bytes().to_vec(), v as u32 as f32),
        7 => ((v as f32 / 8.0).to_le_bytes().to_vec(), v as f32 / 8.0),
        _ => ((f64::from(v) / 8.0).to_le_bytes().to_vec(), v as f32 / 8.0),
    };
    if big {
        bytes.reverse();
    }
    (bytes, value)
}

proptest! {
    #[test]
    fn any_layout_reads_back(
        layout in layouts(),
        height in 1..4u32,
        width in 1..5u32,
        values in proptest::collection::vec(proptest::array::uniform3(-100_000..100_000i32), 12..13),
    ) {
        let mut fields = vec![("ring".to_owned(), 0, 4, 1)];
        let mut data = Vec::new();
        let mut expected = Vec::new();
        let mut point_step = 0;
        for row in 0..height {
            for column in 0..width {
                let v = values[(row * 4 + column) as usize % values.len()];
                let start = data.len();
                let mut point = [0.0; 3];
                for &axis in &layout.order {
                    data.resize(data.len() + layout.gaps[axis], 0xEE);
                    if (row, column) == (0, 0) {
                        let name = ["x", "y", "z"][axis].to_owned();
                        fields.push((name, (data.len() - start) as u32, layout.types[axis], 1));
                    }
                    let (bytes, value) = encode(layout.types[axis], v[axis], layout.big_data);
                    data.extend(bytes);
                    point[axis] = value;
                }
                data.resize(data.len() + layout.gaps[3], 0xEE);
                point_step = data.len() - start;
                expected.push(point);
            }
            data.resize(data.len() + layout.row_gap, 0xEE);
        }
        // The last row may come without its padding.
        data.truncate(data.len() - layout.row_gap);
        let cloud = CloudMessage {
            big_cdr: layout.big_cdr,
            stamp_ns: 1,
            frame: "lidar".to_owned(),
            height,
            width,
            fields,
            big_data: layout.big_data,
            point_step: point_step as u32,
            row_step: width * point_step as u32 + layout.row_gap as u32,
            data,
        };
        let all = read_message(&cloud.encode());
        let before = expected.len();
        expected.retain(|p| p != &[0.0; 3]);
        prop_assume!(!expected.is_empty());
        prop_assert_eq!(all.error, None);
        prop_assert_eq!(all.sweeps[0].cloud.points(), expected.as_slice());
        prop_assert_eq!(all.sweeps[0].dropped, before - expected.len());
    }

    #[test]
    fn noise_never_panics(message in proptest::collection::vec(any::<u8>(), 0..200)) {
        let all = read_message(&message);
        prop_assert!(all.error.is_some() || !all.sweeps.is_empty());
    }

    #[test]
    fn altered_messages_never_panic(at in 0..148usize, value in any::<u8>()) {
        let mut message = plain().encode();
        let n = message.len();
        message[at % n] = value;
        let all = read_message(&message);
        prop_assert!(all.error.is_some() || !all.sweeps.is_empty());
    }
}

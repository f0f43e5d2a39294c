//! Torn and damaged recordings: every intact message is used, and the loss is told.

use std::collections::BTreeMap;
use std::io::Cursor;

use esm_io::{Damage, Lost, OpenOptions, Warning};

use crate::bytes_cdr::{CloudMessage, odometry, yaw};
use crate::bytes_mcap::{CLOUD, Mcap, ODOMETRY};
use crate::support::{ReadAll, TestFile, read_all};

const SECOND: i64 = 1_000_000_000;

fn cloud(i: usize) -> Vec<u8> {
    let points: Vec<_> = (0..20).map(|k| [i as f32 + 1.0, k as f32, (i * k) as f32]).collect();
    CloudMessage::plain(i as i64 * SECOND, "lidar", &points).encode()
}

fn motion(i: usize) -> Vec<u8> {
    odometry(i as i64 * SECOND, "odom", "lidar", [i as f64, 0.0, 0.0], yaw(0.0))
}

/// Chunks of three clouds and three odometry messages each, uncompressed.
fn by_hand(chunks: usize, with_crc: bool) -> Mcap {
    let mut mcap = Mcap::new();
    for c in 0..chunks {
        mcap.begin_chunk();
        if c == 0 {
            mcap.channel(1, "/points", CLOUD).channel(2, "/odom", ODOMETRY);
        }
        for i in 3 * c..3 * c + 3 {
            mcap.message(1, i as u64, &cloud(i)).message(2, i as u64, &motion(i));
        }
        mcap.end_chunk_as("", with_crc);
    }
    mcap
}

/// The same by the library's writer.
fn by_library(compression: Option<mcap::Compression>, messages: usize, chunk_size: u64) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(compression).chunk_size(Some(chunk_size));
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let mut channel = |schema: &str, topic: &str| {
        let schema = writer.add_schema(schema, "ros2msg", b"").unwrap();
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    };
    let (points, odom) = (channel(CLOUD, "/points"), channel(ODOMETRY, "/odom"));
    for i in 0..messages {
        for (channel_id, data) in [(points, cloud(i)), (odom, motion(i))] {
            let time = i as u64;
            let header =
                mcap::records::MessageHeader { channel_id, sequence: 0, log_time: time, publish_time: time };
            writer.write_to_known_channel(&header, &data).unwrap();
        }
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn read(bytes: &[u8]) -> ReadAll {
    let file = TestFile::new("r.mcap", bytes);
    read_all(&file.path, &OpenOptions::default())
}

fn damage(all: &ReadAll) -> Option<&Damage> {
    all.raw_warnings
        .iter()
        .find_map(|w| if let Warning::Damaged { damage, .. } = w { Some(damage) } else { None })
}

/// The clouds that came, by what their points say; each must be whole and right.
fn which(all: &ReadAll) -> Vec<usize> {
    let each = all.sweeps.iter().enumerate().map(|(n, sweep)| {
        let i = (sweep.stamp_ns / SECOND) as usize;
        let again = read_points(i);
        assert_eq!((sweep.number, sweep.cloud.points()), (n + 1, again.as_slice()));
        i
    });
    each.collect()
}

fn read_points(i: usize) -> Vec<[f32; 3]> {
    (0..20).map(|k| [i as f32 + 1.0, k as f32, (i * k) as f32]).collect()
}

#[test]
fn whole_files_by_hand_and_by_library() {
    use mcap::Compression::{Lz4, Zstd};
    let files = [
        by_hand(3, true).finished(),
        by_hand(3, false).finished(),
        by_hand(3, true).without_summary(),
        by_library(None, 9, 2000),
        by_library(Some(Zstd), 9, 2000),
        by_library(Some(Lz4), 9, 2000),
    ];
    for bytes in files {
        let all = read(&bytes);
        assert_eq!((&all.error, &all.warnings), (&None, &vec![]));
        assert_eq!(which(&all), (0..9).collect::<Vec<_>>());
        for (i, sweep) in all.sweeps.iter().enumerate() {
            assert_eq!(sweep.pose_odom_sensor.unwrap().translation.x, i as f64);
        }
    }
}

/// Cut at every byte: never a panic, never a wrong cloud, and never fewer than are there in full.
#[test]
fn every_cut_of_an_uncompressed_file() {
    let mcap = by_hand(2, true);
    let whole = mcap.finished();
    let ends: Vec<usize> = (0..6)
        .map(|i| {
            let message = cloud(i);
            whole.windows(message.len()).position(|w| w == message).unwrap() + message.len()
        })
        .collect();
    for cut in 8..whole.len() {
        let all = read(&whole[..cut]);
        let there = ends.iter().filter(|&&end| end <= cut).count();
        if there == 0 {
            let error = all.error.unwrap();
            assert!(error.contains("\nhint: ") && error.starts_with("r.mcap: "), "{cut}: {error}");
            continue;
        }
        assert_eq!(all.error, None, "cut at {cut}");
        assert_eq!(which(&all), (0..there).collect::<Vec<_>>(), "cut at {cut}");
        let told = damage(&all);
        if cut < mcap.bytes.len() + 9 {
            // The data section is cut: something is or may be missing.
            assert!(matches!(told.unwrap().lost, Lost::AtLeast(_)), "cut at {cut}: {told:?}");
        } else {
            // Only the summary is cut.
            assert_eq!(told.unwrap().lost, Lost::Exactly(0), "cut at {cut}");
            let what = format!("the file ends at byte {cut} inside its summary; no message was lost");
            assert_eq!(all.warnings, [format!("r.mcap: the recording is damaged: {what}")]);
        }
    }
}

#[test]
fn cuts_of_compressed_files() {
    use mcap::Compression::{Lz4, Zstd};
    for compression in [Zstd, Lz4] {
        let whole = by_library(Some(compression), 400, 60_000);
        let mut last = 0;
        for cut in (100..whole.len()).step_by(whole.len() / 200) {
            let all = read(&whole[..cut]);
            let clouds = which(&all);
            assert_eq!(clouds, (0..clouds.len()).collect::<Vec<_>>());
            assert!(clouds.len() >= last, "a longer piece never gives less");
            last = clouds.len();
            assert_eq!(all.error.is_some(), clouds.is_empty());
            assert!(clouds.len() == 400 || clouds.is_empty() || damage(&all).is_some());
        }
        assert_eq!(last, 400);
    }
}

#[test]
fn a_killed_recorder_says_what_is_known() {
    let mcap = by_hand(2, true);
    let all = read(&mcap.unfinished());
    assert_eq!(which(&all).len(), 6);
    let n = mcap.bytes.len();
    assert_eq!(
        all.warnings,
        [format!(
            "r.mcap: the recording is damaged: the file ends at byte {n} without its closing records; every intact \
             message was used, lost are an unknown number of messages, among them an unknown number of clouds"
        )]
    );
    let cut = mcap.chunks[1] + 1500;
    let all = read(&mcap.bytes[..cut]);
    assert_eq!(which(&all), [0, 1, 2, 3]);
    assert_eq!(
        all.warnings,
        [format!(
            "r.mcap: the recording is damaged: the file ends inside the chunk at byte {}; every intact message was used, \
             lost are at least 1 message, among them an unknown number of clouds",
            mcap.chunks[1]
        )]
    );
}

#[test]
fn an_altered_byte_costs_one_chunk_and_is_counted() {
    let mcap = by_hand(3, true);
    let lost = |n, clouds| (Lost::Exactly(n), Lost::Exactly(clouds));
    for (bytes, name) in [(mcap.finished(), "summary"), (mcap.without_summary(), "indexes")] {
        let mut bytes = bytes;
        bytes[mcap.chunks[1] + 700] ^= 0x10;
        let all = read(&bytes);
        assert_eq!(all.error, None);
        assert_eq!(which(&all), [0, 1, 2, 6, 7, 8], "by {name}");
        let damage = damage(&all).unwrap();
        assert_eq!((damage.lost, damage.lost_clouds), lost(6, 3), "by {name}");
        let place = format!("the chunk at byte {} is broken: Chunk CRC failed", mcap.chunks[1]);
        assert!(damage.places[0].starts_with(&place), "{:?}", damage.places);
        assert!(
            all.warnings[0]
                .ends_with("every intact message was used, lost are 6 messages, among them 3 clouds")
        );
    }
}

/// Every byte of the records altered: never a panic, never a cloud with other points, and the other chunks survive.
#[test]
fn every_byte_altered() {
    let mcap = by_hand(3, true);
    let whole = mcap.finished();
    for at in 8..whole.len() {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x55;
        let all = read(&bytes);
        let Some(error) = &all.error else {
            let clouds = which(&all);
            let expected: &[usize] = match mcap.chunks.iter().rposition(|&c| c <= at) {
                _ if at >= mcap.bytes.len() => &[0, 1, 2, 3, 4, 5, 6, 7, 8],
                Some(0) if clouds.len() < 9 => &[3, 4, 5, 6, 7, 8],
                Some(1) if clouds.len() < 9 => &[0, 1, 2, 6, 7, 8],
                Some(2) if clouds.len() < 9 => &[0, 1, 2, 3, 4, 5],
                _ => &[0, 1, 2, 3, 4, 5, 6, 7, 8],
            };
            assert_eq!(clouds, expected, "byte {at}: {:?}", all.warnings);
            if clouds.len() < 9 {
                let lost = damage(&all).unwrap();
                assert_eq!((lost.lost, lost.lost_clouds), (Lost::Exactly(6), Lost::Exactly(3)), "byte {at}");
            }
            continue;
        };
        // The name of the first chunk's compression, which no later chunk can prove to be damage.
        assert!(error.contains("compressed with"), "byte {at}: {error}");
    }
}

#[test]
fn reading_goes_on_behind_a_wiped_region() {
    let mcap = by_hand(4, true);
    let mut bytes = mcap.unfinished();
    // The head of the second chunk and a good part of it, as a lost disk block leaves it.
    bytes[mcap.chunks[1]..mcap.chunks[1] + 512].fill(0);
    let all = read(&bytes);
    assert_eq!(all.error, None);
    assert_eq!(which(&all), [0, 1, 2, 6, 7, 8, 9, 10, 11]);
    let damage = damage(&all).unwrap();
    let gap = format!("bytes {} to {} are no valid records", mcap.chunks[1], mcap.chunks[2]);
    assert_eq!(damage.places[0], gap);
    assert_eq!(damage.lost, Lost::AtLeast(0));

    let mut bytes = mcap.finished();
    bytes[mcap.chunks[1]..mcap.chunks[1] + 512].fill(0);
    let all = read(&bytes);
    assert_eq!(which(&all).len(), 9);
    assert_eq!(super::mcap_damage::damage(&all).unwrap().lost_clouds, Lost::Exactly(3));
}

#[test]
fn a_zero_filled_tail() {
    let mcap = by_hand(2, true);
    let mut bytes = mcap.unfinished();
    let n = bytes.len();
    bytes.extend([0; 5000]);
    let all = read(&bytes);
    assert_eq!(which(&all).len(), 6);
    assert_eq!(damage(&all).unwrap().places, [format!("the file ends inside the record at byte {n}")]);
}

#[test]
fn nothing_intact_is_an_error() {
    let mcap = by_hand(1, true);
    for bytes in [mcap.finished(), mcap.unfinished()] {
        let mut bytes = bytes;
        bytes[mcap.chunks[0] + 700] ^= 1;
        let all = read(&bytes);
        assert!(all.sweeps.is_empty());
        let error = all.error.unwrap();
        assert!(error.starts_with("r.mcap: the chunk at byte 36 is broken: Chunk CRC failed"), "{error}");
        assert!(error.contains("is left in the recording\nhint: copy the recording again"), "{error}");
    }
}

#[test]
fn loose_messages_are_checked_by_the_data_sections_crc() {
    let mut mcap = Mcap::new();
    mcap.channel(1, "/points", CLOUD);
    for i in 0..5 {
        mcap.message(1, i as u64, &cloud(i));
    }
    let whole = mcap.finished();
    assert_eq!(read(&whole).warnings, Vec::<String>::new());
    let mut altered = whole.clone();
    let at = whole.windows(16).position(|w| w == &cloud(3)[200..216]).unwrap();
    altered[at] ^= 1;
    let all = read(&altered);
    assert_eq!(all.sweeps.len(), 5);
    assert_eq!(
        damage(&all).unwrap().places,
        ["the data section's checksum is wrong: a message may have been altered"]
    );
    for cut in 8..mcap.bytes.len() {
        let all = read(&whole[..cut]);
        let clouds = which(&all);
        assert_eq!(clouds, (0..clouds.len()).collect::<Vec<_>>());
        assert_eq!(all.error.is_some(), clouds.is_empty());
    }
}

#[test]
fn hostile_lengths_allocate_little() {
    // A chunk that claims to unpack to 2^60 bytes, and a record in it that claims 2^50.
    let mut mcap = by_hand(1, true);
    let good = mcap.bytes.len();
    let mut body = vec![0; 16];
    body.extend((1u64 << 60).to_le_bytes());
    body.extend(1u32.to_le_bytes());
    body.extend([0; 4]);
    body.extend(64u64.to_le_bytes());
    body.push(0x05);
    body.extend((1u64 << 50).to_le_bytes());
    body.resize(40 + 64, 0);
    mcap.bytes.extend(crate::bytes_mcap::record(0x06, &body));
    // A message whose length is beyond the file.
    mcap.bytes.push(0x05);
    mcap.bytes.extend(u64::MAX.to_le_bytes());
    let all = read(&mcap.unfinished());
    assert_eq!(which(&all), [0, 1, 2]);
    let places = &damage(&all).unwrap().places;
    assert!(places[0].starts_with(&format!("the chunk at byte {good} is broken")), "{places:?}");
    assert!(places[1].starts_with("the file ends inside the record at byte"), "{places:?}");
}

#[test]
fn a_torn_real_recording() {
    let Some(data) = crate::support::shared_data() else { return };
    let whole = std::fs::read(data.join("kitti00/query.mcap")).unwrap();
    for (cut, least) in [(3_000_000, 50), (7_654_321, 150), (whole.len() - 10, 260)] {
        let all = read(&whole[..cut]);
        assert_eq!(all.error, None);
        assert!(all.sweeps.len() >= least, "{}", all.sweeps.len());
        assert!(all.sweeps.iter().all(|s| s.pose_odom_sensor.is_some() || s.number == all.sweeps.len()));
        println!("cut at {cut}: {} clouds, {:?}", all.sweeps.len(), all.warnings);
    }
}

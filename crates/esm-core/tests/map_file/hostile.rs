//! Files whose checksums are right and whose contents are not: written by a faulty or hostile program.

use esm_core::map::Map;

use crate::seal::{add_section, entry, put, reseal, section, up64};
use crate::{Scratch, bytes_of, refusal, small_data};

/// A change to a good file and what must be said about it.
type Case = (&'static str, fn(&mut Vec<u8>), &'static str);

fn field(bytes: &mut [u8], id: &str, at: usize, value: &[u8]) {
    let start = section(bytes, id).start;
    put(bytes, start + at, value);
}

/// Declares another length of a section, in bytes, without moving anything.
fn declare(bytes: &mut [u8], id: &str, len: u64) {
    let at = entry(bytes, id);
    put(bytes, at + 16, &len.to_le_bytes());
}

/// Shortens a section, within its padding.
fn cut(bytes: &mut [u8], id: &str, len: usize) {
    let range = section(bytes, id);
    assert_eq!(up64(len), up64(range.len()));
    bytes[range.start + len..range.end].fill(0);
    declare(bytes, id, len as u64);
}

fn f32(v: f32) -> [u8; 4] {
    v.to_le_bytes()
}

fn f64(v: f64) -> [u8; 8] {
    v.to_le_bytes()
}

const TABLE: &[Case] = &[
    ("no sections", |b| put(b, 12, &[0; 4]), "0 sections, 1 to 64 are possible"),
    ("65 sections", |b| put(b, 12, &65u32.to_le_bytes()), "65 sections, 1 to 64 are possible"),
    ("4 billion sections", |b| put(b, 12, &[0xFF; 4]), "4294967295 sections"),
    ("reserved", |b| put(b, 30, &[1]), "reserved bytes of the header are not zero"),
    ("one section less", |b| put(b, 12, &14u32.to_le_bytes()), "section META starts at byte 576, not at 512"),
    (
        "two names swapped",
        |b| {
            let (a, z) = (entry(b, "QUAL"), entry(b, "FRAM"));
            put(b, a, b"FRAM");
            put(b, z, b"QUAL")
        },
        "section QUAL has flags 1 and rows of 1 bytes, this format has 1 and 4",
    ),
    (
        "twice",
        |b| {
            let at = entry(b, "QUAL");
            put(b, at, b"DESC")
        },
        "section DESC exists twice",
    ),
    (
        "missing",
        |b| {
            let at = entry(b, "COVR");
            put(b, at, b"NONE");
            put(b, at + 4, &[0; 4])
        },
        "section COVR (covered cells) is missing",
    ),
    (
        "gap",
        |b| {
            let at = entry(b, "DESC");
            let start = section(b, "DESC").start as u64 + 64;
            put(b, at + 8, &start.to_le_bytes())
        },
        "section DESC starts at byte ",
    ),
    (
        "overlap",
        |b| {
            let at = entry(b, "DESC");
            let start = section(b, "SEGM").start as u64;
            put(b, at + 8, &start.to_le_bytes())
        },
        "section DESC starts at byte ",
    ),
    (
        "offset overflow",
        |b| {
            let at = entry(b, "DESC");
            put(b, at + 8, &u64::MAX.to_le_bytes())
        },
        "section DESC starts at byte 18446744073709551615, not at ",
    ),
    ("length overflow", |b| declare(b, "DESC", u64::MAX), "reaches beyond the file"),
    ("length overflow when added", |b| declare(b, "DESC", u64::MAX - 127), "reaches beyond the file"),
    ("last length overflow", |b| declare(b, "PNTS", u64::MAX / 6 * 6), "reaches beyond the file"),
    ("beyond the file", |b| declare(b, "PNTS", 6 * 1_000_000), "section PNTS (6000000 bytes at "),
    ("inside a row", |b| declare(b, "PNTS", 41), "section PNTS ends inside a row"),
    (
        "other rows",
        |b| {
            let at = entry(b, "SEGM");
            put(b, at + 24, &24u32.to_le_bytes())
        },
        "section SEGM has flags 1 and rows of 24 bytes, this format has 1 and 28",
    ),
    (
        "rows of nothing",
        |b| {
            let at = entry(b, "SEGM");
            put(b, at + 24, &[0; 4])
        },
        "rows of 0 bytes",
    ),
    (
        "points with a checksum of their own",
        |b| {
            let at = entry(b, "PNTS");
            put(b, at + 28, &[1])
        },
        "section PNTS has a checksum of its own beside its blocks'",
    ),
    (
        "segments unverified",
        |b| {
            let at = entry(b, "SEGM");
            put(b, at + 4, &[3])
        },
        "section SEGM has flags 3",
    ),
    (
        "padding of the table",
        |b| {
            // 16 sections fill the table; with 17 there is padding for one entry more.
            add_section(b, b"NEWS", 0, b"");
            put(b, 64 + 32 * 17, &[1])
        },
        "the padding after the section table is not zero",
    ),
    (
        "padding of a section",
        |b| {
            let at = section(b, "FRAM").end;
            put(b, at, &[1])
        },
        "the padding after section FRAM is not zero",
    ),
    (
        "padding of the points",
        |b| {
            let at = section(b, "PNTS").end;
            put(b, at, &[1])
        },
        "section PNTS: block 0 ",
    ),
    (
        "left over",
        |b| {
            let end = b.len() + 64;
            b.resize(end, 0);
            put(b, 16, &(end as u64).to_le_bytes())
        },
        "64 bytes after the last section belong to none",
    ),
];

const VALUES: &[Case] = &[
    ("no meta", |b| declare_empty(b, "META"), "section META does not hold exactly one row"),
    ("dim 0", |b| field(b, "META", 76, &[0; 4]), "0 numbers a row, 1 to 4096 are possible"),
    ("dim 4 billion", |b| field(b, "META", 76, &[0xFF; 4]), "4294967295 numbers a row"),
    (
        "another dim",
        |b| field(b, "META", 76, &2u32.to_le_bytes()),
        "it holds 6 descriptor numbers, 2 segments of 2 need",
    ),
    (
        "origin",
        |b| field(b, "META", 0, &f64(f64::NAN)),
        "corner (origin, lower and upper bound) 0 is out of range",
    ),
    (
        "bounds",
        |b| field(b, "META", 24, &f64(f64::NEG_INFINITY)),
        "corner (origin, lower and upper bound) 1 is",
    ),
    ("upside down", |b| field(b, "META", 24 + 8, &f64(6.0e6)), "the bounds are upside down on axis 1"),
    ("one segment less", |b| cut(b, "SEGM", 28), "it holds 6 descriptor numbers, 1 segments of 3 need"),
    ("no segments", |b| declare_empty(b, "SEGM"), "it holds 0 segments"),
    ("one quality less", |b| cut(b, "QUAL", 4), "it holds 1 qualities for 2 segments"),
    ("one descriptor number less", |b| cut(b, "DESC", 20), "it holds 5 descriptor numbers"),
    ("one run less", |b| cut(b, "SRUN", 32), "it holds 1 point runs for 2 segments"),
    ("odd statistics", |b| cut(b, "STDZ", 20), "section STDZ does not hold a mean and a spread"),
    (
        "short statistics",
        |b| cut(b, "STDZ", 16),
        "the descriptor statistics hold 2 means and 2 spreads for 3",
    ),
    ("mean", |b| field(b, "STDZ", 4, &f32(f32::INFINITY)), "descriptor mean 1 is out of range: inf"),
    ("spread", |b| field(b, "STDZ", 12, &f32(-1.0)), "descriptor spread 0 is out of range: -1.0"),
    ("descriptor", |b| field(b, "DESC", 8, &f32(f32::NAN)), "descriptor number 2 is out of range: NaN"),
    ("quality", |b| field(b, "QUAL", 4, &f32(1.5)), "quality 1 is out of range: 1.5"),
    ("centroid", |b| field(b, "SEGM", 28, &f32(f32::NAN)), "segment 1 is out of range: SegmentRecord"),
    ("far centroid", |b| field(b, "SEGM", 0, &f32(3e38)), "segment 0 is out of range"),
    ("extent", |b| field(b, "SEGM", 12, &f32(-0.5)), "segment 0 is out of range"),
    ("run beyond", |b| field(b, "SRUN", 0, &6u64.to_le_bytes()), "segment's point run 0 is out of range"),
    (
        "run overflow",
        |b| field(b, "SRUN", 0, &u64::MAX.to_le_bytes()),
        "segment's point run 0 is out of range",
    ),
    ("run of nothing", |b| field(b, "SRUN", 8, &[0; 4]), "segment's point run 0 is out of range"),
    ("run of 4 billion", |b| field(b, "SRUN", 40, &[0xFF; 4]), "segment's point run 1 is out of range"),
    ("quantum", |b| field(b, "SRUN", 12, &f32(0.0)), "segment's point run 0 is out of range"),
    ("coarse quantum", |b| field(b, "SRUN", 12, &f32(1e30)), "segment's point run 0 is out of range"),
    ("run corner", |b| field(b, "SRUN", 16, &f32(f32::NAN)), "segment's point run 0 is out of range"),
    ("run reserved", |b| field(b, "SRUN", 28, &[1]), "segment's point run 0 is out of range"),
    ("ground run", |b| field(b, "GRUN", 0, &7u64.to_le_bytes()), "ground tile's point run 0 is out of range"),
    (
        "structure run",
        |b| field(b, "TRUN", 0, &8u64.to_le_bytes()),
        "structure tile's point run 0 is out of range",
    ),
    (
        "shared points",
        |b| {
            field(b, "SRUN", 0, &0u64.to_le_bytes());
            field(b, "SRUN", 8, &6u32.to_le_bytes())
        },
        "the point runs list 11 points, the map holds 8",
    ),
    ("path", |b| field(b, "PATH", 24 + 16, &f64(f64::NAN)), "path position 1 is out of range"),
    (
        "unsorted cells",
        |b| field(b, "COVR", 0, &i32::MAX.to_le_bytes()),
        "covered cell 1 is not greater than",
    ),
    ("frame name", |b| field(b, "FRAM", 0, &[0xFF]), "section FRAM (frame name) is not UTF-8 at its byte 0"),
    (
        "settings",
        |b| field(b, "SETT", 9, &[0xC3, 0x28]),
        "section SETT (build settings) is not UTF-8 at its byte 9",
    ),
    ("terminal codes", |b| field(b, "SRCE", 0, b"\x1b[2J"), "the source name holds a control character"),
    (
        "long name",
        |b| {
            let to = section(b, "DNAM").start;
            b.splice(to + 64..to + 64, [0; 64]);
            b[to..to + 65].fill(b'x');
            shift(b, "DNAM", 64);
            declare(b, "DNAM", 65)
        },
        "section DNAM (descriptor name) has 65 bytes, at most 64 are possible",
    ),
    ("no name", |b| declare_empty(b, "DNAM"), "the descriptor name has 0 bytes, 1 to 64 are possible"),
    (
        "one block more",
        |b| declare(b, "PCRC", 8),
        "section PCRC holds 2 checksums, 48 bytes of points need 1",
    ),
    ("no blocks", |b| declare_empty(b, "PCRC"), "section PCRC holds 0 checksums, 48 bytes of points need 1"),
];

/// Moves everything after section `id` by `by` bytes in table and header.
fn shift(bytes: &mut [u8], id: &str, by: i64) {
    let after = section(bytes, id).start as u64;
    let count = crate::seal::u32_at(bytes, 12) as usize;
    for at in (0..count).map(|i| 64 + 32 * i) {
        let offset = crate::seal::u64_at(bytes, at + 8);
        if offset > after {
            put(bytes, at + 8, &offset.saturating_add_signed(by).to_le_bytes());
        }
    }
    let len = bytes.len() as u64;
    put(bytes, 16, &len.to_le_bytes());
}

/// Takes a section's bytes out of the file.
fn declare_empty(bytes: &mut Vec<u8>, id: &str) {
    let range = section(bytes, id);
    let len = up64(range.len());
    bytes.drain(range.start..range.start + len);
    shift(bytes, id, -(len as i64));
    declare(bytes, id, 0);
}

#[test]
fn nonsense_is_refused_in_spite_of_right_checksums() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    let mut untouched = good.clone();
    reseal(&mut untouched);
    assert!(untouched == good, "the seal of the tests is not the writer's");
    for (name, change, expected) in TABLE.iter().chain(VALUES) {
        let mut bytes = good.clone();
        change(&mut bytes);
        reseal(&mut bytes);
        let message = refusal(scratch.open(&bytes), name);
        assert!(message.contains(expected), "{name}: {message}");
    }
}

#[test]
fn a_needed_section_may_stand_anywhere() {
    // The order of sections is free: move FRAM's bytes to the end and leave an unneeded section in its place.
    let mut bytes = bytes_of(small_data());
    let frame = bytes[section(&bytes, "FRAM")].to_vec();
    let at = entry(&bytes, "FRAM");
    put(&mut bytes, at, b"GONE");
    put(&mut bytes, at + 4, &[0; 4]);
    add_section(&mut bytes, b"FRAM", 1, &frame);
    assert_eq!(Scratch::new().open(&bytes).unwrap().frame_id(), "map");
}

/// Uses everything a map offers.
fn use_all(map: &Map, scratch: &Scratch) {
    let mut points = Vec::new();
    for i in 0..map.len() {
        let _ = map.segment_points_into(i, &mut points);
        assert!(points.iter().flatten().all(|v| v.is_finite()));
        assert_eq!(map.descriptor(i).len(), map.descriptor_info().dim as usize);
    }
    for i in 0..map.ground_tiles().len() {
        let _ = map.ground_tile_points_into(i, &mut points);
        assert!(points.iter().flatten().all(|v| v.is_finite()));
    }
    for i in 0..map.structure_tiles().len() {
        let _ = map.structure_tile_points_into(i, &mut points);
        assert!(points.iter().flatten().all(|v| v.is_finite()));
    }
    assert!(map.segment_points(map.len()).is_err());
    if map.verify_points().is_ok() {
        let again = scratch.folder.path().join("again.esm");
        map.write(&again).unwrap();
        Map::open(&again).unwrap().verify_points().unwrap();
    }
}

#[test]
fn no_byte_with_right_checksums_can_do_harm() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    let (mut accepted, mut refused) = (0, 0);
    for at in 0..good.len() {
        for mask in [0x01, 0x80, 0xFF] {
            let mut bytes = good.clone();
            bytes[at] ^= mask;
            reseal(&mut bytes);
            match scratch.open_unverified(&bytes) {
                Ok(map) => {
                    use_all(&map, &scratch);
                    accepted += 1;
                }
                Err(e) => {
                    assert!(e.to_string().contains("hint: "), "byte {at}: {e}");
                    refused += 1;
                }
            }
        }
    }
    // Coordinates, descriptors and texts may take many values; structure may not.
    assert!(accepted > 500 && refused > 2000, "{accepted} accepted, {refused} refused");
}

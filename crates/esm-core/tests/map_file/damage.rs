//! Damage in transit or on the disk: all of it is noticed.

use std::path::Path;

use esm_core::map::Map;

use crate::seal::{add_section, section, up64};
use crate::{Scratch, bytes_of, large_data, refusal, small_data};

#[test]
fn every_flipped_byte_is_noticed() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    scratch.open(&good).unwrap();
    for at in 0..good.len() {
        for mask in [0x01, 0x80, 0xFF] {
            let mut bytes = good.clone();
            bytes[at] ^= mask;
            refusal(scratch.open(&bytes), format!("byte {at} ^ {mask:#x}"));
        }
    }
}

#[test]
fn damage_in_the_padding_of_the_table_is_noticed() {
    // This build's 16 entries fill the table; a newer minor version's 17 leave padding.
    let mut good = bytes_of(small_data());
    add_section(&mut good, b"NEWS", 0, b"");
    let scratch = Scratch::new();
    scratch.open(&good).unwrap();
    for at in 64 + 32 * 17..64 + 32 * 18 {
        let mut bytes = good.clone();
        bytes[at] ^= 1;
        let message = refusal(scratch.open(&bytes), at);
        assert!(message.contains("the section table (bytes 64 to 640) fails its checksum"), "{message}");
    }
}

#[test]
fn damage_is_reported_with_its_place() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    let flipped = |at: usize| {
        let mut bytes = good.clone();
        bytes[at] ^= 4;
        refusal(scratch.open(&bytes), at)
    };
    assert!(flipped(20).contains("the header (bytes 0 to 64) fails its checksum\nhint: the file is damaged"));
    assert!(flipped(70).contains("the section table (bytes 64 to 576) fails its checksum"));
    let segments = section(&good, "SEGM");
    let place = format!("section SEGM (bytes {} to {}) fails its", segments.start, up64(segments.end));
    assert!(flipped(segments.start + 5).contains(&place));
    // Padding counts as well.
    assert!(flipped(segments.end).contains(&place));
    let points = section(&good, "PNTS");
    let place =
        format!("section PNTS: block 0 (bytes {} to {}) fails its checksum\n", points.start, good.len());
    assert!(flipped(points.start).contains(&place));
    assert!(flipped(good.len() - 1).contains(&place));
}

#[test]
fn a_damaged_point_block_spoils_the_segments_in_it_and_no_others() {
    let good = bytes_of(large_data(200, 300, 2));
    let points = section(&good, "PNTS");
    assert!(points.len() > 5 * 65_536);
    let mut bytes = good.clone();
    let (first, second) = (2 * 65_536 + 17, 4 * 65_536);
    bytes[points.start + first] ^= 1;
    bytes[points.start + second] ^= 1;
    let scratch = Scratch::new();
    // Opening does not read the points.
    let map = scratch.open_unverified(&bytes).unwrap();
    let whole = Map::from_data(large_data(200, 300, 2)).unwrap();
    let mut refused = 0;
    for (i, run) in map.runs().iter().enumerate() {
        let (start, end) = (run.start as usize * 6, (run.start as usize + run.len as usize) * 6);
        let touches = |block: usize| start < (block + 1) * 65_536 && end > block * 65_536;
        // Twice: the verdict is remembered.
        for _ in 0..2 {
            match map.segment_points(i) {
                Ok(points) => {
                    assert!(!touches(2) && !touches(4), "segment {i}");
                    assert_eq!(points, whole.segment_points(i).unwrap());
                }
                Err(e) => {
                    assert!(touches(2) || touches(4), "segment {i}: {e}");
                    assert!(e.to_string().contains("fails its checksum"), "{e}");
                    refused += 1;
                }
            }
        }
    }
    assert!(refused > 100, "{refused}");
    let message = map.verify_points().unwrap_err().to_string();
    let blocks = up64(points.len()).div_ceil(65_536);
    assert!(message.contains("section PNTS: block 2 (bytes "), "{message}");
    assert!(message.contains(&format!("fails its checksum; 2 of {blocks} blocks do\nhint: ")), "{message}");
    // Nor do the damaged points get fresh checksums.
    let copy = scratch.folder.path().join("copy.esm");
    let message = map.write(&copy).unwrap_err().to_string();
    assert!(message.contains("fails its checksum"), "{message}");
    assert!(!copy.exists());
}

#[test]
fn every_truncation_is_noticed() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    for len in 0..good.len() {
        let message = refusal(scratch.open(&good[..len]), format!("{len} bytes"));
        let expected = match len {
            0 => "the file is empty (a map's header takes 64 bytes)".into(),
            1..64 => format!("cut short: {len} bytes, the header alone takes 64"),
            _ => format!("cut short: {len} bytes of {}", good.len()),
        };
        assert!(message.contains(&expected), "{len}: {message}");
    }
}

#[test]
fn bytes_after_the_end_are_noticed() {
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    for more in [1, 2, 63, 64, 65, 4096, good.len()] {
        for fill in [0, 0xFF] {
            let mut bytes = good.clone();
            bytes.resize(good.len() + more, fill);
            let message = refusal(scratch.open(&bytes), format!("{more} bytes more"));
            let expected = format!("{more} bytes follow the end of the map at {}", good.len());
            assert!(message.contains(&expected), "{message}");
        }
    }
}

#[test]
fn other_things_than_maps_are_refused() {
    let scratch = Scratch::new();
    for (bytes, what) in [
        (&b"# .PCD v0.7\n"[..], "pcd"),
        (b"\x89MCAP0\r\n", "mcap"),
        (b"E", "one byte"),
        (&[0; 4096], "zeros"),
    ] {
        let message = refusal(scratch.open(bytes), what);
        assert!(message.contains("this is not an esm map"), "{message}");
        assert!(message.ends_with("hint: give the .esm file that `esm-cli map build` wrote"), "{message}");
    }
    // What a text-mode transfer does to the line ends.
    let text: Vec<u8> = bytes_of(small_data()).into_iter().filter(|&b| b != b'\r').collect();
    assert!(refusal(scratch.open(&text), "text mode").contains("this is not an esm map"));

    std::fs::remove_file(scratch.path()).unwrap();
    let message = refusal(Map::open(&scratch.path()), "missing");
    assert!(message.contains("there is no such file\nhint: build a map first"), "{message}");
    std::fs::create_dir(scratch.path()).unwrap();
    let message = refusal(Map::open(&scratch.path()), "directory");
    assert!(message.contains("this is a directory, not a map file"), "{message}");
    std::fs::remove_dir(scratch.path()).unwrap();
}

#[test]
fn a_map_edited_underneath_gives_an_error_and_no_panic() {
    use std::io::{Seek, SeekFrom, Write};
    let good = bytes_of(small_data());
    let scratch = Scratch::new();
    let map = scratch.open(&good).unwrap();
    // What nobody should do: the same file, in place. Run 0 now starts far outside the points.
    let mut file = std::fs::OpenOptions::new().write(true).open(scratch.path()).unwrap();
    file.seek(SeekFrom::Start(section(&good, "SRUN").start as u64)).unwrap();
    file.write_all(&u64::MAX.to_le_bytes()).unwrap();
    let message = map.segment_points(0).unwrap_err().to_string();
    assert!(
        message.contains("the point run of segment 0 has changed since the file was opened"),
        "{message}"
    );
    map.segment_points(1).unwrap();
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_at_once() {
    let scratch = Scratch::new();
    let made = std::process::Command::new("mkfifo").arg(scratch.path()).status().unwrap();
    assert!(made.success());
    let message = refusal(Map::open(&scratch.path()), "pipe");
    assert!(message.contains("this is not a regular file"), "{message}");
    let message = Map::open(Path::new("/dev/null")).unwrap_err().to_string();
    assert!(message.starts_with("/dev/null: this is not a regular file"), "{message}");
}

/// Whoever has copied a map does not care what becomes of the file.
#[test]
fn a_loaded_map_outlives_what_happens_to_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.esm");
    let bytes = bytes_of(large_data(40, 3000, 4));
    std::fs::write(&path, &bytes).unwrap();
    let (opened, loaded) = (Map::open(&path).unwrap(), Map::load(&path).unwrap());
    assert_eq!(loaded.len(), opened.len());
    assert_eq!(loaded.file_size(), bytes.len() as u64);
    let before: Vec<_> = (0..loaded.len()).map(|s| opened.segment_points(s).unwrap()).collect();
    drop(opened);
    // Overwritten in place, then cut to nothing: a mapping of the file would end the process with SIGBUS.
    std::fs::write(&path, vec![0xaa; bytes.len()]).unwrap();
    std::fs::File::create(&path).unwrap();
    let after: Vec<_> = (0..loaded.len()).map(|s| loaded.segment_points(s).unwrap()).collect();
    assert_eq!(before, after);
    loaded.write(&folder.path().join("again.esm")).unwrap();
    assert_eq!(std::fs::read(folder.path().join("again.esm")).unwrap(), bytes);
}

/// Opening leaves the points for later; loading looks at them too.
#[test]
fn loading_verifies_the_points() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.esm");
    let mut bytes = bytes_of(large_data(40, 3000, 4));
    let points = {
        std::fs::write(&path, &bytes).unwrap();
        let map = Map::open(&path).unwrap();
        map.sections().iter().find(|s| s.id == "PNTS").map(|s| s.offset).unwrap()
    };
    bytes[points as usize + 5] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    assert!(Map::open(&path).is_ok());
    let error = Map::load(&path).unwrap_err().to_string();
    assert!(error.contains("PNTS") && error.contains("hint: "), "{error}");
}

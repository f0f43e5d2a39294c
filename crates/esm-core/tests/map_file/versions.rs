//! Newer and older programs meet.

use crate::seal::{add_section, put, reseal, section};
use crate::{Scratch, bytes_of, refusal, small_data};

#[test]
fn a_newer_major_version_is_refused_as_such() {
    let mut bytes = bytes_of(small_data());
    put(&mut bytes, 8, &3u16.to_le_bytes());
    put(&mut bytes, 10, &2u16.to_le_bytes());
    reseal(&mut bytes);
    // Whatever a newer format changed further down does not hide the reason.
    bytes.truncate(70);
    let message = refusal(Scratch::new().open(&bytes), "format 3.2");
    assert!(message.contains("written by a newer esm (format 3.2, this build reads 1)"), "{message}");
    assert!(message.ends_with("hint: update esm, or rebuild the map with this version"), "{message}");
}

#[test]
fn a_damaged_version_is_not_reported_as_newer() {
    let mut bytes = bytes_of(small_data());
    put(&mut bytes, 8, &3u16.to_le_bytes());
    let message = refusal(Scratch::new().open(&bytes), "damaged version");
    assert!(message.contains("the header (bytes 0 to 64) fails its checksum"), "{message}");
}

#[test]
fn format_0_does_not_exist() {
    let mut bytes = bytes_of(small_data());
    put(&mut bytes, 8, &0u16.to_le_bytes());
    reseal(&mut bytes);
    assert!(refusal(Scratch::new().open(&bytes), "format 0").contains("format 0 does not exist"));
}

#[test]
fn a_newer_minor_version_with_a_section_to_pass_over_is_read() {
    let good = bytes_of(small_data());
    let mut bytes = good.clone();
    put(&mut bytes, 10, &9u16.to_le_bytes());
    add_section(&mut bytes, b"NEWS", 0, b"something this build need not understand");
    let scratch = Scratch::new();
    let map = scratch.open(&bytes).unwrap();
    assert_eq!(map.file_size(), bytes.len() as u64);
    let news = map.sections().pop().unwrap();
    assert_eq!((news.id.as_str(), news.what, news.len), ("NEWS", "unknown to this build", 40));
    // Written again it is what this build knows.
    let again = scratch.folder.path().join("again.esm");
    map.write(&again).unwrap();
    assert_eq!(std::fs::read(again).unwrap(), good);
    // Passed over, but not unverified.
    let news = section(&bytes, "NEWS");
    for at in [news.start, news.end + 1] {
        let mut damaged = bytes.clone();
        damaged[at] ^= 1;
        assert!(refusal(scratch.open(&damaged), at).contains("section NEWS (bytes "));
    }
}

#[test]
fn an_unknown_section_that_is_needed_is_refused() {
    for flags in [1, 2, 3, 4, 1 << 31] {
        let mut bytes = bytes_of(small_data());
        add_section(&mut bytes, b"NEWS", flags, b"important");
        let message = refusal(Scratch::new().open(&bytes), flags);
        assert!(
            message.contains("section NEWS is needed to use this map and unknown to this build"),
            "{message}"
        );
        assert!(message.contains("hint: update esm"), "{message}");
    }
}

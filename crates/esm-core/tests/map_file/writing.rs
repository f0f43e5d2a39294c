//! Writing replaces the file in one step or not at all.

use std::path::Path;

use esm_core::Error;
use esm_core::map::Map;

use crate::{Scratch, large_data, names, small_data};

fn small() -> Map {
    Map::from_data(small_data()).unwrap()
}

/// A map that takes several writes to the disk.
fn large() -> Map {
    Map::from_data(large_data(2000, 200, 4)).unwrap()
}

#[test]
fn a_file_is_replaced_while_it_is_in_use() {
    let scratch = Scratch::new();
    large().write(&scratch.path()).unwrap();
    let old = Map::open(&scratch.path()).unwrap();
    small().write(&scratch.path()).unwrap();
    assert_eq!(Map::open(&scratch.path()).unwrap().len(), 2);
    // The old one lives on for whoever has it open.
    old.verify_points().unwrap();
    assert_eq!(old.segment_points(1999).unwrap().len(), 200);
    assert_eq!(scratch.names(), ["map.esm"]);
}

#[test]
fn a_missing_folder_is_an_error_and_is_not_made() {
    let scratch = Scratch::new();
    let path = scratch.folder.path().join("no/such/map.esm");
    let error = small().write(&path).unwrap_err();
    assert!(matches!(error, Error::Io { .. }));
    let message = error.to_string();
    assert!(message.contains("no/such/map.esm: creating a temporary file in its folder: "), "{message}");
    assert!(message.contains("No such file or directory"), "{message}");
    assert!(scratch.names().is_empty());
}

#[test]
fn only_regular_files_are_replaced() {
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path()).unwrap();
    let message = small().write(&scratch.path()).unwrap_err().to_string();
    assert!(message.contains("map.esm: this is a directory\nhint: give the name of a file"), "{message}");
    for nameless in ["", "/", ".."] {
        let message = small().write(Path::new(nameless)).unwrap_err().to_string();
        assert!(message.contains("this names no file"), "{nameless:?}: {message}");
    }
    assert_eq!(scratch.names(), ["map.esm"]);
    assert!(names(&scratch.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn devices_are_left_alone() {
    let message = small().write(Path::new("/dev/null")).unwrap_err().to_string();
    assert!(message.starts_with("/dev/null: this is not a regular file"), "{message}");
    assert!(!std::fs::metadata("/dev/null").unwrap().is_file());
}

#[cfg(unix)]
#[test]
fn a_link_stays_a_link_and_rights_are_those_of_any_new_file() {
    use std::os::unix::fs::PermissionsExt;
    let scratch = Scratch::new();
    let real = scratch.folder.path().join("real.esm");
    std::fs::write(&real, "old").unwrap();
    std::os::unix::fs::symlink("real.esm", scratch.path()).unwrap();
    small().write(&scratch.path()).unwrap();
    assert!(std::fs::symlink_metadata(scratch.path()).unwrap().is_symlink());
    Map::open(&real).unwrap();
    let plain = scratch.folder.path().join("plain");
    std::fs::write(&plain, "").unwrap();
    let mode = |p: &Path| std::fs::metadata(p).unwrap().permissions().mode();
    assert_eq!(mode(&real), mode(&plain));
}

#[test]
fn what_a_crashed_writer_left_does_not_disturb() {
    let scratch = Scratch::new();
    let left = scratch.folder.path().join(".map.esm.AbC123.tmp");
    std::fs::write(&left, "half a map").unwrap();
    small().write(&scratch.path()).unwrap();
    Map::open(&scratch.path()).unwrap().verify_points().unwrap();
    large().write(&scratch.path()).unwrap();
    assert_eq!(Map::open(&scratch.path()).unwrap().len(), 2000);
    assert_eq!(scratch.names(), [".map.esm.AbC123.tmp", "map.esm"]);
    assert_eq!(std::fs::read_to_string(left).unwrap(), "half a map");
}

/// The folder that a second process of this test binary is asked to write in.
#[cfg(unix)]
const FOLDER: &str = "ESM_TEST_WRITER_FOLDER";

/// This test binary, running one of the `child_` tests below in `folder`, after `shell` has set its limits.
#[cfg(unix)]
fn child(test: &str, folder: &Path, shell: &str) -> std::process::Command {
    let mut command = std::process::Command::new("sh");
    let test = format!("writing::{test}");
    command.args(["-c", &format!("{shell} exec \"$@\"")]).arg("sh").arg(std::env::current_exe().unwrap());
    command.args(["--exact", &test, "--nocapture"]).env(FOLDER, folder).stdout(std::process::Stdio::null());
    command
}

/// Asked by [`a_full_disk_leaves_the_old_file`] only.
#[cfg(unix)]
#[test]
fn child_writes_a_large_map() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let message = large().write(&Path::new(&folder).join("map.esm")).unwrap_err().to_string();
    assert!(message.contains("map.esm: writing it under a temporary name: File too large"), "{message}");
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_old_file() {
    let scratch = Scratch::new();
    small().write(&scratch.path()).unwrap();
    let before = std::fs::read(scratch.path()).unwrap();
    // A limit on file sizes (in blocks of 512 or 1024 bytes) fails the write half-way, as a full disk does.
    let status =
        child("child_writes_a_large_map", scratch.folder.path(), "trap '' XFSZ; ulimit -f 1000;").status();
    assert!(status.unwrap().success(), "the write did not fail, or not as expected");
    assert_eq!(scratch.names(), ["map.esm"]);
    assert!(std::fs::read(scratch.path()).unwrap() == before);
}

/// Asked by [`a_killed_writer_leaves_a_whole_file`] only: writes until it is killed.
#[cfg(unix)]
#[test]
fn child_writes_for_ever() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let path = Path::new(&folder).join("map.esm");
    let (small, large) = (small(), large());
    loop {
        small.write(&path).unwrap();
        large.write(&path).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn a_killed_writer_leaves_a_whole_file() {
    let scratch = Scratch::new();
    small().write(&scratch.path()).unwrap();
    let whole = || {
        let map = Map::open(&scratch.path()).unwrap();
        map.verify_points().unwrap();
        assert!([2, 2000].contains(&map.len()));
        map.len()
    };
    for round in 0..8u64 {
        let mut writer = child("child_writes_for_ever", scratch.folder.path(), "").spawn().unwrap();
        // Watch it at work: it has replaced the file when the length changes.
        let (first, start) = (whole(), std::time::Instant::now());
        while whole() == first {
            assert!(start.elapsed().as_secs() < 60, "the writer does not write");
        }
        std::thread::sleep(std::time::Duration::from_millis(3 * round));
        writer.kill().unwrap();
        writer.wait().unwrap();
        whole();
    }
    // And the next writer does its work beside what is left.
    small().write(&scratch.path()).unwrap();
    assert_eq!(whole(), 2);
}

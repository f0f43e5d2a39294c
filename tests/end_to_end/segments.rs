//! Labelled segments, from a simulated place and from the real drive.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::common::{esm, folder, names, program, shared};

const FILES: [&str; 11] = [
    "above_ground.npy",
    "centroid_map.npy",
    "class.npy",
    "meta.json",
    "object.npy",
    "observation.npy",
    "offsets.npy",
    "place.npy",
    "points.npy",
    "rings.npy",
    "visit.npy",
];

/// The numbers of an array file, after its header of 128 bytes.
fn array<const N: usize, T>(set: &Path, name: &str, of: fn([u8; N]) -> T) -> Vec<T> {
    let bytes = fs::read(set.join(name)).unwrap();
    assert_eq!(&bytes[..6], b"\x93NUMPY");
    bytes[128..].as_chunks::<N>().0.iter().map(|b| of(*b)).collect()
}

/// Both visits of a street: what has the same name stands in the same place and is of one class.
#[test]
fn names_hold_over_both_visits() {
    let dir = folder();
    let (place, set) = (dir.path().join("street"), dir.path().join("set"));
    esm!["simulate", "kitti", "--seed", "103", "--scale", "0.05", "-o", place].ended(0);
    let ran = esm!["segments", place, "--accumulate", "20,6", "--step", "10", "--json", "-o", set].ended(0);
    let told: Value = serde_json::from_str(&ran.stdout).unwrap();
    assert_eq!(names(&set), FILES);
    let meta: Value = serde_json::from_str(&fs::read_to_string(set.join("meta.json")).unwrap()).unwrap();
    assert_eq!((&meta["segments"], &meta["places"][0]), (&told["segments"], &Value::from("kitti:103:0.05")));
    let object = array(&set, "object.npy", i64::from_le_bytes);
    let visit = array(&set, "visit.npy", u16::from_le_bytes);
    let class = array(&set, "class.npy", |[b]| b);
    let observation = array(&set, "observation.npy", u32::from_le_bytes);
    let flat = array(&set, "centroid_map.npy", f64::from_le_bytes);
    let centroid = flat.as_chunks::<3>().0;
    assert_eq!(object.len() as u64, told["segments"].as_u64().unwrap());
    assert!(object.len() > 500, "{told}");
    assert!(observation.is_sorted());
    let mut seen: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
    object
        .iter()
        .enumerate()
        .filter(|(_, o)| **o >= 0)
        .for_each(|(n, o)| seen.entry(*o).or_default().push(n));
    let named = seen.values().map(Vec::len).sum::<usize>();
    assert!(named * 2 > object.len(), "{named} of {} have a name", object.len());
    let in_both = seen
        .values()
        .filter(|rows| rows.iter().any(|n| visit[*n] == 0) && rows.iter().any(|n| visit[*n] == 1));
    assert!(in_both.count() >= 20, "few objects are seen at both visits");
    for rows in seen.values() {
        let first = rows[0];
        for n in rows {
            let off: f64 = (0..3).map(|a| (centroid[*n][a] - centroid[first][a]).powi(2)).sum::<f64>().sqrt();
            assert!(off <= 1.0, "{off} m apart");
            assert_eq!(class[*n], class[first], "one object, one class");
        }
    }
    // What is there is not written over.
    esm!["segments", place, "-o", set].failed(&["it exists already"]);
}

/// The real drive has no numbers: what stands within half a metre is one object.
#[test]
fn real_drives_follow_the_rule_of_the_paper() {
    let Some(map) = shared("kitti00/map.mcap") else { return };
    let dir = folder();
    let set = dir.path().join("set");
    esm!["segments", map, "--frames", "600-660", "--step", "8", "-o", set].ended(0);
    let object = array(&set, "object.npy", i64::from_le_bytes);
    let flat = array(&set, "centroid_map.npy", f64::from_le_bytes);
    let centroid = flat.as_chunks::<3>().0;
    assert!(array(&set, "class.npy", |[b]| b).iter().all(|c| *c == 255));
    let mut first: BTreeMap<i64, [f64; 3]> = BTreeMap::new();
    let mut again = 0;
    for (o, c) in object.iter().zip(centroid).filter(|(o, _)| **o >= 0) {
        let a = first.entry(*o).or_insert(*c);
        let off: f64 = (0..3).map(|i| (a[i] - c[i]).powi(2)).sum::<f64>().sqrt();
        assert!(off <= 0.5, "{off}");
        again += usize::from(off > 0.0);
    }
    assert!(again > 50, "{again} seen again of {}", object.len());
}

#[test]
fn inputs_that_make_no_set_are_refused() {
    let dir = folder();
    let nothing = dir.path().join("nothing.mcap");
    esm!["segments", nothing, "-o", dir.path().join("set")].failed(&["nothing.mcap"]);
    fs::write(dir.path().join("a.bin"), [0u8; 64]).unwrap();
    let scan = dir.path().join("a.bin");
    esm!["segments", scan, "-o", dir.path().join("set")].failed(&["does not tell how the sensor moved"]);
    let truth = dir.path().join("t.tum");
    esm!["segments", scan, "--truth", truth, "--truth", "t2.tum", "-o", dir.path().join("set")]
        .failed(&["2 truths for 1 recordings"]);
    esm!["segments", scan, "--accumulate", "-3", "-o", dir.path().join("set")].failed(&["accumulate"]);
    esm!["segments", scan, "--step", "nan", "-o", dir.path().join("set")].failed(&["step = NaN"]);
    // A directory of the simulator brings its own truth and name.
    let street = dir.path().join("street");
    fs::create_dir(&street).unwrap();
    for name in ["map.mcap", "map_truth.tum"] {
        fs::write(street.join(name), []).unwrap();
    }
    for flag in ["--poses", "--truth", "--place"] {
        esm!["segments", street, flag, "other", "-o", dir.path().join("set")].failed(&[flag, "street"]);
    }
    assert!(!dir.path().join("set").exists());
}

#[cfg(unix)]
#[test]
fn an_interrupted_set_leaves_nothing() {
    let Some(map) = shared("kitti00/map.mcap") else { return };
    for signal in ["INT", "TERM"] {
        let dir = folder();
        let mut segments = program();
        segments.arg("segments").arg(&map).args(["--step", "0", "-o"]).arg(dir.path().join("set"));
        let child = segments.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let begun = Instant::now();
        while names(dir.path()).is_empty() && begun.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(5));
        }
        assert!(!names(dir.path()).is_empty(), "the set was never begun");
        let kill =
            Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        assert!(kill.success());
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(names(dir.path()), [""; 0], "{signal}");
    }
}

//! Inputs and flags as they should not be: each refused with one clear line, or read as far as it goes.

use std::fs;
use std::path::Path;

use esm_core::Pose;
use esm_tests::recording::{Recording, write_pcd};
use serde_json::Value;

use crate::common::{Ran, TOWN, esm, folder};

/// Localizes one input in the town's map.
fn localize(input: impl AsRef<Path>) -> Ran {
    esm!["localize", "--json", "--map", TOWN.path("map.esm"), input.as_ref()]
}

fn torn(name: &str, keep: impl Fn(usize) -> usize) -> (tempfile::TempDir, std::path::PathBuf) {
    let dir = folder();
    let path = dir.path().join(name);
    let bytes = fs::read(TOWN.path("live.mcap")).unwrap();
    fs::write(&path, &bytes[..keep(bytes.len())]).unwrap();
    (dir, path)
}

#[test]
fn a_torn_recording_is_used_as_far_as_it_is_whole() {
    let (_dir, path) = torn("torn.mcap", |n| n * 6 / 10);
    let ran = localize(&path).ended(0);
    assert!(ran.stderr.starts_with("warning: "), "{}", ran.stderr);
    assert!(ran.stderr.contains("torn.mcap"), "{}", ran.stderr);
    let clouds = ran.json().len() - 1;
    assert!((20..TOWN.live_drive.len()).contains(&clouds), "{clouds}");
}

#[test]
fn a_recording_damaged_in_the_middle_loses_only_that() {
    let dir = folder();
    let path = dir.path().join("scratched.mcap");
    let mut bytes = fs::read(TOWN.path("live.mcap")).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 64].fill(0xAA);
    fs::write(&path, bytes).unwrap();
    let ran = localize(&path).ended(0);
    assert!(ran.stderr.contains("warning: ") && ran.stderr.contains("scratched.mcap"), "{}", ran.stderr);
    let clouds = ran.json().len() - 1;
    assert!(clouds < TOWN.live_drive.len() && clouds + 10 > TOWN.live_drive.len(), "{clouds}");
}

#[test]
fn a_recording_without_one_intact_cloud_is_an_error() {
    for keep in [0, 5, 8, 200, 2000] {
        let (_dir, path) = torn("stump.mcap", |_| keep);
        localize(&path).failed(&["stump.mcap"]);
    }
    let dir = folder();
    let garbage = dir.path().join("garbage.mcap");
    fs::write(&garbage, vec![b'x'; 5000]).unwrap();
    localize(&garbage).failed(&["garbage.mcap"]);
}

#[test]
fn an_empty_recording_is_an_error() {
    let dir = folder();
    let path = dir.path().join("empty.mcap");
    Recording::create(&path, true).unwrap().finish().unwrap();
    localize(&path).failed(&["empty.mcap"]);
}

#[test]
fn clouds_of_nothing_but_nan_are_an_error() {
    let dir = folder();
    let path = dir.path().join("blind.mcap");
    let mut recording = Recording::create(&path, true).unwrap();
    for i in 0..5 {
        recording.write(f64::from(i), &[[f32::NAN; 3]; 100], Some(&Pose::identity())).unwrap();
    }
    recording.finish().unwrap();
    localize(&path).failed(&["blind.mcap", "500 invalid"]);
}

#[test]
fn empty_clouds_among_others_are_not_found() {
    let dir = folder();
    let path = dir.path().join("blinks.mcap");
    let mut recording = Recording::create(&path, true).unwrap();
    recording.write(1.0, &[[5.0, 0.0, 0.0]; 10], Some(&Pose::identity())).unwrap();
    recording.write(2.0, &[], Some(&Pose::identity())).unwrap();
    recording.finish().unwrap();
    let ran = localize(&path).ended(1);
    assert_eq!(ran.json()[1]["verdict"], "not_found");
    assert!(ran.json()[1]["reason"].is_string());
    assert_eq!(ran.json()[1]["pose"], Value::Null);
}

#[test]
fn two_topics_of_clouds_must_be_told_apart() {
    let dir = folder();
    let path = dir.path().join("two.mcap");
    let mut recording = Recording::create(&path, true).unwrap();
    let first = &TOWN.live_drive[0];
    recording.write_other("/rear/points", first.stamp, first.cloud.points()).unwrap();
    for sweep in &TOWN.live_drive[..12] {
        recording.write(sweep.stamp, sweep.cloud.points(), Some(&sweep.pose_world_sensor)).unwrap();
    }
    recording.finish().unwrap();
    localize(&path).failed(&["two.mcap", "/points", "/rear/points", "--cloud-topic"]);
    let ran = esm!["localize", "--json", "--map", TOWN.path("map.esm"), path, "--cloud-topic", "/points"];
    assert_eq!(ran.ended(0).json().len(), 13);
    esm!["localize", "--map", TOWN.path("map.esm"), path, "--cloud-topic", "/front"]
        .failed(&["/front", "/points"]);
    esm!["localize", "--map", TOWN.path("map.esm"), TOWN.path("live.mcap"), "--odometry-topic", "/gps"]
        .failed(&["/gps", "/odom"]);
}

#[test]
fn files_that_are_nothing_of_ours_are_refused() {
    let dir = folder();
    let text = dir.path().join("notes.txt");
    fs::write(&text, "dear diary").unwrap();
    localize(&text).failed(&["notes.txt"]);
    localize(dir.path().join("missing.mcap")).failed(&["missing.mcap"]);
    let empty = dir.path().join("nothing");
    fs::create_dir(&empty).unwrap();
    localize(&empty).failed(&["nothing"]);
    let short = dir.path().join("short.pcd");
    write_pcd(&short, &[[1.0, 2.0, 3.0]; 100]).unwrap();
    let bytes = fs::read(&short).unwrap();
    fs::write(&short, &bytes[..bytes.len() - 7]).unwrap();
    localize(&short).failed(&["short.pcd", "100"]);
    esm!["map", "build", short, "-o", dir.path().join("m.esm")].failed(&["short.pcd", "100"]);
}

#[test]
fn an_input_given_twice_is_refused() {
    let (map, live) = (TOWN.path("map.esm"), TOWN.path("live.mcap"));
    let twice = ["live.mcap: this input is given twice"];
    esm!["localize", "--map", map, live, TOWN.path("silent.mcap"), live].failed(&twice);
    esm!["loops", live, live].failed(&twice);
    let other = TOWN.path("other.esm");
    esm!["map", "build", live, live, "-o", other].failed(&twice);
    assert!(!other.exists());
}

#[test]
fn a_map_needs_to_know_where_the_scans_were_taken() {
    let dir = folder();
    let map = dir.path().join("m.esm");
    esm!["map", "build", TOWN.path("silent.mcap"), "-o", map].failed(&["silent.mcap", "--poses"]);
    esm!["map", "build", TOWN.path("scans"), "-o", map].failed(&["scans", "--poses"]);
    esm!["loops", TOWN.path("silent.mcap")].failed(&["silent.mcap: this input does not tell", "--poses"]);
    let ran = esm![
        "localize",
        "--map",
        TOWN.path("map.esm"),
        TOWN.path("live.mcap"),
        TOWN.path("scans/0.pcd"),
        "--frames",
        "1-2"
    ];
    let silent = format!("warning: {}: this input does not tell", TOWN.path("scans/0.pcd").display());
    assert!(ran.stderr.starts_with(&silent), "{}", ran.stderr);
    let few = dir.path().join("few.txt");
    fs::write(&few, "1 0 0 0 0 1 0 0 0 0 1 0\n").unwrap();
    esm!["map", "build", TOWN.path("scans"), "--poses", few, "-o", map]
        .failed(&["few.txt", "1 lines for 171 scans"]);
    let yesterday = dir.path().join("yesterday.tum");
    fs::write(&yesterday, "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n").unwrap();
    esm!["map", "build", TOWN.path("silent.mcap"), "--poses", yesterday, "-o", map]
        .failed(&["no scan has a pose"]);
    esm!["map", "build", TOWN.path("survey.pcd"), TOWN.path("map.mcap"), "-o", map].failed(&[
        "one prior cloud: ",
        "survey.pcd is a prior cloud, ",
        "map.mcap is a recording",
    ]);
    esm!["map", "build", TOWN.path("survey.pcd"), "--frames", "1-5", "-o", map]
        .failed(&["survey.pcd", "--frames"]);
    assert!(!map.exists());
}

#[test]
fn ground_alone_is_no_map() {
    let dir = folder();
    let flat = dir.path().join("flat.pcd");
    let points: Vec<[f32; 3]> =
        (0..40_000).map(|i| [(i % 200) as f32 * 0.2, (i / 200) as f32 * 0.2, 0.0]).collect();
    write_pcd(&flat, &points).unwrap();
    esm!["map", "build", flat, "-o", dir.path().join("m.esm")]
        .failed(&[&format!("error: {}: ", flat.display()), "no segments"]);
}

#[test]
fn truths_must_be_poses_over_time() {
    let dir = folder();
    let with = |text: &str| {
        let truth = dir.path().join("truth.tum");
        fs::write(&truth, text).unwrap();
        esm!["localize", "--map", TOWN.path("map.esm"), TOWN.path("live.mcap"), "--truth", truth]
    };
    with("").failed(&["truth.tum"]);
    with("1 2 3\n").failed(&["truth.tum", "line 1"]);
    with("1 0 0 0 0 0 0 1\n2 0 x 0 0 0 0 1\n").failed(&["truth.tum", "line 2"]);
    with("1 0 0 0 0 1 0 0 0 0 1 0\n").failed(&["truth.tum", "no time stamps"]);
    // A truth of another day judges nothing.
    let summary = esm![
        "localize",
        "--json",
        "--frames",
        "11-13",
        "--map",
        TOWN.path("map.esm"),
        TOWN.path("live.mcap"),
        "--truth",
        TOWN.path("map_truth.tum")
    ]
    .summary();
    assert_eq!((&summary["clouds"], &summary["outside_truth"]), (&Value::from(0), &Value::from(3)));
    assert_eq!(summary["recall"], Value::Null);
}

#[test]
fn a_gap_in_the_truth_judges_nothing() {
    let town = &*TOWN;
    let dir = folder();
    let truth = dir.path().join("truth.tum");
    let whole = fs::read_to_string(town.path("live_truth.tum")).unwrap();
    let lines: Vec<&str> = whole.lines().filter(|l| !l.starts_with('#')).collect();
    assert_eq!(lines.len(), town.live_drive.len());
    // 20 s around a corner: a straight line would be far from the road.
    let holed: Vec<&str> = lines[..20].iter().chain(&lines[60..]).copied().collect();
    fs::write(&truth, holed.join("\n") + "\n").unwrap();
    let ran =
        esm!["localize", "--json", "--map", town.path("map.esm"), town.path("live.mcap"), "--truth", truth]
            .ended(0);
    let summary = ran.summary();
    assert_eq!((&summary["outside_truth"], &summary["false"]), (&Value::from(40), &Value::from(0)));
    assert_eq!(summary["clouds"].as_u64().unwrap() as usize, lines.len() - 40);
    let unjudged = ran.json().iter().filter(|l| l["localizable"].is_null() && l["error_m"].is_null()).count();
    assert_eq!(unjudged, 40 + 1, "the summary has neither");
}

#[test]
fn a_recording_can_be_the_truth() {
    let town = &*TOWN;
    let summary = esm![
        "localize",
        "--json",
        "--frames",
        "1-30",
        "--map",
        town.path("map.esm"),
        town.path("map.mcap"),
        "--truth",
        town.path("map.mcap")
    ]
    .ended(0)
    .summary();
    assert_eq!((&summary["clouds"], &summary["false"]), (&Value::from(30), &Value::from(0)));
    assert!(summary["recall"].as_f64().unwrap() > 0.95, "{summary}");
}

#[test]
fn impossible_flags_are_refused() {
    let town = &*TOWN;
    let run = |flags: &[&str]| {
        let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
        let mut all = vec!["localize", "--map", map.to_str().unwrap(), live.to_str().unwrap()];
        all.extend(flags);
        crate::common::run(all)
    };
    run(&["--frames", "900-950"]).failed(&["--frames 900-950", "71 scans"]);
    run(&["--frames", "1-5,4-9"]).failed(&["overlap"]);
    run(&["--from", "9000"]).failed(&["--from 9000", "the scans span 35.000 s"]);
    run(&["--from", "-1"]).failed(&["--from -1"]);
    run(&["--from", "9", "--to", "3"]).failed(&["ends before it begins"]);
    run(&["--accumulate", "-3"]).failed(&["accumulate.distance_m = -3"]);
    run(&["--accumulate", "nan"]).failed(&["accumulate.distance_m"]);
    run(&["--accumulate", "0", "--swathes"]).failed(&["accumulate.swathes"]);
    run(&["--threads", "0"]).failed(&["--threads 0"]);
    run(&["--descriptor", "magic"]).failed(&["magic", "shape", "eigen"]);
    run(&["--config", "/nowhere/esm.toml"]).failed(&["/nowhere/esm.toml"]);
    // Spelling is clap's: its message names the value and the flag.
    for (flags, words) in [
        (["--frames", "0-5"], "counted from 1"),
        (["--frames", "9-5"], "ends before it begins"),
        (["--frames", "x"], "form A-B"),
        (["--seed", "-1"], "--seed"),
    ] {
        let ran = run(&flags).ended(2);
        assert!(ran.stderr.contains(words), "{}", ran.stderr);
    }
    let ran = run(&["--frames", "60-90"]).ended(0);
    assert!(ran.stderr.contains("warning: --frames 60-90: the input ends with scan 71"), "{}", ran.stderr);
}

#[cfg(unix)]
#[test]
fn pipes_and_endless_files_are_no_configuration_and_no_truth() {
    let dir = folder();
    let (map, live) = (TOWN.path("map.esm"), TOWN.path("live.mcap"));
    let pipe = dir.path().join("pipe.tum");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for flag in ["--truth", "--config"] {
        esm!["localize", "--map", map, live, flag, pipe].failed(&["pipe.tum: this is not a regular file"]);
        esm!["localize", "--map", map, live, flag, dir.path()].failed(&["this is a directory"]);
    }
    esm!["localize", "--map", map, live, "--config", "/dev/zero"].failed(&["not a regular file"]);
    esm!["localize", "--map", map, live, "--config", live].failed(&["larger than a configuration can be"]);
}

#[test]
fn a_configuration_is_read_and_unknown_keys_are_refused() {
    let town = &*TOWN;
    let dir = folder();
    let file = dir.path().join("esm.toml");
    let run = |text: &str| {
        fs::write(&file, text).unwrap();
        esm![
            "localize",
            "--json",
            "--config",
            file,
            "--map",
            town.path("map.esm"),
            town.path("live.mcap"),
            "--frames",
            "1-12"
        ]
    };
    let summary = run("[accumulate]\ndistance_m = 6.0\n").ended(0).summary();
    assert_eq!(summary["accumulate_m"], 6.0);
    run("[accumulate]\ndistance = 6.0\n").failed(&[
        "esm.toml:2",
        "unknown field `distance`",
        "esm-cli config",
    ]);
    run("[pose]\nmethod = \"luck\"\n").failed(&["esm.toml:2", "luck", "clique"]);
    run("seed = [\n").failed(&["esm.toml:"]);
    run("[match]\nk = 10001\n").failed(&["esm.toml", "match.k = 10001", "esm-cli config"]);
    // All defaults, as printed.
    let defaults = esm!["config"].ended(0).stdout;
    assert_eq!(run(&defaults).ended(0).summary()["accumulate_m"], 20.0);
    // Segments cut in another way are warned of.
    let ran = run("[segment]\nvoxel = 0.3\n");
    assert!(ran.stderr.contains("warning: the map was built with another [segment]"), "{}", ran.stderr);
}

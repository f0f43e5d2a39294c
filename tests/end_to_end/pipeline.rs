//! From recordings to poses, on the synthetic street.

use serde_json::Value;

use crate::common::{TOWN, esm, folder};

fn pose_of(line: &Value) -> [f64; 3] {
    [0, 1, 2].map(|i| line["pose"]["t"][i].as_f64().unwrap())
}

#[test]
fn a_drive_is_localized_in_the_map_of_another_drive() {
    let town = &*TOWN;
    let ran = esm![
        "localize",
        "--map",
        town.path("map.esm"),
        town.path("live.mcap"),
        "--truth",
        town.path("live_truth.tum"),
        "--json"
    ]
    .ended(0);
    let lines = ran.json();
    assert_eq!(lines.len(), town.live_drive.len() + 1, "a line a sweep, and the summary");
    let summary = ran.summary();
    assert_eq!(summary["false"], 0, "{summary}");
    assert!(summary["recall"].as_f64().unwrap() > 0.9, "{summary}");
    assert!(summary["median_error_m"].as_f64().unwrap() < 0.1, "{summary}");
    assert!(summary["median_error_deg"].as_f64().unwrap() < 0.3, "{summary}");
    assert_eq!(summary["clouds"], town.live_drive.len());
    // The product's figures are what the lines say, judged here once more and by other means.
    let (mut near, mut located) = (0, 0);
    for (line, sweep) in lines.iter().zip(&town.live_drive) {
        assert_eq!(line["stamp"].as_f64().unwrap(), sweep.stamp);
        assert_eq!(line["localizable"], true);
        if line["verdict"] == "located" {
            located += 1;
            let truth = sweep.pose_world_sensor.translation.vector;
            let pose = pose_of(line);
            let off = (0..3).map(|a| (pose[a] - truth[a]).powi(2)).sum::<f64>().sqrt();
            assert!((off - line["error_m"].as_f64().unwrap()).abs() < 1e-9);
            near += usize::from(off < 2.0);
            assert_eq!(line["covariance"].as_array().unwrap().len(), 36);
            assert_eq!(line["reason"], Value::Null);
        } else {
            assert!(line["reason"].is_string(), "{line}");
        }
        let times = line["timings_ms"].as_object().unwrap();
        let sum: f64 = times.iter().filter(|t| t.0 != "total").map(|t| t.1.as_f64().unwrap()).sum();
        assert!((sum - times["total"].as_f64().unwrap()).abs() < 0.01, "the total is the stages' sum");
    }
    assert_eq!(
        (summary["located"].as_u64(), summary["correct"].as_u64()),
        (Some(located), Some(near as u64))
    );
}

#[test]
fn clouds_hold_the_travel_that_was_asked_for() {
    let town = &*TOWN;
    let run = |flags: &[&str]| {
        let map = town.path("map.esm");
        let live = town.path("live.mcap");
        let mut all = vec!["localize", "--json", "--map", map.to_str().unwrap(), live.to_str().unwrap()];
        all.extend(flags);
        crate::common::run(all)
    };
    let travel = |line: &Value| line["travel_m"].as_f64().unwrap();
    let six = run(&["--accumulate", "6"]).json();
    assert_eq!(six.len(), town.live_drive.len() + 1);
    assert!(six[3..six.len() - 1].iter().all(|l| (6.0..8.5).contains(&travel(l))));
    let single = run(&["--accumulate", "0"]).json();
    assert_eq!(single.len(), town.live_drive.len() + 1);
    assert!(single[..single.len() - 1].iter().all(|l| travel(l) == 0.0));
    let swathes = run(&["--accumulate", "20", "--swathes"]).json();
    assert!((5..=7).contains(&(swathes.len() - 1)), "{} swathes of 20 m in 140 m", swathes.len() - 1);
    assert!(swathes[..swathes.len() - 1].iter().all(|l| travel(l) >= 20.0));
    let alone = run(&["--accumulate", "20", "--single"]).ended(0).json();
    assert_eq!(alone.len(), town.live_drive.len() + 1);
}

#[test]
fn frames_and_times_choose_scans() {
    let town = &*TOWN;
    let stamps = |flags: &[&str]| -> Vec<f64> {
        let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
        let mut all = vec!["localize", "--json", "--map", map.to_str().unwrap(), live.to_str().unwrap()];
        all.extend(flags);
        crate::common::run(all).json().iter().filter_map(|l| l["stamp"].as_f64()).collect()
    };
    let chosen = stamps(&["--frames", "3-5,20-21"]);
    let want: Vec<f64> = [3, 4, 5, 20, 21].map(|n: usize| town.live_drive[n - 1].stamp).to_vec();
    assert_eq!(chosen, want);
    // Half a second a sweep.
    assert_eq!(stamps(&["--from", "2", "--to", "3"]), [5002.0, 5002.5, 5003.0]);
    // What was left out between two ranges is not accumulated across.
    let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
    let lines = esm!["localize", "--json", "--map", map, live, "--frames", "3-5,7-8"].json();
    let travels: Vec<f64> = lines.iter().filter_map(|l| l["travel_m"].as_f64()).collect();
    assert_eq!(travels.iter().filter(|t| **t == 0.0).count(), 2, "{travels:?}");
}

#[test]
fn without_motion_every_scan_is_localized_by_itself() {
    let town = &*TOWN;
    let ran = esm![
        "localize",
        "--map",
        town.path("map.esm"),
        town.path("silent.mcap"),
        "--truth",
        town.path("live_truth.tum"),
        "--json"
    ];
    assert!(
        ran.stderr.contains("silent.mcap: this input does not tell how the sensor moved"),
        "{}",
        ran.stderr
    );
    let lines = ran.json();
    assert!(lines[..lines.len() - 1].iter().all(|l| l["travel_m"] == 0.0));
    let summary = ran.summary();
    assert_eq!((summary["accumulate_m"].as_f64(), summary["false"].as_u64()), (Some(0.0), Some(0)));
    assert_eq!(summary["localizable"], town.live_drive.len(), "no travel is asked for, so all clouds count");
}

#[test]
fn a_map_is_built_from_scans_with_poses() {
    let town = &*TOWN;
    let dir = folder();
    let map = dir.path().join("scans.esm");
    esm!["map", "build", town.path("scans"), "--poses", town.path("scans.txt"), "-o", map].ended(0);
    let summary = esm![
        "localize",
        "--map",
        map,
        town.path("live.mcap"),
        "--truth",
        town.path("live_truth.tum"),
        "--json"
    ]
    .ended(0)
    .summary();
    assert_eq!(summary["false"], 0, "{summary}");
    assert!(summary["recall"].as_f64().unwrap() > 0.9, "{summary}");
}

#[test]
fn a_map_is_built_from_one_prior_cloud() {
    let town = &*TOWN;
    let dir = folder();
    let map = dir.path().join("survey.esm");
    esm!["map", "build", town.path("survey.pcd"), "-o", map].ended(0);
    let info: Value = serde_json::from_str(&esm!["map", "info", "--json", map].ended(0).stdout).unwrap();
    assert_eq!(info["path"]["positions"], 0);
    assert!(info["coverage_cells"].as_u64().unwrap() > 100, "{info}");
    let summary = esm![
        "localize",
        "--map",
        map,
        town.path("live.mcap"),
        "--truth",
        town.path("live_truth.tum"),
        "--json"
    ]
    .ended(0)
    .summary();
    assert_eq!(summary["false"], 0, "{summary}");
    assert!(summary["recall"].as_f64().unwrap() > 0.5, "{summary}");
}

#[test]
fn the_other_descriptor_works_too() {
    let town = &*TOWN;
    let dir = folder();
    let map = dir.path().join("eigen.esm");
    esm!["map", "build", town.path("map.mcap"), "--descriptor", "eigen", "-o", map].ended(0);
    // The map tells which one it needs.
    let summary = esm![
        "localize",
        "--map",
        map,
        town.path("live.mcap"),
        "--truth",
        town.path("live_truth.tum"),
        "--json"
    ]
    .ended(0)
    .summary();
    assert_eq!(summary["false"], 0, "{summary}");
    assert!(summary["located"].as_u64().unwrap() > 0, "{summary}");
}

#[test]
fn another_town_is_not_found() {
    let town = &*TOWN;
    let dir = folder();
    let stranger = esm_tests::street::Street::new(8).drive(60.0, 0.0, 0.0, 3);
    let recording = dir.path().join("elsewhere.mcap");
    esm_tests::recording::write_drive(&recording, &stranger, Some(&esm_core::Pose::identity())).unwrap();
    let ran = esm!["localize", "--map", town.path("map.esm"), recording, "--json"].ended(1);
    assert_eq!(ran.summary()["located"], 0);
}

#[test]
fn loops_close_where_the_drive_comes_back() {
    let town = &*TOWN;
    let dir = folder();
    let graph = dir.path().join("loops.g2o");
    let ran =
        esm!["loops", town.path("map.mcap"), "--truth", town.path("map_truth.tum"), "--json", "-o", graph]
            .ended(0);
    let lines = ran.json();
    let summary = ran.summary();
    assert_eq!(summary["false"], 0, "{summary}");
    assert!(summary["recall"].as_f64().unwrap() > 0.6, "{summary}");
    for line in &lines[..lines.len() - 1] {
        let (from, to) = (line["stamp_from"].as_f64().unwrap(), line["stamp_to"].as_f64().unwrap());
        assert!(to - from > 30.0, "{line}");
        assert_eq!(line["correct"], true, "{line}");
        // Half a second a scan, from 1000 s.
        assert_eq!(line["frame_to"].as_f64().unwrap(), 1.0 + (to - 1000.0) / 0.5);
    }
    let text = std::fs::read_to_string(graph).unwrap();
    let count = |tag: &str| text.lines().filter(|l| l.starts_with(tag)).count();
    let n = town.map_drive.len();
    assert_eq!(count("VERTEX_SE3:QUAT "), n);
    assert_eq!(count("EDGE_SE3:QUAT "), n - 1 + lines.len() - 1, "odometry and closures");
}

#[test]
fn several_inputs_are_read_one_after_the_other() {
    let town = &*TOWN;
    let (map, live) = (town.path("map.esm"), town.path("live.mcap"));
    let dir = folder();
    let again = dir.path().join("again.mcap");
    std::fs::copy(&live, &again).unwrap();
    let n = town.live_drive.len();
    let lines =
        esm!["localize", "--json", "--map", map, live, again, "--frames", format!("{n}-{}", n + 1)].json();
    let stamps: Vec<f64> = lines.iter().filter_map(|l| l["stamp"].as_f64()).collect();
    assert_eq!(stamps, [town.live_drive[n - 1].stamp, town.live_drive[0].stamp]);
    assert_eq!(lines[1]["travel_m"], 0.0, "nothing is accumulated from one input into the next");
}

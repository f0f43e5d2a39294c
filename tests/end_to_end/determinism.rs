//! The same input, configuration and seed give the same bits, with any number of threads.

use serde_json::Value;

use crate::common::{TOWN, esm, folder};

fn without_measurements(text: &str) -> Vec<Value> {
    text.lines()
        .map(|line| {
            let mut value: Value = serde_json::from_str(line).unwrap();
            let object = match value.get_mut("summary") {
                Some(summary) => summary.as_object_mut(),
                None => value.as_object_mut(),
            };
            if let Some(object) = object {
                for measured in ["timings_ms", "elapsed_s", "peak_memory_mib"] {
                    object.remove(measured);
                }
            }
            value
        })
        .collect()
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let town = &*TOWN;
    let run = |threads: &str| {
        let ran = esm![
            "localize",
            "--json",
            "--threads",
            threads,
            "--map",
            town.path("map.esm"),
            town.path("live.mcap"),
            "--truth",
            town.path("live_truth.tum")
        ];
        without_measurements(&ran.ended(0).stdout)
    };
    let one = run("1");
    assert_eq!(one, run("2"));
    assert_eq!(one, run("5"));
}

#[test]
fn maps_are_the_same_bytes_with_any_number_of_threads() {
    let town = &*TOWN;
    let dir = folder();
    for input in ["map.mcap", "survey.pcd"] {
        let build = |threads: &str| {
            let map = dir.path().join(format!("{threads}.esm"));
            esm!["map", "build", town.path(input), "--threads", threads, "-o", map].ended(0);
            std::fs::read(map).unwrap()
        };
        let one = build("1");
        assert!(one == build("2") && one == build("3"), "{input}");
    }
}

#[test]
fn loops_do_not_depend_on_the_number_of_threads() {
    let town = &*TOWN;
    let dir = folder();
    let run = |threads: &str| {
        let graph = dir.path().join("loops.g2o");
        let ran = esm!["loops", "--json", "--threads", threads, town.path("map.mcap"), "-o", graph];
        (without_measurements(&ran.ended(0).stdout), std::fs::read(graph).unwrap())
    };
    assert!(run("1") == run("2"));
}

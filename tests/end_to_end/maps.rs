//! Map files on the command line: what they tell, and damaged ones.

use std::fs;

use serde_json::Value;

use crate::common::{TOWN, esm, folder, names};

#[test]
fn a_map_tells_what_it_holds() {
    let town = &*TOWN;
    let text = esm!["map", "info", town.path("map.esm"), "--check"].ended(0).stdout;
    for words in [
        " of ground, ",
        " of structure",
        "map.mcap",
        "esm-swift (version ",
        ", 24 numbers)",
        "path of 3",
        "checked            every byte",
    ] {
        assert!(text.contains(words), "'{words}' is missing in\n{text}");
    }
    let info: Value =
        serde_json::from_str(&esm!["map", "info", "--json", town.path("map.esm")].ended(0).stdout).unwrap();
    assert_eq!(info["descriptor"]["name"], "esm-swift");
    assert_eq!(info["bytes"].as_u64().unwrap(), fs::metadata(town.path("map.esm")).unwrap().len());
    assert!(info["structure_tiles"].as_u64().unwrap() > 0, "{info}");
    assert!(!text.contains("[segment]"));
    let text = esm!["map", "info", "--settings", town.path("map.esm")].ended(0).stdout;
    assert!(text.contains(&format!("\n\n{}\n", info["settings"].as_str().unwrap().trim_end())), "{text}");
    assert!(info["segments"].as_u64().unwrap() > 50, "{info}");
    let length = info["path"]["length_m"].as_f64().unwrap();
    assert!((330.0..350.0).contains(&length), "{length}");
    let settings: esm_core::Config = toml::from_str(info["settings"].as_str().unwrap()).unwrap();
    assert_eq!(settings, esm_core::Config::default());
}

#[test]
fn no_flipped_byte_goes_unnoticed() {
    let town = &*TOWN;
    let dir = folder();
    let bytes = fs::read(town.path("map.esm")).unwrap();
    let damaged = dir.path().join("damaged.esm");
    // The start, the end, and places all over.
    let step = bytes.len() / 23;
    let places = [0, 9, 60, 64, 100, bytes.len() - 1].into_iter().chain((0..23).map(|i| i * step + 7));
    for place in places {
        let mut copy = bytes.clone();
        copy[place] ^= 0x10;
        fs::write(&damaged, copy).unwrap();
        esm!["map", "info", "--check", damaged].failed(&["damaged.esm"]);
    }
}

#[test]
fn localizing_in_a_damaged_map_fails_even_where_nothing_of_the_damage_is_needed() {
    let town = &*TOWN;
    let dir = folder();
    let info: Value =
        serde_json::from_str(&esm!["map", "info", "--json", town.path("map.esm")].ended(0).stdout).unwrap();
    let sections = info["sections"].as_array().unwrap();
    let points = sections.iter().max_by_key(|s| s["bytes"].as_u64()).unwrap();
    let (offset, len) =
        (points["offset"].as_u64().unwrap() as usize, points["bytes"].as_u64().unwrap() as usize);
    let damaged = dir.path().join("damaged.esm");
    let poses = dir.path().join("poses.tum");
    for place in [offset, offset + len / 2, offset + len - 1] {
        let mut bytes = fs::read(town.path("map.esm")).unwrap();
        bytes[place] ^= 1;
        fs::write(&damaged, bytes).unwrap();
        let ran = esm!["localize", "--map", damaged, town.path("live.mcap"), "--frames", "1-3", "-o", poses];
        ran.failed(&["damaged.esm"]);
        assert_eq!(names(dir.path()), ["damaged.esm"], "no output of a run that failed");
    }
}

#[test]
fn what_is_no_whole_map_is_refused() {
    let town = &*TOWN;
    let dir = folder();
    let bytes = fs::read(town.path("map.esm")).unwrap();
    let file = dir.path().join("x.esm");
    for keep in [0, 3, 63, 64, 1000, bytes.len() / 2, bytes.len() - 1] {
        fs::write(&file, &bytes[..keep]).unwrap();
        esm!["map", "info", file].failed(&["x.esm"]);
        esm!["localize", "--map", file, town.path("live.mcap")].failed(&["x.esm"]);
    }
    let mut longer = bytes;
    longer.extend(b"more");
    fs::write(&file, longer).unwrap();
    esm!["map", "info", file].failed(&["x.esm"]);
    esm!["map", "info", town.path("live.mcap")].failed(&["live.mcap", "not an esm map"]);
    esm!["map", "info", dir.path().join("none.esm")].failed(&["none.esm"]);
    esm!["map", "info", dir.path()].failed(&[&dir.path().display().to_string()]);
}

#[test]
fn a_map_of_another_descriptor_is_refused() {
    let town = &*TOWN;
    esm!["localize", "--descriptor", "eigen", "--map", town.path("map.esm"), town.path("live.mcap")].failed(
        &["map.esm: the map holds 'esm-swift ", "eigen", "hint: use --descriptor esm-swift, or rebuild"],
    );
}

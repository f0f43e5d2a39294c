//! The second visit driven otherwise: what is written, what is resumed, what stays as it was.

use std::collections::BTreeMap;
use std::path::Path;

use esm_io::read_tum;
use esm_sim::{Drive, Error, Plan, Preset, State, made_in, preset, simulate, state};
use proptest::prelude::*;

const SEED: u64 = 7;
const SCALE: f64 = 0.012;

fn forest(drive: Drive) -> Preset {
    drive.of(&preset("train-forest").unwrap()).unwrap()
}

fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(dir).unwrap().map(Result::unwrap);
    entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect()
}

const ALL: Drive = Drive { reversed: true, offset_m: 2.0, changed: Some(0.3) };

/// The map visit is the same to the byte, the live one is not; what was asked for stands in `preset.toml`; the same arguments
/// give the same bytes with any number of threads.
#[test]
fn the_live_visit_alone_is_another() {
    let made = |drive: Drive, threads: usize| {
        let dir = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| simulate(&forest(drive), SEED, SCALE, dir.path(), &mut |_| true)).unwrap();
        let name = made_in(dir.path()).unwrap();
        (files(dir.path()), name, dir)
    };
    let (own, own_name, _) = made(Drive::default(), 2);
    let (other, name, dir) = made(ALL, 1);
    let (again, ..) = made(ALL, 3);
    assert!(other == again, "the bytes depend on the threads");
    for file in ["map.mcap", "map_truth.tum"] {
        assert!(own[file] == other[file], "{file} differs");
    }
    assert!(own["live.mcap"] != other["live.mcap"]);
    assert_eq!(
        (own_name.as_str(), name.as_str()),
        ("train-forest:7:0.012", "train-forest:7:0.012:reversed:offset 2:changed 0.3")
    );
    let told: toml::Table = toml::from_str(std::str::from_utf8(&other["preset.toml"]).unwrap()).unwrap();
    let live = &told["preset"]["live"];
    assert_eq!(live["reversed"].as_bool(), Some(true));
    assert_eq!(live["offset_m"].as_float(), Some(2.0));
    assert_eq!(live["visit"]["changed"].as_float(), Some(0.3));
    let own: toml::Table = toml::from_str(std::str::from_utf8(&own["preset.toml"]).unwrap()).unwrap();
    assert!(
        own["preset"]["live"]["visit"].get("changed").is_none(),
        "nothing new where nothing was asked for"
    );
    // Backwards and beside, by the truth.
    let truth = |name: &str| {
        let poses = read_tum(dir.path().join(format!("{name}_truth.tum"))).unwrap();
        poses.iter().map(|p| p.pose.translation.vector).collect::<Vec<_>>()
    };
    let (map, live) = (truth("map"), truth("live"));
    let (start, end) = ((live[0] - map[map.len() - 1]).norm(), (live[live.len() - 1] - map[0]).norm());
    assert!(
        start < 4.0 && end < 4.0,
        "it starts {start} m from the map's end and ends {end} m from its start"
    );
    let off = |p: &nalgebra::Vector3<f64>| map.iter().map(|q| (p - q).norm()).fold(f64::INFINITY, f64::min);
    assert!(live.iter().any(|p| off(p) > 1.2), "somewhere it is beside the way");
}

/// Outside of a bent way the whole of it is accompanied, not as many metres of it.
#[test]
fn ways_beside_are_as_long_as_the_mapped_one() {
    let forest = preset("train-forest").unwrap();
    let ends = |p: &Preset| {
        let world = Plan::world(p, 100, 0.15, &p.live);
        let truth = Plan::new(p, 100, 0.15, &p.live, &world).truth;
        [truth[0], truth[truth.len() - 1]].map(|pose| pose.translation.vector)
    };
    let own = ends(&forest);
    for offset_m in [5.0, -5.0] {
        let beside = ends(&Drive { offset_m, ..Drive::default() }.of(&forest).unwrap());
        for (a, b) in own.iter().zip(&beside) {
            assert!((a - b).norm() < 9.0, "{offset_m}: {} m from the plain one's end", (a - b).norm());
        }
    }
}

#[test]
fn a_part_of_another_drive_is_not_gone_on_with() {
    let dir = tempfile::tempdir().unwrap();
    simulate(&forest(ALL), SEED, SCALE, dir.path(), &mut |_| false).unwrap_err();
    assert_eq!(state(&forest(ALL), SEED, SCALE, dir.path()), State::Unfinished);
    for other in [
        Drive::default(),
        Drive { reversed: false, ..ALL },
        Drive { offset_m: 5.0, ..ALL },
        Drive { changed: None, ..ALL },
    ] {
        let State::OtherUnfinished(words) = state(&forest(other), SEED, SCALE, dir.path()) else {
            panic!("{other:?} goes on with {ALL:?}")
        };
        assert!(
            words.starts_with(
                "train-forest, seed 7, scale 0.012, live reversed, live offset 2, live changed 0.3, esm-sim "
            ),
            "{words}"
        );
    }
    simulate(&forest(ALL), SEED, SCALE, dir.path(), &mut |_| true).unwrap();
    assert!(matches!(state(&forest(ALL), SEED, SCALE, dir.path()), State::Complete(_)));
    assert!(matches!(state(&forest(Drive::default()), SEED, SCALE, dir.path()), State::Other(_)));
}

/// A reversed drive covers the stretch that the preset's own covers: that of `kitti` is its last fifth.
#[test]
fn reversed_parts_are_the_same_stretch() {
    let kitti = preset("kitti").unwrap();
    let back = Drive { reversed: true, ..Drive::default() }.of(&kitti).unwrap();
    let poses = |p: &Preset| {
        let world = Plan::world(p, 3, 0.2, &p.live);
        let plan = Plan::new(p, 3, 0.2, &p.live, &world);
        plan.truth.iter().map(|pose| pose.translation.vector).collect::<Vec<_>>()
    };
    let (there, back) = (poses(&kitti), poses(&back));
    let off =
        |p: &nalgebra::Vector3<f64>| there.iter().map(|q| (p - q).xy().norm()).fold(f64::INFINITY, f64::min);
    let far = back.iter().filter(|p| off(p) > 6.0).count();
    assert!(back.len() > 40 && far * 20 < back.len(), "{far} of {} sweeps are elsewhere", back.len());
    let start = (back[0] - there[there.len() - 1]).xy().norm();
    assert!(start < 12.0, "it starts {start} m from the other's end");
}

#[test]
fn drives_that_cannot_be_are_refused() {
    let kitti = preset("kitti").unwrap();
    for offset_m in [21.0, -20.5, f64::NAN, f64::INFINITY] {
        let error = Drive { offset_m, ..Drive::default() }.of(&kitti).unwrap_err();
        assert!(matches!(error, Error::Offset { .. }) && error.to_string().contains("hint: "), "{error}");
    }
    for share in [-0.1, 1.1, f64::NAN] {
        let error = Drive { changed: Some(share), ..Drive::default() }.of(&kitti).unwrap_err();
        assert!(matches!(error, Error::Changed { .. }) && error.to_string().contains("hint: "), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, ..ProptestConfig::default() })]

    /// Whatever the world, the seed and the drive: the truth is finite, as long as it should be, and near the mapped way.
    #[test]
    fn any_drive_is_driven(
        which in 0..esm_sim::PRESETS.len(),
        seed in 0u64..1000,
        reversed: bool,
        offset_m in -12.0f64..12.0,
        changed in proptest::option::of(0.0f64..1.0),
    ) {
        let own = esm_sim::PRESETS[which];
        let scale = 150.0 / own.length_m;
        let driven = Drive { reversed, offset_m, changed }.of(&own).unwrap();
        let places = |p: &Preset| {
            let world = Plan::world(p, seed, scale, &p.live);
            let plan = Plan::new(p, seed, scale, &p.live, &world);
            plan.truth.iter().map(|pose| pose.translation.vector).collect::<Vec<_>>()
        };
        let (plain, driven) = (places(&own), places(&driven));
        prop_assert!(driven.len() as f64 > 0.4 * plain.len() as f64, "{} of {}", driven.len(), plain.len());
        // Wandering, the other lane, and what sharp bends add at their outside.
        let most = offset_m.abs() + 3.2 + 0.4 * own.spacing_m + 4.0;
        for p in driven.iter().step_by(20) {
            prop_assert!(p.iter().all(|v| v.is_finite()));
            let off = plain.iter().map(|q| (p - q).xy().norm()).fold(f64::INFINITY, f64::min);
            prop_assert!(off < most, "{}: {off} m off for {offset_m}", own.name);
        }
    }
}

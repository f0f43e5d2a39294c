//! Simulations that are interrupted go on where they were, and nobody can tell from what they make.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use esm_sim::{Error, Preset, Progress, State, Summary, preset, simulate, state};

const SEED: u64 = 107;
const SCALE: f64 = 0.012;

/// 24 sweeps of a VLP-16 a visit: two batches.
fn forest() -> Preset {
    preset("train-forest").unwrap()
}

/// All files of a directory, hidden ones too.
fn files(dir: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(dir).unwrap().map(Result::unwrap);
    entries.map(|e| (e.file_name().into_string().unwrap(), std::fs::read(e.path()).unwrap())).collect()
}

/// Runs until `progress` has been heard this many times; the progress told.
fn run(dir: &Path, reports: usize) -> (Result<Summary, Error>, Vec<Progress>) {
    let mut told = Vec::new();
    let result = simulate(&forest(), SEED, SCALE, dir, &mut |p| {
        told.push(p);
        told.len() < reports
    });
    (result, told)
}

/// What a run makes that nobody interrupts.
static WHOLE: LazyLock<BTreeMap<String, Vec<u8>>> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), usize::MAX).0.unwrap();
    files(dir.path())
});

fn assert_same(dir: &Path, whole: &BTreeMap<String, Vec<u8>>, when: &str) {
    let found = files(dir);
    let names: Vec<_> = found.keys().collect();
    assert_eq!(names, whole.keys().collect::<Vec<_>>(), "{when}");
    for (name, bytes) in &found {
        assert!(*bytes == whole[name], "{when}: {name} differs");
    }
}

#[test]
fn interrupted_runs_end_in_the_same_bytes() {
    let whole = &*WHOLE;
    assert_eq!(
        whole.keys().collect::<Vec<_>>(),
        ["live.mcap", "live_truth.tum", "map.mcap", "map_truth.tum", "preset.toml"]
    );
    for reports in [1, 2, 3] {
        let dir = tempfile::tempdir().unwrap();
        let (result, told) = run(dir.path(), reports);
        assert!(matches!(result, Err(Error::Interrupted)));
        let reached = *told.last().unwrap();
        assert_eq!(state(&forest(), SEED, SCALE, dir.path()), State::Unfinished);
        let (result, told) = run(dir.path(), usize::MAX);
        let summary = result.unwrap();
        let earlier = if reached.visit == "live" { reached.total } else { 0 };
        assert_eq!((summary.kept, summary.discarded), (earlier + reached.done, 0), "after {reports} reports");
        assert!(
            told.iter().all(|p| p.visit == "live") == (reached.visit == "live"),
            "no visit is made twice"
        );
        assert_same(dir.path(), whole, &format!("interrupted after {reports} reports"));
    }
}

#[test]
fn torn_and_damaged_parts_are_used_as_far_as_they_are_whole() {
    let whole = &*WHOLE;
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), 2).0.unwrap_err();
    let left = files(dir.path());
    assert_eq!(left.keys().collect::<Vec<_>>(), [".map.mcap.part", "unfinished.toml"]);
    let part = &left[".map.mcap.part"];
    let mut most = 0;
    for (case, keep) in [0, 5, 700, part.len() / 2, part.len() - 30].into_iter().enumerate() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("unfinished.toml"), &left["unfinished.toml"]).unwrap();
        // As when the copying of an earlier resumption was interrupted: the copy is of no use then.
        let name = if case % 2 == 0 { ".map.mcap.part" } else { ".map.mcap.part.old" };
        std::fs::write(dir.path().join(".map.mcap.part"), b"rubbish").unwrap();
        std::fs::write(dir.path().join(name), &part[..keep]).unwrap();
        let summary = run(dir.path(), usize::MAX).0.unwrap();
        assert!(summary.kept <= 24 && summary.kept >= most, "{} kept of {keep} bytes", summary.kept);
        most = summary.kept;
        assert_same(dir.path(), whole, &format!("{keep} bytes of the part"));
    }
    assert!(most >= 22, "{most} sweeps are in the part but for its last 30 bytes");
    // A flipped byte in the middle: what stands before its chunk is used.
    let mut bytes = part.clone();
    let at = bytes.len() / 2;
    bytes[at] ^= 0x55;
    std::fs::write(dir.path().join(".map.mcap.part"), bytes).unwrap();
    run(dir.path(), usize::MAX).0.unwrap();
    assert_same(dir.path(), whole, "a flipped byte");
}

#[test]
fn interruptions_while_resuming_lose_nothing() {
    let whole = &*WHOLE;
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), 2).0.unwrap_err();
    // The first report of a resumption comes from the copying.
    let (result, told) = run(dir.path(), 1);
    assert!(matches!(result, Err(Error::Interrupted)));
    assert_eq!(told[0].done, 16);
    assert_eq!(run(dir.path(), usize::MAX).0.unwrap().kept, 24);
    assert_same(dir.path(), whole, "interrupted while copying");
}

#[test]
fn parts_of_other_simulations_are_not_used() {
    let whole = &*WHOLE;
    let dir = tempfile::tempdir().unwrap();
    simulate(&forest(), SEED + 1, SCALE, dir.path(), &mut |_| false).unwrap_err();
    let State::OtherUnfinished(words) = state(&forest(), SEED, SCALE, dir.path()) else { panic!() };
    assert!(words.starts_with("train-forest, seed 108, scale 0.012, esm-sim "), "{words}");
    assert_eq!(run(dir.path(), usize::MAX).0.unwrap().kept, 0);
    assert_same(dir.path(), whole, "another seed before");
    // A part that claims to be of this one, and is not: another build of the program has made it.
    let other = tempfile::tempdir().unwrap();
    simulate(&forest(), SEED + 1, SCALE, other.path(), &mut |_| false).unwrap_err();
    run(dir.path(), 1).0.unwrap_err();
    std::fs::copy(other.path().join(".map.mcap.part"), dir.path().join(".map.mcap.part")).unwrap();
    let summary = run(dir.path(), usize::MAX).0.unwrap();
    assert!(summary.kept == 0 && summary.discarded > 0, "{summary:?}");
    assert_same(dir.path(), whole, "another build before");
}

#[test]
fn what_is_complete_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let summary = run(dir.path(), usize::MAX).0.unwrap();
    assert_eq!(state(&forest(), SEED, SCALE, dir.path()), State::Complete(summary));
    let State::Other(words) = state(&forest(), u64::MAX, SCALE, dir.path()) else { panic!() };
    assert!(words.starts_with("train-forest, seed 107"), "{words}");
    std::fs::remove_file(dir.path().join("live_truth.tum")).unwrap();
    assert_eq!(state(&forest(), SEED, SCALE, dir.path()), State::Nothing);
}

#[test]
fn two_at_once_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut second = None;
    simulate(&forest(), SEED, SCALE, dir.path(), &mut |_| {
        second = Some(run(dir.path(), 1).0);
        false
    })
    .unwrap_err();
    let Some(Err(error)) = second else { panic!() };
    assert!(matches!(error, Error::Busy { .. }) && error.to_string().contains("hint: "), "{error}");
}

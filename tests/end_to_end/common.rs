//! Running the program, and the recordings it is run on.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use esm_core::Pose;
use esm_tests::recording::{write_drive, write_kitti_poses, write_pcd, write_truth};
use esm_tests::street::{Street, Sweep, prior_cloud};
use nalgebra::Vector3;
use serde_json::Value;
use tempfile::TempDir;

/// The program under test.
pub(crate) fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_esm-cli-under-test"))
}

/// What a run printed and how it ended.
pub(crate) struct Ran {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Ran {
    /// The objects on stdout.
    pub(crate) fn json(&self) -> Vec<Value> {
        self.stdout.lines().map(|l| serde_json::from_str(l).unwrap_or_else(|e| panic!("{e}: {l}"))).collect()
    }

    /// The one object on stdout, however many lines it takes.
    pub(crate) fn value(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {}", self.stdout))
    }

    /// The last object's `summary`.
    pub(crate) fn summary(&self) -> Value {
        self.json()
            .pop()
            .and_then(|mut v| v.get_mut("summary").map(Value::take))
            .expect("a summary at the end")
    }

    /// Asserts the exit code.
    pub(crate) fn ended(self, code: i32) -> Self {
        let tail: Vec<&str> = self.stdout.lines().rev().take(2).collect();
        assert_eq!(self.code, code, "stdout ends:\n{}\nstderr:\n{}", tail.join("\n"), self.stderr);
        self
    }

    /// Asserts that it failed with one clear line that says all these words, and a hint.
    pub(crate) fn failed(self, words: &[&str]) {
        let ran = self.ended(2);
        let mut lines = ran.stderr.lines().filter(|l| !l.starts_with("warning: "));
        let first = lines.next().unwrap_or_default();
        assert!(first.starts_with("error: "), "stderr:\n{}", ran.stderr);
        for word in words {
            assert!(ran.stderr.contains(word), "'{word}' is missing in\n{}", ran.stderr);
        }
        assert!(lines.all(|l| l.starts_with("hint: ")), "stderr:\n{}", ran.stderr);
        assert!(ran.stderr.contains("\nhint: "), "no hint in\n{}", ran.stderr);
        assert!(!ran.stderr.contains("panicked"), "{}", ran.stderr);
    }
}

/// Runs the program.
pub(crate) fn run<S: AsRef<OsStr>>(arguments: impl IntoIterator<Item = S>) -> Ran {
    let output: Output = program().args(arguments).output().expect("the program starts");
    Ran {
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8(output.stdout).expect("UTF-8 on stdout"),
        stderr: String::from_utf8(output.stderr).expect("UTF-8 on stderr"),
    }
}

/// Runs the program with arguments of different kinds.
macro_rules! esm {
    ($($argument:expr),* $(,)?) => {
        $crate::common::run([$(std::ffi::OsStr::new(&$argument).to_owned()),*])
    };
}
pub(crate) use esm;

/// A street, mapped once and driven again.
pub(crate) struct Town {
    dir: PathBuf,
    pub(crate) map_drive: Vec<Sweep>,
    pub(crate) live_drive: Vec<Sweep>,
}

/// Where the live drive's odometry starts: the map knows nothing of it.
fn pose_world_odom() -> Pose {
    Pose::new(Vector3::new(-310.0, 42.0, 3.0), Vector3::z() * 2.2)
}

/// The town, its recordings and its map, made once for all tests.
pub(crate) static TOWN: LazyLock<Town> = LazyLock::new(|| {
    let street = Street::new(7);
    let dir = lasting_folder("town");
    // Once around is 300 m; the live drive is on another day, in the other half of the lane.
    let map_drive = street.drive(340.0, 0.4, 1000.0, 1);
    let live_drive = street.drive(140.0, 1.6, 5000.0, 2);
    let town = Town { dir, map_drive, live_drive };
    write_drive(&town.path("map.mcap"), &town.map_drive, Some(&Pose::identity())).expect("map.mcap");
    write_drive(&town.path("live.mcap"), &town.live_drive, Some(&pose_world_odom())).expect("live.mcap");
    write_drive(&town.path("silent.mcap"), &town.live_drive, None).expect("silent.mcap");
    write_truth(&town.path("live_truth.tum"), &town.live_drive).expect("live_truth.tum");
    write_truth(&town.path("map_truth.tum"), &town.map_drive).expect("map_truth.tum");
    write_pcd(&town.path("survey.pcd"), &prior_cloud(&town.map_drive)).expect("survey.pcd");
    std::fs::create_dir(town.path("scans")).expect("scans");
    for (i, sweep) in town.map_drive.iter().enumerate() {
        write_pcd(&town.path(&format!("scans/{i}.pcd")), sweep.cloud.points()).expect("a scan");
    }
    write_kitti_poses(&town.path("scans.txt"), &town.map_drive).expect("scans.txt");
    esm!["map", "build", town.path("map.mcap"), "-o", town.path("map.esm")].ended(0);
    town
});

impl Town {
    /// A file of the town; writing to names of one's own is allowed.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.join(name)
    }
}

/// An empty place for files that several tests share: statics are never dropped, so it is cleaned by the next run.
pub(crate) fn lasting_folder(name: &str) -> PathBuf {
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    // Missing the first time.
    let _ = std::fs::remove_dir_all(&dir);
    std::fs::create_dir_all(&dir).expect("a folder under target/");
    dir
}

/// A place for a test's own files.
pub(crate) fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary directory")
}

/// What lies in a folder, sorted: also shows forgotten temporary files.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("the folder");
    let mut names: Vec<String> =
        entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A real recording's folder; `None`, with a message, where it is missing. On CI it must be there.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("ESM_SHARED_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing on CI", path.display());
    eprintln!("skipped: {} is not there", path.display());
    None
}

//! `esm-cli serve` and `esm-cli replay`, as processes that talk over the loopback.

mod answers;
mod client;
mod faults;
mod safety;
mod swap;

use std::io::{BufRead, BufReader};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::{Child, Stdio};
use std::sync::LazyLock;

use serde_json::Value;

use crate::common::{TOWN, esm, lasting_folder, program, run};
use client::{Reply, Request};

/// Another map of the town, which answers otherwise.
static OTHER_MAP: LazyLock<PathBuf> = LazyLock::new(|| {
    let path = lasting_folder("service").join("other.esm");
    esm!["map", "build", "--accumulate", "6", TOWN.path("map.mcap"), "-o", path].ended(0);
    path
});

/// A service that ends with the test.
struct Service {
    process: Child,
    address: SocketAddr,
    url: String,
    log: PathBuf,
    _folder: tempfile::TempDir,
}

impl Service {
    /// Starts one with these flags on a free port.
    fn start<S: AsRef<std::ffi::OsStr>>(flags: impl IntoIterator<Item = S>) -> Self {
        let folder = crate::common::folder();
        let log = folder.path().join("log");
        let mut process = program()
            .args(["serve", "--listen", "127.0.0.1:0"])
            .args(flags)
            .stdout(Stdio::piped())
            .stderr(std::fs::File::create(&log).unwrap())
            .spawn()
            .expect("the program starts");
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let Some(url) = line.trim().strip_prefix("listening on ") else {
            let _ = process.wait();
            panic!("'{line}'; log:\n{}", std::fs::read_to_string(&log).unwrap());
        };
        let address = url.split("://").nth(1).unwrap().parse().unwrap();
        Self { address, url: url.to_owned(), process, log, _folder: folder }
    }

    /// With the town's map.
    fn town() -> Self {
        Self::start(["--map".into(), format!("town={}", TOWN.path("map.esm").display())])
    }

    fn send(&self, request: &Request) -> Reply {
        request.send(self.address)
    }

    fn log(&self) -> String {
        std::fs::read_to_string(&self.log).unwrap()
    }

    /// Sends a signal.
    fn signal(&self, name: &str) {
        let pid = self.process.id().to_string();
        assert!(std::process::Command::new("kill").args(["-s", name, &pid]).status().unwrap().success());
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
        if !std::thread::panicking() {
            let log = self.log();
            assert!(!log.contains("panicked"), "{log}");
        }
    }
}

/// The points of a sweep as the service takes them, little-endian f32 x y z reflectance.
fn floats(points: &[[f32; 3]]) -> Vec<u8> {
    points.iter().flat_map(|[x, y, z]| [*x, *y, *z, 0.5]).flat_map(f32::to_le_bytes).collect()
}

/// An answer without what is different every time.
fn timeless(mut answer: Value) -> Value {
    let fields = answer.as_object_mut().unwrap();
    assert!(fields.remove("timings_ms").is_some_and(|t| t["total"].as_f64().is_some_and(|ms| ms > 0.0)));
    answer
}

/// What `localize` says about the live drive's sweeps, each by itself.
fn told_by_localize(map: &std::path::Path) -> Vec<Value> {
    told(map, &["--single", "--accumulate", "0"])
}

/// What `localize` says about the live drive's sweeps with these flags.
fn told(map: &std::path::Path, flags: &[&str]) -> Vec<Value> {
    let mut arguments = vec!["localize".into(), "--json".into(), "--map".into(), map.as_os_str().to_owned()];
    arguments.extend(flags.iter().map(Into::into));
    arguments.push(TOWN.path("live.mcap").into_os_string());
    let mut lines = run(arguments).ended(0).json();
    lines.pop();
    lines.into_iter().map(timeless).collect()
}

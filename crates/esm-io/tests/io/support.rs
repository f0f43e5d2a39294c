//! What the tests share.

use std::path::{Path, PathBuf};

use esm_io::{Error, OpenOptions, Recording, Sweep, Warning};
use tempfile::TempDir;

/// The recordings beside the repository, or `None` with a message; with `CI=true` they have to be there.
pub(crate) fn shared_data() -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let dir = std::env::var_os("ESM_SHARED_DATA").map_or_else(|| PathBuf::from(default), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing in CI", dir.display());
    println!("skipped: {} is missing", dir.display());
    None
}

/// A file of these bytes in a directory of its own.
pub(crate) struct TestFile {
    dir: TempDir,
    pub(crate) path: PathBuf,
}

impl TestFile {
    pub(crate) fn new(name: &str, bytes: impl AsRef<[u8]>) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        Self { dir, path }
    }

    /// An error's text with the directory cut off, so that it can be compared.
    pub(crate) fn message(&self, error: &Error) -> String {
        error.to_string().replace(&format!("{}/", self.dir.path().display()), "")
    }
}

/// Everything a recording gives: sweeps, warnings without the path, and the error it may end with.
pub(crate) struct ReadAll {
    pub(crate) sweeps: Vec<Sweep>,
    pub(crate) warnings: Vec<String>,
    pub(crate) error: Option<String>,
    pub(crate) raw_warnings: Vec<Warning>,
}

pub(crate) fn read_all(path: &Path, options: &OpenOptions) -> ReadAll {
    let short = |text: String| text.replace(&format!("{}/", path.parent().unwrap().display()), "");
    let mut all = ReadAll { sweeps: Vec::new(), warnings: Vec::new(), error: None, raw_warnings: Vec::new() };
    let mut sweeps = match Recording::open(path, options).and_then(|r| r.sweeps()) {
        Ok(sweeps) => sweeps,
        Err(e) => {
            all.error = Some(short(e.to_string()));
            return all;
        }
    };
    for sweep in &mut sweeps {
        match sweep {
            Ok(sweep) => all.sweeps.push(sweep),
            Err(e) => all.error = Some(short(e.to_string())),
        }
    }
    assert!(sweeps.next().is_none(), "an ended iterator stays ended");
    all.raw_warnings = sweeps.warnings().to_vec();
    all.warnings = sweeps.warnings().iter().map(|w| short(w.to_string())).collect();
    all
}

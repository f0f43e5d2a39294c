//! What the tests share.
#![allow(dead_code, unreachable_pub)] // each test binary uses its own part

use std::path::PathBuf;

/// The recordings beside the repository, or `None` with a message; with `CI=true` they have to be there.
pub fn shared_data() -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let dir = std::env::var_os("ESM_SHARED_DATA").map_or_else(|| PathBuf::from(default), PathBuf::from);
    if dir.is_dir() {
        return Some(dir);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing in CI", dir.display());
    println!("skipped: {} is missing", dir.display());
    None
}

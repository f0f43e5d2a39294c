//! What can go wrong while a set is written.

use std::path::PathBuf;

/// The crate's errors.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{}: {doing}: {source}\nhint: {hint}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
        /// What to do.
        hint: &'static str,
    },
    /// The target exists already.
    #[error("{}: it exists already\nhint: sets are written whole; remove it or choose another name", path.display())]
    Exists {
        /// The directory.
        path: PathBuf,
    },
    /// A setting is outside its range.
    #[error("{name} = {value} is not allowed: {allowed}")]
    Setting {
        /// What it is called.
        name: &'static str,
        /// The value, as given.
        value: f64,
        /// What would be allowed.
        allowed: &'static str,
    },
    /// The settings make no sense.
    #[error(transparent)]
    Core(#[from] esm_core::Error),
}

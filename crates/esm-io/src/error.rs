//! What can go wrong while reading or writing, one variant a cause.

use std::path::{Path, PathBuf};

use crate::plain::Plain;

/// The errors of this crate. Each message names the file, the place in it, what is wrong, and what to do about it;
/// control characters in names from files are escaped.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("{}: {doing}: {source}\nhint: {}", Plain(path.display()), io_hint(source))]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file is damaged, cut short, or breaks its format's rules.
    #[error("{}: {}: {}\nhint: {hint}", Plain(path.display()), Plain(place), Plain(what))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it: `line 7`, `byte 4096`, `message 12 of /points`, `header`.
        place: String,
        /// What is wrong there.
        what: String,
        /// What to do.
        hint: String,
    },
    /// The file is something else than what this crate reads.
    #[error("{}: {}\nhint: {hint}", Plain(path.display()), Plain(what))]
    Unsupported {
        /// The file or directory.
        path: PathBuf,
        /// What it is instead.
        what: String,
        /// What to do.
        hint: String,
    },
    /// A topic has to be named, or the one named is not there.
    #[error("{}: {}\nhint: {hint}", Plain(path.display()), Plain(what))]
    Topic {
        /// The recording.
        path: PathBuf,
        /// What is wrong, with the candidates listed.
        what: String,
        /// The topics that could be meant, in order.
        candidates: Vec<String>,
        /// What to do, with the flag.
        hint: String,
    },
    /// There is nothing usable in the input.
    #[error("{}: {}\nhint: {hint}", Plain(path.display()), Plain(what))]
    Empty {
        /// The file or directory.
        path: PathBuf,
        /// What was looked for.
        what: String,
        /// What to do.
        hint: String,
    },
}

/// Hint for files that hold less than they declare.
pub(crate) const HINT_INCOMPLETE: &str =
    "the copy may be incomplete; compare the file's size with the original's";

impl Error {
    pub(crate) fn io(path: &Path, doing: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), doing, source }
    }

    pub(crate) fn malformed(
        path: &Path,
        place: impl Into<String>,
        what: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        Self::Malformed { path: path.to_owned(), place: place.into(), what: what.into(), hint: hint.into() }
    }

    pub(crate) fn unsupported(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_owned(), what: what.into(), hint: hint.into() }
    }

    pub(crate) fn empty(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Empty { path: path.to_owned(), what: what.into(), hint: hint.into() }
    }

    /// The file or directory the error is about.
    pub fn path(&self) -> &Path {
        match self {
            Self::Io { path, .. }
            | Self::Malformed { path, .. }
            | Self::Unsupported { path, .. }
            | Self::Topic { path, .. }
            | Self::Empty { path, .. } => path,
        }
    }
}

fn io_hint(error: &std::io::Error) -> &'static str {
    match error.kind() {
        std::io::ErrorKind::NotFound => "check the spelling; relative paths start at the working directory",
        std::io::ErrorKind::PermissionDenied => "check the permissions of the file and of its directory",
        std::io::ErrorKind::StorageFull => "free some space on the disk",
        _ => "check the disk or the network share the file lies on",
    }
}

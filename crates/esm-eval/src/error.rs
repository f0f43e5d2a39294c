//! What can go wrong while evaluating.

use std::path::{Path, PathBuf};

/// The crate's errors. Each says what is wrong, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The plan cannot be followed.
    #[error("{}{}: {what}\nhint: {hint}", path.display(), place(*line))]
    Plan {
        /// The file of the plan.
        path: PathBuf,
        /// Its line, from 1, where the trouble has one.
        line: Option<usize>,
        /// The entry and what is wrong with it.
        what: String,
        /// What to do.
        hint: String,
    },
    /// An input cannot be used as the plan wants.
    #[error("{}: {what}\nhint: {hint}", path.display())]
    Input {
        /// The file or directory.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
        /// What to do.
        hint: String,
    },
    /// The operating system refused a file operation.
    #[error("{}: {doing}: {source}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
    },
    /// The watcher asked to stop.
    #[error("the evaluation was interrupted\nhint: the same command goes on where it was")]
    Interrupted,
    /// A process that ran a part of it has failed.
    #[error("{what}\nhint: {hint}")]
    Apart {
        /// What it said.
        what: String,
        /// What to do.
        hint: String,
    },
    /// Of the core, named by what was being done.
    #[error("{doing}: {source}")]
    Core {
        /// Dataset and method.
        doing: String,
        /// The core's error.
        source: esm_core::Error,
    },
    /// Reading or writing.
    #[error(transparent)]
    Files(#[from] esm_io::Error),
    /// Simulating.
    #[error(transparent)]
    Simulator(esm_sim::Error),
    /// Cutting labelled segments.
    #[error(transparent)]
    Learn(#[from] esm_learn::Error),
}

impl From<esm_sim::Error> for Error {
    fn from(error: esm_sim::Error) -> Self {
        match error {
            esm_sim::Error::Interrupted => Self::Interrupted,
            other => Self::Simulator(other),
        }
    }
}

impl Error {
    pub(crate) fn io(path: &Path, doing: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), doing, source }
    }

    pub(crate) fn input(path: &Path, what: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Input { path: path.to_owned(), what: what.into(), hint: hint.into() }
    }

    /// An error of the core, with what was being done.
    pub(crate) fn core(doing: impl Into<String>) -> impl FnOnce(esm_core::Error) -> Self {
        let doing = doing.into();
        |source| Self::Core { doing, source }
    }
}

fn place(line: Option<usize>) -> String {
    line.map_or_else(String::new, |n| format!(":{n}"))
}

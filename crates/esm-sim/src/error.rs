//! What can go wrong while simulating.

use std::path::PathBuf;

/// The errors of this crate.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There is no preset of this name.
    #[error("no preset is called '{name}'\nhint: the presets are {known}")]
    UnknownPreset {
        /// What was asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The scale is no usable factor.
    #[error(
        "the scale {scale} is not within 0.005 to 4\nhint: 1 is the preset's own length, 0.1 a tenth of it"
    )]
    Scale {
        /// What was asked for.
        scale: f64,
    },
    /// No live visit is driven so far beside the mapped way.
    #[error(
        "the live way cannot lie {offset_m} m beside the mapped one\nhint: give -{most_m} to {most_m} m; positive is to its left"
    )]
    Offset {
        /// What was asked for, metres.
        offset_m: f64,
        /// What is possible, metres.
        most_m: f64,
    },
    /// The share is none.
    #[error(
        "the share {share} of what has changed is not within 0 to 1\nhint: 0.3 changes three of ten things"
    )]
    Changed {
        /// What was asked for.
        share: f64,
    },
    /// The output directory cannot be made, or a file of it cannot be replaced.
    #[error("{}: {doing}: {source}\nhint: check the path and its permissions", path.display())]
    Directory {
        /// The directory or the file.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
    },
    /// Another simulation is at work in the directory.
    #[error("{}: another simulation is writing here\nhint: wait for it, or choose another directory", path.display())]
    Busy {
        /// The directory.
        path: PathBuf,
    },
    /// A file could not be written.
    #[error(transparent)]
    Output(#[from] esm_io::Error),
    /// The caller asked to stop.
    #[error("the simulation was interrupted\nhint: run it again to go on where it was")]
    Interrupted,
}

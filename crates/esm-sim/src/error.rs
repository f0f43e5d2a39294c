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
    /// The output directory cannot be made.
    #[error("{}: creating the directory: {source}\nhint: check the path and its permissions", path.display())]
    Directory {
        /// The directory.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file could not be written.
    #[error(transparent)]
    Output(#[from] esm_io::Error),
    /// The caller asked to stop.
    #[error("the simulation was interrupted\nhint: nothing incomplete was left behind; run it again")]
    Interrupted,
}

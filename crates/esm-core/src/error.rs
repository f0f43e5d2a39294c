//! What can go wrong in the core, one variant a cause.

use std::path::PathBuf;

/// The core's errors. Each message says what is wrong, where, and what to do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A point holds a NaN or an infinity.
    #[error("point {index} is not finite\nhint: drop invalid returns first (PointCloud::from_finite does)")]
    NonFinitePoint {
        /// Index of the first such point.
        index: usize,
    },
    /// A configuration value is outside its range.
    #[error("configuration: {field} = {value} is not allowed: {allowed}")]
    Config {
        /// Dotted name of the field.
        field: &'static str,
        /// The value, as given.
        value: String,
        /// What would be allowed.
        allowed: &'static str,
    },
    /// The map was built with another descriptor than the one asked for.
    #[error("the map holds '{map}' descriptors, asked for '{asked}'\nhint: {hint}")]
    DescriptorMismatch {
        /// What the map holds (name and version).
        map: String,
        /// What was asked for (name and version).
        asked: String,
        /// What to do.
        hint: String,
    },
    /// A map cannot be built or used because it would hold nothing.
    #[error("the map holds no segments\nhint: {hint}")]
    EmptyMap {
        /// What to look at.
        hint: &'static str,
    },
    /// What was gathered for a map does not fit together.
    #[error("the map cannot be made: {what}\nhint: {hint}")]
    MapData {
        /// What is wrong and where (field, index).
        what: String,
        /// What to do.
        hint: &'static str,
    },
    /// The map file is damaged, truncated, newer, or not a map at all.
    #[error("{}: {what}\nhint: {hint}", path.display())]
    MapFile {
        /// The file.
        path: PathBuf,
        /// What is wrong and where (section, byte offset).
        what: String,
        /// What to do.
        hint: &'static str,
    },
    /// A file of network weights is damaged or belongs to another network.
    #[error("{}: {what}\nhint: {hint}", path.display())]
    WeightsFile {
        /// The file.
        path: PathBuf,
        /// What is wrong and where (header key, tensor, number).
        what: String,
        /// What to do.
        hint: &'static str,
    },
    /// The operating system refused a file operation.
    #[error("{}: {doing}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: std::io::Error,
    },
}

/// The error of a configuration field, unless its condition holds. Conditions are written so that NaN fails them.
pub(crate) fn require(
    holds: bool,
    field: &'static str,
    value: impl ToString,
    allowed: &'static str,
) -> Result<(), Error> {
    if holds { Ok(()) } else { Err(Error::Config { field, value: value.to_string(), allowed }) }
}

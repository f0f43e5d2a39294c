//! `--truth FILE`.

use std::path::Path;

use super::check_regular;
use crate::truth::{self, Trajectory};

/// Reads true poses: a TUM file, or a recording whose motion is the truth.
pub(crate) fn read_truth(path: &Path) -> anyhow::Result<Trajectory> {
    check_regular(path)?;
    Ok(truth::read(path)?)
}

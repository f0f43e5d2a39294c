//! What is wrong with a map, before it is known whether a file or a builder is to blame.

use std::path::Path;

use crate::error::Error;

/// For bytes that are not what was written.
pub(super) const HINT_DAMAGED: &str =
    "the file is damaged or was cut short: copy it again, or rebuild the map";
/// For files of a later format.
pub(super) const HINT_NEWER: &str = "update esm, or rebuild the map with this version";
/// For files whose checksums are right and whose contents are not.
pub(super) const HINT_INVALID: &str =
    "the checksums match, so the program that wrote the file is at fault: rebuild the map with esm";
/// For files that are something else.
pub(super) const HINT_NOT_A_MAP: &str = "give the .esm file that `esm-cli map build` wrote";
/// For builders.
const HINT_DATA: &str = "this is an error of the program that gathered the map, not of its input";

/// A finding; becomes an [`Error`] once its place is known.
#[derive(Debug, PartialEq)]
pub(super) struct Problem {
    pub(super) what: String,
    pub(super) hint: &'static str,
}

impl Problem {
    pub(super) fn damaged(what: impl Into<String>) -> Self {
        Self { what: what.into(), hint: HINT_DAMAGED }
    }

    pub(super) fn newer(what: impl Into<String>) -> Self {
        Self { what: what.into(), hint: HINT_NEWER }
    }

    pub(super) fn invalid(what: impl Into<String>) -> Self {
        Self { what: what.into(), hint: HINT_INVALID }
    }

    pub(super) fn not_a_map(what: impl Into<String>) -> Self {
        Self { what: what.into(), hint: HINT_NOT_A_MAP }
    }

    pub(super) fn in_file(self, path: &Path) -> Error {
        Error::MapFile { path: path.to_owned(), what: self.what, hint: self.hint }
    }

    pub(super) fn in_data(self) -> Error {
        // A reader's hint speaks of files; a builder's problem has none yet.
        Error::MapData { what: self.what, hint: HINT_DATA }
    }
}

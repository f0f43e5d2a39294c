//! A plan as it is written: what the TOML may hold, and no key besides.

use std::path::Path;

use serde::Deserialize;
use toml::{Spanned, Table};

use crate::error::Error;

/// Most bytes of a plan.
const MAX_BYTES: u64 = 1 << 20;

/// The whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PlanText {
    pub(super) name: Option<String>,
    #[serde(default)]
    pub(super) config: Table,
    #[serde(default)]
    pub(super) datasets: Vec<DatasetText>,
    #[serde(default)]
    pub(super) methods: Vec<MethodText>,
    pub(super) modes: Option<Vec<ModeText>>,
    pub(super) roc: Option<RocText>,
    /// For the lines of errors.
    #[serde(skip)]
    pub(super) text: String,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DatasetText {
    pub(super) name: Spanned<String>,
    pub(super) map: Option<Spanned<String>>,
    pub(super) map_poses: Option<Spanned<String>>,
    pub(super) live: Option<Spanned<String>>,
    pub(super) live_poses: Option<Spanned<String>>,
    pub(super) truth: Option<Spanned<String>>,
    pub(super) cloud_topic: Option<String>,
    pub(super) odometry_topic: Option<String>,
    pub(super) preset: Option<Spanned<String>>,
    pub(super) seeds: Option<Vec<u64>>,
    pub(super) scale: Option<f64>,
    pub(super) live_reversed: Option<bool>,
    pub(super) live_offset: Option<f64>,
    pub(super) live_changed: Option<f64>,
    pub(super) accumulate: Option<f64>,
    #[serde(default)]
    pub(super) swathes: bool,
    #[serde(default)]
    pub(super) config: Table,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MethodText {
    pub(super) name: Spanned<String>,
    pub(super) descriptor: Option<Spanned<String>>,
    #[serde(default)]
    pub(super) config: Table,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ModeText {
    pub(super) name: Spanned<String>,
    pub(super) accumulate: Option<f64>,
    #[serde(default)]
    pub(super) odometry: bool,
    #[serde(default = "one")]
    pub(super) every: usize,
    #[serde(default = "one")]
    pub(super) beams: usize,
    #[serde(default)]
    pub(super) map_deleted: f64,
    #[serde(default)]
    pub(super) map_deleted_seed: u64,
    pub(super) datasets: Option<Vec<Spanned<String>>>,
    pub(super) methods: Option<Vec<Spanned<String>>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RocText {
    pub(super) step: Option<f64>,
    #[serde(default)]
    pub(super) seed: u64,
    pub(super) datasets: Option<Vec<Spanned<String>>>,
}

fn one() -> usize {
    1
}

/// Reads the file; keys that do not exist are refused with their line.
pub(super) fn read(path: &Path) -> Result<PlanText, Error> {
    let hint = "docs/evaluation.md describes plans, evaluation/ holds some";
    let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "opening the plan", e))?;
    if !meta.is_file() {
        return Err(Error::input(path, "this is not a regular file", hint));
    }
    if meta.len() > MAX_BYTES {
        return Err(Error::input(path, "this is larger than a plan can be (1 MiB)", hint));
    }
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "reading the plan", e))?;
    let text = String::from_utf8(bytes).map_err(|_| Error::input(path, "the plan is no UTF-8 text", hint))?;
    let plan = toml::from_str::<PlanText>(&text).map_err(|e| Error::Plan {
        path: path.to_owned(),
        line: e.span().map(|span| line_of(&text, span.start)),
        what: e.message().trim_end().replace('\n', " "),
        hint: hint.to_owned(),
    })?;
    Ok(PlanText { text, ..plan })
}

/// The line, from 1, of a byte.
pub(super) fn line_of(text: &str, at: usize) -> usize {
    1 + text.as_bytes()[..at.min(text.len())].iter().filter(|b| **b == b'\n').count()
}

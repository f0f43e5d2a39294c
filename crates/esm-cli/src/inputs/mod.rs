//! What is read: scans one after the other, from any number of inputs.

mod files;
mod frames;
mod select;
mod truth_file;

pub(crate) use files::{check_distinct, check_regular, paths, read_text};
pub(crate) use frames::Frames;
pub use select::FrameRange;
pub(crate) use select::Selection;
pub(crate) use truth_file::read_truth;

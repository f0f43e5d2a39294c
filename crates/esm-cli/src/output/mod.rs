//! Where results go: lines on stdout, files under a temporary name until they are whole.

mod file;
mod g2o;
mod lines;
mod loop_lines;
mod poses;
mod stdout;
pub(crate) mod summary;

pub(crate) use file::{Format, Target, check_target};
pub(crate) use g2o::G2o;
pub(crate) use lines::{json_line, stages_text, table_header, table_line};
pub(crate) use loop_lines::{loop_header, loop_json, loop_row};
pub(crate) use poses::PoseWriter;
pub use stdout::StdoutClosed;
pub(crate) use stdout::{Lines, data};

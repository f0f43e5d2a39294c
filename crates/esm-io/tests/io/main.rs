//! The readers and writers as a user of the crate meets them: files made byte by byte here, real recordings where they
//! are at hand, and whatever can be wrong with either.

// The lints spare test functions, not the helpers beside them.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod bytes_cdr;
mod bytes_mcap;
mod clouds_las;
mod clouds_pcd;
mod clouds_ply;
mod directories;
mod mcap_clouds;
mod mcap_damage;
mod mcap_motion;
mod mcap_topics;
mod real_recordings;
mod support;
mod trajectories;

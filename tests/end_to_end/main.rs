//! The command line from end to end: on a synthetic street that every machine can make, and on the real recordings in
//! `../shared/data` where they are.

// Failing by panic and telling by print are what tests do; clippy knows only the functions marked as tests.
#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::print_stderr)]

mod common;
mod determinism;
mod evaluate;
mod inputs;
mod kitti;
mod licences;
mod maps;
mod outputs;
mod pipeline;
mod segments;
mod service;
mod simulate;
mod words;

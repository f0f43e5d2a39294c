//! The command line from end to end: on a synthetic street that every machine can make, and on the real recordings in
//! `../shared/data` where they are.

mod common;
mod determinism;
mod inputs;
mod kitti;
mod licences;
mod maps;
mod outputs;
mod pipeline;
mod words;

//! The simulator against oracles, its own truth, and the readers of recordings.
#![allow(missing_docs, clippy::unwrap_used)] // Helpers of tests unwrap too.

mod alike;
mod casting;
mod drives;
mod movers;
mod presets;
mod recordings;
mod resuming;
mod worlds;

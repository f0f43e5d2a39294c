//! The simulator against oracles, its own truth, and the readers of recordings.
#![allow(missing_docs)]

mod casting;
mod recordings;
mod worlds;

//! Labelled segments: the training sets of the learned descriptor, and the sets it is judged by.
//!
//! A [`Surveyor`] is fed the sweeps of a recording whose poses are known, like an
//! [`Accumulator`](esm_core::Accumulator), and gives the segments of each live cloud in the map frame. [`Identities`]
//! tells which of them are one object: by the simulator's object numbers where points carry them, by the paper's rule
//! (section IV: centroids within 0.5 m are one object, beyond 4 m different, between neither) where they do not.
//! A [`SegmentSetWriter`] puts them into a directory that NumPy maps into memory (`python/train/DATA.md`).

mod error;
mod identity;
mod npy;
mod set;
mod survey;
mod votes;

pub use error::Error;
pub use esm_io::PointLabel;
pub use identity::{Identities, IdentityRule};
pub use set::{Row, SegmentSetWriter, SetInfo};
pub use survey::{Found, Surveyor};
pub use votes::UNKNOWN_CLASS;

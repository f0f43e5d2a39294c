//! The prior map: segments with their descriptors, the ground, and the path it was recorded along.
//!
//! A [`MapData`] is what a builder fills; a [`Map`] is what everything else uses, made from one in memory
//! ([`Map::from_data`]) or opened from a file ([`Map::open`]), with the same accessors. The file is described byte by
//! byte in `FORMAT.md` beside this module.

mod access;
mod atomic;
mod blocks;
mod builder;
mod check;
mod column;
mod container;
mod data;
mod layout;
mod mmap;
mod problem;
mod quantise;
mod read;
mod records;
mod standardizer;
mod write;

pub use builder::{BuildConfig, MapBuilder, coverage_cell};
pub(crate) use builder::{TILE_M, tile_of};
pub use container::Map;
pub use data::{DescriptorInfo, MapData};
pub use layout::{FORMAT_VERSION, SectionInfo};
pub use quantise::QUANTUM_M;
pub use records::{COVERAGE_CELL_M, PointRun, SegmentRecord};
pub use standardizer::Standardizer;

// The file is little-endian and its columns are used where they lie.
#[cfg(target_endian = "big")]
compile_error!("esm-core reads its maps in place and needs a little-endian machine");

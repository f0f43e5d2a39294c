//! Efficient Segment Matching: where am I in this map, from LiDAR alone, on a CPU.

pub mod accumulate;
pub mod cloud;
pub mod config;
pub mod describe;
pub mod error;
pub mod estimate;
pub mod index;
pub mod localization;
pub mod localizer;
pub mod loops;
pub mod map;
pub mod matching;
pub mod segment;
pub mod verify;

pub use accumulate::{AccumulateConfig, Accumulator, LiveCloud};
pub use cloud::{PointCloud, Pose, transform_point};
pub use config::Config;
pub use describe::{Descriptions, Descriptor};
pub use error::Error;
pub use localization::{Localization, MatchedSegment, Timings, Verdict};
pub use localizer::Localizer;
pub use loops::{LoopAnswer, LoopClosure, LoopFinder};
pub use map::{Map, MapBuilder};

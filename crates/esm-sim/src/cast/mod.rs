//! Ray casting: shapes, the ground and the BVH of a tile, and the scene of tiles around the sensor.

mod footprint;
mod ground;
mod scene;
mod shape;
mod tile;

pub(crate) use footprint::Footprint;
pub(crate) use ground::Ground;
pub use scene::Scene;
pub use shape::{Ray, Shape};
pub use tile::{Hit, TileScene};

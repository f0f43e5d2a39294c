//! Ray casting: shapes, the BVH of a tile, and the scene of tiles around the sensor.

mod scene;
mod shape;
mod tile;

pub use scene::Scene;
pub use shape::{Ray, Shape};
pub(crate) use tile::HeightGrid;
pub use tile::{Hit, TileScene};

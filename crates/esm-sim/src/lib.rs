//! Worlds with truth: procedural forests, parks, streets and places that look alike, seen by models of real LiDARs along known paths.
//!
//! [`World`] makes objects tile by tile from a seed; [`Scene`] casts rays at the tiles around a sensor; [`sweep`] makes
//! what a [`Sensor`] would measure; [`simulate`] writes whole recordings with their truth. Everything is a function of
//! seeds and places, never of the order of work: any number of threads gives the same bits.
//!
//! Metres, radians, z up; f64 poses, f32 points.

#![cfg_attr(not(test), warn(clippy::unwrap_used))]

mod cast;
mod drive;
mod error;
mod hash;
mod motion;
mod movers;
mod noise;
mod plan;
mod preset;
mod resume;
mod sensor;
mod simulate;
mod tiles;
mod world;

pub use cast::{Hit, Ray, Scene, Shape, TileScene};
pub use drive::Drive;
pub use error::Error;
pub use hash::{Draw, Key};
pub use motion::{Drift, Path, Ride, Trajectory, drifted};
pub use movers::{Mover, Movers};
pub use plan::Plan;
pub use preset::{PRESETS, Preset, Tour, preset};
pub use resume::{State, made_in, state};
pub use sensor::{Firing, Point, Scan, Sensor, SensorModel, SweepSpec, sweep, sweep_among};
pub use simulate::{Progress, Summary, check_scale, simulate};
pub use tiles::Tiles;
pub use world::{Class, Object, Season, TILE_M, Visit, World, WorldKind, tile_of};

//! LiDARs: where they look, how well they see, and the sweeps they make.

mod models;
mod sweep;

pub use models::{Firing, Scan, Sensor, SensorModel};
pub use sweep::{Point, SweepSpec, sweep, sweep_among};

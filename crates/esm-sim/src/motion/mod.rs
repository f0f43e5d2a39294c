//! How the sensor moves: paths over the ground, poses in time, and what odometry makes of them.

mod odometry;
mod path;
mod trajectory;

pub use odometry::{Drift, drifted};
pub use path::Path;
pub use trajectory::{Ride, Trajectory};

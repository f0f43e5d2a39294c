//! Named configurations that mirror the data sets of the paper, and those for learning.

use crate::error::Error;
use crate::motion::{Drift, Ride};
use crate::sensor::SensorModel;
use crate::world::{Season, Visit, WorldKind};
use nalgebra::UnitQuaternion;

/// One of the two visits of a preset.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Tour {
    /// Where on the route it starts and ends, shares of its length.
    pub part: (f64, f64),
    /// When, and what has changed.
    pub visit: Visit,
}

/// A world, a sensor, and two visits.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Preset {
    /// Its name.
    pub name: &'static str,
    /// What it mirrors.
    pub about: &'static str,
    /// The kind of world.
    pub world: WorldKind,
    /// Length of the route, metres.
    pub length_m: f64,
    /// The sensor.
    pub sensor: SensorModel,
    /// Its height above the ground, metres.
    pub sensor_height_m: f64,
    /// Its mounting on the vehicle: roll, pitch, yaw in degrees. Push-broom scanners look up with their x axis, across the
    /// way with their plane.
    pub mount_deg: [f64; 3],
    /// Mean speed, m/s.
    pub speed_mps: f64,
    /// Wheel base, metres.
    pub wheel_base_m: f64,
    /// Standard deviation of the ride's pitch and roll, degrees.
    pub shake_deg: f64,
    /// Metres between recorded sweeps; 0 records every one.
    pub spacing_m: f64,
    /// Whether points are freed of the sweep's motion, as KITTI's are.
    pub undistorted: bool,
    /// Drift of the odometry.
    pub drift: Drift,
    /// The visit the map is made from.
    pub map: Tour,
    /// The visit that is localized.
    pub live: Tour,
}

const DRIFT: Drift = Drift { translation: 0.01, rotation_deg_per_100m: 0.5 };
const ALL: (f64, f64) = (0.0, 1.0);

const fn tour(part: (f64, f64), number: u8, season: Season, change: f32) -> Tour {
    Tour { part, visit: Visit { number, season, change } }
}

/// Looks up, its plane across the way, tilted 5 degrees back: lines lie about upright.
const PUSH_BROOM: [f64; 3] = [0.0, -95.0, 0.0];

/// All presets. Seeds 0-99 are for training, 100-199 for tuning, 200 and up for judging only.
pub const PRESETS: [Preset; 6] = [
    Preset {
        name: "burgess",
        about: "Burgess Field: a 2.8 km loop in a wood, LMS151 push-broom, two weeks apart in February",
        world: WorldKind::Forest,
        length_m: 2800.0,
        sensor: SensorModel::Lms151,
        sensor_height_m: 1.2,
        mount_deg: PUSH_BROOM,
        speed_mps: 2.0,
        wheel_base_m: 1.3,
        shake_deg: 0.7,
        spacing_m: 0.0,
        undistorted: false,
        drift: DRIFT,
        map: tour(ALL, 0, Season::February, 0.02),
        live: tour(ALL, 1, Season::February, 0.02),
    },
    Preset {
        name: "cornbury",
        about: "Cornbury Park: 700 m in a wood, HDL-32E, 1,125 sweeps, summer and autumn",
        world: WorldKind::Forest,
        length_m: 700.0,
        sensor: SensorModel::Hdl32e,
        sensor_height_m: 1.4,
        mount_deg: [0.5, 2.0, 0.0],
        speed_mps: 1.4,
        wheel_base_m: 1.0,
        shake_deg: 0.8,
        spacing_m: 700.0 / 1125.0,
        undistorted: false,
        drift: DRIFT,
        map: tour(ALL, 0, Season::May, 0.04),
        live: tour(ALL, 1, Season::October, 0.04),
    },
    Preset {
        name: "george-square",
        about: "George Square: 500 m in a city park, LMS151 push-broom",
        world: WorldKind::Park,
        length_m: 500.0,
        sensor: SensorModel::Lms151,
        sensor_height_m: 1.1,
        mount_deg: PUSH_BROOM,
        speed_mps: 1.2,
        wheel_base_m: 0.8,
        shake_deg: 0.4,
        spacing_m: 0.0,
        undistorted: false,
        drift: DRIFT,
        map: tour(ALL, 0, Season::February, 0.03),
        live: tour(ALL, 1, Season::May, 0.03),
    },
    Preset {
        name: "kitti",
        about: "KITTI odometry 00: 3.7 km of streets of which the last 700 m are driven again, HDL-64E, a sweep every 2 m",
        world: WorldKind::Urban,
        length_m: 3000.0,
        sensor: SensorModel::Hdl64e,
        sensor_height_m: 1.73,
        mount_deg: [0.1, 0.3, 0.0],
        speed_mps: 8.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 2.0,
        undistorted: true,
        drift: DRIFT,
        map: tour(ALL, 0, Season::October, 0.01),
        live: tour((0.1, 0.1 + 700.0 / 3000.0), 1, Season::October, 0.01),
    },
    Preset {
        name: "train-forest",
        about: "a wood for learning: VLP-16 and two seasons",
        world: WorldKind::Forest,
        length_m: 1000.0,
        sensor: SensorModel::Vlp16,
        sensor_height_m: 1.2,
        mount_deg: [0.0, 1.0, 0.0],
        speed_mps: 1.5,
        wheel_base_m: 1.0,
        shake_deg: 0.7,
        spacing_m: 0.5,
        undistorted: false,
        drift: DRIFT,
        map: tour(ALL, 0, Season::May, 0.05),
        live: tour(ALL, 1, Season::February, 0.05),
    },
    Preset {
        name: "train-urban",
        about: "streets for learning: HDL-64E, the same way driven twice",
        world: WorldKind::Urban,
        length_m: 1500.0,
        sensor: SensorModel::Hdl64e,
        sensor_height_m: 1.73,
        mount_deg: [0.0, 0.0, 0.0],
        speed_mps: 8.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 2.0,
        undistorted: true,
        drift: DRIFT,
        map: tour(ALL, 0, Season::May, 0.05),
        live: tour(ALL, 1, Season::October, 0.05),
    },
];

/// The preset of a name.
///
/// # Errors
/// [`Error::UnknownPreset`], with the names there are.
///
/// ```
/// assert_eq!(esm_sim::preset("kitti")?.sensor, esm_sim::SensorModel::Hdl64e);
/// assert!(esm_sim::preset("mars").unwrap_err().to_string().contains("george-square"));
/// # Ok::<(), esm_sim::Error>(())
/// ```
pub fn preset(name: &str) -> Result<Preset, Error> {
    PRESETS.iter().find(|p| p.name == name).copied().ok_or_else(|| {
        let known = PRESETS.map(|p| p.name).join(", ");
        Error::UnknownPreset { name: name.to_owned(), known }
    })
}

impl Preset {
    /// Its vehicle.
    pub fn ride(&self) -> Ride {
        let [roll, pitch, yaw] = self.mount_deg.map(f64::to_radians);
        Ride {
            speed_mps: self.speed_mps,
            wheel_base_m: self.wheel_base_m,
            sensor_height_m: self.sensor_height_m,
            shake_rad: self.shake_deg.to_radians(),
            wander_m: 0.3,
            rotation_body_sensor: UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        }
    }
}

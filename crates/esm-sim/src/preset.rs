//! Named configurations that mirror the data sets of the paper, and those for learning.

use crate::error::Error;
use crate::motion::{Drift, Path, Ride};
use crate::sensor::{Sensor, SensorModel};
use crate::world::{REVISIT_SHARE, Season, Visit, World, WorldKind};
use nalgebra::UnitQuaternion;

/// One of the two visits of a preset.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Tour {
    /// Where on the way it starts and ends, shares of its length as it is driven.
    pub part: (f64, f64),
    /// When, and what has changed.
    pub visit: Visit,
    /// Whether the route is driven from its end to its start. In streets the car keeps to the right then too.
    pub reversed: bool,
    /// Metres beside the route, to the left as it is driven, as far as the ground allows.
    pub offset_m: f64,
    /// How many cars and people move about: 1 is a quiet afternoon, 0 nobody.
    pub movers: f64,
}

impl Tour {
    /// The way over the ground that is driven in a world whose route has `length_m` metres.
    ///
    /// Beside the route it keeps off what stands (solid things, hedges and bushes between knee and head) by the vehicle's half
    /// width and wandering, and in streets and car parks on the carriageway; where that leaves less than `offset_m`, it goes
    /// as near to it as it can, down to the route itself, which is free.
    ///
    /// ```
    /// use esm_sim::{Tour, World, preset};
    /// let kitti = preset("kitti")?;
    /// let world = World::new(kitti.world, 1, 400.0, kitti.live.visit);
    /// let back = Tour { reversed: true, ..kitti.live }.way(&world, 400.0);
    /// let there = Tour { reversed: false, ..kitti.live }.way(&world, 400.0);
    /// let (start, end) = (back.at(0.0), there.at(400.0));
    /// assert!((start[0] - end[0]).hypot(start[1] - end[1]) < 4.0, "it starts in the other lane of where that ends");
    /// # Ok::<(), esm_sim::Error>(())
    /// ```
    pub fn way(&self, world: &World, length_m: f64) -> Path {
        let mut way = world.route().clone();
        if self.reversed {
            way = way.part(0.0, length_m.min(way.length())).reversed();
            if let Some(oncoming_m) = world.lanes_m() {
                way = beside(&way, -oncoming_m);
            }
        }
        if self.offset_m == 0.0 { way } else { world.aside(&way, self.offset_m) }
    }
}

/// A way beside another, driveable: where bends were cut off, it is rounded.
fn beside(way: &Path, left_m: f64) -> Path {
    let way = way.offset(left_m);
    way.smoothed(0.0, way.length(), 3.0)
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
    /// Mixed into the seed: presets of one kind and seed with another salt have other worlds.
    pub world_salt: u64,
    /// Length of the route, metres.
    pub length_m: f64,
    /// The sensor.
    pub sensor: SensorModel,
    /// Its height above the ground, metres.
    pub sensor_height_m: f64,
    /// How its frame `lidar` (x forward, z up) sits on the vehicle: roll, pitch, yaw in degrees.
    pub mount_deg: [f64; 3],
    /// How the scanner is turned in that frame: roll, pitch, yaw in degrees. Push-brooms look up with their x axis, across the
    /// way with their plane.
    pub turn_deg: [f64; 3],
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
    /// Metres of travel that a live cloud holds in the data set this mirrors (`localize --accumulate`); 0 where every sweep is
    /// a cloud.
    pub accumulate_m: f64,
    /// The visit the map is made from.
    pub map: Tour,
    /// The visit that is localized.
    pub live: Tour,
}

const DRIFT: Drift = Drift::LIDAR;
const ALL: (f64, f64) = (0.0, 1.0);

const fn tour(part: (f64, f64), number: u8, season: Season, change: f32) -> Tour {
    let visit = Visit { number, season, change, changed: None };
    Tour { part, visit, reversed: false, offset_m: 0.0, movers: 1.0 }
}

/// Looks up, its plane across the way, tilted 5 degrees back: lines lie about upright.
const PUSH_BROOM: [f64; 3] = [0.0, -95.0, 0.0];

/// The worlds for learning are others than those for judging, whatever the seed.
const LEARNING: u64 = 0x6C65_6172_6E00_0000;

/// All presets. Seeds 0-99 are for training, 100-199 for tuning, 200 and up for judging only.
pub const PRESETS: [Preset; 9] = [
    Preset {
        name: "burgess",
        about: "Burgess Field: a 2.8 km loop through copses and meadows, LMS151 push-broom, two weeks apart in February",
        world: WorldKind::Copse,
        world_salt: 0,
        length_m: 2800.0,
        sensor: SensorModel::Lms151,
        sensor_height_m: 1.2,
        mount_deg: [0.4, 0.6, 0.0],
        turn_deg: PUSH_BROOM,
        speed_mps: 2.0,
        wheel_base_m: 1.3,
        shake_deg: 0.7,
        spacing_m: 0.0,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 22.0,
        map: tour(ALL, 0, Season::February, 0.02),
        live: tour(ALL, 1, Season::February, 0.02),
    },
    Preset {
        name: "cornbury",
        about: "Cornbury Park: 700 m in a wood, HDL-32E, 1,125 sweeps, summer and autumn",
        world: WorldKind::Forest,
        world_salt: 0,
        length_m: 700.0,
        sensor: SensorModel::Hdl32e,
        sensor_height_m: 1.4,
        mount_deg: [0.5, 2.0, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 1.4,
        wheel_base_m: 1.0,
        shake_deg: 0.8,
        spacing_m: 700.0 / 1125.0,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 0.0,
        map: tour(ALL, 0, Season::May, 0.04),
        live: tour(ALL, 1, Season::October, 0.04),
    },
    Preset {
        name: "george-square",
        about: "George Square: 500 m in a city park, LMS151 push-broom; 30 clouds in 500 m are swathes of 17 m",
        world: WorldKind::Park,
        world_salt: 0,
        length_m: 500.0,
        sensor: SensorModel::Lms151,
        sensor_height_m: 1.1,
        mount_deg: [0.4, 0.6, 0.0],
        turn_deg: PUSH_BROOM,
        speed_mps: 1.2,
        wheel_base_m: 0.8,
        shake_deg: 0.4,
        spacing_m: 0.0,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 17.0,
        map: tour(ALL, 0, Season::February, 0.03),
        live: tour(ALL, 1, Season::May, 0.03),
    },
    Preset {
        name: "kitti",
        about: "KITTI odometry 00: 3.7 km of streets; the last 700 m, which are localized, drive over mapped ones again, in \
                both directions; HDL-64E, a sweep every 2 m",
        world: WorldKind::Urban,
        world_salt: 0,
        length_m: 3700.0,
        sensor: SensorModel::Hdl64e,
        sensor_height_m: 1.73,
        mount_deg: [0.1, 0.3, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 8.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 2.0,
        undistorted: true,
        drift: Drift::GNSS_INS,
        accumulate_m: 20.0,
        map: tour((0.0, REVISIT_SHARE), 0, Season::October, 0.01),
        live: tour((REVISIT_SHARE, 1.0), 1, Season::October, 0.01),
    },
    Preset {
        name: "train-forest",
        about: "a wood for learning: VLP-16 and two seasons",
        world: WorldKind::Forest,
        world_salt: LEARNING,
        length_m: 1000.0,
        sensor: SensorModel::Vlp16,
        sensor_height_m: 1.2,
        mount_deg: [0.0, 1.0, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 1.5,
        wheel_base_m: 1.0,
        shake_deg: 0.7,
        spacing_m: 0.5,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 10.0,
        map: tour(ALL, 0, Season::May, 0.05),
        live: tour(ALL, 1, Season::February, 0.05),
    },
    Preset {
        name: "train-urban",
        about: "streets for learning: HDL-64E, the same way driven twice",
        world: WorldKind::Urban,
        world_salt: LEARNING,
        length_m: 1500.0,
        sensor: SensorModel::Hdl64e,
        sensor_height_m: 1.73,
        mount_deg: [0.0, 0.0, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 8.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 2.0,
        undistorted: true,
        drift: Drift::GNSS_INS,
        accumulate_m: 20.0,
        map: tour(ALL, 0, Season::May, 0.05),
        live: tour(ALL, 1, Season::October, 0.05),
    },
    Preset {
        name: "plantation",
        about: "looks alike: 900 m between rows of one poplar clone, 5 m by 4 m, and along their edge; VLP-16, spring and \
                autumn",
        world: WorldKind::Plantation,
        world_salt: 0,
        length_m: 900.0,
        sensor: SensorModel::Vlp16,
        sensor_height_m: 1.2,
        mount_deg: [0.0, 1.0, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 1.5,
        wheel_base_m: 1.0,
        shake_deg: 0.6,
        spacing_m: 0.5,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 10.0,
        map: tour(ALL, 0, Season::May, 0.01),
        live: tour(ALL, 1, Season::October, 0.01),
    },
    Preset {
        name: "car-park",
        about: "looks alike: 800 m up and down a car park, bays of 2.5 m, five models of cars, a lamp post every 20 m; \
                HDL-32E, half of the cars changed",
        world: WorldKind::CarPark,
        world_salt: 0,
        length_m: 800.0,
        sensor: SensorModel::Hdl32e,
        sensor_height_m: 1.9,
        mount_deg: [0.2, 0.4, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 4.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 1.0,
        undistorted: false,
        drift: DRIFT,
        accumulate_m: 15.0,
        map: tour(ALL, 0, Season::October, 0.06),
        live: tour(ALL, 1, Season::October, 0.06),
    },
    Preset {
        name: "terraces",
        about: "looks alike: 1.2 km of parallel streets of one terraced house, its wall, porch, bin and lamp post; HDL-64E, a \
                sweep every 2 m, half of the cars and bins moved",
        world: WorldKind::Terraces,
        world_salt: 0,
        length_m: 1200.0,
        sensor: SensorModel::Hdl64e,
        sensor_height_m: 1.73,
        mount_deg: [0.1, 0.3, 0.0],
        turn_deg: [0.0; 3],
        speed_mps: 8.0,
        wheel_base_m: 2.7,
        shake_deg: 0.35,
        spacing_m: 2.0,
        undistorted: true,
        drift: Drift::GNSS_INS,
        accumulate_m: 20.0,
        map: tour(ALL, 0, Season::May, 0.06),
        live: tour(ALL, 1, Season::October, 0.06),
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
    /// Its sensor, turned as it is mounted.
    pub fn sensor(&self) -> Sensor {
        let [roll, pitch, yaw] = self.turn_deg.map(f64::to_radians);
        self.sensor.sensor().turned(UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }

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

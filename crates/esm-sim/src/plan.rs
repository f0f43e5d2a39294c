//! One visit of a preset: what is recorded when, and where the sensor truly is.

use std::ops::Range;
use std::sync::Arc;

use esm_core::Pose;
use nalgebra::Vector3;

use crate::cast::Scene;
use crate::hash::Key;
use crate::motion::{Trajectory, drifted};
use crate::movers::Movers;
use crate::preset::{Preset, Tour};
use crate::sensor::{Point, Scan, Sensor, SweepSpec, sweep_among};
use crate::tiles::Tiles;
use crate::world::World;

/// Worlds are made for routes at least this long, metres: smaller ones would be all bends.
const LEAST_WORLD_M: f64 = 150.0;

/// A visit that is about to be recorded.
///
/// ```
/// use esm_sim::{Plan, Tiles, preset};
/// let preset = preset("train-forest")?;
/// let world = Plan::world(&preset, 1, 0.02, &preset.map);
/// let plan = Plan::new(&preset, 1, 0.02, &preset.map, &world);
/// let scene = plan.scene(&mut Tiles::new(&world), 3);
/// assert_eq!(plan.truth.len(), plan.stamps_ns.len());
/// assert!(plan.sweep(3, &scene).len() > 5000);
/// # Ok::<(), esm_sim::Error>(())
/// ```
pub struct Plan<'a> {
    /// Its sensor.
    pub sensor: Sensor,
    /// When each sweep ends, nanoseconds.
    pub stamps_ns: Vec<i64>,
    /// `pose_map_sensor` then.
    pub truth: Vec<Pose>,
    /// `pose_odom_sensor` then, as the odometry tells it.
    pub odometry: Vec<Pose>,
    /// What moves through the world.
    pub movers: Movers<'a>,
    preset: &'a Preset,
    trajectory: Arc<Trajectory<'a>>,
    key: Key,
}

impl<'a> Plan<'a> {
    /// The world at a visit, large enough for the preset's route times `scale`.
    pub fn world(preset: &Preset, seed: u64, scale: f64, tour: &Tour) -> World {
        let length_m = (preset.length_m * scale).max(LEAST_WORLD_M);
        World::new(preset.world, seed ^ preset.world_salt, length_m, tour.visit)
    }

    /// The plan of a visit to its [`world`](Self::world), with the same arguments.
    pub fn new(preset: &'a Preset, seed: u64, scale: f64, tour: &Tour, world: &'a World) -> Self {
        let length = preset.length_m * scale;
        let key = Key::new(seed).with(0x5EE9).with(tour.visit.number.into());
        let height = |x, y| world.height(x, y);
        let way = tour.way(world, length);
        let mut trajectory = Trajectory::new(way, preset.ride(), key.with(1), height);
        if tour.offset_m != 0.0 {
            trajectory = trajectory.beside(Tour { offset_m: 0.0, ..*tour }.way(world, length));
        }
        let trajectory = Arc::new(trajectory);
        // Both visits drive the same vehicle.
        let sensor = Sensor { unit: seed, ..preset.sensor() };
        // Beside it, a bent way is longer or shorter: the same stretch is driven.
        let end = trajectory.lane().map_or(length.min(trajectory.length()), |lane| {
            length.min(lane.length()) / lane.length().max(1.0) * trajectory.length()
        });
        let stamps_ns = stamps(preset, &trajectory, tour.part.0 * end, tour.part.1 * end, sensor.period_s);
        let truth: Vec<Pose> = stamps_ns.iter().map(|ns| trajectory.pose(seconds(*ns))).collect();
        let odometry = drifted(&truth, preset.drift, key.with(2));
        let end = |ns: Option<&i64>| seconds(ns.copied().unwrap_or(0));
        let span = (end(stamps_ns.first()) - sensor.period_s, end(stamps_ns.last()));
        let movers = Movers::new(world, Arc::clone(&trajectory), span, tour.movers, key.with(4));
        Self { sensor, stamps_ns, truth, odometry, movers, preset, trajectory, key }
    }

    /// The sweeps that are made together with one: as many at a time, whatever is asked for, so that what is in memory does
    /// not grow with the recording.
    pub fn batch(&self, n: usize) -> Range<usize> {
        let size = match self.sensor.scan {
            Scan::Spinning { .. } => 16,
            Scan::Line { .. } => 512,
        };
        let start = n / size * size;
        start..(start + size).min(self.stamps_ns.len())
    }

    /// What a sweep sees. It is the same for all of its batch: a sweep's bits depend on the scene's origin.
    pub fn scene(&self, tiles: &mut Tiles<'_>, n: usize) -> Scene {
        let places: Vec<Vector3<f64>> =
            self.truth[self.batch(n)].iter().map(|p| p.translation.vector).collect();
        tiles.scene(&places, f64::from(self.sensor.max_range_m))
    }

    /// The points of a sweep, in its [`scene`](Self::scene).
    pub fn sweep(&self, n: usize, scene: &Scene) -> Vec<Point> {
        let spec = SweepSpec {
            sensor: &self.sensor,
            stamp_s: seconds(self.stamps_ns[n]),
            undistorted: self.preset.undistorted,
            key: self.key.with(3).with(n as u64),
        };
        sweep_among(&spec, scene, &self.movers, |t| self.trajectory.pose(t))
    }

    /// Whether points are told in the sensor frame at the stamp, not at their own time.
    pub fn is_undistorted(&self) -> bool {
        self.preset.undistorted
    }

    /// `pose_map_sensor` at any time, seconds.
    pub fn pose(&self, seconds: f64) -> Pose {
        self.trajectory.pose(seconds)
    }

    /// Metres travelled from the first sweep to the last.
    pub fn travel_m(&self) -> f64 {
        let step = |w: &[Pose]| (w[1].translation.vector - w[0].translation.vector).norm();
        self.truth.windows(2).map(step).sum()
    }
}

/// When sweeps are recorded, nanoseconds, on whole periods of the sensor.
fn stamps(preset: &Preset, trajectory: &Trajectory<'_>, from: f64, to: f64, period: f64) -> Vec<i64> {
    let (first, last) = (
        (trajectory.time_at(from) / period).floor() as i64 + 1,
        (trajectory.time_at(to) / period).floor() as i64,
    );
    let ns = (period * 1e9).round() as i64;
    let every_one = (first..=last).map(|n| n * ns);
    if preset.spacing_m <= 0.0 {
        return every_one.collect();
    }
    let mut due = from;
    let mut out = Vec::new();
    for stamp in every_one {
        let s = trajectory.travelled(seconds(stamp));
        if s >= due {
            out.push(stamp);
            due = (due + preset.spacing_m).max(s);
        }
    }
    out
}

fn seconds(ns: i64) -> f64 {
    ns as f64 * 1e-9
}

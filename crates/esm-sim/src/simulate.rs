//! Whole recordings with their truth.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path as FilePath;
use std::sync::Arc;

use esm_core::Pose;
use esm_io::{CloudField, FieldType, RecordingLayout, RecordingWriter, StampedPose, write_file, write_tum};
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::cast::{Scene, TileScene};
use crate::error::Error;
use crate::hash::Key;
use crate::motion::{Trajectory, drifted};
use crate::movers::Movers;
use crate::preset::{Preset, Tour};
use crate::sensor::{Point, Scan, SweepSpec, sweep_among};
use crate::world::{TILE_M, World, tile_of};

/// Bytes of a point record.
const POINT_STEP: usize = 28;

/// Fields of a point record; `class` tells the kind of the object.
const FIELDS: [CloudField; 8] = {
    const fn field(name: &'static str, offset: u32, kind: FieldType) -> CloudField {
        CloudField { name, offset, kind }
    }
    [
        field("x", 0, FieldType::F32),
        field("y", 4, FieldType::F32),
        field("z", 8, FieldType::F32),
        field("intensity", 12, FieldType::F32),
        field("time", 16, FieldType::F32),
        field("object_id", 20, FieldType::U32),
        field("ring", 24, FieldType::U16),
        field("class", 26, FieldType::U8),
    ]
};

/// Worlds are made for routes at least this long, metres: smaller ones would be all bends.
const LEAST_WORLD_M: f64 = 150.0;

/// Names in the recordings.
const LAYOUT: RecordingLayout<'static> = RecordingLayout {
    cloud_topic: "/points",
    odometry_topic: "/odometry",
    sensor_frame: "lidar",
    odom_frame: "odom",
    fields: &FIELDS,
    point_step: POINT_STEP as u32,
};

/// How far a simulation has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// `map` or `live`.
    pub visit: &'static str,
    /// Sweeps written.
    pub done: usize,
    /// Sweeps of the visit.
    pub total: usize,
}

/// What was made, both visits together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Sweeps.
    pub sweeps: usize,
    /// Rays cast.
    pub rays: u64,
    /// Points that came back.
    pub points: u64,
    /// Metres travelled.
    pub travel_m: f64,
}

/// Simulates both visits of a preset into a directory: `map.mcap`, `live.mcap`, `map_truth.tum`, `live_truth.tum` and, when
/// all is done, `preset.toml`. `scale` multiplies the length of the route. `progress` hears of every batch of sweeps; where it
/// answers `false` the simulation stops. The bytes depend on preset, seed and scale alone.
///
/// Clouds (`/points`, frame `lidar`) hold x y z intensity time ring object_id and class; `/odometry` (`odom` to `lidar`)
/// drifts. Truth is `pose_map_sensor` at every sweep's stamp. Both visits share the map frame.
///
/// # Errors
/// [`Error::Scale`], [`Error::Directory`], [`Error::Output`], [`Error::Interrupted`].
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// let preset = esm_sim::preset("cornbury")?;
/// let summary = esm_sim::simulate(&preset, 1, 0.01, dir.path(), &mut |_| true)?;
/// assert!(summary.points > 0 && dir.path().join("live.mcap").exists());
/// # Ok(())
/// # }
/// ```
pub fn simulate(
    preset: &Preset,
    seed: u64,
    scale: f64,
    out_dir: &FilePath,
    progress: &mut dyn FnMut(Progress) -> bool,
) -> Result<Summary, Error> {
    if !(0.005..=4.0).contains(&scale) {
        return Err(Error::Scale { scale });
    }
    std::fs::create_dir_all(out_dir)
        .map_err(|source| Error::Directory { path: out_dir.to_owned(), source })?;
    let mut summary = Summary::default();
    for (name, tour) in [("map", &preset.map), ("live", &preset.live)] {
        visit(preset, seed, scale, name, tour, out_dir, progress, &mut summary)?;
    }
    write_file(out_dir.join("preset.toml"), describe(preset, seed, scale).as_bytes())?;
    Ok(summary)
}

/// The settings a recording was made with, as TOML.
fn describe(preset: &Preset, seed: u64, scale: f64) -> String {
    #[derive(serde::Serialize)]
    struct File<'a> {
        generator: &'a str,
        seed: u64,
        scale: f64,
        sensor_source: &'a str,
        preset: &'a Preset,
    }
    let file = File {
        generator: concat!("esm-sim ", env!("CARGO_PKG_VERSION")),
        seed,
        scale,
        sensor_source: preset.sensor.sensor().source,
        preset,
    };
    // Numbers, texts and tables of them: nothing that TOML could refuse.
    toml::to_string(&file).unwrap_or_default()
}

#[allow(clippy::too_many_arguments)] // Called once, from above.
fn visit(
    preset: &Preset,
    seed: u64,
    scale: f64,
    name: &'static str,
    tour: &Tour,
    out_dir: &FilePath,
    progress: &mut dyn FnMut(Progress) -> bool,
    summary: &mut Summary,
) -> Result<(), Error> {
    let length = preset.length_m * scale;
    let world = World::new(preset.world, seed, length.max(LEAST_WORLD_M), tour.visit);
    let key = Key::new(seed).with(0x5EE9).with(tour.visit.number.into());
    let trajectory =
        Trajectory::new(tour.way(&world, length), preset.ride(), key.with(1), |x, y| world.height(x, y));
    let sensor = preset.sensor();
    let end = length.min(trajectory.length());
    let stamps = stamps(preset, &trajectory, tour.part.0 * end, tour.part.1 * end, sensor.period_s);
    let truth: Vec<Pose> = stamps.iter().map(|ns| trajectory.pose(seconds(*ns))).collect();
    let odometry = drifted(&truth, preset.drift, key.with(2));
    let ends = (stamps.first().copied().unwrap_or(0), stamps.last().copied().unwrap_or(0));
    let span = (seconds(ends.0) - sensor.period_s, seconds(ends.1));
    let movers = Movers::new(&world, &trajectory, span, tour.movers, key.with(4));
    let path = out_dir.join(format!("{name}.mcap"));
    let mut writer = RecordingWriter::create(&path, &LAYOUT)?;
    let mut tiles = Tiles::new(&world);
    // Batches of a fixed size: what is in memory does not grow with the recording.
    let batch = match sensor.scan {
        Scan::Spinning { .. } => 16,
        Scan::Line { .. } => 512,
    };
    for start in (0..stamps.len()).step_by(batch) {
        let range = start..(start + batch).min(stamps.len());
        let places: Vec<Vector3<f64>> = truth[range.clone()].iter().map(|p| p.translation.vector).collect();
        let scene = tiles.scene(&places, f64::from(sensor.max_range_m));
        let clouds: Vec<Vec<u8>> = range
            .clone()
            .into_par_iter()
            .map(|n| {
                let spec = SweepSpec {
                    sensor: &sensor,
                    stamp_s: seconds(stamps[n]),
                    undistorted: preset.undistorted,
                    key: key.with(3).with(n as u64),
                };
                records(&sweep_among(&spec, &scene, &movers, |t| trajectory.pose(t)))
            })
            .collect();
        for (n, cloud) in range.clone().zip(&clouds) {
            writer.write_odometry(stamps[n], &odometry[n])?;
            writer.write_cloud(stamps[n], cloud)?;
            summary.points += (cloud.len() / POINT_STEP) as u64;
        }
        summary.rays += (range.len() * sensor.rays()) as u64;
        if !progress(Progress { visit: name, done: range.end, total: stamps.len() }) {
            return Err(Error::Interrupted);
        }
    }
    writer.finish()?;
    let poses = stamps.iter().zip(&truth).map(|(ns, pose)| StampedPose { stamp_ns: *ns, pose: *pose });
    write_tum(out_dir.join(format!("{name}_truth.tum")), poses)?;
    summary.sweeps += stamps.len();
    summary.travel_m +=
        truth.windows(2).map(|w| (w[1].translation.vector - w[0].translation.vector).norm()).sum::<f64>();
    Ok(())
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

/// The points as little-endian records of [`FIELDS`].
fn records(points: &[Point]) -> Vec<u8> {
    let mut out = Vec::with_capacity(points.len() * POINT_STEP);
    for p in points {
        for v in [p.xyz[0], p.xyz[1], p.xyz[2], p.intensity, p.time] {
            out.extend(v.to_le_bytes());
        }
        out.extend(p.object_id.to_le_bytes());
        out.extend(p.ring.to_le_bytes());
        out.extend([p.class as u8, 0]);
    }
    out
}

/// The tiles in use, made when they come near and forgotten behind.
pub struct Tiles<'a> {
    world: &'a World,
    made: BTreeMap<(i32, i32), Arc<TileScene>>,
}

impl<'a> Tiles<'a> {
    /// None yet.
    pub fn new(world: &'a World) -> Self {
        Self { world, made: BTreeMap::new() }
    }

    /// The scene of all tiles within `range` metres of any of some places.
    pub fn scene(&mut self, places: &[Vector3<f64>], range: f64) -> Scene {
        let mut wanted = BTreeSet::new();
        for p in places {
            let (low, high) = (tile_of(p.x - range, p.y - range), tile_of(p.x + range, p.y + range));
            for i in low.0..=high.0 {
                for j in low.1..=high.1 {
                    // Nearest point of the tile.
                    let off = |v: f64, t: i32| {
                        let a = f64::from(t) * TILE_M;
                        v - v.clamp(a, a + TILE_M)
                    };
                    if off(p.x, i).hypot(off(p.y, j)) <= range {
                        wanted.insert((i, j));
                    }
                }
            }
        }
        self.made.retain(|tile, _| wanted.contains(tile));
        let missing: Vec<(i32, i32)> =
            wanted.iter().filter(|t| !self.made.contains_key(t)).copied().collect();
        let new: Vec<TileScene> = missing.par_iter().map(|t| self.world.tile(*t)).collect();
        self.made.extend(missing.into_iter().zip(new.into_iter().map(Arc::new)));
        let origin = places.first().copied().unwrap_or_default();
        Scene::new(origin, self.made.values().cloned())
    }
}

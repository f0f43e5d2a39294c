//! Whole recordings with their truth.

use std::path::Path as FilePath;

use esm_io::{CloudField, FieldType, RecordingLayout, RecordingWriter, StampedPose, write_tum};
use rayon::prelude::*;

use crate::error::Error;
use crate::plan::Plan;
use crate::preset::Preset;
use crate::resume::{self, Record};
use crate::sensor::Point;
use crate::tiles::Tiles;

/// Bytes of a point record.
pub(crate) const POINT_STEP: usize = 28;

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
    /// Sweeps written, those kept from an interrupted run included.
    pub done: usize,
    /// Sweeps of the visit.
    pub total: usize,
}

/// What was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Summary {
    /// Sweeps.
    pub sweeps: usize,
    /// Rays cast.
    pub rays: u64,
    /// Points that came back.
    pub points: u64,
    /// Metres travelled.
    pub travel_m: f64,
    /// Of the sweeps, those that an interrupted run had made.
    #[serde(skip)]
    pub kept: usize,
    /// Sweeps of an interrupted run that were made again: this program makes other ones.
    #[serde(skip)]
    pub discarded: usize,
}

impl std::ops::AddAssign for Summary {
    fn add_assign(&mut self, other: Self) {
        self.sweeps += other.sweeps;
        self.rays += other.rays;
        self.points += other.points;
        self.travel_m += other.travel_m;
        self.kept += other.kept;
        self.discarded += other.discarded;
    }
}

/// Simulates both visits of a preset into a directory: `map.mcap`, `live.mcap`, `map_truth.tum`, `live_truth.tum` and, when
/// all is done, `preset.toml`. `scale` multiplies the length of the route. `progress` hears of every batch of sweeps; where it
/// answers `false` the simulation stops. The bytes depend on preset, seed and scale alone; other drives of the second visit are
/// presets too ([`Drive::of`](crate::Drive::of)).
///
/// A simulation that was stopped, by whatever, goes on where it was when it is called again with the same arguments: until all
/// is done, `unfinished.toml` and the part of the recording in hand (`.map.mcap.part`) lie in the directory. Other arguments
/// start afresh. What an earlier simulation has completed there is replaced; [`state`](crate::state) tells beforehand.
///
/// Clouds (`/points`, frame `lidar`) hold x y z intensity time ring object_id and class; `/odometry` (`odom` to `lidar`)
/// drifts. Truth is `pose_map_sensor` at every sweep's stamp. Both visits share the map frame.
///
/// # Errors
/// [`Error::Scale`], [`Error::Directory`], [`Error::Busy`], [`Error::Output`], [`Error::Interrupted`].
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
    check_scale(scale)?;
    let _lock = resume::lock(out_dir)?;
    let mut record = Record::take_up(preset, seed, scale, out_dir)?;
    let mut summary = Summary::default();
    for (name, tour) in [("map", &preset.map), ("live", &preset.live)] {
        if let Some(made) = record.made(name, out_dir) {
            summary += Summary { kept: made.sweeps, ..made };
            continue;
        }
        let world = Plan::world(preset, seed, scale, tour);
        let plan = Plan::new(preset, seed, scale, tour, &world);
        let mut tiles = Tiles::new(&world);
        let made = visit(&plan, name, &mut tiles, out_dir, progress)?;
        record.set_made(name, made, out_dir)?;
        summary += made;
    }
    record.complete(out_dir)?;
    Ok(summary)
}

/// Checks a scale before any work is done.
///
/// # Errors
/// [`Error::Scale`].
pub fn check_scale(scale: f64) -> Result<(), Error> {
    if (0.005..=4.0).contains(&scale) { Ok(()) } else { Err(Error::Scale { scale }) }
}

fn visit(
    plan: &Plan<'_>,
    name: &'static str,
    tiles: &mut Tiles<'_>,
    out_dir: &FilePath,
    progress: &mut dyn FnMut(Progress) -> bool,
) -> Result<Summary, Error> {
    let total = plan.stamps_ns.len();
    let mut report = |done| match progress(Progress { visit: name, done, total }) {
        true => Ok(()),
        false => Err(Error::Interrupted),
    };
    let (mut writer, mut summary) = resume::start(plan, name, tiles, out_dir, &mut report)?;
    let mut done = summary.kept;
    while done < total {
        let scene = plan.scene(tiles, done);
        let range = done..plan.batch(done).end;
        let clouds: Vec<Vec<u8>> =
            range.clone().into_par_iter().map(|n| records(&plan.sweep(n, &scene))).collect();
        for (n, cloud) in range.clone().zip(&clouds) {
            writer.write_odometry(plan.stamps_ns[n], &plan.odometry[n])?;
            writer.write_cloud(plan.stamps_ns[n], cloud)?;
            summary.points += (cloud.len() / POINT_STEP) as u64;
        }
        done = range.end;
        report(done)?;
    }
    writer.finish()?;
    let poses =
        plan.stamps_ns.iter().zip(&plan.truth).map(|(ns, pose)| StampedPose { stamp_ns: *ns, pose: *pose });
    write_tum(out_dir.join(format!("{name}_truth.tum")), poses)?;
    let rays = (total * plan.sensor.rays()) as u64;
    Ok(Summary { sweeps: total, rays, travel_m: plan.travel_m(), ..summary })
}

/// Starts a visit's recording, its unfinished part under a name that stays.
pub(crate) fn create(path: &FilePath, part: &str) -> Result<RecordingWriter, Error> {
    Ok(RecordingWriter::create_lasting(path, part, &LAYOUT)?)
}

/// The points as little-endian records of [`FIELDS`].
pub(crate) fn records(points: &[Point]) -> Vec<u8> {
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

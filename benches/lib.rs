//! What the benchmarks share: clouds to measure on, and the limits of the machine.

mod limits;
mod live;

pub use limits::{bandwidth, peak_flops};
pub use live::{SEGMENTS, above_and_ground, simulated_cloud, simulated_segments};

use std::path::{Path, PathBuf};

use esm_core::segment::{SegmentConfig, ground_flags, voxel_filter};
use esm_core::{AccumulateConfig, Accumulator, PointCloud};
use esm_io::{OpenOptions, Recording};

/// The KITTI recording, where the shared data is at hand (`ESM_SHARED_DATA`, or beside the repository).
pub fn kitti_map() -> Option<PathBuf> {
    let shared = std::env::var_os("ESM_SHARED_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from);
    Some(shared.join("kitti00/map.mcap")).filter(|path| path.is_file())
}

/// The live cloud of 20 m of travel that ends with a sweep (from 1).
///
/// # Errors
/// What reading gives, and a sweep beyond the end of the recording.
pub fn live_cloud(recording: &Path, sweep: usize) -> Result<PointCloud, Box<dyn std::error::Error>> {
    let mut accumulator = Accumulator::new(AccumulateConfig::default())?;
    for next in Recording::open(recording, &OpenOptions::default())?.sweeps()? {
        let next = next?;
        // 40 key frames of 2 m are more than 20 m of travel.
        if next.number + 40 < sweep {
            continue;
        }
        let live = accumulator.push(next.stamp, &next.cloud, next.pose_odom_sensor);
        if next.number == sweep {
            return Ok(live.ok_or("the accumulator gave no cloud")?.cloud);
        }
    }
    Err(format!("{}: there is no sweep {sweep}", recording.display()).into())
}

/// The voxelled points above the ground.
pub fn objects(cloud: &PointCloud, config: &SegmentConfig) -> Vec<[f32; 3]> {
    let points = voxel_filter(cloud.points(), config.voxel);
    let flags = ground_flags(&points, &config.ground);
    points.into_iter().zip(flags).filter(|(_, is_ground)| !is_ground).map(|(p, _)| p).collect()
}

/// A made-up street of 60 m: road, house fronts with gaps, parked cars, poles and hedges, sampled every 10 cm with
/// 2 cm of noise. About 48,000 voxels of 0.2 m, 17,000 of them above the ground.
pub fn street() -> PointCloud {
    let mut state = 1u64;
    let mut noise = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        ((state >> 40) as f32 / (1u64 << 24) as f32 - 0.5) * 0.04
    };
    let mut points = Vec::new();
    let mut sheet = |from: [f32; 3], u: [f32; 3], v: [f32; 3]| {
        let steps = |e: [f32; 3]| (e.iter().map(|c| c * c).sum::<f32>().sqrt() / 0.1).ceil() as usize;
        let (nu, nv) = (steps(u), steps(v));
        for i in 0..nu {
            for j in 0..nv {
                let (s, t) = (i as f32 / nu as f32, j as f32 / nv as f32);
                points.push(std::array::from_fn(|a| from[a] + s * u[a] + t * v[a] + noise()));
            }
        }
    };
    // Sheets lie in the middle of voxels of 0.2 m, so that noise does not double them.
    sheet([-30.0, -9.9, 0.1], [60.0, 0.0, 0.0], [0.0, 19.8, 0.0]);
    for house in 0..6 {
        let x = -29.9 + 10.0 * house as f32;
        for y in [-9.9, 9.9] {
            sheet([x, y, 0.1], [8.0, 0.0, 0.0], [0.0, 0.0, 4.0]);
            sheet([x + 8.0, y, 0.1], [0.0, y * 0.3, 0.0], [0.0, 0.0, 4.0]);
        }
    }
    for car in 0..9 {
        let (x, y) = (-28.1 + 6.4 * car as f32, if car % 3 == 0 { 4.1 } else { -6.1 });
        sheet([x, y, 0.3], [4.4, 0.0, 0.0], [0.0, 0.0, 1.2]);
        sheet([x, y, 0.3], [0.0, 1.8, 0.0], [0.0, 0.0, 1.2]);
        sheet([x, y, 1.5], [4.4, 0.0, 0.0], [0.0, 1.8, 0.0]);
    }
    for pole in 0..7 {
        let x = -26.1 + 8.0 * pole as f32;
        sheet([x, 7.5, 0.1], [0.2, 0.0, 0.0], [0.0, 0.0, 5.0]);
        sheet([x + 3.0, -8.0, 0.1], [2.0, 0.6, 0.0], [0.0, 0.0, 0.9]);
    }
    PointCloud::from_finite(points).0
}

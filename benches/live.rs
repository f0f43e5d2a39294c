//! A simulated live cloud and its segments, the same ones every time.

use esm_core::segment::{Segment, SegmentConfig, ground_flags, voxel_filter};
use esm_core::{PointCloud, segment, transform_point};
use esm_sim::{Key, SweepSpec, Tiles, Trajectory, World, preset, sweep};

/// Segments of a live cloud in the paper's timing case.
pub const SEGMENTS: usize = 46;

/// Forty metres of travel through a street of the preset `kitti`, in the frame of the last sweep.
///
/// # Errors
/// Where the preset is not there.
pub fn simulated_cloud() -> Result<PointCloud, Box<dyn std::error::Error>> {
    const SEED: u64 = 7;
    let preset = preset("kitti")?;
    let sensor = preset.sensor.sensor();
    let world = World::new(preset.world, SEED, 400.0, preset.map.visit);
    let trajectory =
        Trajectory::new(world.route().clone(), preset.ride(), Key::new(SEED), |x, y| world.height(x, y));
    let mut tiles = Tiles::new(&world);
    let (mut points, mut travel, mut stamp_s) = (Vec::new(), 0.0, 6.0);
    let mut pose_world_sensor = trajectory.pose(stamp_s);
    while travel < 40.0 && stamp_s < 60.0 {
        let place = pose_world_sensor.translation.vector;
        let scene = tiles.scene(&[place], f64::from(sensor.max_range_m));
        let spec = SweepSpec { sensor: &sensor, stamp_s, undistorted: true, key: Key::new(SEED) };
        let cloud = sweep(&spec, &scene, |t| trajectory.pose(t));
        points.extend(cloud.iter().map(|p| transform_point(&pose_world_sensor, p.xyz)));
        stamp_s += 0.2;
        pose_world_sensor = trajectory.pose(stamp_s);
        travel += (pose_world_sensor.translation.vector - place).norm();
    }
    let pose_sensor_world = pose_world_sensor.inverse();
    let points = points.into_iter().map(|p| transform_point(&pose_sensor_world, p)).collect();
    Ok(PointCloud::from_finite(points).0)
}

/// [`SEGMENTS`] of the cloud's segments, spread over all of them.
///
/// # Errors
/// Where there are fewer.
pub fn simulated_segments(cloud: &PointCloud) -> Result<Vec<Segment>, Box<dyn std::error::Error>> {
    let all = segment::segment(cloud, &SegmentConfig::default()).segments;
    if all.len() < SEGMENTS {
        return Err(format!("only {} segments", all.len()).into());
    }
    Ok((0..SEGMENTS).map(|n| all[n * all.len() / SEGMENTS].clone()).collect())
}

/// The voxelled points of a cloud above the ground, and those on it.
pub fn above_and_ground(cloud: &PointCloud, config: &SegmentConfig) -> [Vec<[f32; 3]>; 2] {
    let points = voxel_filter(cloud.points(), config.voxel);
    let flags = ground_flags(&points, &config.ground);
    let of = |ground: bool| {
        points.iter().zip(&flags).filter(|(_, flag)| **flag == ground).map(|(p, _)| *p).collect()
    };
    [of(false), of(true)]
}

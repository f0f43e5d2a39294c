//! From single sweeps and their motion to live clouds: the last metres of travel in the newest sensor frame.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::cloud::{PointCloud, Pose, transform_point};
use crate::error::{Error, require};
use crate::segment::voxel_filter;

/// How sweeps become live clouds.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct AccumulateConfig {
    /// Metres of travel a live cloud holds; 0 makes every sweep a cloud of its own. (The paper's push-broom clouds
    /// hold 22 m.)
    pub distance_m: f64,
    /// Non-overlapping clouds, one every `distance_m`, instead of one for every sweep.
    pub swathes: bool,
    /// Points farther than this from the sensor are dropped, metres.
    pub max_range_m: f64,
    /// Points nearer than this to the sensor are dropped: they lie on the robot itself, metres.
    pub min_range_m: f64,
    /// Each sweep is thinned to one point a voxel of this edge before it is kept, metres; 0 keeps all.
    pub sweep_voxel_m: f64,
    /// A sweep is kept for later clouds only this far after the last kept one, metres: standing still adds nothing. Sweeps
    /// of fewer than 4,000 points (after thinning) are kept proportionally closer: the lines of a push-broom scanner
    /// make a cloud only together.
    pub min_step_m: f64,
    /// A longer step between two sweeps breaks the accumulation (a gap in the recording or a jump of the odometry),
    /// metres.
    pub max_step_m: f64,
}

impl Default for AccumulateConfig {
    fn default() -> Self {
        Self {
            distance_m: 20.0,
            swathes: false,
            max_range_m: 50.0,
            min_range_m: 1.0,
            sweep_voxel_m: 0.1,
            min_step_m: 0.5,
            max_step_m: 10.0,
        }
    }
}

impl AccumulateConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require(
            !self.swathes || self.distance_m > 0.0,
            "accumulate.swathes",
            self.swathes,
            "only with a distance_m above 0",
        )?;
        require(
            (0.0..=1000.0).contains(&self.distance_m),
            "accumulate.distance_m",
            self.distance_m,
            "0 to 1000 m",
        )?;
        require(
            self.max_range_m > 0.0 && self.max_range_m <= 1000.0,
            "accumulate.max_range_m",
            self.max_range_m,
            "more than 0, up to 1000 m",
        )?;
        require(
            self.min_range_m >= 0.0 && self.min_range_m < self.max_range_m,
            "accumulate.min_range_m",
            self.min_range_m,
            "0 m up to accumulate.max_range_m",
        )?;
        require(
            (0.0..=5.0).contains(&self.sweep_voxel_m),
            "accumulate.sweep_voxel_m",
            self.sweep_voxel_m,
            "0 to 5 m",
        )?;
        require(
            (0.0..=10.0).contains(&self.min_step_m),
            "accumulate.min_step_m",
            self.min_step_m,
            "0 to 10 m",
        )?;
        require(
            self.max_step_m > self.min_step_m,
            "accumulate.max_step_m",
            self.max_step_m,
            "more than min_step_m",
        )
    }
}

/// A cloud ready to be localized.
#[derive(Clone, Debug)]
pub struct LiveCloud {
    /// Seconds, of the newest sweep.
    pub stamp: f64,
    /// Points in the newest sensor frame, metres.
    pub cloud: PointCloud,
    /// Pose of the newest sensor in the odometry frame, where the motion is known.
    pub pose_odom_sensor: Option<Pose>,
    /// Metres of travel the cloud was meant to hold.
    pub distance_m: f64,
    /// Metres of travel the cloud really holds.
    pub travel_m: f64,
    /// Sweeps in the cloud.
    pub sweeps: usize,
    /// Where each sweep was seen from, in the order of the cloud's points, the newest last; empty where that is not known.
    pub viewpoints: Vec<Viewpoint>,
    /// Time it took to put together.
    pub elapsed: Duration,
}

/// Where some points of a live cloud were seen from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The sensor then, in the newest sensor frame, metres.
    pub origin_sensor: [f32; 3],
    /// How many points, after those of the viewpoints before.
    pub points: usize,
}

impl LiveCloud {
    /// Where the cloud was seen from on average, in the newest sensor frame, metres; `None` where that is not known.
    pub fn middle_sensor(&self) -> Option<Vector3<f64>> {
        let points: usize = self.viewpoints.iter().map(|v| v.points).sum();
        let sum: Vector3<f64> =
            self.viewpoints.iter().map(|v| Vector3::from(v.origin_sensor).cast() * v.points as f64).sum();
        (points > 0).then(|| sum / points as f64)
    }
}

struct Kept {
    points_sensor: Vec<[f32; 3]>,
    pose_odom_sensor: Pose,
    travel_m: f64,
}

/// Sweeps a cloud may hold, and their points: turning on the spot must not grow it without end.
const MAX_SWEEPS: usize = 4096;
const MAX_POINTS: usize = 5_000_000;
/// Points of a sweep that sees its surroundings well enough to be kept every `min_step_m` only.
const FULL_SWEEP: f64 = 4000.0;
/// A turn of this many radians since the last kept sweep is also worth keeping: it brings another view.
const MIN_TURN_RAD: f64 = 0.35;

/// Feeds on sweeps, one after the other, and gives live clouds. Memory is bounded by the distance, not by the length
/// of the recording.
///
/// ```
/// use esm_core::{Accumulator, AccumulateConfig, PointCloud, Pose};
///
/// let mut accumulator = Accumulator::new(AccumulateConfig { distance_m: 4.0, ..Default::default() })?;
/// for step in 0..6 {
///     let sweep = PointCloud::try_new(vec![[5.0, 1.0, 0.0]])?;
///     let pose_odom_sensor = Pose::translation(step as f64, 0.0, 0.0);
///     let live = accumulator.push(step as f64, &sweep, Some(pose_odom_sensor)).expect("a cloud for every sweep");
///     assert_eq!(live.sweeps, 5.min(step + 1));
/// }
/// # Ok::<(), esm_core::Error>(())
/// ```
pub struct Accumulator {
    config: AccumulateConfig,
    kept: VecDeque<Kept>,
}

impl Accumulator {
    /// An empty accumulator.
    ///
    /// # Errors
    /// [`Error::Config`] where the configuration is out of range.
    pub fn new(config: AccumulateConfig) -> Result<Self, Error> {
        config.check()?;
        Ok(Self { config, kept: VecDeque::new() })
    }

    /// Forgets all sweeps: after a gap, or when the sensor was carried elsewhere.
    pub fn clear(&mut self) {
        self.kept.clear();
    }

    /// Takes the next sweep (points in the sensor frame) and gives the live cloud that ends with it; with `swathes`
    /// only once every `distance_m`.
    ///
    /// A sweep without a pose is a cloud of its own and is not kept.
    pub fn push(
        &mut self,
        stamp: f64,
        sweep: &PointCloud,
        pose_odom_sensor: Option<Pose>,
    ) -> Option<LiveCloud> {
        let started = Instant::now();
        let points_sensor = self.thin(sweep);
        let Some(pose) = pose_odom_sensor else {
            return Some(LiveCloud {
                stamp,
                viewpoints: vec![Viewpoint { origin_sensor: [0.0; 3], points: points_sensor.len() }],
                cloud: PointCloud::from_finite(points_sensor).0,
                pose_odom_sensor: None,
                distance_m: 0.0,
                travel_m: 0.0,
                sweeps: 1,
                elapsed: started.elapsed(),
            });
        };
        let step = self.kept.back().map(|last| last.pose_odom_sensor.inv_mul(&pose));
        let step_m = step.map_or(0.0, |s| s.translation.vector.norm());
        if step_m > self.config.max_step_m {
            self.kept.clear();
        }
        let travel_m = self.kept.back().map_or(0.0, |last| last.travel_m + step_m);
        // Only as many old sweeps as are needed to hold the distance.
        while self.kept.get(1).map_or(travel_m, |second| second.travel_m) <= travel_m - self.config.distance_m
            && !self.kept.is_empty()
        {
            self.kept.pop_front();
        }
        let share = (points_sensor.len() as f64 / FULL_SWEEP).min(1.0);
        let newest = Kept { points_sensor, pose_odom_sensor: pose, travel_m };
        let held_m = travel_m - self.kept.front().map_or(travel_m, |first| first.travel_m);
        let turned = step.is_some_and(|s| s.rotation.angle() > MIN_TURN_RAD);
        let keep = self.kept.is_empty() || step_m >= share * self.config.min_step_m || turned;

        let due = !self.config.swathes || held_m >= self.config.distance_m;
        let live = due.then(|| {
            let (mut points, mut viewpoints) = (Vec::new(), Vec::with_capacity(self.kept.len() + 1));
            for old in &self.kept {
                let pose_sensor_old = pose.inv_mul(&old.pose_odom_sensor);
                points.extend(old.points_sensor.iter().map(|p| transform_point(&pose_sensor_old, *p)));
                let origin_sensor = pose_sensor_old.translation.vector.map(|v| v as f32).into();
                viewpoints.push(Viewpoint { origin_sensor, points: old.points_sensor.len() });
            }
            points.extend_from_slice(&newest.points_sensor);
            viewpoints.push(Viewpoint { origin_sensor: [0.0; 3], points: newest.points_sensor.len() });
            let (cloud, dropped) = PointCloud::from_finite(points);
            if dropped > 0 {
                // Poses beyond the range of f32: which point is whose is lost.
                viewpoints.clear();
            }
            LiveCloud {
                stamp,
                cloud,
                viewpoints,
                pose_odom_sensor: Some(pose),
                distance_m: self.config.distance_m,
                travel_m: held_m,
                sweeps: self.kept.len() + 1,
                elapsed: started.elapsed(),
            }
        });
        if due && self.config.swathes {
            self.kept.clear();
        }
        if keep || self.kept.is_empty() {
            self.kept.push_back(newest);
            let mut points: usize = self.kept.iter().map(|k| k.points_sensor.len()).sum();
            while self.kept.len() > MAX_SWEEPS || (points > MAX_POINTS && self.kept.len() > 1) {
                points -= self.kept.pop_front().map_or(0, |k| k.points_sensor.len());
            }
        }
        live
    }

    fn thin(&self, sweep: &PointCloud) -> Vec<[f32; 3]> {
        let range = (self.config.min_range_m.powi(2) as f32)..=(self.config.max_range_m.powi(2) as f32);
        let in_range: Vec<[f32; 3]> = sweep
            .points()
            .iter()
            .filter(|p| range.contains(&(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])))
            .copied()
            .collect();
        if self.config.sweep_voxel_m > 0.0 {
            voxel_filter(&in_range, self.config.sweep_voxel_m as f32)
        } else {
            in_range
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(distance_m: f64) -> AccumulateConfig {
        AccumulateConfig { distance_m, sweep_voxel_m: 0.0, ..Default::default() }
    }

    fn sweep_of(x_sensor: f32) -> PointCloud {
        PointCloud::try_new(vec![[x_sensor, 2.0, 0.5]]).unwrap()
    }

    fn drive(config: AccumulateConfig, steps: usize, step_m: f64) -> Vec<LiveCloud> {
        let mut accumulator = Accumulator::new(config).unwrap();
        (0..steps)
            .filter_map(|i| {
                accumulator.push(
                    i as f64,
                    &sweep_of(3.0),
                    Some(Pose::translation(i as f64 * step_m, 0.0, 0.0)),
                )
            })
            .collect()
    }

    #[test]
    fn every_sweep_gives_a_cloud_that_holds_the_distance_once_travelled() {
        let clouds = drive(config(20.0), 40, 1.9);
        assert_eq!(clouds.len(), 40);
        for (i, cloud) in clouds.iter().enumerate() {
            let want = (i as f64 * 1.9).min(11.0 * 1.9);
            assert!((cloud.travel_m - want).abs() < 1e-9, "cloud {i} holds {}", cloud.travel_m);
        }
    }

    #[test]
    fn points_are_in_the_newest_frame() {
        let clouds = drive(config(4.0), 3, 1.0);
        let origins: Vec<f32> = clouds[2].viewpoints.iter().map(|v| v.origin_sensor[0]).collect();
        assert_eq!(origins, [-2.0, -1.0, 0.0], "and so is where each was seen from");
        assert_eq!(clouds[2].middle_sensor(), Some(Vector3::new(-1.0, 0.0, 0.0)));
        let mut xs: Vec<f32> = clouds[2].cloud.points().iter().map(|p| p[0]).collect();
        xs.sort_by(f32::total_cmp);
        assert_eq!(xs, [1.0, 2.0, 3.0]);
    }

    #[test]
    fn distance_zero_gives_single_sweeps() {
        assert!(drive(config(0.0), 5, 1.0).iter().all(|c| c.sweeps == 1 && c.travel_m == 0.0));
    }

    #[test]
    fn swathes_do_not_overlap() {
        let clouds = drive(AccumulateConfig { swathes: true, ..config(4.0) }, 21, 1.0);
        let stamps: Vec<f64> = clouds.iter().map(|c| c.stamp).collect();
        assert_eq!(stamps, [4.0, 8.0, 12.0, 16.0, 20.0]);
    }

    #[test]
    fn standing_still_adds_nothing() {
        let clouds = drive(config(20.0), 1000, 0.0);
        assert!(clouds.iter().all(|c| c.sweeps <= 2));
    }

    /// A push-broom scanner's lines, 4 cm apart, all count; a scanner that sees all around is kept every half metre.
    #[test]
    fn sparse_sweeps_are_kept_closer() {
        let sweep =
            |n: usize| PointCloud::try_new((0..n).map(|i| [3.0 + i as f32 * 1e-3, 2.0, 0.5]).collect());
        for (points, want) in [(300, 501), (1200, 126), (4000, 41), (9000, 41)] {
            let mut accumulator = Accumulator::new(config(20.0)).unwrap();
            let cloud = sweep(points).unwrap();
            let poses = (0..=500).map(|i| Pose::translation(f64::from(i) * 0.04, 0.0, 0.0));
            let last = poses.filter_map(|pose| accumulator.push(0.0, &cloud, Some(pose))).last().unwrap();
            assert!(last.sweeps.abs_diff(want) <= 3, "{points} points: {} sweeps", last.sweeps);
        }
    }

    #[test]
    fn turning_on_the_spot_does_not_grow_without_end() {
        // Swathes that never come due: what is kept is looked at, no cloud is made.
        let mut accumulator = Accumulator::new(AccumulateConfig { swathes: true, ..config(20.0) }).unwrap();
        let cloud = PointCloud::try_new(vec![[3.0, 2.0, 0.5]; 100_000]).unwrap();
        for i in 0..120 {
            let turn = Pose::rotation(nalgebra::Vector3::z() * f64::from(i) * 0.5);
            assert!(accumulator.push(f64::from(i), &cloud, Some(turn)).is_none());
        }
        assert_eq!(accumulator.kept.len(), MAX_POINTS / cloud.len());
    }

    #[test]
    fn a_jump_starts_anew() {
        let mut accumulator = Accumulator::new(config(20.0)).unwrap();
        accumulator.push(0.0, &sweep_of(3.0), Some(Pose::identity()));
        let live = accumulator.push(1.0, &sweep_of(3.0), Some(Pose::translation(300.0, 0.0, 0.0))).unwrap();
        assert_eq!((live.sweeps, live.travel_m), (1, 0.0));
    }

    #[test]
    fn without_motion_every_sweep_stands_alone() {
        let mut accumulator = Accumulator::new(config(20.0)).unwrap();
        for i in 0..3 {
            assert_eq!(accumulator.push(i as f64, &sweep_of(3.0), None).unwrap().sweeps, 1);
        }
    }

    #[test]
    fn range_is_limited_at_both_ends() {
        let mut accumulator = Accumulator::new(config(0.0)).unwrap();
        let sweep = PointCloud::try_new(vec![[0.5, 0.0, 0.0], [10.0, 0.0, 0.0], [60.0, 0.0, 0.0]]).unwrap();
        assert_eq!(accumulator.push(0.0, &sweep, None).unwrap().cloud.points(), [[10.0, 0.0, 0.0]]);
    }
}

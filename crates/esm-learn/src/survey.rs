//! [`Surveyor`]: segments of live clouds in the map frame, with the objects they show.

use std::collections::VecDeque;

use esm_core::segment::{Context, SegmentConfig, segment};
use esm_core::{AccumulateConfig, Accumulator, PointCloud, Pose, transform_point};
use esm_io::PointLabel;
use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashSet;

use crate::error::Error;
use crate::votes::Votes;

/// Sweeps nearer than this to the one before add no labels that are not there, metres; sweeps of few points proportionally
/// nearer ones, as the accumulator keeps them: each line of a push-broom scanner sees what no other does.
const LEAST_STEP_M: f64 = 0.25;
const FULL_SWEEP: f64 = 4000.0;

/// Of a sweep's points each object keeps one a voxel of this edge, metres.
const LABEL_VOXEL_M: f32 = 0.1;

/// A segment of a live cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Metres about `centroid_map`, axes of the map frame.
    pub points: Vec<[f32; 3]>,
    /// Mean of the points, map frame, metres.
    pub centroid_map: [f64; 3],
    /// The object that a clear majority of its points lies on; `None` where there is none or points carry no labels.
    pub label: Option<PointLabel>,
    /// What stands around it in its cloud.
    pub context: Context,
}

/// Labels of a sweep, thinned.
struct Labelled {
    points: Vec<([f32; 3], PointLabel)>,
    pose_odom_sensor: Pose,
    travel_m: f64,
}

/// Feeds on the sweeps of one recording; gives the segments of a live cloud every `step_m` of travel.
pub struct Surveyor {
    accumulator: Accumulator,
    distance_m: f64,
    max_range_m: f64,
    segments: SegmentConfig,
    step_m: f64,
    labelled: VecDeque<Labelled>,
    travel_m: f64,
    last_pose: Option<Pose>,
    next_m: f64,
}

impl Surveyor {
    /// Live clouds as `accumulate` says, cut as `segments` says; clouds that hold less than 95 % of the asked travel are
    /// left out.
    ///
    /// # Errors
    /// [`Error::Core`] and [`Error::Setting`] where the configuration is out of range.
    pub fn new(accumulate: &AccumulateConfig, segments: &SegmentConfig, step_m: f64) -> Result<Self, Error> {
        segments.check()?;
        if !(0.0..=10_000.0).contains(&step_m) {
            return Err(Error::Setting { name: "step", value: step_m, allowed: "0 to 10000 m" });
        }
        Ok(Self {
            accumulator: Accumulator::new(accumulate.clone())?,
            distance_m: accumulate.distance_m,
            max_range_m: accumulate.max_range_m,
            segments: segments.clone(),
            step_m,
            labelled: VecDeque::new(),
            travel_m: 0.0,
            last_pose: None,
            next_m: 0.0,
        })
    }

    /// Takes the next sweep: its points in the sensor frame, their labels (as many, or none), its odometry, and the truth.
    /// Returns the segments of the live cloud that ends here, where one is due.
    pub fn push(
        &mut self,
        stamp: f64,
        sweep: &PointCloud,
        labels: &[PointLabel],
        pose_odom_sensor: Pose,
        pose_map_sensor: Option<Pose>,
    ) -> Option<Vec<Found>> {
        let step = self.last_pose.map_or(0.0, |p| p.inv_mul(&pose_odom_sensor).translation.vector.norm());
        self.travel_m += step;
        self.last_pose = Some(pose_odom_sensor);
        self.keep_labels(sweep, labels, pose_odom_sensor);
        let live = self.accumulator.push(stamp, sweep, Some(pose_odom_sensor))?;
        if live.travel_m < 0.95 * self.distance_m || self.travel_m < self.next_m {
            return None;
        }
        let pose_map_sensor = pose_map_sensor?;
        self.next_m = self.travel_m + self.step_m;
        let segmentation = segment(&live.cloud, &self.segments);
        let votes = self.votes(&pose_odom_sensor);
        let found = segmentation.segments.iter().map(|segment| {
            let sum =
                segment.points.iter().fold(Vector3::zeros(), |sum, p| sum + Vector3::from(*p).cast::<f64>());
            let centroid_sensor = sum / segment.points.len() as f64;
            let turned = pose_map_sensor.rotation;
            let about = |p: &[f32; 3]| turned * (Vector3::from(*p).cast::<f64>() - centroid_sensor);
            Found {
                points: segment.points.iter().map(|p| about(p).cast::<f32>().into()).collect(),
                centroid_map: (pose_map_sensor * Point3::from(centroid_sensor)).coords.into(),
                label: votes.of_segment(&segment.points),
                context: segment.context,
            }
        });
        Some(found.collect())
    }

    /// Keeps one label a voxel of each sweep, as long as the accumulator may keep its points.
    fn keep_labels(&mut self, sweep: &PointCloud, labels: &[PointLabel], pose_odom_sensor: Pose) {
        if labels.len() != sweep.len() || labels.is_empty() {
            return;
        }
        let apart = self.labelled.back().map_or(f64::INFINITY, |l| self.travel_m - l.travel_m);
        let least = LEAST_STEP_M * (sweep.len() as f64 / FULL_SWEEP).min(1.0);
        if apart < least && self.distance_m > 0.0 {
            return;
        }
        let range = self.max_range_m as f32;
        let mut seen: FxHashSet<([i32; 3], u32)> = FxHashSet::default();
        let mut points = Vec::new();
        for (p, label) in sweep.points().iter().zip(labels) {
            let near = p.iter().map(|v| v * v).sum::<f32>() <= range * range;
            let cell = p.map(|v| (v / LABEL_VOXEL_M).floor() as i32);
            if near && seen.insert((cell, label.object)) {
                points.push((*p, *label));
            }
        }
        self.labelled.push_back(Labelled { points, pose_odom_sensor, travel_m: self.travel_m });
        while self.labelled.front().is_some_and(|l| l.travel_m < self.travel_m - self.distance_m - 5.0)
            || (self.distance_m == 0.0 && self.labelled.len() > 1)
        {
            self.labelled.pop_front();
        }
    }

    /// The labels around, in the newest sensor frame.
    fn votes(&self, pose_odom_sensor: &Pose) -> Votes {
        let mut votes = Votes::new(self.segments.voxel);
        for old in &self.labelled {
            let pose_sensor_old = pose_odom_sensor.inv_mul(&old.pose_odom_sensor);
            for (p, label) in &old.points {
                votes.add(transform_point(&pose_sensor_old, *p), *label);
            }
        }
        votes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLOOR: PointLabel = PointLabel { object: 0, class: 0 };

    /// A floor and two posts of 0.8 x 0.8 x 2 m at (8, 3) and (14, -3), as a sensor 1.5 m up at `x` sees them.
    fn sweep(x: f32) -> (PointCloud, Vec<PointLabel>) {
        let (mut points, mut labels) = (Vec::new(), Vec::new());
        for i in 0..10_000 {
            points.push([(i % 100) as f32 * 0.3 - 5.0 - x, (i / 100) as f32 * 0.3 - 15.0, -1.5]);
            labels.push(FLOOR);
        }
        for (object, px, py) in [(1, 8.0, 3.0), (2, 14.0, -3.0)] {
            for i in 0..9 * 9 * 20 {
                let (a, b, c) = (i % 9, i / 9 % 9, i / 81);
                let p = [px + a as f32 * 0.1, py + b as f32 * 0.1, c as f32 * 0.1];
                points.push([p[0] - x, p[1], p[2] - 1.5]);
                labels.push(PointLabel { object, class: 4 });
            }
        }
        (PointCloud::try_new(points).unwrap(), labels)
    }

    #[test]
    fn posts_are_found_where_they_stand_and_named() {
        let accumulate = AccumulateConfig { distance_m: 4.0, ..AccumulateConfig::default() };
        let mut surveyor = Surveyor::new(&accumulate, &SegmentConfig::default(), 3.0).unwrap();
        // The map frame: turned by a quarter, 100 m away.
        let pose_map_odom =
            Pose::new(Vector3::new(100.0, 50.0, 7.0), Vector3::z() * std::f64::consts::FRAC_PI_2);
        let mut clouds = 0;
        for n in 0..11 {
            let pose = Pose::translation(f64::from(n), 0.0, 0.0);
            let (cloud, labels) = sweep(n as f32);
            let truth = pose_map_odom * pose;
            let Some(found) = surveyor.push(f64::from(n), &cloud, &labels, pose, Some(truth)) else {
                continue;
            };
            clouds += 1;
            assert_eq!(found.len(), 2, "cloud {n}");
            for f in &found {
                let label = f.label.expect("one object");
                let at = if label.object == 1 { [8.4, 3.4] } else { [14.4, -2.6] };
                let want = pose_map_odom * Point3::new(at[0], at[1], -0.5);
                let off = (Point3::from(f.centroid_map) - want).norm();
                assert!(off < 0.3, "cloud {n}: {off} m off");
                assert_eq!(label.class, 4);
                assert!(f.context.above_ground.is_some_and(|h| (0.0..0.5).contains(&h)), "{:?}", f.context);
                let mean = f.points.iter().fold(Vector3::zeros(), |s, p| s + Vector3::from(*p))
                    / f.points.len() as f32;
                assert!(mean.norm() < 1e-3);
            }
        }
        assert_eq!(clouds, 3, "at 4, 7 and 10 m of travel");
    }

    /// The same posts as a scanner sees them whose lines lie across the way, 4 cm apart.
    #[test]
    fn lines_across_the_way_have_labels_too() {
        let accumulate = AccumulateConfig { distance_m: 10.0, ..AccumulateConfig::default() };
        // Voxels as fine as the posts' points: every line that is left out would be missed.
        let segments = SegmentConfig { voxel: 0.1, ..SegmentConfig::default() };
        let mut surveyor = Surveyor::new(&accumulate, &segments, 10.0).unwrap();
        let (scene, labels) = sweep(0.0);
        let mut found = None;
        for n in 0..500 {
            let x = 0.04 * n as f32 + 5.0;
            let seen =
                scene.points().iter().zip(&labels).filter(|(p, _)| (x - 0.02..x + 0.02).contains(&p[0]));
            let (points, labels): (Vec<_>, Vec<_>) = seen.map(|(p, l)| ([p[0] - x, p[1], p[2]], *l)).unzip();
            let pose = Pose::translation(f64::from(x), 0.0, 0.0);
            let cloud = PointCloud::try_new(points).unwrap();
            found = found.or(surveyor.push(f64::from(n), &cloud, &labels, pose, Some(pose)));
        }
        let found = found.expect("a cloud of 10 m");
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|f| f.label.is_some()));
    }

    #[test]
    fn without_truth_or_labels_nothing_is_made_up() {
        let accumulate = AccumulateConfig { distance_m: 0.0, ..AccumulateConfig::default() };
        let mut surveyor = Surveyor::new(&accumulate, &SegmentConfig::default(), 0.0).unwrap();
        let (cloud, _) = sweep(0.0);
        assert!(surveyor.push(0.0, &cloud, &[], Pose::identity(), None).is_none());
        let found = surveyor.push(1.0, &cloud, &[], Pose::identity(), Some(Pose::identity())).unwrap();
        assert!(found.iter().all(|f| f.label.is_none()) && found.len() == 2);
    }
}

//! Segments of live clouds along a recording, and what re-appears of them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use esm_core::segment::{Segment, SegmentConfig, segment};
use esm_core::{AccumulateConfig, Accumulator, PointCloud, Pose, transform_point};
use esm_io::{OpenOptions, Recording, read_tum};

use crate::figures::{Side, nearest, roughness, spread};

/// Travel from one live cloud to the next, metres.
const STEP_M: f64 = 5.0;
/// Every so many sweeps one is kept for the figures of sweeps.
const KEEP_EVERY: usize = 4;

/// One recording; its truth where the odometry is not in the map's frame.
pub(crate) struct Visit {
    pub(crate) recording: PathBuf,
    pub(crate) truth: Option<PathBuf>,
}

/// Two visits and what their sweeps go through first.
pub(crate) struct Drive {
    pub(crate) map: Visit,
    pub(crate) live: Visit,
    pub(crate) filter: fn(&PointCloud) -> PointCloud,
}

/// What was cut from a visit.
#[derive(Default)]
pub(crate) struct Cut {
    pub(crate) sweeps: Vec<PointCloud>,
    /// Segments of each live cloud, sensor frame of its newest sweep.
    pub(crate) clouds: Vec<Vec<Segment>>,
    /// Their centroids in the map's frame.
    pub(crate) places: Vec<Vec<[f32; 3]>>,
}

/// Poses by time, nanoseconds.
fn truth(path: &Path) -> Result<BTreeMap<i64, Pose>, Box<dyn std::error::Error>> {
    Ok(read_tum(path)?.into_iter().map(|p| (p.stamp_ns, p.pose)).collect())
}

impl Visit {
    /// Clouds of 20 m of travel, one every 5 m, that hold all of it.
    pub(crate) fn segments(
        &self,
        filter: fn(&PointCloud) -> PointCloud,
    ) -> Result<Cut, Box<dyn std::error::Error>> {
        let truth = self.truth.as_deref().map(truth).transpose()?;
        let accumulate = AccumulateConfig::default();
        let full = 0.95 * accumulate.distance_m;
        let config = SegmentConfig::default();
        let mut accumulator = Accumulator::new(accumulate)?;
        let mut cut = Cut::default();
        let mut last: Option<Pose> = None;
        for sweep in Recording::open(&self.recording, &OpenOptions::default())?.sweeps()? {
            let sweep = sweep?;
            let cloud = filter(&sweep.cloud);
            let live = accumulator.push(sweep.stamp, &cloud, sweep.pose_odom_sensor);
            if sweep.number % KEEP_EVERY == 1 {
                cut.sweeps.push(cloud);
            }
            let pose = match &truth {
                Some(truth) => truth.get(&sweep.stamp_ns).copied(),
                None => sweep.pose_odom_sensor,
            };
            let (Some(live), Some(pose)) = (live, pose) else { continue };
            let far = last.is_none_or(|l| (l.translation.vector - pose.translation.vector).norm() >= STEP_M);
            if live.travel_m < full || !far {
                continue;
            }
            last = Some(pose);
            let segments = segment(&live.cloud, &config).segments;
            cut.places.push(segments.iter().map(|s| transform_point(&pose, s.centroid)).collect());
            cut.clouds.push(segments);
        }
        Ok(cut)
    }
}

impl Cut {
    /// Numbers, sizes and shapes of the segments.
    pub(crate) fn shapes(&self, side: &mut Side) {
        let of = |f: &dyn Fn(&Segment) -> f64| self.clouds.iter().flatten().map(f).collect::<Vec<f64>>();
        let counts = self.clouds.iter().map(|c| c.len() as f64).collect();
        side.quantiles("segments of a live cloud", "", counts, &[0.1, 0.5, 0.9]);
        side.quantiles("points of a segment", "", of(&|s| s.points.len() as f64), &[0.25, 0.5, 0.75, 0.9]);
        side.quantiles(
            "height of a segment",
            "m",
            of(&|s| f64::from(s.max[2] - s.min[2])),
            &[0.25, 0.5, 0.75, 0.9],
        );
        side.quantiles("radius of a segment", "m", of(&radius), &[0.25, 0.5, 0.75, 0.9]);
        let spreads: Vec<[f64; 3]> = self.clouds.iter().flatten().map(|s| spread(&s.points)).collect();
        side.quantiles(
            "linearity of a segment",
            "",
            spreads.iter().map(|l| (l[0] - l[1]) / l[0]).collect(),
            &[0.25, 0.5, 0.75],
        );
        side.quantiles(
            "scattering of a segment",
            "",
            spreads.iter().map(|l| l[2] / l[0]).collect(),
            &[0.25, 0.5, 0.75],
        );
        let rough = self.clouds.iter().flatten().step_by(7).flat_map(|s| {
            let asked: Vec<[f32; 3]> = s.points.iter().step_by(11).copied().collect();
            roughness(&s.points, &asked, 0.7)
        });
        side.quantiles("roughness within 0.7 m", "m", rough.collect(), &[0.1, 0.5, 0.9]);
    }

    /// Only segments of at least so many points.
    pub(crate) fn larger(&self, least: usize) -> Self {
        let keep = |c: &[Segment], p: &[[f32; 3]]| -> Vec<[f32; 3]> {
            c.iter().zip(p).filter(|(s, _)| s.points.len() >= least).map(|(_, p)| *p).collect()
        };
        let places = self.clouds.iter().zip(&self.places).map(|(c, p)| keep(c, p)).collect();
        Self { places, ..Self::default() }
    }

    /// Only every so many clouds.
    pub(crate) fn every(&self, step: usize) -> Self {
        Self { places: self.places.iter().step_by(step).cloned().collect(), ..Self::default() }
    }

    /// Share of the segments whose centroid lies within 0.5 m of one of the map's.
    pub(crate) fn found_in(&self, map: &Self) -> f64 {
        let known: Vec<[f32; 3]> = map.places.iter().flatten().copied().collect();
        let asked: Vec<[f32; 3]> = self.places.iter().flatten().copied().collect();
        let found =
            nearest(&known, &asked, 1).iter().filter(|d| d.first().is_some_and(|d| *d <= 0.5)).count();
        found as f64 / asked.len().max(1) as f64
    }
}

/// Root of the mean squared horizontal distance from the centroid.
fn radius(s: &Segment) -> f64 {
    let sum: f64 = s
        .points
        .iter()
        .map(|p| f64::from(p[0] - s.centroid[0]).powi(2) + f64::from(p[1] - s.centroid[1]).powi(2))
        .sum();
    (sum / s.points.len() as f64).sqrt()
}

//! The clouds of a live recording with their truth.

use std::path::Path;

use esm_core::{Accumulator, Config, LiveCloud, Map, Pose};
use esm_io::{OpenOptions, Recording, Track, read_tum};

/// Farthest a localizable position lies from the mapped path, metres.
const LOCALIZABLE_M: f64 = 10.0;
/// Share of the asked travel that a cloud must hold to count as localizable.
const TRAVEL_SHARE: f64 = 0.95;

/// One cloud.
pub(crate) struct Recorded {
    pub(crate) live: LiveCloud,
    pub(crate) truth_map_sensor: Pose,
    pub(crate) localizable: bool,
}

impl Recorded {
    /// Every `every`-th cloud of a recording whose truth is known.
    pub(crate) fn read(
        live: &Path,
        truth: &Path,
        map: &Map,
        config: &Config,
        every: usize,
    ) -> Result<Vec<Self>, Box<dyn std::error::Error>> {
        let mut track = Track::new(usize::MAX);
        for pose in read_tum(truth)? {
            track.push(pose.stamp_ns, pose.pose);
        }
        let mut accumulator = Accumulator::new(config.accumulate.clone())?;
        let (mut number, mut all) = (0, Vec::new());
        for sweep in Recording::open(live, &OpenOptions::default())?.sweeps()? {
            let sweep = sweep?;
            let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
                continue;
            };
            number += 1;
            let Some(truth_map_sensor) = track.at(sweep.stamp_ns) else { continue };
            if number % every != 0 {
                continue;
            }
            let at = truth_map_sensor.translation.vector;
            let near = |p: &[f64; 3]| (at - nalgebra::Vector3::from(*p)).norm() <= LOCALIZABLE_M;
            let localizable =
                live.travel_m >= TRAVEL_SHARE * config.accumulate.distance_m && map.path().iter().any(near);
            all.push(Self { live, truth_map_sensor, localizable });
        }
        Ok(all)
    }

    /// Whether a pose is the cloud's: within 2 m and 5 degrees.
    pub(crate) fn is_right(&self, pose_map_sensor: &Pose) -> bool {
        let off = self.truth_map_sensor.inv_mul(pose_map_sensor);
        off.translation.vector.norm() <= 2.0 && off.rotation.angle().to_degrees() <= 5.0
    }
}

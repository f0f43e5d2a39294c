//! [`LoopFinder`]: places of one recording that were passed before.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::accumulate::LiveCloud;
use crate::cloud::Pose;
use crate::config::Config;
use crate::describe::{self, Descriptor};
use crate::error::Error;
use crate::localization::{Localization, Verdict};
use crate::localizer::Localizer;
use crate::map::MapBuilder;

/// What was seen at least this long ago counts as the past, seconds.
pub const MIN_AGE_S: f64 = 30.0;
/// And at least this much travel ago, metres.
pub const MIN_TRAVEL_M: f64 = 50.0;

/// A constraint between two moments of one recording.
#[derive(Clone, Debug)]
pub struct LoopClosure {
    /// Seconds: the sweep of the past whose place is nearest.
    pub stamp_from: f64,
    /// Seconds: the newest sweep of the cloud that was recognised.
    pub stamp_to: f64,
    /// Pose of the sensor at `stamp_to` in the sensor frame of `stamp_from`.
    pub pose_from_to: Pose,
    /// Row-major 6 x 6, order x y z rx ry rz in m and rad, a right perturbation in the sensor frame of `stamp_to`.
    pub covariance: Option<[f64; 36]>,
}

/// The answer for one cloud.
#[derive(Clone, Debug)]
pub struct LoopAnswer {
    /// The cloud's localization in the map of the past. Its pose is in the odometry frame of the past.
    pub localization: Localization,
    /// The constraint, where the cloud was located.
    pub closure: Option<LoopClosure>,
}

/// Grows a map of the recording's past and looks for every new cloud in it. The motion is used relatively only: it
/// accumulates clouds and ages the past, and never decides where to look.
pub struct LoopFinder {
    config: Config,
    descriptor: Arc<dyn Descriptor>,
    builder: MapBuilder,
    localizer: Option<Localizer>,
    waiting: VecDeque<Moment>,
    past: Vec<(f64, Pose)>,
    travel_m: f64,
    last: Option<Pose>,
}

/// A cloud that is still too young for the map.
struct Moment {
    live: LiveCloud,
    pose_odom_sensor: Pose,
    travel_m: f64,
}

impl LoopFinder {
    /// An empty past.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn new(config: &Config) -> Result<Self, Error> {
        Self::with_descriptor(config, describe::by_name(&config.descriptor)?)
    }

    /// The same with a descriptor of your own in the place of the configured one.
    ///
    /// # Errors
    /// [`Error::Config`].
    pub fn with_descriptor(config: &Config, descriptor: Arc<dyn Descriptor>) -> Result<Self, Error> {
        Ok(Self {
            builder: MapBuilder::with_descriptor(config, Arc::clone(&descriptor))?,
            config: config.clone(),
            descriptor,
            localizer: None,
            waiting: VecDeque::new(),
            past: Vec::new(),
            travel_m: 0.0,
            last: None,
        })
    }

    /// Looks for the cloud in the past, then adds it to what will be the past. `None` where the cloud has no motion
    /// or there is no past yet.
    ///
    /// # Errors
    /// As [`Localizer::localize`] and [`MapBuilder::finish`].
    pub fn push(&mut self, live: LiveCloud) -> Result<Option<LoopAnswer>, Error> {
        let Some(pose_odom_sensor) = live.pose_odom_sensor else { return Ok(None) };
        if let Some(last) = self.last.replace(pose_odom_sensor) {
            self.travel_m += (pose_odom_sensor.translation.vector - last.translation.vector).norm();
        }
        self.age(live.stamp)?;
        let answer = match &self.localizer {
            Some(localizer) => Some(self.close(localizer.localize(&live)?)),
            None => None,
        };
        self.waiting.push_back(Moment { live, pose_odom_sensor, travel_m: self.travel_m });
        Ok(answer)
    }

    /// Moves what is old enough into the map.
    fn age(&mut self, now: f64) -> Result<(), Error> {
        let mut changed = false;
        while let Some(oldest) = self.waiting.front() {
            if now - oldest.live.stamp <= MIN_AGE_S || self.travel_m - oldest.travel_m <= MIN_TRAVEL_M {
                break;
            }
            if let Some(moment) = self.waiting.pop_front() {
                changed |= self.builder.push(&moment.live, &moment.pose_odom_sensor)?;
                self.past.push((moment.live.stamp, moment.pose_odom_sensor));
            }
        }
        if changed && !self.builder.is_empty() {
            let (map, descriptor) = (Arc::new(self.builder.finish()?), Arc::clone(&self.descriptor));
            self.localizer = Some(Localizer::with_descriptor(map, &self.config, descriptor)?);
        }
        Ok(())
    }

    fn close(&self, localization: Localization) -> LoopAnswer {
        let closure = localization
            .pose_map_sensor
            .filter(|_| localization.verdict == Verdict::Located)
            .and_then(|pose_odom_to| {
                let off = |p: &Pose| (p.translation.vector - pose_odom_to.translation.vector).norm();
                let (stamp_from, pose_odom_from) =
                    self.past.iter().min_by(|a, b| off(&a.1).total_cmp(&off(&b.1)))?;
                Some(LoopClosure {
                    stamp_from: *stamp_from,
                    stamp_to: localization.stamp,
                    pose_from_to: pose_odom_from.inv_mul(&pose_odom_to),
                    covariance: localization.covariance,
                })
            });
        LoopAnswer { localization, closure }
    }
}

//! [`Robot`]: what a session knows of its robot, from one cloud to the next.

use std::collections::BTreeMap;
use std::sync::Arc;

use esm_core::{Accumulator, Pose, SequenceLocalizer};
use esm_io::seconds;

use super::frame::points;
use super::inbox::Pending;
use crate::maps::LoadedMap;
use crate::problem::Problem;
use crate::state::{Answer, find, internal};

/// The last metres of travel, and where the robot may be in each map.
pub(super) struct Robot {
    accumulator: Accumulator,
    /// By the map's name, with the map itself: another map under the same name is looked at afresh.
    beliefs: BTreeMap<String, (Arc<LoadedMap>, SequenceLocalizer)>,
}

impl Robot {
    pub(super) fn new(accumulator: Accumulator) -> Self {
        Self { accumulator, beliefs: BTreeMap::new() }
    }

    /// Puts the clouds together and finds the newest. Not for threads that talk.
    pub(super) fn step(
        mut self,
        clouds: Vec<(Pending, Option<Pose>)>,
        maps: &[Arc<LoadedMap>],
        watched: bool,
    ) -> (Self, Result<Answer, Problem>) {
        let mut live = None;
        for (Pending { stamp_ns, message, held, .. }, pose_odom_sensor) in clouds {
            let scan = points(&message);
            drop((message, held));
            live = self.accumulator.push(seconds(stamp_ns), &scan.cloud, pose_odom_sensor);
        }
        let Some(live) = live else { return (self, Err(internal("a sweep gave no cloud"))) };
        self.beliefs.retain(|_, (held, _)| maps.iter().any(|map| Arc::ptr_eq(map, held)));
        let answer = find(&live, maps, watched, |map| {
            let fresh = || (Arc::clone(map), SequenceLocalizer::new(Arc::clone(&map.localizer)));
            let (_, sequence) = self.beliefs.entry(map.name.clone()).or_insert_with(fresh);
            sequence.localize(&live)
        });
        (self, answer)
    }
}

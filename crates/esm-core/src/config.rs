//! [`Config`]: everything that can be set, one documented default each.

use serde::{Deserialize, Serialize};

use crate::accumulate::AccumulateConfig;
use crate::budget::BudgetConfig;
use crate::describe;
use crate::error::Error;
use crate::estimate::PoseConfig;
use crate::map::BuildConfig;
use crate::matching::MatchConfig;
use crate::odometry::OdometryConfig;
use crate::segment::SegmentConfig;
use crate::sequence::SequenceConfig;
use crate::verify::VerifyConfig;

/// The whole configuration, a table for each room of the pipeline. Unknown keys are refused.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Name of the descriptor, one of [`describe::NAMES`], or the path of a weights file (`*.safetensors`).
    pub descriptor: String,
    /// Seed of everything random: the same seed gives the same bits.
    pub seed: u64,
    /// From sweeps to live clouds.
    pub accumulate: AccumulateConfig,
    /// How far the motion between the sweeps of a cloud is off.
    pub odometry: OdometryConfig,
    /// From clouds to segments.
    pub segment: SegmentConfig,
    /// From descriptors to candidate matches.
    #[serde(rename = "match")]
    pub matching: MatchConfig,
    /// From candidate matches to places.
    pub pose: PoseConfig,
    /// From places to a verdict.
    pub verify: VerifyConfig,
    /// How long a cloud may take.
    pub budget: BudgetConfig,
    /// From clouds to the way of one robot.
    pub sequence: SequenceConfig,
    /// How maps are built.
    pub map: BuildConfig,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            descriptor: describe::NAMES[0].to_owned(),
            seed: 0,
            accumulate: AccumulateConfig::default(),
            odometry: OdometryConfig::default(),
            segment: SegmentConfig::default(),
            matching: MatchConfig::default(),
            pose: PoseConfig::default(),
            verify: VerifyConfig::default(),
            budget: BudgetConfig::default(),
            sequence: SequenceConfig::default(),
            map: BuildConfig::default(),
        }
    }
}

impl Config {
    /// Checks every field of every room.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        describe::check_name(&self.descriptor)?;
        self.accumulate.check()?;
        self.odometry.check()?;
        self.segment.check()?;
        self.matching.check()?;
        self.pose.check()?;
        self.verify.check()?;
        self.budget.check()?;
        self.sequence.check()?;
        self.map.check()
    }
}

//! Verification: a place is believed only when the live points really lie on what the map holds there.

mod chance;
mod freespace;
mod grid;
mod refine;
mod shifts;
mod surface;
mod surroundings;

use serde::{Deserialize, Serialize};

pub use chance::chance_false;
pub use freespace::{Ray, free_space_violated, rays};
pub use refine::{Refined, approach, rate, refine, settle};
pub use shifts::{Shift, Shifts};
pub use surface::{Gaussian, Surface, Tile};
pub use surroundings::Surroundings;

use crate::cloud::{Pose, transform_point};
use crate::error::{Error, require};
use crate::segment::Segmentation;

/// Configuration of refinement and verdict.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct VerifyConfig {
    /// Live points above the ground used for refinement and overlap.
    pub structure_points: usize,
    /// Live points of the ground used for refinement.
    pub ground_points: usize,
    /// Share of the live points above the ground that must lie where the map has been seen.
    pub min_seen: f64,
    /// Expected false localizations in a thousand clouds: a place is believed only when its evidence makes it that rare
    /// ([`chance_false`]).
    pub max_false_per_thousand: f64,
    /// Live rays that are looked at for free space.
    pub rays: usize,
    /// Share of them that may pass through what the map holds as solid; 1 lets it decide nothing, which is the default: on
    /// simulated tuning worlds no place that its points speak for was unmasked by it. Right places had 6 % at most, cars gone and
    /// leaves fallen included, false ones 2 to 30 %. For live clouds that are one scanner's: one that was put together from many
    /// places, and is pushed as one sweep, sees through walls.
    pub max_free_space_violated: f64,
    /// A second place with more than this share of the best place's score makes the cloud ambiguous.
    pub max_runner_up: f64,
}

impl Default for VerifyConfig {
    fn default() -> Self {
        Self {
            structure_points: 3000,
            ground_points: 1000,
            min_seen: 0.3,
            rays: 300,
            max_free_space_violated: 1.0,
            max_false_per_thousand: 0.1,
            max_runner_up: 0.5,
        }
    }
}

impl VerifyConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        let share = |v: f64| (0.0..=1.0).contains(&v);
        require(
            self.structure_points >= 100,
            "verify.structure_points",
            self.structure_points,
            "100 or more",
        )?;
        require(share(self.min_seen), "verify.min_seen", self.min_seen, "0 to 1")?;
        require(
            (0.0..=1000.0).contains(&self.max_false_per_thousand),
            "verify.max_false_per_thousand",
            self.max_false_per_thousand,
            "0 to 1000",
        )?;
        require((0..=100_000).contains(&self.rays), "verify.rays", self.rays, "0 to 100000")?;
        require(
            share(self.max_free_space_violated),
            "verify.max_free_space_violated",
            self.max_free_space_violated,
            "0 to 1",
        )?;
        require(share(self.max_runner_up), "verify.max_runner_up", self.max_runner_up, "0 to 1")
    }
}

/// The live points that refinement and verification use, in the sensor frame: an even sample.
pub struct LivePoints {
    structure: Vec<[f32; 3]>,
    all: Vec<[f32; 3]>,
    rays: Vec<Ray>,
}

impl LivePoints {
    /// Samples what stands on the ground, and the ground, evenly.
    pub fn new(segmentation: &Segmentation, config: &VerifyConfig) -> Self {
        let sample = |points: &[[f32; 3]], most: usize| -> Vec<[f32; 3]> {
            points.iter().step_by(points.len().div_ceil(most.max(1)).max(1)).copied().collect()
        };
        let structure = sample(&segmentation.structure, config.structure_points);
        let mut all = structure.clone();
        all.extend(sample(&segmentation.ground, config.ground_points));
        Self { structure, all, rays: Vec::new() }
    }

    /// With rays of the cloud, for free space.
    #[must_use]
    pub fn with_rays(self, rays: Vec<Ray>) -> Self {
        Self { rays, ..self }
    }

    /// Those of the refinement: what stands on the ground, then the ground.
    pub fn all(&self) -> &[[f32; 3]] {
        &self.all
    }
}

/// How well a place explains the live cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Verified {
    /// The refined pose.
    pub refined: Refined,
    /// Share of the live points above the ground, where the map has been seen, that lie on what stands there in the map.
    pub overlap: f64,
    /// Share of the live points above the ground that lie where the map has been seen.
    pub seen: f64,
    /// Share of the live rays that pass through what the map holds as solid; 0 without rays.
    pub free_space_violated: f64,
}

/// Refines a pose on the surface around it, and measures the overlap and how much free space it violates.
pub fn verify(surface: &Surface, live: &LivePoints, pose_map_sensor: &Pose) -> Verified {
    weigh(surface, live, refine(surface, &live.all, pose_map_sensor))
}

/// Measures what speaks for a refined pose and what against.
pub fn weigh(surface: &Surface, live: &LivePoints, refined: Refined) -> Verified {
    let (mut seen, mut found) = (0usize, 0usize);
    for p in &live.structure {
        let at = transform_point(&refined.pose_map_sensor, *p);
        if surface.is_seen(at) {
            seen += 1;
            found += usize::from(surface.is_occupied(at));
        }
    }
    Verified {
        free_space_violated: free_space_violated(surface, &live.rays, &refined.pose_map_sensor),
        refined,
        overlap: found as f64 / seen.max(1) as f64,
        seen: seen as f64 / live.structure.len().max(1) as f64,
    }
}

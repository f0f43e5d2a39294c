//! Configuration of the pose search.

use serde::{Deserialize, Serialize};

use super::agreement::Agreement;
use crate::error::{Error, require};

/// How the best group of consistent matches is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// PROSAC: samples in the order of quality (the paper's).
    Prosac,
    /// RANSAC: uniform samples, for comparison.
    Ransac,
    /// The maximum clique of the consistency graph: no sampling, no luck.
    #[default]
    Clique,
    /// Groups grown greedily from each match, for comparison (SegMatch's).
    Plain,
}

/// Which matches are tried first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Order {
    /// Those whose two descriptors are likely to be good for matching: by p_live x p_map, ties by descriptor distance.
    #[default]
    Quality,
    /// Those whose descriptors are nearest to each other.
    Distance,
}

/// Configuration of the pose search.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseConfig {
    /// How the best group of consistent matches is found.
    pub method: Method,
    /// Which matches are tried first (PROSAC and plain groups; the others take all alike).
    pub order: Order,
    /// Two matches agree when their lengths in live cloud and map differ by at most this, metres. (SegMatch: 0.4 m,
    /// SegMap: 0.6 m.)
    pub resolution_m: f64,
    /// A match supports a pose when its centroids lie this near, metres.
    pub inlier_m: f64,
    /// Whether the live z axis points up but for `max_tilt_deg`: two matches then fix a pose instead of three.
    pub gravity: bool,
    /// Largest tilt of the live z axis against the map's, degrees (with `gravity`).
    pub max_tilt_deg: f64,
    /// How much of its extents along the map's axes, length, width and height, a segment may have lost or gained against
    /// the one it is matched with, once it is turned: a share of the larger extent, besides `resolution_m`. Turns on which
    /// they differ by more are ruled out for the match; 1 compares nothing. (With `gravity`.)
    pub max_extent_change: f64,
    /// Matches that a place must have to be considered at all.
    pub min_inliers: usize,
    /// Distinct places that are passed on to verification.
    pub hypotheses: usize,
    /// Whether matches that cannot belong to a group of `min_inliers` are left out first: those outside the core of the
    /// consistency graph. Without it PROSAC and RANSAC draw from all matches, as the paper's does.
    pub prune: bool,
    /// Places nearer than this to each other, metres, are one place.
    pub distinct_m: f64,
    /// Chance that a candidate agrees with a wrong pose (PROSAC's beta); 0: measured on each cloud
    /// ([`measured_beta`](super::measured_beta)).
    pub beta: f64,
    /// Most samples drawn for one place (PROSAC and RANSAC).
    pub max_draws: usize,
    /// Most branches visited for one place (clique).
    pub max_branches: usize,
}

impl Default for PoseConfig {
    fn default() -> Self {
        Self {
            method: Method::default(),
            order: Order::default(),
            resolution_m: 0.5,
            inlier_m: 0.8,
            gravity: true,
            max_tilt_deg: 6.0,
            max_extent_change: 1.0,
            min_inliers: 4,
            hypotheses: 4,
            prune: true,
            distinct_m: 2.0,
            beta: 0.0,
            max_draws: 100_000,
            max_branches: 1000,
        }
    }
}

impl PoseConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        require(positive(self.resolution_m), "pose.resolution_m", self.resolution_m, "more than 0 m")?;
        require(positive(self.inlier_m), "pose.inlier_m", self.inlier_m, "more than 0 m")?;
        require(
            (0.0..=45.0).contains(&self.max_tilt_deg),
            "pose.max_tilt_deg",
            self.max_tilt_deg,
            "0 to 45 deg",
        )?;
        require(
            (0.0..=1.0).contains(&self.max_extent_change),
            "pose.max_extent_change",
            self.max_extent_change,
            "0 to 1",
        )?;
        require(self.min_inliers >= 3, "pose.min_inliers", self.min_inliers, "3 or more")?;
        require((1..=64).contains(&self.hypotheses), "pose.hypotheses", self.hypotheses, "1 to 64")?;
        require(positive(self.distinct_m), "pose.distinct_m", self.distinct_m, "more than 0 m")?;
        require((0.0..1.0).contains(&self.beta), "pose.beta", self.beta, "0, or between 0 and 1")?;
        require(self.max_draws >= 1, "pose.max_draws", self.max_draws, "1 or more")
    }

    /// Whether the search works on the graph of consistent matches.
    pub(super) fn needs_graph(&self) -> bool {
        self.prune || matches!(self.method, Method::Clique | Method::Plain)
    }

    /// When two matches agree.
    pub fn agreement(&self) -> Agreement {
        Agreement {
            resolution_m: self.resolution_m as f32,
            max_tilt_rad: self.gravity.then(|| self.max_tilt_deg.to_radians() as f32),
        }
    }

    /// Tilt that a pose of four degrees of freedom leaves unmodelled, radians.
    pub(super) fn tilt_rad(&self) -> f32 {
        if self.gravity { self.max_tilt_deg.to_radians() as f32 } else { 0.0 }
    }
}

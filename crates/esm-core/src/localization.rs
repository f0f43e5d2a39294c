//! What localizing one cloud gives: [`Localization`].

use std::time::Duration;

use crate::cloud::Pose;

/// What the system says about a cloud.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The pose is trusted.
    Located,
    /// Two places explain the cloud nearly as well: neither is trusted.
    Ambiguous,
    /// No place explains the cloud well enough.
    NotFound,
}

impl Verdict {
    /// The word used in results: `located`, `ambiguous` or `not_found`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Located => "located",
            Self::Ambiguous => "ambiguous",
            Self::NotFound => "not_found",
        }
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.as_str())
    }
}

/// Time spent on one cloud, stage by stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timings {
    /// Putting the sweeps together.
    pub accumulation: Duration,
    /// Voxels, ground and clusters.
    pub segmentation: Duration,
    /// Sampling and normalisation of the segments' points.
    pub preprocessing: Duration,
    /// Describing the segments, neighbour search included.
    pub descriptor: Duration,
    /// K nearest in descriptor space, and judging them where the descriptor does.
    pub matching: Duration,
    /// The part of `matching` that judging the candidates took (SegMatch's and NSM's random forest).
    pub judging: Duration,
    /// Consistency and pose search.
    pub pose: Duration,
    /// Refinement and verification on points.
    pub verification: Duration,
}

impl Timings {
    /// Each stage with its name, in the order of the pipeline.
    pub fn stages(&self) -> [(&'static str, Duration); 7] {
        [
            ("accumulation", self.accumulation),
            ("segmentation", self.segmentation),
            ("preprocessing", self.preprocessing),
            ("descriptor", self.descriptor),
            ("matching", self.matching),
            ("pose", self.pose),
            ("verification", self.verification),
        ]
    }

    /// Sum of all stages.
    pub fn total(&self) -> Duration {
        self.stages().iter().map(|s| s.1).sum()
    }
}

/// One live segment and the map segment it was matched with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MatchedSegment {
    /// Index of the live segment.
    pub live: usize,
    /// Index of the map segment.
    pub map: usize,
    /// Centroid of the live segment in the sensor frame, metres.
    pub live_centroid_sensor: [f32; 3],
    /// Centroid of the map segment in the map frame, metres.
    pub map_centroid_map: [f64; 3],
}

/// The answer for one cloud.
#[derive(Clone, Debug)]
pub struct Localization {
    /// Seconds, of the newest sweep in the cloud.
    pub stamp: f64,
    /// Whether the pose is to be trusted.
    pub verdict: Verdict,
    /// Why the cloud was not located.
    pub reason: Option<String>,
    /// Pose of the newest sensor frame in the map; also given, as a guess, where the verdict is `ambiguous`.
    pub pose_map_sensor: Option<Pose>,
    /// Row-major 6 x 6, order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame. What the points tell, what
    /// the odometry within the cloud may have got wrong ([`OdometryConfig`](crate::OdometryConfig)), and how far apart the map
    /// holds the place where it holds it twice.
    pub covariance: Option<[f64; 36]>,
    /// Metres of travel the cloud holds.
    pub travel_m: f64,
    /// Segments cut from the cloud.
    pub segments: usize,
    /// Segments described for this answer.
    pub described: usize,
    /// Matched segments that agree with the pose, at most one a live segment.
    pub inliers: usize,
    /// How well the best place explains the cloud: inliers weighted by the share of points found in the map.
    pub score: f64,
    /// Share of the live points above the ground, where the map has been seen, that lie on what stands there in the map.
    pub overlap: f64,
    /// Share of the live points above the ground that lie where the map has been seen.
    pub seen: f64,
    /// Share of the live rays that pass through what the map holds as solid, well before they reach what they saw.
    pub free_space_violated: f64,
    /// The score of the best other place, 0 where there is none.
    pub runner_up: f64,
    /// The pose of that other place.
    pub runner_up_pose_map_sensor: Option<Pose>,
    /// The matches behind `inliers`.
    pub matches: Vec<MatchedSegment>,
    /// Time spent.
    pub timings: Timings,
}

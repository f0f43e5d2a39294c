//! From a group of matches to a place: the pose that explains most.

use nalgebra::Vector3;

use super::candidate::Candidate;
use super::config::PoseConfig;
use super::consensus::{Consensus, NearCentroids, Support};
use super::rigid::{Estimator, FourDof, Pair, SixDof};
use crate::cloud::Pose;

/// A place the cloud may have been taken at.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Pose of the live sensor in the map.
    pub pose_map_sensor: Pose,
    /// The matches that agree with it.
    pub support: Support,
}

/// Whether two poses are one place for all that matters here.
pub fn same_place(a: &Pose, b: &Pose, distinct_m: f64) -> bool {
    (a.translation.vector - b.translation.vector).norm() < distinct_m
        && a.rotation.angle_to(&b.rotation) < 0.3
}

/// Fits a pose to a group, gathers all matches that agree with it, and fits again until nothing changes.
pub(super) fn settle(
    candidates: &[Candidate],
    consensus: &mut NearCentroids<'_>,
    group: &[u32],
    config: &PoseConfig,
) -> Option<Hypothesis> {
    const ROUNDS: usize = 4;
    let mut best: Option<Hypothesis> = None;
    let mut members = group.to_vec();
    for _ in 0..ROUNDS {
        let pose_map_sensor = fit(candidates, &members, config)?;
        let support = consensus.support(&pose_map_sensor);
        let better = best.as_ref().is_none_or(|b| support.beats(&b.support));
        if !better {
            break;
        }
        members.clone_from(&support.inliers);
        best = Some(Hypothesis { pose_map_sensor, support });
        if members.len() < config.min_inliers {
            break;
        }
    }
    best
}

/// Six degrees where the matches fix them and the tilt is plausible, else four where gravity is known.
fn fit(candidates: &[Candidate], members: &[u32], config: &PoseConfig) -> Option<Pose> {
    let pairs: Vec<Pair> = members.iter().map(|v| candidates[*v as usize].pair).collect();
    let six = SixDof.estimate(&pairs);
    if !config.gravity {
        return six;
    }
    let upright = |p: &Pose| {
        let up = p.rotation * Vector3::z();
        up.z.clamp(-1.0, 1.0).acos() <= config.max_tilt_deg.to_radians()
    };
    six.filter(upright).or_else(|| FourDof.estimate(&pairs))
}

//! How many candidates agree with a pose: the `Consensus` of the pose search.

use super::candidate::Candidate;
use crate::cloud::Pose;

/// The candidates that agree with a pose.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Support {
    /// Candidate indices, ascending; at most one a live segment and one a map segment.
    pub inliers: Vec<u32>,
    /// Sum over the inliers of 1 - (residual / tolerance)^2: breaks ties between equal counts.
    pub weight: f64,
}

impl Support {
    /// Whether this support is better: more inliers, then the greater weight.
    pub fn beats(&self, other: &Self) -> bool {
        (self.inliers.len(), self.weight) > (other.inliers.len(), other.weight)
    }
}

/// Counts the support of a pose among all candidates.
pub trait Consensus {
    /// The candidates that agree with `pose_map_sensor`.
    fn support(&mut self, pose_map_sensor: &Pose) -> Support;
}

/// Agreement by distance: the live centroid, moved by the pose, lies near its map centroid. Each live segment gives
/// at most one inlier, its nearest; the tolerance is larger up and down where tilt lifts far segments.
pub struct NearCentroids<'a> {
    candidates: &'a [Candidate],
    tolerance_m: f32,
    tilt_rad: f32,
    /// Best residual and its candidate for each live segment, kept between calls to save the allocation.
    by_live: Vec<(f32, u32)>,
}

impl<'a> NearCentroids<'a> {
    /// Over all candidates; `tilt_rad` is the tilt a four-degree pose leaves unmodelled (0 for six degrees).
    pub fn new(candidates: &'a [Candidate], tolerance_m: f32, tilt_rad: f32) -> Self {
        let live = candidates.iter().map(|c| c.live as usize + 1).max().unwrap_or(0);
        Self { candidates, tolerance_m, tilt_rad, by_live: vec![(f32::INFINITY, u32::MAX); live] }
    }
}

impl Consensus for NearCentroids<'_> {
    fn support(&mut self, pose_map_sensor: &Pose) -> Support {
        let r = pose_map_sensor.rotation.to_rotation_matrix().matrix().map(|v| v as f32);
        let t = pose_map_sensor.translation.vector.map(|v| v as f32);
        let horizontal = self.tolerance_m * self.tolerance_m;
        self.by_live.fill((f32::INFINITY, u32::MAX));
        for (i, c) in self.candidates.iter().enumerate() {
            let (l, m) = (c.pair.live, c.pair.map);
            let d = [
                r[(0, 0)] * l[0] + r[(0, 1)] * l[1] + r[(0, 2)] * l[2] + t[0] - m[0],
                r[(1, 0)] * l[0] + r[(1, 1)] * l[1] + r[(1, 2)] * l[2] + t[1] - m[1],
                r[(2, 0)] * l[0] + r[(2, 1)] * l[1] + r[(2, 2)] * l[2] + t[2] - m[2],
            ];
            let flat = d[0] * d[0] + d[1] * d[1];
            if flat > horizontal {
                continue;
            }
            let up = self.tolerance_m + self.tilt_rad * (l[0] * l[0] + l[1] * l[1]).sqrt();
            let residual = flat / horizontal + d[2] * d[2] / (up * up);
            let best = &mut self.by_live[c.live as usize];
            if residual <= 1.0 && residual < best.0 {
                *best = (residual, i as u32);
            }
        }
        let mut found: Vec<(f32, u32)> = self.by_live.iter().copied().filter(|b| b.1 != u32::MAX).collect();
        // One map segment cannot be two live ones: the nearer keeps it.
        found.sort_unstable_by(|a, b| {
            let map = |x: &(f32, u32)| self.candidates[x.1 as usize].map;
            map(a).cmp(&map(b)).then(a.0.total_cmp(&b.0)).then(a.1.cmp(&b.1))
        });
        found.dedup_by_key(|f| self.candidates[f.1 as usize].map);
        found.sort_unstable_by_key(|f| f.1);
        let weight = found.iter().map(|f| 1.0 - f64::from(f.0)).sum();
        Support { inliers: found.into_iter().map(|f| f.1).collect(), weight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::rigid::Pair;

    fn candidate(live: u32, map: u32, at: [f32; 3], off: f32) -> Candidate {
        let pair = Pair { live: at, map: [at[0] + 10.0 + off, at[1], at[2]] };
        Candidate { live, map, distance: 0.0, quality: 1.0, pair, turns: u64::MAX }
    }

    #[test]
    fn at_most_one_inlier_a_live_and_a_map_segment() {
        let candidates = [
            candidate(0, 0, [1.0, 0.0, 0.0], 0.3),
            candidate(0, 1, [1.0, 0.0, 0.0], 0.1),
            candidate(1, 1, [1.2, 0.0, 0.0], 0.0),
            candidate(2, 2, [5.0, 5.0, 0.0], 0.2),
            candidate(3, 3, [9.0, 5.0, 0.0], 2.0),
        ];
        let support = NearCentroids::new(&candidates, 0.5, 0.0).support(&Pose::translation(10.0, 0.0, 0.0));
        assert_eq!(support.inliers, [2, 3]);
    }

    #[test]
    fn tilt_widens_the_tolerance_upwards_only() {
        let mut c = [candidate(0, 0, [40.0, 0.0, 0.0], 0.0), candidate(1, 1, [0.0, 40.0, 0.0], 2.0)];
        c[0].pair.map[2] += 2.0;
        let pose = Pose::translation(10.0, 0.0, 0.0);
        assert!(NearCentroids::new(&c, 0.5, 0.0).support(&pose).inliers.is_empty());
        assert_eq!(NearCentroids::new(&c, 0.5, 0.1).support(&pose).inliers, [0]);
    }
}

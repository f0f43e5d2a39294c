//! Candidate matches: a live segment, a map segment it may be, and how good that looks.

use super::rigid::Pair;

/// Every turn about the up axis ([`Candidate::turns`]).
pub const ANY_TURN: u64 = u64::MAX;

/// One candidate match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Index of the live segment.
    pub live: u32,
    /// Index of the map segment.
    pub map: u32,
    /// Squared L2 distance of the descriptors.
    pub distance: f32,
    /// Joint probability that both descriptors are good for matching: p_live x p_map (paper, section 1).
    pub quality: f32,
    /// The two centroids.
    pub pair: Pair,
    /// The turns about the up axis, from the live frame to the map's, on which the two segments have the same extents: one
    /// bit for each of 64, the first one looking back; [`ANY_TURN`] where they were not compared
    /// ([`compare_extents`](super::compare_extents)). Of no effect where gravity is unknown.
    pub turns: u64,
}

/// Best first: by quality, ties by descriptor distance, then by index, so that the order is unique.
pub fn sort_by_quality(candidates: &mut [Candidate]) {
    candidates.sort_unstable_by(|a, b| {
        b.quality
            .total_cmp(&a.quality)
            .then(a.distance.total_cmp(&b.distance))
            .then(a.live.cmp(&b.live))
            .then(a.map.cmp(&b.map))
    });
}

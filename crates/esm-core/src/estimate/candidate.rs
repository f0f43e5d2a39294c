//! Candidate matches: a live segment, a map segment it may be, and how good that looks.

use super::rigid::Pair;

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

//! What a forest is asked about a pair of segments.

use crate::describe::esf::{BINS, HISTOGRAMS};

/// Below this a number counts as nothing to divide by.
const LEAST: f32 = 1e-6;

/// Five numbers for each of a descriptor's (SegMatch): the difference, the difference in shares of the one and of the other,
/// and both, all without sign; grouped by kind.
pub(super) fn differences(live: &[f32], map: &[f32], out: &mut Vec<f32>) {
    let share = |d: f32, f: f32| d / f.abs().max(LEAST);
    let pairs = || live.iter().zip(map);
    out.extend(pairs().map(|(a, b)| (a - b).abs()));
    out.extend(pairs().map(|(a, b)| share((a - b).abs(), *b)));
    out.extend(pairs().map(|(a, b)| share((a - b).abs(), *a)));
    out.extend(live.iter().map(|a| a.abs()));
    out.extend(map.iter().map(|b| b.abs()));
}

/// What each of the ten histograms of two ESFs have in common.
pub(super) fn intersections(live: &[f32], map: &[f32], out: &mut Vec<f32>) {
    debug_assert_eq!(live.len(), BINS * HISTOGRAMS);
    for (a, b) in live.as_chunks::<BINS>().0.iter().zip(map.as_chunks::<BINS>().0) {
        out.push(a.iter().zip(b).map(|(a, b)| a.min(*b)).sum());
    }
}

//! The pair tests of all candidates that lie near each other in the map, many at a time.

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

use super::agreement::Agreement;
use super::bins::Bins;
use super::candidate::Candidate;

/// Members tested at a time: a few instructions on the widest vectors the processor has.
const LANES: usize = 16;

/// Which pairs of candidates are tested.
pub(super) struct Tests<'a, K> {
    pub(super) candidates: &'a [Candidate],
    pub(super) bins: &'a Bins,
    /// Bins of the same reach: each member of `bins` is tested with these; without, with the other members of `bins`.
    pub(super) among: Option<&'a Bins>,
    /// Of each live segment: how far from it another one lies at most, metres.
    pub(super) reach: &'a [f32],
    pub(super) agreement: Agreement,
    /// Asked for those whose places agree.
    pub(super) keep: K,
}

/// Pairs of members whose places agree and that are kept, and how many were tested. They ascend by their first member, and
/// those of each second one by the first; of one set of bins the first is the lower.
pub(super) fn agreeing_pairs<K: Fn(&Candidate, &Candidate) -> bool>(
    tests: Tests<'_, K>,
) -> (Vec<(u32, u32)>, u64) {
    Arch::new().dispatch(tests)
}

impl<K: Fn(&Candidate, &Candidate) -> bool> WithSimd for Tests<'_, K> {
    type Output = (Vec<(u32, u32)>, u64);

    // No vector type is named: inlined here, the loops are compiled for the instructions at hand. None of them fuses or
    // reorders, so that the bits are the same on all.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { candidates, bins, among, reach, agreement, keep } = self;
        let others = among.unwrap_or(bins);
        let lanes = Lanes::of(candidates, others);
        let (mut found, mut tests) = (Vec::new(), 0);
        let (mut near, mut ranges) = (Vec::new(), Vec::new());
        for cell in 0..bins.cells() {
            let members = bins.members(cell);
            let farthest = farthest(&bins.live[members.clone()], reach) + agreement.resolution_m;
            match among {
                Some(others) => others.around(bins, cell, farthest, &mut near),
                None => bins.later(cell, farthest, &mut near),
            }
            for a in members.clone() {
                ranges.clear();
                if among.is_none() {
                    ranges.push(a + 1..members.end);
                }
                ranges.extend_from_slice(&near);
                let one = &candidates[bins.order[a] as usize];
                for range in &ranges {
                    tests += range.len() as u64;
                    for (number, lanes) in lanes_of(&lanes, range) {
                        let first = number * LANES;
                        let mut hits = lanes.test(one, agreement) & within(range, first);
                        while hits != 0 {
                            let b = first + hits.trailing_zeros() as usize;
                            hits &= hits - 1;
                            if keep(one, &candidates[others.order[b] as usize]) {
                                found.push((a as u32, b as u32));
                            }
                        }
                    }
                }
            }
        }
        (found, tests)
    }
}

fn farthest(live: &[u32], reach: &[f32]) -> f32 {
    live.iter().map(|l| reach[*l as usize]).fold(0.0, f32::max)
}

/// Where some members are, in the live cloud and in the map, coordinate by coordinate; the last ones are filled up with
/// NaN, which agrees with nothing.
struct Lanes {
    live: [[f32; LANES]; 3],
    map: [[f32; LANES]; 3],
}

impl Lanes {
    fn of(candidates: &[Candidate], bins: &Bins) -> Vec<Self> {
        let filled = |members: &[u32]| {
            let mut lanes = Self { live: [[f32::NAN; LANES]; 3], map: [[f32::NAN; LANES]; 3] };
            for (k, member) in members.iter().enumerate() {
                let pair = &candidates[*member as usize].pair;
                for axis in 0..3 {
                    (lanes.live[axis][k], lanes.map[axis][k]) = (pair.live[axis], pair.map[axis]);
                }
            }
            lanes
        };
        bins.order.chunks(LANES).map(filled).collect()
    }

    /// Tests a candidate with these members: one bit each.
    #[inline(always)]
    fn test(&self, one: &Candidate, agreement: Agreement) -> u32 {
        let Self { live: [lx, ly, lz], map: [mx, my, mz] } = self;
        let m = one.pair.map;
        let mut hits = 0;
        for k in 0..LANES {
            let bounds = agreement.bounds(one.pair.live, [lx[k], ly[k], lz[k]]);
            hits |= u32::from(bounds.hold([m[0] - mx[k], m[1] - my[k], m[2] - mz[k]])) << k;
        }
        hits
    }
}

/// The lanes that hold a range of members, with their numbers.
#[inline(always)]
fn lanes_of<'a>(lanes: &'a [Lanes], range: &Range<usize>) -> impl Iterator<Item = (usize, &'a Lanes)> {
    let (first, end) = (range.start / LANES, range.end.div_ceil(LANES));
    (first..).zip(&lanes[first.min(end)..end])
}

/// The bits of those lanes, `first` and on, that are in the range.
#[inline(always)]
fn within(range: &Range<usize>, first: usize) -> u32 {
    let from = range.start.saturating_sub(first);
    let to = (range.end - first).min(LANES);
    (1 << to) - (1 << from)
}

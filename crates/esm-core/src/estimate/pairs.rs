//! The pair tests of all candidates that lie near each other in the map, many at a time.

use pulp::{Arch, Simd, WithSimd};

use super::agreement::{Agreement, Bounds};
use super::bins::Bins;
use super::candidate::Candidate;

/// Members tested at a time: a few instructions on the widest vectors the processor has.
const LANES: usize = 16;

/// Pairs of members that agree, the lower first, and how many were tested. Pairs ascend by their lower member, and for
/// each higher one by the lower.
pub(super) fn agreeing_pairs(
    candidates: &[Candidate],
    bins: &Bins,
    reach: &[f32],
    agreement: Agreement,
) -> (Vec<(u32, u32)>, u64) {
    Arch::new().dispatch(Tests { candidates, bins, reach, agreement })
}

struct Tests<'a> {
    candidates: &'a [Candidate],
    bins: &'a Bins,
    /// Of each live segment: how far from it another one lies at most, metres.
    reach: &'a [f32],
    agreement: Agreement,
}

impl WithSimd for Tests<'_> {
    type Output = (Vec<(u32, u32)>, u64);

    // No vector type is named: inlined here, the loops are compiled for the instructions at hand. None of them fuses or
    // reorders, so that the bits are the same on all.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let Self { candidates, bins, reach, agreement } = self;
        let places = Places::new(candidates, bins);
        let (mut found, mut tests) = (Vec::new(), 0);
        let (mut later, mut ranges) = (Vec::new(), Vec::new());
        for cell in 0..bins.cells() {
            let members = bins.members(cell);
            let farthest = farthest(&bins.live[members.clone()], reach);
            bins.later(cell, farthest + agreement.resolution_m, &mut later);
            for a in members.clone() {
                ranges.clear();
                ranges.push(a + 1..members.end);
                ranges.extend_from_slice(&later);
                let one = &candidates[bins.order[a] as usize];
                for range in &ranges {
                    tests += range.len() as u64;
                    let mut start = range.start;
                    while start < range.end {
                        let mut hits = places.test(start, one, agreement);
                        if range.end - start < LANES {
                            hits &= (1 << (range.end - start)) - 1;
                        }
                        while hits != 0 {
                            let b = start + hits.trailing_zeros() as usize;
                            hits &= hits - 1;
                            let other = &candidates[bins.order[b] as usize];
                            if other.live != one.live && other.map != one.map {
                                found.push((a as u32, b as u32));
                            }
                        }
                        start += LANES;
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

/// Where the members are, in the live cloud and in the map, coordinate by coordinate; then NaN, which agrees with nothing.
struct Places {
    live: [Vec<f32>; 3],
    map: [Vec<f32>; 3],
}

impl Places {
    fn new(candidates: &[Candidate], bins: &Bins) -> Self {
        let column = |of: &dyn Fn(&Candidate) -> f32| -> Vec<f32> {
            let values = bins.order.iter().map(|i| of(&candidates[*i as usize]));
            values.chain([f32::NAN; LANES]).collect()
        };
        Self {
            live: [0, 1, 2].map(|axis| column(&|c| c.pair.live[axis])),
            map: [0, 1, 2].map(|axis| column(&|c| c.pair.map[axis])),
        }
    }

    /// Tests a candidate with the members from `start` on: one bit each.
    #[inline(always)]
    fn test(&self, start: usize, one: &Candidate, agreement: Agreement) -> u32 {
        let [lx, ly, lz] =
            [lanes(&self.live[0], start), lanes(&self.live[1], start), lanes(&self.live[2], start)];
        let [mx, my, mz] =
            [lanes(&self.map[0], start), lanes(&self.map[1], start), lanes(&self.map[2], start)];
        let (l, m) = (one.pair.live, one.pair.map);
        let mut hits = 0;
        for k in 0..LANES {
            let bounds: Bounds = agreement.bounds(l, [lx[k], ly[k], lz[k]]);
            hits |= u32::from(bounds.hold([m[0] - mx[k], m[1] - my[k], m[2] - mz[k]])) << k;
        }
        hits
    }
}

#[inline(always)]
fn lanes(values: &[f32], start: usize) -> [f32; LANES] {
    let mut out = [f32::NAN; LANES];
    out.copy_from_slice(&values[start..start + LANES]);
    out
}

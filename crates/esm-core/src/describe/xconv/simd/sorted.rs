//! The least of many keys, in order: a sorting network over vectors, in which every lane is a list of its own.
//!
//! Batcher's bitonic merging (Sorting networks and their applications, 1968) on runs that a network of 60 comparators has
//! sorted (Green 1969; Knuth, The Art of Computer Programming 3, 5.3.4). Nothing depends on the data, so nothing is mispredicted.

use pulp::{Simd, WithSimd};

use super::arrays;

/// Vectors that are sorted in registers.
const RUN: usize = 16;

/// The low bits of a key: the index of the point. The distance's bits above it are rounded down.
pub(crate) const INDEX: u32 = 0xFF;

/// How many keys are sorted where `reach` are wanted: 16 or a larger power of two.
pub(crate) fn kept(reach: usize) -> usize {
    reach.next_power_of_two().max(RUN)
}

/// Distances from a vector of query points to all points, the least of them in order.
pub(crate) struct Lowest<'a> {
    /// x, y, z of the points, with a vector beyond the last.
    pub(crate) points: [&'a [f32]; 3],
    /// How many of them are looked among.
    pub(crate) sources: usize,
    /// The first of as many query points as a vector has lanes.
    pub(crate) query: usize,
    /// How many are wanted.
    pub(crate) reach: usize,
    /// Room for as many vectors as there are points, rounded up to a multiple of [`kept`]. The first vectors become the keys of the
    /// nearest, ascending.
    pub(crate) keys: &'a mut [u32],
    /// For each query a key that none of those left out is below.
    pub(crate) lost: &'a mut [u32],
    /// For each query the least difference, bit by bit, of two keys that follow one another up to the first that is not wanted: at
    /// most [`INDEX`] where rounded distances are the same.
    pub(crate) closest: &'a mut [u32],
}

impl WithSimd for Lowest<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [x, y, z] = self.points;
        let kept = kept(self.reach);
        let vectors = self.sources.next_multiple_of(kept);
        let keys = &mut S::as_mut_simd_u32s(self.keys).0[..vectors];
        let of = |axis: &[f32]| arrays::<S, 1>(&axis[self.query..self.query + S::F32_LANES])[0][0];
        let query = [of(x), of(y), of(z)];
        for n in 0..self.sources {
            let dx = simd.sub_f32s(query[0], simd.splat_f32s(x[n]));
            let dy = simd.sub_f32s(query[1], simd.splat_f32s(y[n]));
            let dz = simd.sub_f32s(query[2], simd.splat_f32s(z[n]));
            let xy = simd.add_f32s(simd.mul_f32s(dx, dx), simd.mul_f32s(dy, dy));
            let distance = simd.add_f32s(xy, simd.mul_f32s(dz, dz));
            let rounded = simd.and_u32s(simd.transmute_u32s_f32s(distance), simd.splat_u32s(!INDEX));
            keys[n] = simd.or_u32s(rounded, simd.splat_u32s(n as u32));
        }
        for n in self.sources..vectors {
            keys[n] = simd.splat_u32s(u32::MAX);
        }
        for run in keys.as_chunks_mut::<RUN>().0 {
            *run = sorted(simd, *run);
        }
        let mut width = RUN;
        while width < kept {
            let mut first = 0;
            while first < vectors {
                merge(simd, &mut keys[first..first + 2 * width]);
                first += 2 * width;
            }
            width *= 2;
        }
        let mut lost = simd.splat_u32s(u32::MAX);
        let (best, rest) = keys.split_at_mut(kept);
        let mut first = 0;
        while first < rest.len() {
            for n in 0..kept {
                let (a, b) = (best[n], rest[first + kept - 1 - n]);
                best[n] = simd.min_u32s(a, b);
                lost = simd.min_u32s(lost, simd.max_u32s(a, b));
            }
            clean(simd, best);
            first += kept;
        }
        S::as_mut_simd_u32s(self.lost).0[0] = lost;
        let mut closest = simd.splat_u32s(u32::MAX);
        for n in 1..kept.min(self.reach + 1) {
            closest = simd.min_u32s(closest, simd.xor_u32s(best[n], best[n - 1]));
        }
        S::as_mut_simd_u32s(self.closest).0[0] = closest;
    }
}

/// Comparators one after the other, written out: a loop over them would keep the run in memory.
macro_rules! network {
    ($simd:ident, $run:ident: $($low:literal $high:literal),*) => {
        $(order($simd, &mut $run, $low, $high);)*
    };
}

/// Compares and exchanges.
#[inline(always)]
fn order<S: Simd>(simd: S, v: &mut [S::u32s], low: usize, high: usize) {
    let (a, b) = (v[low], v[high]);
    v[low] = simd.min_u32s(a, b);
    v[high] = simd.max_u32s(a, b);
}

/// Two sorted halves become one sorted run.
#[inline(always)]
fn merge<S: Simd>(simd: S, v: &mut [S::u32s]) {
    let half = v.len() / 2;
    for n in 0..half {
        order(simd, v, n, 2 * half - 1 - n);
    }
    // No number of one half is above one of the other now, and both are bitonic.
    clean(simd, &mut v[..half]);
    clean(simd, &mut v[half..]);
}

/// Sorts what is bitonic.
#[inline(always)]
fn clean<S: Simd>(simd: S, v: &mut [S::u32s]) {
    let mut width = v.len();
    while width > RUN {
        let mut first = 0;
        while first < v.len() {
            for n in first..first + width / 2 {
                order(simd, v, n, n + width / 2);
            }
            first += width;
        }
        width /= 2;
    }
    for run in v.as_chunks_mut::<RUN>().0 {
        let mut r = *run;
        network!(simd, r: 0 8, 1 9, 2 10, 3 11, 4 12, 5 13, 6 14, 7 15);
        network!(simd, r: 0 4, 1 5, 2 6, 3 7, 8 12, 9 13, 10 14, 11 15);
        network!(simd, r: 0 2, 1 3, 4 6, 5 7, 8 10, 9 11, 12 14, 13 15);
        network!(simd, r: 0 1, 2 3, 4 5, 6 7, 8 9, 10 11, 12 13, 14 15);
        *run = r;
    }
}

/// Sorts one run.
#[inline(always)]
fn sorted<S: Simd>(simd: S, mut r: [S::u32s; RUN]) -> [S::u32s; RUN] {
    network!(simd, r: 0 1, 2 3, 4 5, 6 7, 8 9, 10 11, 12 13, 14 15);
    network!(simd, r: 0 2, 1 3, 4 6, 5 7, 8 10, 9 11, 12 14, 13 15);
    network!(simd, r: 0 4, 1 5, 2 6, 3 7, 8 12, 9 13, 10 14, 11 15);
    network!(simd, r: 0 8, 1 9, 2 10, 3 11, 4 12, 5 13, 6 14, 7 15);
    network!(simd, r: 5 10, 6 9, 3 12, 13 14, 4 8, 7 11, 1 2);
    network!(simd, r: 1 4, 7 13, 2 8, 11 14);
    network!(simd, r: 2 4, 5 6, 9 10, 11 13, 3 8, 7 12);
    network!(simd, r: 6 8, 10 12, 3 5, 7 9);
    network!(simd, r: 3 4, 5 6, 7 8, 9 10, 11 12);
    network!(simd, r: 6 7, 8 9);
    r
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Arch;

    /// What sorts all lists of zeros and ones sorts all lists (Knuth, 5.3.4, theorem Z).
    #[test]
    fn the_network_sorts_zeros_and_ones() {
        struct All;
        impl WithSimd for All {
            type Output = ();
            fn with_simd<S: Simd>(self, simd: S) {
                for first in (0..1u32 << RUN).step_by(S::U32_LANES) {
                    let mut columns = vec![0u32; RUN * S::U32_LANES];
                    for (n, c) in columns.iter_mut().enumerate() {
                        *c = (first + (n % S::U32_LANES) as u32) >> (n / S::U32_LANES) & 1;
                    }
                    let run = S::as_simd_u32s(&columns).0.as_chunks::<RUN>().0[0];
                    let found = sorted(simd, run);
                    let found: Vec<u32> = bytemuck::cast_slice(&found).to_vec();
                    for lane in 0..S::U32_LANES {
                        let ones = (first + lane as u32).count_ones() as usize;
                        let column: Vec<u32> = (0..RUN).map(|n| found[n * S::U32_LANES + lane]).collect();
                        let want: Vec<u32> = (0..RUN).map(|n| u32::from(n >= RUN - ones)).collect();
                        assert_eq!(column, want);
                    }
                }
            }
        }
        Arch::new().dispatch(All);
    }
}

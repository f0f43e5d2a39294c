//! Voxel grid filter: one point, the centroid, for each occupied cell of a cubic grid.

use super::radix::{Word, bits_for, floor_i64, sort_by_key};

/// Fractions of a voxel are summed in units of `leaf / 2^32`: integers add up to the same sum in any order.
const FRACTION: f64 = (1u64 << 32) as f64;

/// Replaces the points of each voxel by their centroid.
///
/// The grid is aligned with the origin: voxel `(i, j, k)` holds the points with `floor(x / leaf) = i` and so on.
/// The output is ordered by voxel (z, then y, then x) and every centroid is computed in integers, so the same set of
/// points gives the same bits in whatever order it comes. A voxel with a single point keeps that very point.
///
/// Points more than `2^31` voxels from the origin (400,000 km at 0.2 m) are left out, and of a cloud of more than
/// `2^32 - 1` points the rest is not read. `leaf` is in metres and positive; points must be finite.
///
/// ```
/// use esm_core::segment::voxel_filter;
/// let filtered = voxel_filter(&[[1.05, 0.05, 0.0], [0.05, 0.05, 0.0], [0.15, 0.05, 0.0]], 0.2);
/// assert_eq!(filtered, vec![[0.1, 0.05, 0.0], [1.05, 0.05, 0.0]]);
/// ```
pub fn voxel_filter(points: &[[f32; 3]], leaf: f32) -> Vec<[f32; 3]> {
    let points = &points[..points.len().min(u32::MAX as usize)];
    let per_metre = 1.0 / f64::from(leaf);
    let voxel_of = |p: &[f32; 3]| -> Option<[i32; 3]> {
        let k = p.map(|v| i32::try_from(floor_i64(f64::from(v) * per_metre)));
        match k {
            [Ok(x), Ok(y), Ok(z)] => Some([x, y, z]),
            _ => None,
        }
    };

    let mut voxels = Vec::with_capacity(points.len());
    let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
    for (index, p) in points.iter().enumerate() {
        if let Some(v) = voxel_of(p) {
            for a in 0..3 {
                low[a] = low[a].min(v[a]);
                high[a] = high[a].max(v[a]);
            }
            voxels.push((v, index as u32));
        }
    }
    if voxels.is_empty() {
        return Vec::new();
    }
    let bits: [u32; 3] = std::array::from_fn(|a| bits_for(high[a].abs_diff(low[a]).into()));
    let key_bits = bits.iter().sum();
    let key = |v: [i32; 3]| {
        let d: [u32; 3] = std::array::from_fn(|a| v[a].abs_diff(low[a]));
        (u128::from(d[2]) << (bits[0] + bits[1])) | (u128::from(d[1]) << bits[0]) | u128::from(d[0])
    };
    if key_bits <= 32 {
        let words = voxels.into_iter().map(|(v, i)| u64::pack(key(v), i)).collect();
        centroids(points, &sort_by_key::<u64>(words, key_bits), per_metre)
    } else {
        let words = voxels.into_iter().map(|(v, i)| u128::pack(key(v), i)).collect();
        centroids(points, &sort_by_key::<u128>(words, key_bits), per_metre)
    }
}

/// The centroid of every run of equal keys.
fn centroids<W: Word>(points: &[[f32; 3]], sorted: &[W], per_metre: f64) -> Vec<[f32; 3]> {
    let mut out = Vec::with_capacity(sorted.len() / 2);
    for run in sorted.chunk_by(|a, b| a.key() == b.key()) {
        let first = points[run[0].index() as usize];
        if run.len() == 1 {
            out.push(first);
            continue;
        }
        let corner = first.map(|v| floor_i64(f64::from(v) * per_metre) as f64);
        let mut sum = [0u64; 3];
        for w in run {
            let p = points[w.index() as usize];
            for a in 0..3 {
                // Each below 2^32, and there are fewer than 2^32 of them: the sum cannot overflow.
                sum[a] += ((f64::from(p[a]) * per_metre - corner[a]) * FRACTION) as u64;
            }
        }
        let scale = 1.0 / (FRACTION * run.len() as f64);
        out.push(std::array::from_fn(|a| ((corner[a] + sum[a] as f64 * scale) / per_metre) as f32));
    }
    out
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    /// Sums in f64, voxels in a tree ordered by z, y, x.
    fn naive(points: &[[f32; 3]], leaf: f32) -> Vec<[f32; 3]> {
        let mut voxels: BTreeMap<[i64; 3], Vec<[f32; 3]>> = BTreeMap::new();
        for p in points {
            let k = p.map(|v| (f64::from(v) * (1.0 / f64::from(leaf))).floor() as i64);
            voxels.entry([k[2], k[1], k[0]]).or_default().push(*p);
        }
        let mean = |ps: &Vec<[f32; 3]>, a: usize| {
            (ps.iter().map(|p| f64::from(p[a])).sum::<f64>() / ps.len() as f64) as f32
        };
        voxels.values().map(|ps| [mean(ps, 0), mean(ps, 1), mean(ps, 2)]).collect()
    }

    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![8 => -2f32..2.0, 1 => -1e3f32..1e3, 1 => -1e7f32..1e7, 1 => Just(0.2f32), 1 => Just(-0.2f32)]
    }

    fn cloud(max: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
        prop::collection::vec([coordinate(), coordinate(), coordinate()], 0..max)
    }

    proptest! {
        #[test]
        fn equals_the_naive_filter(points in cloud(200), leaf in prop_oneof![Just(0.2f32), 0.05f32..3.0]) {
            let (got, expected) = (voxel_filter(&points, leaf), naive(&points, leaf));
            prop_assert_eq!(got.len(), expected.len());
            for (g, e) in got.iter().zip(&expected) {
                for a in 0..3 {
                    prop_assert!((g[a] - e[a]).abs() <= 1e-6 + e[a].abs() * 1e-6, "{:?} {:?}", g, e);
                }
            }
        }

        #[test]
        fn any_order_gives_the_same_bits(points in cloud(200), seed in any::<u64>()) {
            let mut shuffled = points.clone();
            let mut s = seed | 1;
            for i in (1..shuffled.len()).rev() {
                s = s.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                shuffled.swap(i, (s >> 33) as usize % (i + 1));
            }
            prop_assert_eq!(voxel_filter(&points, 0.2), voxel_filter(&shuffled, 0.2));
        }
    }

    #[test]
    fn empty_and_single() {
        assert!(voxel_filter(&[], 0.2).is_empty());
        assert_eq!(
            voxel_filter(&[[1.234_567, -9.876_543, 0.000_123]], 0.2),
            [[1.234_567, -9.876_543, 0.000_123]]
        );
    }

    #[test]
    fn points_beyond_the_grid_are_left_out() {
        assert_eq!(
            voxel_filter(&[[f32::MAX, 0.0, 0.0], [1.0, 2.0, 3.0], [0.0, -1e12, 0.0]], 0.2),
            [[1.0, 2.0, 3.0]]
        );
        assert!(voxel_filter(&[[f32::MAX, f32::MIN, 0.0]], 0.2).is_empty());
    }

    #[test]
    fn the_whole_grid_is_usable() {
        let far = 4.2e8; // 2.1e9 voxels of 0.2 m: the keys need more than 32 bits
        let corners = [[far, far, far], [-far, -far, -far], [far, -far, far]];
        assert_eq!(voxel_filter(&corners, 0.2), [corners[1], corners[2], corners[0]]);
    }
}

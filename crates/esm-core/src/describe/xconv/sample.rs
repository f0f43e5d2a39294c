//! From a segment to the network's input: 256 points, zero mean, unit variance (paper, section III).

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::architecture::INPUT_POINTS;
use crate::segment::Segment;

/// Floor of the standard deviation, metres.
const LEAST_SIGMA: f64 = 1e-3;

/// The 256 sampled points, normalised. The same points in the same order give the same sample, wherever the segment stands
/// in its batch and whatever the seed of anything else. `turned` as in [`normalise`]; `order` is working memory.
pub(super) fn sample(segment: &Segment, turned: bool, order: &mut Vec<u32>, out: &mut Vec<[f32; 3]>) {
    let points = &segment.points;
    out.clear();
    if points.is_empty() {
        out.resize(INPUT_POINTS, [0.0; 3]);
        return;
    }
    draw(points.len(), hash(points), order);
    out.extend(order[..INPUT_POINTS].iter().map(|n| points[*n as usize]));
    normalise(out, turned);
}

/// Draws 256 of `n` > 0 points without replacement (Fisher and Yates); of fewer, each once in random order, and then some
/// again. The first entries of `order` are the answer.
fn draw(n: usize, seed: u64, order: &mut Vec<u32>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    order.clear();
    order.extend(0..n as u32);
    for place in 0..n.min(INPUT_POINTS) {
        order.swap(place, place + below(&mut random, n - place));
    }
    while order.len() < INPUT_POINTS {
        let again = order[below(&mut random, n)];
        order.push(again);
    }
}

/// Takes the mean off and divides by the standard deviation over all coordinates, so that proportions stay. Where `turned`,
/// turns the points about the up axis: x becomes the horizontal direction of largest variance, seen so that its third
/// moment is not negative, and the same thing enters the same way from wherever it is met.
pub(super) fn normalise(points: &mut [[f32; 3]], turned: bool) {
    let n = points.len().max(1) as f64;
    let mut mean = [0f64; 3];
    for p in points.iter() {
        mean.iter_mut().zip(p).for_each(|(m, v)| *m += f64::from(*v));
    }
    let mean = mean.map(|m| m / n);
    let squares = |p: &[f32; 3]| (0..3).map(|a| (f64::from(p[a]) - mean[a]).powi(2)).sum::<f64>();
    let sigma = (points.iter().map(squares).sum::<f64>() / (3.0 * n)).sqrt().max(LEAST_SIGMA);
    let [c, s] = if turned { direction(points, mean) } else { [1.0, 0.0] };
    for p in points.iter_mut() {
        let [x, y, z] = std::array::from_fn(|a| f64::from(p[a]) - mean[a]);
        *p = [c * x + s * y, c * y - s * x, z].map(|v| (v / sigma) as f32);
    }
}

/// Cosine and sine of the angle from the x axis to the horizontal direction that x becomes.
fn direction(points: &[[f32; 3]], mean: [f64; 3]) -> [f64; 2] {
    let centred = || points.iter().map(|p| [0, 1].map(|a| f64::from(p[a]) - mean[a]));
    let [xx, xy, yy] = centred().fold([0.0; 3], |[xx, xy, yy], [x, y]| [xx + x * x, xy + x * y, yy + y * y]);
    let (s, c) = (0.5 * f64::atan2(2.0 * xy, xx - yy)).sin_cos();
    let third: f64 = centred().map(|[x, y]| (c * x + s * y).powi(3)).sum();
    if third < 0.0 { [-c, -s] } else { [c, s] }
}

/// The generator's seed: FNV-1a over the little-endian bits of the points relative to the first one, rounded to 1/64 m, so that
/// a segment that stands elsewhere in its frame gives the same sample.
fn hash(points: &[[f32; 3]]) -> u64 {
    let Some(first) = points.first() else { return 0 };
    let mut hash = 0xCBF2_9CE4_8422_2325u64;
    for p in points {
        for a in 0..3 {
            let step = rounded((p[a] - first[a]) * 64.0);
            for byte in step.to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01B3);
            }
        }
    }
    hash
}

/// The nearest whole number, halves away from zero, as `f32::round` has it, which is a call where the processor is not known to have
/// an instruction for it.
fn rounded(x: f32) -> i32 {
    let whole = x as i32;
    // Exact: where x has a broken part it is below 2^23.
    let rest = x - whole as f32;
    whole.saturating_add(i32::from(rest >= 0.5) - i32::from(rest <= -0.5))
}

/// Uniform in 0..n, n > 0 (Lemire, "Fast random integer generation in an interval", 2019, without the rejection: the bias
/// is below n / 2^64).
fn below(random: &mut ChaCha8Rng, n: usize) -> usize {
    ((u128::from(random.next_u64()) * n as u128) >> 64) as usize
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    fn cloud(n: usize) -> Segment {
        let point =
            |i: usize| [(i % 17) as f32 * 0.2, (i / 17 % 13) as f32 * 0.2, (i / 221) as f32 * 0.2 + 40.0];
        Segment::from_points((0..n).map(point).collect()).unwrap()
    }

    fn bits(points: &[[f32; 3]]) -> Vec<[u32; 3]> {
        points.iter().map(|p| p.map(f32::to_bits)).collect()
    }

    #[test]
    fn large_segments_give_256_different_points_and_small_ones_each_once() {
        for (n, different) in [(5000, 256), (256, 256), (100, 100), (40, 40), (1, 1)] {
            let (mut order, mut out) = (Vec::new(), Vec::new());
            sample(&cloud(n), false, &mut order, &mut out);
            let first = bits(&out);
            assert_eq!(out.len(), INPUT_POINTS);
            assert_eq!(first.iter().collect::<BTreeSet<_>>().len(), different);
            assert_eq!(
                first[..different].iter().collect::<BTreeSet<_>>().len(),
                different,
                "each once first"
            );
            sample(&cloud(n), false, &mut order, &mut out);
            assert_eq!(first, bits(&out));
        }
    }

    /// Every point is as likely as any other in every place: inner down-sampling keeps the first places.
    #[test]
    fn sampling_is_uniform() {
        let (mut counts, mut order) = ([[0u32; 4]; 4], Vec::new());
        for seed in 0..500 {
            draw(1000, seed, &mut order);
            for (place, n) in order[..INPUT_POINTS].iter().enumerate() {
                counts[place / 64][*n as usize / 250] += 1;
            }
        }
        // 8,000 expected in each, with a deviation below 78.
        assert!(counts.iter().flatten().all(|c| (7610..8390).contains(c)), "{counts:?}");
    }

    #[test]
    fn mean_is_zero_and_variance_one() {
        let (mut order, mut out) = (Vec::new(), Vec::new());
        for turned in [false, true] {
            sample(&cloud(3000), turned, &mut order, &mut out);
            let n = out.len() as f64;
            let sum = |f: &dyn Fn(&[f32; 3]) -> f64| out.iter().map(f).sum::<f64>();
            for a in 0..3 {
                assert!((sum(&|p| f64::from(p[a])) / n).abs() < 1e-6);
            }
            let variance = sum(&|p| p.iter().map(|v| f64::from(*v).powi(2)).sum()) / (3.0 * n);
            assert!((variance - 1.0).abs() < 1e-6);
        }
    }

    /// Whatever its heading, a thing that is turned into its own pose looks the same, also one that is met from the other side.
    #[test]
    fn headings_do_not_matter_to_what_is_turned() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut unit = || below(&mut random, 1 << 20) as f32 / (1 << 20) as f32;
        // Longer than wide, and fuller at one end.
        let thing: Vec<[f32; 3]> = (0..256).map(|_| [4.0 * unit() * unit(), unit(), 2.0 * unit()]).collect();
        let mut first = thing.clone();
        normalise(&mut first, true);
        for degrees in [0.0f32, 30.0, 77.0, 90.0, 135.0, 180.0, 260.0, 359.0] {
            let (s, c) = degrees.to_radians().sin_cos();
            let mut other: Vec<[f32; 3]> =
                thing.iter().map(|p| [c * p[0] - s * p[1], s * p[0] + c * p[1], p[2]]).collect();
            normalise(&mut other, true);
            let off = first.iter().flatten().zip(other.iter().flatten()).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 1e-4, "{degrees} degrees");
        }
    }

    #[test]
    fn rounding_is_that_of_the_library() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let any = (0..1_000_000).map(|_| f32::from_bits(random.next_u32()));
        let near = (-40..40).flat_map(|n| {
            [-1, 0, 1].map(|d| f32::from_bits((n as f32 / 2.0).to_bits().wrapping_add_signed(d)))
        });
        let ends = [f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, 8_388_607.5, 2_147_483_520.0];
        for x in any.chain(near).chain(ends).filter(|x| !x.is_nan()) {
            assert_eq!(rounded(x), x.round() as i32, "{x}");
        }
    }

    #[test]
    fn a_place_far_from_the_origin_gives_the_same_sample() {
        let (mut order, mut here, mut there) = (Vec::new(), Vec::new(), Vec::new());
        let moved = cloud(700).points.iter().map(|p| [p[0] + 512.0, p[1] - 256.0, p[2]]).collect();
        sample(&cloud(700), true, &mut order, &mut here);
        sample(&Segment::from_points(moved).unwrap(), true, &mut order, &mut there);
        for (a, b) in here.iter().zip(&there) {
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3), "{a:?} {b:?}");
        }
    }
}

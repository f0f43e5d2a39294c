//! What the machine can do at most, measured: multiply-adds and bytes a second of one thread.

use std::hint::black_box;
use std::time::Instant;

use pulp::{Arch, Simd, WithSimd};

/// Independent sums: enough for two units of a latency of five.
const SUMS: usize = 12;
/// Rounds of one measurement, about 0.2 ms.
const ROUNDS: usize = 50_000;

struct Peak;

impl WithSimd for Peak {
    /// Floating-point operations, and a number that depends on them all.
    type Output = (f64, f32);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (f64, f32) {
        let (a, b) = (simd.splat_f32s(black_box(0.999)), simd.splat_f32s(black_box(1e-3)));
        let mut sums = [simd.splat_f32s(1.0); SUMS];
        for _ in 0..ROUNDS {
            // A plain loop: what closures hold does not stay in registers.
            #[allow(clippy::needless_range_loop)]
            for n in 0..SUMS {
                sums[n] = simd.mul_add_e_f32s(a, sums[n], b);
            }
        }
        let all = sums.into_iter().map(|s| simd.reduce_sum_f32s(s)).sum();
        ((2 * ROUNDS * SUMS * S::F32_LANES) as f64, all)
    }
}

struct Sum<'a>(&'a [f32]);

impl WithSimd for Sum<'_> {
    type Output = f32;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f32 {
        let mut sums = [simd.splat_f32s(0.0); 8];
        let chunks = S::as_simd_f32s(self.0).0.as_chunks::<8>().0;
        #[allow(clippy::needless_range_loop)]
        for at in 0..chunks.len() {
            for n in 0..8 {
                sums[n] = simd.add_f32s(sums[n], chunks[at][n]);
            }
        }
        sums.into_iter().map(|s| simd.reduce_sum_f32s(s)).sum()
    }
}

/// Floating-point operations a second, f32, two a fused multiply-add, in the processor's widest vectors: the best of many short
/// measurements.
pub fn peak_flops() -> f64 {
    let arch = Arch::new();
    let once = || {
        let start = Instant::now();
        let (operations, sum) = arch.dispatch(Peak);
        black_box(sum);
        operations / start.elapsed().as_secs_f64()
    };
    (0..1000).map(|_| once()).fold(0.0, f64::max)
}

/// Bytes a second that are read from memory, far more of them than caches hold.
pub fn bandwidth() -> f64 {
    let numbers = vec![1f32; 64 << 20];
    let arch = Arch::new();
    let once = || {
        let start = Instant::now();
        black_box(arch.dispatch(Sum(&numbers)));
        (4 * numbers.len()) as f64 / start.elapsed().as_secs_f64()
    };
    (0..12).map(|_| once()).fold(0.0, f64::max)
}

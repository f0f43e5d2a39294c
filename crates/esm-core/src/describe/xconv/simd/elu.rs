//! ELU(x) = x for x > 0, else exp(x) - 1.

use pulp::Simd;

/// 1.5 * 2^23: added to a number of less than 2^22 it leaves the nearest whole number in the lowest bits.
const TO_WHOLE: f32 = 12_582_912.0;

/// ELU of a vector, to within 2e-7 of the exact value: exp by reduction to [-ln 2 / 2, ln 2 / 2] and a polynomial of degree
/// 6 (the Taylor series, whose next term is below 1.2e-7 there), times a power of two put together from its bits.
#[inline(always)]
pub(super) fn elu<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // exp(-87) is the smallest that is not subnormal; below it the result is -1 to the last bit anyway.
    let low = simd.max_f32s(simd.min_f32s(x, simd.splat_f32s(0.0)), simd.splat_f32s(-87.0));
    let whole =
        simd.mul_add_e_f32s(low, simd.splat_f32s(std::f32::consts::LOG2_E), simd.splat_f32s(TO_WHOLE));
    let n = simd.sub_f32s(whole, simd.splat_f32s(TO_WHOLE));
    // ln 2 in two parts, so that n ln 2 is exact where it is taken off.
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(-0.693_359_4), low);
    let r = simd.mul_add_e_f32s(n, simd.splat_f32s(2.121_944_4e-4), r);
    let mut p = simd.splat_f32s(1.0 / 720.0);
    for c in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        p = simd.mul_add_e_f32s(p, r, simd.splat_f32s(c));
    }
    let exponent = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(whole), simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(simd.add_u32s(exponent, simd.splat_u32s(127 << 23)));
    let below = simd.mul_add_e_f32s(p, power, simd.splat_f32s(-1.0));
    simd.select_f32s(simd.greater_than_f32s(x, simd.splat_f32s(0.0)), x, below)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::{Arch, WithSimd};

    struct All<'a>(&'a mut [f32]);
    impl WithSimd for All<'_> {
        type Output = ();
        fn with_simd<S: Simd>(self, simd: S) {
            for v in S::as_mut_simd_f32s(self.0).0 {
                *v = elu(simd, *v);
            }
        }
    }

    #[test]
    fn elu_is_exact_to_two_ten_millionths() {
        let x: Vec<f32> = (0..1_048_576).map(|i| -100.0 + 104.0 * i as f32 / 1_048_576.0).collect();
        let mut y = x.clone();
        Arch::new().dispatch(All(&mut y));
        for (x, y) in x.iter().zip(&y) {
            let want = if *x > 0.0 { f64::from(*x) } else { f64::from(*x).exp_m1() };
            assert!((f64::from(*y) - want).abs() < 2e-7, "ELU({x}) = {y}, not {want}");
        }
        let mut ends = [0.0, -0.0, 1e-30, -1e-30, f32::MIN, f32::MAX, f32::NEG_INFINITY, f32::INFINITY];
        let mut wide = ends.repeat(2);
        Arch::new().dispatch(All(&mut wide));
        ends.copy_from_slice(&wide[..8]);
        assert_eq!(ends, [0.0, 0.0, 1e-30, 0.0, -1.0, f32::MAX, -1.0, f32::INFINITY]);
    }
}

//! ELU(x) = x for x > 0, else exp(x) - 1, of numbers in units of ln 2.
//!
//! With t = x / ln 2 the exponential is 2^t, which needs no multiplication to be split into its whole and its broken part, and
//! ELU(x) = t ln 2 for t > 0. So the weights of a layer are divided by ln 2 when they are packed, and what ELU gives stays
//! in units of ln 2 until the weights after it, or the batch norm, take them off again.

use pulp::Simd;

/// What one stands for in the numbers that go into a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unit {
    /// 1.
    One,
    /// ln 2: what [`elu`] gives.
    Ln2,
}

impl Unit {
    /// What a weight is multiplied by so that numbers in this unit become numbers in `to`.
    pub(crate) fn factor(self, to: Unit) -> f64 {
        match (self, to) {
            (Unit::One, Unit::Ln2) => std::f64::consts::LOG2_E,
            (Unit::Ln2, Unit::One) => std::f64::consts::LN_2,
            _ => 1.0,
        }
    }
}

/// 1.5 * 2^23: added to a number of less than 2^22 it leaves the nearest whole number in the lowest bits; and 127 more, so that
/// these are those of the exponent of a power of two.
const TO_WHOLE: f32 = 12_582_912.0 + 127.0;

/// 2^f over ln 2 for f in [-1/2, 1/2], the polynomial of degree 5 that is exact at 0 and has the least relative error, 9.2e-8.
const POWER: [f32; 5] = [
    (0.001_326_472_72 * std::f64::consts::LOG2_E) as f32,
    (0.009_671_512_64 * std::f64::consts::LOG2_E) as f32,
    (0.055_507_337_4 * std::f64::consts::LOG2_E) as f32,
    (0.240_222_421 * std::f64::consts::LOG2_E) as f32,
    (0.693_146_978 * std::f64::consts::LOG2_E) as f32,
];

/// ELU of a vector in units of ln 2, to within 2e-7 of the exact value in units of 1.
#[inline(always)]
pub(super) fn elu<S: Simd>(simd: S, t: S::f32s) -> S::f32s {
    // 2^-126 is the smallest that is not subnormal; below it the result is -1 to the last bit anyway.
    let low = simd.max_f32s(t, simd.splat_f32s(-126.0));
    let whole = simd.add_f32s(low, simd.splat_f32s(TO_WHOLE));
    let f = simd.sub_f32s(low, simd.sub_f32s(whole, simd.splat_f32s(TO_WHOLE)));
    let mut p = simd.splat_f32s(POWER[0]);
    for c in [POWER[1], POWER[2], POWER[3], POWER[4], std::f32::consts::LOG2_E] {
        p = simd.mul_add_e_f32s(p, f, simd.splat_f32s(c));
    }
    let bits = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(whole), simd.splat_u32s(23));
    let power = simd.transmute_f32s_u32s(bits);
    let below = simd.mul_add_e_f32s(p, power, simd.splat_f32s(-std::f32::consts::LOG2_E));
    // Of t > 0 `below` is nonsense, and not taken.
    simd.select_f32s(simd.greater_than_f32s(t, simd.splat_f32s(0.0)), t, below)
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
        let ln2 = std::f64::consts::LN_2;
        let t: Vec<f32> = (0..1_048_576).map(|i| -140.0 + 144.0 * i as f32 / 1_048_576.0).collect();
        let mut y = t.clone();
        Arch::new().dispatch(All(&mut y));
        for (t, y) in t.iter().zip(&y) {
            let x = f64::from(*t) * ln2;
            let want = if x > 0.0 { x } else { x.exp_m1() };
            assert!((f64::from(*y) * ln2 - want).abs() < 2e-7, "ELU({x}) = {y}, not {want}");
        }
        let mut ends = [0.0, -0.0, 1e-30, -1e-30, f32::MIN, f32::MAX, f32::NEG_INFINITY, f32::INFINITY];
        let mut wide = ends.repeat(2);
        Arch::new().dispatch(All(&mut wide));
        ends.copy_from_slice(&wide[..8]);
        let least = -std::f32::consts::LOG2_E;
        assert_eq!(ends, [0.0, 0.0, 1e-30, 0.0, least, f32::MAX, least, f32::INFINITY]);
    }
}

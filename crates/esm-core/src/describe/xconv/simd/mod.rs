//! The network's arithmetic on the widest vectors the processor has, chosen at run time by pulp: AVX-512, AVX2 with FMA,
//! NEON, or plain code. Weights are packed once for that width.

// Kernels are plain loops over indices: iterators and closures are compiled on their own and do not take on the processor's
// features, which costs a factor of three.
#![allow(clippy::needless_range_loop)]

mod aligned;
mod elu;
mod mix;
mod rows;
mod sorted;
mod sum;
mod transform;

pub(super) use aligned::Aligned;
pub(super) use elu::Unit;
pub(super) use mix::{Mix, MixPart, MixWeights};
pub(super) use rows::{Rows, RowsWeights};
pub(super) use sorted::{INDEX, Lowest, kept};
pub(super) use sum::Sum;
pub(super) use transform::{Transform, TransformWeights, WHOLE};

use pulp::{Arch, Simd, WithSimd};

/// f32 numbers in a vector of the processor.
pub(super) fn lanes(arch: Arch) -> usize {
    struct Lanes;
    impl WithSimd for Lanes {
        type Output = usize;
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::F32_LANES
        }
    }
    arch.dispatch(Lanes)
}

/// Vector registers of the processor.
pub(super) fn registers(arch: Arch) -> usize {
    struct Registers;
    impl WithSimd for Registers {
        type Output = usize;
        fn with_simd<S: Simd>(self, _: S) -> usize {
            S::REGISTER_COUNT
        }
    }
    arch.dispatch(Registers)
}

/// `n` rounded up to whole vectors.
pub(super) fn padded(n: usize, lanes: usize) -> usize {
    n.next_multiple_of(lanes)
}

/// A slice as arrays of `N` vectors.
#[inline(always)]
fn arrays<S: Simd, const N: usize>(slice: &[f32]) -> &[[S::f32s; N]] {
    S::as_simd_f32s(slice).0.as_chunks().0
}

/// The same to write to.
#[inline(always)]
fn arrays_mut<S: Simd, const N: usize>(slice: &mut [f32]) -> &mut [[S::f32s; N]] {
    S::as_mut_simd_f32s(slice).0.as_chunks_mut().0
}

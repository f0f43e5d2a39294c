//! The X-transform's products: vectors hold points, and weights are broadcast.
//!
//! Every point has a small matrix of its own here, so nothing is shared along channels; along points it is.

use pulp::{Simd, WithSimd};

use super::elu::elu;
use super::{arrays, arrays_mut};

/// Rows of a tile: K is 8, 12 or 16.
const TILE: usize = 4;

/// `groups` independent products: output row `g * rows + r` is the sum over k of weight `(g, k, r)` times input row
/// `k * stride + g * offset`, plus a bias.
pub(crate) struct ColumnsWeights {
    rows: usize,
    inner: usize,
    stride: usize,
    offset: usize,
    /// Whether ELU follows.
    activated: bool,
    /// In blocks of [`TILE`] output rows: k, then row.
    packed: Vec<f32>,
    bias: Vec<f32>,
}

impl ColumnsWeights {
    /// `weight(g, k, r)` and `bias[g * rows + r]`; `rows` is a multiple of 4.
    pub(crate) fn pack(
        [groups, inner, rows]: [usize; 3],
        [stride, offset]: [usize; 2],
        activated: bool,
        bias: &[f64],
        weight: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let mut packed = Vec::with_capacity(groups * inner * rows);
        for g in 0..groups {
            for block in (0..rows).step_by(TILE) {
                for k in 0..inner {
                    packed.extend((block..block + TILE).map(|r| weight(g, k, r) as f32));
                }
            }
        }
        let bias = bias.iter().map(|b| *b as f32).collect();
        Self { rows, inner, stride, offset, activated, packed, bias }
    }
}

/// Runs the products for a block of points: input and output rows hold `points` numbers, whole vectors.
pub(crate) struct Columns<'a> {
    pub(crate) weights: &'a ColumnsWeights,
    pub(crate) input: &'a [f32],
    pub(crate) output: &'a mut [f32],
    pub(crate) points: usize,
}

impl WithSimd for Columns<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut first = 0;
        let wide = if S::REGISTER_COUNT >= 32 { 4 } else { 2 };
        while first < self.points {
            match ((self.points - first) / S::F32_LANES).min(wide) {
                4 => first += self.strip::<S, 4>(simd, first),
                2 | 3 => first += self.strip::<S, 2>(simd, first),
                _ => first += self.strip::<S, 1>(simd, first),
            }
        }
    }
}

impl Columns<'_> {
    /// N vectors of points from `first` on.
    #[inline(always)]
    fn strip<S: Simd, const N: usize>(&mut self, simd: S, first: usize) -> usize {
        let w = self.weights;
        let width = N * S::F32_LANES;
        let packed = w.packed.as_chunks::<TILE>().0;
        for block in 0..packed.len() / w.inner {
            let weights = &packed[block * w.inner..][..w.inner];
            let row = block * TILE;
            let start = row / w.rows * w.offset;
            let mut sums = [[simd.splat_f32s(0.0); N]; TILE];
            for r in 0..TILE {
                sums[r] = [simd.splat_f32s(w.bias[row + r]); N];
            }
            for k in 0..weights.len() {
                let at = (start + k * w.stride) * self.points + first;
                let x = &arrays::<S, N>(&self.input[at..at + width])[0];
                for r in 0..TILE {
                    let w = simd.splat_f32s(weights[k][r]);
                    for n in 0..N {
                        sums[r][n] = simd.mul_add_e_f32s(w, x[n], sums[r][n]);
                    }
                }
            }
            for r in 0..TILE {
                let at = (row + r) * self.points + first;
                let out = &mut arrays_mut::<S, N>(&mut self.output[at..at + width])[0];
                for n in 0..N {
                    out[n] = if w.activated { elu(simd, sums[r][n]) } else { sums[r][n] };
                }
            }
        }
        width
    }
}

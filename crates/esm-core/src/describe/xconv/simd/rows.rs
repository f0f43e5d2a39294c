//! Dense layers over rows of features: vectors hold output channels.

use pulp::{Simd, WithSimd};

use super::elu::{Unit, elu};
use super::{Aligned, arrays, arrays_mut, padded};

/// A dense layer `y = ELU(x W + bias)`, or `y = ELU(x W + bias) * scale + shift`, packed in panels of one or two vectors of
/// columns.
pub(crate) struct RowsWeights {
    inputs: usize,
    /// Columns, whole vectors.
    pub(crate) outputs: usize,
    /// Vectors a panel.
    panel: usize,
    packed: Aligned,
    /// In units of ln 2.
    pub(crate) bias: Aligned,
    norm: Option<[Aligned; 2]>,
}

impl RowsWeights {
    /// Packs a row-major `inputs` x `outputs` matrix for inputs in a unit, its bias, and the scale and shift of its batch norm.
    /// Without these what comes out is in units of ln 2.
    pub(crate) fn pack(
        matrix: &[f64],
        unit: Unit,
        bias: &[f64],
        norm: Option<[&[f64]; 2]>,
        lanes: usize,
    ) -> Self {
        let outputs = bias.len();
        let inputs = matrix.len() / outputs;
        let wide = padded(outputs, lanes);
        let panel = if (wide / lanes).is_multiple_of(2) { 2 } else { 1 };
        let factor = unit.factor(Unit::Ln2);
        let mut packed = Vec::with_capacity(inputs * wide);
        for first in (0..wide).step_by(panel * lanes) {
            for row in matrix.chunks_exact(outputs) {
                packed.extend(
                    (first..first + panel * lanes)
                        .map(|c| (row.get(c).copied().unwrap_or(0.0) * factor) as f32),
                );
            }
        }
        let vector = |v: &[f64], factor: f64| {
            let mut v: Vec<f32> = v.iter().map(|v| (*v * factor) as f32).collect();
            v.resize(wide, 0.0);
            Aligned::from(v)
        };
        let norm =
            norm.map(|[scale, shift]| [vector(scale, Unit::Ln2.factor(Unit::One)), vector(shift, 1.0)]);
        let bias = vector(bias, Unit::One.factor(Unit::Ln2));
        Self { inputs, outputs: wide, panel, packed: packed.into(), bias, norm }
    }
}

/// Runs a dense layer over `count` rows.
pub(crate) struct Rows<'a> {
    pub(crate) weights: &'a RowsWeights,
    /// Added before the activation, one number a column, in units of ln 2; the layer's own or one for this batch.
    pub(crate) bias: &'a [f32],
    pub(crate) input: &'a [f32],
    pub(crate) input_pitch: usize,
    pub(crate) output: &'a mut [f32],
    pub(crate) output_pitch: usize,
    pub(crate) count: usize,
}

impl WithSimd for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.weights.panel, S::REGISTER_COUNT >= 32) {
            (2, true) => self.panels::<S, 8, 2>(simd),
            (2, false) => self.panels::<S, 4, 2>(simd),
            _ => self.panels::<S, 8, 1>(simd),
        }
    }
}

impl Rows<'_> {
    #[inline(always)]
    fn panels<S: Simd, const R: usize, const N: usize>(mut self, simd: S) {
        let width = N * S::F32_LANES;
        let panels = self.weights.packed.chunks_exact(self.weights.inputs * width);
        for (n, panel) in panels.enumerate() {
            let first = n * width;
            let mut row = 0;
            while row + R <= self.count {
                self.tile::<S, R, N>(simd, row, first, arrays::<S, N>(panel));
                row += R;
            }
            while row < self.count {
                self.tile::<S, 1, N>(simd, row, first, arrays::<S, N>(panel));
                row += 1;
            }
        }
    }

    /// R rows by N vectors of columns.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const N: usize>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
        panel: &[[S::f32s; N]],
    ) {
        let lanes = S::F32_LANES;
        let wide = column + N * lanes;
        let mut inputs: [&[f32]; R] = [&[]; R];
        for r in 0..R {
            inputs[r] = &self.input[(row + r) * self.input_pitch..][..panel.len()];
        }
        let mut sums = [arrays::<S, N>(&self.bias[column..wide])[0]; R];
        for k in 0..panel.len() {
            for r in 0..R {
                let x = simd.splat_f32s(inputs[r][k]);
                for n in 0..N {
                    sums[r][n] = simd.mul_add_e_f32s(x, panel[k][n], sums[r][n]);
                }
            }
        }
        for r in 0..R {
            for n in 0..N {
                sums[r][n] = elu(simd, sums[r][n]);
            }
        }
        if let Some([scale, shift]) = &self.weights.norm {
            let scale = arrays::<S, N>(&scale[column..wide])[0];
            let shift = arrays::<S, N>(&shift[column..wide])[0];
            for r in 0..R {
                for n in 0..N {
                    sums[r][n] = simd.mul_add_e_f32s(sums[r][n], scale[n], shift[n]);
                }
            }
        }
        for r in 0..R {
            let at = (row + r) * self.output_pitch + column;
            arrays_mut::<S, N>(&mut self.output[at..at + N * lanes])[0] = sums[r];
        }
    }
}

//! 3-D convolutions of 3 x 3 x 3 cells on channels-last grids, on the widest vectors the processor has.
//!
//! Most of a segment's grid is empty, and where it is empty a layer answers what it answers to an empty grid. So what is kept
//! of a grid is its difference from that ([`Layer::empty`]), columns along z that do not differ are skipped, and the sums start
//! from the answer to the empty grid. This is the same arithmetic, less what multiplies zeros.

// Kernels are plain loops over indices: iterators and closures are compiled on their own and do not take on the processor's
// features, which costs a factor of three.
#![allow(clippy::needless_range_loop)]

use pulp::{Arch, Simd, WithSimd};

/// Rows (cells along z) and vectors of output channels of a tile: its sums stay in registers.
const ROWS: usize = 4;

/// A grid whose border of one cell is zero, and which of its columns along z hold anything.
pub(super) struct Padded {
    pub(super) cells: [usize; 3],
    pub(super) channels: usize,
    pub(super) values: Vec<f32>,
    pub(super) busy: Vec<bool>,
}

impl Padded {
    pub(super) fn new(cells: [usize; 3], channels: usize) -> Self {
        let [x, y, z] = cells.map(|n| n + 2);
        Self { cells, channels, values: vec![0.0; x * y * z * channels], busy: vec![false; x * y] }
    }

    /// Number of the column of a cell (x, y).
    fn column(&self, x: usize, y: usize) -> usize {
        (x + 1) * (self.cells[1] + 2) + y + 1
    }

    /// Numbers a column.
    fn pitch(&self) -> usize {
        (self.cells[2] + 2) * self.channels
    }

    /// The values of a column, without the border, to be filled; and whether it differs from zero.
    pub(super) fn column_mut(&mut self, x: usize, y: usize) -> (&mut [f32], &mut bool) {
        let (column, pitch, channels) = (self.column(x, y), self.pitch(), self.channels);
        let values = &mut self.values[column * pitch..][channels..pitch - channels];
        (values, &mut self.busy[column])
    }
}

/// Weights of a layer of `inputs` to `outputs` channels.
pub(super) struct Layer {
    inputs: usize,
    pub(super) outputs: usize,
    /// Columns of a panel: channels whose sums are made together.
    width: usize,
    /// For each of the 9 neighbouring columns, for each panel, 3 `inputs` rows of `width`.
    packed: Vec<f32>,
    /// The layer's sums (before ReLU) for an empty grid: one row of `outputs` a cell.
    pub(super) empty: Vec<f32>,
}

impl Layer {
    /// Packs weights [x][y][z][input][output] of 3 x 3 x 3 cells. `nothing` is what enters where the grid is empty.
    pub(super) fn pack(weights: &[f32], bias: &[f32], nothing: &Padded, arch: Arch) -> Self {
        let (inputs, outputs) = (nothing.channels, bias.len());
        let width = arch.dispatch(Width).min(outputs);
        let mut packed = Vec::with_capacity(weights.len());
        for column in weights.chunks_exact(3 * inputs * outputs) {
            for first in (0..outputs).step_by(width) {
                column
                    .chunks_exact(outputs)
                    .for_each(|row| packed.extend_from_slice(&row[first..first + width]));
            }
        }
        let mut layer = Self { inputs, outputs, width, packed, empty: Vec::new() };
        let mut empty = bias.repeat(nothing.cells.iter().product());
        arch.dispatch(Conv { layer: &layer, input: nothing, output: &mut empty });
        layer.empty = empty;
        layer
    }
}

/// Channels of a panel on this processor.
struct Width;

impl WithSimd for Width {
    type Output = usize;
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES * vectors(S::REGISTER_COUNT)
    }
}

/// Vectors of a tile: with 4 rows as many sums as leave registers for weights and inputs.
const fn vectors(registers: usize) -> usize {
    if registers >= 32 { 4 } else { 2 }
}

/// Adds a layer's products to `output`, which holds what the sums start from.
pub(super) struct Conv<'a> {
    pub(super) layer: &'a Layer,
    pub(super) input: &'a Padded,
    pub(super) output: &'a mut [f32],
}

impl WithSimd for Conv<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match vectors(S::REGISTER_COUNT) {
            4 => self.columns::<S, 4>(simd),
            _ => self.columns::<S, 2>(simd),
        }
    }
}

impl Conv<'_> {
    /// One neighbouring column after the other, so that its weights stay in the first-level cache for the whole grid.
    #[inline(always)]
    fn columns<S: Simd, const N: usize>(mut self, simd: S) {
        let [nx, ny, nz] = self.input.cells;
        let pitch = self.input.pitch();
        let share = self.layer.packed.len() / 9;
        for d in 0..9 {
            let weights = &self.layer.packed[d * share..][..share];
            for x in 0..nx {
                for y in 0..ny {
                    let column = (x + d / 3) * (ny + 2) + y + d % 3;
                    if !self.input.busy[column] {
                        continue;
                    }
                    let input = &self.input.values[column * pitch..][..pitch];
                    let mut z = 0;
                    while z < nz {
                        self.rows::<S, N>(simd, weights, input, [(x * ny + y) * nz, z]);
                        z += ROWS;
                    }
                }
            }
        }
    }

    /// Four cells of a column: row z of the input and the two above it are 3 * inputs numbers in a row.
    #[inline(always)]
    fn rows<S: Simd, const N: usize>(
        &mut self,
        simd: S,
        weights: &[f32],
        input: &[f32],
        [first, z]: [usize; 2],
    ) {
        let (inputs, outputs, width) = (self.layer.inputs, self.layer.outputs, self.layer.width);
        let length = 3 * inputs;
        let mut runs: [&[f32]; ROWS] = [&[]; ROWS];
        for r in 0..ROWS {
            runs[r] = &input[(z + r) * inputs..][..length];
        }
        let mut panel = 0;
        while panel * width < outputs {
            let packed: &[[S::f32s; N]] =
                S::as_simd_f32s(&weights[panel * length * width..][..length * width]).0.as_chunks().0;
            let mut sums = [[simd.splat_f32s(0.0); N]; ROWS];
            for k in 0..length {
                for r in 0..ROWS {
                    let x = simd.splat_f32s(runs[r][k]);
                    for n in 0..N {
                        sums[r][n] = simd.mul_add_e_f32s(x, packed[k][n], sums[r][n]);
                    }
                }
            }
            for r in 0..ROWS {
                let at = (first + z + r) * outputs + panel * width;
                let out: &mut [[S::f32s; N]] =
                    S::as_mut_simd_f32s(&mut self.output[at..at + width]).0.as_chunks_mut().0;
                for n in 0..N {
                    out[0][n] = simd.add_f32s(out[0][n], sums[r][n]);
                }
            }
            panel += 1;
        }
    }
}

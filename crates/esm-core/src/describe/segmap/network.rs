//! The encoder: conv3 32 - pool - conv3 64 - pool - conv3 64 - dense 512 - dense 64; 8.59 M parameters.

use std::path::Path;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use pulp::Arch;

use super::conv::{Conv, Layer, Padded};
use super::first::{FIRST, First, FirstLayer};
use super::grid::{Columns, GRID};
use crate::describe::tensors::Tensors;
use crate::error::Error;

/// Numbers of the descriptor.
pub(super) const DIM: usize = 64;
/// Channels of the second and the third layer.
const CHANNELS: usize = 64;
const HIDDEN: usize = 512;
/// Numbers that enter the dense layers: what the convolutions leave, and the extents.
pub(super) const FLAT: usize = CHANNELS * (GRID[0] / 4) * (GRID[1] / 4) * (GRID[2] / 4) + 3;
/// Segments that pass the dense layers together, always as many, so that a row's bits do not depend on its neighbours. Their
/// weights are 34 MB: to read them once for sixteen segments instead of for each makes them a matter of arithmetic again.
pub(super) const BLOCK: usize = 16;

const AFTER_FIRST: [usize; 3] = [GRID[0] / 2, GRID[1] / 2, GRID[2] / 2];
const AFTER_SECOND: [usize; 3] = [GRID[0] / 4, GRID[1] / 4, GRID[2] / 4];

/// The weights, ready for this processor.
pub(super) struct Network {
    first: FirstLayer,
    second: Layer,
    /// What the second layer answers to an empty grid, pooled and past ReLU.
    second_empty: Vec<f32>,
    third: Layer,
    dense1: Vec<f32>,
    dense1_bias: Vec<f32>,
    dense2: Vec<f32>,
    dense2_bias: Vec<f32>,
    scale: Vec<f32>,
    shift: Vec<f32>,
    arch: Arch,
}

/// Working memory of one thread.
pub(super) struct Workspace {
    pub(super) columns: Columns,
    after_first: Padded,
    second: Vec<f32>,
    after_second: Padded,
}

impl Network {
    /// Takes the weights from an opened file.
    ///
    /// # Errors
    /// [`Error::WeightsFile`].
    pub(super) fn load(bytes: &[u8], path: &Path, arch: Arch) -> Result<Self, Error> {
        let mut file = Tensors::parse(bytes, path, "segmap-cnn")?;
        file.expect("grid", "32,32,16")?;
        file.expect("channels", "32,64,64")?;
        file.expect("normalisation", "mean,turn,fit=3.2x3.2x1.6,centre=mean")?;
        let of = |file: &mut Tensors<'_>, name: &str, shape: &[usize]| -> Result<[Vec<f32>; 2], Error> {
            let outputs = &shape[shape.len() - 1..];
            Ok([file.take(&format!("{name}.weight"), shape)?, file.take(&format!("{name}.bias"), outputs)?])
        };
        let [weights, bias] = of(&mut file, "conv1", &[3, 3, 3, 1, FIRST])?;
        let mut first = FirstLayer { weights: weights.as_chunks().0.to_vec(), bias: [0.0; FIRST] };
        first.bias.copy_from_slice(&bias);
        let mut nothing = Padded::new(AFTER_FIRST, FIRST);
        fill(&mut nothing, |_, out| out.copy_from_slice(&first.empty()));
        let [weights, bias] = of(&mut file, "conv2", &[3, 3, 3, FIRST, CHANNELS])?;
        let second = Layer::pack(&weights, &bias, &nothing, arch);
        let mut second_empty = vec![0.0; AFTER_SECOND.iter().product::<usize>() * CHANNELS];
        pool(&second.empty, &mut second_empty);
        let mut nothing = Padded::new(AFTER_SECOND, CHANNELS);
        fill(&mut nothing, |cell, out| out.copy_from_slice(&second_empty[cell * CHANNELS..][..CHANNELS]));
        let [weights, bias] = of(&mut file, "conv3", &[3, 3, 3, CHANNELS, CHANNELS])?;
        let third = Layer::pack(&weights, &bias, &nothing, arch);
        let [dense1, dense1_bias] = of(&mut file, "dense1", &[FLAT, HIDDEN])?;
        let [dense2, dense2_bias] = of(&mut file, "dense2", &[HIDDEN, DIM])?;
        let scale = file.take("bn2.scale", &[DIM])?;
        let shift = file.take("bn2.shift", &[DIM])?;
        file.finish()?;
        Ok(Self {
            first,
            second,
            second_empty,
            third,
            dense1,
            dense1_bias,
            dense2,
            dense2_bias,
            scale,
            shift,
            arch,
        })
    }

    pub(super) fn workspace(&self) -> Workspace {
        Workspace {
            columns: [0; GRID[0] * GRID[1]],
            after_first: Padded::new(AFTER_FIRST, FIRST),
            second: Vec::new(),
            after_second: Padded::new(AFTER_SECOND, CHANNELS),
        }
    }

    /// The convolutions: the occupied cells of `workspace.columns` -> [`FLAT`] numbers, of which the last three are the
    /// extents in metres.
    pub(super) fn convolve(&self, workspace: &mut Workspace, extents: [f32; 3], flat: &mut [f32]) {
        let Workspace { columns, after_first, second, after_second } = workspace;
        self.arch.dispatch(First { layer: &self.first, columns, output: after_first });
        second.clone_from(&self.second.empty);
        self.arch.dispatch(Conv { layer: &self.second, input: after_first, output: second });
        let (values, sizes) = flat.split_at_mut(FLAT - 3);
        // The pooled grid lies where the third layer's answer will be.
        pool(second, values);
        fill(after_second, |cell, out| {
            let (at, empty) = (&values[cell * CHANNELS..], &self.second_empty[cell * CHANNELS..]);
            out.iter_mut().zip(at).zip(empty).for_each(|((out, v), e)| *out = v - e);
        });
        values.copy_from_slice(&self.third.empty);
        self.arch.dispatch(Conv { layer: &self.third, input: after_second, output: values });
        values.iter_mut().for_each(|v| *v = v.max(0.0));
        sizes.copy_from_slice(&extents);
    }

    /// The dense layers of [`BLOCK`] segments: rows of [`FLAT`] numbers -> rows of [`DIM`].
    pub(super) fn connect(&self, flat: &[f32], out: &mut [f32]) {
        let mut hidden = self.dense1_bias.repeat(BLOCK);
        matmul(
            MatMut::from_column_major_slice_mut(&mut hidden, HIDDEN, BLOCK),
            Accum::Add,
            MatRef::from_column_major_slice(&self.dense1, HIDDEN, FLAT),
            MatRef::from_column_major_slice(flat, FLAT, BLOCK),
            1.0,
            Par::Seq,
        );
        for (hidden, out) in hidden.chunks_exact(HIDDEN).zip(out.chunks_exact_mut(DIM)) {
            let mut sums = [0f32; DIM];
            sums.copy_from_slice(&self.dense2_bias);
            for (h, row) in hidden.iter().zip(self.dense2.as_chunks::<DIM>().0) {
                let h = h.max(0.0);
                sums.iter_mut().zip(row).for_each(|(s, w)| *s += h * w);
            }
            for (n, out) in out.iter_mut().enumerate() {
                *out = sums[n].max(0.0) * self.scale[n] + self.shift[n];
            }
        }
    }
}

/// Fills a padded grid cell by cell (numbered x, y, z) and notes which columns are not zero.
fn fill(grid: &mut Padded, cell: impl Fn(usize, &mut [f32])) {
    let ([nx, ny, nz], channels) = (grid.cells, grid.channels);
    for x in 0..nx {
        for y in 0..ny {
            let (out, busy) = grid.column_mut(x, y);
            for (z, out) in out.chunks_exact_mut(channels).enumerate() {
                cell((x * ny + y) * nz + z, out);
            }
            *busy = out.iter().any(|v| *v != 0.0);
        }
    }
}

/// Largest of 2 x 2 x 2 cells of the second layer's grid, and ReLU.
fn pool(values: &[f32], out: &mut [f32]) {
    let [_, ny, nz] = AFTER_FIRST;
    let [_, my, mz] = AFTER_SECOND;
    for (cell, out) in out.chunks_exact_mut(CHANNELS).enumerate() {
        let [x, y, z] = [cell / (my * mz), cell / mz % my, cell % mz].map(|n| 2 * n);
        out.fill(0.0);
        for child in 0..8 {
            let at = ((x + child / 4) * ny + y + child / 2 % 2) * nz + z + child % 2;
            let from = &values[at * CHANNELS..][..CHANNELS];
            out.iter_mut().zip(from).for_each(|(o, v)| *o = o.max(*v));
        }
    }
}

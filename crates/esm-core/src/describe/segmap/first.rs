//! The first layer: one input channel of zeros and ones, so its sums are sums of weight rows.

#![allow(clippy::needless_range_loop)]

use pulp::{Simd, WithSimd};

use super::conv::Padded;
use super::grid::{Columns, GRID};

/// Channels of the first layer.
pub(super) const FIRST: usize = 32;

/// Weights of the first layer.
pub(super) struct FirstLayer {
    /// [x][y][z] of 3 x 3 x 3, a row of channels each.
    pub(super) weights: Vec<[f32; FIRST]>,
    pub(super) bias: [f32; FIRST],
}

impl FirstLayer {
    /// What it answers, after ReLU, where there is nothing.
    pub(super) fn empty(&self) -> [f32; FIRST] {
        self.bias.map(|v| v.max(0.0))
    }
}

/// Convolution, pooling of 2 x 2 x 2 and ReLU; `output` (16 x 16 x 8) holds the difference from an empty grid.
pub(super) struct First<'a> {
    pub(super) layer: &'a FirstLayer,
    pub(super) columns: &'a Columns,
    pub(super) output: &'a mut Padded,
}

impl WithSimd for First<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let empty = self.layer.empty();
        // Bits of the 3 x 3 columns around each column, shifted by one so that the border's cells are bits as well.
        let bits = |x: usize, y: usize| match (x.wrapping_sub(1), y.wrapping_sub(1)) {
            (x, y) if x < GRID[0] && y < GRID[1] => u32::from(self.columns[x * GRID[1] + y]) << 1,
            _ => 0,
        };
        for x in 0..GRID[0] / 2 {
            for y in 0..GRID[1] / 2 {
                let mut around = [[0u32; 4]; 4];
                let mut any = 0;
                for dx in 0..4 {
                    for dy in 0..4 {
                        around[dx][dy] = bits(2 * x + dx, 2 * y + dy);
                        any |= around[dx][dy];
                    }
                }
                let (out, busy) = self.output.column_mut(x, y);
                *busy = any != 0;
                if any == 0 {
                    out.fill(0.0);
                    continue;
                }
                let out = out.as_chunks_mut::<FIRST>().0;
                for z in 0..GRID[2] / 2 {
                    // Four cells along z reach the two of this place.
                    if any >> (2 * z) & 0b1111 == 0 {
                        out[z] = [0.0; FIRST];
                        continue;
                    }
                    let mut best = [f32::NEG_INFINITY; FIRST];
                    for cell in 0..8 {
                        let [cx, cy, cz] = [cell / 4, cell / 2 % 2, 2 * z + cell % 2];
                        let mut sums = self.layer.bias;
                        for d in 0..9 {
                            let mut three = around[cx + d / 3][cy + d % 3] >> cz & 0b111;
                            while three != 0 {
                                let row = &self.layer.weights[d * 3 + three.trailing_zeros() as usize];
                                for c in 0..FIRST {
                                    sums[c] += row[c];
                                }
                                three &= three - 1;
                            }
                        }
                        for c in 0..FIRST {
                            best[c] = best[c].max(sums[c]);
                        }
                    }
                    for c in 0..FIRST {
                        out[z][c] = best[c].max(0.0) - empty[c];
                    }
                }
            }
        }
    }
}

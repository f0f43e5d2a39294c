//! The transformed features and the depthwise convolution in one go: FX never leaves the registers.

use pulp::{Simd, WithSimd};

use super::{arrays, arrays_mut, padded};

/// Rows of FX a tile holds.
const TILE: usize = 4;

/// Depthwise weights, packed in blocks of vectors of channels.
pub(crate) struct MixWeights {
    neighbours: usize,
    multiplier: usize,
    /// Channels of the lifted coordinates and of the layer before, whole vectors each.
    pub(crate) widths: [usize; 2],
    /// For each part and each of its strips of vectors: neighbour, multiplier, channel.
    packed: [Vec<f32>; 2],
}

/// Vectors of the next strip of a part that has `left` vectors to go.
#[inline(always)]
fn strip(left: usize, registers: usize) -> usize {
    match left {
        4.. if registers >= 32 => 4,
        2.. => 2,
        _ => 1,
    }
}

impl MixWeights {
    /// `weight(k, c, q)` for channels `c` of the lifted coordinates first and of the layer before then; `widths` are
    /// their true numbers.
    pub(crate) fn pack(
        neighbours: usize,
        multiplier: usize,
        widths: [usize; 2],
        [lanes, registers]: [usize; 2],
        weight: impl Fn(usize, usize, usize) -> f64,
    ) -> Self {
        let pack = |first: usize, width: usize| {
            let vectors = padded(width, lanes) / lanes;
            let mut packed = Vec::new();
            let mut done = 0;
            while done < vectors {
                let n = strip(vectors - done, registers);
                for k in 0..neighbours {
                    for q in 0..multiplier {
                        packed.extend(
                            (done * lanes..(done + n) * lanes)
                                .map(|c| if c < width { weight(k, first + c, q) as f32 } else { 0.0 }),
                        );
                    }
                }
                done += n;
            }
            packed
        };
        let packed = [pack(0, widths[0]), pack(widths[0], widths[1])];
        Self { neighbours, multiplier, widths: widths.map(|w| padded(w, lanes)), packed }
    }

    /// Numbers a point: for each multiplier all channels, the lifted ones first.
    pub(crate) fn outputs(&self) -> usize {
        self.multiplier * (self.widths[0] + self.widths[1])
    }
}

/// Features of the neighbours: row `rows[p * neighbours + j]` of a table, or row `p * neighbours + j` without `rows`.
pub(crate) struct MixPart<'a> {
    pub(crate) table: &'a [f32],
    pub(crate) rows: Option<&'a [u16]>,
}

/// Transforms and convolves the features of `count` points.
pub(crate) struct Mix<'a> {
    pub(crate) weights: &'a MixWeights,
    /// K x K rows of `pitch` points.
    pub(crate) transform: &'a [f32],
    pub(crate) pitch: usize,
    pub(crate) parts: [MixPart<'a>; 2],
    /// [`MixWeights::outputs`] numbers a point.
    pub(crate) output: &'a mut [f32],
    pub(crate) count: usize,
}

impl WithSimd for Mix<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.weights.multiplier {
            4 => self.points::<S, 4>(simd),
            _ => self.points::<S, 2>(simd),
        }
    }
}

impl Mix<'_> {
    #[inline(always)]
    fn points<S: Simd, const M: usize>(mut self, simd: S) {
        let k = self.weights.neighbours;
        // The point's own transform, columns first, so that four rows of FX read four neighbours in memory.
        let mut own = [[0f32; TILE]; 16 * 16 / TILE];
        for p in 0..self.count {
            for tile in 0..k / TILE {
                for j in 0..k {
                    own[tile * k + j] =
                        std::array::from_fn(|r| self.transform[((tile * TILE + r) * k + j) * self.pitch + p]);
                }
            }
            let mut channel = 0;
            for part in 0..2 {
                let vectors = self.weights.widths[part] / S::F32_LANES;
                let mut done = 0;
                while done < vectors {
                    let n = strip(vectors - done, S::REGISTER_COUNT);
                    let at = [part, p, done, channel];
                    match n {
                        4 => self.strip::<S, 4, M>(simd, &own, at),
                        2 => self.strip::<S, 2, M>(simd, &own, at),
                        _ => self.strip::<S, 1, M>(simd, &own, at),
                    }
                    done += n;
                    channel += n * S::F32_LANES;
                }
            }
        }
    }

    /// N vectors of channels of one point.
    #[inline(always)]
    fn strip<S: Simd, const N: usize, const M: usize>(
        &mut self,
        simd: S,
        own: &[[f32; TILE]; 16 * 16 / TILE],
        [part, p, done, channel]: [usize; 4],
    ) {
        let (k, lanes) = (self.weights.neighbours, S::F32_LANES);
        let wide = self.weights.widths[part];
        let packed = &self.weights.packed[part][done * lanes * k * M..][..N * lanes * k * M];
        let (weights, _) = arrays::<S, N>(packed).as_chunks::<M>();
        let source = &self.parts[part];
        let mut sums = [[simd.splat_f32s(0.0); N]; M];
        for tile in 0..k / TILE {
            let transform = &own[tile * k..][..k];
            let mut mixed = [[simd.splat_f32s(0.0); N]; TILE];
            for j in 0..k {
                let row = match source.rows {
                    Some(rows) => usize::from(rows[p * k + j]),
                    None => p * k + j,
                };
                let at = row * wide + done * lanes;
                let features = &arrays::<S, N>(&source.table[at..at + N * lanes])[0];
                for r in 0..TILE {
                    let x = simd.splat_f32s(transform[j][r]);
                    for n in 0..N {
                        mixed[r][n] = simd.mul_add_e_f32s(x, features[n], mixed[r][n]);
                    }
                }
            }
            let weights = &weights[tile * TILE..][..TILE];
            for r in 0..TILE {
                for q in 0..M {
                    for n in 0..N {
                        sums[q][n] = simd.mul_add_e_f32s(mixed[r][n], weights[r][q][n], sums[q][n]);
                    }
                }
            }
        }
        let all = self.weights.widths[0] + self.weights.widths[1];
        for q in 0..M {
            let at = (p * M + q) * all + channel;
            arrays_mut::<S, N>(&mut self.output[at..at + N * lanes])[0] = sums[q];
        }
    }
}

//! The transformed features and the depthwise convolution in one go: FX never leaves the registers.

use pulp::{Simd, WithSimd};

use super::{Aligned, arrays, arrays_mut, padded};

/// Depthwise weights, packed in blocks of vectors of channels.
pub(crate) struct MixWeights {
    neighbours: usize,
    multiplier: usize,
    /// Channels of the lifted coordinates and of the layer before, whole vectors each.
    pub(crate) widths: [usize; 2],
    /// For each part and each of its strips of vectors: neighbour, multiplier, channel.
    packed: [Aligned; 2],
}

/// Vectors of the next strip of a part that has `left` vectors to go.
#[inline(always)]
fn strip(left: usize, registers: usize, multiplier: usize) -> usize {
    match left {
        4.. if registers >= 32 => 4,
        2.. if registers >= 32 || multiplier < 4 => 2,
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
                let n = strip(vectors - done, registers, multiplier);
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
            packed.into()
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
    /// For each point K rows of K numbers in whole vectors, as [`Transform`](super::Transform) leaves them.
    pub(crate) transform: &'a [f32],
    pub(crate) parts: [MixPart<'a>; 2],
    /// [`MixWeights::outputs`] numbers a point.
    pub(crate) output: &'a mut [f32],
    pub(crate) count: usize,
}

impl WithSimd for Mix<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.weights.multiplier, self.weights.neighbours) {
            (4, _) => self.points::<S, 4, 8>(simd),
            (_, 12) => self.points::<S, 2, 12>(simd),
            _ => self.points::<S, 2, 16>(simd),
        }
    }
}

impl Mix<'_> {
    #[inline(always)]
    fn points<S: Simd, const M: usize, const K: usize>(mut self, simd: S) {
        for p in 0..self.count {
            let mut channel = 0;
            for part in 0..2 {
                let wide = self.weights.widths[part];
                let mut rows = [0; K];
                for j in 0..K {
                    rows[j] = match self.parts[part].rows {
                        Some(rows) => usize::from(rows[p * K + j]) * wide,
                        None => (p * K + j) * wide,
                    };
                }
                let vectors = wide / S::F32_LANES;
                let mut done = 0;
                while done < vectors {
                    let n = strip(vectors - done, S::REGISTER_COUNT, M);
                    let at = [part, p, done, channel];
                    // About sixteen sums where the processor has registers for them, so that none waits for another.
                    match (n, S::REGISTER_COUNT >= 32) {
                        (4, _) => self.strip::<S, 4, M, K, 4>(simd, &rows, at),
                        (2, true) if K == 12 => self.strip::<S, 2, M, K, 12>(simd, &rows, at),
                        (2, true) => self.strip::<S, 2, M, K, 8>(simd, &rows, at),
                        (2, false) => self.strip::<S, 2, M, K, 4>(simd, &rows, at),
                        (_, true) => self.strip::<S, 1, M, K, K>(simd, &rows, at),
                        _ if K == 12 => self.strip::<S, 1, M, K, 6>(simd, &rows, at),
                        _ => self.strip::<S, 1, M, K, 8>(simd, &rows, at),
                    }
                    done += n;
                    channel += n * S::F32_LANES;
                }
            }
        }
    }

    /// N vectors of channels of one point, T rows of FX at a time.
    #[inline(always)]
    fn strip<S: Simd, const N: usize, const M: usize, const K: usize, const T: usize>(
        &mut self,
        simd: S,
        rows: &[usize; K],
        [part, p, done, channel]: [usize; 4],
    ) {
        let lanes = S::F32_LANES;
        let pitch = K.next_multiple_of(lanes);
        let packed = &self.weights.packed[part][done * lanes * K * M..][..N * lanes * K * M];
        let (weights, _) = arrays::<S, N>(packed).as_chunks::<M>();
        let table = self.parts[part].table;
        let mut sums = [[simd.splat_f32s(0.0); N]; M];
        for tile in 0..K / T {
            let own = &self.transform[(p * K + tile * T) * pitch..][..T * pitch];
            let mut mixed = [[simd.splat_f32s(0.0); N]; T];
            for j in 0..K {
                let at = rows[j] + done * lanes;
                let features = &arrays::<S, N>(&table[at..at + N * lanes])[0];
                for r in 0..T {
                    let x = simd.splat_f32s(own[r * pitch + j]);
                    for n in 0..N {
                        mixed[r][n] = simd.mul_add_e_f32s(x, features[n], mixed[r][n]);
                    }
                }
            }
            let weights = &weights[tile * T..][..T];
            for r in 0..T {
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

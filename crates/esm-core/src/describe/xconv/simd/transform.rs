//! The X-transform of every point: a dense layer over its neighbours' coordinates and two depthwise ones.
//!
//! Every point has a small matrix of its own here, so nothing is shared along channels; along points it is: vectors hold points,
//! and weights are broadcast. The last product turns this round, so that each point's matrix ends up in one piece.

use pulp::{Simd, WithSimd};

use super::elu::{Unit, elu};
use super::{Aligned, arrays, arrays_mut, padded};

/// Points are padded to a multiple of this many, whatever the processor.
pub(crate) const WHOLE: usize = 16;

/// Three products: X0 = ELU(local W0); X1[j] = ELU(X0[.][j] W1[j]); X2[q] = X1[.][q] W2[q].
pub(crate) struct TransformWeights {
    /// K.
    neighbours: usize,
    /// Rows that are computed together.
    tile: usize,
    /// For each column j of X0 and each tile of its rows: inputs, then rows.
    first: Vec<f32>,
    /// For each row j of X1 and each tile: inputs, then rows.
    second: Vec<f32>,
    /// [j][q].
    second_bias: Vec<f32>,
    /// For each row q of X2 and each of its vectors: inputs, then lanes.
    third: Aligned,
    /// For each row q its vectors.
    third_bias: Aligned,
}

impl TransformWeights {
    /// `first(input, i, j)`, `second(i, j, q)` and `third(j, q, r)` as the network has them; biases [j][q] and [q][r].
    pub(crate) fn pack(
        k: usize,
        [lanes, registers]: [usize; 2],
        first: impl Fn(usize, usize, usize) -> f64,
        second: impl Fn(usize, usize, usize) -> f64,
        third: impl Fn(usize, usize, usize) -> f64,
        [second_bias, third_bias]: [&[f64]; 2],
    ) -> Self {
        // Two vectors of points by so many rows fill the registers.
        let tile = match k {
            _ if registers < 32 => 4,
            12 => 12,
            _ => 8,
        };
        let to_ln2 = Unit::One.factor(Unit::Ln2);
        let mut packed = [Vec::new(), Vec::new()];
        for j in 0..k {
            for top in (0..k).step_by(tile) {
                for input in 0..3 * k {
                    packed[0].extend((top..top + tile).map(|i| (first(input, i, j) * to_ln2) as f32));
                }
                for i in 0..k {
                    // From units of ln 2 to units of ln 2.
                    packed[1].extend((top..top + tile).map(|q| second(i, j, q) as f32));
                }
            }
        }
        let [first, second] = packed;
        let wide = padded(k, lanes);
        let (mut rows, mut rows_bias) = (Vec::new(), Vec::new());
        for q in 0..k {
            for lane in (0..wide).step_by(lanes) {
                let columns = lane..lane + lanes;
                for j in 0..k {
                    let weight = |r| if r < k { third(j, q, r) * Unit::Ln2.factor(Unit::One) } else { 0.0 };
                    rows.extend(columns.clone().map(|r| weight(r) as f32));
                }
                rows_bias.extend(columns.map(|r| if r < k { third_bias[q * k + r] as f32 } else { 0.0 }));
            }
        }
        let second_bias = second_bias.iter().map(|b| (b * to_ln2) as f32).collect();
        let (third, third_bias) = (rows.into(), rows_bias.into());
        Self { neighbours: k, tile, first, second, second_bias, third, third_bias }
    }

    /// Numbers of a row of a point's matrix: K, in whole vectors.
    pub(crate) fn row(&self) -> usize {
        self.third_bias.len() / self.neighbours
    }
}

/// Computes the transforms of a block of points.
pub(crate) struct Transform<'a> {
    pub(crate) weights: &'a TransformWeights,
    /// 3 K rows (neighbour, axis) of `points` local coordinates.
    pub(crate) local: &'a [f32],
    /// A multiple of [`WHOLE`].
    pub(crate) points: usize,
    /// Room for K + K K rows of `points` numbers.
    pub(crate) work: &'a mut [f32],
    /// For each point K rows of [`TransformWeights::row`] numbers.
    pub(crate) output: &'a mut [f32],
}

impl WithSimd for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match (self.weights.neighbours, self.weights.tile) {
            (8, 8) => self.run::<S, 8, 8>(simd),
            (12, 12) => self.run::<S, 12, 12>(simd),
            (16, 8) => self.run::<S, 16, 8>(simd),
            (8, _) => self.run::<S, 8, 4>(simd),
            (12, _) => self.run::<S, 12, 4>(simd),
            _ => self.run::<S, 16, 4>(simd),
        }
    }
}

impl Transform<'_> {
    #[inline(always)]
    fn run<S: Simd, const K: usize, const T: usize>(self, simd: S) {
        let (w, points) = (self.weights, self.points);
        let (x0, x1) = self.work.split_at_mut(K * points);
        let x1 = &mut x1[..K * K * points];
        let (first, second) = (w.first.as_chunks::<T>().0, w.second.as_chunks::<T>().0);
        let bias = w.second_bias.as_chunks::<T>().0;
        for j in 0..K {
            for tile in 0..K / T {
                let at = j * (K / T) + tile;
                let rows = tile * T * points..(tile + 1) * T * points;
                let weights = &first[at * 3 * K..][..3 * K];
                columns::<S, T>(simd, weights, &[0.0; T], self.local, &mut x0[rows], points);
            }
            let own = &mut x1[j * K * points..][..K * points];
            for tile in 0..K / T {
                let at = j * (K / T) + tile;
                let rows = tile * T * points..(tile + 1) * T * points;
                columns::<S, T>(simd, &second[at * K..][..K], &bias[at], x0, &mut own[rows], points);
            }
        }
        let vectors = K.div_ceil(S::F32_LANES);
        for at in 0..K * vectors {
            let weights = &S::as_simd_f32s(&w.third).0[at * K..][..K];
            let bias = S::as_simd_f32s(&w.third_bias).0[at];
            let place = [at / vectors, at * S::F32_LANES, K * vectors * S::F32_LANES];
            let mut point = 0;
            while point < points {
                if S::REGISTER_COUNT >= 32 {
                    turned::<S, K, 16>(simd, weights, bias, x1, [points, point], self.output, place);
                    point += 16;
                } else {
                    turned::<S, K, 8>(simd, weights, bias, x1, [points, point], self.output, place);
                    point += 8;
                }
            }
        }
    }
}

/// T output rows: the sum of weights times input rows, then ELU. All rows hold `points` numbers.
#[inline(always)]
fn columns<S: Simd, const T: usize>(
    simd: S,
    weights: &[[f32; T]],
    bias: &[f32; T],
    input: &[f32],
    output: &mut [f32],
    points: usize,
) {
    let mut first = 0;
    while first + 2 * S::F32_LANES <= points {
        strip::<S, T, 2>(simd, weights, bias, input, output, [points, first]);
        first += 2 * S::F32_LANES;
    }
    if first < points {
        strip::<S, T, 1>(simd, weights, bias, input, output, [points, first]);
    }
}

/// N vectors of points from `first` on.
#[inline(always)]
fn strip<S: Simd, const T: usize, const N: usize>(
    simd: S,
    weights: &[[f32; T]],
    bias: &[f32; T],
    input: &[f32],
    output: &mut [f32],
    [points, first]: [usize; 2],
) {
    let width = N * S::F32_LANES;
    let mut sums = [[simd.splat_f32s(0.0); N]; T];
    for r in 0..T {
        sums[r] = [simd.splat_f32s(bias[r]); N];
    }
    for k in 0..weights.len() {
        let at = k * points + first;
        let x = &arrays::<S, N>(&input[at..at + width])[0];
        for r in 0..T {
            let w = simd.splat_f32s(weights[k][r]);
            for n in 0..N {
                sums[r][n] = simd.mul_add_e_f32s(w, x[n], sums[r][n]);
            }
        }
    }
    for r in 0..T {
        let at = r * points + first;
        let out = &mut arrays_mut::<S, N>(&mut output[at..at + width])[0];
        for n in 0..N {
            out[n] = elu(simd, sums[r][n]);
        }
    }
}

/// One vector of the matrices of R points: `row` of X2, from lane `at` on of the `all` of a point.
#[inline(always)]
fn turned<S: Simd, const K: usize, const R: usize>(
    simd: S,
    weights: &[S::f32s],
    bias: S::f32s,
    x1: &[f32],
    [points, point]: [usize; 2],
    output: &mut [f32],
    [row, at, all]: [usize; 3],
) {
    let mut sums = [bias; R];
    for j in 0..K {
        let x = &x1[(j * K + row) * points + point..].as_chunks::<R>().0[0];
        for r in 0..R {
            sums[r] = simd.mul_add_e_f32s(simd.splat_f32s(x[r]), weights[j], sums[r]);
        }
    }
    for r in 0..R {
        let at = (point + r) * all + at;
        arrays_mut::<S, 1>(&mut output[at..at + S::F32_LANES])[0] = [sums[r]];
    }
}

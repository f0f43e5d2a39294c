//! The network with its weights packed, and the pass of one segment through it.
//!
//! Batch norms fold exactly into the next linear step where nothing stands between: after the first lifting layer, inside
//! the X branch, and between the fully connected layers. Those of the lifted and the previous features do not, because the
//! X-transform of the input comes next; they are applied once a point. What stands between an ELU and what folds into the next
//! step is in units of ln 2 ([`Unit`]).

use std::ops::Range;

use pulp::Arch;

use super::architecture::{FC1, FC2, GLOBAL, INPUT_POINTS, LAYER_TABLE, LAYERS, Layer};
use super::neighbours::Search;
use super::parts::{Part, Probe};
use super::simd::{
    Aligned, Mix, MixPart, MixWeights, Rows, RowsWeights, Sum, Transform, TransformWeights, Unit, WHOLE,
    lanes, padded, registers,
};
use super::weights::{Header, Weights};
use crate::error::Error;

/// Points that go through a dense layer together.
const BLOCK: usize = 64;
/// Points that are mixed together: their transforms stay in the first level of cache.
const CHUNK: usize = 32;
/// Points that are lifted together.
const LIFT: usize = 8;

/// Row-major matrix times a diagonal from the left: batch norm's scale folded into the layer after it.
fn scaled(matrix: &[f64], scale: &[f64]) -> Vec<f64> {
    let columns = matrix.len() / scale.len();
    let rows = matrix.chunks_exact(columns).zip(scale);
    rows.flat_map(|(row, s)| row.iter().map(move |v| v * s)).collect()
}

/// A row of numbers times a row-major matrix: batch norm's shift folded into the layer after it.
fn through(shift: &[f64], matrix: &[f64]) -> Vec<f64> {
    let columns = matrix.len() / shift.len();
    let mut out = vec![0.0; columns];
    for (row, s) in matrix.chunks_exact(columns).zip(shift) {
        out.iter_mut().zip(row).for_each(|(o, v)| *o += s * v);
    }
    out
}

/// The weights of one X-conv layer.
struct XConv {
    lift: [RowsWeights; 2],
    transform: TransformWeights,
    mix: MixWeights,
    pointwise: RowsWeights,
}

impl XConv {
    fn take(weights: &mut Weights<'_>, n: usize, layer: &Layer, arch: Arch) -> Result<Self, Error> {
        let width = lanes(arch);
        let at = |name: &str| format!("xconv{}.{name}", n + 1);
        let Layer { neighbours: k, lift: cd, previous, multiplier: m, channels, .. } = *layer;
        let cin = cd + previous;

        let lift1 = weights.take(&at("lift1.weight"), &[3, cd])?;
        let [scale1, shift1] = weights.norm(&at("lift1"), cd)?;
        let lift2 = weights.take(&at("lift2.weight"), &[cd, cd])?;
        let [scale2, shift2] = weights.norm(&at("lift2"), cd)?;
        let lift = [
            RowsWeights::pack(&lift1, Unit::One, &vec![0.0; cd], None, width),
            RowsWeights::pack(
                &scaled(&lift2, &scale1),
                Unit::Ln2,
                &through(&shift1, &lift2),
                Some([&scale2, &shift2]),
                width,
            ),
        ];

        let x0 = weights.take(&at("x0.weight"), &[3 * k, k * k])?;
        let [scale0, shift0] = weights.norm(&at("x0"), k * k)?;
        let x1 = weights.take(&at("x1.weight"), &[k, k, k])?;
        let [scale1, shift1] = weights.norm(&at("x1"), k * k)?;
        let x2 = weights.take(&at("x2.weight"), &[k, k, k])?;
        let [scale2, shift2] = weights.norm(&at("x2"), k * k)?;
        // X0[i][j] is channel i k + j, and x1 is indexed [i][j][q]; X1[j][q] is channel j k + q, and x2 [j][q][r].
        let sum = |shift: &[f64], matrix: &[f64], out: usize| -> f64 {
            (0..k).map(|i| shift[i * k + out / k] * matrix[i * k * k + out]).sum()
        };
        let bias1: Vec<f64> = (0..k * k).map(|out| sum(&shift0, &x1, out)).collect();
        let bias2: Vec<f64> =
            (0..k * k).map(|out| sum(&shift1, &x2, out) * scale2[out] + shift2[out]).collect();
        let transform = TransformWeights::pack(
            k,
            [width, registers(arch)],
            |input, i, j| x0[input * k * k + i * k + j],
            |i, j, q| scale0[i * k + j] * x1[(i * k + j) * k + q],
            |j, q, r| scale1[j * k + q] * x2[(j * k + q) * k + r] * scale2[q * k + r],
            [&bias1, &bias2],
        );

        let depthwise = weights.take(&at("depthwise.weight"), &[k, cin, m])?;
        let mix = MixWeights::pack(k, m, [cd, previous], [width, registers(arch)], |k, c, q| {
            depthwise[(k * cin + c) * m + q]
        });
        let flat = weights.take(&at("pointwise.weight"), &[cin * m, channels])?;
        let [scale, shift] = weights.norm(&at("pointwise"), channels)?;
        // Rows in the order in which the mixing leaves its channels, with zeros where those are padded.
        let mut pointwise = vec![0.0; mix.outputs() * channels];
        for (row, out) in pointwise.chunks_exact_mut(channels).enumerate() {
            let (q, c) = (row / (mix.widths[0] + mix.widths[1]), row % (mix.widths[0] + mix.widths[1]));
            let true_channel = match c.checked_sub(mix.widths[0]) {
                None if c < cd => c,
                Some(c) if c < previous => cd + c,
                _ => continue,
            };
            out.copy_from_slice(&flat[(true_channel * m + q) * channels..][..channels]);
        }
        let none = vec![0.0; channels];
        let pointwise = RowsWeights::pack(&pointwise, Unit::One, &none, Some([&scale, &shift]), width);
        Ok(Self { lift, transform, mix, pointwise })
    }
}

/// The layer that joins the second fully connected one's output, with its batch norm folded in, and the measures.
fn join(
    weights: &mut Weights<'_>,
    measures: usize,
    [scale, shift]: [&[f64]; 2],
    width: usize,
) -> Result<RowsWeights, Error> {
    let matrix = weights.take("join.weight", &[FC2 + measures, FC2])?;
    let norm = weights.norm("join", FC2)?;
    let (top, rest) = matrix.split_at(FC2 * FC2);
    let bias = through(shift, top);
    let folded: Vec<f64> = scaled(top, scale).iter().chain(rest).copied().collect();
    Ok(RowsWeights::pack(&folded, Unit::One, &bias, Some([&norm[0], &norm[1]]), width))
}

/// What the pass of a segment needs in memory; made once, used for segment after segment.
pub(super) struct Workspace {
    pub(super) search: Search,
    pub(super) order: Vec<u32>,
    pub(super) points: Vec<[f32; 3]>,
    pub(super) lists: [Vec<u16>; LAYERS],
    local_rows: Aligned,
    local_columns: Aligned,
    lifted: [Aligned; 2],
    /// Room for making transforms, and these.
    transforms: [Aligned; 2],
    mixed: Aligned,
    /// Features of the points of each layer; those of the last stand beside the global branch.
    pub(super) features: [Aligned; LAYERS],
    coordinates: Aligned,
    global: Aligned,
    fc1: Aligned,
    fc2: Aligned,
    bias: Aligned,
    /// Measures in units of their deviation.
    z: Vec<f64>,
    join: [Aligned; 2],
}

/// One network, ready to run.
pub(super) struct Network {
    arch: Arch,
    pub(super) header: Header,
    layers: [XConv; LAYERS],
    global: [RowsWeights; 2],
    fc1: RowsWeights,
    fc2: RowsWeights,
    /// Shape, sizes and context in, with the batch norm before it folded in.
    join: Option<RowsWeights>,
    /// 128 x learned, row-major, and the bias; without a joining layer with the batch norm before it folded in.
    fc3: [Vec<f64>; 2],
    /// Mean and one over deviation of the measures.
    mean: Vec<f64>,
    gain: Vec<f64>,
    /// Of the sizes: weight beside the learned numbers; rows for the first fully connected layer, in units of ln 2.
    size_weight: Vec<f64>,
    size_rows: Vec<f64>,
    quality: [Vec<f64>; 2],
}

/// Pitch of the rows that the fully connected layers read: the global branch, then the last X-conv.
pub(super) const HEAD: usize = GLOBAL + 256;

impl Network {
    /// Takes all tensors of a file, checks them, packs them for a processor.
    pub(super) fn load(mut weights: Weights<'_>, arch: Arch) -> Result<Self, Error> {
        let width = lanes(arch);
        let header = weights.header.clone();
        let mut layers = Vec::with_capacity(LAYERS);
        for (n, layer) in LAYER_TABLE.iter().enumerate() {
            layers.push(XConv::take(&mut weights, n, layer, arch)?);
        }
        let layers = layers.try_into().map_err(|_| weights.flaw("layers are missing"))?;

        let global1 = weights.take("global1.weight", &[3, GLOBAL])?;
        let [scale1, shift1] = weights.norm("global1", GLOBAL)?;
        let global2 = weights.take("global2.weight", &[GLOBAL, GLOBAL])?;
        let [scale2, shift2] = weights.norm("global2", GLOBAL)?;
        let global = [
            RowsWeights::pack(&global1, Unit::One, &[0.0; GLOBAL], None, width),
            RowsWeights::pack(
                &scaled(&global2, &scale1),
                Unit::Ln2,
                &through(&shift1, &global2),
                Some([&scale2, &shift2]),
                width,
            ),
        ];
        let fc1 = weights.take("fc1.weight", &[HEAD, FC1])?;
        let [scale1, shift1] = weights.norm("fc1", FC1)?;
        let fc2 = weights.take("fc2.weight", &[FC1, FC2])?;
        let [scale2, shift2] = weights.norm("fc2", FC2)?;
        let mut fc3 = weights.take("fc3.weight", &[FC2, header.learned])?;
        let mut bias = weights.take("fc3.bias", &[header.learned])?;
        let join = if header.context {
            Some(join(&mut weights, header.measures(), [&scale2, &shift2], width)?)
        } else {
            bias.iter_mut().zip(through(&shift2, &fc3)).for_each(|(b, s)| *b += s);
            fc3 = scaled(&fc3, &scale2);
            None
        };
        let fc3 = [fc3, bias];
        let fc2 = RowsWeights::pack(&scaled(&fc2, &scale1), Unit::Ln2, &through(&shift1, &fc2), None, width);
        let fc1 = RowsWeights::pack(&fc1, Unit::One, &[0.0; FC1], None, width);

        let (s, m) = (header.size_features, header.measures());
        let (mut mean, mut gain, mut size_weight, mut size_rows) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        if m > 0 {
            mean = weights.take("measures.mean", &[m])?;
            gain = weights.take("measures.std", &[m])?;
            if gain.iter().any(|d| *d <= 0.0) {
                return Err(weights.flaw("tensor measures.std must be above 0"));
            }
            gain.iter_mut().for_each(|d| *d = 1.0 / *d);
        }
        if header.sizes.beside {
            size_weight = weights.take("size.weight", &[s])?;
        }
        if header.sizes.connected {
            size_rows = weights.take("fc1.size_weight", &[s, FC1])?;
            size_rows.iter_mut().for_each(|v| *v *= Unit::One.factor(Unit::Ln2));
        }
        let quality =
            [weights.take("quality.weight", &[header.dim, 2])?, weights.take("quality.bias", &[2])?];
        weights.finish()?;
        Ok(Self {
            arch,
            header,
            layers,
            global,
            fc1,
            fc2,
            join,
            fc3,
            mean,
            gain,
            size_weight,
            size_rows,
            quality,
        })
    }

    pub(super) fn workspace(&self) -> Workspace {
        let width = lanes(self.arch);
        let most = |of: &dyn Fn(&Layer) -> usize| LAYER_TABLE.iter().map(of).max().unwrap_or(0);
        let k = most(&|l| l.neighbours);
        let lift = most(&|l| padded(l.lift, width));
        let of_layers = |of: &dyn Fn(&XConv) -> usize| self.layers.iter().map(of).max().unwrap_or(0);
        let mixed = of_layers(&|l| l.mix.outputs());
        let row = of_layers(&|l| l.transform.row());
        let joined = self.join.as_ref().map_or(0, |_| FC2 + self.header.measures());
        let zeros = Aligned::zeros;
        Workspace {
            search: Search::new(self.arch),
            order: Vec::new(),
            points: Vec::with_capacity(INPUT_POINTS),
            lists: Default::default(),
            local_rows: zeros(CHUNK * k * 3),
            local_columns: zeros(CHUNK * k * 3),
            lifted: [zeros(LIFT * k * lift), zeros(CHUNK * k * lift)],
            transforms: [zeros(CHUNK * k * (k + 1)), zeros(CHUNK * k * row)],
            mixed: zeros(BLOCK * mixed),
            features: std::array::from_fn(|l| {
                let pitch = if l == LAYERS - 1 { HEAD } else { LAYER_TABLE[l].channels };
                zeros(INPUT_POINTS * pitch)
            }),
            coordinates: zeros(BLOCK * 3),
            global: zeros(BLOCK * GLOBAL),
            fc1: zeros(BLOCK * FC1),
            fc2: zeros(BLOCK * FC2),
            bias: zeros(FC1),
            z: Vec::new(),
            join: [zeros(joined), zeros(FC2)],
        }
    }

    /// Describes the 256 normalised points in the workspace. `measures` are the metric sizes as the header lists them, NaN
    /// where unknown, then the context. Fills the descriptor and returns the quality.
    pub(super) fn describe(
        &self,
        w: &mut Workspace,
        measures: &[f64],
        out: &mut [f32],
        probe: &mut impl Probe,
    ) -> f32 {
        w.search.lists(&w.points, &self.header.plan, &mut w.lists);
        probe.ended(Part::Neighbours);
        for layer in 0..LAYERS {
            self.xconv(layer, w, probe);
        }
        // What is not known is the mean.
        let measures = measures.iter().zip(&self.mean).zip(&self.gain);
        w.z.clear();
        w.z.extend(measures.map(|((s, mean), gain)| if s.is_finite() { (s - mean) * gain } else { 0.0 }));
        let mean = self.head(w, probe);
        let mean = self.joined(w, mean);
        let [fc3, bias] = &self.fc3;
        let learned = self.header.learned;
        for (n, out) in out[..learned].iter_mut().enumerate() {
            let sum: f64 = mean.iter().zip(fc3[n..].iter().step_by(learned)).map(|(m, w)| m * w).sum();
            *out = (sum + bias[n]) as f32;
        }
        for ((out, z), weight) in out[learned..].iter_mut().zip(&w.z).zip(&self.size_weight) {
            *out = (z * weight) as f32;
        }
        let [weight, bias] = &self.quality;
        let logit = |n: usize| {
            let sum: f64 =
                out.iter().zip(weight[n..].iter().step_by(2)).map(|(d, w)| f64::from(*d) * w).sum();
            (sum + bias[n]) / self.header.temperature
        };
        let quality = (1.0 / (1.0 + (logit(0) - logit(1)).exp())) as f32;
        probe.ended(Part::Head);
        quality
    }

    /// One X-conv layer, block by block.
    fn xconv(&self, n: usize, w: &mut Workspace, probe: &mut impl Probe) {
        let (layer, weights) = (&LAYER_TABLE[n], &self.layers[n]);
        let last = n == LAYERS - 1;
        let (pitch, start) = if last { (HEAD, GLOBAL) } else { (layer.channels, 0) };
        let kept = self.header.plan.0[n];
        for first in (0..kept).step_by(BLOCK) {
            let block = first..kept.min(first + BLOCK);
            for point in block.clone().step_by(CHUNK) {
                let chunk = point..block.end.min(point + CHUNK);
                self.mixed(n, chunk, (point - first) * weights.mix.outputs(), w, probe);
            }
            self.arch.dispatch(Rows {
                weights: &weights.pointwise,
                bias: &weights.pointwise.bias,
                input: &w.mixed,
                input_pitch: weights.mix.outputs(),
                output: &mut w.features[n][first * pitch + start..],
                output_pitch: pitch,
                count: block.len(),
            });
            probe.ended(Part::Pointwise(n));
        }
    }

    /// The transformed and convolved features of a chunk of points in layer `n`, from place `at` of [`Workspace::mixed`] on.
    fn mixed(&self, n: usize, chunk: Range<usize>, at: usize, w: &mut Workspace, probe: &mut impl Probe) {
        let (k, weights) = (LAYER_TABLE[n].neighbours, &self.layers[n]);
        let count = chunk.len();
        // What lies beyond the last point is computed and not read.
        let wide = padded(count, WHOLE);
        let list = &w.lists[n][chunk.start * k..chunk.end * k];
        for (p, near) in list.chunks_exact(k).enumerate() {
            let query = w.points[chunk.start + p];
            for (j, index) in near.iter().enumerate() {
                let point = w.points[usize::from(*index)];
                for a in 0..3 {
                    let local = point[a] - query[a];
                    w.local_rows[(p * k + j) * 3 + a] = local;
                    w.local_columns[(j * 3 + a) * wide + p] = local;
                }
            }
        }
        probe.ended(Part::Local(n));
        let [lifted1, lifted2] = &mut w.lifted;
        let [lift1, lift2] = &weights.lift;
        let width = lift1.outputs;
        for p in (0..count).step_by(LIFT) {
            let rows = LIFT.min(count - p) * k;
            self.arch.dispatch(Rows {
                weights: lift1,
                bias: &lift1.bias,
                input: &w.local_rows[p * k * 3..],
                input_pitch: 3,
                output: lifted1,
                output_pitch: width,
                count: rows,
            });
            self.arch.dispatch(Rows {
                weights: lift2,
                bias: &lift2.bias,
                input: lifted1,
                input_pitch: width,
                output: &mut lifted2[p * k * width..],
                output_pitch: width,
                count: rows,
            });
        }
        probe.ended(Part::Lift(n));
        let [work, transform] = &mut w.transforms;
        self.arch.dispatch(Transform {
            weights: &weights.transform,
            local: &w.local_columns,
            points: wide,
            work,
            output: transform,
        });
        probe.ended(Part::Transform(n));
        let previous: &[f32] = if n == 0 { &[] } else { &w.features[n - 1] };
        self.arch.dispatch(Mix {
            weights: &weights.mix,
            transform,
            parts: [MixPart { table: lifted2, rows: None }, MixPart { table: previous, rows: Some(list) }],
            output: &mut w.mixed[at..],
            count,
        });
        probe.ended(Part::Mix(n));
    }

    /// The global branch and the fully connected layers; returns the mean over the points of what leaves the second one,
    /// before its batch norm.
    fn head(&self, w: &mut Workspace, probe: &mut impl Probe) -> [f64; FC2] {
        let kept = self.header.plan.0[LAYERS - 1];
        w.bias.copy_from_slice(&self.fc1.bias);
        for (row, z) in self.size_rows.chunks_exact(FC1).zip(&w.z) {
            w.bias.iter_mut().zip(row).for_each(|(b, r)| *b += (z * r) as f32);
        }
        let mut mean = [0f64; FC2];
        let head = &mut w.features[LAYERS - 1];
        for first in (0..kept).step_by(BLOCK) {
            let count = BLOCK.min(kept - first);
            for (out, p) in w.coordinates.chunks_exact_mut(3).zip(&w.points[first..first + count]) {
                out.copy_from_slice(p);
            }
            let [global1, global2] = &self.global;
            self.arch.dispatch(Rows {
                weights: global1,
                bias: &global1.bias,
                input: &w.coordinates,
                input_pitch: 3,
                output: &mut w.global,
                output_pitch: GLOBAL,
                count,
            });
            self.arch.dispatch(Rows {
                weights: global2,
                bias: &global2.bias,
                input: &w.global,
                input_pitch: GLOBAL,
                output: &mut head[first * HEAD..],
                output_pitch: HEAD,
                count,
            });
            probe.ended(Part::Global);
            self.arch.dispatch(Rows {
                weights: &self.fc1,
                bias: &w.bias,
                input: &head[first * HEAD..],
                input_pitch: HEAD,
                output: &mut w.fc1,
                output_pitch: FC1,
                count,
            });
            self.arch.dispatch(Rows {
                weights: &self.fc2,
                bias: &self.fc2.bias,
                input: &w.fc1,
                input_pitch: FC1,
                output: &mut w.fc2,
                output_pitch: FC2,
                count,
            });
            probe.ended(Part::Connected);
            self.arch.dispatch(Sum { rows: &w.fc2[..count * FC2], sums: &mut mean });
            probe.ended(Part::Head);
        }
        mean.map(|m| m * Unit::Ln2.factor(Unit::One) / kept as f64)
    }

    /// Joins what the points say with sizes and context, where the network does.
    fn joined(&self, w: &mut Workspace, mean: [f64; FC2]) -> [f64; FC2] {
        let Some(join) = &self.join else { return mean };
        let [input, output] = &mut w.join;
        input.iter_mut().zip(mean.iter().chain(&w.z)).for_each(|(to, v)| *to = *v as f32);
        self.arch.dispatch(Rows {
            weights: join,
            bias: &join.bias,
            input,
            input_pitch: input.len(),
            output,
            output_pitch: FC2,
            count: 1,
        });
        std::array::from_fn(|n| f64::from(output[n]))
    }
}

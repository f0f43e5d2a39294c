//! The forward pass restated from the description, one number at a time in f64: the oracle of the fast one.

use std::collections::BTreeMap;
use std::path::Path;

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, serialize};

use super::architecture::{FC1, FC2, GLOBAL, LAYER_TABLE, LAYERS};
use super::*;

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// Makes a tensor of a name and shape, uniform between two numbers.
type Put<'a> = &'a mut dyn FnMut(String, &[usize], f32, f32);

/// Random weights of the right shapes, with a header.
fn random(
    variant: &str,
    plan: &str,
    size_mode: &str,
    context: bool,
    seed: u64,
) -> (Tensors, BTreeMap<String, String>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform =
        move |low: f32, high: f32| low + (high - low) * (random.next_u32() as f32 / 4_294_967_296.0);
    let mut t = Tensors::new();
    let mut put = |name: String, shape: &[usize], low: f32, high: f32| {
        let n = shape.iter().product();
        t.insert(name, (shape.to_vec(), (0..n).map(|_| uniform(low, high)).collect()));
    };
    let matrix = |put: Put<'_>, name: String, shape: &[usize], inputs: usize| {
        let a = (3.0 / inputs as f32).sqrt();
        put(name, shape, -a, a);
    };
    let norm = |put: Put<'_>, name: &str, n: usize| {
        put(format!("{name}.bn.scale"), &[n], 0.6, 1.4);
        put(format!("{name}.bn.shift"), &[n], -0.3, 0.3);
    };
    for (n, l) in LAYER_TABLE.iter().enumerate() {
        let x = format!("xconv{}", n + 1);
        let (k, cin) = (l.neighbours, l.lift + l.previous);
        matrix(&mut put, format!("{x}.lift1.weight"), &[3, l.lift], 3);
        norm(&mut put, &format!("{x}.lift1"), l.lift);
        matrix(&mut put, format!("{x}.lift2.weight"), &[l.lift, l.lift], l.lift);
        norm(&mut put, &format!("{x}.lift2"), l.lift);
        matrix(&mut put, format!("{x}.x0.weight"), &[3 * k, k * k], 3 * k);
        matrix(&mut put, format!("{x}.x1.weight"), &[k, k, k], k);
        matrix(&mut put, format!("{x}.x2.weight"), &[k, k, k], k);
        (0..3).for_each(|i| norm(&mut put, &format!("{x}.x{i}"), k * k));
        matrix(&mut put, format!("{x}.depthwise.weight"), &[k, cin, l.multiplier], 3 * k);
        matrix(
            &mut put,
            format!("{x}.pointwise.weight"),
            &[cin * l.multiplier, l.channels],
            cin * l.multiplier,
        );
        norm(&mut put, &format!("{x}.pointwise"), l.channels);
    }
    for (name, inputs, outputs) in
        [("global1", 3, GLOBAL), ("global2", GLOBAL, GLOBAL), ("fc1", GLOBAL + 256, FC1), ("fc2", FC1, FC2)]
    {
        matrix(&mut put, format!("{name}.weight"), &[inputs, outputs], inputs);
        norm(&mut put, name, outputs);
    }
    matrix(&mut put, "fc3.weight".into(), &[FC2, 16], FC2);
    put("fc3.bias".into(), &[16], -0.2, 0.2);
    let (beside, connected) = (matches!(size_mode, "beside" | "both"), matches!(size_mode, "fc" | "both"));
    let sizes = if beside || connected { 6 } else { 0 };
    if sizes > 0 {
        let measures = sizes + if context { 28 } else { 0 };
        put("measures.mean".into(), &[measures], -1.0, 1.0);
        put("measures.std".into(), &[measures], 0.4, 1.0);
        if context {
            matrix(&mut put, "join.weight".into(), &[FC2 + measures, FC2], FC2 + measures);
            norm(&mut put, "join", FC2);
        }
    }
    if beside {
        put("size.weight".into(), &[sizes], 0.2, 1.0);
    }
    if connected {
        put("fc1.size_weight".into(), &[sizes, FC1], -0.3, 0.3);
    }
    let dim = 16 + if beside { sizes } else { 0 };
    put("quality.weight".into(), &[dim, 2], -0.5, 0.5);
    put("quality.bias".into(), &[2], -0.5, 0.5);
    let dim = dim.to_string();
    let header = [
        ("format", "esm-weights"),
        ("format_version", "2"),
        ("architecture", "xconv-4"),
        ("variant", variant),
        ("input_points", "256"),
        ("point_plan", plan),
        ("neighbours", "8x1,12x3,16x3,16x4"),
        ("channels", "32,64,128,256"),
        ("lift", "16,8,16,32"),
        ("multipliers", "4,2,2,2"),
        ("learned_dim", "16"),
        ("size_mode", size_mode),
        ("size_features", if sizes > 0 { "sigma1,sigma2,sigma3,height,extent1,extent2" } else { "" }),
        ("context", if context { "rings-7x4" } else { "none" }),
        ("descriptor_dim", &dim),
        ("normalisation", "mean,rms,floor=0.001"),
        ("quality_temperature", "1.25"),
    ];
    (t, header.into_iter().map(|(k, v)| (k.to_owned(), v.to_owned())).collect())
}

/// The bytes of a weights file.
fn file(tensors: &Tensors, header: &BTreeMap<String, String>) -> Vec<u8> {
    let bytes: BTreeMap<&str, Vec<u8>> = tensors
        .iter()
        .map(|(name, (_, v))| (name.as_str(), v.iter().flat_map(|v| v.to_le_bytes()).collect()))
        .collect();
    let views = tensors.iter().map(|(name, (shape, _))| {
        (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), &bytes[name.as_str()]).unwrap())
    });
    serialize(views, Some(header.clone().into_iter().collect())).unwrap()
}

struct Naive<'a>(&'a Tensors);

impl Naive<'_> {
    fn w(&self, name: &str) -> Vec<f64> {
        self.0[name].1.iter().map(|v| f64::from(*v)).collect()
    }

    fn norm(&self, name: &str, x: &mut [f64]) {
        let (scale, shift) = (self.w(&format!("{name}.bn.scale")), self.w(&format!("{name}.bn.shift")));
        x.iter_mut().zip(scale).zip(shift).for_each(|((x, a), b)| *x = *x * a + b);
    }

    /// x W, then ELU and batch norm.
    fn dense(&self, name: &str, x: &[f64], extra: &[f64]) -> Vec<f64> {
        let w = self.w(&format!("{name}.weight"));
        let columns = w.len() / x.len();
        let mut y: Vec<f64> = (0..columns)
            .map(|c| {
                let sum: f64 = x.iter().enumerate().map(|(r, x)| x * w[r * columns + c]).sum();
                elu(sum + extra.get(c).copied().unwrap_or(0.0))
            })
            .collect();
        self.norm(name, &mut y);
        y
    }

    fn xconv(&self, n: usize, points: &[[f32; 3]], previous: &[Vec<f64>], kept: usize) -> Vec<Vec<f64>> {
        let l = &LAYER_TABLE[n];
        let (k, m, cin) = (l.neighbours, l.multiplier, l.lift + l.previous);
        let at = |s: &str| format!("xconv{}.{s}", n + 1);
        let [x1w, x2w] = ["x1.weight", "x2.weight"].map(|s| self.w(&at(s)));
        let depthwise = self.w(&at("depthwise.weight"));
        (0..kept)
            .map(|q| {
                let mut near: Vec<(f32, usize)> = points
                    .iter()
                    .enumerate()
                    .map(|(i, p)| {
                        let d: [f32; 3] = std::array::from_fn(|a| points[q][a] - p[a]);
                        ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2], i)
                    })
                    .collect();
                near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let near: Vec<usize> = (0..k).map(|j| near[j * l.dilation].1).collect();
                let local: Vec<f64> = near
                    .iter()
                    .flat_map(|i| (0..3).map(|a| f64::from(points[*i][a] - points[q][a])))
                    .collect();
                let f: Vec<Vec<f64>> = (0..k)
                    .map(|j| {
                        let a = self.dense(&at("lift1"), &local[3 * j..3 * j + 3], &[]);
                        let mut f = self.dense(&at("lift2"), &a, &[]);
                        f.extend(previous.get(near[j]).into_iter().flatten());
                        f
                    })
                    .collect();
                let x0 = self.dense(&at("x0"), &local, &[]);
                let product = |x: &[f64], w: &[f64]| -> Vec<f64> {
                    (0..k * k)
                        .map(|out| {
                            (0..k).map(|i| x[i * k + out / k] * w[(i * k + out / k) * k + out % k]).sum()
                        })
                        .collect()
                };
                let mut x1: Vec<f64> = product(&x0, &x1w).into_iter().map(elu).collect();
                self.norm(&at("x1"), &mut x1);
                let mut x2 = product(&x1, &x2w);
                self.norm(&at("x2"), &mut x2);
                let mut s = vec![0.0; cin * m];
                for row in 0..k {
                    for c in 0..cin {
                        let fx: f64 = (0..k).map(|j| x2[row * k + j] * f[j][c]).sum();
                        for o in 0..m {
                            s[c * m + o] += fx * depthwise[(row * cin + c) * m + o];
                        }
                    }
                }
                self.dense(&at("pointwise"), &s, &[])
            })
            .collect()
    }

    fn run(
        &self,
        points: &[[f32; 3]],
        plan: [usize; LAYERS],
        measures: &[f64],
        mode: &str,
    ) -> (Vec<f64>, f64) {
        let mut features: Vec<Vec<f64>> = Vec::new();
        let mut sources = 256;
        for (n, kept) in plan.into_iter().enumerate() {
            features = self.xconv(n, &points[..sources], &features, kept);
            sources = kept;
        }
        let z: Vec<f64> = if mode == "none" {
            Vec::new()
        } else {
            let (mean, std) = (self.w("measures.mean"), self.w("measures.std"));
            let z = measures.iter().zip(mean).zip(std).map(|((s, m), d)| (s - m) / d);
            z.map(|z| if z.is_nan() { 0.0 } else { z }).collect()
        };
        let row: Vec<f64> = if matches!(mode, "fc" | "both") {
            let w = self.w("fc1.size_weight");
            (0..FC1).map(|c| z[..6].iter().enumerate().map(|(s, z)| z * w[s * FC1 + c]).sum()).collect()
        } else {
            Vec::new()
        };
        let mut mean = vec![0.0; FC2];
        for (p, f) in points.iter().zip(&features) {
            let g = self.dense("global1", &p.map(f64::from), &[]);
            let mut g = self.dense("global2", &g, &[]);
            g.extend(f);
            let h = self.dense("fc2", &self.dense("fc1", &g, &row), &[]);
            mean.iter_mut().zip(h).for_each(|(m, h)| *m += h / features.len() as f64);
        }
        if self.0.contains_key("join.weight") {
            mean.extend(&z);
            mean = self.dense("join", &mean, &[]);
        }
        let (w, bias) = (self.w("fc3.weight"), self.w("fc3.bias"));
        let mut d: Vec<f64> = (0..16)
            .map(|c| bias[c] + mean.iter().enumerate().map(|(r, m)| m * w[r * 16 + c]).sum::<f64>())
            .collect();
        if matches!(mode, "beside" | "both") {
            d.extend(z.iter().zip(self.w("size.weight")).map(|(z, w)| z * w));
        }
        let (w, bias) = (self.w("quality.weight"), self.w("quality.bias"));
        let logit =
            |n: usize| (bias[n] + d.iter().enumerate().map(|(r, d)| d * w[r * 2 + n]).sum::<f64>()) / 1.25;
        let quality = logit(1).exp() / (logit(0).exp() + logit(1).exp());
        (d, quality)
    }
}

fn elu(x: f64) -> f64 {
    if x > 0.0 { x } else { x.exp_m1() }
}

fn blob(seed: u64) -> Vec<[f32; 3]> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = move || random.next_u32() as f32 / 4_294_967_296.0 - 0.5;
    let mut points: Vec<[f32; 3]> = (0..256).map(|_| [4.0 * unit(), 2.0 * unit(), unit()]).collect();
    sample::normalise(&mut points, false);
    points
}

/// What this machine can run: the widest vectors, narrower ones, none.
pub(super) fn processors() -> Vec<Arch> {
    let mut all = vec![Arch::new(), Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    all.extend(pulp::x86::V3::try_new().map(Arch::V3));
    all
}

/// All plans and ways of size, one segment each: f64, one number at a time, against the packed pass.
#[test]
fn the_pass_is_the_restated_one() {
    let cases = [
        ("esm-paper", [256, 256, 256, 256], "none", false),
        ("esm-swift", [256, 96, 64, 48], "beside", false),
        ("esm-swift", [128, 65, 64, 47], "both", true),
        ("esm", [256, 96, 64, 64], "fc", false),
        ("esm", [256, 96, 64, 64], "beside", true),
    ];
    for (n, (variant, plan, mode, context)) in cases.into_iter().enumerate() {
        let text = plan.map(|p| p.to_string()).join(",");
        let (tensors, header) = random(variant, &text, mode, context, n as u64);
        let points = blob(n as u64);
        let measures = [0.3, -0.5, f64::NAN, 0.8, 1.1, 0.2];
        let around = (0..28).map(|i| f64::from(i) / 20.0 - 0.7);
        let measures: Vec<f64> = measures.into_iter().chain(around).collect();
        let measures = match (mode, context) {
            ("none", _) => &measures[..0],
            (_, false) => &measures[..6],
            (_, true) => &measures[..],
        };
        let (want, quality) = Naive(&tensors).run(&points, plan, measures, mode);
        for arch in processors() {
            let descriptor =
                XConv::for_processor(&file(&tensors, &header), Path::new("random"), arch).unwrap();
            let found = descriptor.describe_normalised(&points, measures);
            assert_eq!(found.values.len(), want.len());
            for (a, b) in found.values.iter().zip(&want) {
                assert!((f64::from(*a) - b).abs() < 1e-5, "{variant} {mode} {context} {arch:?}: {a} {b}");
            }
            assert!((f64::from(found.quality[0]) - quality).abs() < 1e-5, "{variant} {mode} {arch:?}");
        }
    }
}

/// One thread or many, alone or in a batch, first or later: the same bits.
#[test]
fn rows_depend_on_their_segment_alone() {
    let (tensors, header) = random("esm-swift", "256,96,64,48", "beside", true, 9);
    let descriptor = XConv::from_bytes(&file(&tensors, &header), "random").unwrap();
    let segments: Vec<Segment> = (0..12)
        .map(|n| {
            let mut points = blob(n);
            points.truncate(60 + 40 * n as usize);
            Segment::from_points(points).unwrap()
        })
        .collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let one = pool.install(|| descriptor.describe(&segments));
    let many = descriptor.describe(&segments);
    assert_eq!((&one.values, &one.quality), (&many.values, &many.quality));
    let last = descriptor.describe(&segments[11..]);
    assert_eq!(last.values, one.values[11 * one.dim..]);
    assert!(one.values.iter().all(|v| v.is_finite()));
}

/// The order of the points within a sample changes neighbours' numbers, not what is computed.
#[test]
fn the_full_network_does_not_see_the_order_of_points() {
    let (tensors, header) = random("esm-paper", "256,256,256,256", "none", false, 4);
    let descriptor = XConv::from_bytes(&file(&tensors, &header), "random").unwrap();
    let points = blob(3);
    let turned: Vec<[f32; 3]> = points.iter().rev().copied().collect();
    let (a, b) = (descriptor.describe_normalised(&points, &[]), descriptor.describe_normalised(&turned, &[]));
    for (a, b) in a.values.iter().zip(&b.values) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

fn refused(tensors: &Tensors, header: &BTreeMap<String, String>) -> String {
    XConv::from_bytes(&file(tensors, header), "w.safetensors").expect_err("refused").to_string()
}

#[test]
fn wrong_weights_are_refused_with_a_reason() {
    let (tensors, header) = random("esm", "256,256,256,256", "beside", true, 5);
    let with = |key: &str, value: &str| {
        let mut header = header.clone();
        header.insert(key.to_owned(), value.to_owned());
        refused(&tensors, &header)
    };
    assert!(with("format", "other").contains("format is `other`"));
    assert!(with("architecture", "xconv-5").contains("architecture"));
    assert!(with("channels", "32,64,128,512").contains("channels"));
    assert!(with("variant", "mine").contains("one of esm-paper, esm, esm-swift"));
    assert!(with("point_plan", "256,96,32,32").contains("layer 4 needs the 64 nearest of 32"));
    assert!(with("point_plan", "1,2").contains("four numbers"));
    assert!(with("size_mode", "none").contains("size_features"));
    assert!(with("descriptor_dim", "16").contains("its parts have 22"));
    assert!(with("context", "maps").contains("none or rings-7x4"));
    assert!(with("quality_temperature", "NaN").contains("above 0"));
    let mut short = header.clone();
    short.remove("format");
    assert!(refused(&tensors, &short).contains("lacks `format`"));

    let mut broken = tensors.clone();
    broken.get_mut("fc2.weight").unwrap().1[77] = f32::NAN;
    assert!(refused(&broken, &header).contains("fc2.weight is not finite at number 77"));
    let mut broken = tensors.clone();
    broken.remove("xconv3.x1.weight");
    assert!(refused(&broken, &header).contains("xconv3.x1.weight is missing"));
    let mut broken = tensors.clone();
    broken.insert("fc3.bias".into(), (vec![4, 4], vec![0.0; 16]));
    assert!(refused(&broken, &header).contains("fc3.bias has the shape [4, 4], not [16]"));
    let mut broken = tensors.clone();
    broken.insert("decoder".into(), (vec![1], vec![0.0]));
    assert!(refused(&broken, &header).contains("decoder is not part of this network"));
    let mut broken = tensors.clone();
    broken.remove("join.weight");
    assert!(refused(&broken, &header).contains("join.weight is missing"));
    let mut broken = tensors;
    broken.get_mut("measures.std").unwrap().1[0] = 0.0;
    assert!(refused(&broken, &header).contains("measures.std must be above 0"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]
    /// Torn and altered files give an error or, where a number changed, other numbers: never a panic.
    #[test]
    fn damaged_bytes_never_panic(cut in 0usize..6000, flip in 0usize..6000, bit in 0u8..8) {
        let (tensors, header) = random("esm", "256,256,256,256", "beside", true, 6);
        let bytes = file(&tensors, &header);
        prop_assert!(XConv::from_bytes(&bytes[..cut.min(bytes.len() - 1)], "cut").is_err());
        let mut bytes = bytes;
        bytes[flip] ^= 1 << bit;
        let _ = XConv::from_bytes(&bytes, "flipped");
    }
}

#[test]
fn large_and_missing_files_are_refused_before_they_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("huge.safetensors");
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    assert!(matches!(XConv::open(&path), Err(Error::WeightsFile { .. })));
    assert!(matches!(XConv::open(Path::new("/nowhere/w.safetensors")), Err(Error::Io { .. })));
}

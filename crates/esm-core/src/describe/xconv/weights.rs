//! The weights file: safetensors with a header that tells the architecture; `python/train/WEIGHTS.md` is its description.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::{Dtype, SafeTensors};

use super::architecture::{INPUT_POINTS, LAYER_TABLE, LAYERS, PointPlan};
use crate::error::Error;
use crate::segment::{RING_NUMBERS, RINGS};

/// Larger files are no weights of this network, which has some 300 thousand numbers: bytes.
const MOST_BYTES: u64 = 64 << 20;

/// Names a weights file may give to its network.
pub(super) const VARIANTS: [&str; 3] = ["esm-paper", "esm", "esm-swift"];

/// Metric sizes in the order of the columns; the last one may be missing.
pub(super) const SIZE_FEATURES: [&str; 7] =
    ["sigma1", "sigma2", "sigma3", "height", "extent1", "extent2", "above_ground"];

/// How metric size enters the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SizeMode {
    /// Beside the learned numbers, weighted.
    pub(super) beside: bool,
    /// Into the first fully connected layer.
    pub(super) connected: bool,
}

/// What the header tells.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) variant: &'static str,
    pub(super) plan: PointPlan,
    /// Whether segments are turned about the up axis into a pose of their own.
    pub(super) turned: bool,
    pub(super) sizes: SizeMode,
    /// Number of size features, 0, 6 or 7.
    pub(super) size_features: usize,
    /// Whether what stands around a segment enters.
    pub(super) context: bool,
    pub(super) learned: usize,
    pub(super) dim: usize,
    pub(super) temperature: f64,
    /// All of it, as text.
    pub(super) metadata: BTreeMap<String, String>,
}

/// An opened weights file; tensors are taken out of it one by one.
pub(super) struct Weights<'a> {
    pub(super) header: Header,
    tensors: BTreeMap<String, (Vec<usize>, Vec<f64>)>,
    path: &'a Path,
}

fn flaw(path: &Path, what: impl Into<String>) -> Error {
    Error::WeightsFile {
        path: path.to_owned(),
        what: what.into(),
        hint: "weights are written by `esm-train export`; see python/train/WEIGHTS.md",
    }
}

/// Reads a file whole, unless it is far too large.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let io = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let file = std::fs::File::open(path).map_err(io("opening the weights"))?;
    let size = file.metadata().map_err(io("reading the weights"))?.len();
    if size > MOST_BYTES {
        return Err(flaw(path, format!("{size} bytes are more than weights of this network can have")));
    }
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::io::Read::take(file, MOST_BYTES), &mut bytes)
        .map_err(io("reading the weights"))?;
    Ok(bytes)
}

impl<'a> Weights<'a> {
    /// Parses the bytes of a file; `path` is for messages.
    pub(super) fn parse(bytes: &[u8], path: &'a Path) -> Result<Self, Error> {
        let damaged = |e: safetensors::SafeTensorError| flaw(path, format!("not a safetensors file: {e}"));
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let text = metadata.metadata().clone().unwrap_or_default();
        let header = Header::parse(text.into_iter().collect()).map_err(|what| flaw(path, what))?;
        let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(flaw(path, format!("tensor {name} is {:?}, must be F32", view.dtype())));
            }
            let values: Vec<f64> =
                view.data().as_chunks::<4>().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
            if let Some(n) = values.iter().position(|v| !v.is_finite()) {
                return Err(flaw(path, format!("tensor {name} is not finite at number {n}")));
            }
            tensors.insert(name.to_owned(), (view.shape().to_vec(), values));
        }
        Ok(Self { header, tensors, path })
    }

    /// The numbers of a tensor, row-major.
    pub(super) fn take(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f64>, Error> {
        let Some((found, values)) = self.tensors.remove(name) else {
            return Err(flaw(self.path, format!("tensor {name} is missing")));
        };
        if found != shape {
            return Err(flaw(self.path, format!("tensor {name} has the shape {found:?}, not {shape:?}")));
        }
        Ok(values)
    }

    /// Scale and shift of a batch norm.
    pub(super) fn norm(&mut self, layer: &str, channels: usize) -> Result<[Vec<f64>; 2], Error> {
        let mut of = |part| self.take(&format!("{layer}.bn.{part}"), &[channels]);
        Ok([of("scale")?, of("shift")?])
    }

    /// An error about this file.
    pub(super) fn flaw(&self, what: impl Into<String>) -> Error {
        flaw(self.path, what)
    }

    /// Ends the reading: what nobody took belongs to another network.
    pub(super) fn finish(self) -> Result<Header, Error> {
        match self.tensors.keys().next() {
            Some(name) => Err(flaw(self.path, format!("tensor {name} is not part of this network"))),
            None => Ok(self.header),
        }
    }
}

impl Header {
    /// Numbers that enter beside the points: sizes, then context.
    pub(super) fn measures(&self) -> usize {
        self.size_features + if self.context { RINGS * RING_NUMBERS } else { 0 }
    }

    fn parse(metadata: BTreeMap<String, String>) -> Result<Self, String> {
        let get = |key: &str| {
            let text = metadata.get(key).map(String::as_str);
            text.ok_or_else(|| format!("its header lacks `{key}`: no weights of this network"))
        };
        let expect = |key: &str, want: &str| match get(key)? {
            found if found == want => Ok(()),
            found => Err(format!("{key} is `{found}`, this version understands `{want}`")),
        };
        let list = |of: fn(&super::architecture::Layer) -> String| {
            LAYER_TABLE.iter().map(of).collect::<Vec<_>>().join(",")
        };
        expect("format", "esm-weights")?;
        expect("format_version", "2")?;
        expect("architecture", "xconv-4")?;
        expect("input_points", &INPUT_POINTS.to_string())?;
        expect("neighbours", &list(|l| format!("{}x{}", l.neighbours, l.dilation)))?;
        expect("channels", &list(|l| l.channels.to_string()))?;
        expect("lift", &list(|l| l.lift.to_string()))?;
        expect("multipliers", &list(|l| l.multiplier.to_string()))?;
        let turned = match get("normalisation")? {
            "mean,rms,floor=0.001" => false,
            "mean,turn,rms,floor=0.001" => true,
            other => return Err(format!("normalisation is `{other}`, which this version does not know")),
        };
        let variant = get("variant")?;
        let variant = VARIANTS
            .into_iter()
            .find(|v| *v == variant)
            .ok_or_else(|| format!("variant is `{variant}`, must be one of {}", VARIANTS.join(", ")))?;
        let number = |key: &str, range: std::ops::RangeInclusive<usize>| {
            let text = get(key)?;
            text.parse()
                .ok()
                .filter(|n| range.contains(n))
                .ok_or_else(|| format!("{key} is `{text}`, must be {} to {}", range.start(), range.end()))
        };
        let plan = get("point_plan")?;
        let points: Vec<usize> = plan.split(',').filter_map(|p| p.parse().ok()).collect();
        let points: [usize; LAYERS] =
            points.try_into().map_err(|_| format!("point_plan is `{plan}`, must be four numbers"))?;
        let plan = PointPlan(points);
        if let Some(what) = plan.flaw() {
            return Err(format!("point_plan: {what}"));
        }
        let sizes = match get("size_mode")? {
            "none" => SizeMode { beside: false, connected: false },
            "beside" => SizeMode { beside: true, connected: false },
            "fc" => SizeMode { beside: false, connected: true },
            "both" => SizeMode { beside: true, connected: true },
            other => return Err(format!("size_mode is `{other}`, must be none, beside, fc or both")),
        };
        let features = get("size_features")?;
        let names: Vec<&str> = features.split(',').filter(|f| !f.is_empty()).collect();
        let any = sizes.beside || sizes.connected;
        let known =
            if any { names.len() >= 6 && SIZE_FEATURES.starts_with(&names) } else { names.is_empty() };
        if !known {
            return Err(format!("size_features is `{features}`, which this version cannot measure"));
        }
        let context = match get("context")? {
            "none" => false,
            "rings-7x4" if any => true,
            "rings-7x4" => return Err("context is `rings-7x4`, which goes with sizes only".to_owned()),
            other => return Err(format!("context is `{other}`, must be none or rings-7x4")),
        };
        let learned = number("learned_dim", 1..=64)?;
        let dim = number("descriptor_dim", 1..=128)?;
        let want = learned + if sizes.beside { names.len() } else { 0 };
        if dim != want {
            return Err(format!("descriptor_dim is {dim}, its parts have {want}"));
        }
        let temperature = get("quality_temperature")?;
        let temperature = temperature
            .parse()
            .ok()
            .filter(|t: &f64| t.is_finite() && *t > 0.0)
            .ok_or_else(|| format!("quality_temperature is `{temperature}`, must be above 0"))?;
        Ok(Self {
            variant,
            plan,
            turned,
            sizes,
            size_features: names.len(),
            context,
            learned,
            dim,
            temperature,
            metadata: metadata.clone(),
        })
    }
}

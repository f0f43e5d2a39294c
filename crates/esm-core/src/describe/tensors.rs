//! [`Tensors`]: the opened weights file of a peer, safetensors with a header of text.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::{Dtype, SafeTensors};

use crate::error::Error;

/// Larger files are no weights of anything here: bytes.
const MOST_BYTES: u64 = 256 << 20;

/// Tensors of a file by name, all numbers finite; they are taken out one by one.
pub(super) struct Tensors<'a> {
    header: BTreeMap<String, String>,
    tensors: BTreeMap<String, (Vec<usize>, Vec<f32>)>,
    path: &'a Path,
}

/// Reads a weights file whole, unless it is far too large.
///
/// # Errors
/// [`Error::Io`]; [`Error::WeightsFile`] for one that is too large.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let io = |doing| move |source| Error::Io { path: path.to_owned(), doing, source };
    let file = std::fs::File::open(path).map_err(io("opening the weights"))?;
    let size = file.metadata().map_err(io("reading the weights"))?.len();
    if size > MOST_BYTES {
        return Err(flaw(path, format!("{size} bytes are more than weights can have")));
    }
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut std::io::Read::take(file, MOST_BYTES), &mut bytes)
        .map_err(io("reading the weights"))?;
    Ok(bytes)
}

/// The line `architecture` of the header, where the bytes are a weights file that has one.
pub(super) fn architecture(bytes: &[u8]) -> Option<String> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).ok()?;
    metadata.metadata().as_ref()?.get("architecture").cloned()
}

fn flaw(path: &Path, what: impl Into<String>) -> Error {
    Error::WeightsFile {
        path: path.to_owned(),
        what: what.into(),
        hint: "weights are written by `esm-train`; see python/train/WEIGHTS.md",
    }
}

impl<'a> Tensors<'a> {
    /// Parses the bytes of a file; `path` is for messages.
    ///
    /// # Errors
    /// [`Error::WeightsFile`] where it is damaged, of another format, or holds a number that is not finite.
    pub(super) fn parse(bytes: &[u8], path: &'a Path, architecture: &str) -> Result<Self, Error> {
        let damaged = |e: safetensors::SafeTensorError| flaw(path, format!("not a safetensors file: {e}"));
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let file = SafeTensors::deserialize(bytes).map_err(damaged)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            let Some(values) = numbers(view.dtype(), view.data()) else {
                return Err(flaw(path, format!("tensor {name} is {:?}, must be F16 or F32", view.dtype())));
            };
            if let Some(n) = values.iter().position(|v| !v.is_finite()) {
                return Err(flaw(path, format!("tensor {name} is not finite at number {n}")));
            }
            tensors.insert(name.to_owned(), (view.shape().to_vec(), values));
        }
        let header = metadata.metadata().clone().unwrap_or_default().into_iter().collect();
        let it = Self { header, tensors, path };
        it.expect("format", "esm-weights")?;
        it.expect("format_version", "2")?;
        it.expect("architecture", architecture)?;
        Ok(it)
    }

    /// A line of the header that has to say just this.
    pub(super) fn expect(&self, key: &str, want: &str) -> Result<(), Error> {
        match self.text(key)? {
            found if found == want => Ok(()),
            found => Err(self.flaw(format!("{key} is `{found}`, this version understands `{want}`"))),
        }
    }

    /// A line of the header.
    pub(super) fn text(&self, key: &str) -> Result<&str, Error> {
        let text = self.header.get(key).map(String::as_str);
        text.ok_or_else(|| self.flaw(format!("its header lacks `{key}`")))
    }

    /// The numbers of a tensor, row-major.
    pub(super) fn take(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>, Error> {
        match self.tensors.remove(name) {
            Some((found, values)) if found == shape => Ok(values),
            Some((found, _)) => {
                Err(self.flaw(format!("tensor {name} has the shape {found:?}, not {shape:?}")))
            }
            None => Err(self.flaw(format!("tensor {name} is missing"))),
        }
    }

    /// An error about this file.
    pub(super) fn flaw(&self, what: impl Into<String>) -> Error {
        flaw(self.path, what)
    }

    /// Ends the reading: what nobody took belongs to something else.
    pub(super) fn finish(self) -> Result<BTreeMap<String, String>, Error> {
        match self.tensors.keys().next() {
            Some(name) => Err(self.flaw(format!("tensor {name} is not part of it"))),
            None => Ok(self.header),
        }
    }
}

fn numbers(kind: Dtype, bytes: &[u8]) -> Option<Vec<f32>> {
    match kind {
        Dtype::F32 => Some(bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()),
        Dtype::F16 => {
            Some(bytes.as_chunks::<2>().0.iter().map(|b| half::f16::from_le_bytes(*b).to_f32()).collect())
        }
        _ => None,
    }
}

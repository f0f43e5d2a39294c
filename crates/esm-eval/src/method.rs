//! [`Model`]: a method's descriptor, opened.

use std::path::Path;
use std::sync::Arc;

use esm_core::{Descriptor, describe};
use serde_json::{Value, json};

use crate::digest;
use crate::error::Error;
use crate::plan::Method;

/// A descriptor and what it is made of.
pub(crate) struct Model {
    pub(crate) descriptor: Arc<dyn Descriptor>,
    /// Tells it from every other one.
    pub(crate) digest: Value,
    /// Size of its weights; 0 of a descriptor that is a formula.
    pub(crate) bytes: u64,
}

impl Model {
    pub(crate) fn open(method: &Method) -> Result<Self, Error> {
        let name = method.descriptor.as_str();
        let descriptor = describe::by_name(name).map_err(Error::core(&method.name))?;
        let built_in: Option<&[u8]> = match name {
            "esm-swift" => Some(esm_weights::ESM_SWIFT),
            "esm" => Some(esm_weights::ESM),
            "esm-paper" => Some(esm_weights::ESM_PAPER),
            _ => None,
        };
        let (weights, bytes) = match (built_in, describe::NAMES.contains(&name)) {
            (Some(weights), _) => (digest::of_bytes(weights), weights.len() as u64),
            (None, true) => (String::new(), 0),
            (None, false) => {
                let path = Path::new(name);
                let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "opening it", e))?;
                (digest::of_input(path)?, meta.len())
            }
        };
        let digest = json!([descriptor.name(), descriptor.version(), weights]);
        Ok(Self { descriptor, digest, bytes })
    }
}

//! The trained weights of the networks, as bytes: safetensors files as `python/train/WEIGHTS.md` describes them. The model
//! card, `README.md`, tells what they were trained on and how well they do.

/// The network with inner down-sampling, the metric size beside the learned numbers; 22 numbers a segment.
pub const ESM_SWIFT: &[u8] = include_bytes!("../esm-swift.safetensors");

//! The trained weights of the networks, as bytes: safetensors files as `python/train/WEIGHTS.md` describes them. The model
//! card, `README.md`, tells what they were trained on and how well they do.

/// The network with inner down-sampling, metric size and context; 24 numbers a segment.
pub const ESM_SWIFT: &[u8] = include_bytes!("../esm-swift.safetensors");

/// The same with all 256 points in every layer; 24 numbers a segment.
pub const ESM: &[u8] = include_bytes!("../esm.safetensors");

/// The paper's network: all points, neither size nor context; 16 numbers a segment.
pub const ESM_PAPER: &[u8] = include_bytes!("../esm-paper.safetensors");

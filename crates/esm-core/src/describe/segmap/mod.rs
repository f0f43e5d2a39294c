//! [`SegMap`]: the descriptor of SegMap (Dube et al., RSS 2018), a 3-D convolutional network; the peer that the paper compares
//! itself with.
//!
//! A segment, turned by its principal axes and fitted into a grid of 32 x 32 x 16 cells, passes three convolutions and two
//! dense layers: 64 numbers. The weights come from a file that `esm-train segmap` writes (`python/train/WEIGHTS.md`); they are
//! not part of the program. The pass agrees with PyTorch's to 1e-4.

mod conv;
mod first;
#[cfg(test)]
mod golden;
mod grid;
mod network;

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use pulp::Arch;
use rayon::prelude::*;

use self::network::{BLOCK, DIM, FLAT, Network, Workspace};
use super::{Descriptions, Descriptor, tensors};
use crate::error::Error;
use crate::segment::Segment;

/// Candidates a segment, as published.
const CANDIDATES: usize = 25;

/// SegMap's encoder with the weights of a file.
pub struct SegMap {
    network: Network,
    version: u32,
    spare: Mutex<Vec<Workspace>>,
}

impl SegMap {
    /// Multiply-adds for one segment of a program that multiplies zeros too.
    pub const MULTIPLY_ADDS: usize = 164_136_448;
    /// Numbers that are learned.
    pub const PARAMETERS: usize = 8_591_552;

    /// Opens a weights file (`.safetensors`).
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read; [`Error::WeightsFile`] where it is damaged or belongs to something else.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        Self::from_bytes(&tensors::read(path)?, path)
    }

    /// The same from bytes in memory; `name` stands for the file in messages.
    ///
    /// # Errors
    /// [`Error::WeightsFile`].
    pub fn from_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Self, Error> {
        let network = Network::load(bytes, name.as_ref(), Arch::new())?;
        Ok(Self { network, version: crc32fast::hash(bytes), spare: Mutex::default() })
    }

    fn workspace(&self) -> Workspace {
        let spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop();
        spare.unwrap_or_else(|| self.network.workspace())
    }

    fn give_back(&self, workspace: Workspace) {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }

    /// Runs `prepare` (which fills the columns and gives the extents) and the network for `count` segments.
    fn rows(&self, count: usize, prepare: impl Fn(usize, &mut Workspace) -> [f32; 3] + Sync) -> Descriptions {
        // Whole blocks: those beyond the last segment stay zero, and what comes of them is cut off.
        let whole = count.next_multiple_of(BLOCK);
        let mut values = vec![0.0; whole * DIM];
        let preprocessing = values
            .par_chunks_mut(BLOCK * DIM)
            .enumerate()
            .map(|(block, out)| {
                let mut flat = vec![0.0; BLOCK * FLAT];
                let first = block * BLOCK;
                let spent = flat
                    .par_chunks_exact_mut(FLAT)
                    .take(count - first)
                    .enumerate()
                    .map(|(n, flat)| {
                        let start = Instant::now();
                        let mut workspace = self.workspace();
                        let extents = prepare(first + n, &mut workspace);
                        let spent = start.elapsed();
                        self.network.convolve(&mut workspace, extents, flat);
                        self.give_back(workspace);
                        spent
                    })
                    .sum::<Duration>();
                self.network.connect(&flat, out);
                spent
            })
            .sum();
        values.truncate(count * DIM);
        Descriptions { dim: DIM, values, quality: vec![1.0; count], candidates: CANDIDATES, preprocessing }
    }
}

impl Descriptor for SegMap {
    fn name(&self) -> &'static str {
        "segmap"
    }

    /// The checksum of the weights: numbers of other weights mean other things.
    fn version(&self) -> u32 {
        self.version
    }

    fn dim(&self) -> usize {
        DIM
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        self.rows(segments.len(), |n, workspace| grid::fit(&segments[n], &mut workspace.columns))
    }
}

impl std::fmt::Debug for SegMap {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SegMap").field("version", &self.version).finish_non_exhaustive()
    }
}

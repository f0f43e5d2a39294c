//! [`XConv`]: the descriptor of Efficient Segment Matching (paper, section III), a small point network on a CPU.
//!
//! 256 points of a segment, normalised, pass four X-conv layers and three fully connected ones; the mean over the points
//! is the descriptor, and one more layer tells the probability that it is good for matching. The weights come from a file
//! that PyTorch's training writes (`python/train/WEIGHTS.md`); with them this pass agrees to 1e-4.

mod architecture;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod naive;
mod neighbours;
mod network;
mod sample;
mod simd;
mod weights;

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use pulp::Arch;
use rayon::prelude::*;

use self::architecture::INPUT_POINTS;
use self::network::{Network, Workspace};
use self::weights::Weights;
use super::shape::log_sizes;
use super::{Descriptions, Descriptor};
use crate::error::Error;
use crate::segment::{Context, RING_NUMBERS, RINGS, Segment};

/// Candidates a segment, as in the paper (section IV).
const CANDIDATES: usize = 25;

/// A learned descriptor: the network with the weights of one file.
pub struct XConv {
    network: Network,
    version: u32,
    /// Working memory that is not in use: describing makes more only when more threads take part than ever before.
    spare: Mutex<Vec<Workspace>>,
}

impl XConv {
    /// Opens a weights file (`.safetensors`).
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read; [`Error::WeightsFile`] where it is damaged, holds NaN or belongs to another
    /// architecture.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        Self::from_bytes(&weights::read(path)?, path)
    }

    /// The same from bytes in memory; `name` stands for the file in messages.
    ///
    /// # Errors
    /// [`Error::WeightsFile`].
    pub fn from_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Self, Error> {
        Self::for_processor(bytes, name.as_ref(), Arch::new())
    }

    fn for_processor(bytes: &[u8], name: &Path, arch: Arch) -> Result<Self, Error> {
        let network = Network::load(Weights::parse(bytes, name)?, arch)?;
        Ok(Self { network, version: crc32fast::hash(bytes), spare: Mutex::default() })
    }

    /// A line of the weights' header, such as `training_data` or `max_distance_fpr_0.1`.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.network.header.metadata.get(key).map(String::as_str)
    }

    /// Multiply-adds for one segment.
    pub fn multiply_adds(&self) -> usize {
        let header = &self.network.header;
        header.plan.multiply_adds(header.learned, if header.context { header.measures() } else { 0 })
    }

    /// Describes inputs that are sampled and normalised already: `points` holds 256 for each, `measures` the sizes of the
    /// header (NaN where unknown), then the context. For comparing with other programs.
    ///
    /// # Panics
    /// Where the lengths do not fit together.
    pub fn describe_normalised(&self, points: &[[f32; 3]], measures: &[f64]) -> Descriptions {
        let each = self.network.header.measures();
        assert_eq!(points.len() % INPUT_POINTS, 0, "256 points a segment");
        assert_eq!(measures.len(), points.len() / INPUT_POINTS * each, "{each} measures a segment");
        self.rows(points.len() / INPUT_POINTS, |n, workspace, row| {
            workspace.points.clear();
            workspace.points.extend_from_slice(&points[n * INPUT_POINTS..][..INPUT_POINTS]);
            (self.network.describe(workspace, &measures[n * each..][..each], row), Duration::ZERO)
        })
    }

    /// Runs one segment after the other on all threads.
    fn rows(
        &self,
        count: usize,
        one: impl Fn(usize, &mut Workspace, &mut [f32]) -> (f32, Duration) + Sync,
    ) -> Descriptions {
        let dim = self.dim();
        let (mut values, mut quality) = (vec![0.0; dim * count], vec![0.0; count]);
        let preprocessing = values
            .par_chunks_mut(dim)
            .zip(&mut quality)
            .enumerate()
            .map(|(n, (row, quality))| {
                let spare = || self.spare.lock().unwrap_or_else(PoisonError::into_inner);
                let mut workspace = spare().pop().unwrap_or_else(|| self.network.workspace());
                let (value, spent) = one(n, &mut workspace, row);
                *quality = value;
                spare().push(workspace);
                spent
            })
            .sum();
        Descriptions { dim, values, quality, candidates: CANDIDATES, preprocessing }
    }
}

impl Descriptor for XConv {
    fn name(&self) -> &'static str {
        self.network.header.variant
    }

    /// The checksum of the weights: numbers of other weights mean other things.
    fn version(&self) -> u32 {
        self.version
    }

    fn dim(&self) -> usize {
        self.network.header.dim
    }

    fn distance_at_rate(&self, false_positive_rate: f64) -> Option<f64> {
        self.metadata(&format!("max_distance_fpr_{false_positive_rate}"))?.parse().ok().filter(|d| *d > 0.0)
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        let features = self.network.header.size_features;
        self.rows(segments.len(), |n, workspace, row| {
            let start = Instant::now();
            let turned = self.network.header.turned;
            sample::sample(&segments[n], turned, &mut workspace.order, &mut workspace.points);
            let mut measures = [f64::NAN; 7 + RINGS * RING_NUMBERS];
            if features > 0 {
                measures[..6].copy_from_slice(&log_sizes(&segments[n]));
            }
            let Context { above_ground, rings } = &segments[n].context;
            measures[6] = above_ground.map_or(f64::NAN, |h| f64::from(h).max(0.0).ln_1p());
            let around = rings.iter().flatten().map(|v| f64::from(*v));
            measures[features..].iter_mut().zip(around).for_each(|(to, v)| *to = v);
            let spent = start.elapsed();
            (self.network.describe(workspace, &measures[..self.network.header.measures()], row), spent)
        })
    }
}

impl std::fmt::Debug for XConv {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let header = &self.network.header;
        f.debug_struct("XConv")
            .field("variant", &header.variant)
            .field("plan", &header.plan.0)
            .finish_non_exhaustive()
    }
}

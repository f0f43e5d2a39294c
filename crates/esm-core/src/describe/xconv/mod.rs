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
mod parts;
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
pub use self::parts::{Part, PartTime};
use self::parts::{Probe, Stopwatch};
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
            (self.network.describe(workspace, &measures[n * each..][..each], row, &mut ()), Duration::ZERO)
        })
    }

    /// Describes segments one after the other on this thread, each `repeats` times, and tells how long each part of it takes at
    /// best, all segments together. The looking itself adds some 5 µs a segment.
    pub fn time_parts(&self, segments: &[Segment], repeats: usize) -> Vec<PartTime> {
        let header = &self.network.header;
        let joined = if header.context { header.measures() } else { 0 };
        let empty = |part| {
            let multiply_adds = segments.len() * header.plan.part_multiply_adds(part, header.learned, joined);
            PartTime { part, time: Duration::ZERO, multiply_adds }
        };
        let mut times: Vec<PartTime> = Part::all().into_iter().map(empty).collect();
        let mut workspace = self.network.workspace();
        let mut row = vec![0.0; self.dim()];
        for segment in segments {
            let mut best = [Duration::MAX; Part::NUMBER];
            for _ in 0..repeats {
                let mut watch = Stopwatch::new();
                let measures = self.prepare(segment, &mut workspace);
                watch.ended(Part::Sample);
                let measures = &measures[..header.measures()];
                self.network.describe(&mut workspace, measures, &mut row, &mut watch);
                best.iter_mut().zip(watch.spent).for_each(|(best, time)| *best = time.min(*best));
            }
            if repeats > 0 {
                times.iter_mut().zip(best).for_each(|(all, best)| all.time += best);
            }
        }
        times
    }

    /// The sampled points of a segment into the workspace; its sizes and context, those that the network knows first.
    fn prepare(&self, segment: &Segment, workspace: &mut Workspace) -> [f64; 7 + RINGS * RING_NUMBERS] {
        let header = &self.network.header;
        sample::sample(segment, header.turned, &mut workspace.order, &mut workspace.points);
        let mut measures = [f64::NAN; 7 + RINGS * RING_NUMBERS];
        if header.size_features > 0 {
            measures[..6].copy_from_slice(&log_sizes(segment));
        }
        let Context { above_ground, rings } = &segment.context;
        measures[6] = above_ground.map_or(f64::NAN, |h| f64::from(h).max(0.0).ln_1p());
        let around = rings.iter().flatten().map(|v| f64::from(*v));
        measures[header.size_features..].iter_mut().zip(around).for_each(|(to, v)| *to = v);
        measures
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
        self.rows(segments.len(), |n, workspace, row| {
            let start = Instant::now();
            let measures = self.prepare(&segments[n], workspace);
            let spent = start.elapsed();
            (
                self.network.describe(workspace, &measures[..self.network.header.measures()], row, &mut ()),
                spent,
            )
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

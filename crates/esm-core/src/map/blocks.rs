//! [`PointBlocks`]: the points of a mapped file are checksummed in blocks, each verified once, before its first use.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use memmap2::Mmap;
use rayon::prelude::*;

use super::column::Column;
use super::layout::{BLOCK_LEN, block_count, padded};
use super::problem::Problem;

const UNKNOWN: u8 = 0;
const GOOD: u8 = 1;
const BAD: u8 = 2;

/// The blocks of the points section and what is known about each.
pub(super) struct PointBlocks {
    file: Arc<Mmap>,
    /// The section with its padding, in the file.
    range: Range<usize>,
    /// Bytes of the section without its padding.
    len: usize,
    crcs: Column<u32>,
    /// A block may be verified by two threads at once; they agree, so relaxed order is enough.
    states: Vec<AtomicU8>,
}

impl PointBlocks {
    /// The section of `len` bytes at `offset`. `crcs` must hold one checksum a block.
    pub(super) fn new(
        file: &Arc<Mmap>,
        offset: usize,
        len: usize,
        crcs: Column<u32>,
    ) -> Result<Self, Problem> {
        let expected = block_count(len as u64);
        if expected != Some(crcs.len() as u64) {
            return Err(Problem::invalid(format!(
                "section PCRC holds {} checksums, {len} bytes of points need {}",
                crcs.len(),
                expected.map_or("more than fit".into(), |n| n.to_string()),
            )));
        }
        let range = padded(len as u64)
            .and_then(|l| usize::try_from(l).ok()?.checked_add(offset))
            .filter(|&end| end <= file.len())
            .map(|end| offset..end)
            .ok_or_else(|| Problem::damaged("section PNTS reaches beyond the file"))?;
        let states = (0..crcs.len()).map(|_| AtomicU8::new(UNKNOWN)).collect();
        Ok(Self { file: Arc::clone(file), range, len, crcs, states })
    }

    /// Verifies the blocks that hold `bytes` of the section, those not yet verified.
    pub(super) fn verify(&self, bytes: Range<usize>) -> Result<(), Problem> {
        if bytes.is_empty() {
            return Ok(());
        }
        let blocks = bytes.start / BLOCK_LEN..bytes.end.div_ceil(BLOCK_LEN);
        match blocks.clone().find(|&b| !self.is_good(b)) {
            Some(bad) => Err(self.problem(bad, 1)),
            None => Ok(()),
        }
    }

    /// Verifies all blocks not yet verified, on all threads; names the first bad one.
    pub(super) fn verify_all(&self) -> Result<(), Problem> {
        let bad: Vec<usize> = (0..self.states.len()).into_par_iter().filter(|&b| !self.is_good(b)).collect();
        match bad.first() {
            Some(&first) => Err(self.problem(first, bad.len())),
            None => Ok(()),
        }
    }

    fn is_good(&self, block: usize) -> bool {
        let Some(state) = self.states.get(block) else { return false };
        match state.load(Ordering::Relaxed) {
            UNKNOWN => {
                let good = self.matches(block);
                state.store(if good { GOOD } else { BAD }, Ordering::Relaxed);
                good
            }
            known => known == GOOD,
        }
    }

    fn matches(&self, block: usize) -> bool {
        let range = self.file_range(block);
        let padding = self.range.start + self.len..range.end;
        let bytes = &self.file[range];
        // The section's padding ends up in its last block; it is zero by definition.
        let padding_is_zero = self.file.get(padding).is_none_or(|p| p.iter().all(|&b| b == 0));
        padding_is_zero && self.crcs.get(block) == Some(&crc32fast::hash(bytes))
    }

    fn file_range(&self, block: usize) -> Range<usize> {
        let start = self.range.start + block * BLOCK_LEN;
        start..(start + BLOCK_LEN).min(self.range.end)
    }

    fn problem(&self, first: usize, bad: usize) -> Problem {
        let Range { start, end } = self.file_range(first);
        let more =
            if bad > 1 { format!("; {bad} of {} blocks do", self.states.len()) } else { String::new() };
        Problem::damaged(format!(
            "section PNTS: block {first} (bytes {start} to {end}) fails its checksum{more}"
        ))
    }
}

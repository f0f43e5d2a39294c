//! [`Product`]: exact search by matrix product, |q - m|^2 = |q|^2 - 2 q.m + |m|^2, blocks of the map at a time.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use rayon::prelude::*;

use super::{Neighbour, in_range, scan, settle};

/// Exact search by scanning the whole map with matrix products.
pub struct Product {
    descriptors: Vec<f32>,
    norms: Vec<f32>,
    largest_norm: f32,
    in_range: bool,
    dim: usize,
}

/// Map rows a block: with 64 queries the block's products stay in a 1 MiB second-level cache.
const BLOCK_ROWS: usize = 2048;

impl Product {
    /// Indexes row-major `descriptors` of `dim` numbers.
    pub fn new(descriptors: &[f32], dim: usize) -> Self {
        let dim = dim.max(1);
        let norms: Vec<f32> =
            descriptors.chunks_exact(dim).map(|row| row.iter().map(|v| v * v).sum()).collect();
        let largest_norm = norms.iter().copied().fold(0.0, f32::max);
        Self { descriptors: descriptors.to_vec(), norms, largest_norm, in_range: in_range(descriptors), dim }
    }

    /// Numbers a row.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// For every query row the `k` nearest rows, nearest first.
    pub fn nearest(&self, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        let dim = self.dim;
        let count = queries.len() / dim;
        let k = k.min(self.norms.len());
        if !self.in_range {
            return queries.par_chunks_exact(dim).map(|q| scan(q, &self.descriptors, k)).collect();
        }
        let margins: Vec<f32> = queries.chunks_exact(dim).map(|q| self.rounding_margin(q)).collect();
        // Each block keeps its own shortlist; which rows are on it depends on the block alone, and `settle` makes
        // the final order unique, so threads change nothing.
        let blocks: Vec<Vec<Shortlist>> = self
            .norms
            .par_chunks(BLOCK_ROWS)
            .enumerate()
            .map(|(b, norms)| self.scan_block(b * BLOCK_ROWS, norms, queries, k, &margins))
            .collect();
        (0..count)
            .into_par_iter()
            .map(|q| {
                let query = &queries[q * dim..][..dim];
                if !in_range(query) {
                    return scan(query, &self.descriptors, k);
                }
                let mut all = Shortlist::new(k, margins[q]);
                for block in &blocks {
                    for &(distance, row) in &block[q].entries {
                        all.offer(distance, row);
                    }
                }
                all.shrink();
                let rows = all.entries.iter().map(|e| e.1);
                settle(rows, query, &self.descriptors, k)
            })
            .collect()
    }

    fn scan_block(
        &self,
        first_row: usize,
        norms: &[f32],
        queries: &[f32],
        k: usize,
        margins: &[f32],
    ) -> Vec<Shortlist> {
        let (rows, count) = (norms.len(), margins.len());
        let mut products = vec![0.0f32; rows * count];
        matmul(
            MatMut::from_column_major_slice_mut(&mut products, rows, count),
            Accum::Replace,
            MatRef::from_row_major_slice(
                &self.descriptors[first_row * self.dim..][..rows * self.dim],
                rows,
                self.dim,
            ),
            MatRef::from_column_major_slice(&queries[..count * self.dim], self.dim, count),
            -2.0,
            Par::Seq,
        );
        products
            .chunks_exact(rows.max(1))
            .zip(margins)
            .map(|(column, &margin)| {
                let mut list = Shortlist::new(k, margin);
                for (r, (product, norm)) in column.iter().zip(norms).enumerate() {
                    list.offer(product + norm, (first_row + r) as u32);
                }
                list.shrink();
                list
            })
            .collect()
    }

    /// Bound of twice the rounding error of |m|^2 - 2 q.m in f32, so that no true neighbour is lost to it. The last term
    /// is for numbers so small that their squares underflow.
    fn rounding_margin(&self, query: &[f32]) -> f32 {
        let norm: f32 = query.iter().map(|v| v * v).sum();
        (self.dim as f32 + 8.0) * 4.0 * f32::EPSILON * (norm + self.largest_norm) + f32::MIN_POSITIVE
    }
}

/// The k smallest values seen so far and everything within the rounding margin of the k-th.
struct Shortlist {
    entries: Vec<(f32, u32)>,
    k: usize,
    margin: f32,
    threshold: f32,
}

impl Shortlist {
    fn new(k: usize, margin: f32) -> Self {
        let threshold = if k == 0 { f32::NEG_INFINITY } else { f32::INFINITY };
        Self { entries: Vec::new(), k, margin, threshold }
    }

    #[inline]
    fn offer(&mut self, distance: f32, row: u32) {
        if distance <= self.threshold {
            self.entries.push((distance, row));
            // Twice what was kept: shrinking costs linear time, so this keeps offers amortised constant even where
            // ties fill the list.
            if self.entries.len() >= self.entries.capacity().max(4 * self.k + 64) {
                self.shrink();
                self.entries.reserve(self.entries.len() + 4 * self.k + 64);
            }
        }
    }

    fn shrink(&mut self) {
        if self.k == 0 || self.entries.len() <= self.k {
            return;
        }
        let (_, kth, _) = self.entries.select_nth_unstable_by(self.k - 1, |a, b| a.0.total_cmp(&b.0));
        self.threshold = kth.0 + self.margin;
        let threshold = self.threshold;
        self.entries.retain(|e| e.0 <= threshold);
    }
}

//! [`Tree`]: the k-d tree search, by kiddo.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{Neighbour, settle};

/// A k-d tree over descriptors of up to [`Tree::MAX_DIM`] numbers. Rows are padded with zeros to the next size the
/// tree is compiled for, which changes no distance.
pub struct Tree {
    tree: Padded,
    descriptors: Vec<f32>,
    dim: usize,
}

enum Padded {
    D8(ImmutableKdTree<f32, 8>),
    D16(ImmutableKdTree<f32, 16>),
    D24(ImmutableKdTree<f32, 24>),
}

/// Relative slack on the tree's own distances, which may round differently: a few units in the last place of a sum
/// of 24 squares.
const SLACK: f32 = 1e-5;

impl Tree {
    /// Largest dimension served.
    pub const MAX_DIM: usize = 24;

    /// Indexes row-major `descriptors`; `None` where a k-d tree does not serve (too many dimensions, no rows).
    pub fn try_new(descriptors: &[f32], dim: usize) -> Option<Self> {
        if dim == 0 || descriptors.is_empty() {
            return None;
        }
        let tree = match dim {
            1..=8 => Padded::D8(build(descriptors, dim)?),
            9..=16 => Padded::D16(build(descriptors, dim)?),
            17..=24 => Padded::D24(build(descriptors, dim)?),
            _ => return None,
        };
        Some(Self { tree, descriptors: descriptors.to_vec(), dim })
    }

    /// For every query row the `k` nearest rows, nearest first.
    pub fn nearest(&self, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        queries
            .par_chunks(self.dim)
            .map(|query| {
                let rows = match &self.tree {
                    Padded::D8(tree) => candidates(tree, query, k),
                    Padded::D16(tree) => candidates(tree, query, k),
                    Padded::D24(tree) => candidates(tree, query, k),
                };
                settle(rows.into_iter(), query, &self.descriptors, k)
            })
            .collect()
    }
}

fn pad<const D: usize>(row: &[f32]) -> [f32; D] {
    let mut padded = [0.0; D];
    padded[..row.len()].copy_from_slice(row);
    padded
}

fn build<const D: usize>(descriptors: &[f32], dim: usize) -> Option<ImmutableKdTree<f32, D>> {
    let rows: Vec<[f32; D]> = descriptors.chunks_exact(dim).map(pad).collect();
    ImmutableKdTree::new_from_slice(&rows).ok()
}

/// Every row that may be among the `k` nearest: all within the tree's k-th distance and a slack for rounding. The
/// second search also brings in the ties at the k-th distance, of which the first keeps an arbitrary few.
fn candidates<const D: usize>(tree: &ImmutableKdTree<f32, D>, query: &[f32], k: usize) -> Vec<u32> {
    let Some(count) = NonZero::new(k) else { return Vec::new() };
    let query = pad::<D>(query);
    let first = tree.query(&query).nearest_n::<SquaredEuclidean<f32>>(count).execute();
    let Some(last) = first.last() else { return Vec::new() };
    let reach = last.distance * (1.0 + SLACK) + f32::MIN_POSITIVE;
    let found = tree.query(&query).within::<SquaredEuclidean<f32>>(reach).unsorted().execute();
    found.into_iter().map(|n| n.item).collect()
}

//! [`Tree`]: the k-d tree search, by kiddo.

use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use super::{Neighbour, in_range, scan, settle};

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

/// Neighbours asked of the tree beyond those wanted.
const SPARE: usize = 2;

impl Tree {
    /// Largest dimension served.
    pub const MAX_DIM: usize = 24;

    /// Indexes row-major `descriptors`; `None` where a k-d tree does not serve: more dimensions than
    /// [`MAX_DIM`](Self::MAX_DIM), no rows, or numbers beyond 1e16 (squared distances might overflow).
    pub fn try_new(descriptors: &[f32], dim: usize) -> Option<Self> {
        if dim == 0 || descriptors.is_empty() || !in_range(descriptors) {
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

    /// Numbers a row.
    pub fn dim(&self) -> usize {
        self.dim
    }

    /// For every query row the `k` nearest rows, nearest first.
    pub fn nearest(&self, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        // The tree makes room for as many as it is asked for.
        let k = k.min(self.descriptors.len() / self.dim);
        queries
            .par_chunks_exact(self.dim)
            .map(|query| {
                if !in_range(query) {
                    return scan(query, &self.descriptors, k);
                }
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

/// Every row that may be among the `k` nearest: all within the tree's k-th distance and a slack for rounding. A few more
/// than `k` are asked for: where the last of them lies beyond the slack, nothing was left out. Otherwise (many ties at
/// the k-th distance, of which the tree keeps an arbitrary few) a second search brings in the rest.
fn candidates<const D: usize>(tree: &ImmutableKdTree<f32, D>, query: &[f32], k: usize) -> Vec<u32> {
    let (Some(wanted), Some(count)) = (k.checked_sub(1), NonZero::new(k + SPARE)) else { return Vec::new() };
    let query = pad::<D>(query);
    let first = tree.query(&query).nearest_n::<SquaredEuclidean<f32>>(count).execute();
    let (Some(kth), Some(last)) = (first.get(wanted), first.last()) else { return Vec::new() };
    let reach = kth.distance * (1.0 + SLACK) + f32::MIN_POSITIVE;
    if first.len() < count.get() || last.distance > reach {
        return first.into_iter().map(|n| n.item).collect();
    }
    let found = tree.query(&query).within::<SquaredEuclidean<f32>>(reach).unsorted().execute();
    found.into_iter().map(|n| n.item).collect()
}

//! The K nearest map descriptors of every live descriptor (squared L2), for a whole cloud at once.
//!
//! Two searches with the same answers to the bit: a k-d tree ([`Tree`]) for few dimensions, and an exact scan by
//! matrix product ([`Product`]) for many. Both use their own arithmetic only to find candidates; the distances that
//! count are computed again in one fixed order, and ties go to the lower index.

mod product;
mod tree;

pub use product::Product;
pub use tree::Tree;

use serde::{Deserialize, Serialize};

/// One neighbour: a map row and its squared distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Row of the map's descriptors.
    pub row: u32,
    /// Squared L2 distance in descriptor space.
    pub distance: f32,
}

/// Which search to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Search {
    /// The faster of the two for the map's size and dimension, by the measurements of `cargo bench --bench index`.
    #[default]
    Auto,
    /// The k-d tree.
    Tree,
    /// The matrix product.
    Product,
}

/// An index over the map's descriptors.
pub enum Index {
    /// By k-d tree.
    Tree(Tree),
    /// By matrix product.
    Product(Product),
}

/// Up to this many dimensions the k-d tree wins for maps of more than [`TREE_MIN_ROWS`] rows.
const TREE_MAX_DIM: usize = 13;
/// Below this many rows a scan is cheaper than a tree walk.
const TREE_MIN_ROWS: usize = 1000;

impl Index {
    /// Indexes `descriptors`: row-major, `dim` numbers a row, all finite.
    pub fn new(descriptors: &[f32], dim: usize, search: Search) -> Self {
        let rows = descriptors.len() / dim.max(1);
        let tree = match search {
            Search::Tree => true,
            Search::Product => false,
            Search::Auto => dim <= TREE_MAX_DIM && rows >= TREE_MIN_ROWS,
        };
        match tree.then(|| Tree::try_new(descriptors, dim)).flatten() {
            Some(tree) => Self::Tree(tree),
            None => Self::Product(Product::new(descriptors, dim)),
        }
    }

    /// For every query row the `k` nearest rows, nearest first (all rows where there are fewer).
    ///
    /// The result holds one list a query, in the order of the queries.
    pub fn nearest(&self, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        match self {
            Self::Tree(tree) => tree.nearest(queries, k),
            Self::Product(product) => product.nearest(queries, k),
        }
    }
}

/// The distance that counts: differences squared and summed in the order of the dimensions.
fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// Sorts candidates by the distance that counts and keeps `k`.
fn settle(candidates: impl Iterator<Item = u32>, query: &[f32], map: &[f32], k: usize) -> Vec<Neighbour> {
    let dim = query.len();
    let mut found: Vec<Neighbour> = candidates
        .map(|row| Neighbour { row, distance: squared_distance(query, &map[row as usize * dim..][..dim]) })
        .collect();
    found.sort_unstable_by(|a, b| a.distance.total_cmp(&b.distance).then(a.row.cmp(&b.row)));
    found.truncate(k);
    found
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn brute_force(map: &[f32], dim: usize, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        let rows = (map.len() / dim) as u32;
        queries.chunks(dim).map(|q| settle(0..rows, q, map, k)).collect()
    }

    proptest! {
        #[test]
        fn both_searches_equal_brute_force(
            dim in 1usize..20,
            k in 1usize..30,
            // A coarse lattice makes ties and duplicates common; the offset makes cancellation severe.
            values in prop::collection::vec(-4i8..4, 20..3000),
            offset in prop::sample::select(vec![0.0f32, 100.0, 3000.0]),
        ) {
            let values: Vec<f32> = values.iter().map(|v| *v as f32 * 0.3 + offset).collect();
            let rows = values.len() / dim;
            let map = &values[..rows * dim];
            let queries = &values[..rows.min(7) * dim];
            let want = brute_force(map, dim, queries, k);
            prop_assert_eq!(&Product::new(map, dim).nearest(queries, k), &want);
            if let Some(tree) = Tree::try_new(map, dim) {
                prop_assert_eq!(&tree.nearest(queries, k), &want);
            }
        }
    }

    #[test]
    fn an_empty_map_has_no_neighbours() {
        assert_eq!(Index::new(&[], 13, Search::Auto).nearest(&[0.0; 26], 5), vec![vec![], vec![]]);
        assert_eq!(Index::new(&[], 13, Search::Tree).nearest(&[0.0; 13], 5), vec![vec![]]);
    }
}

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

/// Where the k-d tree pays: up to so many dimensions from so many rows on (the first line that covers the dimension).
///
/// Time of the tree over time of the product, one thread, 50 queries, k = 25 to 60, by `cargo bench --bench index`; `low`
/// is data of 6 latent dimensions and noise, as descriptors of segments are taken to be, `full` is isotropic:
///
/// | dim, data | 1,000 rows | 3,000      | 10,000     | 30,000     | 100,000    |
/// |-----------|------------|------------|------------|------------|------------|
/// | 7, low    | 0.6 to 1.4 | 0.3 to 1.3 | 0.5 to 0.9 | 0.3 to 0.4 | 0.1        |
/// | 7, full   | 1.2 to 3.1 | 1.2 to 1.6 | 0.7 to 1.1 | 0.4 to 0.5 | 0.2        |
/// | 13, low   | 2.6 to 4.0 | 2.2 to 2.7 | 1.3 to 1.8 | 0.7 to 1.1 | 0.4 to 0.5 |
/// | 13, full  | 4.1 to 6.0 | 4.0 to 5.2 | 3.0 to 3.9 | 2.8 to 3.7 | 2.2 to 2.4 |
/// | 16, low   | 2.0 to 3.8 | 2.1 to 3.3 | 1.7 to 2.3 | 1.2 to 1.9 | 0.6 to 0.8 |
/// | 16, full  | 3.7 to 4.3 | 3.0 to 4.6 | 3.8 to 4.4 | 4.0 to 4.2 | 3.1 to 3.6 |
const TREE_PAYS: [(usize, usize); 2] = [(7, 10_000), (13, 50_000)];

/// Whether [`Search::Auto`] is the tree.
fn tree_pays(rows: usize, dim: usize) -> bool {
    TREE_PAYS.iter().find(|(max_dim, _)| dim <= *max_dim).is_some_and(|(_, min_rows)| rows >= *min_rows)
}

impl Index {
    /// Indexes `descriptors`: row-major, `dim` numbers a row, all finite. Where [`Search::Tree`] is asked for and does
    /// not serve (see [`Tree::try_new`]), it is the matrix product.
    pub fn new(descriptors: &[f32], dim: usize, search: Search) -> Self {
        let rows = descriptors.len() / dim.max(1);
        let tree = match search {
            Search::Tree => true,
            Search::Product => false,
            Search::Auto => tree_pays(rows, dim),
        };
        match tree.then(|| Tree::try_new(descriptors, dim)).flatten() {
            Some(tree) => Self::Tree(tree),
            None => Self::Product(Product::new(descriptors, dim)),
        }
    }

    /// Numbers a row.
    pub fn dim(&self) -> usize {
        match self {
            Self::Tree(tree) => tree.dim(),
            Self::Product(product) => product.dim(),
        }
    }

    /// For every query row the `k` nearest rows, nearest first (all rows where there are fewer).
    ///
    /// The result holds one list a query, in the order of the queries, whose numbers must be finite.
    pub fn nearest(&self, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        match self {
            Self::Tree(tree) => tree.nearest(queries, k),
            Self::Product(product) => product.nearest(queries, k),
        }
    }
}

/// Numbers up to this size are far from overflow in distances and norms of any number of dimensions a map may have.
/// Rows beyond it (they are finite, so a file may hold them) are compared one by one.
const LARGEST: f32 = 1e16;

/// Whether products and sums of squares of these numbers are finite.
fn in_range(values: &[f32]) -> bool {
    values.iter().all(|v| v.abs() <= LARGEST)
}

/// The search that needs no thought: every row, by the distance that counts.
fn scan(query: &[f32], map: &[f32], k: usize) -> Vec<Neighbour> {
    settle(0..(map.len() / query.len()) as u32, query, map, k)
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

    /// Written apart from [`scan`] and [`settle`]: it sorts everything and looks at nothing twice.
    fn brute_force(map: &[f32], dim: usize, queries: &[f32], k: usize) -> Vec<Vec<Neighbour>> {
        let one = |query: &[f32]| {
            let mut all: Vec<Neighbour> = Vec::new();
            for (row, values) in map.chunks(dim).enumerate() {
                let mut distance = 0.0;
                for (a, b) in query.iter().zip(values) {
                    distance += (a - b) * (a - b);
                }
                all.push(Neighbour { row: row as u32, distance });
            }
            // Stable: ties stay in the order of the rows.
            all.sort_by(|a, b| a.distance.partial_cmp(&b.distance).unwrap());
            all.truncate(k);
            all
        };
        queries.chunks(dim).map(one).collect()
    }

    /// Numbers between -1 and 1, the same in every run.
    fn noise(n: usize, seed: u64) -> Vec<f32> {
        use rand_chacha::rand_core::{Rng, SeedableRng};
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        (0..n).map(|_| random.next_u32() as f32 / (1u32 << 31) as f32 - 1.0).collect()
    }

    fn both_agree(map: &[f32], dim: usize, queries: &[f32], k: usize) -> Result<(), TestCaseError> {
        let want = brute_force(map, dim, queries, k);
        let searches = [Search::Tree, Search::Product, Search::Auto].map(|s| Index::new(map, dim, s));
        for index in searches {
            prop_assert_eq!(&index.nearest(queries, k), &want);
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn all_searches_equal_brute_force(
            dim in 1usize..28,
            k in 0usize..30,
            // A coarse lattice makes ties and duplicates common; the offset makes cancellation severe.
            values in prop::collection::vec(-4i8..4, 0..3000),
            offset in prop::sample::select(vec![0.0f32, 100.0, 3000.0]),
        ) {
            let values: Vec<f32> = values.iter().map(|v| *v as f32 * 0.3 + offset).collect();
            let rows = values.len() / dim;
            both_agree(&values[..rows * dim], dim, &values[..rows.min(7) * dim], k)?;
        }

        /// From below the smallest normal number to where squares overflow, in rows that are not queries as well.
        #[test]
        fn size_changes_no_answer(
            dim in 1usize..28,
            k in 0usize..70,
            rows in 1usize..300,
            scale in prop::sample::select(vec![1e-44f32, 1e-30, 1e-20, 1e-5, 1e3, 1e15, 1e16, 1e18, 1e19, 3e38]),
            query_scale in prop::option::of(prop::sample::select(vec![1e-30f32, 1.0, 1e17, 3e38])),
            seed in any::<u64>(),
        ) {
            let map: Vec<f32> = noise(rows * dim, seed).iter().map(|v| v * scale).collect();
            let queries: Vec<f32> =
                noise(5 * dim, !seed).iter().map(|v| v * query_scale.unwrap_or(scale)).collect();
            both_agree(&map, dim, &queries, k)?;
        }
    }

    #[test]
    fn a_map_of_many_blocks_is_searched_whole() {
        let (dim, rows) = (13, 3 * 2048 + 1);
        let (map, queries) = (noise(rows * dim, 1), noise(20 * dim, 2));
        both_agree(&map, dim, &queries, 60).unwrap();
        // The last row, alone in its block, is found.
        let last = Index::new(&map, dim, Search::Product).nearest(&map[(rows - 1) * dim..], 1);
        assert_eq!(last, [[Neighbour { row: rows as u32 - 1, distance: 0.0 }]]);
        // Nothing but ties: the first rows, in order.
        for search in [Search::Tree, Search::Product] {
            let found = Index::new(&vec![0.5; rows * dim], dim, search).nearest(&vec![0.25; dim], 60);
            let order: Vec<u32> = found[0].iter().map(|n| n.row).collect();
            assert_eq!(order, (0..60).collect::<Vec<_>>(), "{search:?}");
        }
    }

    #[test]
    fn threads_change_nothing() {
        let (dim, rows) = (9, 9000);
        let (map, queries) = (noise(rows * dim, 3), noise(50 * dim, 4));
        for search in [Search::Tree, Search::Product] {
            let with = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| Index::new(&map, dim, search).nearest(&queries, 25))
            };
            assert_eq!(with(1), with(7), "{search:?}");
        }
    }

    #[test]
    fn counts_out_of_range_are_met_with_what_there_is() {
        let map = noise(10 * 3, 5);
        for search in [Search::Tree, Search::Product, Search::Auto] {
            let index = Index::new(&map, 3, search);
            // More than there are, without room being made for them.
            assert_eq!(index.nearest(&map, usize::MAX), index.nearest(&map, 10));
            assert_eq!(index.nearest(&map, 10)[9].len(), 10);
            assert_eq!(index.nearest(&map, 0), vec![vec![]; 10]);
            assert!(index.nearest(&[], 5).is_empty());
            assert!(Index::new(&[], 0, search).nearest(&[], 5).is_empty());
            assert_eq!(Index::new(&[], 13, search).nearest(&[0.0; 26], 5), vec![vec![], vec![]]);
        }
    }

    #[test]
    fn the_search_is_the_one_asked_for_where_it_serves() {
        let is_tree = |rows: usize, dim: usize, search| {
            matches!(Index::new(&noise(rows * dim, 6), dim, search), Index::Tree(_))
        };
        assert!(is_tree(5, Tree::MAX_DIM, Search::Tree));
        assert!(!is_tree(5, Tree::MAX_DIM + 1, Search::Tree));
        assert!(!is_tree(0, 3, Search::Tree));
        assert!(!is_tree(5, 3, Search::Product));
        for (dim, rows) in TREE_PAYS {
            assert!(is_tree(rows, dim, Search::Auto));
            assert!(!is_tree(rows - 1, dim, Search::Auto));
            assert!(!is_tree(rows, dim + 1, Search::Auto));
        }
        assert!(Tree::try_new(&[1.0, 1e17], 2).is_none());
    }
}

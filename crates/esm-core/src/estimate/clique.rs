//! The largest set of candidates that all agree with each other: an exact maximum clique with bounded effort.

use super::consistency::{ConsistencyGraph, Cores};

/// A clique and whether it is proven to be the largest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Clique {
    /// Candidate indices, ascending.
    pub members: Vec<u32>,
    /// False where the effort ran out first: the clique is then the largest one found.
    pub proven: bool,
}

/// Largest clique of more than `larger_than` vertices among those for which `allowed` holds; empty where there is
/// none. `effort` bounds the branches visited.
///
/// Vertices are taken in degeneracy order, so each branch works on at most as many vertices as the graph's core
/// number; within a branch, bitsets and a greedy colouring bound (Tomita and Seki 2003).
pub fn max_clique(
    graph: &ConsistencyGraph,
    cores: &Cores,
    allowed: &[bool],
    larger_than: usize,
    effort: usize,
) -> Clique {
    let Cores { numbers: cores, order } = cores;
    let mut rank = vec![0u32; graph.len()];
    for (r, v) in order.iter().enumerate() {
        rank[*v as usize] = r as u32;
    }
    let mut search = Search { best: Vec::new(), size: larger_than, effort };
    // The densest part of the graph comes last in the order: begin there, where a large clique is likely.
    for &v in order.iter().rev() {
        if !allowed[v as usize] || (cores[v as usize] as usize) < search.size {
            continue;
        }
        let later: Vec<u32> = graph
            .neighbours(v)
            .iter()
            .copied()
            .filter(|u| allowed[*u as usize] && rank[*u as usize] > rank[v as usize])
            .filter(|u| cores[*u as usize] as usize >= search.size)
            .collect();
        if later.len() < search.size {
            continue;
        }
        let branch = Branch::new(graph, &later);
        branch.expand(&mut vec![v], branch.all(), &mut search);
    }
    search.best.sort_unstable();
    Clique { members: search.best, proven: search.effort > 0 }
}

struct Search {
    best: Vec<u32>,
    /// Only cliques larger than this count.
    size: usize,
    effort: usize,
}

/// The subgraph of one branch, as a bit matrix.
struct Branch<'a> {
    vertices: &'a [u32],
    words: usize,
    adjacent: Vec<u64>,
}

impl<'a> Branch<'a> {
    fn new(graph: &ConsistencyGraph, vertices: &'a [u32]) -> Self {
        let words = vertices.len().div_ceil(64);
        let mut adjacent = vec![0u64; words * vertices.len()];
        for (i, v) in vertices.iter().enumerate() {
            // Both lists ascend: one merge finds the common vertices.
            let (mut j, neighbours) = (0, graph.neighbours(*v));
            for u in neighbours {
                while j < vertices.len() && vertices[j] < *u {
                    j += 1;
                }
                if j < vertices.len() && vertices[j] == *u {
                    adjacent[i * words + j / 64] |= 1 << (j % 64);
                }
            }
        }
        Self { vertices, words, adjacent }
    }

    fn all(&self) -> Vec<u64> {
        let mut set = vec![u64::MAX; self.words];
        if !self.vertices.len().is_multiple_of(64) {
            set[self.words - 1] = (1 << (self.vertices.len() % 64)) - 1;
        }
        set
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.adjacent[i * self.words..][..self.words]
    }

    fn expand(&self, clique: &mut Vec<u32>, mut set: Vec<u64>, search: &mut Search) {
        if search.effort == 0 {
            return;
        }
        search.effort -= 1;
        let colours = self.colour(&set);
        for &(i, colour) in colours.iter().rev() {
            if clique.len() + colour <= search.size {
                return;
            }
            clique.push(self.vertices[i]);
            let inner: Vec<u64> = set.iter().zip(self.row(i)).map(|(a, b)| a & b).collect();
            if inner.iter().any(|w| *w != 0) {
                self.expand(clique, inner, search);
            } else if clique.len() > search.size {
                search.size = clique.len();
                search.best = clique.clone();
            }
            clique.pop();
            set[i / 64] &= !(1 << (i % 64));
        }
    }

    /// Greedy colouring: vertices with the number of colours needed up to them, ascending. A clique within a prefix
    /// is no larger than its colour.
    fn colour(&self, set: &[u64]) -> Vec<(usize, usize)> {
        let mut left = set.to_vec();
        let mut coloured = Vec::new();
        let mut colour = 0;
        while left.iter().any(|w| *w != 0) {
            colour += 1;
            let mut independent = left.clone();
            while let Some(w) = independent.iter().position(|w| *w != 0) {
                let bit = independent[w].trailing_zeros() as usize;
                let i = w * 64 + bit;
                coloured.push((i, colour));
                left[w] &= !(1 << bit);
                independent[w] &= !(1 << bit);
                for (a, b) in independent.iter_mut().zip(self.row(i)) {
                    *a &= !b;
                }
            }
        }
        coloured
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn naive(graph: &ConsistencyGraph, members: &mut Vec<u32>, from: u32) -> usize {
        let mut best = members.len();
        for v in from..graph.len() as u32 {
            if members.iter().all(|m| graph.agree(*m, v)) {
                members.push(v);
                best = best.max(naive(graph, members, v + 1));
                members.pop();
            }
        }
        best
    }

    proptest! {
        #[test]
        fn the_largest_clique_is_found(bits in prop::collection::vec(any::<bool>(), 14 * 13 / 2)) {
            let mut bits = bits.into_iter();
            let mut edges = Vec::new();
            for a in 0..14u32 {
                for b in 0..a {
                    if bits.next() == Some(true) {
                        edges.push((a, b));
                    }
                }
            }
            let graph = ConsistencyGraph::from_edges(14, &edges);
            let found = max_clique(&graph, &graph.cores(), &[true; 14], 0, usize::MAX);
            prop_assert!(found.proven);
            prop_assert_eq!(found.members.len(), naive(&graph, &mut Vec::new(), 0));
            for a in &found.members {
                for b in &found.members {
                    prop_assert!(a == b || graph.agree(*a, *b));
                }
            }
            prop_assert!(max_clique(&graph, &graph.cores(), &[true; 14], found.members.len(), usize::MAX).members.is_empty());
        }
    }

    #[test]
    fn a_large_clique_is_found_among_many_words() {
        // 200 vertices of which every third forms a clique.
        let edges: Vec<_> = (0..200u32)
            .flat_map(|a| (0..200u32).map(move |b| (a, b)))
            .filter(|(a, b)| a < b && ((a % 3 == 0 && b % 3 == 0) || (a + b) % 7 == 0))
            .collect();
        let graph = ConsistencyGraph::from_edges(200, &edges);
        let found = max_clique(&graph, &graph.cores(), &[true; 200], 0, 100_000);
        assert_eq!(found.members, (0..200).filter(|v| v % 3 == 0).collect::<Vec<u32>>());
    }

    #[test]
    fn spent_effort_is_told() {
        let edges: Vec<_> = (0..30u32).flat_map(|a| (0..a).map(move |b| (a, b))).collect();
        let graph = ConsistencyGraph::from_edges(30, &edges);
        assert!(!max_clique(&graph, &graph.cores(), &[true; 30], 0, 1).proven);
    }
}

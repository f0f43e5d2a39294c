//! The largest set of candidates that all agree with each other: an exact maximum clique with bounded effort.

use super::branch::{Best, Branch};
use super::consistency::ConsistencyGraph;
use super::turns::{agreeing, cores};

/// A clique and whether it is proven to be the largest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Clique {
    /// Candidate indices, ascending.
    pub members: Vec<u32>,
    /// False where the effort ran out first: the clique is then the largest one found.
    pub proven: bool,
    /// Branches visited.
    pub branches: usize,
}

/// Largest clique of more than `larger_than` candidates among those for which `allowed` holds; empty where there is
/// none. `effort` bounds the branches visited. Where gravity is known its members all allow one and the same turn about
/// the up axis, as matches of one pose do.
pub fn max_clique(graph: &ConsistencyGraph, allowed: &[bool], larger_than: usize, effort: usize) -> Clique {
    Cliques::new(graph, cores(graph, larger_than + 1)).largest(allowed, larger_than, effort)
}

/// Looks for the largest cliques of a graph, one after the other.
///
/// A vertex is looked at together with the neighbours that agree with it on one turn: few, even where a dense wood lets
/// hundreds agree on the length. Counting those for all turns at once bounds every vertex first ([`TurnCounts`]); those that
/// promise most come first, and nearly all others need not be looked at.
///
/// [`TurnCounts`]: super::turns::TurnCounts
pub(super) struct Cliques<'a> {
    graph: &'a ConsistencyGraph,
    /// Turns on which each vertex may belong to a clique of the size looked for.
    turns: Vec<u64>,
    /// No clique with this vertex is larger.
    bound: Vec<u32>,
    /// One more than the number of a vertex in the branch at hand; 0 outside.
    slot: Vec<u32>,
    branch: Branch,
}

/// A neighbour of the vertex at hand and the turns that both allow.
type Partner = (u32, u64);

impl<'a> Cliques<'a> {
    /// `turns`: those on which each vertex may belong to a clique of the size looked for ([`cores`]).
    pub(super) fn new(graph: &'a ConsistencyGraph, turns: Vec<u64>) -> Self {
        let bound = |v: usize| match turns[v] {
            0 => 0,
            own => 1 + agreeing(graph, v as u32, |u| own & turns[u as usize]).most() as u32,
        };
        let bound = (0..graph.len()).map(bound).collect();
        Self { graph, bound, slot: vec![0; graph.len()], branch: Branch::default(), turns }
    }

    /// Largest clique of more than `larger_than` candidates among those for which `allowed` holds.
    pub(super) fn largest(&mut self, allowed: &[bool], larger_than: usize, effort: usize) -> Clique {
        let count = self.graph.len() as u32;
        let mut open: Vec<bool> = (0..count).map(|v| allowed[self.graph.candidate(v) as usize]).collect();
        let mut order: Vec<u32> = (0..count)
            .filter(|v| open[*v as usize] && self.bound[*v as usize] as usize > larger_than)
            .collect();
        order.sort_by_key(|v| std::cmp::Reverse(self.bound[*v as usize]));
        let mut best = Best { members: Vec::new(), size: larger_than, effort };
        let mut members = Vec::new();
        let mut partners: Vec<Partner> = Vec::new();
        for v in order {
            if best.effort == 0 || self.bound[v as usize] as usize <= best.size {
                break;
            }
            // All cliques with v are seen now: it is of no use to later vertices.
            open[v as usize] = false;
            let own = self.turns[v as usize];
            let (turns, bound) = (&self.turns, &self.bound);
            let counted = |u: u32| {
                let (u, own) = (u as usize, own);
                if open[u] && bound[u] as usize > best.size { own & turns[u] } else { 0 }
            };
            let promising = agreeing(self.graph, v, counted).at_least(best.size);
            if promising == 0 {
                continue;
            }
            partners.clear();
            partners.extend(
                self.graph
                    .edges_of(v)
                    .map(|(u, t)| (u, t.bits() & promising & counted(u)))
                    .filter(|p| p.1 != 0),
            );
            self.look_at(v, promising, &partners, &mut best, &mut members);
        }
        members.sort_unstable();
        Clique { members, proven: best.effort > 0, branches: effort - best.effort }
    }

    /// Searches the cliques of `v` with its partners, one turn after the other.
    fn look_at(
        &mut self,
        v: u32,
        promising: u64,
        partners: &[Partner],
        best: &mut Best,
        members: &mut Vec<u32>,
    ) {
        let on = |bin: u32| partners.iter().filter(move |p| p.1 >> bin & 1 == 1);
        let mut bins: Vec<(usize, u32)> =
            (0..64).filter(|bin| promising >> bin & 1 == 1).map(|bin| (on(bin).count(), bin)).collect();
        bins.sort_by_key(|(count, bin)| (std::cmp::Reverse(*count), *bin));
        let mut seen = 0u64;
        for (count, bin) in bins {
            // Neighbouring bins mostly hold the same partners, or fewer of them.
            let repeated = partners.iter().filter(|p| p.1 >> bin & 1 == 1).fold(seen, |all, p| all & p.1);
            if count < best.size || repeated != 0 {
                continue;
            }
            seen |= 1 << bin;
            let found = self.search_on(bin, on(bin).map(|p| p.0).collect(), best);
            if let Some(mut others) = found {
                others.push(v);
                *members = others.iter().map(|u| self.graph.candidate(*u)).collect();
            }
        }
    }

    /// The largest clique among vertices that all agree with the vertex at hand on one turn, if that makes one larger
    /// than the best.
    fn search_on(&mut self, bin: u32, mut vertices: Vec<u32>, best: &mut Best) -> Option<Vec<u32>> {
        self.fill(bin, &vertices);
        // The best connected first: it gets the lowest colour, and the search begins with the last.
        let degree: Vec<u32> = (0..vertices.len()).map(|i| self.branch.degree(i)).collect();
        let mut order: Vec<usize> =
            (0..vertices.len()).filter(|i| degree[*i] as usize + 2 > best.size).collect();
        order.sort_by_key(|i| std::cmp::Reverse(degree[*i]));
        vertices = order.iter().map(|i| vertices[*i]).collect();
        self.fill(bin, &vertices);
        let mut inner = Best { members: Vec::new(), size: best.size.saturating_sub(1), effort: best.effort };
        self.branch.search(&mut inner);
        best.effort = inner.effort;
        if inner.members.is_empty() {
            return None;
        }
        best.size = inner.size + 1;
        Some(inner.members.iter().map(|i| vertices[*i as usize]).collect())
    }

    /// The branch's bit matrix: vertices joined when they agree on the turn.
    fn fill(&mut self, bin: u32, vertices: &[u32]) {
        self.branch.reset(vertices.len());
        for (i, v) in vertices.iter().enumerate() {
            self.slot[*v as usize] = i as u32 + 1;
        }
        for (i, v) in vertices.iter().enumerate() {
            for (u, turns) in self.graph.edges_of(*v) {
                let slot = self.slot[u as usize];
                if slot != 0 && turns.bits() >> bin & 1 == 1 {
                    self.branch.join(i, slot as usize - 1);
                }
            }
        }
        for v in vertices {
            self.slot[*v as usize] = 0;
        }
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
            let found = max_clique(&graph, &[true; 14], 0, usize::MAX);
            prop_assert!(found.proven);
            prop_assert_eq!(found.members.len(), naive(&graph, &mut Vec::new(), 0));
            for a in &found.members {
                for b in &found.members {
                    prop_assert!(a == b || graph.agree(*a, *b));
                }
            }
            prop_assert!(max_clique(&graph, &[true; 14], found.members.len(), usize::MAX).members.is_empty());
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
        let found = max_clique(&graph, &[true; 200], 0, 100_000);
        assert_eq!(found.members, (0..200).filter(|v| v % 3 == 0).collect::<Vec<u32>>());
    }

    #[test]
    fn spent_effort_is_told() {
        let edges: Vec<_> = (0..30u32).flat_map(|a| (0..a).map(move |b| (a, b))).collect();
        let graph = ConsistencyGraph::from_edges(30, &edges);
        let found = max_clique(&graph, &[true; 30], 0, 1);
        assert!(!found.proven && found.branches == 1);
    }
}

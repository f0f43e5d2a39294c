//! How many live segments can agree on one turn: counters for all bins of the circle at once.

use super::consistency::ConsistencyGraph;

/// 64 counters, one a bin, as the planes of a binary number: adding a set of bins takes a few steps, however many.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TurnCounts {
    planes: [u64; 16],
}

impl TurnCounts {
    /// Counts one up in each bin of the set; a count ends at 65,535.
    #[inline]
    pub(super) fn add(&mut self, bins: u64) {
        let mut carry = bins;
        for plane in &mut self.planes {
            if carry == 0 {
                return;
            }
            (*plane, carry) = (*plane ^ carry, *plane & carry);
        }
    }

    /// The largest count.
    pub(super) fn most(&self) -> usize {
        let (mut bins, mut most) = (u64::MAX, 0);
        for (digit, plane) in self.planes.iter().enumerate().rev() {
            if bins & plane != 0 {
                bins &= plane;
                most |= 1 << digit;
            }
        }
        most
    }

    /// The bins with a count of at least `least`.
    pub(super) fn at_least(&self, least: usize) -> u64 {
        let (mut equal, mut more) = (u64::MAX, 0);
        for (digit, plane) in self.planes.iter().enumerate().rev() {
            if least >> digit & 1 == 1 {
                equal &= plane;
            } else {
                more |= equal & plane;
                equal &= !plane;
            }
        }
        if least >> self.planes.len() > 0 { 0 } else { more | equal }
    }
}

/// For each turn the number of live segments among the neighbours of `v` that agree with it on that turn: a group of
/// matches that one pose explains has at most one more in its bin. Only neighbours that `counted` gives bins for, in those.
pub(super) fn agreeing(graph: &ConsistencyGraph, v: u32, counted: impl Fn(u32) -> u64) -> TurnCounts {
    let mut counts = TurnCounts::default();
    // Neighbours of one live segment lie together: it counts once a turn.
    let (mut live, mut bins) = (u32::MAX, 0);
    for (u, turns) in graph.edges_of(v) {
        if graph.live(u) != live {
            counts.add(bins);
            (live, bins) = (graph.live(u), 0);
        }
        bins |= turns.bits() & counted(u);
    }
    counts.add(bins);
    counts
}

/// For each vertex the turns on which it may belong to a group of `size` matches that one pose explains: the core of
/// the graph of each turn, all found at once. Found to within [`ROUNDS`] of pruning: what is left may be more.
pub(super) fn cores(graph: &ConsistencyGraph, size: usize) -> Vec<u64> {
    pruned(graph, size, ROUNDS)
}

/// The same without looking: any vertex on any turn that it allows by itself.
pub(super) fn anywhere(graph: &ConsistencyGraph) -> Vec<u64> {
    graph.alone().to_vec()
}

/// Rounds of pruning: more find little that the search does not find at once.
const ROUNDS: usize = 2;

fn pruned(graph: &ConsistencyGraph, size: usize, rounds: usize) -> Vec<u64> {
    let mut alive = anywhere(graph);
    for _ in 0..rounds {
        let mut changed = false;
        for v in 0..graph.len() {
            if alive[v] != 0 {
                let left =
                    alive[v] & agreeing(graph, v as u32, |u| alive[u as usize]).at_least(size.max(1) - 1);
                changed |= left != alive[v];
                alive[v] = left;
            }
        }
        if !changed {
            break;
        }
    }
    alive
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn counts_equal_naive_counts(sets in prop::collection::vec(any::<u64>(), 0..70), least in 0usize..80) {
            let mut counts = TurnCounts::default();
            sets.iter().for_each(|s| counts.add(*s));
            let naive: Vec<usize> =
                (0..64).map(|bin| sets.iter().filter(|s| *s >> bin & 1 == 1).count()).collect();
            prop_assert_eq!(counts.most(), *naive.iter().max().unwrap());
            let at_least = (0..64).filter(|bin| naive[*bin] >= least).fold(0, |set, bin| set | 1u64 << bin);
            prop_assert_eq!(counts.at_least(least), at_least);
        }

        #[test]
        fn cores_equal_naive_peeling(edges in prop::collection::vec((0u32..25, 0u32..25), 0..150)) {
            let mut once: Vec<(u32, u32)> =
                edges.iter().filter(|e| e.0 != e.1).map(|e| (e.0.min(e.1), e.0.max(e.1))).collect();
            once.sort_unstable();
            once.dedup();
            let graph = ConsistencyGraph::from_edges(25, &once);
            for size in 1..12 {
                let mut naive = [true; 25];
                while let Some(v) = (0..25u32).find(|v| {
                    naive[*v as usize]
                        && graph.neighbours(*v).iter().filter(|u| naive[**u as usize]).count() + 1 < size
                }) {
                    naive[v as usize] = false;
                }
                let found: Vec<bool> = pruned(&graph, size, usize::MAX).iter().map(|bins| *bins != 0).collect();
                prop_assert_eq!(found, naive.to_vec());
            }
        }
    }

    #[test]
    fn a_count_beyond_the_last_digit_is_never_reached() {
        assert_eq!(TurnCounts::default().at_least(1 << 16), 0);
    }
}

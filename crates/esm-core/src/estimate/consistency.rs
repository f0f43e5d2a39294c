//! Geometric consistency: the graph of candidate matches that can be true together.
//!
//! Candidates are binned by where they lie in the map, so the cost grows with the local density of candidates and not
//! with the size of the map.

use super::agreement::{Agreement, Turns, difference};
use super::bins::Bins;
use super::candidate::{ANY_TURN, Candidate};
use super::pairs::{Tests, agreeing_pairs};

/// The graph of consistent matches: vertices are candidates, edges join those that can be true together.
///
/// Inside, vertices are numbered by place (cell of the map, then live segment), and each knows its candidate.
#[derive(Clone, Debug, PartialEq)]
pub struct ConsistencyGraph {
    /// Candidate index of each vertex, and the other way round.
    candidates: Vec<u32>,
    vertices: Vec<u32>,
    /// Live segment of each vertex.
    live: Vec<u32>,
    offsets: Vec<u32>,
    neighbours: Vec<u32>,
    turns: Vec<Turns>,
    /// The turns that each vertex allows by itself: those of its candidate.
    alone: Vec<u64>,
    pair_tests: u64,
}

impl ConsistencyGraph {
    /// Tests every pair of candidates whose map segments are near enough to each other to be one live cloud.
    pub fn new(candidates: &[Candidate], agreement: Agreement) -> Self {
        let reach = reaches(candidates);
        let farthest = reach.iter().copied().fold(0.0, f32::max);
        let bins = Bins::new(candidates, farthest + agreement.resolution_m);
        let keep = |a: &Candidate, b: &Candidate| {
            a.live != b.live && a.map != b.map && agreement.extents_allow(a, b)
        };
        let (found, tests) =
            agreeing_pairs(Tests { candidates, bins: &bins, among: None, reach: &reach, agreement, keep });
        Self::from_pairs(candidates, bins, &found, agreement, tests)
    }

    /// From the pairs that agree: members of the bins, sorted, the lower first.
    pub(super) fn from_pairs(
        candidates: &[Candidate],
        bins: Bins,
        pairs: &[(u32, u32)],
        agreement: Agreement,
        pair_tests: u64,
    ) -> Self {
        let turns = |a: u32, b: u32| agreement.turns(&candidates[a as usize], &candidates[b as usize]);
        let alone = bins.order.iter().map(|c| agreement.alone(&candidates[*c as usize])).collect();
        Self { alone, pair_tests, ..Self::from_sorted_edges(bins.order, bins.live, pairs, turns) }
    }

    /// From undirected edges between vertices, each given once with the lower vertex first; sorted by it, and so that
    /// for either end the other ends ascend. `turns_of` is asked by candidate.
    fn from_sorted_edges(
        candidates: Vec<u32>,
        live: Vec<u32>,
        edges: &[(u32, u32)],
        turns_of: impl Fn(u32, u32) -> Turns,
    ) -> Self {
        let count = candidates.len();
        let mut offsets = vec![0u32; count + 1];
        for &(a, b) in edges {
            offsets[a as usize + 1] += 1;
            offsets[b as usize + 1] += 1;
        }
        for v in 0..count {
            offsets[v + 1] += offsets[v];
        }
        let mut next = offsets.clone();
        let mut neighbours = vec![0u32; 2 * edges.len()];
        let mut turns = vec![Turns::ALL; 2 * edges.len()];
        for &(a, b) in edges {
            let edge = turns_of(candidates[a as usize], candidates[b as usize]);
            for (at, neighbour) in [(a, b), (b, a)] {
                let slot = &mut next[at as usize];
                (neighbours[*slot as usize], turns[*slot as usize]) = (neighbour, edge);
                *slot += 1;
            }
        }
        let mut vertices = vec![0u32; count];
        for (v, c) in candidates.iter().enumerate() {
            vertices[*c as usize] = v as u32;
        }
        let alone = vec![ANY_TURN; count];
        Self { candidates, vertices, live, offsets, neighbours, turns, alone, pair_tests: 0 }
    }

    /// Vertices of distinct live segments, numbered as the candidates, that any turn explains.
    #[cfg(test)]
    pub(super) fn from_edges(count: u32, edges: &[(u32, u32)]) -> Self {
        let mut sorted: Vec<(u32, u32)> = edges.iter().map(|&(a, b)| (a.min(b), a.max(b))).collect();
        sorted.sort_unstable();
        Self::from_sorted_edges((0..count).collect(), (0..count).collect(), &sorted, |_, _| Turns::ALL)
    }

    /// Whether two graphs are the same, however many pairs were tested for them.
    pub fn same_as(&self, other: &Self) -> bool {
        let all = |g: &Self| Self { pair_tests: 0, ..g.clone() };
        all(self) == all(other)
    }

    /// Number of candidates.
    pub fn len(&self) -> usize {
        self.candidates.len()
    }

    /// Whether there is no candidate.
    pub fn is_empty(&self) -> bool {
        self.candidates.is_empty()
    }

    /// Number of pairs that agree.
    pub fn edges(&self) -> usize {
        self.neighbours.len() / 2
    }

    /// Number of pairs that were tested.
    pub fn pair_tests(&self) -> u64 {
        self.pair_tests
    }

    /// Whether two candidates are consistent.
    pub fn agree(&self, a: u32, b: u32) -> bool {
        let [a, b] = [a, b].map(|c| self.vertices[c as usize]);
        self.neighbours(a).binary_search(&b).is_ok()
    }

    /// Candidate index of a vertex.
    pub(super) fn candidate(&self, v: u32) -> u32 {
        self.candidates[v as usize]
    }

    /// Vertex of a candidate.
    pub(super) fn vertex(&self, candidate: u32) -> u32 {
        self.vertices[candidate as usize]
    }

    /// Live segment of a vertex.
    pub(super) fn live(&self, v: u32) -> u32 {
        self.live[v as usize]
    }

    /// The turns that each vertex allows by itself.
    pub(super) fn alone(&self) -> &[u64] {
        &self.alone
    }

    /// Vertices consistent with a vertex, ascending: those of one live segment and cell lie together.
    pub(super) fn neighbours(&self, v: u32) -> &[u32] {
        &self.neighbours[self.offsets[v as usize] as usize..self.offsets[v as usize + 1] as usize]
    }

    /// The same with the turns that each pair allows.
    pub(super) fn edges_of(&self, v: u32) -> impl Iterator<Item = (u32, Turns)> + '_ {
        let range = self.offsets[v as usize] as usize..self.offsets[v as usize + 1] as usize;
        self.neighbours[range.clone()].iter().copied().zip(self.turns[range].iter().copied())
    }
}

/// How far from each live segment another one lies at most, metres; 0 for those without a candidate.
pub(super) fn reaches(candidates: &[Candidate]) -> Vec<f32> {
    let count = candidates.iter().map(|c| c.live as usize + 1).max().unwrap_or(0);
    let mut at = vec![[f32::NAN; 3]; count];
    for c in candidates {
        at[c.live as usize] = c.pair.live;
    }
    let squared = |a: &[f32; 3], b: &[f32; 3]| {
        let d = difference(*a, *b);
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    };
    // A maximum takes no notice of NaN.
    at.iter().map(|a| at.iter().map(|b| squared(a, b)).fold(0.0, f32::max).sqrt()).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::rigid::Pair;

    fn candidates() -> impl Strategy<Value = Vec<Candidate>> {
        // Some allow few turns, most allow any.
        let turns =
            prop_oneof![Just(ANY_TURN), Just(ANY_TURN), (0u32..64).prop_map(|b| 0xffff_u64.rotate_left(b))];
        let one = (0u32..12, 0u32..40, prop::array::uniform3(-120.0f32..120.0), turns);
        prop::collection::vec(one, 1..120).prop_map(|all| {
            all.into_iter()
                .map(|(live, map, at, turns)| {
                    let l = live as f32;
                    let pair = Pair { live: [l * 3.0, (l * 7.0) % 11.0, (l * 5.0) % 3.0], map: at };
                    Candidate { live, map, distance: 0.0, quality: 1.0, pair, turns }
                })
                .collect()
        })
    }

    const AGREEMENT: Agreement = Agreement { resolution_m: 2.0, max_tilt_rad: Some(0.2) };

    proptest! {
        #[test]
        fn binning_finds_exactly_the_pairs_that_testing_all_finds(candidates in candidates()) {
            let graph = ConsistencyGraph::new(&candidates, AGREEMENT);
            let mut edges = 0;
            for (i, a) in candidates.iter().enumerate() {
                for (j, b) in candidates.iter().enumerate() {
                    let want = AGREEMENT.holds(a, b);
                    prop_assert_eq!(graph.agree(i as u32, j as u32), want);
                    edges += usize::from(want);
                }
            }
            prop_assert_eq!(graph.edges(), edges / 2);
            for v in 0..graph.len() as u32 {
                prop_assert!(graph.neighbours(v).is_sorted());
                for (u, turns) in graph.edges_of(v) {
                    let [a, b] = [v, u].map(|v| &candidates[graph.candidate(v) as usize]);
                    prop_assert_eq!(turns, AGREEMENT.turns(a, b));
                }
            }
        }
    }

    /// 46 live segments with 25 candidates each in a map of `segments` segments, one in 25 square metres.
    fn spread(segments: u32) -> Vec<Candidate> {
        let mut state = 77u64;
        let mut random = move |most: f32| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1u64 << 24) as f32 * most
        };
        let side = (segments as f32 * 25.0).sqrt();
        let mut all = Vec::new();
        for live in 0..46 {
            let at = [random(80.0), random(80.0), random(3.0)];
            for k in 0..25 {
                let pair = Pair { live: at, map: [random(side), random(side), random(3.0)] };
                let map = live * 25 + k;
                all.push(Candidate { live, map, distance: 0.0, quality: 1.0, pair, turns: ANY_TURN });
            }
        }
        all
    }

    #[test]
    fn pair_tests_do_not_grow_with_the_map() {
        let agreement = Agreement { resolution_m: 0.5, max_tilt_rad: Some(0.1) };
        let tests: Vec<u64> = [3_000, 30_000, 300_000]
            .into_iter()
            .map(|segments| ConsistencyGraph::new(&spread(segments), agreement).pair_tests())
            .collect();
        // All pairs are 660,675. The larger the map, the thinner 46 x 25 candidates lie in it.
        assert!(tests[0] < 400_000 && tests[1] < tests[0] / 4 && tests[2] < tests[1] / 4, "{tests:?}");

        // A larger map with as many candidates in every place, as when descriptors tell nothing: each is tested with
        // what lies around it and no more.
        let several = |times: u32| {
            let mut all = Vec::new();
            for tile in 0..times {
                all.extend(spread(3_000).into_iter().map(|c| {
                    let at = c.pair.map;
                    let map = [at[0] + 1000.0 * tile as f32, at[1], at[2]];
                    Candidate { map: c.map + tile * 1150, pair: Pair { map, ..c.pair }, ..c }
                }));
            }
            ConsistencyGraph::new(&all, agreement).pair_tests()
        };
        let one = several(1);
        assert!(several(8) <= 8 * one + one, "{one} {}", several(8));
    }
}

//! Geometric consistency: which candidate matches can be true together.
//!
//! Two matches agree when their segments lie as far apart in the live cloud as in the map, and, where gravity is
//! known, stand at the same relative height. Candidates are binned by where they lie in the map, so the cost grows
//! with the local density of candidates and not with the size of the map.

use super::candidate::Candidate;

/// When two matches agree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Largest difference of the two lengths, metres.
    pub resolution_m: f32,
    /// Largest tilt between the live up axis and the map's, radians; bounds the difference of relative heights.
    /// `None` where the live cloud's up axis is unknown.
    pub max_tilt_rad: Option<f32>,
}

/// The graph of consistent matches: vertices are candidates, edges join those that can be true together.
#[derive(Clone, Debug, PartialEq)]
pub struct ConsistencyGraph {
    offsets: Vec<u32>,
    neighbours: Vec<u32>,
}

/// How densely each vertex of a graph is tied in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cores {
    /// Core number of every vertex.
    pub numbers: Vec<u32>,
    /// All vertices in a degeneracy order: each has at most its core number of neighbours behind it.
    pub order: Vec<u32>,
}

impl ConsistencyGraph {
    /// Tests every pair of candidates whose map segments are near enough to each other to be one live cloud.
    pub fn new(candidates: &[Candidate], agreement: Agreement) -> Self {
        let live = LiveBounds::new(candidates, agreement);
        let bins = Bins::new(candidates, live.largest + agreement.resolution_m);
        let mut edges = Vec::new();
        for (a, b_range) in bins.pairs() {
            let (i, first) = bins.members[a];
            let row = live.row(first.live);
            for (j, second) in &bins.members[b_range] {
                if row[second.live as usize].hold(&first, second) && first.map != second.map {
                    edges.push((i, *j));
                }
            }
        }
        Self::from_edges(candidates.len(), &edges)
    }

    /// From undirected edges, each given once, in any order.
    pub(super) fn from_edges(vertices: usize, edges: &[(u32, u32)]) -> Self {
        let mut offsets = vec![0u32; vertices + 1];
        for &(a, b) in edges {
            offsets[a as usize + 1] += 1;
            offsets[b as usize + 1] += 1;
        }
        for v in 0..vertices {
            offsets[v + 1] += offsets[v];
        }
        let mut next = offsets.clone();
        let mut neighbours = vec![0u32; 2 * edges.len()];
        let mut put = |at: u32, neighbour: u32| {
            neighbours[next[at as usize] as usize] = neighbour;
            next[at as usize] += 1;
        };
        for &(a, b) in edges {
            put(a, b);
            put(b, a);
        }
        for v in 0..vertices {
            neighbours[offsets[v] as usize..offsets[v + 1] as usize].sort_unstable();
        }
        Self { offsets, neighbours }
    }

    /// Number of vertices.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there is no vertex.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Candidates consistent with candidate `v`, ascending.
    pub fn neighbours(&self, v: u32) -> &[u32] {
        &self.neighbours[self.offsets[v as usize] as usize..self.offsets[v as usize + 1] as usize]
    }

    /// Whether two candidates are consistent.
    pub fn agree(&self, a: u32, b: u32) -> bool {
        self.neighbours(a).binary_search(&b).is_ok()
    }

    /// Core number of every vertex (the largest k such that it survives in the k-core) and a degeneracy order.
    ///
    /// A clique of size s lies within the (s-1)-core, so low core numbers rule candidates out at once.
    pub fn cores(&self) -> Cores {
        let n = self.len();
        let mut degree: Vec<u32> = (0..n).map(|v| self.neighbours(v as u32).len() as u32).collect();
        let largest = degree.iter().copied().max().unwrap_or(0) as usize;
        // Bucket queue (Batagelj and Zaversnik 2003).
        let mut start = vec![0usize; largest + 2];
        for d in &degree {
            start[*d as usize + 1] += 1;
        }
        for d in 0..=largest {
            start[d + 1] += start[d];
        }
        let mut next = start.clone();
        let (mut order, mut place) = (vec![0u32; n], vec![0usize; n]);
        for v in 0..n {
            let slot = &mut next[degree[v] as usize];
            order[*slot] = v as u32;
            place[v] = *slot;
            *slot += 1;
        }
        for i in 0..n {
            let v = order[i];
            for &u in self.neighbours(v) {
                let (u, du) = (u as usize, degree[u as usize] as usize);
                if du as u32 > degree[v as usize] {
                    // Swap u with the first vertex of its bucket, then shrink the bucket from the left.
                    let first = start[du].max(i + 1);
                    let w = order[first] as usize;
                    order.swap(place[u], first);
                    place[w] = place[u];
                    place[u] = first;
                    start[du] = first + 1;
                    degree[u] -= 1;
                }
            }
        }
        Cores { numbers: degree, order }
    }
}

impl Agreement {
    /// What two map segments must keep to when their live segments lie `live_length` apart.
    fn bounds(&self, live_length: f32) -> Bounds {
        let low = (live_length - self.resolution_m).max(0.0);
        let high = live_length + self.resolution_m;
        // Tilting by an angle raises a segment at distance d by at most d * angle.
        let rise = self.max_tilt_rad.map_or(f32::INFINITY, |tilt| self.resolution_m + tilt * live_length);
        Bounds { low: low * low, high: high * high, rise }
    }
}

/// Bounds of the squared distance of two map segments, and of how far their relative height may be off.
#[derive(Clone, Copy)]
struct Bounds {
    low: f32,
    high: f32,
    rise: f32,
}

impl Bounds {
    /// Of a live segment with itself: a match cannot agree with another one of the same live segment.
    const NEVER: Self = Self { low: f32::INFINITY, high: f32::NEG_INFINITY, rise: 0.0 };

    #[inline]
    fn hold(&self, a: &Candidate, b: &Candidate) -> bool {
        let m = difference(a.pair.map, b.pair.map);
        let squared = m[0] * m[0] + m[1] * m[1] + m[2] * m[2];
        // Rarely true: only then is the rest looked at.
        squared >= self.low
            && squared <= self.high
            && (a.pair.live[2] - b.pair.live[2] - m[2]).abs() <= self.rise
    }
}

fn difference(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// The bounds for all pairs of live segments, computed once.
struct LiveBounds {
    bounds: Vec<Bounds>,
    count: usize,
    /// Largest distance of two live segments, metres.
    largest: f32,
}

impl LiveBounds {
    fn new(candidates: &[Candidate], agreement: Agreement) -> Self {
        let count = candidates.iter().map(|c| c.live as usize + 1).max().unwrap_or(0);
        let mut centroid = vec![None; count];
        for c in candidates {
            centroid[c.live as usize] = Some(c.pair.live);
        }
        let mut bounds = vec![Bounds::NEVER; count * count];
        let mut largest = 0.0f32;
        for a in 0..count {
            for b in 0..a {
                if let (Some(p), Some(q)) = (centroid[a], centroid[b]) {
                    let d = difference(p, q);
                    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
                    bounds[a * count + b] = agreement.bounds(length);
                    bounds[b * count + a] = agreement.bounds(length);
                    largest = largest.max(length);
                }
            }
        }
        Self { bounds, count, largest }
    }

    /// The bounds of one live segment with each.
    fn row(&self, live: u32) -> &[Bounds] {
        &self.bounds[live as usize * self.count..][..self.count]
    }
}

/// Candidates by cell of a horizontal grid over the map; the cell's edge is the reach of a live cloud, so consistent
/// pairs lie in the same or in neighbouring cells.
struct Bins {
    /// Candidates with their indices, sorted by cell (x, then y), then index: what is tested together lies together.
    members: Vec<(u32, Candidate)>,
    cells: Vec<(i64, i64)>,
}

impl Bins {
    fn new(candidates: &[Candidate], reach: f32) -> Self {
        let edge = f64::from(reach.max(1.0));
        let cell = |c: &Candidate| {
            (
                (f64::from(c.pair.map[0]) / edge).floor() as i64,
                (f64::from(c.pair.map[1]) / edge).floor() as i64,
            )
        };
        let mut keyed: Vec<((i64, i64), u32)> =
            candidates.iter().enumerate().map(|(i, c)| (cell(c), i as u32)).collect();
        keyed.sort_unstable();
        let (cells, members) = keyed.into_iter().map(|(cell, i)| (cell, (i, candidates[i as usize]))).unzip();
        Self { members, cells }
    }

    /// Each member with the range of members to test it against; every near pair comes once.
    fn pairs(&self) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + '_ {
        (0..self.members.len()).flat_map(move |a| {
            let (x, y) = self.cells[a];
            let row_end = self.cells.partition_point(|c| *c <= (x, y + 1));
            let next_start = self.cells.partition_point(|c| *c < (x + 1, y - 1));
            let next_end = self.cells.partition_point(|c| *c <= (x + 1, y + 1));
            [(a, a + 1..row_end), (a, next_start..next_end)]
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::rigid::Pair;

    fn candidates() -> impl Strategy<Value = Vec<Candidate>> {
        let one = (0u32..12, 0u32..40, prop::array::uniform3(-120.0f32..120.0));
        prop::collection::vec(one, 1..120).prop_map(|all| {
            all.into_iter()
                .map(|(live, map, at)| {
                    let l = live as f32;
                    let pair = Pair { live: [l * 3.0, (l * 7.0) % 11.0, (l * 5.0) % 3.0], map: at };
                    Candidate { live, map, distance: 0.0, quality: 1.0, pair }
                })
                .collect()
        })
    }

    const AGREEMENT: Agreement = Agreement { resolution_m: 2.0, max_tilt_rad: Some(0.2) };

    proptest! {
        #[test]
        fn binning_finds_exactly_the_pairs_that_testing_all_finds(candidates in candidates()) {
            let graph = ConsistencyGraph::new(&candidates, AGREEMENT);
            for (i, a) in candidates.iter().enumerate() {
                for (j, b) in candidates.iter().enumerate() {
                    let d = difference(a.pair.live, b.pair.live);
                    let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
                    let want = a.live != b.live && a.map != b.map && AGREEMENT.bounds(length).hold(a, b);
                    prop_assert_eq!(graph.agree(i as u32, j as u32), want);
                }
            }
        }

        #[test]
        fn core_numbers_equal_naive_peeling(edges in prop::collection::vec((0u32..25, 0u32..25), 0..150)) {
            let mut once: Vec<(u32, u32)> =
                edges.iter().filter(|e| e.0 != e.1).map(|e| (e.0.min(e.1), e.0.max(e.1))).collect();
            once.sort_unstable();
            once.dedup();
            let graph = ConsistencyGraph::from_edges(25, &once);
            let Cores { numbers: cores, order } = graph.cores();
            let mut naive = [0u32; 25];
            for k in 1..25 {
                let mut alive = [true; 25];
                while let Some(v) = (0..25u32).find(|v| {
                    alive[*v as usize] && graph.neighbours(*v).iter().filter(|u| alive[**u as usize]).count() < k
                }) {
                    alive[v as usize] = false;
                }
                (0..25).filter(|v| alive[*v]).for_each(|v| naive[v] = k as u32);
            }
            prop_assert_eq!(cores, naive.to_vec());
            let mut sorted = order;
            sorted.sort_unstable();
            prop_assert_eq!(sorted, (0..25).collect::<Vec<u32>>());
        }
    }
}

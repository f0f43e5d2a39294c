//! [`IncrementalRecognizer`]: cloud after cloud, only what is new or has moved is tested for consistency again.
//!
//! After SegMap's incremental recognizer: segments that stay in view keep many of their candidate matches, and what those
//! agree with. Two matches are remembered as near to agreeing with some room to move; as long as neither segment has moved
//! farther than that from where it was then, no other pair can have come to agree, and only those are tested.

use super::agreement::{Agreement, difference};
use super::bins::Bins;
use super::candidate::Candidate;
use super::config::PoseConfig;
use super::consistency::{ConsistencyGraph, reaches};
use super::pairs::{Tests, agreeing_pairs};
use super::search::{Found, search, search_in};

/// A segment that moved farther than this is as good as new, metres.
const MOST_MOVED_M: f32 = 0.1;
/// What rounding can do to a length, metres, and a metre of length.
const ROUNDING: (f32, f32) = (1e-3, 1e-5);

/// The pose search over the clouds of one robot, which remembers what agreed: it finds exactly what [`search`] finds in the
/// same candidates.
///
/// The live centroids are given in a frame that stays while the robot moves, with z up: its odometry. So are the places
/// found (`pose_map_odom`). Each live segment has an identity, a number that it keeps from cloud to cloud. It is a hint and
/// no more: a wrong one costs time and changes nothing. What is no longer among the candidates is forgotten, so the memory
/// is that of one cloud's.
///
/// ```
/// use esm_core::estimate::{ANY_TURN, Candidate, IncrementalRecognizer, Pair, PoseConfig, search};
/// let config = PoseConfig::default();
/// let mut robot = IncrementalRecognizer::new(&config, 0);
/// let segments = [[0.0, 0.0, 0.0], [9.0, 1.0, 0.5], [-4.0, 12.0, 1.0], [7.0, -8.0, 0.0], [-11.0, -3.0, 2.0], [5.0, 5.0, 1.0]];
/// // Two clouds: the first five segments, then the last five.
/// for range in [0..5, 1..6] {
///     let identities: Vec<u64> = range.clone().collect();
///     let candidates: Vec<Candidate> = range.clone().enumerate().map(|(live, s)| {
///         let at: [f32; 3] = segments[s as usize];
///         let pair = Pair { live: at, map: [at[0] + 10.0, at[1], at[2]] };
///         Candidate { live: live as u32, map: s as u32, distance: 0.0, quality: 1.0, pair, turns: ANY_TURN }
///     }).collect();
///     assert_eq!(robot.search(&candidates, &identities).places, search(&candidates, &config, 0).places);
/// }
/// assert_eq!((robot.reuse().kept, robot.reuse().fresh), (4, 1));
/// ```
#[derive(Clone, Debug)]
pub struct IncrementalRecognizer {
    config: PoseConfig,
    seed: u64,
    /// Those of the last cloud, in its order.
    known: Vec<Known>,
    /// Identity, map segment and number of the known ones, ascending.
    keys: Vec<(u64, u32, u32)>,
    /// Pairs of them that agree or nearly do.
    near: Vec<Near>,
    reuse: Reuse,
}

/// What was remembered of the cloud before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reuse {
    /// Matches that were known and have not moved too far.
    pub kept: usize,
    /// Matches that are new, or as good as new.
    pub fresh: usize,
    /// Pairs tested because one of the two is new.
    pub fresh_tests: u64,
    /// Pairs tested again because one of the two has moved.
    pub repeated_tests: u64,
    /// Pairs remembered.
    pub pairs: usize,
}

#[derive(Clone, Copy, Debug)]
struct Known {
    /// As in the last cloud.
    now: Candidate,
    /// Where the live segment was when the pairs near this match were gathered.
    anchor: [f32; 3],
}

/// Two known matches.
#[derive(Clone, Copy, Debug)]
struct Near {
    a: u32,
    b: u32,
    /// Whether their places and extents agreed in the last cloud.
    fits: bool,
}

const GONE: u32 = u32::MAX;

impl IncrementalRecognizer {
    /// One that knows nothing yet. Configuration and seed as for [`search`].
    pub fn new(config: &PoseConfig, seed: u64) -> Self {
        let (known, keys, near) = (Vec::new(), Vec::new(), Vec::new());
        Self { config: config.clone(), seed, known, keys, near, reuse: Reuse::default() }
    }

    /// The distinct places with the most support, best first, as [`search`] finds them; of its effort only the pair tests are
    /// others. `candidates` are sorted best first, all of one live segment have the same live centroid. `identities`: one for
    /// each live segment by its index; a segment without is new.
    pub fn search(&mut self, candidates: &[Candidate], identities: &[u64]) -> Found {
        if !self.config.needs_graph() {
            return search(candidates, &self.config, self.seed);
        }
        let graph = self.graph(candidates, identities);
        search_in(&graph, candidates, &self.config, self.seed)
    }

    /// The graph of consistent matches alone: that of [`ConsistencyGraph::new`] on the same candidates.
    pub fn graph(&mut self, candidates: &[Candidate], identities: &[u64]) -> ConsistencyGraph {
        let agreement = self.config.agreement();
        let reach = reaches(candidates);
        let farthest = reach.iter().copied().fold(0.0, f32::max);
        let bins = Bins::new(candidates, farthest + agreement.resolution_m);
        let keys = keys(candidates, identities);
        // By number: where it is known from, and where what was known has gone.
        let from = self.recognised(candidates, &keys);
        let mut to = vec![GONE; self.known.len()];
        from.iter().enumerate().filter(|(_, f)| **f != GONE).for_each(|(i, f)| to[*f as usize] = i as u32);

        self.reuse = Reuse::default();
        let moved: Vec<bool> =
            candidates.iter().zip(&from).map(|(c, f)| *f == GONE || self.has_moved(*f, c)).collect();
        self.retest(candidates, &to, &moved, agreement);
        self.known = candidates
            .iter()
            .zip(&from)
            .map(|(c, f)| Known {
                now: *c,
                anchor: self.known.get(*f as usize).map_or(c.pair.live, |k| k.anchor),
            })
            .collect();
        self.keys = keys;
        let fresh: Vec<bool> = from.iter().map(|f| *f == GONE).collect();
        self.reuse.fresh = fresh.iter().filter(|f| **f).count();
        self.reuse.kept = fresh.len() - self.reuse.fresh;
        self.gather(candidates, &reach, &fresh, agreement);
        self.reuse.pairs = self.near.len();
        self.connect(candidates, bins, agreement)
    }

    /// What the last search could remember.
    pub fn reuse(&self) -> Reuse {
        self.reuse
    }

    /// Forgets all: after a gap, or where the map is another one.
    pub fn forget(&mut self) {
        self.known.clear();
        self.keys.clear();
        self.near.clear();
    }

    /// For each candidate the known match that it is, or `GONE`.
    fn recognised(&self, candidates: &[Candidate], keys: &[(u64, u32, u32)]) -> Vec<u32> {
        let mut from = vec![GONE; candidates.len()];
        let mut known = self.keys.iter().peekable();
        for (identity, map, number) in keys {
            while known.next_if(|k| (k.0, k.1) < (*identity, *map)).is_some() {}
            if let Some(k) = known.next_if(|k| (k.0, k.1) == (*identity, *map)) {
                let (c, known) = (&candidates[*number as usize], &self.known[k.2 as usize]);
                let d = difference(c.pair.live, known.anchor);
                let near = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= MOST_MOVED_M * MOST_MOVED_M;
                if near && bits(c.pair.map) == bits(known.now.pair.map) {
                    from[*number as usize] = k.2;
                }
            }
        }
        from
    }

    /// Whether what a known match agrees with may be other than it was.
    fn has_moved(&self, known: u32, c: &Candidate) -> bool {
        let before = &self.known[known as usize].now;
        bits(before.pair.live) != bits(c.pair.live) || before.turns != c.turns
    }

    /// Takes the pairs that are left over to the new numbers, and tests those again that have moved.
    fn retest(&mut self, candidates: &[Candidate], to: &[u32], moved: &[bool], agreement: Agreement) {
        let tests = &mut self.reuse.repeated_tests;
        self.near.retain_mut(|pair| {
            let (a, b) = (to[pair.a as usize], to[pair.b as usize]);
            if a == GONE || b == GONE {
                return false;
            }
            (pair.a, pair.b) = (a, b);
            if moved[a as usize] || moved[b as usize] {
                pair.fits = agreement.fits(&candidates[a as usize], &candidates[b as usize]);
                *tests += 1;
            }
            true
        });
    }

    /// Gathers the pairs with a fresh match that agree or may come to while neither end moves too far.
    fn gather(&mut self, candidates: &[Candidate], reach: &[f32], fresh: &[bool], agreement: Agreement) {
        let anchored: Vec<Candidate> = candidates
            .iter()
            .zip(&self.known)
            .map(|(c, k)| Candidate { pair: super::rigid::Pair { live: k.anchor, ..c.pair }, ..*c })
            .collect();
        // Each end may have moved before it was anchored or will after.
        let room = 2.0 * MOST_MOVED_M;
        let reach: Vec<f32> = reach.iter().map(|r| r + room).collect();
        let farthest = reach.iter().copied().fold(0.0, f32::max);
        let rounding = ROUNDING.0 + ROUNDING.1 * farthest;
        let tilt = agreement.max_tilt_rad.unwrap_or(0.0);
        let resolution_m = agreement.resolution_m + room * (1.0 + tilt) + rounding;
        let wide = Agreement { resolution_m, ..agreement };
        let keep = |a: &Candidate, b: &Candidate| a.map != b.map;
        let edge = farthest + resolution_m;
        let [new, old] = [true, false].map(|which| Bins::of(&anchored, edge, |i| fresh[i] == which));
        for among in [None, Some(&old)] {
            let (found, tests) = agreeing_pairs(Tests {
                candidates: &anchored,
                bins: &new,
                among,
                reach: &reach,
                agreement: wide,
                keep,
            });
            self.reuse.fresh_tests += tests;
            let others = among.unwrap_or(&new);
            self.near.extend(found.into_iter().map(|(a, b)| {
                let (a, b) = (new.order[a as usize], others.order[b as usize]);
                Near { a, b, fits: agreement.fits(&candidates[a as usize], &candidates[b as usize]) }
            }));
        }
    }

    /// The graph of the pairs that agree.
    fn connect(&self, candidates: &[Candidate], bins: Bins, agreement: Agreement) -> ConsistencyGraph {
        let mut member = vec![0u32; candidates.len()];
        bins.order.iter().enumerate().for_each(|(m, c)| member[*c as usize] = m as u32);
        let live = |c: u32| candidates[c as usize].live;
        let mut pairs: Vec<(u32, u32)> = self
            .near
            .iter()
            .filter(|p| p.fits && live(p.a) != live(p.b))
            .map(|p| (member[p.a as usize], member[p.b as usize]))
            .map(|(a, b)| (a.min(b), a.max(b)))
            .collect();
        pairs.sort_unstable();
        let tests = self.reuse.fresh_tests + self.reuse.repeated_tests;
        ConsistencyGraph::from_pairs(candidates, bins, &pairs, agreement, tests)
    }
}

/// Identity, map segment and number of the candidates that have one, ascending.
fn keys(candidates: &[Candidate], identities: &[u64]) -> Vec<(u64, u32, u32)> {
    let mut keys: Vec<(u64, u32, u32)> = candidates
        .iter()
        .enumerate()
        .filter_map(|(i, c)| Some((*identities.get(c.live as usize)?, c.map, i as u32)))
        .collect();
    keys.sort_unstable();
    keys
}

fn bits(p: [f32; 3]) -> [u32; 3] {
    p.map(f32::to_bits)
}

#[cfg(test)]
mod tests;

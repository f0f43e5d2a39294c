//! Branch and bound for the largest clique of a small graph, held as a bit matrix.

/// A small graph; the branching is Tomita and Seki's (2003): a greedy colouring bounds what a set can yield.
#[derive(Default)]
pub(super) struct Branch {
    count: usize,
    words: usize,
    adjacent: Vec<u64>,
    /// Sets of the nodes on the way down, one behind the other; likewise their colourings.
    sets: Vec<u64>,
    coloured: Vec<(u32, u32)>,
    scratch: Vec<u64>,
    clique: Vec<u32>,
}

/// What a search has found so far.
pub(super) struct Best {
    /// Members of the largest clique, by their number in the branch.
    pub(super) members: Vec<u32>,
    /// Only cliques larger than this count.
    pub(super) size: usize,
    /// Nodes that may yet be visited.
    pub(super) effort: usize,
}

impl Branch {
    /// Begins a graph without edges.
    pub(super) fn reset(&mut self, count: usize) {
        self.count = count;
        self.words = count.div_ceil(64);
        self.adjacent.clear();
        self.adjacent.resize(self.words * count, 0);
    }

    /// Joins two vertices, seen from the first; to be called for both.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        self.adjacent[a * self.words + b / 64] |= 1 << (b % 64);
    }

    /// Number of vertices joined to `a`.
    pub(super) fn degree(&self, a: usize) -> u32 {
        self.row(a).iter().map(|w| w.count_ones()).sum()
    }

    fn row(&self, a: usize) -> &[u64] {
        &self.adjacent[a * self.words..][..self.words]
    }

    /// Searches all cliques; leaves `best` at the largest one if that is larger than `best.size`.
    pub(super) fn search(&mut self, best: &mut Best) {
        self.sets.clear();
        self.coloured.clear();
        self.clique.clear();
        self.sets.resize(self.words, u64::MAX);
        if !self.count.is_multiple_of(64) {
            self.sets[self.words - 1] = (1 << (self.count % 64)) - 1;
        }
        self.expand(0, best);
    }

    /// Expands the node whose set begins at `set`.
    fn expand(&mut self, set: usize, best: &mut Best) {
        if best.effort == 0 {
            return;
        }
        best.effort -= 1;
        let first = self.coloured.len();
        // A vertex that cannot lead beyond the best is never branched on.
        let needed = (best.size + 1).saturating_sub(self.clique.len());
        self.colour(set, needed);
        while self.coloured.len() > first {
            let (i, colour) = self.coloured[self.coloured.len() - 1];
            if self.clique.len() + colour as usize <= best.size {
                break;
            }
            self.coloured.pop();
            let i = i as usize;
            self.clique.push(i as u32);
            let inner = self.sets.len();
            let mut any = 0;
            for w in 0..self.words {
                let word = self.sets[set + w] & self.adjacent[i * self.words + w];
                any |= word;
                self.sets.push(word);
            }
            if any != 0 {
                self.expand(inner, best);
            } else if self.clique.len() > best.size {
                best.size = self.clique.len();
                best.members.clone_from(&self.clique);
            }
            self.sets.truncate(inner);
            self.clique.pop();
            self.sets[set + i / 64] &= !(1 << (i % 64));
        }
        self.coloured.truncate(first);
    }

    /// Appends the vertices of a set with the number of colours needed up to each, ascending, from the colour `from` on:
    /// a clique within a prefix is no larger than its colour.
    fn colour(&mut self, set: usize, from: usize) {
        let words = self.words;
        self.scratch.clear();
        self.scratch.extend_from_slice(&self.sets[set..set + words]);
        self.scratch.resize(2 * words, 0);
        let (left, independent) = self.scratch.split_at_mut(words);
        let mut colour = 0u32;
        loop {
            if left.iter().all(|w| *w == 0) {
                return;
            }
            colour += 1;
            independent.copy_from_slice(left);
            for w in 0..words {
                while independent[w] != 0 {
                    let bit = independent[w].trailing_zeros() as usize;
                    let i = w * 64 + bit;
                    left[w] &= !(1 << bit);
                    independent[w] &= !(1 << bit);
                    let row = &self.adjacent[i * words..][..words];
                    for (a, b) in independent[w..].iter_mut().zip(&row[w..]) {
                        *a &= !b;
                    }
                    if colour as usize >= from {
                        self.coloured.push((i as u32, colour));
                    }
                }
            }
        }
    }
}

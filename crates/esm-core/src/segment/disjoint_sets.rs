//! Union-find.

/// Disjoint sets of `0..n`; the smaller index is the root, so the sets do not depend on the order of the unions.
pub(crate) struct DisjointSets {
    parent: Vec<u32>,
}

impl DisjointSets {
    /// Each number a set of its own.
    pub(crate) fn new(n: usize) -> Self {
        Self { parent: (0..n as u32).collect() }
    }

    /// The root of a set: equal for two numbers if and only if they are in one set.
    #[inline]
    pub(crate) fn find(&mut self, mut i: u32) -> u32 {
        loop {
            let parent = self.parent[i as usize];
            if parent == i {
                return i;
            }
            let grand = self.parent[parent as usize];
            self.parent[i as usize] = grand;
            i = grand;
        }
    }

    /// Unites the sets of two roots.
    #[inline]
    pub(crate) fn unite(&mut self, root_a: u32, root_b: u32) {
        let (low, high) = (root_a.min(root_b), root_a.max(root_b));
        self.parent[high as usize] = low;
    }
}

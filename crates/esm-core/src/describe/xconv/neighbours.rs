//! Neighbour lists, exactly as the training program makes them.
//!
//! The X-transform depends on the order of a point's neighbours, so distances are rounded the same way everywhere:
//! (dx dx + dy dy) + dz dz in f32, no fused multiply-add, ascending, ties by the lower index, duplicates kept.

use pulp::Arch;

use super::architecture::{INPUT_POINTS, LAYER_TABLE, LAYERS, Layer, PointPlan};
use super::simd::{Aligned, INDEX, Lowest, kept, lanes};

/// Working memory of the search.
pub(super) struct Search {
    arch: Arch,
    coordinates: [Aligned; 3],
    /// For each rank a vector of keys, one of each query.
    keys: Aligned,
    /// What sorting by rounded distances leaves open: see [`Lowest`].
    lost: Aligned,
    closest: Aligned,
    exact: Vec<u64>,
}

impl Search {
    pub(super) fn new(arch: Arch) -> Self {
        let width = lanes(arch);
        Self {
            arch,
            // The last vector of queries may reach beyond the points.
            coordinates: std::array::from_fn(|_| Aligned::zeros(INPUT_POINTS + width)),
            keys: Aligned::zeros(INPUT_POINTS * width),
            lost: Aligned::zeros(width),
            closest: Aligned::zeros(width),
            exact: Vec::with_capacity(INPUT_POINTS),
        }
    }

    /// Neighbour lists of all layers: in layer l, `K` indices for each of its query points, nearest first.
    pub(super) fn lists(&mut self, points: &[[f32; 3]], plan: &PointPlan, lists: &mut [Vec<u16>; LAYERS]) {
        for (axis, column) in self.coordinates.iter_mut().enumerate() {
            column.iter_mut().zip(points).for_each(|(c, p)| *c = p[axis]);
        }
        for (list, (kept, layer)) in lists.iter_mut().zip(plan.0.iter().zip(&LAYER_TABLE)) {
            list.resize(kept * layer.neighbours, 0);
        }
        let mut layer = 0;
        while layer < LAYERS {
            // Layers that look among the same points share one search.
            let sources = plan.sources(layer);
            let same = (layer..LAYERS).take_while(|l| plan.sources(*l) == sources).count();
            let together = layer..layer + same;
            let queries = together.clone().map(|l| plan.0[l]).max().unwrap_or(0);
            let width = self.lost.len();
            for first in (0..queries).step_by(width) {
                // Later layers keep fewer points and look farther: no query of this vector wants more than the first.
                let wanted = together.clone().filter(|l| first < plan.0[*l]);
                let reach = wanted.map(|l| LAYER_TABLE[l].reach()).max().unwrap_or(0);
                let sorted = self.lowest(first, sources, reach);
                for query in first..queries.min(first + width) {
                    let wanted = together.clone().filter(|l| query < plan.0[*l]);
                    if sorted && self.in_order(query, reach) {
                        for l in wanted {
                            let Layer { neighbours, dilation, .. } = LAYER_TABLE[l];
                            let list = &mut lists[l][query * neighbours..][..neighbours];
                            let ranks = self.keys.chunks_exact(width * dilation);
                            for (to, keys) in list.iter_mut().zip(ranks) {
                                *to = (keys[query % width].to_bits() & INDEX) as u16;
                            }
                        }
                        continue;
                    }
                    if sorted {
                        self.settle(query, sources, reach);
                    } else {
                        self.nearest(query, sources, reach);
                    }
                    for l in wanted {
                        let Layer { neighbours, dilation, .. } = LAYER_TABLE[l];
                        let list = &mut lists[l][query * neighbours..][..neighbours];
                        // The key's low half is the index.
                        for (to, key) in list.iter_mut().zip(self.exact.iter().step_by(dilation)) {
                            *to = *key as u16;
                        }
                    }
                }
            }
            layer += same;
        }
    }

    /// Sorts the keys of a vector of queries. Not where there are no vectors: plain code does better without.
    fn lowest(&mut self, first: usize, sources: usize, reach: usize) -> bool {
        if self.lost.len() == 1 {
            return false;
        }
        self.arch.dispatch(Lowest {
            points: self.coordinates.each_ref().map(|c| &c[..]),
            sources,
            query: first,
            reach,
            keys: bytemuck::cast_slice_mut(&mut self.keys),
            lost: bytemuck::cast_slice_mut(&mut self.lost),
            closest: bytemuck::cast_slice_mut(&mut self.closest),
        });
        true
    }

    fn key(&self, rank: usize, query: usize) -> u32 {
        let width = self.lost.len();
        self.keys[rank * width + query % width].to_bits()
    }

    /// Whether the order by rounded distances is the one by distances: no two of a query's nearest are rounded to the same, nor the
    /// last and one that was left out. So it is but for duplicates and one query in some twenty.
    fn in_order(&self, query: usize, reach: usize) -> bool {
        let lane = query % self.lost.len();
        self.closest[lane].to_bits() > INDEX && self.lost[lane].to_bits() > self.key(reach - 1, query) | INDEX
    }

    /// Puts the nearest of a query in order by their true distances, as keys into `exact`: all whose rounded distances are not
    /// above the last one's.
    fn settle(&mut self, query: usize, sources: usize, reach: usize) {
        let last = self.key(reach - 1, query) | INDEX;
        self.exact.clear();
        let mut greatest = 0;
        for rank in 0..kept(reach) {
            let key = self.key(rank, query);
            if key > last {
                break;
            }
            greatest = key;
            let n = (key & INDEX) as usize;
            self.exact.push((u64::from(self.distance(query, n)) << 32) | n as u64);
        }
        if self.lost[query % self.lost.len()].to_bits() <= last {
            for n in 0..sources {
                let distance = self.distance(query, n);
                let key = distance & !INDEX | n as u32;
                if key > greatest && key <= last {
                    self.exact.push((u64::from(distance) << 32) | n as u64);
                }
            }
        }
        // By insertion: nearly all of them are where they belong.
        for n in 1..self.exact.len() {
            let mut at = n;
            while at > 0 && self.exact[at] < self.exact[at - 1] {
                self.exact.swap(at, at - 1);
                at -= 1;
            }
        }
    }

    /// The squared distance of two points, as bits.
    fn distance(&self, a: usize, b: usize) -> u32 {
        let [x, y, z] = &self.coordinates;
        let (dx, dy, dz) = (x[a] - x[b], y[a] - y[b], z[a] - z[b]);
        ((dx * dx + dy * dy) + dz * dz).to_bits()
    }

    /// The `reach` nearest of the first `sources` points into `exact`, as keys: the distance's bits, which order like the
    /// distance, above the index.
    fn nearest(&mut self, query: usize, sources: usize, reach: usize) {
        let [x, y, z] = self.coordinates.each_ref().map(|c| &c[..sources]);
        let (qx, qy, qz) = (x[query], y[query], z[query]);
        self.exact.clear();
        self.exact.extend(x.iter().zip(y).zip(z).enumerate().map(|(n, ((x, y), z))| {
            let (dx, dy, dz) = (qx - x, qy - y, qz - z);
            let distance = (dx * dx + dy * dy) + dz * dz;
            (u64::from(distance.to_bits()) << 32) | n as u64
        }));
        if reach < self.exact.len() {
            self.exact.select_nth_unstable(reach);
        }
        self.exact.truncate(reach);
        self.exact.sort_unstable();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::naive::processors;
    use super::*;

    fn naive(points: &[[f32; 3]], plan: &PointPlan, layer: usize) -> Vec<u16> {
        let Layer { neighbours, dilation, .. } = LAYER_TABLE[layer];
        let mut out = Vec::new();
        for q in &points[..plan.0[layer]] {
            let mut all: Vec<(f32, u16)> = (0..plan.sources(layer) as u16)
                .map(|n| {
                    let p = points[usize::from(n)];
                    let d = [q[0] - p[0], q[1] - p[1], q[2] - p[2]];
                    ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2], n)
                })
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            out.extend((0..neighbours).map(|k| all[k * dilation].1));
        }
        out
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// From a coarse grid, where ties and duplicates are the rule, to one so fine that there are hardly any; with distances
        /// that are rounded to the same in between.
        #[test]
        fn lists_are_those_of_a_full_sort(
            cells in prop::collection::vec([-600i16..600, -600i16..600, -600i16..600], INPUT_POINTS),
            coarse in 1i16..200,
            tiny in prop::sample::select(vec![0.0f32, 1e-6, 1e-5]),
            plan in prop::sample::select(vec![[256, 256, 256, 256], [256, 96, 64, 48], [200, 65, 64, 47], [256, 130, 130, 70]]),
        ) {
            let cell = |v: i16| f32::from(v / coarse) * 0.0037 * f32::from(coarse) + f32::from(v) * tiny;
            let points: Vec<[f32; 3]> = cells.iter().map(|c| c.map(cell)).collect();
            let plan = PointPlan(plan);
            prop_assume!(plan.flaw().is_none());
            for arch in processors() {
                let mut lists = Default::default();
                Search::new(arch).lists(&points, &plan, &mut lists);
                for (layer, list) in lists.iter().enumerate() {
                    prop_assert_eq!(list, &naive(&points, &plan, layer), "layer {} {:?}", layer + 1, arch);
                }
            }
        }
    }
}

//! Neighbour lists, exactly as the training program makes them.
//!
//! The X-transform depends on the order of a point's neighbours, so distances are rounded the same way everywhere:
//! (dx dx + dy dy) + dz dz in f32, no fused multiply-add, ascending, ties by the lower index, duplicates kept.

use pulp::Arch;

use super::architecture::{INPUT_POINTS, LAYER_TABLE, LAYERS, Layer, PointPlan};
use super::simd::{Aligned, INDEX, Lowest, lanes};

/// Working memory of the search.
pub(super) struct Search {
    arch: Arch,
    coordinates: [Aligned; 3],
    /// A vector of keys for each point, and one of what was left out.
    keys: Aligned,
    lost: Aligned,
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
            exact: Vec::with_capacity(INPUT_POINTS),
        }
    }

    /// Neighbour lists of all layers: in layer l, `K` indices for each of its query points, nearest first.
    pub(super) fn lists(&mut self, points: &[[f32; 3]], plan: &PointPlan, lists: &mut [Vec<u16>; LAYERS]) {
        for (axis, column) in self.coordinates.iter_mut().enumerate() {
            column.iter_mut().zip(points).for_each(|(c, p)| *c = p[axis]);
        }
        lists.iter_mut().for_each(Vec::clear);
        let mut layer = 0;
        while layer < LAYERS {
            // Layers that look among the same points share one search.
            let sources = plan.sources(layer);
            let same = (layer..LAYERS).take_while(|l| plan.sources(*l) == sources).count();
            let together = layer..layer + same;
            let queries = together.clone().map(|l| plan.0[l]).max().unwrap_or(0);
            // A layer that keeps a point wants neighbours of all points before it, so no query reaches farther than the first of
            // its vector.
            let reach = |query: usize| {
                let wanted = together.clone().filter(|l| query < plan.0[*l]);
                wanted.map(|l| LAYER_TABLE[l].reach()).max().unwrap_or(0)
            };
            let width = self.lost.len();
            for first in (0..queries).step_by(width) {
                let kept = self.lowest(first, sources, reach(first));
                for query in first..queries.min(first + width) {
                    let reach = reach(query);
                    let exact = kept.is_some_and(|kept| self.settle(query, reach, kept));
                    if !exact {
                        self.nearest(query, sources, reach);
                    }
                    for l in together.clone().filter(|l| query < plan.0[*l]) {
                        let Layer { neighbours, dilation, .. } = LAYER_TABLE[l];
                        // The key's low half is the index.
                        lists[l]
                            .extend(self.exact.iter().step_by(dilation).take(neighbours).map(|k| *k as u16));
                    }
                }
            }
            layer += same;
        }
    }

    /// Sorts the keys of a vector of queries and tells how many are in order; none where there are no vectors: plain code does
    /// better without.
    fn lowest(&mut self, first: usize, sources: usize, reach: usize) -> Option<usize> {
        if self.lost.len() == 1 {
            return None;
        }
        let kept = reach.next_power_of_two().max(16);
        self.arch.dispatch(Lowest {
            points: self.coordinates.each_ref().map(|c| &c[..]),
            sources,
            query: first,
            kept,
            keys: bytemuck::cast_slice_mut(&mut self.keys),
            lost: bytemuck::cast_slice_mut(&mut self.lost),
        });
        Some(kept)
    }

    /// Puts the `reach` nearest of a query into `exact`, where its sorted keys tell them: those whose rounded distances are the
    /// same are compared by the true ones.
    fn settle(&mut self, query: usize, reach: usize, kept: usize) -> bool {
        let (width, lane) = (self.lost.len(), query % self.lost.len());
        let keys: &[u32] = bytemuck::cast_slice(&self.keys);
        let key = |n: usize| keys[n * width + lane];
        let end = key(reach - 1) | INDEX;
        if self.lost[lane].to_bits() <= end {
            return false;
        }
        self.exact.clear();
        let (mut before, mut ties) = (u32::MAX, false);
        for n in 0..kept {
            let key = key(n);
            if key > end {
                break;
            }
            ties |= (key ^ before) <= INDEX;
            before = key;
            self.exact.push(u64::from(key & INDEX));
        }
        if ties {
            let [x, y, z] = &self.coordinates;
            for key in &mut self.exact {
                let n = *key as usize;
                let (dx, dy, dz) = (x[query] - x[n], y[query] - y[n], z[query] - z[n]);
                *key |= u64::from(((dx * dx + dy * dy) + dz * dz).to_bits()) << 32;
            }
            self.exact.sort_unstable();
        }
        true
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
        /// On a coarse grid, where ties and duplicates are the rule.
        #[test]
        fn lists_are_those_of_a_full_sort(
            cells in prop::collection::vec([-6i8..6, -6i8..6, -6i8..6], INPUT_POINTS),
            swift in any::<bool>(),
        ) {
            let points: Vec<[f32; 3]> = cells.iter().map(|c| c.map(|v| f32::from(v) * 0.37)).collect();
            let plan = PointPlan(if swift { [256, 96, 64, 48] } else { [256; 4] });
            let mut lists = Default::default();
            Search::new(Arch::new()).lists(&points, &plan, &mut lists);
            for (layer, list) in lists.iter().enumerate() {
                prop_assert_eq!(list, &naive(&points, &plan, layer), "layer {}", layer + 1);
            }
        }
    }
}

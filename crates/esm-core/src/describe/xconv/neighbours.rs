//! Neighbour lists, exactly as the training program makes them.
//!
//! The X-transform depends on the order of a point's neighbours, so distances are rounded the same way everywhere:
//! (dx dx + dy dy) + dz dz in f32, no fused multiply-add, ascending, ties by the lower index, duplicates kept.

use super::architecture::{INPUT_POINTS, LAYER_TABLE, LAYERS, Layer, PointPlan};

/// Working memory of [`neighbours`].
pub(super) struct Search {
    coordinates: [Vec<f32>; 3],
    keys: Vec<u64>,
}

impl Search {
    pub(super) fn new() -> Self {
        Self { coordinates: Default::default(), keys: Vec::with_capacity(INPUT_POINTS) }
    }

    /// Neighbour lists of all layers: in layer l, `K` indices for each of its query points, nearest first.
    pub(super) fn lists(&mut self, points: &[[f32; 3]], plan: &PointPlan, lists: &mut [Vec<u16>; LAYERS]) {
        for (axis, column) in self.coordinates.iter_mut().enumerate() {
            column.clear();
            column.extend(points.iter().map(|p| p[axis]));
        }
        lists.iter_mut().for_each(Vec::clear);
        let mut layer = 0;
        while layer < LAYERS {
            // Layers that look among the same points share one search.
            let sources = plan.sources(layer);
            let same = (layer..LAYERS).take_while(|l| plan.sources(*l) == sources).count();
            let together = layer..layer + same;
            let queries = together.clone().map(|l| plan.0[l]).max().unwrap_or(0);
            for query in 0..queries {
                let wanted = together.clone().filter(|l| query < plan.0[*l]);
                let reach = wanted.clone().map(|l| LAYER_TABLE[l].reach()).max().unwrap_or(0);
                let nearest = self.nearest(query, sources, reach);
                for l in wanted {
                    let Layer { neighbours, dilation, .. } = LAYER_TABLE[l];
                    // The key's low half is the index.
                    lists[l].extend(nearest.iter().step_by(dilation).take(neighbours).map(|k| *k as u16));
                }
            }
            layer += same;
        }
    }

    /// The `reach` nearest of the first `sources` points, as keys: the distance's bits, which order like the distance,
    /// above the index.
    fn nearest(&mut self, query: usize, sources: usize, reach: usize) -> &[u64] {
        let [x, y, z] = self.coordinates.each_ref().map(|c| &c[..sources]);
        let (qx, qy, qz) = (x[query], y[query], z[query]);
        self.keys.clear();
        self.keys.extend(x.iter().zip(y).zip(z).enumerate().map(|(n, ((x, y), z))| {
            let (dx, dy, dz) = (qx - x, qy - y, qz - z);
            let distance = (dx * dx + dy * dy) + dz * dz;
            (u64::from(distance.to_bits()) << 32) | n as u64
        }));
        if reach < self.keys.len() {
            self.keys.select_nth_unstable(reach);
        }
        let nearest = &mut self.keys[..reach];
        nearest.sort_unstable();
        nearest
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
            Search::new().lists(&points, &plan, &mut lists);
            for (layer, list) in lists.iter().enumerate() {
                prop_assert_eq!(list, &naive(&points, &plan, layer), "layer {}", layer + 1);
            }
        }
    }
}

//! Numbers of clouds: quantiles, histograms, spacing.

use esm_core::index::Tree;
use nalgebra::{Matrix3, Vector3};

/// One line of a table.
pub(crate) struct Row {
    pub(crate) what: String,
    pub(crate) unit: &'static str,
    pub(crate) real: f64,
    pub(crate) sim: f64,
}

/// One comparison.
pub(crate) struct Table {
    pub(crate) title: String,
    pub(crate) name: &'static str,
    pub(crate) rows: Vec<Row>,
}

/// Values of one side, in the order of the rows.
#[derive(Default)]
pub(crate) struct Side(pub(crate) Vec<(String, &'static str, f64)>);

impl Side {
    pub(crate) fn put(&mut self, what: impl Into<String>, unit: &'static str, value: f64) {
        self.0.push((what.into(), unit, value));
    }

    /// Some quantiles of a sample, one row each.
    pub(crate) fn quantiles(&mut self, what: &str, unit: &'static str, mut values: Vec<f64>, at: &[f64]) {
        values.sort_by(f64::total_cmp);
        for q in at {
            let name = if *q == 0.5 {
                format!("{what}, median")
            } else {
                format!("{what}, {:.0} % quantile", q * 100.0)
            };
            self.put(name, unit, quantile(&values, *q));
        }
    }

    /// Shares of a sample between edges, in percent.
    pub(crate) fn shares(&mut self, what: &str, values: &[f64], edges: &[f64]) {
        for e in edges.windows(2) {
            let inside = values.iter().filter(|v| (e[0]..e[1]).contains(*v)).count();
            self.put(
                format!("{what} {} to {} m", e[0], e[1]),
                "%",
                100.0 * inside as f64 / values.len().max(1) as f64,
            );
        }
    }
}

/// Rows from both sides, which hold the same lines in the same order.
pub(crate) fn rows(real: Side, sim: Side) -> Vec<Row> {
    real.0
        .into_iter()
        .zip(sim.0)
        .map(|((what, unit, real), (other, _, sim))| {
            debug_assert_eq!(what, other);
            Row { what, unit, real, sim }
        })
        .collect()
}

/// Of a sorted sample; 0 of an empty one.
pub(crate) fn quantile(sorted: &[f64], q: f64) -> f64 {
    sorted.get(((sorted.len().max(1) - 1) as f64 * q).round() as usize).copied().unwrap_or(0.0)
}

/// Distance from each `every`-th point to its nearest neighbour, metres.
pub(crate) fn spacing(points: &[[f32; 3]], every: usize) -> Vec<f64> {
    let asked: Vec<[f32; 3]> = points.iter().step_by(every).copied().collect();
    // The first is the point itself.
    nearest(points, &asked, 2).into_iter().filter_map(|d| d.get(1).copied()).collect()
}

/// Distances from each of `asked` to its `k` nearest `points`, metres.
pub(crate) fn nearest(points: &[[f32; 3]], asked: &[[f32; 3]], k: usize) -> Vec<Vec<f64>> {
    Tree::try_new(points.as_flattened(), 3).map_or(Vec::new(), |tree| {
        let found = tree.nearest(asked.as_flattened(), k);
        found.iter().map(|row| row.iter().map(|n| f64::from(n.distance).sqrt()).collect()).collect()
    })
}

/// How far points lie off a plane through their surroundings: of each of `asked`, the root of the smallest eigenvalue of the
/// covariance of what lies within `radius` metres among its 40 nearest, where those are 12 or more; metres.
pub(crate) fn roughness(points: &[[f32; 3]], asked: &[[f32; 3]], radius: f64) -> Vec<f64> {
    let Some(tree) = Tree::try_new(points.as_flattened(), 3) else { return Vec::new() };
    tree.nearest(asked.as_flattened(), 40)
        .iter()
        .filter_map(|row| {
            let near: Vec<[f32; 3]> = row
                .iter()
                .filter(|n| f64::from(n.distance).sqrt() < radius)
                .map(|n| points[n.row as usize])
                .collect();
            (near.len() >= 12).then(|| spread(&near)[2].sqrt())
        })
        .collect()
}

/// Eigenvalues of the points' covariance, largest first, square metres.
pub(crate) fn spread(points: &[[f32; 3]]) -> [f64; 3] {
    let n = points.len() as f64;
    let at = |p: &[f32; 3]| Vector3::from(p.map(f64::from));
    let middle = points.iter().map(at).sum::<Vector3<f64>>() / n;
    let sum: Matrix3<f64> = points.iter().map(|p| (at(p) - middle) * (at(p) - middle).transpose()).sum();
    let mut values: [f64; 3] = (sum / n).symmetric_eigenvalues().into();
    values.sort_by(|a, b| b.total_cmp(a));
    values.map(|v| v.max(1e-9))
}

/// Distance from the sensor, metres.
pub(crate) fn range(p: &[f32; 3]) -> f64 {
    p.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt()
}

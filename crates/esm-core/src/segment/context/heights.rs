//! How high the ground is.

use rustc_hash::FxHashMap;

/// Ground heights of a cloud, by cells of half a metre.
pub(super) struct Heights {
    cells: FxHashMap<[i32; 2], (f64, u32)>,
}

impl Heights {
    const CELL: f32 = 0.5;

    pub(super) fn new(points: &[[f32; 3]]) -> Self {
        let mut cells: FxHashMap<[i32; 2], (f64, u32)> = FxHashMap::default();
        for p in points {
            let sum = cells.entry(Self::cell(p[0], p[1])).or_default();
            *sum = (sum.0 + f64::from(p[2]), sum.1 + 1);
        }
        Self { cells }
    }

    fn cell(x: f32, y: f32) -> [i32; 2] {
        [x, y].map(|v| (v / Self::CELL).floor() as i32)
    }

    /// The mean of the nearest ring of cells that holds ground; `None` beyond 1.5 m.
    pub(super) fn at(&self, x: f32, y: f32) -> Option<f32> {
        let [i, j] = Self::cell(x, y);
        for ring in 0i32..=3 {
            let mut sum = (0.0, 0u32);
            for di in -ring..=ring {
                for dj in -ring..=ring {
                    if di.abs().max(dj.abs()) == ring
                        && let Some(cell) = self.cells.get(&[i.saturating_add(di), j.saturating_add(dj)])
                    {
                        sum = (sum.0 + cell.0, sum.1 + cell.1);
                    }
                }
            }
            if sum.1 > 0 {
                return Some((sum.0 / f64::from(sum.1)) as f32);
            }
        }
        None
    }
}

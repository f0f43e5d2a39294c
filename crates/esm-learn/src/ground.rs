//! How high segments are above the ground.

use esm_core::segment::Segment;
use rustc_hash::FxHashMap;

/// Height of a segment's lowest point above the ground points around it, metres; NaN where there are none within 1.5 m.
pub(crate) fn above_ground(segment: &Segment, ground: &Ground) -> f32 {
    let lowest = segment.points.iter().min_by(|a, b| a[2].total_cmp(&b[2]));
    lowest.map_or(f32::NAN, |p| p[2] - ground.height(p[0], p[1]))
}

/// Ground heights of a cloud, by cells of half a metre.
pub(crate) struct Ground {
    cells: FxHashMap<[i32; 2], (f64, u32)>,
}

impl Ground {
    const CELL: f32 = 0.5;

    pub(crate) fn new(points: &[[f32; 3]]) -> Self {
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

    /// The mean of the nearest ring of cells that holds ground; NaN beyond 1.5 m.
    fn height(&self, x: f32, y: f32) -> f32 {
        let [i, j] = Self::cell(x, y);
        for ring in 0i32..=3 {
            let mut sum = (0.0, 0u32);
            for di in -ring..=ring {
                for dj in -ring..=ring {
                    if di.abs().max(dj.abs()) == ring
                        && let Some(cell) = self.cells.get(&[i + di, j + dj])
                    {
                        sum = (sum.0 + cell.0, sum.1 + cell.1);
                    }
                }
            }
            if sum.1 > 0 {
                return (sum.0 / f64::from(sum.1)) as f32;
            }
        }
        f32::NAN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_above_the_ground_near_by() {
        let ground: Vec<[f32; 3]> = (0..1600)
            .map(|i| [(i % 40) as f32 * 0.2, (i / 40) as f32 * 0.2, 0.1 * (i % 40) as f32 * 0.2])
            .collect();
        let ground = Ground::new(&ground);
        let sign = Segment::from_points(vec![[4.0, 4.0, 2.4], [4.0, 4.0, 2.9]]).unwrap();
        assert!((above_ground(&sign, &ground) - 2.0).abs() < 0.05);
        let far = Segment::from_points(vec![[40.0, 4.0, 2.4]]).unwrap();
        assert!(above_ground(&far, &ground).is_nan());
    }
}

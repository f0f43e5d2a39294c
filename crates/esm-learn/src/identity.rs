//! Which segments are one and the same object.

use esm_core::segment::Segment;
use rustc_hash::FxHashMap;

/// Side of the cells that centroids are sorted into, metres: at least the largest `different_m`.
const CELL_M: f64 = 5.0;

/// When two segments at some distance are the same object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IdentityRule {
    /// Centroids up to this far apart are one object, metres.
    pub same_m: f64,
    /// Centroids beyond this are different ones, metres; what lies between is neither.
    pub different_m: f64,
}

impl IdentityRule {
    /// The paper's rule for drives whose objects have no numbers (section IV).
    pub const PAPER: Self = Self { same_m: 0.5, different_m: 4.0 };

    /// For objects with numbers. A long hedge or a terrace of houses is cut into several segments that carry one number:
    /// only what stands in the same place is told to be the same.
    pub const NUMBERED: Self = Self { same_m: 1.0, different_m: 3.0 };
}

/// A part of an object that has a name of its own.
struct Part {
    object: u32,
    centroid_map: [f64; 3],
    identity: i64,
}

/// Gives segments of one place their identities, in the order in which they come, over all visits.
///
/// ```
/// use esm_learn::{Identities, IdentityRule};
/// let mut identities = Identities::new(IdentityRule::PAPER);
/// let first = identities.of(0, [0.0, 0.0, 1.0]);
/// assert_eq!(identities.of(0, [0.3, 0.0, 1.0]), first);
/// assert_eq!(identities.of(0, [2.0, 0.0, 1.0]), -1, "neither the same nor another");
/// assert_ne!(identities.of(0, [9.0, 0.0, 1.0]), first);
/// ```
pub struct Identities {
    rule: IdentityRule,
    parts: Vec<Part>,
    /// Parts by cell; looked up, never iterated.
    cells: FxHashMap<[i64; 2], Vec<u32>>,
}

impl Identities {
    /// Nothing is known yet.
    pub fn new(rule: IdentityRule) -> Self {
        Self { rule, parts: Vec::new(), cells: FxHashMap::default() }
    }

    /// The identity of a segment of an object (0 for all where objects have no numbers): that of the nearest part of the
    /// same object within `same_m`, a new one where none is within `different_m`, else -1.
    pub fn of(&mut self, object: u32, centroid_map: [f64; 3]) -> i64 {
        let cell = [0, 1].map(|a| (centroid_map[a] / CELL_M).floor() as i64);
        let near = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [cell[0] + i, cell[1] + j]));
        let distance =
            |p: &Part| (0..3).map(|a| (p.centroid_map[a] - centroid_map[a]).powi(2)).sum::<f64>().sqrt();
        let nearest = near
            .filter_map(|c| self.cells.get(&c))
            .flatten()
            .map(|n| &self.parts[*n as usize])
            .filter(|p| p.object == object)
            .map(|p| (distance(p), p.identity))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        match nearest {
            Some((d, identity)) if d <= self.rule.same_m => identity,
            Some((d, _)) if d <= self.rule.different_m => -1,
            _ => {
                let identity = self.parts.len() as i64;
                self.cells.entry(cell).or_default().push(identity as u32);
                self.parts.push(Part { object, centroid_map, identity });
                identity
            }
        }
    }

    /// Number of identities so far.
    pub fn len(&self) -> usize {
        self.parts.len()
    }

    /// Whether nothing has been seen.
    pub fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }
}

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
    fn parts_of_one_long_object_have_names_of_their_own() {
        let mut identities = Identities::new(IdentityRule::NUMBERED);
        let a = identities.of(5, [0.0, 0.0, 0.0]);
        let b = identities.of(5, [8.0, 0.0, 0.0]);
        assert!(a >= 0 && b >= 0 && a != b);
        assert_eq!(identities.of(5, [0.9, 0.0, 0.0]), a);
        assert_eq!(identities.of(5, [7.2, 0.1, 0.0]), b);
        assert_eq!(identities.of(5, [2.5, 0.0, 0.0]), -1);
        let other = identities.of(6, [0.1, 0.0, 0.0]);
        assert!(other >= 0 && other != a, "another number is another object, wherever it stands");
        assert_eq!(identities.len(), 3);
    }

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

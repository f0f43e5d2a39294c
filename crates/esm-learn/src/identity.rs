//! Which segments are one and the same object.

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
}

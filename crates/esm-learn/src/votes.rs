//! Which object the points of a segment belong to, by the labels of the raw points in their voxels.

use esm_io::PointLabel;
use rustc_hash::FxHashMap;

/// The class of what is not known.
pub const UNKNOWN_CLASS: u8 = 255;

/// Share of a segment's points that one object must have to give the segment its name.
const MAJORITY: f64 = 0.6;

/// Labels by voxel, in the frame of a live cloud.
#[derive(Default)]
pub(crate) struct Votes {
    size: f32,
    /// Labels seen in a voxel with their counts; looked up, never iterated.
    cells: FxHashMap<[i32; 3], Vec<(PointLabel, u32)>>,
}

impl Votes {
    pub(crate) fn new(size: f32) -> Self {
        Self { size, cells: FxHashMap::default() }
    }

    fn cell(&self, p: [f32; 3]) -> [i32; 3] {
        p.map(|v| (v / self.size).floor() as i32)
    }

    pub(crate) fn add(&mut self, p: [f32; 3], label: PointLabel) {
        let seen = self.cells.entry(self.cell(p)).or_default();
        match seen.iter_mut().find(|(l, _)| *l == label) {
            Some((_, n)) => *n += 1,
            None => seen.push((label, 1)),
        }
    }

    /// The label most points in the point's voxel have; ties go to the lower number.
    fn of(&self, p: [f32; 3]) -> Option<PointLabel> {
        let seen = self.cells.get(&self.cell(p))?;
        seen.iter().max_by_key(|(l, n)| (*n, std::cmp::Reverse(l.object))).map(|(l, _)| *l)
    }

    /// The object that a segment shows, if one has a clear majority of its points.
    pub(crate) fn of_segment(&self, points: &[[f32; 3]]) -> Option<PointLabel> {
        let mut counts: FxHashMap<u32, (u32, PointLabel)> = FxHashMap::default();
        for label in points.iter().filter_map(|p| self.of(*p)) {
            counts.entry(label.object).or_insert((0, label)).0 += 1;
        }
        let best = counts.values().max_by_key(|(n, l)| (*n, std::cmp::Reverse(l.object)))?;
        (f64::from(best.0) >= MAJORITY * points.len() as f64).then_some(best.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: PointLabel = PointLabel { object: 3, class: 1 };
    const CAR: PointLabel = PointLabel { object: 9, class: 2 };

    #[test]
    fn the_majority_gives_the_name_and_a_mixture_has_none() {
        let mut votes = Votes::new(0.2);
        for i in 0..10 {
            let x = i as f32 * 0.2 + 0.1;
            votes.add([x, 0.0, 0.0], TREE);
            votes.add([x, 0.0, 0.0], if i < 4 { CAR } else { TREE });
            votes.add([x, 0.0, 0.0], if i < 4 { CAR } else { TREE });
        }
        let points: Vec<[f32; 3]> = (0..10).map(|i| [i as f32 * 0.2 + 0.05, 0.01, 0.01]).collect();
        assert_eq!(votes.of_segment(&points), Some(TREE));
        assert_eq!(votes.of_segment(&points[..4]), Some(CAR));
        assert_eq!(votes.of_segment(&points[..8]), None, "half and half");
        assert_eq!(votes.of_segment(&[[50.0, 0.0, 0.0]]), None, "nothing was seen there");
    }
}

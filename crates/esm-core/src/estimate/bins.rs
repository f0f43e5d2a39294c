//! Candidates by where they lie in the map: only neighbours can agree, however large the map.

use std::ops::Range;

use super::candidate::Candidate;

/// Cells to the reach of a live cloud.
const CELLS_TO_REACH: f32 = 6.0;

/// Candidates in cells of a horizontal grid over the map.
///
/// Members are sorted by cell (x, then y), live segment and index: what is tested together lies together, and what can
/// agree with a member lies in one range of each column of cells.
pub(super) struct Bins {
    /// Candidate index of each member.
    pub(super) order: Vec<u32>,
    /// Live segment of each member.
    pub(super) live: Vec<u32>,
    edge: f32,
    /// The cells that hold members, sorted, and the first member of each; one more start at the end.
    cells: Vec<(i64, i64)>,
    starts: Vec<usize>,
    /// The columns that hold cells, and the first cell of each; one more at the end.
    columns: Vec<(i64, usize)>,
}

impl Bins {
    /// `reach`: the largest distance of two candidates in the map that can agree, metres.
    pub(super) fn new(candidates: &[Candidate], reach: f32) -> Self {
        Self::of(candidates, reach, |_| true)
    }

    /// Of some of the candidates alone.
    pub(super) fn of(candidates: &[Candidate], reach: f32, wanted: impl Fn(usize) -> bool) -> Self {
        let edge = (reach / CELLS_TO_REACH).max(1.0);
        // Bounded, so that cells next to it can be counted whatever the map says.
        let number = |v: f32| (f64::from(v) / f64::from(edge)).floor().clamp(-1e12, 1e12) as i64;
        let mut keyed: Vec<((i64, i64), u32, u32)> = candidates
            .iter()
            .enumerate()
            .filter(|(i, _)| wanted(*i))
            .map(|(i, c)| ((number(c.pair.map[0]), number(c.pair.map[1])), c.live, i as u32))
            .collect();
        keyed.sort_unstable();
        let (mut cells, mut starts) = (Vec::new(), Vec::new());
        for (member, key) in keyed.iter().enumerate() {
            if cells.last() != Some(&key.0) {
                cells.push(key.0);
                starts.push(member);
            }
        }
        starts.push(keyed.len());
        let mut columns: Vec<(i64, usize)> = cells.iter().enumerate().map(|(i, c)| (c.0, i)).collect();
        columns.dedup_by_key(|c| c.0);
        columns.push((i64::MAX, cells.len()));
        Self {
            order: keyed.iter().map(|k| k.2).collect(),
            live: keyed.iter().map(|k| k.1).collect(),
            edge,
            cells,
            starts,
            columns,
        }
    }

    /// Number of cells that hold members.
    pub(super) fn cells(&self) -> usize {
        self.cells.len()
    }

    /// Members of a cell.
    pub(super) fn members(&self, cell: usize) -> Range<usize> {
        self.starts[cell]..self.starts[cell + 1]
    }

    /// For what lies in `cell`: the members of later cells within `reach` metres, in ascending ranges. Every near pair
    /// of cells comes once.
    pub(super) fn later(&self, cell: usize, reach: f32, ranges: &mut Vec<Range<usize>>) {
        ranges.clear();
        let (x, y) = self.cells[cell];
        let own = self.columns.partition_point(|c| c.0 <= x);
        self.add(cell + 1..self.columns[own].1, y + 1, y + self.along(reach, 0), ranges);
        self.add_columns(own, (x, y), reach, ranges);
    }

    /// For what lies in a cell of `others`, bins of the same reach: all members here within `reach` metres, in ascending
    /// ranges.
    pub(super) fn around(&self, others: &Self, cell: usize, reach: f32, ranges: &mut Vec<Range<usize>>) {
        ranges.clear();
        let at = others.cells[cell];
        let farthest = at.0 - self.along(reach, 0);
        self.add_columns(self.columns.partition_point(|c| c.0 < farthest), at, reach, ranges);
    }

    /// Adds what lies within reach of a cell in the columns from the `first` on.
    fn add_columns(&self, first: usize, (x, y): (i64, i64), reach: f32, ranges: &mut Vec<Range<usize>>) {
        for pair in self.columns[first..].windows(2) {
            let aside = (pair[0].0 - x).abs();
            if aside > self.along(reach, 0) {
                break;
            }
            let along = self.along(reach, aside);
            self.add(pair[0].1..pair[1].1, y - along, y + along, ranges);
        }
    }

    /// Cells along a column, `aside` columns away, that may lie within reach.
    fn along(&self, reach: f32, aside: i64) -> i64 {
        // Between a cell and one `aside` columns on lie at least aside - 1 whole columns.
        let aside = (aside - 1).max(0) as f32 * self.edge;
        i64::from(((reach * reach - aside * aside).max(0.0).sqrt() / self.edge) as i32) + 1
    }

    /// Adds the members of the cells from `low` to `high` among the cells of one column.
    fn add(&self, cells: Range<usize>, low: i64, high: i64, ranges: &mut Vec<Range<usize>>) {
        let column = &self.cells[cells.clone()];
        let first = cells.start + column.partition_point(|c| c.1 < low);
        let last = cells.start + column.partition_point(|c| c.1 <= high);
        if first < last {
            ranges.push(self.starts[first]..self.starts[last]);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::estimate::rigid::Pair;

    proptest! {
        #[test]
        fn all_near_pairs_come_once(at in prop::collection::vec(prop::array::uniform2(-90.0f32..90.0), 1..80), reach in 1.0f32..80.0) {
            let candidates: Vec<Candidate> = at
                .iter()
                .map(|p| Candidate {
                    live: 0,
                    map: 0,
                    distance: 0.0,
                    quality: 1.0,
                    pair: Pair { live: [0.0; 3], map: [p[0], p[1], 0.0] },
                    turns: u64::MAX,
                })
                .collect();
            let bins = Bins::new(&candidates, 80.0);
            let mut times = vec![0; at.len() * at.len()];
            let mut ranges = Vec::new();
            for cell in 0..bins.cells() {
                bins.later(cell, reach, &mut ranges);
                prop_assert!(ranges.windows(2).all(|r| r[0].end <= r[1].start));
                let mut around = Vec::new();
                bins.around(&bins, cell, reach, &mut around);
                prop_assert!(around.windows(2).all(|r| r[0].end <= r[1].start));
                let later: Vec<usize> = ranges.iter().cloned().flatten().collect();
                let own = bins.members(cell);
                prop_assert!(own.clone().all(|m| around.iter().any(|r| r.contains(&m))));
                let from_here: Vec<usize> = around.iter().cloned().flatten().filter(|m| *m >= own.end).collect();
                prop_assert_eq!(later, from_here);
                for a in bins.members(cell) {
                    let own = a + 1..bins.members(cell).end;
                    for b in own.chain(ranges.iter().cloned().flatten()) {
                        prop_assert!(a < b);
                        times[bins.order[a] as usize * at.len() + bins.order[b] as usize] += 1;
                    }
                }
            }
            for i in 0..at.len() {
                for j in 0..i {
                    let found = times[i * at.len() + j] + times[j * at.len() + i];
                    let near = (at[i][0] - at[j][0]).hypot(at[i][1] - at[j][1]) <= reach;
                    prop_assert!(found == 1 || (found == 0 && !near), "{found} {near}");
                }
            }
        }
    }
}

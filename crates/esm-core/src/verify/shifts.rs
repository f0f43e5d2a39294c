//! Does the map look the same a few metres on? Rows of trees, of parked cars and of equal houses do.
//!
//! Among equal segments the nearest in descriptor space are any of them, so a wrong place may gather many matches while
//! the right one gathers few: the runner-up of the search does not tell. The map does: where the segments that a cloud was
//! matched with stand again, equally large, one step further on, the step could as well have been taken.

use rustc_hash::FxHashMap;

use crate::map::{Map, SegmentRecord};

/// Longest step that is looked at, metres: longer ones are left to the matches.
const REACH_M: f32 = 20.0;
/// Edge of the cells in which steps are counted, metres.
const CELL_M: f32 = 1.0;
/// A segment stands where the step takes another one when it is this near, metres.
const NEAR_M: f32 = 0.8;
/// Extents are alike when they differ by less than this share, and this many metres.
const ALIKE: f32 = 0.2;
const ALIKE_M: f32 = 0.3;
/// Steps that are counted exactly.
const TRIED: usize = 8;

/// Which map segments stand near a position.
pub struct Shifts {
    cells: FxHashMap<[i32; 2], Vec<u32>>,
}

/// A step over which the map repeats itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shift {
    /// Metres, in the map frame.
    pub step: [f32; 3],
    /// Share of the given segments that stand there again, 0 to 1.
    pub share: f64,
}

impl Shifts {
    /// For all segments of a map.
    pub fn new(map: &Map) -> Self {
        let mut cells: FxHashMap<[i32; 2], Vec<u32>> = FxHashMap::default();
        for (i, s) in map.segments().iter().enumerate() {
            cells.entry(cell(s.centroid, REACH_M)).or_default().push(i as u32);
        }
        Self { cells }
    }

    /// The step, longer than `least_m`, over which most of the segments `of` repeat themselves; `None` where not two do.
    pub fn best(&self, map: &Map, of: &[u32], least_m: f64) -> Option<Shift> {
        let all = map.segments();
        let steps: Vec<Vec<[f32; 3]>> = of.iter().map(|i| self.steps(all, *i, least_m as f32)).collect();
        let mut counts: FxHashMap<[i32; 2], (u32, usize)> = FxHashMap::default();
        for (i, steps) in steps.iter().enumerate() {
            for s in steps {
                let (count, last) = counts.entry(cell(*s, CELL_M)).or_insert((0, usize::MAX));
                if *last != i {
                    (*count, *last) = (*count + 1, i);
                }
            }
        }
        let mut cells: Vec<(u32, [i32; 2])> = counts.into_iter().map(|(k, v)| (v.0, k)).collect();
        cells.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
        cells.truncate(TRIED);
        let mut best: Option<(usize, Shift)> = None;
        for (_, key) in cells {
            let middle = [(key[0] as f32 + 0.5) * CELL_M, (key[1] as f32 + 0.5) * CELL_M];
            // Each segment's nearest step; their mean is the step.
            let near: Vec<[f32; 3]> = steps.iter().filter_map(|s| nearest(s, middle, 1.5 * NEAR_M)).collect();
            let n = near.len().max(1) as f32;
            let mean = [0, 1, 2].map(|a| near.iter().map(|s| s[a]).sum::<f32>() / n);
            let agree = steps.iter().filter(|s| nearest(s, [mean[0], mean[1]], NEAR_M).is_some()).count();
            if agree >= 2 && best.is_none_or(|b| agree > b.0) {
                best = Some((agree, Shift { step: mean, share: agree as f64 / of.len() as f64 }));
            }
        }
        best.map(|b| b.1)
    }

    /// Steps from a segment to those like it.
    fn steps(&self, all: &[SegmentRecord], i: u32, least_m: f32) -> Vec<[f32; 3]> {
        let from = &all[i as usize];
        let [x, y] = cell(from.centroid, REACH_M);
        let mut steps = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                for j in self.cells.get(&[x + dx, y + dy]).into_iter().flatten() {
                    let to = &all[*j as usize];
                    let step = [0, 1, 2].map(|a| to.centroid[a] - from.centroid[a]);
                    let length = step[0].hypot(step[1]);
                    if length >= least_m && length <= REACH_M && alike(from, to) {
                        steps.push(step);
                    }
                }
            }
        }
        steps
    }
}

fn alike(a: &SegmentRecord, b: &SegmentRecord) -> bool {
    (0..3).all(|i| {
        let (a, b) = (a.extent[i], b.extent[i]);
        (a - b).abs() <= ALIKE_M + ALIKE * a.max(b)
    })
}

fn nearest(steps: &[[f32; 3]], to: [f32; 2], within_m: f32) -> Option<[f32; 3]> {
    let off = |s: &[f32; 3]| (s[0] - to[0]).hypot(s[1] - to[1]);
    steps.iter().filter(|s| off(s) <= within_m).min_by(|a, b| off(a).total_cmp(&off(b))).copied()
}

fn cell(at: [f32; 3], edge: f32) -> [i32; 2] {
    [(at[0] / edge).floor() as i32, (at[1] / edge).floor() as i32]
}

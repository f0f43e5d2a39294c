//! A pyramid of 2-D grids that holds occupied cells only.

use crate::segment::radix::{Word, bits_for, floor_i64, sort_by_key};

/// No cell.
pub(super) const NONE: u32 = u32::MAX;

/// One grid: its occupied cells in ascending order of y, then x. Cell `(i, j)` spans `[i, i + 1) x [j, j + 1)` edges.
pub(super) struct Grid {
    /// Edge of a cell, metres.
    pub(super) edge: f64,
    /// x and y index of each cell.
    pub(super) cells: Vec<[i32; 2]>,
    /// The cell of the next coarser grid that holds each cell; empty in the coarsest.
    pub(super) parents: Vec<u32>,
    lookup: Lookup,
}

/// Finds a cell by its indices: by a table where the area is small enough for one, else by bisection.
enum Lookup {
    Table { low: [i32; 2], size: [i64; 2], cell_at: Vec<u32> },
    Bisection,
}

impl Grid {
    fn new(edge: f64, cells: Vec<[i32; 2]>) -> Self {
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for c in &cells {
            for a in 0..2 {
                low[a] = low[a].min(c[a]);
                high[a] = high[a].max(c[a]);
            }
        }
        let size: [i64; 2] = std::array::from_fn(|a| (i64::from(high[a]) - i64::from(low[a]) + 1).max(0));
        // A table a few times larger than the cells it holds (and a small one in any case) keeps memory linear.
        let lookup = match size[0].checked_mul(size[1]) {
            Some(area) if area <= 16 * cells.len() as i64 + (1 << 16) => {
                let mut cell_at = vec![NONE; area as usize];
                for (i, c) in cells.iter().enumerate() {
                    let [dx, dy] = [0, 1].map(|a| i64::from(c[a]) - i64::from(low[a]));
                    let at = dy * size[0] + dx;
                    cell_at[at as usize] = i as u32;
                }
                Lookup::Table { low, size, cell_at }
            }
            _ => Lookup::Bisection,
        };
        Self { edge, cells, parents: Vec::new(), lookup }
    }

    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The cell with these indices, or [`NONE`].
    #[inline]
    pub(super) fn find(&self, x: i64, y: i64) -> u32 {
        match &self.lookup {
            Lookup::Table { low, size, cell_at } => {
                let (dx, dy) = (x - i64::from(low[0]), y - i64::from(low[1]));
                if dx < 0 || dy < 0 || dx >= size[0] || dy >= size[1] {
                    return NONE;
                }
                cell_at[(dy * size[0] + dx) as usize]
            }
            Lookup::Bisection => self
                .cells
                .binary_search_by_key(&(y, x), |c| (i64::from(c[1]), i64::from(c[0])))
                .map_or(NONE, |i| i as u32),
        }
    }

    /// Centre of a cell, metres.
    #[inline]
    pub(super) fn centre(&self, cell: usize) -> [f64; 2] {
        self.cells[cell].map(|k| (f64::from(k) + 0.5) * self.edge)
    }

    /// Occupied cells of the square of `2 radius + 1` cells about a cell, itself included, in ascending order.
    #[inline]
    pub(super) fn for_around(&self, cell: usize, radius: i64, mut visit: impl FnMut(usize)) {
        let [x, y] = self.cells[cell].map(i64::from);
        for j in y - radius..=y + radius {
            for i in x - radius..=x + radius {
                let found = self.find(i, j);
                if found != NONE {
                    visit(found as usize);
                }
            }
        }
    }
}

/// Grids of doubling edge, finest first, and the points sorted into the finest.
pub(super) struct Pyramid {
    pub(super) grids: Vec<Grid>,
    /// Points of finest cell `c`: `order[starts[c]..starts[c + 1]]`.
    pub(super) starts: Vec<u32>,
    /// Point indices, cell by cell; points too far out for the grid are missing.
    pub(super) order: Vec<u32>,
}

impl Pyramid {
    pub(super) fn new(points: &[[f32; 3]], finest_edge: f64, levels: usize) -> Self {
        let per_metre = 1.0 / finest_edge;
        let mut placed = Vec::with_capacity(points.len());
        let (mut low, mut high) = ([i32::MAX; 2], [i32::MIN; 2]);
        for (index, p) in points.iter().enumerate() {
            let k = [p[0], p[1]].map(|v| i32::try_from(floor_i64(f64::from(v) * per_metre)));
            if let [Ok(x), Ok(y)] = k {
                for (a, k) in [x, y].into_iter().enumerate() {
                    low[a] = low[a].min(k);
                    high[a] = high[a].max(k);
                }
                placed.push(([x, y], index as u32));
            }
        }
        let bits: [u32; 2] = match placed.is_empty() {
            true => [0; 2],
            false => std::array::from_fn(|a| bits_for(high[a].abs_diff(low[a]).into())),
        };
        let key =
            |c: [i32; 2]| (u128::from(c[1].abs_diff(low[1])) << bits[0]) | u128::from(c[0].abs_diff(low[0]));
        let key_bits = bits[0] + bits[1];
        let order: Vec<u32> = if key_bits <= 32 {
            let words = placed.iter().map(|&(c, i)| u64::pack(key(c), i)).collect();
            sort_by_key::<u64>(words, key_bits).iter().map(|w| w.index()).collect()
        } else {
            let words = placed.iter().map(|&(c, i)| u128::pack(key(c), i)).collect();
            sort_by_key::<u128>(words, key_bits).iter().map(|w| w.index()).collect()
        };
        drop(placed);

        let cell_of = |i: u32| {
            let p = points[i as usize];
            [p[0], p[1]].map(|v| floor_i64(f64::from(v) * per_metre) as i32)
        };
        let (mut cells, mut starts) = (Vec::<[i32; 2]>::new(), Vec::new());
        for (at, &i) in order.iter().enumerate() {
            let c = cell_of(i);
            if cells.last() != Some(&c) {
                cells.push(c);
                starts.push(at as u32);
            }
        }
        starts.push(order.len() as u32);

        let mut grids = vec![Grid::new(finest_edge, cells)];
        for level in 1..levels {
            let finer = &grids[level - 1];
            let mut cells: Vec<[i32; 2]> = finer.cells.iter().map(|c| [c[0] >> 1, c[1] >> 1]).collect();
            cells.sort_unstable_by_key(|c| (c[1], c[0]));
            cells.dedup();
            let grid = Grid::new(finer.edge * 2.0, cells);
            let parents =
                finer.cells.iter().map(|c| grid.find((c[0] >> 1).into(), (c[1] >> 1).into())).collect();
            grids[level - 1].parents = parents;
            grids.push(grid);
        }
        Self { grids, starts, order }
    }
}

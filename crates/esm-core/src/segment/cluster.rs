//! Euclidean clustering: the single-linkage components of a cloud at a distance, exactly.
//!
//! Points are sorted into cubic cells so small that all points of a cell are within the tolerance of each other: the
//! cells, not the points, are the nodes of the union-find. Eight cells make a block, wide enough that links reach only
//! into the neighbouring blocks. Rows of blocks (equal y and z) are merged with their four forward neighbour rows by
//! moving pointers; two cells are compared only where they are not connected yet, and the comparison ends at the first
//! pair in reach. No hashing, and no memory that grows with the extent of the cloud.

mod pairs;

use super::disjoint_sets::DisjointSets;
use super::radix::{Word, bits_for, floor_i64, sort_by_key};
use pairs::any_linked;

/// Largest difference of the keys of two cells that can hold a linked pair: with cells of tolerance / sqrt(3), two on
/// each axis. That is one block.
const REACH: u32 = 2;

/// Cell edge over tolerance. Just below 1/sqrt(3) = 0.57735, so that rounding cannot put two points of one cell out of
/// each other's reach, and well above 1/2, so that [`REACH`] holds.
const CELL_OVER_TOLERANCE: f64 = 0.5768;

/// Beyond this many cells from the origin, f32 coordinates are thousands of cells apart: each value gets its own key.
const LAST_REGULAR_CELL: i64 = 1 << 40;

/// Connected components of the points, as ascending indices, ordered by their smallest index.
///
/// Two points are linked when `(dx*dx + dy*dy) + dz*dz <= tolerance * tolerance` in f32; components with fewer than
/// `min_points` or more than `max_points` points are left out. The result is exactly that of comparing all pairs and
/// does not depend on the order of the points but for the numbers they have.
///
/// `tolerance` is in metres, positive and at least 1e-6; points must be finite. Of a cloud of more than `2^32 - 1`
/// points the rest is not read.
///
/// ```
/// use esm_core::segment::euclidean_clusters;
/// let points = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.5, 0.0, 0.0]];
/// assert_eq!(euclidean_clusters(&points, 0.5, 1, 10), vec![vec![0, 2], vec![1]]);
/// assert_eq!(euclidean_clusters(&points, 0.5, 2, 10), vec![vec![0, 2]]);
/// ```
pub fn euclidean_clusters(
    points: &[[f32; 3]],
    tolerance: f32,
    min_points: usize,
    max_points: usize,
) -> Vec<Vec<u32>> {
    let points = &points[..points.len().min(u32::MAX as usize)];
    if points.is_empty() {
        return Vec::new();
    }
    let mut cells = Cells::new(points, tolerance);
    let mut sets = DisjointSets::new(cells.len());
    cells.link(tolerance * tolerance, &mut sets);
    collect(points.len(), &cells, &mut sets, min_points, max_points)
}

/// Writes out the components in the order of their smallest point index.
fn collect(
    n: usize,
    cells: &Cells,
    sets: &mut DisjointSets,
    min_points: usize,
    max_points: usize,
) -> Vec<Vec<u32>> {
    let mut root_of_point = vec![0u32; n];
    let mut size_of_root = vec![0usize; cells.len()];
    for cell in 0..cells.len() {
        let root = sets.find(cell as u32);
        let members = &cells.order[cells.range(cell)];
        size_of_root[root as usize] += members.len();
        for &i in members {
            root_of_point[i as usize] = root;
        }
    }
    const UNSEEN: u32 = u32::MAX;
    let mut cluster_of_root = vec![UNSEEN; cells.len()];
    let mut clusters: Vec<Vec<u32>> = Vec::new();
    for (i, &root) in root_of_point.iter().enumerate() {
        let size = size_of_root[root as usize];
        if size < min_points || size > max_points {
            continue;
        }
        let cluster = &mut cluster_of_root[root as usize];
        if *cluster == UNSEEN {
            *cluster = clusters.len() as u32;
            clusters.push(Vec::with_capacity(size));
        }
        clusters[*cluster as usize].push(i as u32);
    }
    clusters
}

/// A run of blocks that share y and z, ascending in x.
#[derive(Clone, Copy)]
struct Row {
    y: u32,
    z: u32,
    first: u32,
    end: u32,
}

/// A cube of 2 x 2 x 2 cells; the cells that are occupied are `first_cell..` up to the next block's.
#[derive(Clone, Copy)]
struct Block {
    x: u32,
    first_cell: u32,
    /// Whether the block's cells are known to be in one set.
    uniform: bool,
}

/// The points sorted by block (z-major, then y, then x), and within a block by cell.
struct Cells {
    /// Points of cell `c`: `points[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    /// One more than there are blocks: the last one ends the list.
    blocks: Vec<Block>,
    rows: Vec<Row>,
    points: Vec<[f32; 3]>,
    /// Original index of each sorted point, cell by cell.
    order: Vec<u32>,
}

impl Cells {
    fn new(points: &[[f32; 3]], tolerance: f32) -> Self {
        let per_metre = 1.0 / (CELL_OVER_TOLERANCE * f64::from(tolerance));
        let keys: Vec<[i64; 3]> = points.iter().map(|p| p.map(|v| axis_key(v, per_metre))).collect();
        let (mut low, mut high) = ([i64::MAX; 3], [i64::MIN; 3]);
        for k in &keys {
            for a in 0..3 {
                low[a] = low[a].min(k[a]);
                high[a] = high[a].max(k[a]);
            }
        }
        // At least one bit an axis: the lowest is the cell's place in its block.
        let bits: [u32; 3] = std::array::from_fn(|a| bits_for(high[a].abs_diff(low[a])).max(1));
        if bits.iter().sum::<u32>() <= 32 {
            let relative = |k: &[i64; 3]| std::array::from_fn(|a| k[a].abs_diff(low[a]) as u32);
            Self::sorted::<u64>(points, keys.iter().map(relative), bits)
        } else {
            let axes: [Vec<u32>; 3] = std::array::from_fn(|a| close_gaps(&keys, a));
            let bits =
                axes.each_ref().map(|axis| bits_for(axis.iter().copied().max().unwrap_or(0).into()).max(1));
            let keys = (0..points.len()).map(|i| [axes[0][i], axes[1][i], axes[2][i]]);
            Self::sorted::<u128>(points, keys, bits)
        }
    }

    fn sorted<W: Word>(points: &[[f32; 3]], keys: impl Iterator<Item = [u32; 3]>, bits: [u32; 3]) -> Self {
        let (bits_x, bits_y) = (bits[0] - 1, bits[1] - 1);
        let pack = |(i, k): (usize, [u32; 3])| {
            let octant = (k[2] & 1) << 2 | (k[1] & 1) << 1 | k[0] & 1;
            let [x, y, z] = k.map(|k| u128::from(k >> 1));
            W::pack(((z << bits_y | y) << bits_x | x) << 3 | u128::from(octant), i as u32)
        };
        let words = sort_by_key(keys.enumerate().map(pack).collect::<Vec<W>>(), bits.iter().sum());

        let mask = |bits: u32| (1u128 << bits) - 1;
        let (mut starts, mut blocks, mut rows) = (Vec::new(), Vec::<Block>::new(), Vec::<Row>::new());
        let mut last = None;
        for (at, w) in words.iter().enumerate() {
            let key = w.key();
            if last == Some(key) {
                continue;
            }
            let cell = starts.len() as u32;
            starts.push(at as u32);
            if last.is_none_or(|last| last >> 3 != key >> 3) {
                let block = blocks.len() as u32;
                let x = (key >> 3 & mask(bits_x)) as u32;
                blocks.push(Block { x, first_cell: cell, uniform: false });
                let y = (key >> (3 + bits_x) & mask(bits_y)) as u32;
                let z = (key >> (3 + bits_x + bits_y)) as u32;
                match rows.last_mut() {
                    Some(row) if row.y == y && row.z == z => row.end = block + 1,
                    _ => rows.push(Row { y, z, first: block, end: block + 1 }),
                }
            }
            last = Some(key);
        }
        blocks.push(Block { x: u32::MAX, first_cell: starts.len() as u32, uniform: false });
        starts.push(words.len() as u32);
        let order: Vec<u32> = words.iter().map(|w| w.index()).collect();
        let points = order.iter().map(|&i| points[i as usize]).collect();
        Self { starts, blocks, rows, points, order }
    }

    /// Number of cells.
    fn len(&self) -> usize {
        self.starts.len() - 1
    }

    fn range(&self, cell: usize) -> std::ops::Range<usize> {
        self.starts[cell] as usize..self.starts[cell + 1] as usize
    }

    fn cells_of(&self, block: u32) -> std::ops::Range<u32> {
        self.blocks[block as usize].first_cell..self.blocks[block as usize + 1].first_cell
    }

    /// Unites all cells that hold a linked pair.
    fn link(&mut self, tolerance2: f32, sets: &mut DisjointSets) {
        for block in 0..self.blocks.len() as u32 - 1 {
            let cells = self.cells_of(block);
            for a in cells.clone() {
                for b in a + 1..cells.end {
                    self.link_cells(a, b, tolerance2, sets);
                }
            }
            let root = sets.find(cells.start);
            self.blocks[block as usize].uniform = cells.clone().all(|c| sets.find(c) == root);
        }
        for r in 0..self.rows.len() {
            let row = self.rows[r];
            for a in row.first..row.end - 1 {
                if self.blocks[a as usize + 1].x - self.blocks[a as usize].x == 1 {
                    self.link_blocks(a, a + 1, tolerance2, sets);
                }
            }
        }
        for (dy, dz) in [(1, 0), (0, 1), (-1, 1), (1, 1)] {
            let mut s = 0;
            for r in 0..self.rows.len() {
                let row = self.rows[r];
                let wanted = (u64::from(row.z) + dz, i64::from(row.y) + dy);
                let place = |row: &Row| (u64::from(row.z), i64::from(row.y));
                while s < self.rows.len() && place(&self.rows[s]) < wanted {
                    s += 1;
                }
                match self.rows.get(s) {
                    None => break,
                    Some(other) if place(other) == wanted => self.link_rows(row, *other, tolerance2, sets),
                    Some(_) => {}
                }
            }
        }
    }

    /// Unites the cells of two rows, sweeping both along x.
    fn link_rows(&mut self, row: Row, other: Row, tolerance2: f32, sets: &mut DisjointSets) {
        let mut lower = other.first;
        for a in row.first..row.end {
            let x = i64::from(self.blocks[a as usize].x);
            while lower < other.end && i64::from(self.blocks[lower as usize].x) < x - 1 {
                lower += 1;
            }
            for b in lower..other.end {
                if i64::from(self.blocks[b as usize].x) > x + 1 {
                    break;
                }
                self.link_blocks(a, b, tolerance2, sets);
            }
        }
    }

    #[inline]
    fn link_blocks(&mut self, a: u32, b: u32, tolerance2: f32, sets: &mut DisjointSets) {
        let (cells_a, cells_b) = (self.cells_of(a), self.cells_of(b));
        let uniform = self.blocks[a as usize].uniform && self.blocks[b as usize].uniform;
        if uniform && sets.find(cells_a.start) == sets.find(cells_b.start) {
            return;
        }
        for cell_a in cells_a {
            for cell_b in cells_b.clone() {
                if self.link_cells(cell_a, cell_b, tolerance2, sets) && uniform {
                    return;
                }
            }
        }
    }

    /// Whether the two cells are in one set, united or found so.
    #[inline]
    fn link_cells(&mut self, a: u32, b: u32, tolerance2: f32, sets: &mut DisjointSets) -> bool {
        let (root_a, root_b) = (sets.find(a), sets.find(b));
        if root_a == root_b {
            return true;
        }
        let (start_a, end_a) = (self.starts[a as usize] as usize, self.starts[a as usize + 1] as usize);
        let (start_b, end_b) = (self.starts[b as usize] as usize, self.starts[b as usize + 1] as usize);
        // Cells are stored in ascending order and a < b: the two ranges lie in disjoint halves.
        let (head, tail) = self.points.split_at_mut(start_b);
        let linked = any_linked(&mut head[start_a..end_a], &mut tail[..end_b - start_b], tolerance2);
        if linked {
            sets.unite(root_a, root_b);
        }
        linked
    }
}

/// Cell of a coordinate along one axis. Equal coordinates have equal keys, keys ascend with the coordinate, and
/// coordinates whose keys differ by more than [`REACH`] are more than the tolerance apart.
#[inline]
fn axis_key(v: f32, per_metre: f64) -> i64 {
    let cell = f64::from(v) * per_metre;
    if cell.abs() < LAST_REGULAR_CELL as f64 {
        floor_i64(cell)
    } else {
        let steps = i64::from(v.abs().to_bits()) * i64::from(REACH + 1);
        if v > 0.0 { LAST_REGULAR_CELL + steps } else { -LAST_REGULAR_CELL - 1 - steps }
    }
}

/// Keys of one axis moved together: gaps up to [`REACH`] stay, wider ones become `REACH + 1`.
fn close_gaps(keys: &[[i64; 3]], axis: usize) -> Vec<u32> {
    let mut distinct: Vec<i64> = keys.iter().map(|k| k[axis]).collect();
    distinct.sort_unstable();
    distinct.dedup();
    let mut closed = Vec::with_capacity(distinct.len());
    let mut at = 0u32;
    for (i, key) in distinct.iter().enumerate() {
        if i > 0 {
            at = at.saturating_add(key.abs_diff(distinct[i - 1]).min(u64::from(REACH + 1)) as u32);
        }
        closed.push(at);
    }
    keys.iter().map(|k| closed[distinct.partition_point(|d| *d < k[axis])]).collect()
}

#[cfg(test)]
mod tests;

//! [`Esf`]: the ensemble of shape functions (Wohlkinger and Vincze, ROBIO 2011), the 640 numbers that SegMatch judges its
//! candidates by.
//!
//! Three random points of the segment give three distances (D2), the angles between them (A3) and the square root of their
//! triangle's area (D3). Each distance is a line through a grid of the segment's cells: it runs inside the surface, outside, or
//! both, and so there are three histograms of 64 bins of each kind, and a tenth of how far the lines that do both run inside.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::eigen::rows;
use super::{Descriptions, Descriptor};
use crate::segment::Segment;

/// Bins a histogram.
pub(super) const BINS: usize = 64;
/// Histograms: D2, A3 and D3, each in, out and mixed, then the ratio of the mixed lines.
pub(super) const HISTOGRAMS: usize = 10;
const ESF_DIM: usize = BINS * HISTOGRAMS;

/// Triples that are drawn.
const TRIPLES: usize = 20_000;
/// Draws, those of triples that span no triangle among them.
const MOST_DRAWS: usize = 2 * TRIPLES;
/// Smallest area of a triangle that counts, in a segment scaled to the unit ball.
const LEAST_AREA: f64 = 1e-3;

/// Cells along an edge of the grid, which holds the unit ball.
const GRID: usize = 64;
/// A point marks the cells around its own as well, or the gaps between points would count as outside.
const MARGIN: i32 = 1;
/// Cells that a line through nothing crosses at its two ends.
const ENDS: usize = 7;

/// The 640 numbers, dimensionless; each kind's three histograms sum to 1, and so does the tenth.
#[derive(Clone, Copy, Debug, Default)]
pub struct Esf;

impl Descriptor for Esf {
    fn name(&self) -> &'static str {
        "esf"
    }

    fn version(&self) -> u32 {
        1
    }

    fn dim(&self) -> usize {
        ESF_DIM
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        rows(ESF_DIM, segments, histograms)
    }
}

/// Where a line runs.
#[derive(Clone, Copy)]
enum Run {
    In = 0,
    Out = 1,
    Mixed = 2,
}

/// Fills the histograms; all zero for a segment that spans no triangle.
pub(super) fn histograms(segment: &Segment, row: &mut [f32]) {
    row.fill(0.0);
    let points = unit_ball(segment);
    let n = points.len();
    if n < 3 {
        return;
    }
    let grid = Grid::new(&points);
    let mut random = ChaCha8Rng::seed_from_u64(n as u64);
    // Distances are binned by the longest of them, which is known only at the end.
    let mut distances: Vec<(f64, Run)> = Vec::with_capacity(3 * TRIPLES);
    let mut roots: Vec<(f64, Run)> = Vec::with_capacity(TRIPLES);
    let (mut draws, mut triples) = (0, 0);
    while triples < TRIPLES && draws < MOST_DRAWS {
        draws += 1;
        let corner: [usize; 3] = std::array::from_fn(|_| below(&mut random, n));
        let [a, b, c] = corner.map(|i| points[i]);
        let sides = [(a, b), (b, c), (c, a)];
        let lengths = sides.map(|(p, q)| distance(p, q));
        let [x, y, z] = lengths;
        let s = (x + y + z) / 2.0;
        let area = (s * (s - x) * (s - y) * (s - z)).max(0.0).sqrt();
        if area < LEAST_AREA {
            continue;
        }
        triples += 1;
        let lines = sides.map(|(p, q)| grid.trace(p, q));
        for k in 0..3 {
            let (run, share) = lines[k];
            distances.push((lengths[k], run));
            if matches!(run, Run::Mixed) {
                count(row, 9, share);
            }
            // The angle across from a line, by the law of cosines; pi fills the last bin.
            let (across, u, v) = (lengths[k], lengths[(k + 1) % 3], lengths[(k + 2) % 3]);
            let cosine = ((u * u + v * v - across * across) / (2.0 * u * v)).clamp(-1.0, 1.0);
            count(row, 3 + run as usize, cosine.acos() / std::f64::consts::PI);
        }
        // A triangle is in or out where all its sides are.
        let whole = |kind: usize| lines.iter().all(|(run, _)| *run as usize == kind);
        roots.push((
            area.sqrt(),
            if whole(0) {
                Run::In
            } else if whole(1) {
                Run::Out
            } else {
                Run::Mixed
            },
        ));
    }
    for (first, values) in [(0, &distances), (6, &roots)] {
        let most = values.iter().map(|v| v.0).fold(f64::MIN_POSITIVE, f64::max);
        values.iter().for_each(|(v, run)| count(row, first + *run as usize, v / most));
    }
    for kind in [0..3, 3..6, 6..9, 9..10] {
        let part = &mut row[kind.start * BINS..kind.end * BINS];
        let sum: f32 = part.iter().sum();
        part.iter_mut().for_each(|v| *v /= sum.max(1.0));
    }
}

/// Counts a value of 0 to 1.
fn count(row: &mut [f32], histogram: usize, value: f64) {
    let bin = ((value * BINS as f64) as usize).min(BINS - 1);
    row[histogram * BINS + bin] += 1.0;
}

/// The points about their centroid, divided by the largest distance from it.
fn unit_ball(segment: &Segment) -> Vec<[f64; 3]> {
    let n = segment.points.len().max(1) as f64;
    let mean = [0, 1, 2].map(|a| segment.points.iter().map(|p| f64::from(p[a])).sum::<f64>() / n);
    let mut points: Vec<[f64; 3]> =
        segment.points.iter().map(|p| [0, 1, 2].map(|a| f64::from(p[a]) - mean[a])).collect();
    let radius = points.iter().map(|p| distance(*p, [0.0; 3])).fold(1e-6, f64::max);
    points.iter_mut().for_each(|p| *p = p.map(|v| v / radius));
    points
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

/// Uniform in 0..n, n > 0 (Lemire 2019, without the rejection: the bias is below n / 2^64).
fn below(random: &mut ChaCha8Rng, n: usize) -> usize {
    ((u128::from(random.next_u64()) * n as u128) >> 64) as usize
}

/// Which cells of the unit ball's cube hold points: for each (x, y) the bits along z.
struct Grid {
    columns: Vec<u64>,
}

impl Grid {
    fn new(points: &[[f64; 3]]) -> Self {
        let mut columns = vec![0u64; GRID * GRID];
        let inside = |v: i32| (0..GRID as i32).contains(&v);
        for p in points {
            let [x, y, z] = p.map(|v| cell(v).floor() as i32);
            let mut bits = 0u64;
            for z in (z - MARGIN..=z + MARGIN).filter(|z| inside(*z)) {
                bits |= 1 << z;
            }
            for x in (x - MARGIN..=x + MARGIN).filter(|x| inside(*x)) {
                for y in (y - MARGIN..=y + MARGIN).filter(|y| inside(*y)) {
                    columns[x as usize * GRID + y as usize] |= bits;
                }
            }
        }
        Self { columns }
    }

    /// Where the line runs, and the share of its cells that are occupied. One cell a step along the longest axis.
    fn trace(&self, from: [f64; 3], to: [f64; 3]) -> (Run, f64) {
        let (a, b) = (from.map(cell), to.map(cell));
        let steps = (0..3).map(|i| (b[i] - a[i]).abs()).fold(0.0, f64::max).ceil().max(1.0);
        let step = [0, 1, 2].map(|i| (b[i] - a[i]) / steps);
        let cells = steps as usize + 1;
        let mut occupied = 0;
        for n in 0..cells {
            let at = |i: usize| ((a[i] + step[i] * n as f64) as usize).min(GRID - 1);
            occupied += (self.columns[at(0) * GRID + at(1)] >> at(2) & 1) as usize;
        }
        let run = match occupied {
            all if all + 1 >= cells => Run::In,
            few if few <= ENDS => Run::Out,
            _ => Run::Mixed,
        };
        (run, occupied as f64 / cells as f64)
    }
}

/// A coordinate of the unit ball in cells, within the grid's border.
fn cell(v: f64) -> f64 {
    ((v + 1.0) / 2.0 * GRID as f64).clamp(0.0, GRID as f64 - 1e-6)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(points: Vec<[f32; 3]>) -> Vec<f32> {
        Esf.describe(&[Segment::from_points(points).unwrap()]).values
    }

    fn share(row: &[f32], histogram: usize) -> f32 {
        row[histogram * BINS..][..BINS].iter().sum()
    }

    /// A grid of points, `n` along each axis, `step` apart.
    fn lattice(n: [i32; 3], step: f32) -> Vec<[f32; 3]> {
        let axis = |a: usize| 0..n[a];
        axis(0)
            .flat_map(|x| axis(1).flat_map(move |y| axis(2).map(move |z| [x, y, z].map(|v| v as f32 * step))))
            .collect()
    }

    #[test]
    fn lines_in_a_full_cube_run_inside_and_between_two_plates_outside() {
        let full = row(lattice([21; 3], 0.1));
        assert!(share(&full, 0) > 0.99, "{}", share(&full, 0));
        let mut plates = lattice([1, 21, 21], 0.1);
        plates.extend(lattice([1, 21, 21], 0.1).into_iter().map(|p| [p[0] + 4.0, p[1], p[2]]));
        let row = row(plates);
        // Half of all lines lead from one plate to the other.
        assert!((share(&row, 1) - 0.5).abs() < 0.1, "{}", share(&row, 1));
        assert!(share(&row, 0) > 0.4 && share(&row, 2) < 0.1);
    }

    #[test]
    fn each_kind_sums_to_one_and_equal_sides_meet_at_sixty_degrees() {
        // Three points: every triangle is the same one, with sides of equal length.
        let h = 3f32.sqrt() / 2.0;
        let row = row(vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, h, 0.0]]);
        for kind in [0..3, 3..6, 6..9] {
            assert!((kind.map(|n| share(&row, n)).sum::<f32>() - 1.0).abs() < 1e-3);
        }
        let angles: Vec<usize> = (0..BINS).filter(|b| (3..6).any(|n| row[n * BINS + b] > 0.0)).collect();
        assert!(angles.iter().all(|b| (20..=21).contains(b)), "60 of 180 degrees: {angles:?}");
        let last = (0..3).map(|n| row[n * BINS + BINS - 1]).sum::<f32>();
        assert!((last - 1.0).abs() < 1e-3, "all distances are the longest");
    }

    #[test]
    fn size_and_heading_change_little_another_shape_much() {
        let wall = lattice([40, 2, 12], 0.2);
        let turned: Vec<[f32; 3]> =
            wall.iter().map(|p| [20.0 - 2.0 * p[1], 2.0 * p[0], 2.0 * p[2]]).collect();
        let pole = lattice([2, 2, 40], 0.2);
        let [wall, turned, pole] = [wall, turned, pole].map(row);
        let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f32>();
        assert!(4.0 * apart(&wall, &turned) < apart(&wall, &pole));
    }

    #[test]
    fn flat_lines_and_single_points_give_zeros() {
        let line = row((0..50).map(|i| [i as f32 * 0.1, 0.0, 0.0]).collect());
        assert!(line.iter().chain(&row(vec![[1.0; 3]])).all(|v| *v == 0.0));
    }
}

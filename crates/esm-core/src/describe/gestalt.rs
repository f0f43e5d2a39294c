//! [`Gestalt`]: the Gestalt descriptor (Bosse and Zlot, ICRA 2013) about a key pose of the segment's own, the features of
//! natural segment matching (NSM; Tinchev et al., IROS 2018).
//!
//! 66 numbers: planarity and cylindricality, then mean and variance of the heights in 4 rings x 8 sectors about the key pose.
//! The key pose stands at the segment's centroid on the level of its lowest point and looks along the horizontal direction of
//! largest variance, seen so that its third moment is not negative: the same for the same thing from wherever it is met. The
//! rings are equally wide and reach the farthest point.

use super::eigen::{eigenvalues, features, rows};
use super::{Descriptions, Descriptor};
use crate::segment::Segment;

const RINGS: usize = 4;
const SECTORS: usize = 8;
const CELLS: usize = RINGS * SECTORS;
pub(super) const GESTALT_DIM: usize = 2 + 2 * CELLS;

/// The 66 numbers; means in metres, variances in square metres, 0 where a cell is empty.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gestalt;

impl Descriptor for Gestalt {
    fn name(&self) -> &'static str {
        "gestalt"
    }

    fn version(&self) -> u32 {
        1
    }

    fn dim(&self) -> usize {
        GESTALT_DIM
    }

    fn standardized(&self) -> bool {
        true
    }

    fn describe(&self, segments: &[Segment]) -> Descriptions {
        rows(GESTALT_DIM, segments, heights)
    }
}

/// Fills one row.
pub(super) fn heights(segment: &Segment, row: &mut [f32]) {
    let [linearity, planarity, ..] = features(eigenvalues(segment));
    // A line is a thin cylinder.
    (row[0], row[1]) = (planarity, linearity);
    let points = &segment.points;
    let n = points.len().max(1) as f64;
    let mean = [0, 1].map(|a| points.iter().map(|p| f64::from(p[a])).sum::<f64>() / n);
    let ground = f64::from(segment.min[2]);
    let about =
        |p: &[f32; 3]| [f64::from(p[0]) - mean[0], f64::from(p[1]) - mean[1], f64::from(p[2]) - ground];
    let [c, s] = direction(points.iter().map(about));
    let reach = points.iter().map(about).map(|[x, y, _]| x.hypot(y)).fold(0.0, f64::max).max(1e-6);
    let mut sums = [[0f64; 3]; CELLS];
    for [x, y, z] in points.iter().map(about) {
        let (u, v) = (c * x + s * y, c * y - s * x);
        let ring = ((u.hypot(v) / reach * RINGS as f64) as usize).min(RINGS - 1);
        // Sectors are centred on the directions ahead, ahead to the left, left, ...: a thing that lies along the axis is not
        // torn apart by a border.
        let turn = v.atan2(u) / std::f64::consts::TAU + 1.0 + 0.5 / SECTORS as f64;
        let sector = (turn.fract() * SECTORS as f64) as usize % SECTORS;
        let cell = &mut sums[ring * SECTORS + sector];
        *cell = [cell[0] + 1.0, cell[1] + z, cell[2] + z * z];
    }
    for (cell, [count, sum, squares]) in sums.into_iter().enumerate() {
        let mean = sum / count.max(1.0);
        row[2 + cell] = mean as f32;
        row[2 + CELLS + cell] = (squares / count.max(1.0) - mean * mean).max(0.0) as f32;
    }
}

/// Cosine and sine of the angle from the x axis to the horizontal direction of largest variance.
fn direction(about: impl Iterator<Item = [f64; 3]> + Clone) -> [f64; 2] {
    let sums = |[xx, xy, yy]: [f64; 3], [x, y, _]: [f64; 3]| [xx + x * x, xy + x * y, yy + y * y];
    let [xx, xy, yy] = about.clone().fold([0.0; 3], sums);
    let (s, c) = (0.5 * f64::atan2(2.0 * xy, xx - yy)).sin_cos();
    let third: f64 = about.map(|[x, y, _]| (c * x + s * y).powi(3)).sum();
    if third < 0.0 { [-c, -s] } else { [c, s] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sloping wall, higher and with more points towards one end, at any heading and place.
    fn wall(yaw: f64, at: [f64; 3]) -> Segment {
        let (s, c) = yaw.sin_cos();
        let mut points = Vec::new();
        for i in 0..60 {
            for k in 0..=(4 + i / 4) {
                for j in 0..2 {
                    let (x, y, z) = (0.1 * f64::from(i), 0.12 * f64::from(j) + 0.03, 0.2 * f64::from(k));
                    points.push([at[0] + c * x - s * y, at[1] + s * x + c * y, at[2] + z].map(|v| v as f32));
                }
            }
        }
        Segment::from_points(points).unwrap()
    }

    #[test]
    fn place_and_heading_change_next_to_nothing() {
        let all = [wall(0.0, [0.0; 3]), wall(2.2, [8.0, -3.0, 1.0]), wall(-1.0, [-40.0, 12.0, -2.0])];
        let rows = Gestalt.describe(&all).values;
        let [first, others @ ..] = [0, 1, 2].map(|n| &rows[n * GESTALT_DIM..][..GESTALT_DIM]);
        for other in others {
            // Points on the border of a ring may fall on either side.
            let off: f32 = first.iter().zip(other).map(|(a, b)| (a - b).abs()).sum();
            assert!(off < 0.05 * first.iter().sum::<f32>(), "{off}");
        }
    }

    #[test]
    fn heights_are_those_of_the_cells() {
        // A post of 2 m at the key pose and one of 4 m ahead of it, heavy enough that ahead is where it stands.
        let mut points: Vec<[f32; 3]> = Vec::new();
        for k in 0..=20 {
            points.extend([[-1.0, 0.0, 0.1 * k as f32], [-1.0, 0.01, 0.1 * k as f32]]);
            points.push([5.0, 0.0, 0.2 * k as f32]);
        }
        let row = Gestalt.describe(&[Segment::from_points(points).unwrap()]).values;
        let mean = |ring: usize, sector: usize| row[2 + ring * SECTORS + sector];
        let variance = |ring: usize, sector: usize| row[2 + CELLS + ring * SECTORS + sector];
        // The centroid is at x = 1: one post is 4 m ahead (the last ring), the other 2 m behind (the third of four).
        assert!((mean(3, 0) - 2.0).abs() < 1e-5, "{row:?}");
        assert!((mean(2, 4) - 1.0).abs() < 1e-5, "{row:?}");
        // Of 21 evenly spaced heights: step^2 (21^2 - 1) / 12.
        assert!((variance(3, 0) - 0.04 * 440.0 / 12.0).abs() < 1e-4);
        assert!((variance(2, 4) - 0.01 * 440.0 / 12.0).abs() < 1e-4);
        assert_eq!(row[2..].iter().filter(|v| **v != 0.0).count(), 4);
    }

    #[test]
    fn one_point_gives_finite_numbers() {
        let row = Gestalt.describe(&[Segment::from_points(vec![[3.0; 3]]).unwrap()]).values;
        assert!(row.iter().all(|v| v.is_finite()));
    }
}

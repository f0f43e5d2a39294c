//! From a segment to SegMap's input: turned by its principal axes, fitted axis by axis into an occupancy grid.

use crate::segment::Segment;

/// Cells along x, y and z.
pub(super) const GRID: [usize; 3] = [32, 32, 16];

/// Objects smaller than 3.2 x 3.2 x 1.6 m are not blown up: along each axis a cell measures at least this, metres.
const LEAST_CELL_M: f64 = 0.1;

/// Occupied cells: for each column (x, y) of the grid the bits of its 16 cells, lowest first.
pub(super) type Columns = [u16; GRID[0] * GRID[1]];

/// Fills the columns and gives the segment's extents in metres. x is the horizontal direction of largest variance, seen so that
/// its third moment is not negative; the mean of the points comes to the grid's middle, and what then lies outside is left
/// out, as in the published preprocessing.
pub(super) fn fit(segment: &Segment, columns: &mut Columns) -> [f32; 3] {
    columns.fill(0);
    let points = &segment.points;
    let n = points.len().max(1) as f64;
    let mean = [0, 1, 2].map(|a| points.iter().map(|p| f64::from(p[a])).sum::<f64>() / n);
    let centred = |p: &[f32; 3]| [0, 1, 2].map(|a| f64::from(p[a]) - mean[a]);
    let [c, s] = direction(points.iter().map(centred));
    let turned = |p: &[f32; 3]| {
        let [x, y, z] = centred(p);
        [c * x + s * y, c * y - s * x, z]
    };
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in points.iter().map(turned) {
        for a in 0..3 {
            (low[a], high[a]) = (low[a].min(p[a]), high[a].max(p[a]));
        }
    }
    let extents = [0, 1, 2].map(|a| (high[a] - low[a]).max(0.0));
    let most = GRID.map(|cells| cells as f64 - 1.0);
    let scale = [0, 1, 2].map(|a| extents[a].max(GRID[a] as f64 * LEAST_CELL_M));
    for p in points.iter().map(turned) {
        let at = [0, 1, 2].map(|a| (p[a] / scale[a] * most[a] + most[a] / 2.0).floor());
        if (0..3).all(|a| (0.0..GRID[a] as f64).contains(&at[a])) {
            let [x, y, z] = at.map(|v| v as usize);
            columns[x * GRID[1] + y] |= 1 << z;
        }
    }
    extents.map(|m| m as f32)
}

/// Cosine and sine of the angle from the x axis to the horizontal direction that x becomes.
fn direction(centred: impl Iterator<Item = [f64; 3]> + Clone) -> [f64; 2] {
    let sums = |[xx, xy, yy]: [f64; 3], [x, y, _]: [f64; 3]| [xx + x * x, xy + x * y, yy + y * y];
    let [xx, xy, yy] = centred.clone().fold([0.0; 3], sums);
    let (s, c) = (0.5 * f64::atan2(2.0 * xy, xx - yy)).sin_cos();
    let third: f64 = centred.map(|[x, y, _]| (c * x + s * y).powi(3)).sum();
    if third < 0.0 { [-c, -s] } else { [c, s] }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall of 8 x 0.4 x 2 m with a buttress near one end, at any heading.
    fn wall(yaw: f64) -> Segment {
        let mut points = Vec::new();
        for i in 0..=40 {
            for k in 0..=10 {
                for j in 0..=if i > 36 { 5 } else { 2 } {
                    let (x, y) = (0.2 * f64::from(i), 0.2 * f64::from(j));
                    let (s, c) = yaw.sin_cos();
                    points.push([c * x - s * y + 30.0, s * x + c * y, 0.2 * f64::from(k)].map(|v| v as f32));
                }
            }
        }
        Segment::from_points(points).unwrap()
    }

    #[test]
    fn the_heading_changes_next_to_nothing() {
        let mut first = [0; 1024];
        let extents = fit(&wall(0.3), &mut first);
        assert!((extents[2] - 2.0).abs() < 1e-5 && extents[0] > 7.9 && extents[1] < 1.6, "{extents:?}");
        for yaw in [1.4, 3.0, -2.2] {
            let mut other = [0; 1024];
            let again = fit(&wall(yaw), &mut other);
            assert!(extents.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-3));
            let both: u32 = first.iter().zip(&other).map(|(a, b)| (a & b).count_ones()).sum();
            let any: u32 = first.iter().zip(&other).map(|(a, b)| (a | b).count_ones()).sum();
            // Points on a lattice lie on borders of cells, where rounding decides.
            assert!(f64::from(both) > 0.8 * f64::from(any), "{both} of {any}");
        }
    }

    #[test]
    fn small_things_stay_small_and_one_point_is_in_the_middle() {
        let dot = Segment::from_points(vec![[5.0, -3.0, 1.0]]).unwrap();
        let mut columns = [0; 1024];
        assert_eq!(fit(&dot, &mut columns), [0.0; 3]);
        assert_eq!(columns[15 * 32 + 15], 1 << 7);
        assert_eq!(columns.iter().map(|c| c.count_ones()).sum::<u32>(), 1);
        // 0.4 m are a ninth of the 3.2 m that the grid spans at least.
        let stub = Segment::from_points(vec![[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]).unwrap();
        fit(&stub, &mut columns);
        let xs: Vec<usize> = (0..1024).filter(|i| columns[*i] != 0).map(|i| i / 32).collect();
        assert_eq!(xs, [13, 17]);
    }
}

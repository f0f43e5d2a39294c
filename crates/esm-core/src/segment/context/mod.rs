//! What stands around a segment, told without a heading: what a robot sees again from wherever it comes.

mod heights;

use rayon::prelude::*;
use rustc_hash::FxHashMap;

use self::heights::Heights;
use super::Segment;

/// Rings about a segment.
pub const RINGS: usize = 7;
/// Numbers a ring.
pub const RING_NUMBERS: usize = 4;

/// Inner and outer radius of each ring, metres.
const RADII_M: [f32; RINGS + 1] = [0.0, 1.5, 3.0, 5.0, 7.5, 10.5, 14.0, 20.0];
/// Edge of the columns that things are counted by, metres.
const COLUMN_M: f32 = 0.4;
/// Tops of columns count from this far below the segment's lowest point to this far above it, metres.
const TOPS_M: [f32; 2] = [-2.0, 6.0];
/// Added to a ring's occupied share, so that what little stands in an empty ring does not count as much as a full one.
const SHARE_FLOOR: f64 = 0.01;

/// Points that belong to no cluster.
const NONE: u32 = u32::MAX;

/// What stands around a segment in its cloud.
///
/// Everything that stands on the ground within 20 m, in a segment or not, is counted by columns of 0.4 x 0.4 m, in seven rings
/// about the segment's centroid (edges at 1.5, 3, 5, 7.5, 10.5, 14 and 20 m). The numbers are the same whatever way the sensor
/// looked, to within the columns.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Context {
    /// Height of the segment's lowest point above the ground around it, metres; `None` where there is none within 1.5 m.
    pub above_ground: Option<f32>,
    /// Of each ring, with s the share of its area that is occupied: the square root of s; then, over the square root of
    /// s + 0.01, the sum of the columns' tops above the segment's lowest point (from -2 to 6 m) and the lengths of the
    /// columns' first and second circular moments, each a column of the ring's area: metres, and pure numbers.
    pub rings: [[f32; RING_NUMBERS]; RINGS],
}

/// A column of what stands.
struct Column {
    x: f32,
    y: f32,
    top: f32,
    cluster: u32,
}

/// Segments of clusters of `points`, each with what stands around it among all of them. `ground` holds the ground points of the
/// same cloud.
///
/// # Panics
/// Where a cluster names a point that is not there.
pub fn segments_of(points: &[[f32; 3]], ground: &[[f32; 3]], clusters: &[Vec<u32>]) -> Vec<Segment> {
    let columns = columns(points, clusters);
    let heights = Heights::new(ground);
    (0..clusters.len())
        .into_par_iter()
        .filter_map(|n| {
            let mut segment =
                Segment::from_points(clusters[n].iter().map(|i| points[*i as usize]).collect())?;
            segment.context = Context {
                above_ground: above_ground(&segment, &heights),
                rings: rings(&segment, n as u32, &columns),
            };
            Some(segment)
        })
        .collect()
}

fn above_ground(segment: &Segment, heights: &Heights) -> Option<f32> {
    let lowest = segment.points.iter().min_by(|a, b| a[2].total_cmp(&b[2]))?;
    Some(lowest[2] - heights.at(lowest[0], lowest[1])?)
}

/// The columns, ordered by x, then y, then cluster. Where things of two clusters stand above each other each has its own.
fn columns(points: &[[f32; 3]], clusters: &[Vec<u32>]) -> Vec<Column> {
    let mut cluster = vec![NONE; points.len()];
    for (n, members) in clusters.iter().enumerate() {
        members.iter().for_each(|i| cluster[*i as usize] = n as u32);
    }
    let mut tops: FxHashMap<(i32, i32, u32), f32> = FxHashMap::default();
    for (p, cluster) in points.iter().zip(cluster) {
        let [i, j] = [p[0], p[1]].map(|v| (v / COLUMN_M).floor() as i32);
        tops.entry((i, j, cluster)).and_modify(|top| *top = top.max(p[2])).or_insert(p[2]);
    }
    let mut keys: Vec<_> = tops.into_iter().collect();
    keys.par_sort_unstable_by_key(|(key, _)| *key);
    let middle = |i: i32| (i as f32 + 0.5) * COLUMN_M;
    keys.into_iter()
        .map(|((i, j, cluster), top)| Column { x: middle(i), y: middle(j), top, cluster })
        .collect()
}

fn rings(segment: &Segment, own: u32, columns: &[Column]) -> [[f32; RING_NUMBERS]; RINGS] {
    let [x, y, _] = segment.centroid;
    let reach = RADII_M[RINGS];
    let first = columns.partition_point(|c| c.x < x - reach);
    let last = columns.partition_point(|c| c.x <= x + reach);
    // Count, tops, and the two moments with their two parts.
    let mut sums = [[0f64; 6]; RINGS];
    for c in columns.get(first..last).unwrap_or_default() {
        let (dx, dy) = (c.x - x, c.y - y);
        let squared = dx * dx + dy * dy;
        if c.cluster == own || squared >= reach * reach {
            continue;
        }
        let ring = RADII_M[1..].iter().filter(|r| squared >= **r * **r).count();
        let distance = squared.sqrt().max(1e-6);
        let (cos, sin) = (dx / distance, dy / distance);
        let top = (c.top - segment.min[2]).clamp(TOPS_M[0], TOPS_M[1]);
        let parts = [1.0, top, cos, sin, cos * cos - sin * sin, 2.0 * cos * sin];
        sums[ring].iter_mut().zip(parts).for_each(|(sum, part)| *sum += f64::from(part));
    }
    std::array::from_fn(|ring| {
        let area = f64::from(RADII_M[ring + 1].powi(2) - RADII_M[ring].powi(2)) * std::f64::consts::PI;
        let room = area / f64::from(COLUMN_M * COLUMN_M);
        let [count, tops, c1, s1, c2, s2] = sums[ring].map(|sum| sum / room);
        let scale = 1.0 / (count + SHARE_FLOOR).sqrt();
        [count.sqrt(), tops * scale, c1.hypot(s1) * scale, c2.hypot(s2) * scale].map(|v| v as f32)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Posts of `edge` x `edge` points 0.1 m apart, 2 m high, each a cluster.
    fn posts(edge: usize, places: &[[f32; 2]]) -> (Vec<[f32; 3]>, Vec<Vec<u32>>) {
        let mut points = Vec::new();
        let clusters = places
            .iter()
            .map(|[x, y]| {
                let first = points.len() as u32;
                for i in 0..edge * edge * 10 {
                    let (a, b, c) = (i % edge, i / edge % edge, i / (edge * edge));
                    points.push([x + a as f32 * 0.1, y + b as f32 * 0.1, 0.2 + c as f32 * 0.2]);
                }
                (first..points.len() as u32).collect()
            })
            .collect();
        (points, clusters)
    }

    #[test]
    fn rings_count_what_stands_around_and_not_the_segment() {
        let (points, clusters) = posts(3, &[[0.02, 0.02], [4.02, 0.02]]);
        let all = segments_of(&points, &[], &clusters);
        // 4 m apart: the third ring. One column of the 314 of its area.
        let room = (25.0 - 9.0) * std::f32::consts::PI / 0.16;
        let count = 1.0 / room;
        let scale = 1.0 / (count + 0.01f32).sqrt();
        for segment in &all {
            for (n, ring) in segment.context.rings.iter().enumerate() {
                let want = [count.sqrt(), 1.8 * count * scale, count * scale, count * scale];
                let want = if n == 2 { want } else { [0.0; 4] };
                for (found, want) in ring.iter().zip(want) {
                    assert!((found - want).abs() < 1e-5, "{n} {ring:?} {want}");
                }
            }
        }
        assert_eq!(segments_of(&points[..90], &[], &clusters[..1])[0].context, Context::default());
    }

    #[test]
    fn the_heading_of_the_cloud_does_not_matter() {
        let places: Vec<[f32; 2]> =
            (0..40).map(|i| [(i % 7) as f32 * 5.3 - 18.0, (i / 7) as f32 * 6.1 - 18.0]).collect();
        let (points, clusters) = posts(16, &places);
        let (sin, cos) = 0.7f32.sin_cos();
        let turned: Vec<_> =
            points.iter().map(|[x, y, z]| [cos * x - sin * y, sin * x + cos * y, *z]).collect();
        let (a, b) = (segments_of(&points, &[], &clusters), segments_of(&turned, &[], &clusters));
        // Columns count differently by a few at the rims of things and of rings; where things stand all around, moments cancel, and
        // what is left of them is small.
        let difference = |n: usize| {
            let pairs = a.iter().zip(&b).flat_map(|(a, b)| {
                a.context.rings.iter().flatten().zip(b.context.rings.iter().flatten()).skip(n).step_by(4)
            });
            let (sum, size) = pairs.fold((0.0, 0.0), |(s, t), (a, b)| (s + (a - b).abs(), t + a.abs()));
            sum / size
        };
        for n in 0..RING_NUMBERS {
            assert!(difference(n) < [0.1, 0.1, 0.25, 0.25][n], "{n}: {}", difference(n));
        }
    }

    #[test]
    fn heights_are_above_the_ground_near_by() {
        let ground: Vec<[f32; 3]> = (0..1600)
            .map(|i| [(i % 40) as f32 * 0.2, (i / 40) as f32 * 0.2, 0.1 * (i % 40) as f32 * 0.2])
            .collect();
        let points = [[4.0, 4.0, 2.4], [4.0, 4.0, 2.9], [40.0, 4.0, 2.4]];
        let found = segments_of(&points, &ground, &[vec![0, 1], vec![2]]);
        assert!(found[0].context.above_ground.is_some_and(|h| (h - 2.0).abs() < 0.05));
        assert_eq!(found[1].context.above_ground, None);
    }
}

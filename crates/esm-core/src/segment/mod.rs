//! Cutting a cloud into segments: voxels, ground, Euclidean clusters.

mod cluster;
mod config;
mod context;
mod disjoint_sets;
mod ground;
mod radix;
mod voxel;

pub use cluster::euclidean_clusters;
pub use config::{GroundConfig, SegmentConfig, SparseConfig};
pub use context::{Context, RING_NUMBERS, RINGS, segments_of};
pub use ground::ground_flags;
pub use voxel::voxel_filter;

use rustc_hash::FxHashSet;

use crate::cloud::PointCloud;

/// What [`segment`] made of a cloud.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Segmentation {
    /// The segments, ordered by their first point in the order of voxels (z, then y, then x).
    pub segments: Vec<Segment>,
    /// The ground points of the voxelled cloud, metres.
    pub ground: Vec<[f32; 3]>,
    /// All that stands on the ground, in a segment or not, metres.
    pub structure: Vec<[f32; 3]>,
    /// Points of the voxelled cloud, ground and small clusters included.
    pub voxelled: usize,
}

/// Cuts a cloud into segments: thins it by voxels, removes the ground, and clusters the rest.
///
/// The cloud's frame has z up, to within some ten degrees. The result does not depend on the order of the points.
/// `config` must have passed [`SegmentConfig::check`].
///
/// ```
/// use esm_core::{PointCloud, segment::{SegmentConfig, segment}};
/// // A floor of 20 x 20 m and a column of 2 m.
/// let floor = (0..10_000).map(|i| [(i % 100) as f32 * 0.2, (i / 100) as f32 * 0.2, 0.0]);
/// let column = (0..360).map(|i| [10.0 + (i % 6) as f32 * 0.2, 10.0 + (i / 6 % 6) as f32 * 0.2, (i / 36) as f32 * 0.2]);
/// let cloud = PointCloud::try_new(floor.chain(column).collect())?;
/// let result = segment(&cloud, &SegmentConfig::default());
/// assert_eq!(result.segments.len(), 1);
/// assert!(result.segments[0].min[2] < 0.5 && result.segments[0].max[2] > 1.7);
/// # Ok::<(), esm_core::Error>(())
/// ```
pub fn segment(cloud: &PointCloud, config: &SegmentConfig) -> Segmentation {
    let points = voxel_filter(cloud.points(), config.voxel);
    let flags = ground_flags(&points, &config.ground);
    let (mut ground, mut objects) = (Vec::new(), Vec::new());
    for (p, is_ground) in points.iter().zip(flags) {
        if is_ground { &mut ground } else { &mut objects }.push(*p);
    }
    let sparse = &config.sparse;
    let (tolerance, min_points) = if density(&objects) < sparse.below {
        (sparse.tolerance, sparse.min_points)
    } else {
        (config.tolerance, config.min_points)
    };
    let clusters = euclidean_clusters(&objects, tolerance, min_points, config.max_points);
    let segments = segments_of(&objects, &ground, &clusters);
    Segmentation { segments, ground, structure: objects, voxelled: points.len() }
}

/// Points in each cubic metre that holds any, on average; 0 without points.
fn density(points: &[[f32; 3]]) -> f32 {
    let cells: FxHashSet<[i32; 3]> = points.iter().map(|p| p.map(|v| v.floor() as i32)).collect();
    points.len() as f32 / cells.len().max(1) as f32
}

/// One segment: a connected group of points above the ground, in the frame of the cloud it was cut from.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Points, metres.
    pub points: Vec<[f32; 3]>,
    /// Mean of the points, metres.
    pub centroid: [f32; 3],
    /// Lower corner of the axis-aligned box, metres.
    pub min: [f32; 3],
    /// Upper corner of the axis-aligned box, metres.
    pub max: [f32; 3],
    /// What stands around it.
    pub context: Context,
}

impl Segment {
    /// Builds a segment from its points, alone in the world; `None` where there are none.
    pub fn from_points(points: Vec<[f32; 3]>) -> Option<Self> {
        let first = *points.first()?;
        let (mut min, mut max, mut sum) = (first, first, [0f64; 3]);
        for p in &points {
            for a in 0..3 {
                min[a] = min[a].min(p[a]);
                max[a] = max[a].max(p[a]);
                sum[a] += p[a] as f64;
            }
        }
        let centroid = sum.map(|s| (s / points.len() as f64) as f32);
        Some(Self { points, centroid, min, max, context: Context::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor with three columns 2 m apart, 0.9 m wide, and one too small to keep.
    fn hall() -> Vec<[f32; 3]> {
        let mut points = Vec::new();
        for i in 0..10_000 {
            points.push([(i % 100) as f32 * 0.15, (i / 100) as f32 * 0.15, (i % 7) as f32 * 0.004]);
        }
        for (x, size) in [(3.0, 9), (5.9, 9), (8.8, 9), (12.0, 2)] {
            for i in 0..size * size {
                for k in 0..20 {
                    points.push([x + (i % size) as f32 * 0.1, 7.0 + (i / size) as f32 * 0.1, k as f32 * 0.1]);
                }
            }
        }
        points
    }

    #[test]
    fn columns_become_segments_and_the_floor_does_not() {
        let cloud = PointCloud::try_new(hall()).unwrap();
        let result = segment(&cloud, &SegmentConfig::default());
        assert_eq!(result.segments.len(), 3);
        for (segment, x) in result.segments.iter().zip([3.4, 6.3, 9.2]) {
            assert!((segment.centroid[0] - x).abs() < 0.2, "{:?}", segment.centroid);
            assert!(segment.min[2] < 0.3 && segment.max[2] > 1.8, "{:?} {:?}", segment.min, segment.max);
        }
        assert!(result.ground.iter().all(|p| p[2] < 0.3) && result.ground.len() > 4_000);
        let kept: usize = result.segments.iter().map(|s| s.points.len()).sum();
        assert!(kept + result.ground.len() < result.voxelled, "the small column is in neither");
    }

    #[test]
    fn the_order_of_the_points_does_not_matter() {
        let points = hall();
        // 7,919 is prime and no divisor of the length: every point comes once.
        let n = points.len();
        let shuffled = (0..n).map(|i| points[i * 7919 % n]).collect();
        let config = SegmentConfig::default();
        let expected = segment(&PointCloud::try_new(points).unwrap(), &config);
        assert_eq!(segment(&PointCloud::try_new(shuffled).unwrap(), &config), expected);
    }

    #[test]
    fn an_empty_cloud_has_no_segments() {
        assert_eq!(segment(&PointCloud::default(), &SegmentConfig::default()), Segmentation::default());
    }
}

//! Cutting a cloud into segments: voxels, ground, Euclidean clusters.

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
}

impl Segment {
    /// Builds a segment from its points; `None` where there are none.
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
        Some(Self { points, centroid, min, max })
    }
}

mod radix;
mod voxel;
pub use voxel::voxel_filter;

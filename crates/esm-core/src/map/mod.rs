//! The prior map: segments with their descriptors, the ground, and the path it was recorded along.

/// Points of one segment or ground tile inside the points section: quantised to 16 bits an axis.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct PointRun {
    /// First point, counted in points from the start of the section.
    pub start: u64,
    /// Number of points.
    pub len: u32,
    /// Metres a step: point = `min + quantum * q` with `q` in 0..=65535 an axis.
    pub quantum: f32,
    /// Lower corner, metres, relative to the map's origin.
    pub min: [f32; 3],
    /// Zero.
    pub reserved: u32,
}

/// One map segment's geometry.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct SegmentRecord {
    /// Mean of its points, metres, relative to the map's origin.
    pub centroid: [f32; 3],
    /// Size of its axis-aligned box, metres.
    pub extent: [f32; 3],
}

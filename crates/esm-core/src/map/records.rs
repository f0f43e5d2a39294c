//! The fixed-size rows of a map: they lie in memory exactly as in the file, little-endian and without padding.

/// Side of the cells of [`MapData::coverage`](super::MapData::coverage), metres.
pub const COVERAGE_CELL_M: f64 = 5.0;

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
    /// How many observations (windows of the recording) were merged into it; 1 where nothing was merged.
    pub observations: u32,
}

/// The `META` section: the map's numbers that exist once.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub(super) struct MetaRecord {
    pub(super) origin: [f64; 3],
    pub(super) bounds_min: [f64; 3],
    pub(super) bounds_max: [f64; 3],
    pub(super) descriptor_version: u32,
    pub(super) descriptor_dim: u32,
}

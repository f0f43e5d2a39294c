//! Segments for pictures: little-endian u32 number of points, then x y z as f32, one segment after the other.

use std::path::Path;

pub(crate) fn segments(path: &Path, all: &[Vec<[f32; 3]>]) -> Result<(), esm_io::Error> {
    let mut out = Vec::new();
    for points in all {
        out.extend((points.len() as u32).to_le_bytes());
        out.extend(points.iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    esm_io::write_file(path, &out)
}

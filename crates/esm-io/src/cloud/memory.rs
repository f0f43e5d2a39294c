//! Scans that come as bytes, over a network, instead of as files.

use super::sink::PointSink;
use super::{Scan, bin, pcd};
use crate::error::Error;
use crate::input::Input;

/// What the bytes of a scan are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanFormat {
    /// A PCD file.
    Pcd,
    /// x, y, z, reflectance as little-endian f32, as in KITTI's `.bin`.
    Bin,
}

/// Reads a scan from the bytes of a file. `name` stands for the file in messages; compressed content that unpacks to more
/// than `unpack_limit` bytes is refused before any of it is.
///
/// ```
/// use esm_io::{ScanFormat, scan_from_bytes};
///
/// let bytes: Vec<u8> = [1.0f32, 2.0, 3.0, 0.5].iter().flat_map(|v| v.to_le_bytes()).collect();
/// let scan = scan_from_bytes(&bytes, ScanFormat::Bin, "body", 1 << 20)?;
/// assert_eq!(scan.cloud.points(), [[1.0, 2.0, 3.0]]);
/// # Ok::<(), esm_io::Error>(())
/// ```
///
/// # Errors
/// As [`read_scan`](crate::read_scan).
pub fn scan_from_bytes(
    bytes: &[u8],
    format: ScanFormat,
    name: &str,
    unpack_limit: u64,
) -> Result<Scan, Error> {
    let mut sink = PointSink::sensor_frame();
    let input = Input::of_bytes(bytes, name, unpack_limit);
    match format {
        ScanFormat::Pcd => pcd::read(input, &mut sink)?,
        ScanFormat::Bin => bin::read(input, &mut sink)?,
    }
    Ok(finish(sink))
}

/// Makes a scan of points in metres in the sensor frame, leaving out the same ones as the readers do.
pub fn scan_from_points(points: impl IntoIterator<Item = [f64; 3]>) -> Scan {
    let mut sink = PointSink::sensor_frame();
    points.into_iter().for_each(|p| {
        sink.push(p);
    });
    finish(sink)
}

fn finish(sink: PointSink) -> Scan {
    let (_, cloud, dropped) = sink.finish();
    Scan { cloud, dropped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_scan;

    const PCD: &str =
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n1 2 3\nnan 0 0\n";

    #[test]
    fn bytes_and_files_are_read_alike() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.pcd");
        std::fs::write(&path, PCD).unwrap();
        let scan = scan_from_bytes(PCD.as_bytes(), ScanFormat::Pcd, "body", u64::MAX).unwrap();
        assert_eq!(scan, read_scan(&path).unwrap());
        assert_eq!((scan.cloud.points(), scan.dropped), (&[[1.0, 2.0, 3.0]][..], 1));
        assert_eq!(scan_from_points([[1.0, 2.0, 3.0], [f64::NAN, 0.0, 0.0]]), scan);
    }

    #[test]
    fn what_is_wrong_is_told_with_the_name_given() {
        let error =
            |bytes: &[u8], format| scan_from_bytes(bytes, format, "body", 1000).unwrap_err().to_string();
        assert!(error(&PCD.as_bytes()[..PCD.len() - 8], ScanFormat::Pcd).starts_with("body: "));
        assert!(error(&[0; 17], ScanFormat::Bin).starts_with("body: byte 16: "));
        assert!(error(&[], ScanFormat::Bin).starts_with("body: "));
    }

    #[test]
    fn compressed_bodies_may_not_unpack_without_end() {
        let head = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nPOINTS 400\nDATA binary_compressed\n";
        let mut bytes = head.as_bytes().to_vec();
        // One literal byte, then runs of 264 bytes, three bytes each.
        let block: Vec<u8> = [0u8, 0].into_iter().chain([0xe0, 0xff, 0].repeat(20)).collect();
        bytes.extend((block.len() as u32).to_le_bytes());
        bytes.extend(4800u32.to_le_bytes());
        bytes.extend(&block);
        let refused = scan_from_bytes(&bytes, ScanFormat::Pcd, "body", 4000).unwrap_err().to_string();
        assert!(refused.contains("4800 bytes are declared, more than the 4000 allowed here"), "{refused}");
        // Within the limit the block itself is looked at.
        let other = scan_from_bytes(&bytes, ScanFormat::Pcd, "body", 5000);
        assert!(!format!("{other:?}").contains("allowed here"), "{other:?}");
    }
}

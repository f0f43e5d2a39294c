//! Single clouds: `.pcd`, `.ply`, `.las`, `.laz`, KITTI `.bin`.

mod bin;
mod las;
mod laz_guard;
mod lzf;
mod memory;
mod pcd;
mod ply;
pub(crate) mod sink;

use std::path::Path;

use esm_core::PointCloud;

use crate::error::Error;
use crate::input::Input;
pub use memory::{ScanFormat, scan_from_bytes, scan_from_points};
use sink::PointSink;

/// File name extensions of clouds, lower case.
pub(crate) const CLOUD_EXTENSIONS: [&str; 5] = ["bin", "las", "laz", "pcd", "ply"];

/// A survey somebody else made: one cloud in its own frame.
///
/// A point's coordinates in the file are `origin + point`: the origin is kept in f64 so that projected metres (UTM:
/// millions) lose nothing in f32. Axes whose first coordinate is within 10 km keep the origin 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PriorCloud {
    /// What to add to every point, metres, a multiple of 1000 on each axis.
    pub origin: [f64; 3],
    /// The points relative to the origin, metres.
    pub cloud: PointCloud,
    /// Points left out: NaN, infinite, or exactly (0, 0, 0).
    pub dropped: usize,
}

/// One scan as it lies in a file, in its sensor's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scan {
    /// The points, metres, sensor frame.
    pub cloud: PointCloud,
    /// Points left out: NaN, infinite, or exactly (0, 0, 0).
    pub dropped: usize,
}

/// Reads one prior cloud: `.las`, `.laz`, `.pcd`, `.ply` or `.bin`, told apart by extension.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("survey.ply");
/// # std::fs::write(&path, "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\n\
/// #     property double z\nend_header\n448262.25 5428123.5 112.0\n")?;
/// let prior = esm_io::read_prior_cloud(&path)?;
/// assert_eq!(prior.origin, [448_000.0, 5_428_000.0, 0.0]);
/// assert_eq!(prior.cloud.points(), [[262.25, 123.5, 112.0]]);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
/// [`Error::Malformed`] where the file is damaged or holds fewer points than it declares, [`Error::Unsupported`] where it
/// is no cloud, [`Error::Empty`] where no usable point is left, [`Error::Io`].
pub fn read_prior_cloud(path: impl AsRef<Path>) -> Result<PriorCloud, Error> {
    let path = path.as_ref();
    let mut sink = PointSink::with_origin();
    read_into(path, &mut sink)?;
    let (origin, cloud, dropped) = sink.finish();
    if cloud.is_empty() {
        let what = format!("the cloud holds no usable point ({dropped} invalid ones)");
        return Err(Error::empty(path, what, "check the file in a viewer, or export it again"));
    }
    Ok(PriorCloud { origin, cloud, dropped })
}

/// Reads one scan in its sensor's frame, any format of [`read_prior_cloud`]. A scan may hold no point at all.
///
/// # Errors
/// As [`read_prior_cloud`]; a file of 0 bytes is [`Error::Empty`] or [`Error::Malformed`].
pub fn read_scan(path: impl AsRef<Path>) -> Result<Scan, Error> {
    let mut sink = PointSink::sensor_frame();
    read_into(path.as_ref(), &mut sink)?;
    let (_, cloud, dropped) = sink.finish();
    Ok(Scan { cloud, dropped })
}

/// The lower-case extension of a path.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

fn read_into(path: &Path, sink: &mut PointSink) -> Result<(), Error> {
    let input = Input::open(path)?;
    match extension(path).as_str() {
        "pcd" => pcd::read(input, sink),
        "ply" => ply::read(input, sink),
        "las" | "laz" => las::read(input, sink),
        "bin" => bin::read(input, sink),
        other => {
            let what = match other {
                "" => "a file without extension is no known cloud".to_owned(),
                other => format!("'.{other}' is no known kind of cloud"),
            };
            Err(Error::unsupported(path, what, "clouds are .las, .laz, .pcd, .ply and KITTI's .bin"))
        }
    }
}

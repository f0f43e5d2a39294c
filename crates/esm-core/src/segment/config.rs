//! What segmentation can be told, with defaults that fit a spinning LiDAR's clouds.

use serde::{Deserialize, Serialize};

use crate::error::Error;

/// How a cloud is cut into segments.
///
/// ```
/// use esm_core::segment::SegmentConfig;
/// let config = SegmentConfig { min_points: 20, ..SegmentConfig::default() };
/// assert!(config.check().is_ok());
/// assert!(SegmentConfig { tolerance: -0.5, ..config }.check().is_err());
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SegmentConfig {
    /// Edge of the voxels that thin the cloud, metres. Default 0.2: what the paper's clouds of 0.1 m come down to
    /// after 20 m of travel without losing the shape of a car or a trunk.
    pub voxel: f32,
    /// Largest distance between two linked points, metres. Default 0.5: with voxels of 0.2 m, surfaces seen at a
    /// grazing angle stay in one piece.
    pub tolerance: f32,
    /// Fewest points of a segment. Default 40: the paper's 200 raw points on clouds voxelled at 0.2 m.
    pub min_points: usize,
    /// Most points of a segment. Default 15,000 (ESM paper, section V, 3D Velodyne).
    pub max_points: usize,
    /// What holds instead for sparse clouds, such as single sweeps.
    pub sparse: SparseConfig,
    /// The ground filter.
    pub ground: GroundConfig,
}

/// How sparse clouds are cut: their points lie too far apart for the links of dense ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SparseConfig {
    /// A cloud is sparse when what stands on the ground holds fewer points than this, on average, in each cubic metre where
    /// there are any, after thinning by `voxel`. 0: no cloud is sparse. Default 3.5: single sweeps of KITTI, thinned to 4-10
    /// thousand points, hold 2.9, of a simulated HDL-32E in a forest 2.4; accumulated clouds hold 4 and more.
    pub below: f32,
    /// Instead of `tolerance`, metres.
    pub tolerance: f32,
    /// Instead of `min_points`.
    pub min_points: usize,
}

/// How ground is told from what stands on it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroundConfig {
    /// Height above the ground surface up to which a point is ground, metres. Default 0.3: kerbs and rough grass are
    /// ground, and what is left stays clear of the noise of accumulated clouds, which would bridge objects. A point more
    /// than twice this below the surface is not ground.
    pub band: f32,
    /// The same where an object stands on the ground (in a cell of 0.5 m that holds points above the band), metres.
    /// Default 0.1: walls and trunks keep their feet. Measured on SemanticKITTI scans: F1 0.984 against 0.975 with one
    /// band of 0.3.
    pub contact_band: f32,
    /// Steepest ground that a change of height between neighbouring patches may be due to, rise over run. Default 1.0,
    /// 45 degrees: beyond, laser returns of slopes and walls look alike.
    pub max_slope: f32,
}

impl Default for SegmentConfig {
    fn default() -> Self {
        Self {
            voxel: 0.2,
            tolerance: 0.5,
            min_points: 40,
            max_points: 15_000,
            sparse: SparseConfig::default(),
            ground: GroundConfig::default(),
        }
    }
}

impl Default for SparseConfig {
    fn default() -> Self {
        Self { below: 3.5, tolerance: 0.8, min_points: 15 }
    }
}

impl Default for GroundConfig {
    fn default() -> Self {
        Self { band: 0.3, contact_band: 0.1, max_slope: 1.0 }
    }
}

impl SegmentConfig {
    /// Checks every field against its range.
    ///
    /// # Errors
    /// [`Error::Config`] with the first field that is out of its range.
    pub fn check(&self) -> Result<(), Error> {
        in_range("segment.voxel", self.voxel, 0.01, 10.0, "0.01 to 10 (metres)")?;
        in_range("segment.tolerance", self.tolerance, 0.01, 100.0, "0.01 to 100 (metres)")?;
        if self.min_points == 0 {
            return Err(refused("segment.min_points", self.min_points, "at least 1"));
        }
        if self.max_points < self.min_points {
            return Err(refused("segment.max_points", self.max_points, "at least segment.min_points"));
        }
        let sparse = &self.sparse;
        in_range("segment.sparse.below", sparse.below, 0.0, 1000.0, "0 to 1000 (points a cubic metre)")?;
        in_range("segment.sparse.tolerance", sparse.tolerance, 0.01, 100.0, "0.01 to 100 (metres)")?;
        if !(1..=self.max_points).contains(&sparse.min_points) {
            return Err(refused("segment.sparse.min_points", sparse.min_points, "1 to segment.max_points"));
        }
        in_range("segment.ground.band", self.ground.band, 0.01, 5.0, "0.01 to 5 (metres)")?;
        in_range("segment.ground.contact_band", self.ground.contact_band, 0.01, 5.0, "0.01 to 5 (metres)")?;
        in_range("segment.ground.max_slope", self.ground.max_slope, 0.05, 5.0, "0.05 to 5 (rise over run)")
    }
}

fn in_range(
    field: &'static str,
    value: f32,
    low: f32,
    high: f32,
    allowed: &'static str,
) -> Result<(), Error> {
    // Written so that NaN is refused too.
    if value >= low && value <= high { Ok(()) } else { Err(refused(field, value, allowed)) }
}

fn refused(field: &'static str, value: impl ToString, allowed: &'static str) -> Error {
    Error::Config { field, value: value.to_string(), allowed }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_allowed() {
        assert!(SegmentConfig::default().check().is_ok());
    }

    #[test]
    fn each_field_out_of_range_is_named() {
        let base = SegmentConfig::default;
        let ground = GroundConfig::default;
        let cases = [
            (SegmentConfig { voxel: 0.0, ..base() }, "segment.voxel = 0 "),
            (SegmentConfig { voxel: f32::NAN, ..base() }, "segment.voxel = NaN "),
            (SegmentConfig { tolerance: -1.0, ..base() }, "segment.tolerance = -1 "),
            (SegmentConfig { min_points: 0, ..base() }, "segment.min_points = 0 "),
            (SegmentConfig { max_points: 39, ..base() }, "segment.max_points = 39 "),
            (
                SegmentConfig { ground: GroundConfig { band: 9.0, ..ground() }, ..base() },
                "segment.ground.band = 9 ",
            ),
            (
                SegmentConfig { ground: GroundConfig { contact_band: 0.0, ..ground() }, ..base() },
                "segment.ground.contact_band = 0 ",
            ),
            (
                SegmentConfig { ground: GroundConfig { max_slope: f32::INFINITY, ..ground() }, ..base() },
                "segment.ground.max_slope = inf ",
            ),
        ];
        for (config, expected) in cases {
            let message = config.check().expect_err(expected).to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}

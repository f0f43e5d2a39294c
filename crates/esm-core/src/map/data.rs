//! [`MapData`]: what a map holds, owned; what a builder fills.

use super::quantise;
use super::records::{PointRun, SegmentRecord};
use super::standardizer::Standardizer;
use crate::error::Error;
use crate::segment::Segment;

/// Which descriptor a map's rows are of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DescriptorInfo {
    /// Name, as in `--descriptor NAME`: 1 to 64 bytes, no control characters.
    pub name: String,
    /// Version: rows of different versions must not be compared.
    pub version: u32,
    /// Numbers a row, 1 to 4096.
    pub dim: u32,
}

/// Everything a map holds, owned. [`Map::from_data`](super::Map::from_data) checks that it fits together.
#[derive(Clone, Debug, PartialEq)]
pub struct MapData {
    /// Where the f32 coordinates below are counted from, metres, in the map frame. Keeps them small, so that projected
    /// coordinates (UTM: millions of metres) lose nothing.
    pub origin: [f64; 3],
    /// Name of the map frame, at most 256 bytes.
    pub frame_id: String,
    /// What the rows of `descriptors` are.
    pub descriptor: DescriptorInfo,
    /// Statistics to bring live descriptors to the scale of the stored ones, which already are; `None` where the
    /// descriptor needs none.
    pub standardizer: Option<Standardizer>,
    /// The segments, relative to `origin`.
    pub segments: Vec<SegmentRecord>,
    /// Row-major, a row of `descriptor.dim` numbers a segment, already standardised.
    pub descriptors: Vec<f32>,
    /// The probability, 0 to 1, that a segment's descriptor is good for matching; one a segment.
    pub quality: Vec<f32>,
    /// Where each segment's points are.
    pub runs: Vec<PointRun>,
    /// Where each ground tile's points are.
    pub ground_tiles: Vec<PointRun>,
    /// Where each structure tile's points are: all that stands on the ground, whether in a segment or not.
    pub structure_tiles: Vec<PointRun>,
    /// The points of all runs, quantised.
    pub points: Vec<[u16; 3]>,
    /// The path the map was recorded along: positions in the map frame, metres. Empty for a map of a prior cloud.
    pub path: Vec<[f64; 3]>,
    /// For a map of a prior cloud, the cells `(floor(x / 5 m), floor(y / 5 m))` of the map frame that hold points, in
    /// any order; empty otherwise.
    pub coverage: Vec<[i32; 2]>,
    /// Box around all points, lower and upper corner in the map frame, metres. The `push_` functions widen it.
    pub bounds: ([f64; 3], [f64; 3]),
    /// The build configuration as TOML text, at most 1 MiB.
    pub settings: String,
    /// What it was built from: a file name without its folder, at most 4096 bytes.
    pub source: String,
}

impl MapData {
    /// An empty map around `origin`; its frame is called `map`.
    pub fn new(origin: [f64; 3], descriptor: DescriptorInfo) -> Self {
        Self {
            origin,
            frame_id: "map".into(),
            descriptor,
            standardizer: None,
            segments: Vec::new(),
            descriptors: Vec::new(),
            quality: Vec::new(),
            runs: Vec::new(),
            ground_tiles: Vec::new(),
            structure_tiles: Vec::new(),
            points: Vec::new(),
            path: Vec::new(),
            coverage: Vec::new(),
            bounds: ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]),
            settings: String::new(),
            source: String::new(),
        }
    }

    /// Adds a segment whose coordinates are relative to the origin, seen in `observations` windows: its record and its
    /// points. Its descriptor row and quality are the caller's to add: they are computed in batches.
    ///
    /// # Errors
    /// [`Error::NonFinitePoint`]; [`Error::MapData`] for a segment without points, or more than 1000 km from the
    /// origin.
    pub fn push_segment(&mut self, segment: &Segment, observations: u32) -> Result<(), Error> {
        let run = self.push_run(&segment.points)?;
        let extent = [0, 1, 2].map(|a| segment.max[a] - segment.min[a]);
        self.segments.push(SegmentRecord { centroid: segment.centroid, extent, observations });
        self.runs.push(run);
        Ok(())
    }

    /// Adds the ground points of one tile, relative to the origin.
    ///
    /// # Errors
    /// As [`push_segment`](Self::push_segment).
    pub fn push_ground_tile(&mut self, points: &[[f32; 3]]) -> Result<(), Error> {
        let run = self.push_run(points)?;
        self.ground_tiles.push(run);
        Ok(())
    }

    /// Adds the points above the ground of one tile, relative to the origin.
    ///
    /// # Errors
    /// As [`push_segment`](Self::push_segment).
    pub fn push_structure_tile(&mut self, points: &[[f32; 3]]) -> Result<(), Error> {
        let run = self.push_run(points)?;
        self.structure_tiles.push(run);
        Ok(())
    }

    fn push_run(&mut self, points: &[[f32; 3]]) -> Result<PointRun, Error> {
        let run = quantise::encode(points, &mut self.points)?;
        for p in points {
            for (a, &v) in p.iter().enumerate() {
                let v = self.origin[a] + v as f64;
                self.bounds.0[a] = self.bounds.0[a].min(v);
                self.bounds.1[a] = self.bounds.1[a].max(v);
            }
        }
        Ok(run)
    }
}

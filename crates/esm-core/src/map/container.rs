//! [`Map`]: a map ready to use, in memory or in a mapped file.

use std::path::{Path, PathBuf};

use super::blocks::PointBlocks;
use super::column::Column;
use super::data::{DescriptorInfo, MapData};
use super::layout::SectionInfo;
use super::problem::Problem;
use super::records::{MetaRecord, PointRun, SegmentRecord};
use super::standardizer::Standardizer;
use super::{check, read, write};
use crate::describe::{self, Descriptor, NAMES, PEERS};
use crate::error::Error;

/// Positions of the mapped path farther apart are not one drive, metres.
const PATH_GAP_M: f64 = 20.0;

/// A prior map: checked, immutable, and the same to use whether it was just gathered or lies in a file.
///
/// An opened map keeps its file mapped. Files must be replaced (written beside and renamed, as [`Map::write`] does),
/// never edited in place, while a process has them open.
///
/// ```
/// use esm_core::map::{DescriptorInfo, Map, MapData};
/// use esm_core::segment::Segment;
///
/// let descriptor = DescriptorInfo { name: "demo".into(), version: 1, dim: 2 };
/// let mut data = MapData::new([500_000.0, 5_700_000.0, 80.0], descriptor);
/// let tree = Segment::from_points(vec![[1.0, 2.0, 0.0], [1.0, 2.0, 4.0]]).ok_or("no points")?;
/// data.push_segment(&tree, 1)?;
/// data.descriptors.extend([0.5, -0.5]);
/// data.quality.push(1.0);
/// let map = Map::from_data(data)?;
///
/// let folder = tempfile::tempdir()?;
/// let file = folder.path().join("demo.esm");
/// map.write(&file)?;
/// let opened = Map::open(&file)?;
/// assert_eq!(opened.descriptor(0), [0.5, -0.5]);
/// assert_eq!(opened.segment_points(0)?[0], [1.0, 2.0, 0.0]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Map {
    pub(super) meta: MetaRecord,
    pub(super) frame_id: String,
    pub(super) descriptor: DescriptorInfo,
    pub(super) standardizer: Option<Standardizer>,
    pub(super) settings: String,
    pub(super) source: String,
    pub(super) segments: Column<SegmentRecord>,
    pub(super) descriptors: Column<f32>,
    pub(super) quality: Column<f32>,
    pub(super) runs: Column<PointRun>,
    pub(super) ground: Column<PointRun>,
    pub(super) structure: Column<PointRun>,
    pub(super) path: Column<[f64; 3]>,
    pub(super) coverage: Column<[i32; 2]>,
    pub(super) points: Column<[u16; 3]>,
    pub(super) origin_of: Origin,
}

/// Where a map's rows live.
pub(super) enum Origin {
    Memory,
    File { path: PathBuf, len: u64, sections: Vec<SectionInfo>, blocks: PointBlocks },
}

impl Map {
    /// Checks gathered data and makes it a map.
    ///
    /// # Errors
    /// [`Error::EmptyMap`] without segments; [`Error::MapData`] where counts do not fit together, a number is not
    /// finite or out of its range, a run of points lies outside the points, or a text is too long.
    pub fn from_data(mut data: MapData) -> Result<Self, Error> {
        if data.segments.is_empty() {
            return Err(Error::EmptyMap {
                hint: "look at the recording's length and at the segmentation's sizes",
            });
        }
        data.coverage.sort_unstable();
        data.coverage.dedup();
        let meta = MetaRecord {
            origin: data.origin,
            bounds_min: data.bounds.0,
            bounds_max: data.bounds.1,
            descriptor_version: data.descriptor.version,
            descriptor_dim: data.descriptor.dim,
        };
        let map = Self {
            meta,
            frame_id: data.frame_id,
            descriptor: data.descriptor,
            standardizer: data.standardizer,
            settings: data.settings,
            source: data.source,
            segments: data.segments.into(),
            descriptors: data.descriptors.into(),
            quality: data.quality.into(),
            runs: data.runs.into(),
            ground: data.ground_tiles.into(),
            structure: data.structure_tiles.into(),
            path: data.path.into(),
            coverage: data.coverage.into(),
            points: data.points.into(),
            origin_of: Origin::Memory,
        };
        check::check(&map).map_err(Problem::in_data)?;
        Ok(map)
    }

    /// Opens a map file: maps it into memory and verifies header, table and every section but the points, whose blocks
    /// are verified before their first use (or all at once by [`verify_points`](Self::verify_points)).
    ///
    /// # Errors
    /// [`Error::MapFile`] for a file that is missing, not a map, damaged, cut short, written by a newer format, or
    /// whose contents make no sense; [`Error::Io`] where the system refuses.
    pub fn open(path: &Path) -> Result<Self, Error> {
        read::open(path)
    }

    /// Copies a map file into memory and verifies every byte of it, the points included. Takes as much memory as the file
    /// is long; in return nothing that happens to the file later, not even being overwritten in place, can harm whoever
    /// uses the map. For programs that run for days.
    ///
    /// # Errors
    /// As [`open`](Self::open) and [`verify_points`](Self::verify_points).
    pub fn load(path: &Path) -> Result<Self, Error> {
        read::load(path)
    }

    /// Writes the map file: to a temporary file in the same folder, synced, then renamed, then the folder is synced. A
    /// failure leaves what was at `path` untouched. The same map gives the same bytes.
    ///
    /// # Errors
    /// [`Error::Io`] where the system refuses (no such folder, no permission, full disk); [`Error::MapFile`] where
    /// `path` is a directory or device, or where this map was opened from a file whose points are damaged.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        write::write(self, path)
    }

    /// Number of segments, at least 1.
    #[allow(clippy::len_without_is_empty)] // A map is never empty.
    pub fn len(&self) -> usize {
        self.segments.len()
    }

    /// Where the f32 coordinates are counted from, metres, in the map frame.
    pub fn origin(&self) -> [f64; 3] {
        self.meta.origin
    }

    /// Name of the map frame.
    pub fn frame_id(&self) -> &str {
        &self.frame_id
    }

    /// What the descriptor rows are.
    pub fn descriptor_info(&self) -> &DescriptorInfo {
        &self.descriptor
    }

    /// Whether live rows of `descriptor` may be compared with this map's.
    ///
    /// # Errors
    /// [`Error::DescriptorMismatch`] where name, version or dimension differ.
    pub fn check_descriptor(&self, descriptor: &dyn Descriptor) -> Result<(), Error> {
        let d = &self.descriptor;
        if d.name == descriptor.name()
            && d.version == descriptor.version()
            && d.dim as usize == descriptor.dim()
        {
            return Ok(());
        }
        let text =
            |name: &str, version: u32, dim: usize| format!("{name} (version {version}, {dim} numbers)");
        // Another name helps only where this very descriptor can still be made.
        let makes = |o: &dyn Descriptor| o.version() == d.version && o.dim() == d.dim as usize;
        let known = NAMES.contains(&d.name.as_str());
        let hint = match describe::by_name(&d.name) {
            Ok(own) if known && d.name != descriptor.name() && makes(&*own) => {
                format!("use --descriptor {}, or rebuild the map", d.name)
            }
            _ if d.name.starts_with("esm") || PEERS.contains(&d.name.as_str()) => {
                "name the weights file it was built with (--descriptor FILE.safetensors), or rebuild the map"
                    .to_owned()
            }
            _ => "rebuild the map".to_owned(),
        };
        Err(Error::DescriptorMismatch {
            map: text(&d.name, d.version, d.dim as usize),
            asked: text(descriptor.name(), descriptor.version(), descriptor.dim()),
            hint,
        })
    }

    /// Statistics that bring live descriptors to the scale of the stored ones; `None` where none are needed.
    pub fn standardizer(&self) -> Option<&Standardizer> {
        self.standardizer.as_ref()
    }

    /// The segments' geometry, relative to the origin.
    pub fn segments(&self) -> &[SegmentRecord] {
        &self.segments
    }

    /// The descriptors, row-major, one row a segment, already standardised.
    pub fn descriptors(&self) -> &[f32] {
        &self.descriptors
    }

    /// One segment's descriptor; empty where there is no such segment.
    pub fn descriptor(&self, segment: usize) -> &[f32] {
        let dim = self.descriptor.dim as usize;
        self.descriptors().chunks_exact(dim.max(1)).nth(segment).unwrap_or(&[])
    }

    /// The probability, 0 to 1, that a segment's descriptor is good for matching; one a segment.
    pub fn quality(&self) -> &[f32] {
        &self.quality
    }

    /// Where each segment's points are: their number and lower corner without reading them.
    pub fn runs(&self) -> &[PointRun] {
        &self.runs
    }

    /// Where each ground tile's points are.
    pub fn ground_tiles(&self) -> &[PointRun] {
        &self.ground
    }

    /// Where each structure tile's points are.
    pub fn structure_tiles(&self) -> &[PointRun] {
        &self.structure
    }

    /// Number of points, of segments and tiles.
    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// The path the map was recorded along, positions in the map frame, metres; empty for a map of a prior cloud.
    pub fn path(&self) -> &[[f64; 3]] {
        &self.path
    }

    /// Metres of the mapped path; positions more than 20 m apart are not one drive and add nothing.
    pub fn path_length_m(&self) -> f64 {
        let step = |p: &[[f64; 3]]| (0..3).map(|a| (p[1][a] - p[0][a]).powi(2)).sum::<f64>().sqrt();
        self.path().windows(2).map(step).filter(|d| *d <= PATH_GAP_M).sum()
    }

    /// For a map of a prior cloud the 5 m cells of the map frame that hold points, ascending; empty otherwise.
    pub fn coverage(&self) -> &[[i32; 2]] {
        &self.coverage
    }

    /// Box around all points, lower and upper corner in the map frame, metres.
    pub fn bounds(&self) -> ([f64; 3], [f64; 3]) {
        (self.meta.bounds_min, self.meta.bounds_max)
    }

    /// The build configuration, TOML.
    pub fn settings(&self) -> &str {
        &self.settings
    }

    /// What it was built from.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The file's sections, those of the opened file or those that [`write`](Self::write) would write.
    pub fn sections(&self) -> Vec<SectionInfo> {
        match &self.origin_of {
            Origin::Memory => write::plan(self).0,
            Origin::File { sections, .. } => sections.clone(),
        }
    }

    /// Bytes of the opened file, or of the one that [`write`](Self::write) would write.
    pub fn file_size(&self) -> u64 {
        match &self.origin_of {
            Origin::Memory => write::plan(self).1,
            Origin::File { len, .. } => *len,
        }
    }
}

impl std::fmt::Debug for Map {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let place = match &self.origin_of {
            Origin::Memory => Path::new("(memory)"),
            Origin::File { path, .. } => path,
        };
        f.debug_struct("Map")
            .field("place", &place)
            .field("segments", &self.len())
            .field("descriptor", &self.descriptor)
            .field("points", &self.point_count())
            .finish_non_exhaustive()
    }
}

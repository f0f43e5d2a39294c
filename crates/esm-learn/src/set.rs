//! [`SegmentSetWriter`]: the directory of arrays that training maps into memory (`python/train/DATA.md`).

use std::path::{Path, PathBuf};

use esm_core::segment::{Context, RING_NUMBERS, RINGS};
use serde::Serialize;
use tempfile::TempDir;

use crate::error::Error;
use crate::npy::{NpyWriter, io};

/// What holds for a whole set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetInfo {
    /// Names of the places; rows tell theirs by its index.
    pub places: Vec<String>,
    /// Names of the classes; rows tell theirs by its index, or 255.
    pub classes: Vec<String>,
    /// Edge of the voxels the segments were thinned with, metres.
    pub voxel_m: f32,
    /// How the set was made, for people.
    pub source: String,
}

/// One segment as one live cloud sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Metres about `centroid_map`, axes of the map frame, z up.
    pub points: Vec<[f32; 3]>,
    /// Mean of the points, metres, map frame.
    pub centroid_map: [f64; 3],
    /// The object's number, unique in its place; -1 where it is not known.
    pub object: i64,
    /// Number of the live cloud within the set.
    pub observation: u32,
    /// The drive through the place.
    pub visit: u16,
    /// Index into the places.
    pub place: u16,
    /// Index into the classes, or 255.
    pub class: u8,
    /// What stands around it in its cloud.
    pub context: Context,
}

/// Writes a set row by row: memory does not grow with it. Nothing stands at the target before all of it does.
///
/// ```
/// use esm_learn::{Row, SegmentSetWriter, SetInfo};
/// # let dir = tempfile::tempdir()?;
/// # let target = dir.path().join("set");
/// let info = SetInfo { places: vec!["street".into()], classes: vec![], voxel_m: 0.2, source: "by hand".into() };
/// let mut set = SegmentSetWriter::create(&target, info)?;
/// set.push(&Row {
///     points: vec![[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
///     centroid_map: [10.0, 20.0, 1.0],
///     object: 7,
///     observation: 0,
///     visit: 0,
///     place: 0,
///     class: 255,
///     context: esm_core::segment::Context { above_ground: Some(0.1), ..Default::default() },
/// })?;
/// set.finish()?;
/// assert_eq!(std::fs::metadata(target.join("points.npy"))?.len(), 128 + 2 * 12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SegmentSetWriter {
    target: PathBuf,
    temporary: TempDir,
    info: SetInfo,
    points: NpyWriter,
    offsets: NpyWriter,
    centroid_map: NpyWriter,
    object: NpyWriter,
    observation: NpyWriter,
    visit: NpyWriter,
    place: NpyWriter,
    class: NpyWriter,
    above_ground: NpyWriter,
    rings: NpyWriter,
    total: u64,
}

impl SegmentSetWriter {
    /// Starts a set that will stand at `target`, which must not exist yet or be an empty directory.
    ///
    /// # Errors
    /// [`Error::Exists`], [`Error::Io`].
    pub fn create(target: impl AsRef<Path>, info: SetInfo) -> Result<Self, Error> {
        let target = target.as_ref().to_owned();
        if target.exists() && std::fs::read_dir(&target).map_or(true, |mut d| d.next().is_some()) {
            return Err(Error::Exists { path: target });
        }
        let parent = match target.parent() {
            Some(p) if !p.as_os_str().is_empty() => p,
            _ => Path::new("."),
        };
        std::fs::create_dir_all(parent).map_err(io(parent, "creating the directory"))?;
        let temporary = tempfile::Builder::new()
            .prefix(".segments-")
            .tempdir_in(parent)
            .map_err(io(parent, "creating a temporary directory"))?;
        let array = |name: &str, descr, columns| {
            NpyWriter::create(temporary.path().join(format!("{name}.npy")), descr, columns)
        };
        let mut set = Self {
            points: array("points", "<f4", Some(3))?,
            offsets: array("offsets", "<u8", None)?,
            centroid_map: array("centroid_map", "<f8", Some(3))?,
            object: array("object", "<i8", None)?,
            observation: array("observation", "<u4", None)?,
            visit: array("visit", "<u2", None)?,
            place: array("place", "<u2", None)?,
            class: array("class", "|u1", None)?,
            above_ground: array("above_ground", "<f4", None)?,
            rings: array("rings", "<f4", Some(RINGS * RING_NUMBERS))?,
            target,
            temporary,
            info,
            total: 0,
        };
        set.offsets.push(&0u64.to_le_bytes(), 1)?;
        Ok(set)
    }

    /// Appends a segment.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, row: &Row) -> Result<(), Error> {
        let bytes: Vec<u8> = row.points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.points.push(&bytes, row.points.len() as u64)?;
        self.total += row.points.len() as u64;
        self.offsets.push(&self.total.to_le_bytes(), 1)?;
        let centroid: Vec<u8> = row.centroid_map.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.centroid_map.push(&centroid, 1)?;
        self.object.push(&row.object.to_le_bytes(), 1)?;
        self.observation.push(&row.observation.to_le_bytes(), 1)?;
        self.visit.push(&row.visit.to_le_bytes(), 1)?;
        self.place.push(&row.place.to_le_bytes(), 1)?;
        self.class.push(&[row.class], 1)?;
        self.above_ground.push(&row.context.above_ground.unwrap_or(f32::NAN).to_le_bytes(), 1)?;
        let rings: Vec<u8> = row.context.rings.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        self.rings.push(&rings, 1)
    }

    /// Sees everything on the disk and gives the set its name. Returns the number of segments.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn finish(self) -> Result<u64, Error> {
        let segments = self.object.finish()?;
        let points = self.points.finish()?;
        for array in [
            self.offsets,
            self.centroid_map,
            self.observation,
            self.visit,
            self.place,
            self.class,
            self.above_ground,
            self.rings,
        ] {
            array.finish()?;
        }
        #[derive(Serialize)]
        struct Meta<'a> {
            format: &'static str,
            format_version: u32,
            segments: u64,
            points: u64,
            #[serde(flatten)]
            info: &'a SetInfo,
        }
        let meta = Meta { format: "esm-segments", format_version: 2, segments, points, info: &self.info };
        // Texts and numbers: nothing JSON could refuse.
        let text = serde_json::to_string_pretty(&meta).unwrap_or_default();
        let path = self.temporary.path().join("meta.json");
        std::fs::write(&path, text).map_err(io(&path, "writing"))?;
        std::fs::File::open(&path).and_then(|f| f.sync_all()).map_err(io(&path, "writing"))?;
        let made = self.temporary.keep();
        // An empty directory may stand there.
        let _ = std::fs::remove_dir(&self.target);
        std::fs::rename(&made, &self.target).map_err(io(&self.target, "giving the set its name"))?;
        Ok(segments)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(n: u8) -> Row {
        Row {
            points: (0..=n).map(|i| [f32::from(i), 0.5, -1.0]).collect(),
            centroid_map: [f64::from(n), 2.0, 3.0],
            object: i64::from(n) - 1,
            observation: 3,
            visit: 1,
            place: 0,
            class: 255,
            context: Context::default(),
        }
    }

    fn info() -> SetInfo {
        SetInfo {
            places: vec!["a".into()],
            classes: vec!["tree".into()],
            voxel_m: 0.2,
            source: "test".into(),
        }
    }

    #[test]
    fn arrays_hold_what_was_pushed() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("set");
        let mut set = SegmentSetWriter::create(&target, info()).unwrap();
        for n in 0..5 {
            set.push(&row(n)).unwrap();
        }
        assert!(!target.exists(), "nothing stands there before all of it does");
        assert_eq!(set.finish().unwrap(), 5);
        let offsets = std::fs::read(target.join("offsets.npy")).unwrap();
        let numbers: Vec<u64> =
            offsets[128..].as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        assert_eq!(numbers, [0, 1, 3, 6, 10, 15]);
        let points = std::fs::read(target.join("points.npy")).unwrap();
        assert!(points.starts_with(
            b"\x93NUMPY\x01\x00\x76\x00{'descr': '<f4', 'fortran_order': False, 'shape': (15, 3), }"
        ));
        assert_eq!((points[127], points.len()), (b'\n', 128 + 15 * 12));
        let meta: serde_json::Value =
            serde_json::from_slice(&std::fs::read(target.join("meta.json")).unwrap()).unwrap();
        assert_eq!(
            (&meta["segments"], &meta["points"], &meta["places"][0]),
            (&5.into(), &15.into(), &"a".into())
        );
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "no temporary is left");
    }

    #[test]
    fn sets_are_never_written_over() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("mine.txt"), "kept").unwrap();
        assert!(matches!(SegmentSetWriter::create(dir.path(), info()), Err(Error::Exists { .. })));
        let target = dir.path().join("half");
        drop(SegmentSetWriter::create(&target, info()).unwrap());
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "given up: nothing is left");
    }
}

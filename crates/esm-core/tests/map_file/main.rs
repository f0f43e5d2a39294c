//! The map file: what goes in comes out, and nothing else ever does.

#![allow(clippy::unwrap_used, clippy::print_stdout)] // Helpers of tests, outside of `#[test]` functions.

mod damage;
mod hostile;
mod numbers;
mod round_trip;
mod seal;
mod speed;
mod versions;
mod writing;

use std::path::{Path, PathBuf};

use esm_core::Error;
use esm_core::map::{DescriptorInfo, Map, MapData, Standardizer};
use esm_core::segment::Segment;
use tempfile::TempDir;

/// A map small enough to try every byte of its file: two segments, a ground tile, a path and covered cells.
fn small_data() -> MapData {
    let info = DescriptorInfo { name: "shape".into(), version: 2, dim: 3 };
    let mut data = MapData::new([500_000.25, 5_700_000.5, 80.0], info);
    let tree = Segment::from_points(vec![[1.0, 2.0, 0.0], [1.1, 2.0, 4.0], [1.0, 2.2, 2.0]]).unwrap();
    let wall = Segment::from_points(vec![[-5.0, 3.0, 0.0], [-9.0, 3.5, 2.0]]).unwrap();
    data.push_segment(&tree, 1).unwrap();
    data.push_segment(&wall, 7).unwrap();
    data.push_ground_tile(&[[0.0, 0.0, -1.7], [4.0, 0.5, -1.6]]).unwrap();
    data.push_structure_tile(&[[1.0, 0.0, 0.2]]).unwrap();
    data.descriptors = vec![0.5, -0.5, 1.0, -0.25, 0.0, 2.0];
    data.quality = vec![1.0, 0.25];
    data.standardizer = Some(Standardizer { mean: vec![1.0, 2.0, 3.0], inv_std: vec![0.5, 0.0, 4.0] });
    data.path = vec![[500_000.0, 5_700_000.0, 81.7], [500_001.0, 5_700_002.0, 81.75]];
    data.coverage = vec![[100_000, 1_140_000], [-3, 4]];
    data.settings = "[segment]\ntolerance_m = 0.5\n".into();
    data.source = "map.mcap".into();
    data
}

/// Points of several blocks: `n` segments of `points` points each, without ground.
fn large_data(n: usize, points: usize, dim: usize) -> MapData {
    let info = DescriptorInfo { name: "shape".into(), version: 1, dim: dim as u32 };
    let mut data = MapData::new([0.0; 3], info);
    for s in 0..n {
        let (x, y) = ((s % 300) as f32 * 3.0, (s / 300) as f32 * 3.0);
        let at = |i: usize| [x + (i * 7 % 13) as f32 * 0.1, y + (i * 5 % 11) as f32 * 0.1, i as f32 * 0.02];
        data.push_segment(&Segment::from_points((0..points).map(at).collect()).unwrap(), 1).unwrap();
        data.descriptors.extend((0..dim).map(|d| ((s * 31 + d * 17) % 101) as f32 / 50.0 - 1.0));
        data.quality.push(1.0);
    }
    data
}

/// The bytes of a map's file.
fn bytes_of(data: MapData) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("map.esm");
    Map::from_data(data).unwrap().write(&file).unwrap();
    std::fs::read(file).unwrap()
}

/// A folder for one test's file.
struct Scratch {
    folder: TempDir,
}

impl Scratch {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("map.esm")
    }

    /// Puts `bytes` into a fresh file (never edits one that may be mapped) and opens it, points included.
    fn open(&self, bytes: &[u8]) -> Result<Map, Error> {
        let map = self.open_unverified(bytes)?;
        map.verify_points()?;
        Ok(map)
    }

    fn open_unverified(&self, bytes: &[u8]) -> Result<Map, Error> {
        let path = self.path();
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => panic!("{e}"),
            _ => std::fs::write(&path, bytes).unwrap(),
        }
        Map::open(&path)
    }

    /// Names of everything in the folder, sorted.
    fn names(&self) -> Vec<String> {
        names(self.folder.path())
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The message of a refusal, which must name the file and hint at a way out.
fn refusal(result: Result<Map, Error>, what: impl std::fmt::Display) -> String {
    let error = match result {
        Ok(_) => panic!("accepted: {what}"),
        Err(e) => e,
    };
    let message = error.to_string();
    assert!(matches!(error, Error::MapFile { .. }), "{what}: {message}");
    assert!(message.contains("map.esm: ") && message.contains("\nhint: "), "{what}: {message}");
    message
}

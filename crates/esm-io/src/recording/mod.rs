//! Recordings: sweeps one after the other, with the motion between them, in constant memory. Only where the motion is not in
//! time order with the clouds is all of it, and it alone, gathered beforehand: at most 10 million samples, 640 MB.

mod directory;
mod mcap;
mod motion;
mod poses;
mod warning;

use std::path::{Path, PathBuf};

use esm_core::{PointCloud, Pose};

use crate::cloud::{CLOUD_EXTENSIONS, extension};
use crate::error::Error;
use crate::input::Input;
use crate::mcap_file::{Damage, Topic};
use crate::pose::{PoseFile, read_poses};
use crate::ros::point_cloud2::PointLabel;

pub use warning::Warning;

/// One sweep of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// Its number among the recording's intact clouds, from 1.
    pub number: usize,
    /// Time in seconds: `header.stamp`, or what a file's name says, or its place in the directory.
    pub stamp: f64,
    /// The same in nanoseconds, exact.
    pub stamp_ns: i64,
    /// The points, metres, sensor frame.
    pub cloud: PointCloud,
    /// Where the sensor is in the frame its motion is told in; only differences between sweeps mean anything. `None`
    /// where the recording does not tell.
    pub pose_odom_sensor: Option<Pose>,
    /// The sensor frame's name, empty in directories.
    pub frame_id: String,
    /// Points left out: NaN, infinite, or exactly (0, 0, 0).
    pub dropped: usize,
    /// What each point was hit on, as simulators tell it: as many as points where [`OpenOptions::labels`] asked for them and
    /// the clouds have a field `object_id`, else none.
    pub labels: Vec<PointLabel>,
    /// Which laser each point is of: as many as points where [`OpenOptions::rings`] asked for them and the clouds have a field
    /// `ring`, else none.
    pub rings: Vec<u16>,
}

/// What to read of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OpenOptions {
    /// The PointCloud2 topic; needed where there are several.
    pub cloud_topic: Option<String>,
    /// The topic of the motion; needed where several are of the best kind (Odometry, then PoseStamped, then TF).
    pub motion_topic: Option<String>,
    /// A TUM or KITTI file that gives the sensor's pose at each sweep, instead of a topic. TUM poses are matched by time;
    /// KITTI poses need one line a sweep, or, for numbered files of a directory that are a part of a longer drive (they
    /// begin after 1, have gaps, or are one), a line for each number from 0.
    pub poses: Option<PathBuf>,
    /// Whether the points' labels are read too.
    pub labels: bool,
    /// Whether the numbers of the points' lasers are read too.
    pub rings: bool,
}

/// An opened recording: one `.mcap`, a directory of scans, or a single scan.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    source: Source,
    warnings: Vec<Warning>,
}

#[derive(Debug)]
enum Source {
    Mcap(Box<mcap::McapSource>),
    Directory(directory::ScanDirectory),
}

impl Recording {
    /// Opens a recording, finds its topics or files, and checks that poses fit. No cloud is read yet.
    ///
    /// # Errors
    /// [`Error::Topic`] where a topic has to be chosen, [`Error::Malformed`] where nothing intact is left,
    /// [`Error::Unsupported`], [`Error::Empty`], [`Error::Io`].
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let dir = tempfile::tempdir()?;
    /// # for (name, x) in [("2.pcd", 7.0), ("10.pcd", 8.0)] {
    /// #     std::fs::write(dir.path().join(name), format!(
    /// #         "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n{x} 0 0\n"))?;
    /// # }
    /// # let path = dir.path();
    /// use esm_io::{OpenOptions, Recording};
    /// let recording = Recording::open(path, &OpenOptions::default())?;
    /// let mut sweeps = recording.sweeps()?;
    /// for sweep in &mut sweeps {
    ///     let sweep = sweep?;
    ///     println!("{}: {:.2} s, {} points", sweep.number, sweep.stamp, sweep.cloud.len());
    /// }
    /// for warning in sweeps.warnings() {
    ///     eprintln!("warning: {warning}");
    /// }
    /// # Ok(())
    /// # }
    /// ```
    pub fn open(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Self, Error> {
        let path = path.as_ref().to_owned();
        let poses = options.poses.as_deref().map(|p| read_poses(p).map(|f| (p.to_owned(), f))).transpose()?;
        let mut warnings = Vec::new();
        let source = match classify(&path)? {
            InputKind::Recording => Source::Mcap(Box::new(mcap::McapSource::open(&path, options, poses)?)),
            InputKind::ScanDirectory => {
                Source::Directory(directory::ScanDirectory::open(&path, poses, &mut warnings)?)
            }
            InputKind::PriorCloud => Source::Directory(directory::ScanDirectory::single(&path, poses)?),
        };
        Ok(Self { path, source, warnings })
    }

    /// The file or directory.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Starts reading at the first sweep. Independent of other readings of the same recording.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::Unsupported`] where the file is no longer what it was.
    pub fn sweeps(&self) -> Result<Sweeps, Error> {
        let reader = match &self.source {
            Source::Mcap(source) => Reader::Mcap(Box::new(source.sweeps()?)),
            Source::Directory(directory) => Reader::Directory(directory.sweeps()),
        };
        let (path, warnings) = (self.path.clone(), self.warnings.clone());
        Ok(Sweeps { path, reader, warnings, yielded: 0, points: 0, dropped: 0, done: false })
    }

    /// How many sweeps there are as far as the file tells without reading the clouds.
    pub fn sweep_count_hint(&self) -> Option<usize> {
        match &self.source {
            Source::Mcap(source) => Some(source.sweep_count()),
            Source::Directory(directory) => Some(directory.len()),
        }
    }

    /// Whether there is a source of motion: a topic or a file of poses.
    pub fn has_motion(&self) -> bool {
        match &self.source {
            Source::Mcap(source) => source.has_motion(),
            Source::Directory(directory) => directory.has_poses(),
        }
    }

    /// All topics of an MCAP recording by name; none for a directory.
    pub fn topics(&self) -> Vec<Topic> {
        match &self.source {
            Source::Mcap(source) => source.topics(),
            Source::Directory(_) => Vec::new(),
        }
    }

    /// The topic the clouds are read from.
    pub fn cloud_topic(&self) -> Option<&str> {
        match &self.source {
            Source::Mcap(source) => Some(source.cloud_topic()),
            Source::Directory(_) => None,
        }
    }

    /// The topic the motion is read from.
    pub fn motion_topic(&self) -> Option<&str> {
        match &self.source {
            Source::Mcap(source) => source.motion_topic(),
            Source::Directory(_) => None,
        }
    }
}

/// The sweeps of a recording in the order of the file. After an error it ends.
pub struct Sweeps {
    path: PathBuf,
    reader: Reader,
    /// From opening and, once the end is reached, from reading.
    warnings: Vec<Warning>,
    yielded: usize,
    points: usize,
    dropped: usize,
    done: bool,
}

enum Reader {
    Mcap(Box<mcap::McapSweeps>),
    Directory(directory::DirectorySweeps),
}

impl Sweeps {
    /// What was not as it should be; complete once the iteration has ended.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// What is missing of a damaged recording, once the iteration has ended.
    pub fn damage(&self) -> Option<&Damage> {
        self.warnings.iter().find_map(|w| match w {
            Warning::Damaged { damage, .. } => Some(damage),
            _ => None,
        })
    }

    /// At the end: an input without a single usable point is an error.
    fn finish(&mut self) -> Option<Result<Sweep, Error>> {
        self.done = true;
        let (refused_cloud, first_damage) = match &self.reader {
            Reader::Mcap(reader) => {
                self.warnings.extend(reader.warnings());
                (reader.refused_cloud(), reader.first_damage().map(str::to_owned))
            }
            Reader::Directory(_) => (None, None),
        };
        if self.points > 0 {
            return None;
        }
        if let (0, Some(refused)) = (self.yielded, refused_cloud) {
            return Some(Err(refused));
        }
        if let (0, Some(place)) = (self.yielded, first_damage) {
            let hint = "copy the recording again from where it was made; 'mcap recover' may help";
            return Some(Err(Error::malformed(
                &self.path,
                place,
                "no intact cloud is left in the recording",
                hint,
            )));
        }
        let what = match self.yielded {
            0 => "the recording holds no cloud".to_owned(),
            1 => format!("the only cloud holds no usable point ({} invalid ones)", self.dropped),
            n => format!("the {n} clouds hold no usable point ({} invalid ones)", self.dropped),
        };
        Some(Err(Error::empty(&self.path, what, "check the recording in a viewer")))
    }
}

impl Iterator for Sweeps {
    type Item = Result<Sweep, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        let next = match &mut self.reader {
            Reader::Mcap(reader) => reader.next_sweep(),
            Reader::Directory(reader) => reader.next_sweep(),
        };
        match next {
            Ok(Some(sweep)) => {
                self.yielded += 1;
                self.points += sweep.cloud.len();
                self.dropped += sweep.dropped;
                Some(Ok(sweep))
            }
            Ok(None) => self.finish(),
            Err(e) => {
                self.done = true;
                Some(Err(e))
            }
        }
    }
}

/// What an input is, as far as its name and first bytes tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum InputKind {
    /// An MCAP file.
    Recording,
    /// A directory with scans in it.
    ScanDirectory,
    /// One cloud: `.las`, `.laz`, `.pcd`, `.ply`, `.bin`.
    PriorCloud,
}

/// Tells what an input is: directories by being one, files by extension, files of other names by MCAP's magic bytes.
///
/// # Errors
/// [`Error::Unsupported`] where it is none of these, [`Error::Io`] where it cannot be opened.
pub fn classify(path: impl AsRef<Path>) -> Result<InputKind, Error> {
    let path = path.as_ref();
    let meta = std::fs::metadata(path).map_err(|e| Error::io(path, "opening", e))?;
    if meta.is_dir() {
        return Ok(InputKind::ScanDirectory);
    }
    match extension(path).as_str() {
        "mcap" => return Ok(InputKind::Recording),
        e if CLOUD_EXTENSIONS.contains(&e) => return Ok(InputKind::PriorCloud),
        _ => {}
    }
    let mut magic = [0; 8];
    if Input::open(path)?.fill(&mut magic)? && magic == *::mcap::MAGIC {
        return Ok(InputKind::Recording);
    }
    let hint = "inputs are .mcap, a directory of scans, or one cloud (.las .laz .pcd .ply .bin); \
                ROS bags of other kinds can be converted with 'ros2 bag convert' or 'mcap convert'";
    Err(Error::unsupported(path, "is no kind of input that is known", hint))
}

/// A file of poses with its name.
type NamedPoses = Option<(PathBuf, PoseFile)>;

#[cfg(test)]
mod tests {
    use super::*;

    /// A recording may be read on one thread and worked on in another.
    #[test]
    fn sweeps_can_be_sent() {
        fn sendable<T: Send>() {}
        sendable::<Recording>();
        sendable::<Sweeps>();
    }
}

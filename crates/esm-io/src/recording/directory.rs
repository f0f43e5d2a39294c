//! A directory of scans as a recording.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::poses::SweepPoses;
use super::{NamedPoses, Sweep, Warning};
use crate::cloud::{CLOUD_EXTENSIONS, extension, read_scan};
use crate::error::Error;
use crate::natural::natural_order;
use crate::pose::{PoseFile, parse_stamp, seconds};

const SECOND: i64 = 1_000_000_000;

/// Scan files in natural order with their times.
#[derive(Debug)]
pub(super) struct ScanDirectory {
    files: Vec<PathBuf>,
    stamps_ns: Vec<i64>,
    poses: Option<SweepPoses>,
}

pub(super) struct DirectorySweeps {
    files: Vec<PathBuf>,
    stamps_ns: Vec<i64>,
    poses: Option<SweepPoses>,
    next: usize,
}

impl ScanDirectory {
    pub(super) fn open(path: &Path, poses: NamedPoses, warnings: &mut Vec<Warning>) -> Result<Self, Error> {
        let mut by_extension: BTreeMap<String, Vec<(String, PathBuf)>> = BTreeMap::new();
        let mut has_mcap = false;
        let entries = std::fs::read_dir(path).map_err(|e| Error::io(path, "listing", e))?;
        for entry in entries {
            let entry = entry.map_err(|e| Error::io(path, "listing", e))?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let file = entry.path();
            if name.starts_with('.') || !file.is_file() {
                continue;
            }
            let extension = extension(&file);
            has_mcap |= extension == "mcap";
            if CLOUD_EXTENSIONS.contains(&extension.as_str()) {
                by_extension.entry(extension).or_default().push((name, file));
            }
        }
        // The commonest format is the recording; the first by name where two are equally common.
        let Some(most) = by_extension.values().map(Vec::len).max() else {
            let hint = match has_mcap {
                true => "it holds .mcap files: name them instead of the directory",
                false => {
                    "a directory of scans holds .bin, .pcd, .ply, .las or .laz files, not in further directories"
                }
            };
            return Err(Error::empty(path, "the directory holds no scan", hint));
        };
        let read =
            by_extension.iter().find(|(_, v)| v.len() == most).map(|(e, _)| e.clone()).unwrap_or_default();
        let mut files = by_extension.remove(&read).unwrap_or_default();
        if !by_extension.is_empty() {
            let ignored = by_extension.into_iter().map(|(e, v)| (e, v.len())).collect();
            warnings.push(Warning::IgnoredScans { path: path.to_owned(), read, ignored });
        }
        files.sort_by(|a, b| natural_order(&a.0, &b.0));
        Self::new(path, files.into_iter().map(|f| f.1).collect(), poses)
    }

    /// One scan as a recording of its own.
    pub(super) fn single(path: &Path, poses: NamedPoses) -> Result<Self, Error> {
        Self::new(path, vec![path.to_owned()], poses)
    }

    fn new(path: &Path, files: Vec<PathBuf>, poses: NamedPoses) -> Result<Self, Error> {
        let stems: Vec<String> =
            files.iter().map(|f| f.file_stem().unwrap_or_default().to_string_lossy().into_owned()).collect();
        let times = times_in_names(&stems);
        let numbers = numbers_in_names(&stems);
        let poses = match poses {
            None => None,
            Some((file, PoseFile::Ordered(poses))) => {
                let n = poses.len();
                match &numbers {
                    _ if n == files.len() => Some(SweepPoses::ByIndex(poses)),
                    // A part of a longer drive whose files kept their numbers, as in KITTI.
                    Some(numbers) if is_part(numbers) && numbers.iter().all(|&i| (i as usize) < n) => {
                        Some(SweepPoses::ByIndex(numbers.iter().map(|&i| poses[i as usize]).collect()))
                    }
                    _ => return Err(wrong_number(&file, n, files.len())),
                }
            }
            Some((file, PoseFile::Stamped(poses))) => {
                let n = poses.len();
                let by_order = n == files.len();
                let ordered = by_order.then(|| poses.iter().map(|p| p.pose).collect());
                let by_stamp = SweepPoses::by_stamp(poses);
                let known = times.as_ref().or(numbers.as_ref().filter(|_| !by_order));
                let matches = |stamps: &Vec<i64>| stamps.iter().any(|&t| by_stamp.at(0, t).is_some());
                let in_seconds = known.map(|v| v.iter().map(|&t| as_stamp(t, times.is_some())).collect());
                match (in_seconds, ordered) {
                    (Some(stamps), _) if matches(&stamps) => Some(by_stamp),
                    (_, Some(ordered)) => Some(SweepPoses::ByIndex(ordered)),
                    _ => return Err(does_not_fit(&file, n, path, files.len())),
                }
            }
        };
        let stamps_ns = match (times, numbers) {
            (Some(times), _) => times,
            (None, Some(numbers)) => numbers.iter().map(|&n| as_stamp(n, false)).collect(),
            (None, None) => (0..files.len() as i64).map(|n| as_stamp(n, false)).collect(),
        };
        Ok(Self { files, stamps_ns, poses })
    }

    pub(super) fn len(&self) -> usize {
        self.files.len()
    }

    pub(super) fn has_poses(&self) -> bool {
        self.poses.is_some()
    }

    pub(super) fn sweeps(&self) -> DirectorySweeps {
        let (files, stamps_ns) = (self.files.clone(), self.stamps_ns.clone());
        DirectorySweeps { files, stamps_ns, poses: self.poses.clone(), next: 0 }
    }
}

impl DirectorySweeps {
    pub(super) fn next_sweep(&mut self) -> Result<Option<Sweep>, Error> {
        let Some(file) = self.files.get(self.next) else { return Ok(None) };
        let scan = read_scan(file)?;
        let stamp_ns = self.stamps_ns[self.next];
        let sweep = Sweep {
            number: self.next + 1,
            stamp: seconds(stamp_ns),
            stamp_ns,
            cloud: scan.cloud,
            pose_odom_sensor: self.poses.as_ref().and_then(|p| p.at(self.next, stamp_ns)),
            frame_id: String::new(),
            dropped: scan.dropped,
            labels: Vec::new(),
            rings: Vec::new(),
        };
        self.next += 1;
        Ok(Some(sweep))
    }
}

/// A file's number as a time: one second a scan, for want of anything better.
fn as_stamp(number: i64, is_time: bool) -> i64 {
    if is_time { number } else { number.saturating_mul(SECOND) }
}

/// Whether numbered files are a part of something longer: files that count from 0 or 1 without a gap are all there is.
/// A single file may be either.
fn is_part(numbers: &[i64]) -> bool {
    let (first, last) = (numbers.first().copied().unwrap_or(0), numbers.last().copied().unwrap_or(0));
    numbers.len() == 1 || first > 1 || last - first >= numbers.len() as i64
}

fn wrong_number(poses: &Path, n: usize, scans: usize) -> Error {
    let (place, what) =
        (format!("line {}", n.min(scans) + 1), format!("the file has {n} lines for {scans} scans"));
    let hint =
        "KITTI poses have no stamps and need one line a scan in file order; TUM poses are matched by time";
    Error::malformed(poses, place, what, hint)
}

fn does_not_fit(poses: &Path, n: usize, directory: &Path, scans: usize) -> Error {
    let what =
        format!("the file holds {n} poses, the {scans} scans of {} match none of them", directory.display());
    Error::malformed(
        poses,
        format!("line {}", n.min(scans) + 1),
        what,
        "give one pose a scan in file order, or TUM stamps that agree with the times in the files' names",
    )
}

/// The times the names tell, nanoseconds, where all do and they rise: `1317600335.25`, `1317600335_250000000`, or whole
/// numbers of seconds, milli-, micro- or nanoseconds since 1970.
fn times_in_names(stems: &[String]) -> Option<Vec<i64>> {
    let times: Vec<i64> = stems.iter().map(|s| time_in_name(s)).collect::<Option<_>>()?;
    times.is_sorted_by(|a, b| a < b).then_some(times)
}

fn time_in_name(stem: &str) -> Option<i64> {
    if stem.contains('.') {
        return parse_stamp(stem);
    }
    if let Some((s, ns)) = stem.split_once('_') {
        let digits = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        return (digits(s) && digits(ns) && ns.len() == 9).then(|| parse_stamp(&format!("{s}.{ns}")))?;
    }
    if !stem.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    // From 2001 to 2286 the numbers of digits tell the unit; shorter numbers are counters.
    let unit = match stem.len() {
        10 => SECOND,
        13 => SECOND / 1_000,
        16 => SECOND / 1_000_000,
        19 => 1,
        _ => return None,
    };
    (!stem.starts_with('0')).then(|| stem.parse::<i64>().ok()?.checked_mul(unit))?
}

/// The numbers the names are, where all are different whole numbers in rising order.
fn numbers_in_names(stems: &[String]) -> Option<Vec<i64>> {
    let number =
        |s: &String| s.bytes().all(|b| b.is_ascii_digit()).then(|| s.parse::<u32>().ok().map(i64::from))?;
    let numbers: Vec<i64> = stems.iter().map(number).collect::<Option<_>>()?;
    numbers.is_sorted_by(|a, b| a < b).then_some(numbers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_times() {
        let t = Some(1_317_600_335_250_000_000);
        assert_eq!(time_in_name("1317600335.25"), t);
        assert_eq!(time_in_name("1317600335_250000000"), t);
        assert_eq!(time_in_name("1317600335250"), t);
        assert_eq!(time_in_name("1317600335250000"), t);
        assert_eq!(time_in_name("1317600335250000000"), t);
        assert_eq!(time_in_name("1317600335"), Some(1_317_600_335_000_000_000));
        for counter in ["000000", "0000000012", "12", "scan_3", "1317600335_25", "", "x.y"] {
            assert_eq!(time_in_name(counter), None, "{counter}");
        }
    }

    #[test]
    fn numbers_must_rise() {
        let stems = |v: &[&str]| v.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        assert_eq!(numbers_in_names(&stems(&["000002", "000010"])), Some(vec![2, 10]));
        assert_eq!(numbers_in_names(&stems(&["2", "02"])), None);
        assert_eq!(numbers_in_names(&stems(&["a2", "3"])), None);
        assert_eq!(numbers_in_names(&stems(&[""])), None);
    }
}

//! Going on where an interrupted simulation was.
//!
//! While it runs, `unfinished.toml` tells what is being made and which visits are done; the recording in hand lies beside it as
//! `.map.mcap.part`. A later run copies the whole sweeps of that part into a new one, message by message: the same calls
//! give the same bytes, so nobody can tell that there was an interruption. In the end `unfinished.toml` is `preset.toml`.

use std::collections::BTreeMap;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::Path;

use esm_io::{KeptSweeps, RecordingWriter, write_file};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::error::Error;
use crate::plan::Plan;
use crate::preset::Preset;
use crate::simulate::{POINT_STEP, Summary, create, records};
use crate::tiles::Tiles;

const UNFINISHED: &str = "unfinished.toml";
const COMPLETE: &str = "preset.toml";
const VISITS: [&str; 2] = ["map", "live"];
/// Kept sweeps between two reports.
const REPORT_EVERY: usize = 16;

/// What a directory holds of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// No simulation.
    Nothing,
    /// A part of this one: [`simulate`](crate::simulate) goes on with it.
    Unfinished,
    /// All of this one.
    Complete(Summary),
    /// No simulation, but a file of this name that one would replace.
    Foreign(String),
    /// A part of another one, in words.
    OtherUnfinished(String),
    /// All of another one, in words.
    Other(String),
}

/// What a directory holds of the simulation of these arguments.
///
/// ```
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// use esm_sim::{State, preset, simulate, state};
/// # let dir = tempfile::tempdir()?;
/// let forest = preset("train-forest")?;
/// assert_eq!(state(&forest, 1, 0.005, dir.path()), State::Nothing);
/// let summary = simulate(&forest, 1, 0.005, dir.path(), &mut |_| true)?;
/// assert_eq!(state(&forest, 1, 0.005, dir.path()), State::Complete(summary));
/// # Ok(())
/// # }
/// ```
pub fn state(preset: &Preset, seed: u64, scale: f64, out_dir: &Path) -> State {
    let wanted = Record::new(preset, seed, scale);
    if let Some(found) = Record::read(&out_dir.join(UNFINISHED)) {
        return if found.is_of(&wanted) { State::Unfinished } else { State::OtherUnfinished(found.words()) };
    }
    let Some(found) = Record::read(&out_dir.join(COMPLETE)) else {
        let mut ours = VISITS.iter().flat_map(|v| files(v)).chain([COMPLETE.to_owned()]);
        let foreign = ours.find(|name| out_dir.join(name).symlink_metadata().is_ok());
        return foreign.map_or(State::Nothing, State::Foreign);
    };
    if !found.is_of(&wanted) {
        return State::Other(found.words());
    }
    match VISITS.map(|name| found.made(name, out_dir)) {
        [Some(map), Some(live)] => {
            let mut sum = map;
            sum += live;
            State::Complete(sum)
        }
        // A file was taken away or cut.
        _ => State::Nothing,
    }
}

/// Which world a finished simulation in a directory shows, as `preset:seed:scale`, followed by how the live visit was driven
/// where that was not the preset's own way (`:reversed:offset 2:changed 0.3`); `None` where there is none. Two directories
/// with one name hold the same.
pub fn made_in(out_dir: &Path) -> Option<String> {
    let record = Record::read(&out_dir.join(COMPLETE))?;
    let seed = record.seed.as_str().map_or_else(|| record.seed.to_string(), str::to_owned);
    let mut name = format!("{}:{seed}:{}", record.preset.get("name")?.as_str()?, record.scale);
    record.drive().iter().for_each(|words| name.extend([":", words]));
    Some(name)
}

/// What is being made, and what of it is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    generator: String,
    /// A text where TOML's integers do not reach.
    seed: Value,
    scale: f64,
    sensor_source: String,
    preset: Table,
    #[serde(default)]
    made: Made,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Made {
    map: Option<Summary>,
    live: Option<Summary>,
    /// Bytes of the files that are done.
    #[serde(default)]
    bytes: BTreeMap<String, u64>,
}

impl Record {
    fn new(preset: &Preset, seed: u64, scale: f64) -> Self {
        Self {
            generator: concat!("esm-sim ", env!("CARGO_PKG_VERSION")).to_owned(),
            seed: i64::try_from(seed).map_or_else(|_| Value::String(seed.to_string()), Value::Integer),
            scale,
            sensor_source: preset.sensor.sensor().source.to_owned(),
            // Numbers, texts and tables of them: nothing that TOML could refuse.
            preset: Table::try_from(preset).unwrap_or_default(),
            made: Made::default(),
        }
    }

    /// That of an unfinished simulation of the same arguments; else a new one, in a directory freed of older ones.
    pub(crate) fn take_up(preset: &Preset, seed: u64, scale: f64, out_dir: &Path) -> Result<Self, Error> {
        let new = Self::new(preset, seed, scale);
        match Self::read(&out_dir.join(UNFINISHED)) {
            Some(found) if found.is_of(&new) => Ok(found),
            _ => {
                // Before anything is taken away: it may not be writable.
                new.write(&out_dir.join(UNFINISHED))?;
                let visits = VISITS.iter().flat_map(|n| {
                    [format!("{n}.mcap"), format!("{n}_truth.tum"), part_name(n), old_part_name(n)]
                });
                for name in visits.chain([COMPLETE.to_owned()]) {
                    remove(&out_dir.join(name))?;
                }
                Ok(new)
            }
        }
    }

    fn read(path: &Path) -> Option<Self> {
        toml::from_str(&fs::read_to_string(path).ok()?).ok()
    }

    fn write(&self, path: &Path) -> Result<(), Error> {
        let text = toml::to_string(self).unwrap_or_default();
        Ok(write_file(path, text.as_bytes())?)
    }

    fn is_of(&self, other: &Self) -> bool {
        let bare = |r: &Self| Self { made: Made::default(), ..r.clone() };
        bare(self) == bare(other)
    }

    fn words(&self) -> String {
        let name = self.preset.get("name").and_then(Value::as_str).unwrap_or("a preset");
        let drive: String = self.drive().iter().map(|words| format!(", live {words}")).collect();
        format!("{name}, seed {}, scale {}{drive}, {}", self.seed, self.scale, self.generator)
    }

    /// How the live visit was driven, where that is not the preset's own way.
    fn drive(&self) -> Vec<String> {
        let live =
            |keys: &[&str]| keys.iter().try_fold(self.preset.get("live")?, |table, key| table.get(key));
        let reversed = live(&["reversed"]).and_then(Value::as_bool).filter(|yes| *yes);
        let offset = live(&["offset_m"]).and_then(Value::as_float).filter(|metres| *metres != 0.0);
        let changed = live(&["visit", "changed"]).and_then(Value::as_float);
        let words = [
            reversed.map(|_| "reversed".to_owned()),
            offset.map(|metres| format!("offset {metres}")),
            changed.map(|share| format!("changed {share}")),
        ];
        words.into_iter().flatten().collect()
    }

    /// What a visit adds up to, where it is done and its files are there.
    pub(crate) fn made(&self, name: &str, out_dir: &Path) -> Option<Summary> {
        let made = if name == "map" { self.made.map } else { self.made.live };
        let whole =
            |file: &String| size(&out_dir.join(file)).is_some_and(|n| self.made.bytes.get(file) == Some(&n));
        made.filter(|_| files(name).iter().all(whole))
    }

    pub(crate) fn set_made(&mut self, name: &str, summary: Summary, out_dir: &Path) -> Result<(), Error> {
        *(if name == "map" { &mut self.made.map } else { &mut self.made.live }) = Some(summary);
        for file in files(name) {
            self.made.bytes.extend(size(&out_dir.join(&file)).map(|n| (file, n)));
        }
        self.write(&out_dir.join(UNFINISHED))
    }

    /// All is done: nothing is left but the results.
    pub(crate) fn complete(&self, out_dir: &Path) -> Result<(), Error> {
        self.write(&out_dir.join(COMPLETE))?;
        remove(&out_dir.join(UNFINISHED))
    }
}

/// The files of a visit.
fn files(visit: &str) -> [String; 2] {
    [format!("{visit}.mcap"), format!("{visit}_truth.tum")]
}

/// Bytes of a file, where it is one.
fn size(path: &Path) -> Option<u64> {
    fs::metadata(path).ok().filter(fs::Metadata::is_file).map(|m| m.len())
}

fn part_name(visit: &str) -> String {
    format!(".{visit}.mcap.part")
}

/// What is copied from.
fn old_part_name(visit: &str) -> String {
    format!(".{visit}.mcap.part.old")
}

fn failed(path: &Path, source: io::Error) -> Error {
    Error::Directory { path: path.to_owned(), doing: "replacing it", source }
}

fn remove(path: &Path) -> Result<(), Error> {
    match fs::remove_file(path) {
        Err(e) if e.kind() != io::ErrorKind::NotFound => Err(failed(path, e)),
        _ => Ok(()),
    }
}

/// Makes the directory, and holds it as long as the answer lives: two simulations in one would spoil each other.
pub(crate) fn lock(out_dir: &Path) -> Result<Option<File>, Error> {
    fs::create_dir_all(out_dir).map_err(|source| Error::Directory {
        path: out_dir.to_owned(),
        doing: "creating the directory",
        source,
    })?;
    // Not every system can open a directory or lock it.
    let Ok(file) = File::open(out_dir) else { return Ok(None) };
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(Error::Busy { path: out_dir.to_owned() }),
        _ => Ok(Some(file)),
    }
}

/// The writer of a visit's recording, with the sweeps that an interrupted run has left already in it; the summary counts
/// those.
pub(crate) fn start(
    plan: &Plan<'_>,
    name: &str,
    tiles: &mut Tiles<'_>,
    out_dir: &Path,
    report: &mut dyn FnMut(usize) -> Result<(), Error>,
) -> Result<(RecordingWriter, Summary), Error> {
    let path = out_dir.join(format!("{name}.mcap"));
    let (part_name, old) = (part_name(name), out_dir.join(old_part_name(name)));
    let part = out_dir.join(&part_name);
    // Where both are there a copy was interrupted, and the old one holds more.
    if !old.exists() && part.exists() {
        fs::rename(&part, &old).map_err(|e| failed(&part, e))?;
    }
    let mut writer = create(&path, &part_name)?;
    let mut summary = Summary::default();
    let mut last = Vec::new();
    for sweep in KeptSweeps::open(&old).into_iter().flatten() {
        if plan.stamps_ns.get(summary.kept) != Some(&sweep.stamp_ns) {
            break;
        }
        writer.write_kept(&sweep)?;
        last.clear();
        last.extend_from_slice(sweep.records());
        summary.points += (last.len() / POINT_STEP) as u64;
        summary.kept += 1;
        if summary.kept.is_multiple_of(REPORT_EVERY) {
            report(summary.kept)?;
        }
    }
    // Another build of the program may make other sweeps, though it has the same version.
    if let Some(n) = summary.kept.checked_sub(1)
        && records(&plan.sweep(n, &plan.scene(tiles, n))) != last
    {
        drop(writer);
        writer = create(&path, &part_name)?;
        summary = Summary { discarded: summary.kept, ..Summary::default() };
    }
    remove(&old)?;
    Ok((writer, summary))
}

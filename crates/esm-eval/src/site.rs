//! [`Site`]: the recordings of one place, there and with their digests.

use std::path::{Path, PathBuf};

use esm_io::{OpenOptions, Recording};
use serde_json::{Value, json};

use crate::digest;
use crate::error::Error;
use crate::plan::{Dataset, Files, Simulated, Source};
use crate::watch::Teller;

/// One place of a dataset: the only one, or a simulated world.
pub(crate) struct Site {
    /// Of the simulated world.
    pub(crate) seed: Option<u64>,
    pub(crate) files: Files,
    /// What makes the map.
    pub(crate) map_digest: Value,
    /// What is looked for.
    pub(crate) live_digest: Value,
    /// What tells where it was.
    pub(crate) truth_digest: String,
}

/// All places of a dataset; simulated ones are made where they are missing.
pub(crate) fn sites(dataset: &Dataset, sims: &Path, teller: &mut Teller<'_, '_>) -> Result<Vec<Site>, Error> {
    match &dataset.source {
        Source::Files(files) => Ok(vec![site(None, (**files).clone(), &dataset.name, teller)?]),
        Source::Simulated(worlds) => worlds
            .seeds
            .iter()
            .map(|&seed| {
                let dir = simulated(worlds, seed, sims, teller)?;
                let file = |name: &str| dir.join(name);
                let files = Files {
                    map: file("map.mcap"),
                    map_poses: Some(file("map_truth.tum")),
                    live: file("live.mcap"),
                    live_poses: None,
                    truth: file("live_truth.tum"),
                    cloud_topic: None,
                    odometry_topic: None,
                };
                site(Some(seed), files, &dataset.name, teller)
            })
            .collect(),
    }
}

fn site(seed: Option<u64>, files: Files, name: &str, teller: &mut Teller<'_, '_>) -> Result<Site, Error> {
    teller.begins(format!("reading {name}"), None)?;
    let mut of = |path: &Path| {
        teller.step()?;
        digest::of_input(path)
    };
    let optional = |path: &Option<PathBuf>, of: &mut dyn FnMut(&Path) -> Result<String, Error>| {
        path.as_deref().map(of).transpose()
    };
    let map = of(&files.map)?;
    let map_poses = optional(&files.map_poses, &mut of)?;
    let live = of(&files.live)?;
    let live_poses = optional(&files.live_poses, &mut of)?;
    let truth_digest = of(&files.truth)?;
    let topics = json!([files.cloud_topic, files.odometry_topic]);
    let map_name = files.map.file_name().unwrap_or_default().to_string_lossy();
    Ok(Site {
        seed,
        // A map remembers the name of the file it was made from.
        map_digest: json!([map, map_poses, topics, map_name]),
        live_digest: json!([live, live_poses, topics]),
        truth_digest,
        files,
    })
}

/// Simulates a world, or goes on with it, into a folder of its own.
fn simulated(
    worlds: &Simulated,
    seed: u64,
    sims: &Path,
    teller: &mut Teller<'_, '_>,
) -> Result<PathBuf, Error> {
    let Simulated { preset, scale, drive, .. } = worlds;
    let words = format!("{scale} {drive:?}");
    let dir = sims.join(format!("{preset}-{seed}-{}", &digest::of_bytes(words.as_bytes())[..8]));
    let preset = drive.of(&esm_sim::preset(preset)?)?;
    if let esm_sim::State::Complete(_) = esm_sim::state(&preset, seed, *scale, &dir) {
        return Ok(dir);
    }
    let mut visit = "";
    let mut progress = |p: esm_sim::Progress| {
        if std::mem::replace(&mut visit, p.visit) != p.visit {
            let what = format!("simulating {} {seed}, {} visit", preset.name, p.visit);
            if teller.begins(what, Some(p.total)).is_err() {
                return false;
            }
        }
        teller.tell(crate::Event::At(p.done as u64)).is_ok()
    };
    esm_sim::simulate(&preset, seed, *scale, &dir, &mut progress)?;
    Ok(dir)
}

impl Site {
    /// `name`, with the seed where there is one.
    pub(crate) fn words(&self, name: &str) -> String {
        self.seed.map_or_else(|| name.to_owned(), |seed| format!("{name} {seed}"))
    }

    /// Opens the recording that the map is made from; it must tell where its sweeps were taken.
    pub(crate) fn open_map(&self, labels: bool) -> Result<Recording, Error> {
        let recording = self.open(&self.files.map, &self.files.map_poses, labels, false)?;
        if recording.has_motion() {
            return Ok(recording);
        }
        let what = "nothing tells where the scans were taken";
        Err(Error::input(&self.files.map, what, "give their poses as `map_poses` (TUM or KITTI)"))
    }

    /// Opens the second visit.
    pub(crate) fn open_live(&self, labels: bool, rings: bool) -> Result<Recording, Error> {
        self.open(&self.files.live, &self.files.live_poses, labels, rings)
    }

    fn open(
        &self,
        path: &Path,
        poses: &Option<PathBuf>,
        labels: bool,
        rings: bool,
    ) -> Result<Recording, Error> {
        let options = OpenOptions {
            cloud_topic: self.files.cloud_topic.clone(),
            motion_topic: self.files.odometry_topic.clone(),
            poses: poses.clone(),
            labels,
            rings,
        };
        Ok(Recording::open(path, &options)?)
    }
}

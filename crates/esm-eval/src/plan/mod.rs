//! [`Plan`]: what is evaluated, as read from a TOML file and checked.
//!
//! Paths in a plan are relative to the folder it lies in, so that it means the same wherever it is run.

mod check;
mod settings;
mod text;

use std::path::{Path, PathBuf};

use esm_core::Config;
use esm_sim::Drive;
use toml::Table;

use crate::error::Error;

/// What to evaluate. Every dataset is mapped and localized in by every method in every mode.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The file it was read from.
    pub path: PathBuf,
    /// What the report is headed with.
    pub name: String,
    /// Places, mapped once and visited again.
    pub datasets: Vec<Dataset>,
    /// What is compared.
    pub methods: Vec<Method>,
    /// The ways in which live clouds are made and looked for.
    pub modes: Vec<Mode>,
    /// How descriptors are judged apart from localization; `None` where they are not.
    pub roc: Option<RocPlan>,
    /// Settings that hold for all.
    config: Table,
}

/// A place, mapped once and visited again.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Unique in the plan.
    pub name: String,
    /// Where the recordings come from.
    pub source: Source,
    /// Metres of travel that a window of the map holds, and a live cloud where the mode does not say otherwise.
    pub accumulate_m: f64,
    /// Whether live clouds do not overlap.
    pub swathes: bool,
    config: Table,
}

/// Where recordings come from.
#[derive(Clone, Debug)]
pub enum Source {
    /// Files.
    Files(Box<Files>),
    /// The simulator.
    Simulated(Simulated),
}

/// Recordings of one's own.
#[derive(Clone, Debug)]
pub struct Files {
    /// A recording, a directory of scans or a prior cloud.
    pub map: PathBuf,
    /// The sensor's poses in the map recording, in the map frame; `None` takes its odometry.
    pub map_poses: Option<PathBuf>,
    /// The second visit.
    pub live: PathBuf,
    /// Its motion, where the recording does not tell; used relatively only.
    pub live_poses: Option<PathBuf>,
    /// Where the sensor truly was at the second visit, in the map frame.
    pub truth: PathBuf,
    /// The topic of the clouds, where there are several.
    pub cloud_topic: Option<String>,
    /// The topic of the motion, where there are several.
    pub odometry_topic: Option<String>,
}

/// Worlds of the simulator, one a seed.
#[derive(Clone, Debug)]
pub struct Simulated {
    /// What is simulated.
    pub preset: String,
    /// A world each.
    pub seeds: Vec<u64>,
    /// Length of the route, as a factor of the preset's own.
    pub scale: f64,
    /// How the second visit is driven.
    pub drive: Drive,
}

/// A descriptor with the settings that it is used with.
#[derive(Clone, Debug)]
pub struct Method {
    /// Unique in the plan.
    pub name: String,
    /// As of `--descriptor`: a name, or the path of a weights file.
    pub descriptor: String,
    config: Table,
}

/// How live clouds are made and looked for.
#[derive(Clone, Debug)]
pub struct Mode {
    /// Unique in the plan.
    pub name: String,
    /// Metres of travel that a live cloud holds; `None` leaves it to the dataset, 0 takes single sweeps.
    pub accumulate_m: Option<f64>,
    /// Whether the clouds of the visit help each other by the odometry between them.
    pub odometry: bool,
    /// Of so many clouds one is looked for.
    pub every: usize,
    /// Of so many lasers the live clouds keep one.
    pub beams: usize,
    /// The share of the map's segments that is left out: they cannot be matched, their points are still there.
    pub map_deleted: f64,
    /// Draws them.
    pub map_deleted_seed: u64,
    /// The datasets that it is for; `None` for all.
    pub datasets: Option<Vec<String>>,
    /// The methods that it is for; `None` for all.
    pub methods: Option<Vec<String>>,
}

impl Default for Mode {
    fn default() -> Self {
        Self {
            name: "single".to_owned(),
            accumulate_m: None,
            odometry: false,
            every: 1,
            beams: 1,
            map_deleted: 0.0,
            map_deleted_seed: 0,
            datasets: None,
            methods: None,
        }
    }
}

impl Mode {
    /// Whether it is for this dataset and this method.
    pub fn is_for(&self, dataset: &str, method: &str) -> bool {
        let holds = |names: &Option<Vec<String>>, name: &str| {
            names.as_ref().is_none_or(|all| all.iter().any(|n| n == name))
        };
        holds(&self.datasets, dataset) && holds(&self.methods, method)
    }
}

/// How descriptors are judged on pairs of segments.
#[derive(Clone, Debug, PartialEq)]
pub struct RocPlan {
    /// Metres of travel between two clouds that segments are cut from.
    pub step_m: f64,
    /// Draws the pairs.
    pub seed: u64,
    /// The datasets that it is done on; `None` for all that are recordings.
    pub datasets: Option<Vec<String>>,
}

impl Plan {
    /// Reads a plan and checks all of it: names, files, weights and settings.
    ///
    /// # Errors
    /// [`Error::Plan`] with file, line and hint; [`Error::Io`] where it cannot be read.
    ///
    /// ```
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let dir = tempfile::tempdir()?;
    /// # let path = dir.path().join("plan.toml");
    /// std::fs::write(&path, r#"
    ///     datasets = [{ name = "street", preset = "kitti", seeds = [200, 201], scale = 0.05 }]
    ///     methods = [{ name = "shape" }, { name = "eigen" }]
    /// "#)?;
    /// let plan = esm_eval::Plan::read(&path)?;
    /// assert_eq!((plan.datasets.len(), plan.methods[1].descriptor.as_str()), (1, "eigen"));
    /// assert_eq!(plan.modes[0].name, "single");
    /// # Ok(())
    /// # }
    /// ```
    pub fn read(path: &Path) -> Result<Self, Error> {
        check::checked(path, &text::read(path)?)
    }

    /// Keeps only the datasets, methods and modes of these names; an empty list keeps all of the kind.
    ///
    /// # Errors
    /// [`Error::Plan`] for a name that is not in the plan.
    pub fn only(mut self, datasets: &[String], methods: &[String], modes: &[String]) -> Result<Self, Error> {
        check::known(&self.path, "dataset", datasets, self.datasets.iter().map(|d| &d.name))?;
        check::known(&self.path, "method", methods, self.methods.iter().map(|m| &m.name))?;
        check::known(&self.path, "mode", modes, self.modes.iter().map(|m| &m.name))?;
        let keeps = |names: &[String], name: &String| names.is_empty() || names.contains(name);
        self.datasets.retain(|d| keeps(datasets, &d.name));
        self.methods.retain(|m| keeps(methods, &m.name));
        self.modes.retain(|m| keeps(modes, &m.name));
        Ok(self)
    }

    /// Only the trials on one simulated world (or on recordings, which have no seed), without curves.
    pub fn alone(mut self, seed: Option<u64>) -> Self {
        self.roc = None;
        for dataset in &mut self.datasets {
            if let Source::Simulated(worlds) = &mut dataset.source {
                worlds.seeds.retain(|s| Some(*s) == seed);
            }
        }
        self
    }

    /// The settings with which a map is built: the defaults, the plan's, the dataset's and the method's over each other.
    pub(crate) fn map_config(&self, dataset: &Dataset, method: &Method) -> Result<Config, Error> {
        let mut config =
            settings::merged(&[&self.config, &dataset.config, &method.config]).map_err(|what| {
                self.refused(format!("method '{}' on '{}': {what}", method.name, dataset.name))
            })?;
        config.descriptor.clone_from(&method.descriptor);
        config.accumulate.distance_m = dataset.accumulate_m;
        config.accumulate.swathes = false;
        config
            .check()
            .map_err(|e| self.refused(format!("method '{}' on '{}': {e}", method.name, dataset.name)))?;
        Ok(config)
    }

    /// The settings with which live clouds are looked for.
    pub(crate) fn live_config(
        &self,
        dataset: &Dataset,
        method: &Method,
        mode: &Mode,
    ) -> Result<Config, Error> {
        let mut config = self.map_config(dataset, method)?;
        let metres = mode.accumulate_m.unwrap_or(dataset.accumulate_m);
        config.accumulate.distance_m = metres;
        config.accumulate.swathes = dataset.swathes && metres > 0.0;
        config.check().map_err(|e| self.refused(format!("mode '{}': {e}", mode.name)))?;
        Ok(config)
    }

    fn refused(&self, what: String) -> Error {
        let hint = "`esm-cli config` prints every key with its range".to_owned();
        Error::Plan { path: self.path.clone(), line: None, what, hint }
    }
}

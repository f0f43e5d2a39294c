//! [`simulate`]: recordings of worlds with truth.

use std::path::{Path, PathBuf};

use esm_sim::{Class, Drive, State};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::failure::{Failure, raise};
use crate::threads::Threads;
use crate::work::run_telling;

/// A world, a sensor, and two visits, by name (`PRESETS`).
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Preset {
    inner: esm_sim::Preset,
}

#[pymethods]
impl Preset {
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        Ok(Self { inner: esm_sim::preset(name).map_err(Failure::from)? })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        self.inner.name
    }

    /// What it mirrors.
    #[getter]
    fn about(&self) -> &str {
        self.inner.about
    }

    /// Length of the route at scale 1, metres.
    #[getter]
    fn length_m(&self) -> f64 {
        self.inner.length_m
    }

    /// The sensor's name.
    #[getter]
    fn sensor(&self) -> &str {
        self.inner.sensor.sensor().name
    }

    /// Height of the sensor above the ground, metres.
    #[getter]
    fn sensor_height_m(&self) -> f64 {
        self.inner.sensor_height_m
    }

    /// Mean speed, m/s.
    #[getter]
    fn speed_mps(&self) -> f64 {
        self.inner.speed_mps
    }

    /// Metres between recorded sweeps; 0 records every one.
    #[getter]
    fn spacing_m(&self) -> f64 {
        self.inner.spacing_m
    }

    /// Metres of travel in a live cloud of the data it mirrors (`accumulate.distance_m`).
    #[getter]
    fn accumulate_m(&self) -> f64 {
        self.inner.accumulate_m
    }

    fn __repr__(&self) -> String {
        let p = &self.inner;
        format!("Preset({:?}, length_m={}, accumulate_m={})", p.name, p.length_m, p.accumulate_m)
    }
}

/// The presets' names.
pub(crate) fn preset_names(py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
    PyTuple::new(py, esm_sim::PRESETS.map(|p| p.name))
}

/// The classes' names by their numbers.
pub(crate) fn class_names(py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
    let names = PyDict::new(py);
    for class in Class::ALL {
        names.set_item(class as u8, class.name())?;
    }
    Ok(names)
}

/// How far a simulation has come.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Progress {
    inner: esm_sim::Progress,
}

#[pymethods]
impl Progress {
    /// The visit in hand.
    #[getter]
    fn visit(&self) -> &'static str {
        self.inner.visit
    }

    /// Sweeps written.
    #[getter]
    fn done(&self) -> usize {
        self.inner.done
    }

    /// Sweeps of the visit.
    #[getter]
    fn total(&self) -> usize {
        self.inner.total
    }

    fn __repr__(&self) -> String {
        let p = &self.inner;
        format!("Progress(visit={:?}, done={}, total={})", p.visit, p.done, p.total)
    }
}

/// What was simulated.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Summary {
    inner: esm_sim::Summary,
}

#[pymethods]
impl Summary {
    /// Sweeps.
    #[getter]
    fn sweeps(&self) -> usize {
        self.inner.sweeps
    }

    /// Rays cast.
    #[getter]
    fn rays(&self) -> u64 {
        self.inner.rays
    }

    /// Points that came back.
    #[getter]
    fn points(&self) -> u64 {
        self.inner.points
    }

    /// Metres travelled.
    #[getter]
    fn travel_m(&self) -> f64 {
        self.inner.travel_m
    }

    /// Of the sweeps, those that an interrupted run had made.
    #[getter]
    fn kept(&self) -> usize {
        self.inner.kept
    }

    /// Sweeps of an interrupted run that were made again: this program makes other ones.
    #[getter]
    fn discarded(&self) -> usize {
        self.inner.discarded
    }

    fn __repr__(&self) -> String {
        let s = &self.inner;
        format!(
            "Summary(sweeps={}, points={}, travel_m={:.1}, kept={})",
            s.sweeps, s.points, s.travel_m, s.kept
        )
    }
}

/// Simulate both visits of a preset into a directory, or go on where an interrupted run was.
///
/// Makes `map.mcap`, `live.mcap`, `map_truth.tum` and `live_truth.tum`; their bytes depend on preset, seed and scale (which
/// multiplies the route's length) and how the live visit is driven alone: `live_reversed` the other way round, `live_offset`
/// metres to the left of the mapped way or as far as the ground allows, `live_changed` the share of what can change that
/// does. What is complete already is left as it is; what another simulation or somebody else has made is replaced with
/// `force` only. `progress` hears of every batch of sweeps and stops the simulation by answering False. After Ctrl-C the
/// same call goes on.
#[pyfunction]
#[pyo3(signature = (preset, seed, directory, *, scale=1.0, live_reversed=false, live_offset=0.0, live_changed=None, force=false, progress=None, threads=None))]
#[allow(clippy::too_many_arguments)] // Python has names for them.
pub(crate) fn simulate(
    py: Python<'_>,
    preset: &Bound<'_, PyAny>,
    seed: u64,
    directory: PathBuf,
    scale: f64,
    live_reversed: bool,
    live_offset: f64,
    live_changed: Option<f64>,
    force: bool,
    progress: Option<Bound<'_, PyAny>>,
    threads: Option<usize>,
) -> PyResult<Summary> {
    let drive = Drive { reversed: live_reversed, offset_m: live_offset, changed: live_changed };
    let preset = drive.of(&read_preset(preset)?).map_err(Failure::from)?;
    if let Some(progress) = &progress
        && !progress.is_callable()
    {
        return Err(PyTypeError::new_err("progress must be callable"));
    }
    esm_sim::check_scale(scale).map_err(Failure::from)?;
    let threads = Threads::new(threads)?;
    if !force {
        match esm_sim::state(&preset, seed, scale, &directory) {
            State::Complete(inner) => return Ok(Summary { inner }),
            State::Nothing | State::Unfinished => {}
            State::Foreign(name) => {
                return Err(taken(&directory.join(name), "it exists, and no simulation has made it"));
            }
            State::OtherUnfinished(words) => {
                let what = format!("this directory holds a part of another simulation: {words}");
                return Err(taken(&directory, &what));
            }
            State::Other(words) => {
                return Err(taken(&directory, &format!("this directory holds another simulation: {words}")));
            }
        }
    }
    // Only False stops: a callback that returns nothing wants to go on.
    let heard = |inner: esm_sim::Progress| match &progress {
        None => Ok(true),
        Some(progress) => {
            let answer = progress.call1((Progress { inner },))?;
            Ok(!answer.is(pyo3::types::PyBool::new(py, false)))
        }
    };
    let inner = run_telling(py, threads, heard, move |progress| {
        esm_sim::simulate(&preset, seed, scale, &directory, progress)
    })?;
    Ok(Summary { inner })
}

/// By name, or one in hand.
fn read_preset(preset: &Bound<'_, PyAny>) -> PyResult<esm_sim::Preset> {
    if let Ok(preset) = preset.cast::<Preset>() {
        return Ok(preset.get().inner);
    }
    match preset.extract::<String>() {
        Ok(name) => Ok(esm_sim::preset(&name).map_err(Failure::from)?),
        Err(_) => {
            Err(PyTypeError::new_err(format!("preset must be a name or a Preset, got {}", preset.get_type())))
        }
    }
}

fn taken(path: &Path, what: &str) -> PyErr {
    let hint = "choose another directory, or remove this one; force=True replaces it";
    raise("ExistsError", format!("{}: {what}\nhint: {hint}", path.display()))
}

//! [`simulate`]: recordings of worlds with truth.

use std::path::{Path, PathBuf};

use esm_sim::{Class, State};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::failure::{Failure, raise};
use crate::threads::Threads;
use crate::work::run_telling;

/// A world, a sensor, and two visits.
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

    #[getter]
    fn name(&self) -> &str {
        self.inner.name
    }

    #[getter]
    fn about(&self) -> &str {
        self.inner.about
    }

    #[getter]
    fn length_m(&self) -> f64 {
        self.inner.length_m
    }

    #[getter]
    fn sensor(&self) -> &str {
        self.inner.sensor.sensor().name
    }

    #[getter]
    fn sensor_height_m(&self) -> f64 {
        self.inner.sensor_height_m
    }

    #[getter]
    fn speed_mps(&self) -> f64 {
        self.inner.speed_mps
    }

    #[getter]
    fn spacing_m(&self) -> f64 {
        self.inner.spacing_m
    }

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
    #[getter]
    fn visit(&self) -> &'static str {
        self.inner.visit
    }

    #[getter]
    fn done(&self) -> usize {
        self.inner.done
    }

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
    #[getter]
    fn sweeps(&self) -> usize {
        self.inner.sweeps
    }

    #[getter]
    fn rays(&self) -> u64 {
        self.inner.rays
    }

    #[getter]
    fn points(&self) -> u64 {
        self.inner.points
    }

    #[getter]
    fn travel_m(&self) -> f64 {
        self.inner.travel_m
    }

    #[getter]
    fn kept(&self) -> usize {
        self.inner.kept
    }

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

#[pyfunction]
#[pyo3(signature = (preset, seed, directory, *, scale=1.0, force=false, progress=None, threads=None))]
#[allow(clippy::too_many_arguments)] // Python has names for them.
pub(crate) fn simulate(
    py: Python<'_>,
    preset: &Bound<'_, PyAny>,
    seed: u64,
    directory: PathBuf,
    scale: f64,
    force: bool,
    progress: Option<Bound<'_, PyAny>>,
    threads: Option<usize>,
) -> PyResult<Summary> {
    let preset = read_preset(preset)?;
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

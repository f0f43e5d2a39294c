//! [`LoopFinder`]: places of one recording that were passed before.

use std::sync::{Arc, Mutex, PoisonError};

use esm_core as core;
use pyo3::prelude::*;

use crate::accumulate::LiveCloud;
use crate::config::{Config, or_default};
use crate::describe::{Descriptor, given};
use crate::failure::Failure;
use crate::localize::{Localization, covariance};
use crate::output::Kept;
use crate::pose::fixed_pose;
use crate::threads::Threads;
use crate::work::run;

/// Grows a map of the recording's past and looks for every new cloud in it.
///
/// Past is what was seen 30 s and 50 m of travel ago. The motion is used relatively only.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct LoopFinder {
    inner: Arc<Mutex<core::LoopFinder>>,
    threads: Threads,
}

#[pymethods]
impl LoopFinder {
    #[new]
    #[pyo3(signature = (config=None, *, descriptor=None, threads=None))]
    fn new(
        config: Option<&Bound<'_, Config>>,
        descriptor: Option<&Bound<'_, Descriptor>>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let config = or_default(config);
        let inner = match given(descriptor) {
            Some(descriptor) => core::LoopFinder::with_descriptor(&config, descriptor),
            None => core::LoopFinder::new(&config),
        };
        let inner = inner.map_err(Failure::from)?;
        Ok(Self { inner: Arc::new(Mutex::new(inner)), threads: Threads::new(threads)? })
    }

    /// Look for the cloud in the past, then add it to what will be the past.
    ///
    /// None where the cloud has no motion, or there is no past yet.
    fn push(&self, py: Python<'_>, live: &Bound<'_, LiveCloud>) -> PyResult<Option<LoopAnswer>> {
        let (inner, live) = (Arc::clone(&self.inner), (*live.get().inner).clone());
        let answer =
            run(py, self.threads, move || inner.lock().unwrap_or_else(PoisonError::into_inner).push(live))?;
        answer.map(|answer| LoopAnswer::new(py, answer)).transpose()
    }

    fn __repr__(&self) -> &'static str {
        "LoopFinder()"
    }
}

/// The answer for one cloud of a recording.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct LoopAnswer {
    localization: Py<Localization>,
    closure: Option<Py<LoopClosure>>,
}

impl LoopAnswer {
    fn new(py: Python<'_>, answer: core::LoopAnswer) -> PyResult<Self> {
        let closure = |inner| Py::new(py, LoopClosure { inner, covariance: Kept::default() });
        Ok(Self {
            localization: Py::new(py, Localization::new(answer.localization))?,
            closure: answer.closure.map(closure).transpose()?,
        })
    }
}

#[pymethods]
impl LoopAnswer {
    /// The cloud's localization in the map of the past, whose frame is the odometry's.
    #[getter]
    fn localization(&self, py: Python<'_>) -> Py<Localization> {
        self.localization.clone_ref(py)
    }

    /// The constraint, where the cloud was located.
    #[getter]
    fn closure(&self, py: Python<'_>) -> Option<Py<LoopClosure>> {
        self.closure.as_ref().map(|c| c.clone_ref(py))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let localization = self.localization.bind(py).repr()?;
        let closure = match &self.closure {
            Some(closure) => closure.bind(py).repr()?.to_string(),
            None => "None".to_owned(),
        };
        Ok(format!("LoopAnswer(localization={localization}, closure={closure})"))
    }
}

/// A constraint between two moments of one recording.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct LoopClosure {
    inner: core::LoopClosure,
    covariance: Kept,
}

#[pymethods]
impl LoopClosure {
    /// Seconds: the sweep of the past whose place is nearest.
    #[getter]
    fn stamp_from(&self) -> f64 {
        self.inner.stamp_from
    }

    /// Seconds: the newest sweep of the cloud that was recognised.
    #[getter]
    fn stamp_to(&self) -> f64 {
        self.inner.stamp_to
    }

    /// Pose of the sensor at `stamp_to` in the sensor frame of `stamp_from`, shape (4, 4).
    #[getter]
    fn pose_from_to(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_pose(py, &self.inner.pose_from_to)
    }

    /// Shape (6, 6), order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame of `stamp_to`.
    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        covariance(py, &self.covariance, self.inner.covariance.as_ref())
    }

    fn __repr__(&self) -> String {
        format!("LoopClosure(stamp_from={:.6}, stamp_to={:.6})", self.inner.stamp_from, self.inner.stamp_to)
    }
}

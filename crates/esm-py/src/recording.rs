//! [`Recording`]: sweeps one after the other.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use esm_io::{Lost, OpenOptions};
use pyo3::prelude::*;
use pyo3::types::PyType;

use crate::output::{Kept, row, rows3};
use crate::pose;
use crate::threads::Threads;
use crate::work::run;

/// An opened recording.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Recording {
    inner: Arc<esm_io::Recording>,
}

#[pymethods]
impl Recording {
    #[new]
    #[pyo3(signature = (path, *, cloud_topic=None, motion_topic=None, poses=None, labels=false))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        cloud_topic: Option<String>,
        motion_topic: Option<String>,
        poses: Option<PathBuf>,
        labels: bool,
    ) -> PyResult<Self> {
        let options = OpenOptions { cloud_topic, motion_topic, poses, labels };
        let inner = run(py, Threads::default(), move || esm_io::Recording::open(path, &options))?;
        Ok(Self { inner: Arc::new(inner) })
    }

    #[getter]
    fn path(&self) -> PathBuf {
        self.inner.path().to_owned()
    }

    #[getter]
    fn cloud_topic(&self) -> Option<&str> {
        self.inner.cloud_topic()
    }

    #[getter]
    fn motion_topic(&self) -> Option<&str> {
        self.inner.motion_topic()
    }

    #[getter]
    fn has_motion(&self) -> bool {
        self.inner.has_motion()
    }

    #[getter]
    fn sweep_count_hint(&self) -> Option<usize> {
        self.inner.sweep_count_hint()
    }

    #[getter]
    fn topics(&self) -> Vec<Topic> {
        self.inner.topics().into_iter().map(|inner| Topic { inner }).collect()
    }

    fn sweeps(&self, py: Python<'_>) -> PyResult<Sweeps> {
        let recording = Arc::clone(&self.inner);
        let sweeps = run(py, Threads::default(), move || recording.sweeps())?;
        Ok(Sweeps { path: self.path(), inner: Arc::new(Mutex::new(Reading { sweeps, told: false })) })
    }

    fn __iter__(&self, py: Python<'_>) -> PyResult<Sweeps> {
        self.sweeps(py)
    }

    fn __repr__(&self) -> String {
        let count = self.inner.sweep_count_hint().map_or_else(|| "None".to_owned(), |n| n.to_string());
        let motion = if self.inner.has_motion() { "True" } else { "False" };
        format!(
            "Recording({:?}, sweeps={count}, has_motion={motion})",
            self.inner.path().display().to_string()
        )
    }
}

/// A topic of a recording.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Topic {
    inner: esm_io::Topic,
}

#[pymethods]
impl Topic {
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    #[getter]
    fn message_type(&self) -> &str {
        &self.inner.message_type
    }

    #[getter]
    fn messages(&self) -> u64 {
        self.inner.messages
    }

    fn __repr__(&self) -> String {
        let t = &self.inner;
        format!("Topic({:?}, {:?}, messages={})", t.name, t.message_type, t.messages)
    }
}

struct Reading {
    sweeps: esm_io::Sweeps,
    /// Whether the warnings of the end have been given.
    told: bool,
}

/// The sweeps of a recording, one after the other.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Sweeps {
    path: PathBuf,
    inner: Arc<Mutex<Reading>>,
}

impl Sweeps {
    fn with<T: Send + 'static>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Reading) -> Result<T, esm_io::Error> + Send + 'static,
    ) -> PyResult<T> {
        let inner = Arc::clone(&self.inner);
        run(py, Threads::default(), move || f(&mut inner.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

#[pymethods]
impl Sweeps {
    fn __iter__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __next__(&self, py: Python<'_>) -> PyResult<Option<Sweep>> {
        let (sweep, warnings) = self.with(py, |reading| {
            let sweep = reading.sweeps.next().transpose()?;
            let end = sweep.is_none() && !std::mem::replace(&mut reading.told, sweep.is_none());
            let warnings = if end { texts(reading.sweeps.warnings()) } else { Vec::new() };
            Ok((sweep, warnings))
        })?;
        if !warnings.is_empty() {
            let class = py.import("esm_py.errors")?.getattr("RecordingWarning")?.cast_into::<PyType>()?;
            let warn = py.import("warnings")?.getattr("warn")?;
            for text in warnings {
                warn.call1((text, &class, 2))?;
            }
        }
        Ok(sweep.map(Sweep::new))
    }

    #[getter]
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |reading| Ok(texts(reading.sweeps.warnings())))
    }

    #[getter]
    fn damage(&self, py: Python<'_>) -> PyResult<Option<Damage>> {
        self.with(py, |reading| Ok(reading.sweeps.damage().map(|d| Damage { inner: d.clone() })))
    }

    fn __repr__(&self) -> String {
        format!("<sweeps of {:?}>", self.path.display().to_string())
    }
}

fn texts(warnings: &[esm_io::Warning]) -> Vec<String> {
    warnings.iter().map(ToString::to_string).collect()
}

/// What a damaged recording has lost.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Damage {
    inner: esm_io::Damage,
}

fn count(lost: Lost) -> (u64, bool) {
    match lost {
        Lost::Exactly(n) => (n, true),
        Lost::AtLeast(n) => (n, false),
    }
}

#[pymethods]
impl Damage {
    #[getter]
    fn lost(&self) -> u64 {
        count(self.inner.lost).0
    }

    #[getter]
    fn lost_clouds(&self) -> u64 {
        count(self.inner.lost_clouds).0
    }

    #[getter]
    fn is_exact(&self) -> bool {
        count(self.inner.lost).1 && count(self.inner.lost_clouds).1
    }

    #[getter]
    fn places(&self) -> Vec<String> {
        self.inner.places.clone()
    }

    #[getter]
    fn more_places(&self) -> usize {
        self.inner.more_places
    }

    fn __str__(&self) -> String {
        self.inner.to_string()
    }

    fn __repr__(&self) -> String {
        let exact = if self.is_exact() { "True" } else { "False" };
        format!(
            "Damage(lost={}, lost_clouds={}, is_exact={exact}, places={:?})",
            self.lost(),
            self.lost_clouds(),
            self.inner.places
        )
    }
}

/// One sweep.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Sweep {
    pub(crate) inner: Arc<esm_io::Sweep>,
    kept: [Kept; 4],
}

impl Sweep {
    fn new(sweep: esm_io::Sweep) -> Self {
        Self { inner: Arc::new(sweep), kept: Default::default() }
    }

    /// Labels, where the recording was opened with them and has them.
    fn labels<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        kept: &Kept,
        of: impl Fn(&esm_io::PointLabel) -> T,
    ) -> PyResult<Option<Py<PyAny>>> {
        let (labels, points) = (&self.inner.labels, self.inner.cloud.len());
        let known = labels.len() == points && points > 0;
        known.then(|| kept.get(py, || Ok(row(py, labels.iter().map(of).collect())))).transpose()
    }
}

#[pymethods]
impl Sweep {
    #[getter]
    fn number(&self) -> usize {
        self.inner.number
    }

    #[getter]
    fn stamp(&self) -> f64 {
        self.inner.stamp
    }

    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.inner.stamp_ns
    }

    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || rows3(py, self.inner.cloud.points().to_vec()))
    }

    #[getter]
    fn pose_odom_sensor(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let pose = self.inner.pose_odom_sensor.as_ref();
        pose.map(|p| self.kept[1].get(py, || pose::write(py, p))).transpose()
    }

    #[getter]
    fn frame_id(&self) -> &str {
        &self.inner.frame_id
    }

    #[getter]
    fn dropped(&self) -> usize {
        self.inner.dropped
    }

    #[getter]
    fn objects(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        self.labels(py, &self.kept[2], |l| l.object)
    }

    #[getter]
    fn classes(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        self.labels(py, &self.kept[3], |l| l.class)
    }

    fn __len__(&self) -> usize {
        self.inner.cloud.len()
    }

    fn __repr__(&self) -> String {
        let s = &self.inner;
        let pose = if s.pose_odom_sensor.is_some() { "known" } else { "None" };
        format!(
            "Sweep(number={}, stamp={:.6}, points={}, pose_odom_sensor={pose})",
            s.number,
            s.stamp,
            s.cloud.len()
        )
    }
}

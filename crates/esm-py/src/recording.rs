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

/// An opened recording: one `.mcap`, a directory of scans, or a single scan. Iterating over it reads its sweeps.
///
/// `cloud_topic` and `motion_topic` choose where several topics are of a kind; `poses` is a TUM or KITTI file that gives the
/// sensor's pose at each sweep instead of a topic; `labels` reads what each point was hit on, as simulators tell it.
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
        let options = OpenOptions { cloud_topic, motion_topic, poses, labels, rings: false };
        let inner = run(py, Threads::default(), move || esm_io::Recording::open(path, &options))?;
        Ok(Self { inner: Arc::new(inner) })
    }

    /// The file or directory.
    #[getter]
    fn path(&self) -> PathBuf {
        self.inner.path().to_owned()
    }

    /// The topic the clouds are read from.
    #[getter]
    fn cloud_topic(&self) -> Option<&str> {
        self.inner.cloud_topic()
    }

    /// The topic the motion is read from.
    #[getter]
    fn motion_topic(&self) -> Option<&str> {
        self.inner.motion_topic()
    }

    /// Whether there is a source of motion: a topic or a file of poses.
    #[getter]
    fn has_motion(&self) -> bool {
        self.inner.has_motion()
    }

    /// How many sweeps there are as far as the file tells without reading the clouds.
    #[getter]
    fn sweep_count_hint(&self) -> Option<usize> {
        self.inner.sweep_count_hint()
    }

    /// All topics by name; none for a directory.
    #[getter]
    fn topics(&self) -> Vec<Topic> {
        self.inner.topics().into_iter().map(|inner| Topic { inner }).collect()
    }

    /// Start reading at the first sweep, independently of other readings.
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
    /// Its name, such as `/velodyne_points`.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Its message type, such as `sensor_msgs/msg/PointCloud2`.
    #[getter]
    fn message_type(&self) -> &str {
        &self.inner.message_type
    }

    /// Number of messages (intact ones where the recording is damaged).
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

/// The sweeps of a recording in the order of the file, in constant memory. After an error it ends.
///
/// What was not as it should be is warned of once the end is reached (`RecordingWarning`).
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
                warn.call1((text, &class))?;
            }
        }
        Ok(sweep.map(Sweep::new))
    }

    /// What was not as it should be, in words; complete once the iteration has ended.
    #[getter]
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.with(py, |reading| Ok(texts(reading.sweeps.warnings())))
    }

    /// What is missing of a damaged recording, once the iteration has ended.
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

/// A recording from which something is missing. Every intact message was used all the same.
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
    /// Missing messages of all topics, at least.
    #[getter]
    fn lost(&self) -> u64 {
        count(self.inner.lost).0
    }

    /// Missing clouds, at least.
    #[getter]
    fn lost_clouds(&self) -> u64 {
        count(self.inner.lost_clouds).0
    }

    /// Whether not more are missing, as far as the file tells.
    #[getter]
    fn is_exact(&self) -> bool {
        count(self.inner.lost).1 && count(self.inner.lost_clouds).1
    }

    /// Where and what, in the order of the file: the first few places.
    #[getter]
    fn places(&self) -> Vec<String> {
        self.inner.places.clone()
    }

    /// Number of further places.
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

/// One sweep of a recording.
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
    /// Its number among the recording's intact clouds, from 1.
    #[getter]
    fn number(&self) -> usize {
        self.inner.number
    }

    /// Time in seconds.
    #[getter]
    fn stamp(&self) -> f64 {
        self.inner.stamp
    }

    /// The same in nanoseconds, exact.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.inner.stamp_ns
    }

    /// Points, shape (N, 3), metres, sensor frame.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || rows3(py, self.inner.cloud.points().to_vec()))
    }

    /// Where the sensor is in the frame its motion is told in, shape (4, 4). Only differences mean anything.
    #[getter]
    fn pose_odom_sensor(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let pose = self.inner.pose_odom_sensor.as_ref();
        pose.map(|p| self.kept[1].get(py, || pose::write(py, p))).transpose()
    }

    /// The sensor frame's name, empty in directories.
    #[getter]
    fn frame_id(&self) -> &str {
        &self.inner.frame_id
    }

    /// Points left out: NaN, infinite, or exactly (0, 0, 0).
    #[getter]
    fn dropped(&self) -> usize {
        self.inner.dropped
    }

    /// The object each point was hit on, shape (N,), 0 for the ground, where labels were asked for and are there.
    #[getter]
    fn objects(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        self.labels(py, &self.kept[2], |l| l.object)
    }

    /// The class of that object (`CLASSES`), shape (N,), 255 where unknown.
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

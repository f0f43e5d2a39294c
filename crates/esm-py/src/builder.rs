//! [`MapBuilder`]: a map window by window, or from one prior cloud.

use std::sync::{Arc, Mutex, PoisonError};

use esm_core::Pose;
use esm_core::map as core;
use pyo3::prelude::*;

use crate::accumulate::LiveCloud;
use crate::config::{Config, or_default};
use crate::describe::{Descriptor, given};
use crate::failure::Failure;
use crate::input::{bad_value, cloud, position};
use crate::map::Map;
use crate::pose;
use crate::recording::Sweep;
use crate::threads::Threads;
use crate::work::run;

/// Builds a map window by window, or from one prior cloud. Its length is the number of segments so far.
///
/// `descriptor` takes the place of the configured one, such as an `XConv` with weights of your own.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct MapBuilder {
    inner: Arc<Mutex<core::MapBuilder>>,
    threads: Threads,
}

impl MapBuilder {
    fn with<T: Send + 'static>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut core::MapBuilder) -> Result<T, esm_core::Error> + Send + 'static,
    ) -> PyResult<T> {
        let inner = Arc::clone(&self.inner);
        run(py, self.threads, move || work(&mut inner.lock().unwrap_or_else(PoisonError::into_inner)))
    }
}

#[pymethods]
impl MapBuilder {
    #[new]
    #[pyo3(signature = (config=None, *, descriptor=None, threads=None))]
    fn new(
        config: Option<&Bound<'_, Config>>,
        descriptor: Option<&Bound<'_, Descriptor>>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let config = or_default(config);
        let inner = match given(descriptor) {
            Some(descriptor) => core::MapBuilder::with_descriptor(&config, descriptor),
            None => core::MapBuilder::new(&config),
        };
        let inner = inner.map_err(Failure::from)?;
        Ok(Self { inner: Arc::new(Mutex::new(inner)), threads: Threads::new(threads)? })
    }

    /// Name what the map is built from: a file name without its folder.
    fn set_source(&self, py: Python<'_>, source: String) -> PyResult<()> {
        self.with(py, move |builder| {
            builder.set_source(&source);
            Ok(())
        })
    }

    /// Take the next sweep of the recording and where it was taken: windows of all lengths are accumulated and pushed.
    ///
    /// `pose_map_sensor`: shape (4, 4); without it the odometry frame is the map frame, and the sweep's own
    /// `pose_odom_sensor` is taken.
    #[pyo3(signature = (sweep, pose_map_sensor=None))]
    fn push_sweep(
        &self,
        py: Python<'_>,
        sweep: &Bound<'_, Sweep>,
        pose_map_sensor: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let sweep = Arc::clone(&sweep.get().inner);
        let pose = pose_of(pose_map_sensor, sweep.pose_odom_sensor, "sweep")?;
        self.with(py, move |builder| builder.push_sweep(sweep.stamp, &sweep.cloud, &pose))
    }

    /// Tell that the next sweep does not continue the last one: another recording, or a gap.
    fn interrupt(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, core::MapBuilder::interrupt)
    }

    /// Take the next accumulated cloud of the recording and tell whether it was cut into segments.
    ///
    /// Only one every `map.window_step_m` is, of shorter ones than `accumulate.distance_m` one every `map.short_step_m`;
    /// all count for the path. `pose_map_sensor`: as for `push_sweep`.
    #[pyo3(signature = (live, pose_map_sensor=None))]
    fn push(
        &self,
        py: Python<'_>,
        live: &Bound<'_, LiveCloud>,
        pose_map_sensor: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<bool> {
        let live = Arc::clone(&live.get().inner);
        let pose = pose_of(pose_map_sensor, live.pose_odom_sensor, "cloud")?;
        self.with(py, move |builder| builder.push(&live, &pose))
    }

    /// Take one prior cloud: `points`, shape (N, 3), metres, relative to `origin`, shape (3,), metres, map frame.
    fn push_prior_cloud(
        &self,
        py: Python<'_>,
        origin: &Bound<'_, PyAny>,
        points: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let (origin, cloud) = (position(origin, "origin")?, cloud(points, "points")?);
        self.with(py, move |builder| builder.push_prior_cloud(origin, &cloud))
    }

    /// Give the map as it stands.
    fn finish(&self, py: Python<'_>) -> PyResult<Map> {
        self.with(py, |builder| builder.finish()).map(|map| Map::new(Arc::new(map)))
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |builder| Ok(builder.len()))
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("MapBuilder(segments={})", self.__len__(py)?))
    }
}

/// Where it was taken, as told or by its own odometry.
fn pose_of(given: Option<&Bound<'_, PyAny>>, own: Option<Pose>, what: &str) -> PyResult<Pose> {
    pose::read_option(given, "pose_map_sensor")?.or(own).ok_or_else(|| {
        let missing = format!("is missing: this {what} has no pose_odom_sensor to stand for it");
        bad_value("pose_map_sensor", missing)
    })
}

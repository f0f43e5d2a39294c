//! [`Accumulator`]: sweeps and their motion to live clouds.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use pyo3::prelude::*;

use crate::config::{Config, or_default};
use crate::failure::Failure;
use crate::input::{bad_value, cloud};
use crate::output::{Kept, rows3};
use crate::pose;
use crate::recording::Sweep;
use crate::threads::Threads;
use crate::work::run;

/// A cloud ready to be localized: an accumulator gives them, or you make one of points you have put together.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct LiveCloud {
    pub(crate) inner: Arc<esm_core::LiveCloud>,
    kept: [Kept; 2],
}

impl LiveCloud {
    fn from_core(live: esm_core::LiveCloud) -> Self {
        Self { inner: Arc::new(live), kept: Default::default() }
    }
}

#[pymethods]
impl LiveCloud {
    #[new]
    #[pyo3(signature = (stamp, points, pose_odom_sensor=None, *, travel_m=0.0, sweeps=1))]
    fn new(
        stamp: f64,
        points: &Bound<'_, PyAny>,
        pose_odom_sensor: Option<&Bound<'_, PyAny>>,
        travel_m: f64,
        sweeps: usize,
    ) -> PyResult<Self> {
        let cloud = cloud(points, "points")?;
        let pose_odom_sensor = pose::read_option(pose_odom_sensor, "pose_odom_sensor")?;
        check_stamp(stamp)?;
        if !(travel_m >= 0.0 && travel_m.is_finite()) {
            return Err(bad_value("travel_m", format!("must be 0 m or more, got {travel_m}")));
        }
        let elapsed = Duration::ZERO;
        Ok(Self::from_core(esm_core::LiveCloud {
            stamp,
            cloud,
            pose_odom_sensor,
            distance_m: travel_m,
            travel_m,
            sweeps,
            viewpoints: Vec::new(),
            elapsed,
        }))
    }

    /// Seconds, of the newest sweep.
    #[getter]
    fn stamp(&self) -> f64 {
        self.inner.stamp
    }

    /// Points, shape (N, 3), metres, newest sensor frame.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || rows3(py, self.inner.cloud.points().to_vec()))
    }

    /// Pose of the newest sensor in the odometry frame, shape (4, 4), where the motion is known.
    #[getter]
    fn pose_odom_sensor(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        let pose = self.inner.pose_odom_sensor.as_ref();
        pose.map(|p| self.kept[1].get(py, || pose::write(py, p))).transpose()
    }

    /// Metres of travel the cloud really holds.
    #[getter]
    fn travel_m(&self) -> f64 {
        self.inner.travel_m
    }

    /// Sweeps in the cloud.
    #[getter]
    fn sweeps(&self) -> usize {
        self.inner.sweeps
    }

    /// Seconds it took to put together.
    #[getter]
    fn elapsed_s(&self) -> f64 {
        self.inner.elapsed.as_secs_f64()
    }

    fn __len__(&self) -> usize {
        self.inner.cloud.len()
    }

    fn __repr__(&self) -> String {
        let l = &self.inner;
        format!(
            "LiveCloud(stamp={:.6}, points={}, travel_m={:.2}, sweeps={})",
            l.stamp,
            l.cloud.len(),
            l.travel_m,
            l.sweeps
        )
    }
}

pub(crate) fn check_stamp(stamp: f64) -> PyResult<()> {
    if stamp.is_finite() { Ok(()) } else { Err(bad_value("stamp", format!("must be finite, got {stamp}"))) }
}

/// Feeds on sweeps, one after the other, and gives live clouds. Memory is bounded by the distance they hold.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Accumulator {
    inner: Arc<Mutex<esm_core::Accumulator>>,
    config: Arc<esm_core::Config>,
}

#[pymethods]
impl Accumulator {
    #[new]
    #[pyo3(signature = (config=None))]
    fn new(config: Option<&Bound<'_, Config>>) -> PyResult<Self> {
        let config = or_default(config);
        let inner = esm_core::Accumulator::new(config.accumulate.clone()).map_err(Failure::from)?;
        Ok(Self { inner: Arc::new(Mutex::new(inner)), config })
    }

    /// Take the next sweep and give the live cloud that ends with it; with swathes only once every `distance_m`.
    ///
    /// `stamp`: seconds. `points`: shape (N, 3), metres, sensor frame, finite. `pose_odom_sensor`: shape (4, 4); a sweep
    /// without one is a cloud of its own and is not kept.
    #[pyo3(signature = (stamp, points, pose_odom_sensor=None))]
    fn push(
        &self,
        py: Python<'_>,
        stamp: f64,
        points: &Bound<'_, PyAny>,
        pose_odom_sensor: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<LiveCloud>> {
        check_stamp(stamp)?;
        let sweep = cloud(points, "points")?;
        let pose = pose::read_option(pose_odom_sensor, "pose_odom_sensor")?;
        self.with(py, move |inner| inner.push(stamp, &sweep, pose))
    }

    /// Take the next sweep of a recording, its pose to the last bit.
    fn push_sweep(&self, py: Python<'_>, sweep: &Bound<'_, Sweep>) -> PyResult<Option<LiveCloud>> {
        let sweep = Arc::clone(&sweep.get().inner);
        self.with(py, move |inner| inner.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor))
    }

    fn __repr__(&self) -> String {
        let a = &self.config.accumulate;
        let swathes = if a.swathes { "True" } else { "False" };
        format!("Accumulator(distance_m={}, swathes={swathes})", a.distance_m)
    }
}

impl Accumulator {
    fn with(
        &self,
        py: Python<'_>,
        push: impl FnOnce(&mut esm_core::Accumulator) -> Option<esm_core::LiveCloud> + Send + 'static,
    ) -> PyResult<Option<LiveCloud>> {
        let inner = Arc::clone(&self.inner);
        let live = run(py, Threads::default(), move || {
            Ok::<_, Failure>(push(&mut inner.lock().unwrap_or_else(PoisonError::into_inner)))
        })?;
        Ok(live.map(LiveCloud::from_core))
    }
}

//! [`Localizer`]: live clouds in a prior map, and what it answers.

use std::sync::Arc;

use esm_core::{self as core, Verdict};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::accumulate::LiveCloud;
use crate::config::{Config, or_default};
use crate::describe::{Descriptor, given};
use crate::map::Map;
use crate::output::{Kept, fixed_row, table};
use crate::pose::fixed_option;
use crate::threads::Threads;
use crate::work::run;

/// Finds live clouds in a prior map. Every cloud stands for itself: nothing is kept from one to the next.
///
/// `config.descriptor` must be the map's (`map.descriptor_info`); `descriptor` takes the place of the configured one.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Localizer {
    inner: Arc<core::Localizer>,
    threads: Threads,
}

impl Localizer {
    pub(crate) fn core(&self) -> Arc<core::Localizer> {
        Arc::clone(&self.inner)
    }
}

#[pymethods]
impl Localizer {
    #[new]
    #[pyo3(signature = (map, config=None, *, descriptor=None, threads=None))]
    fn new(
        py: Python<'_>,
        map: &Bound<'_, Map>,
        config: Option<&Bound<'_, Config>>,
        descriptor: Option<&Bound<'_, Descriptor>>,
        threads: Option<usize>,
    ) -> PyResult<Self> {
        let (map, config, threads) =
            (Arc::clone(&map.get().inner), or_default(config), Threads::new(threads)?);
        let descriptor = given(descriptor);
        let inner = run(py, threads, move || match descriptor {
            Some(descriptor) => core::Localizer::with_descriptor(map, &config, descriptor),
            None => core::Localizer::new(map, &config),
        })?;
        Ok(Self { inner: Arc::new(inner), threads })
    }

    /// The map in use.
    #[getter]
    fn map(&self) -> Map {
        Map::new(Arc::clone(self.inner.map()))
    }

    /// Find the cloud in the map: segment, describe, match, estimate, verify.
    fn localize(&self, py: Python<'_>, live: &Bound<'_, LiveCloud>) -> PyResult<Localization> {
        let (localizer, live) = (Arc::clone(&self.inner), Arc::clone(&live.get().inner));
        run(py, self.threads, move || localizer.localize(&live)).map(Localization::new)
    }

    fn __repr__(&self) -> String {
        let map = self.inner.map();
        format!("Localizer(segments={}, descriptor={:?})", map.len(), map.descriptor_info().name)
    }
}

/// The answer for one cloud.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Localization {
    inner: core::Localization,
    covariance: Kept,
}

impl Localization {
    pub(crate) fn new(inner: core::Localization) -> Self {
        Self { inner, covariance: Kept::default() }
    }
}

/// A covariance of a pose, shape (6, 6).
pub(crate) fn covariance(py: Python<'_>, kept: &Kept, c: Option<&[f64; 36]>) -> PyResult<Option<Py<PyAny>>> {
    c.map(|c| kept.get(py, || table(py, c.to_vec(), 6))).transpose()
}

#[pymethods]
impl Localization {
    /// Seconds, of the newest sweep in the cloud.
    #[getter]
    fn stamp(&self) -> f64 {
        self.inner.stamp
    }

    /// Whether the pose is to be trusted.
    #[getter]
    fn verdict(&self) -> &'static str {
        self.inner.verdict.as_str()
    }

    /// Whether the verdict is `located`.
    #[getter]
    fn located(&self) -> bool {
        self.inner.verdict == Verdict::Located
    }

    /// Why the cloud was not located.
    #[getter]
    fn reason(&self) -> Option<&str> {
        self.inner.reason.as_deref()
    }

    /// Pose of the newest sensor frame in the map, shape (4, 4); where the verdict is `ambiguous` it is a guess.
    #[getter]
    fn pose_map_sensor(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        fixed_option(py, self.inner.pose_map_sensor.as_ref())
    }

    /// Shape (6, 6), order x y z rx ry rz in m and rad: of a right perturbation in the sensor frame.
    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        covariance(py, &self.covariance, self.inner.covariance.as_ref())
    }

    /// Metres of travel the cloud holds.
    #[getter]
    fn travel_m(&self) -> f64 {
        self.inner.travel_m
    }

    /// Segments cut from the cloud.
    #[getter]
    fn segments(&self) -> usize {
        self.inner.segments
    }

    /// Segments described for this answer.
    #[getter]
    fn described(&self) -> usize {
        self.inner.described
    }

    /// Matched segments that agree with the pose, at most one a live segment.
    #[getter]
    fn inliers(&self) -> usize {
        self.inner.inliers
    }

    /// How well the best place explains the cloud: inliers weighted by the share of points found in the map.
    #[getter]
    fn score(&self) -> f64 {
        self.inner.score
    }

    /// Share of the live points above the ground, where the map has been seen, that lie on what stands there.
    #[getter]
    fn overlap(&self) -> f64 {
        self.inner.overlap
    }

    /// Share of the live points above the ground that lie where the map has been seen.
    #[getter]
    fn seen(&self) -> f64 {
        self.inner.seen
    }

    /// Share of the live rays that pass through what the map holds as solid, well before they reach what they saw.
    #[getter]
    fn free_space_violated(&self) -> f64 {
        self.inner.free_space_violated
    }

    /// The score of the best other place, 0 where there is none.
    #[getter]
    fn runner_up(&self) -> f64 {
        self.inner.runner_up
    }

    /// The pose of that other place, shape (4, 4).
    #[getter]
    fn runner_up_pose_map_sensor(&self, py: Python<'_>) -> PyResult<Option<Py<PyAny>>> {
        fixed_option(py, self.inner.runner_up_pose_map_sensor.as_ref())
    }

    /// The matches behind `inliers`.
    #[getter]
    fn matches(&self) -> Vec<MatchedSegment> {
        self.inner.matches.iter().map(|m| MatchedSegment { inner: *m }).collect()
    }

    /// Seconds by stage, in the order of the pipeline.
    #[getter]
    fn timings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let timings = PyDict::new(py);
        for (stage, time) in self.inner.timings.stages() {
            timings.set_item(stage, time.as_secs_f64())?;
        }
        Ok(timings)
    }

    fn __repr__(&self) -> String {
        let l = &self.inner;
        let place = l.pose_map_sensor.map_or_else(
            || "pose_map_sensor=None".to_owned(),
            |p| {
                let (t, yaw) = (p.translation.vector, p.rotation.euler_angles().2.to_degrees());
                format!("at=[{:.2}, {:.2}, {:.2}], yaw_deg={yaw:.1}", t.x, t.y, t.z)
            },
        );
        format!(
            "Localization(stamp={:.6}, verdict={:?}, {place}, inliers={}, score={:.2}, runner_up={:.2})",
            l.stamp,
            l.verdict.as_str(),
            l.inliers,
            l.score,
            l.runner_up
        )
    }
}

/// One live segment and the map segment it was matched with.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct MatchedSegment {
    inner: core::MatchedSegment,
}

#[pymethods]
impl MatchedSegment {
    /// Index of the live segment.
    #[getter]
    fn live(&self) -> usize {
        self.inner.live
    }

    /// Index of the map segment.
    #[getter]
    fn map(&self) -> usize {
        self.inner.map
    }

    /// Centroid of the live segment, shape (3,), metres, sensor frame.
    #[getter]
    fn live_centroid_sensor(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.live_centroid_sensor)
    }

    /// Centroid of the map segment, shape (3,), metres, map frame.
    #[getter]
    fn map_centroid_map(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.map_centroid_map)
    }

    fn __repr__(&self) -> String {
        format!("MatchedSegment(live={}, map={})", self.inner.live, self.inner.map)
    }
}

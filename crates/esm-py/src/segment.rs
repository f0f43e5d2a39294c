//! [`segment`]: clouds into segments, and its steps one by one.

use std::sync::Arc;

use esm_core::segment as core;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyTuple;

use crate::config::{Config, or_default};
use crate::failure::Failure;
use crate::input::{bad_value, cloud};
use crate::output::{Kept, fixed_row, row, rows3};
use crate::threads::Threads;
use crate::work::run;

/// One segment: a connected group of points above the ground, in the frame of the cloud it was cut from.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Segment {
    pub(crate) inner: Arc<core::Segment>,
    points: Kept,
}

impl Segment {
    fn from_core(segment: core::Segment) -> Self {
        Self { inner: Arc::new(segment), points: Kept::default() }
    }
}

#[pymethods]
impl Segment {
    #[new]
    fn new(points: &Bound<'_, PyAny>) -> PyResult<Self> {
        let segment = core::Segment::from_points(cloud(points, "points")?.into_points());
        segment.map(Self::from_core).ok_or_else(|| bad_value("points", "must hold at least one point"))
    }

    /// Points, shape (N, 3), metres.
    #[getter]
    fn points(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.points.get(py, || rows3(py, self.inner.points.clone()))
    }

    /// Mean of the points, shape (3,), metres.
    #[getter]
    fn centroid(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.centroid)
    }

    /// Lower corner of the axis-aligned box, shape (3,), metres.
    #[getter]
    fn min(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.min)
    }

    /// Upper corner of the axis-aligned box, shape (3,), metres.
    #[getter]
    fn max(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.max)
    }

    fn __len__(&self) -> usize {
        self.inner.points.len()
    }

    fn __repr__(&self) -> String {
        let [x, y, z] = self.inner.centroid;
        format!("Segment(points={}, centroid=[{x:.2}, {y:.2}, {z:.2}])", self.inner.points.len())
    }
}

/// What `segment` made of a cloud.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Segmentation {
    pub(crate) inner: Arc<core::Segmentation>,
    segments: PyOnceLock<Py<PyTuple>>,
    kept: [Kept; 2],
}

#[pymethods]
impl Segmentation {
    /// The segments, ordered by their first point in the order of voxels (z, then y, then x).
    #[getter]
    fn segments(&self, py: Python<'_>) -> PyResult<Py<PyTuple>> {
        let made = self.segments.get_or_try_init(py, || {
            let all = self.inner.segments.iter().map(|s| Segment::from_core(s.clone()));
            let all = all.map(|s| Py::new(py, s)).collect::<PyResult<Vec<_>>>()?;
            PyTuple::new(py, all).map(Bound::unbind)
        });
        made.map(|t| t.clone_ref(py))
    }

    /// The ground points of the voxelled cloud, shape (N, 3), metres.
    #[getter]
    fn ground(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || rows3(py, self.inner.ground.clone()))
    }

    /// All that stands on the ground, in a segment or not, shape (N, 3), metres.
    #[getter]
    fn structure(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[1].get(py, || rows3(py, self.inner.structure.clone()))
    }

    /// Points of the voxelled cloud, ground and small clusters included.
    #[getter]
    fn voxelled(&self) -> usize {
        self.inner.voxelled
    }

    fn __len__(&self) -> usize {
        self.inner.segments.len()
    }

    fn __repr__(&self) -> String {
        let s = &self.inner;
        format!(
            "Segmentation(segments={}, ground={}, structure={}, voxelled={})",
            s.segments.len(),
            s.ground.len(),
            s.structure.len(),
            s.voxelled
        )
    }
}

/// Cut a cloud into segments: thin it by voxels, remove the ground, cluster the rest.
///
/// `points`: shape (N, 3), metres, finite, a frame with z up to within some ten degrees. The result does not depend on their
/// order.
#[pyfunction]
#[pyo3(signature = (points, config=None, *, threads=None))]
pub(crate) fn segment(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    config: Option<&Bound<'_, Config>>,
    threads: Option<usize>,
) -> PyResult<Segmentation> {
    let (cloud, config) = (cloud(points, "points")?, or_default(config));
    let inner =
        run(py, Threads::new(threads)?, move || Ok::<_, Failure>(core::segment(&cloud, &config.segment)))?;
    Ok(Segmentation { inner: Arc::new(inner), segments: PyOnceLock::new(), kept: Default::default() })
}

/// Replace the points of each voxel of `segment.voxel` metres by their centroid: shape (N, 3) to (M, 3).
#[pyfunction]
#[pyo3(signature = (points, config=None, *, threads=None))]
pub(crate) fn voxel_filter<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    config: Option<&Bound<'py, Config>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let (cloud, config) = (cloud(points, "points")?, or_default(config));
    let thinned = run(py, Threads::new(threads)?, move || {
        Ok::<_, Failure>(core::voxel_filter(cloud.points(), config.segment.voxel))
    })?;
    rows3(py, thinned)
}

/// Tell for each point, shape (N, 3), whether it is ground (`segment.ground`): shape (N,).
#[pyfunction]
#[pyo3(signature = (points, config=None, *, threads=None))]
pub(crate) fn ground_flags<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    config: Option<&Bound<'py, Config>>,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let (cloud, config) = (cloud(points, "points")?, or_default(config));
    let flags = run(py, Threads::new(threads)?, move || {
        Ok::<_, Failure>(core::ground_flags(cloud.points(), &config.segment.ground))
    })?;
    Ok(row(py, flags))
}

/// Group points, shape (N, 3), that are linked by steps of up to `segment.tolerance` metres.
///
/// Gives the indices of each group that has `segment.min_points` to `segment.max_points` of them.
#[pyfunction]
#[pyo3(signature = (points, config=None, *, threads=None))]
pub(crate) fn euclidean_clusters<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    config: Option<&Bound<'py, Config>>,
    threads: Option<usize>,
) -> PyResult<Vec<Bound<'py, PyArray1<u32>>>> {
    let (cloud, config) = (cloud(points, "points")?, or_default(config));
    let clusters = run(py, Threads::new(threads)?, move || {
        let c = &config.segment;
        Ok::<_, Failure>(core::euclidean_clusters(cloud.points(), c.tolerance, c.min_points, c.max_points))
    })?;
    Ok(clusters.into_iter().map(|c| row(py, c)).collect())
}

/// The argument `segments`: a segmentation, or a sequence of segments.
pub(crate) enum Segments {
    Whole(Arc<core::Segmentation>),
    List(Vec<core::Segment>),
}

impl Segments {
    pub(crate) fn read(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        if let Ok(whole) = value.cast::<Segmentation>() {
            return Ok(Self::Whole(Arc::clone(&whole.get().inner)));
        }
        let refused = |found: &Bound<'_, PyAny>| {
            let found = found.get_type();
            PyTypeError::new_err(format!(
                "segments must be a Segmentation or a sequence of Segment, got {found}"
            ))
        };
        let mut list = Vec::new();
        for item in value.try_iter().map_err(|_| refused(value))? {
            let item = item?;
            let segment = item.cast::<Segment>().map_err(|_| refused(&item))?;
            list.push((*segment.get().inner).clone());
        }
        Ok(Self::List(list))
    }

    pub(crate) fn as_slice(&self) -> &[core::Segment] {
        match self {
            Self::Whole(whole) => &whole.segments,
            Self::List(list) => list,
        }
    }
}

//! [`segment`]: clouds into segments, and its steps one by one.

use std::sync::Arc;

use esm_core::PointCloud;
use esm_core::segment as core;
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyTuple;

use crate::config::{Config, or_default};
use crate::failure::Failure;
use crate::input::{bad_value, cloud, exactly, integers};
use crate::output::{Kept, fixed, fixed_row, row, rows3, table};
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
    #[pyo3(signature = (points, *, above_ground=None, rings=None))]
    fn new(
        points: &Bound<'_, PyAny>,
        above_ground: Option<f32>,
        rings: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let segment = core::Segment::from_points(cloud(points, "points")?.into_points());
        let mut segment = segment.ok_or_else(|| bad_value("points", "must hold at least one point"))?;
        let rings = rings.map(|r| rings_in(r, "rings")).transpose()?.unwrap_or_default();
        segment.context = core::Context { above_ground: above_ground.filter(|h| !h.is_nan()), rings };
        Ok(Self::from_core(segment))
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

    /// Height of the lowest point above the ground around it, metres; None where that is not known.
    #[getter]
    fn above_ground(&self) -> Option<f32> {
        self.inner.context.above_ground
    }

    /// What stands around it in its cloud, shape (7, 4): of each ring, the same numbers whatever the heading.
    #[getter]
    fn rings(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        rings_out(py, &self.inner.context)
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

/// Segments of clusters of `points`, each with what stands around it among all of them.
///
/// `points`: shape (N, 3), metres, all that stands on the ground. `clusters`: arrays of their indices. `ground`: the
/// ground points of the same cloud.
#[pyfunction]
#[pyo3(signature = (points, clusters, ground=None, *, threads=None))]
pub(crate) fn segments_of(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    clusters: Vec<Bound<'_, PyAny>>,
    ground: Option<&Bound<'_, PyAny>>,
    threads: Option<usize>,
) -> PyResult<Vec<Segment>> {
    let points = cloud(points, "points")?.into_points();
    let ground =
        ground.map(|g| cloud(g, "ground")).transpose()?.map_or_else(Vec::new, PointCloud::into_points);
    let read = |c: &Bound<'_, PyAny>| -> PyResult<Vec<u32>> {
        let indices = integers::<u32>(c, "clusters")?;
        match indices.iter().find(|i| **i as usize >= points.len()) {
            Some(i) => Err(bad_value("clusters", format!("name point {i} of {}", points.len()))),
            None => Ok(indices),
        }
    };
    let clusters = clusters.iter().map(read).collect::<PyResult<Vec<_>>>()?;
    let made = run(py, Threads::new(threads)?, move || {
        Ok::<_, Failure>(core::segments_of(&points, &ground, &clusters))
    })?;
    Ok(made.into_iter().map(Segment::from_core).collect())
}

/// What stands around a segment, as an array of shape (7, 4).
pub(crate) fn rings_out(py: Python<'_>, context: &core::Context) -> PyResult<Py<PyAny>> {
    Ok(fixed(table(py, context.rings.as_flattened().to_vec(), core::RING_NUMBERS)?)?.unbind())
}

/// The same from an array.
pub(crate) fn rings_in(
    value: &Bound<'_, PyAny>,
    name: &str,
) -> PyResult<[[f32; core::RING_NUMBERS]; core::RINGS]> {
    let values = exactly(value, name, &[core::RINGS, core::RING_NUMBERS])?;
    if values.iter().any(|v| !v.is_finite()) {
        return Err(bad_value(name, "must be finite"));
    }
    let at = |ring, n| values[ring * core::RING_NUMBERS + n] as f32;
    Ok(std::array::from_fn(|ring| std::array::from_fn(|n| at(ring, n))))
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

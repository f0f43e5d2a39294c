//! Matching: nearest descriptors, candidate matches, and the places they agree on.

use std::sync::Arc;

use esm_core::estimate::{self, Candidate};
use esm_core::index::{self, Search};
use esm_core::matching;
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::config::{Config, or_default};
use crate::describe::Descriptions;
use crate::failure::Failure;
use crate::input::{bad_value, table};
use crate::map::Map;
use crate::output::{self, Kept, row, rows3};
use crate::pose::fixed_pose;
use crate::segment::Segments;
use crate::threads::Threads;
use crate::work::run;

/// Rows and distances of neighbours, each of shape (M, k).
type Neighbours<'py> = (Bound<'py, PyArray2<u32>>, Bound<'py, PyArray2<f32>>);

/// An index over descriptors, shape (N, dim): by k-d tree, by matrix product, or the faster of the two.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Index {
    inner: Arc<index::Index>,
    rows: usize,
    dim: usize,
}

#[pymethods]
impl Index {
    #[new]
    #[pyo3(signature = (descriptors, search="auto"))]
    fn new(py: Python<'_>, descriptors: &Bound<'_, PyAny>, search: &str) -> PyResult<Self> {
        let search = match search {
            "auto" => Search::Auto,
            "tree" => Search::Tree,
            "product" => Search::Product,
            other => {
                return Err(PyValueError::new_err(format!(
                    "search must be auto, tree or product, not {other:?}"
                )));
            }
        };
        let table = table(descriptors, "descriptors", None)?;
        let (rows, dim) = (table.rows, table.columns);
        if rows == 0 {
            return Err(bad_value("descriptors", "must hold at least one row"));
        }
        let inner = run(py, Threads::default(), move || {
            Ok::<_, Failure>(index::Index::new(&table.values, dim, search))
        })?;
        Ok(Self { inner: Arc::new(inner), rows, dim })
    }

    /// Find for every query, shape (M, dim), the k nearest rows: their numbers and squared L2 distances.
    ///
    /// Both have shape (M, k), nearest first, k at most the number of rows.
    #[pyo3(signature = (queries, k, *, threads=None))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        queries: &Bound<'py, PyAny>,
        k: usize,
        threads: Option<usize>,
    ) -> PyResult<Neighbours<'py>> {
        let queries = table(queries, "queries", Some(self.dim))?;
        if k == 0 {
            return Err(bad_value("k", "must be at least 1"));
        }
        let (index, k) = (Arc::clone(&self.inner), k.min(self.rows));
        let (rows, distances) = run(py, Threads::new(threads)?, move || {
            let found = index.nearest(&queries.values, k);
            let flat = || found.iter().flatten();
            let parts = (flat().map(|n| n.row).collect(), flat().map(|n| n.distance).collect());
            Ok::<(Vec<u32>, Vec<f32>), Failure>(parts)
        })?;
        Ok((output::table(py, rows, k)?, output::table(py, distances, k)?))
    }

    /// Which of the two it is.
    #[getter]
    fn kind(&self) -> &'static str {
        match &*self.inner {
            index::Index::Tree(_) => "tree",
            index::Index::Product(_) => "product",
        }
    }

    fn __len__(&self) -> usize {
        self.rows
    }

    fn __repr__(&self) -> String {
        format!("Index(rows={}, dim={}, kind={:?})", self.rows, self.dim, self.kind())
    }
}

/// Candidate matches of a cloud, best first: a live segment, a map segment it may be, and how good that looks.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Candidates {
    inner: Arc<Vec<Candidate>>,
    kept: [Kept; 6],
}

impl Candidates {
    fn column<T: numpy::Element>(
        &self,
        py: Python<'_>,
        kept: usize,
        of: impl Fn(&Candidate) -> T,
    ) -> PyResult<Py<PyAny>> {
        self.kept[kept].get(py, || Ok(row(py, self.inner.iter().map(of).collect())))
    }

    fn centroids(
        &self,
        py: Python<'_>,
        kept: usize,
        of: impl Fn(&Candidate) -> [f32; 3],
    ) -> PyResult<Py<PyAny>> {
        self.kept[kept].get(py, || rows3(py, self.inner.iter().map(of).collect()))
    }
}

#[pymethods]
impl Candidates {
    /// Index of the live segment, shape (C,).
    #[getter]
    fn live(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, 0, |c| c.live)
    }

    /// Index of the map segment, shape (C,).
    #[getter]
    fn map(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, 1, |c| c.map)
    }

    /// Squared L2 distance of the descriptors, shape (C,).
    #[getter]
    fn distance(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, 2, |c| c.distance)
    }

    /// Probability that both descriptors are good for matching, shape (C,).
    #[getter]
    fn quality(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.column(py, 3, |c| c.quality)
    }

    /// Centroids of the live segments, shape (C, 3), metres, sensor frame.
    #[getter]
    fn live_centroids(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.centroids(py, 4, |c| c.pair.live)
    }

    /// Centroids of the map segments, shape (C, 3), metres, relative to the map's origin.
    #[getter]
    fn map_centroids(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.centroids(py, 5, |c| c.pair.map)
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    fn __repr__(&self) -> String {
        format!("Candidates(matches={})", self.inner.len())
    }
}

/// Find for every live segment its nearest map segments.
///
/// `descriptions` must be on the map's scale (`map.standardizer`), `index` over `map.descriptors`.
#[pyfunction]
#[pyo3(signature = (segments, descriptions, map, index, config=None, *, threads=None))]
pub(crate) fn candidates(
    py: Python<'_>,
    segments: &Bound<'_, PyAny>,
    descriptions: &Bound<'_, Descriptions>,
    map: &Bound<'_, Map>,
    index: &Bound<'_, Index>,
    config: Option<&Bound<'_, Config>>,
    threads: Option<usize>,
) -> PyResult<Candidates> {
    let segments = Segments::read(segments)?;
    let described = Arc::clone(&descriptions.get().inner);
    let (map, index) = (Arc::clone(&map.get().inner), index.get());
    let dim = map.descriptor_info().dim as usize;
    let count = segments.as_slice().len();
    if described.quality.len() != count {
        let got = described.quality.len();
        return Err(bad_value("descriptions", format!("must describe the {count} segments, got {got}")));
    }
    if described.dim != dim {
        let got = described.dim;
        return Err(bad_value(
            "descriptions",
            format!("must have {dim} numbers a row as the map, got {got}"),
        ));
    }
    if (index.rows, index.dim) != (map.len(), dim) {
        return Err(bad_value(
            "index",
            format!(
                "must be over the map's {} x {dim} descriptors, got {} x {}",
                map.len(),
                index.rows,
                index.dim
            ),
        ));
    }
    let (index, config) = (Arc::clone(&index.inner), or_default(config));
    let inner = run(py, Threads::new(threads)?, move || {
        let segments = segments.as_slice();
        let mut found = matching::candidates(segments, &described, &map, &index, &config.matching);
        estimate::compare_extents(&mut found, segments, |m| map.segments()[m as usize].extent, &config.pose);
        Ok::<_, Failure>(found)
    })?;
    Ok(Candidates { inner: Arc::new(inner), kept: Default::default() })
}

/// A place the cloud may have been taken at.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Hypothesis {
    inner: estimate::Hypothesis,
    inliers: Kept,
}

#[pymethods]
impl Hypothesis {
    /// Pose of the live sensor, shape (4, 4), relative to the map's origin.
    #[getter]
    fn pose_origin_sensor(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_pose(py, &self.inner.pose_map_sensor)
    }

    /// The candidates that agree with it, by their index, shape (I,).
    #[getter]
    fn inliers(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.inliers.get(py, || Ok(row(py, self.inner.support.inliers.clone())))
    }

    fn __repr__(&self) -> String {
        let at = self.inner.pose_map_sensor.translation.vector;
        let inliers = self.inner.support.inliers.len();
        format!("Hypothesis(inliers={inliers}, at=[{:.2}, {:.2}, {:.2}])", at.x, at.y, at.z)
    }
}

/// Find the distinct places with the most support, best first.
#[pyfunction]
#[pyo3(signature = (candidates, config=None, *, threads=None))]
pub(crate) fn search(
    py: Python<'_>,
    candidates: &Bound<'_, Candidates>,
    config: Option<&Bound<'_, Config>>,
    threads: Option<usize>,
) -> PyResult<Vec<Hypothesis>> {
    let (candidates, config) = (Arc::clone(&candidates.get().inner), or_default(config));
    let found = run(py, Threads::new(threads)?, move || {
        Ok::<_, Failure>(estimate::search(&candidates, &config.pose, config.seed).places)
    })?;
    Ok(found.into_iter().map(|inner| Hypothesis { inner, inliers: Kept::default() }).collect())
}

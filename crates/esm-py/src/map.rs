//! [`Map`]: the prior map, opened or just built.

use std::path::PathBuf;
use std::sync::Arc;

use esm_core::map as core;
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::describe::{Descriptions, Descriptor};
use crate::failure::Failure;
use crate::input::bad_value;
use crate::output::{Kept, fixed_row, row, rows3, table};
use crate::threads::Threads;
use crate::work::run;

/// A prior map: checked, immutable, the same to use whether it was just built or lies in a file.
///
/// An opened map keeps its file mapped into memory: replace such files (write beside, rename), never edit them in place.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Map {
    pub(crate) inner: Arc<core::Map>,
    kept: [Kept; 7],
}

impl Map {
    pub(crate) fn new(inner: Arc<core::Map>) -> Self {
        Self { inner, kept: Default::default() }
    }

    fn points_of<'py>(
        &self,
        py: Python<'py>,
        index: usize,
        read: impl FnOnce(&core::Map, usize, &mut Vec<[f32; 3]>) -> Result<(), esm_core::Error> + Send + 'static,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let map = Arc::clone(&self.inner);
        let points = run(py, Threads::default(), move || {
            let mut points = Vec::new();
            read(&map, index, &mut points).map(|()| points)
        })?;
        rows3(py, points)
    }
}

#[pymethods]
impl Map {
    /// Open a map file and verify all of it but the points, which are verified before they are used.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        run(py, Threads::default(), move || core::Map::open(&path)).map(|map| Self::new(Arc::new(map)))
    }

    /// Write the map file, whole or not at all. The same map gives the same bytes.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let map = Arc::clone(&self.inner);
        run(py, Threads::default(), move || map.write(&path))
    }

    /// Verify all points now.
    fn verify_points(&self, py: Python<'_>) -> PyResult<()> {
        let map = Arc::clone(&self.inner);
        run(py, Threads::default(), move || map.verify_points())
    }

    /// Raise `DescriptorMismatchError` unless live rows of this descriptor may be compared with the map's.
    fn check_descriptor(&self, descriptor: &Bound<'_, Descriptor>) -> PyResult<()> {
        Ok(self.inner.check_descriptor(&*descriptor.get().inner).map_err(Failure::from)?)
    }

    /// Where the float32 coordinates are counted from, shape (3,), metres, map frame.
    #[getter]
    fn origin(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.origin())
    }

    /// Name of the map frame.
    #[getter]
    fn frame_id(&self) -> &str {
        self.inner.frame_id()
    }

    /// What the descriptors are.
    #[getter]
    fn descriptor_info(&self) -> DescriptorInfo {
        DescriptorInfo { inner: self.inner.descriptor_info().clone() }
    }

    /// Brings live descriptors to the scale of the stored ones; None where that is not needed.
    #[getter]
    fn standardizer(&self) -> Option<Standardizer> {
        self.inner.standardizer().map(|s| Standardizer { inner: Arc::new(s.clone()) })
    }

    /// The segments' centroids, shape (S, 3), metres, relative to the origin.
    #[getter]
    fn centroids(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || rows3(py, self.inner.segments().iter().map(|s| s.centroid).collect()))
    }

    /// Sizes of the segments' axis-aligned boxes, shape (S, 3), metres.
    #[getter]
    fn extents(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[1].get(py, || rows3(py, self.inner.segments().iter().map(|s| s.extent).collect()))
    }

    /// Windows of the recording that each segment was seen in, shape (S,).
    #[getter]
    fn observations(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let observations = || Ok(row(py, self.inner.segments().iter().map(|s| s.observations).collect()));
        self.kept[2].get(py, observations)
    }

    /// Descriptors, shape (S, dim), already standardised.
    #[getter]
    fn descriptors(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let dim = self.inner.descriptor_info().dim as usize;
        self.kept[3].get(py, || table(py, self.inner.descriptors().to_vec(), dim))
    }

    /// The probability, 0 to 1, that a descriptor is good for matching, shape (S,).
    #[getter]
    fn quality(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[4].get(py, || Ok(row(py, self.inner.quality().to_vec())))
    }

    /// Give one segment's points, shape (N, 3), metres, relative to the origin.
    fn segment_points<'py>(&self, py: Python<'py>, segment: usize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.points_of(py, segment, core::Map::segment_points_into)
    }

    /// Number of ground tiles.
    #[getter]
    fn ground_tiles(&self) -> usize {
        self.inner.ground_tiles().len()
    }

    /// Give one ground tile's points, shape (N, 3), metres, relative to the origin.
    fn ground_tile_points<'py>(&self, py: Python<'py>, tile: usize) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.points_of(py, tile, core::Map::ground_tile_points_into)
    }

    /// Number of structure tiles.
    #[getter]
    fn structure_tiles(&self) -> usize {
        self.inner.structure_tiles().len()
    }

    /// Give one structure tile's points, shape (N, 3), metres, relative to the origin.
    fn structure_tile_points<'py>(
        &self,
        py: Python<'py>,
        tile: usize,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        self.points_of(py, tile, core::Map::structure_tile_points_into)
    }

    /// Number of points, of segments and tiles.
    #[getter]
    fn point_count(&self) -> usize {
        self.inner.point_count()
    }

    /// The path the map was recorded along, shape (P, 3), metres, map frame; empty for a map of a prior cloud.
    #[getter]
    fn path(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[5].get(py, || rows3(py, self.inner.path().to_vec()))
    }

    /// The 5 m cells of the map frame that hold points of a prior cloud, shape (C, 2); empty for a map of a path.
    #[getter]
    fn coverage(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        let cells = || table(py, self.inner.coverage().to_vec().into_flattened(), 2);
        self.kept[6].get(py, cells)
    }

    /// Lower and upper corner of the box around all points, shape (3,) each, metres, map frame.
    #[getter]
    fn bounds(&self, py: Python<'_>) -> PyResult<(Py<PyAny>, Py<PyAny>)> {
        let (low, high) = self.inner.bounds();
        Ok((fixed_row(py, &low)?, fixed_row(py, &high)?))
    }

    /// The configuration it was built with, TOML.
    #[getter]
    fn settings(&self) -> &str {
        self.inner.settings()
    }

    /// What it was built from.
    #[getter]
    fn source(&self) -> &str {
        self.inner.source()
    }

    /// Bytes of its file, or of the one that `write` would write.
    #[getter]
    fn file_size(&self) -> u64 {
        self.inner.file_size()
    }

    fn __len__(&self) -> usize {
        self.inner.len()
    }

    fn __repr__(&self) -> String {
        let d = self.inner.descriptor_info();
        format!(
            "Map(segments={}, descriptor={:?}, points={}, source={:?})",
            self.inner.len(),
            d.name,
            self.inner.point_count(),
            self.inner.source()
        )
    }
}

/// Which descriptor a map's rows are of.
#[pyclass(frozen, eq, module = "esm_py")]
#[derive(PartialEq)]
pub(crate) struct DescriptorInfo {
    inner: core::DescriptorInfo,
}

#[pymethods]
impl DescriptorInfo {
    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Its version: rows of different versions must not be compared.
    #[getter]
    fn version(&self) -> u32 {
        self.inner.version
    }

    /// Numbers a row.
    #[getter]
    fn dim(&self) -> u32 {
        self.inner.dim
    }

    fn __hash__(&self) -> u64 {
        u64::from(self.inner.version)
    }

    fn __repr__(&self) -> String {
        let d = &self.inner;
        format!("DescriptorInfo({:?}, version={}, dim={})", d.name, d.version, d.dim)
    }
}

/// Brings descriptors to a map's scale: a row becomes `(row - mean) * inv_std`.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Standardizer {
    inner: Arc<core::Standardizer>,
}

#[pymethods]
impl Standardizer {
    /// Mean of each dimension, shape (dim,).
    #[getter]
    fn mean(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.mean)
    }

    /// One over the standard deviation of each dimension, shape (dim,); 0 where it is constant.
    #[getter]
    fn inv_std(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        fixed_row(py, &self.inner.inv_std)
    }

    /// Standardise live descriptions, as the map's stored rows already are.
    fn apply(&self, descriptions: &Bound<'_, Descriptions>) -> PyResult<Descriptions> {
        let described = descriptions.get();
        let dim = self.inner.mean.len();
        if described.inner.dim != dim {
            let got = described.inner.dim;
            return Err(bad_value("descriptions", format!("must have {dim} numbers a row, got {got}")));
        }
        let mut described = (*described.inner).clone();
        self.inner.apply(&mut described.values);
        Ok(Descriptions::new(described))
    }

    fn __repr__(&self) -> String {
        format!("Standardizer(dim={})", self.inner.mean.len())
    }
}

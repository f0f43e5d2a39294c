//! Descriptors by name, and the learned one with weights of a file.

use std::path::PathBuf;
use std::sync::Arc;

use esm_core::describe::{self, NAMES};
use numpy::PyArrayMethods;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::failure::Failure;
use crate::input::{any_shape, bad_value};
use crate::output::{Kept, row, table};
use crate::segment::Segments;
use crate::threads::Threads;
use crate::work::run;

/// Points of a segment that the network sees.
const INPUT_POINTS: usize = 256;

/// Turns segments into rows of numbers, a batch at a time: one of `DESCRIPTORS` by name.
#[pyclass(frozen, subclass, module = "esm_py")]
pub(crate) struct Descriptor {
    pub(crate) inner: Arc<dyn describe::Descriptor>,
}

/// The argument `descriptor` of what works with one.
pub(crate) fn given(descriptor: Option<&Bound<'_, Descriptor>>) -> Option<Arc<dyn describe::Descriptor>> {
    descriptor.map(|d| Arc::clone(&d.get().inner))
}

#[pymethods]
impl Descriptor {
    #[new]
    fn new(name: &str) -> PyResult<Self> {
        Ok(Self { inner: describe::by_name(name).map_err(Failure::from)? })
    }

    /// Its name, as in `--descriptor NAME`.
    #[getter]
    fn name(&self) -> &str {
        self.inner.name()
    }

    /// Differs where the numbers do, so that maps of another version are refused.
    #[getter]
    fn version(&self) -> u32 {
        self.inner.version()
    }

    /// Numbers a segment.
    #[getter]
    fn dim(&self) -> usize {
        self.inner.dim()
    }

    /// Whether a map brings each dimension to zero mean and unit variance over its segments.
    #[getter]
    fn standardized(&self) -> bool {
        self.inner.standardized()
    }

    /// Describe a batch. A row depends on its own segment's points only.
    #[pyo3(signature = (segments, *, threads=None))]
    fn describe(
        &self,
        py: Python<'_>,
        segments: &Bound<'_, PyAny>,
        threads: Option<usize>,
    ) -> PyResult<Descriptions> {
        let (descriptor, segments) = (Arc::clone(&self.inner), Segments::read(segments)?);
        run(py, Threads::new(threads)?, move || {
            Ok::<_, Failure>(Descriptions::new(descriptor.describe(segments.as_slice())))
        })
    }

    fn __repr__(slf: &Bound<'_, Self>) -> PyResult<String> {
        let d = &slf.get().inner;
        let class = slf.get_type().name()?;
        Ok(format!("{class}({:?}, version={}, dim={})", d.name(), d.version(), d.dim()))
    }
}

/// The names there are, the default first.
pub(crate) fn names(py: Python<'_>) -> PyResult<Bound<'_, PyTuple>> {
    PyTuple::new(py, NAMES)
}

/// The learned descriptor with the weights of a file (`python/train/WEIGHTS.md`), such as weights you have trained.
#[pyclass(frozen, extends = Descriptor, module = "esm_py")]
pub(crate) struct XConv {
    inner: Arc<describe::XConv>,
}

impl XConv {
    fn make(py: Python<'_>, xconv: describe::XConv) -> PyResult<Py<Self>> {
        let inner = Arc::new(xconv);
        let base = Descriptor { inner: Arc::clone(&inner) as Arc<dyn describe::Descriptor> };
        Py::new(py, PyClassInitializer::from(base).add_subclass(Self { inner }))
    }

    /// Sizes a segment that the weights ask for.
    fn size_features(&self) -> usize {
        let names = self.inner.metadata("size_features").unwrap_or_default();
        names.split(',').filter(|name| !name.is_empty()).count()
    }
}

#[pymethods]
impl XConv {
    /// Open a weights file (`.safetensors`).
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Py<Self>> {
        let xconv = run(py, Threads::default(), move || describe::XConv::open(path))?;
        Self::make(py, xconv)
    }

    /// Take the bytes of a weights file; `name` stands for the file in messages.
    #[staticmethod]
    #[pyo3(signature = (data, name="(memory)"))]
    fn from_bytes(py: Python<'_>, data: &[u8], name: &str) -> PyResult<Py<Self>> {
        let (data, name) = (data.to_vec(), name.to_owned());
        let xconv = run(py, Threads::default(), move || describe::XConv::from_bytes(&data, name))?;
        Self::make(py, xconv)
    }

    /// Give a line of the weights' header, such as `training_data`.
    fn metadata(&self, key: &str) -> Option<&str> {
        self.inner.metadata(key)
    }

    /// Multiply-adds for one segment.
    #[getter]
    fn multiply_adds(&self) -> usize {
        self.inner.multiply_adds()
    }

    /// Describe inputs that are sampled and normalised already, to compare with other programs.
    ///
    /// `points`: shape (N, 256, 3). `sizes`: shape (N, F), the sizes that the header names, NaN where unknown.
    #[pyo3(signature = (points, sizes=None, *, threads=None))]
    fn describe_normalised(
        &self,
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        sizes: Option<&Bound<'_, PyAny>>,
        threads: Option<usize>,
    ) -> PyResult<Descriptions> {
        let (points, shape) = any_shape(points, "points")?;
        if shape.len() != 3 || shape[1..] != [INPUT_POINTS, 3] {
            return Err(bad_value(
                "points",
                format!("must have shape (N, {INPUT_POINTS}, 3), got {shape:?}"),
            ));
        }
        if !points.iter().all(|v| v.is_finite()) {
            return Err(bad_value("points", "must be finite"));
        }
        let features = self.size_features();
        let sizes = match sizes {
            Some(sizes) => {
                let (sizes, got) = any_shape(sizes, "sizes")?;
                if got != [shape[0], features] {
                    let what = format!("must have shape ({}, {features}), got {got:?}", shape[0]);
                    return Err(bad_value("sizes", what));
                }
                sizes
            }
            // Not known.
            None => vec![f64::NAN; shape[0] * features],
        };
        let xconv = Arc::clone(&self.inner);
        run(py, Threads::new(threads)?, move || {
            let points: Vec<[f32; 3]> =
                points.as_chunks::<3>().0.iter().map(|p| p.map(|v| v as f32)).collect();
            Ok::<_, Failure>(Descriptions::new(xconv.describe_normalised(&points, &sizes)))
        })
    }
}

/// Descriptors of a batch of segments.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct Descriptions {
    pub(crate) inner: Arc<describe::Descriptions>,
    kept: [Kept; 2],
}

impl Descriptions {
    pub(crate) fn new(described: describe::Descriptions) -> Self {
        Self { inner: Arc::new(described), kept: Default::default() }
    }
}

#[pymethods]
impl Descriptions {
    /// Numbers a segment.
    #[getter]
    fn dim(&self) -> usize {
        self.inner.dim
    }

    /// Descriptors, shape (N, dim), in the order of the segments.
    #[getter]
    fn values(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[0].get(py, || match self.inner.values.is_empty() {
            true => row(py, Vec::<f32>::new()).reshape([0, self.inner.dim]),
            false => table(py, self.inner.values.clone(), self.inner.dim),
        })
    }

    /// The probability, 0 to 1, that a descriptor is good for matching, shape (N,).
    #[getter]
    fn quality(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        self.kept[1].get(py, || Ok(row(py, self.inner.quality.clone())))
    }

    /// Seconds spent on preparing the input, where the descriptor has such a step.
    #[getter]
    fn preprocessing_s(&self) -> f64 {
        self.inner.preprocessing.as_secs_f64()
    }

    fn __len__(&self) -> usize {
        self.inner.quality.len()
    }

    fn __repr__(&self) -> String {
        format!("Descriptions(segments={}, dim={})", self.inner.quality.len(), self.inner.dim)
    }
}

//! NumPy arrays out: those of result objects are made once and cannot be written to.

use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

/// An array of a result object, made when it is first asked for.
pub(crate) struct Kept(PyOnceLock<Py<PyAny>>);

impl Default for Kept {
    fn default() -> Self {
        Self(PyOnceLock::new())
    }
}

impl Kept {
    pub(crate) fn get<'py, T>(
        &self,
        py: Python<'py>,
        make: impl FnOnce() -> PyResult<Bound<'py, T>>,
    ) -> PyResult<Py<PyAny>> {
        self.0.get_or_try_init(py, || Ok(fixed(make()?)?.unbind())).map(|made| made.clone_ref(py))
    }
}

/// Makes an array read-only.
pub(crate) fn fixed<T>(array: Bound<'_, T>) -> PyResult<Bound<'_, PyAny>> {
    let array = array.into_any();
    array.call_method1("setflags", (false,))?;
    Ok(array)
}

/// Rows of three as an array of shape (N, 3).
pub(crate) fn rows3<T: Element>(py: Python<'_>, rows: Vec<[T; 3]>) -> PyResult<Bound<'_, PyArray2<T>>> {
    table(py, rows.into_flattened(), 3)
}

/// Row-major numbers as an array of shape (N, `columns`).
pub(crate) fn table<T: Element>(
    py: Python<'_>,
    values: Vec<T>,
    columns: usize,
) -> PyResult<Bound<'_, PyArray2<T>>> {
    let rows = values.len() / columns.max(1);
    values.into_pyarray(py).reshape([rows, columns])
}

/// Numbers as an array of shape (N,).
pub(crate) fn row<T: Element>(py: Python<'_>, values: Vec<T>) -> Bound<'_, PyArray1<T>> {
    values.into_pyarray(py)
}

/// A few numbers of a result object.
pub(crate) fn fixed_row<T: Element + Copy>(py: Python<'_>, values: &[T]) -> PyResult<Py<PyAny>> {
    Ok(fixed(PyArray1::from_slice(py, values))?.unbind())
}

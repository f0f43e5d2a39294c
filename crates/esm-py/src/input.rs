//! NumPy arrays in: any layout, any real dtype, checked, and copied into what the core takes.

use std::fmt::Display;

use esm_core::PointCloud;
use numpy::ndarray::{ArrayView2, Axis};
use numpy::{Element, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::failure::{Failure, not_finite};

/// More rows are no array that the core could number.
const MAX_ROWS: usize = 1 << 31;

/// What is wrong with an argument's values.
pub(crate) fn bad_value(name: &str, what: impl Display) -> PyErr {
    PyValueError::new_err(format!("{name} {what}"))
}

fn bad_type(name: &str, what: impl Display) -> PyErr {
    PyTypeError::new_err(format!("{name} {what}"))
}

/// Points of shape (N, 3), each coordinate rounded once to float32; all must be finite, as the core asks for.
pub(crate) fn cloud(value: &Bound<'_, PyAny>, name: &str) -> PyResult<PointCloud> {
    PointCloud::try_new(points(value, name)?).map_err(|error| match error {
        esm_core::Error::NonFinitePoint { index } => not_finite(name, index),
        other => Failure::from(other).into(),
    })
}

/// Points of shape (N, 3) as float32, NaN and infinities included.
pub(crate) fn points(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<[f32; 3]>> {
    let array = array(value, name)?;
    let shape = array.shape();
    if shape.len() != 2 || shape[1] != 3 {
        let hint = match shape {
            [_, columns] if *columns > 3 => format!("\nhint: pass {name}[:, :3]"),
            _ => String::new(),
        };
        return Err(bad_value(name, format!("must have shape (N, 3), got {}{hint}", Shape(shape))));
    }
    rows(&array, name, |v: [f32; 3]| v, |v: [f64; 3]| v.map(|x| x as f32))
}

/// A table of float32 numbers, row-major, with its number of columns; all must be finite.
pub(crate) struct Table {
    pub(crate) values: Vec<f32>,
    pub(crate) rows: usize,
    pub(crate) columns: usize,
}

/// An array of shape (N, `columns`), or of any number of columns.
pub(crate) fn table(value: &Bound<'_, PyAny>, name: &str, columns: Option<usize>) -> PyResult<Table> {
    let array = array(value, name)?;
    let shape = array.shape();
    let right = shape.len() == 2 && shape[1] > 0 && columns.is_none_or(|c| c == shape[1]);
    if !right {
        let wanted = columns.map_or("D".to_owned(), |c| c.to_string());
        return Err(bad_value(name, format!("must have shape (N, {wanted}), got {}", Shape(shape))));
    }
    let (rows, columns) = (shape[0], shape[1]);
    let values = numbers(&array, name)?;
    if let Some(n) = values.iter().position(|v: &f32| !v.is_finite()) {
        return Err(bad_value(
            name,
            format!("must be finite, row {} column {} is not", n / columns, n % columns),
        ));
    }
    Ok(Table { values, rows, columns })
}

/// An array of float64 numbers of exactly this shape.
pub(crate) fn exactly(value: &Bound<'_, PyAny>, name: &str, shape: &[usize]) -> PyResult<Vec<f64>> {
    let array = array(value, name)?;
    if array.shape() != shape {
        let (wanted, got) = (Shape(shape), Shape(array.shape()));
        return Err(bad_value(name, format!("must have shape {wanted}, got {got}")));
    }
    numbers(&array, name)
}

/// An array of float64 numbers of any shape, which is given too.
pub(crate) fn any_shape(value: &Bound<'_, PyAny>, name: &str) -> PyResult<(Vec<f64>, Vec<usize>)> {
    let array = array(value, name)?;
    Ok((numbers(&array, name)?, array.shape().to_vec()))
}

/// A position, shape (3,), finite.
pub(crate) fn position(value: &Bound<'_, PyAny>, name: &str) -> PyResult<[f64; 3]> {
    let values = exactly(value, name, &[3])?;
    match values[..] {
        [x, y, z] if values.iter().all(|v| v.is_finite()) => Ok([x, y, z]),
        _ => Err(bad_value(name, "must be finite")),
    }
}

/// Whole numbers of shape (N,) that fit `T`.
pub(crate) fn integers<T: TryFrom<i64>>(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<T>> {
    let array = array(value, name)?;
    if !matches!(array.dtype().kind(), b'i' | b'u') {
        return Err(bad_type(name, format!("must hold whole numbers, got dtype {}", array.dtype())));
    }
    let &[rows] = array.shape() else {
        return Err(bad_value(name, format!("must have shape (N,), got {}", Shape(array.shape()))));
    };
    check_rows(rows, name)?;
    let wide = array.call_method1("astype", ("int64",))?.cast_into::<numpy::PyArray1<i64>>()?;
    let wide = wide.readonly();
    let fits = |(n, v): (usize, &i64)| {
        T::try_from(*v).map_err(|_| {
            bad_value(name, format!("does not fit {}: item {n} is {v}", std::any::type_name::<T>()))
        })
    };
    wide.as_array().iter().enumerate().map(fits).collect()
}

/// The argument as an array of real numbers.
fn array<'py>(value: &Bound<'py, PyAny>, name: &str) -> PyResult<Bound<'py, PyUntypedArray>> {
    let array = match value.cast::<PyUntypedArray>() {
        Ok(array) => array.clone(),
        Err(_) => {
            let made = value.py().import("numpy")?.call_method1("asarray", (value,));
            let made = made.map_err(|e| bad_type(name, format!("must be an array of numbers: {e}")))?;
            made.cast_into()?
        }
    };
    match array.dtype().kind() {
        b'f' | b'i' | b'u' => Ok(array),
        _ => Err(bad_type(name, format!("must hold real numbers, got dtype {}", array.dtype()))),
    }
}

fn check_rows(rows: usize, name: &str) -> PyResult<()> {
    if rows > MAX_ROWS {
        Err(bad_value(name, format!("has {rows} rows, at most {MAX_ROWS} are possible")))
    } else {
        Ok(())
    }
}

fn room<T>(count: Option<usize>, name: &str) -> PyResult<Vec<T>> {
    let mut room = Vec::new();
    let count = count.ok_or_else(|| bad_value(name, "is too large"))?;
    let tried = room.try_reserve_exact(count);
    tried.map_err(|_| PyMemoryError::new_err(format!("{name}: no memory for {count} items")))?;
    Ok(room)
}

/// The rows of an array that has `N` columns.
fn rows<const N: usize, T>(
    array: &Bound<'_, PyUntypedArray>,
    name: &str,
    narrow: impl Fn([f32; N]) -> T,
    wide: impl Fn([f64; N]) -> T,
) -> PyResult<Vec<T>> {
    fn gather<const N: usize, E: Copy, T>(
        view: &ArrayView2<'_, E>,
        out: &mut Vec<T>,
        make: impl Fn([E; N]) -> T,
    ) {
        out.extend(view.axis_iter(Axis(0)).map(|row| make(std::array::from_fn(|c| row[c]))));
    }
    let count = array.shape()[0];
    check_rows(count, name)?;
    let mut out = room(Some(count), name)?;
    match in_place::<f32>(array) {
        Some(array) => gather(&array.readonly().as_array(), &mut out, narrow),
        None => gather(&as_f64(array)?.readonly().as_array(), &mut out, wide),
    }
    Ok(out)
}

/// A floating-point number that arrays are read as.
trait Real: Copy {
    fn from_f32(v: f32) -> Self;
    fn from_f64(v: f64) -> Self;
}

impl Real for f32 {
    fn from_f32(v: f32) -> Self {
        v
    }
    fn from_f64(v: f64) -> Self {
        v as Self
    }
}

impl Real for f64 {
    fn from_f32(v: f32) -> Self {
        v.into()
    }
    fn from_f64(v: f64) -> Self {
        v
    }
}

/// All numbers of an array in row-major order.
fn numbers<T: Real>(array: &Bound<'_, PyUntypedArray>, name: &str) -> PyResult<Vec<T>> {
    check_rows(array.shape().first().copied().unwrap_or(0), name)?;
    let count = array.shape().iter().try_fold(1usize, |n, s| n.checked_mul(*s));
    let mut out = room(count, name)?;
    let flat = (-1, 1);
    match array.dtype().is_equiv_to(&numpy::dtype::<f32>(array.py())) {
        true => {
            let flat = array.call_method1("reshape", flat)?.call_method0("copy")?;
            let flat = flat.cast_into::<PyArray2<f32>>()?;
            out.extend(flat.readonly().as_array().iter().map(|v| T::from_f32(*v)));
        }
        false => {
            let flat = array.call_method1("reshape", flat)?.cast_into::<PyUntypedArray>()?;
            out.extend(as_f64(&flat)?.readonly().as_array().iter().map(|v| T::from_f64(*v)));
        }
    }
    Ok(out)
}

/// The array itself where its numbers are of this type and can be read where they lie.
fn in_place<'py, T: Element>(array: &Bound<'py, PyUntypedArray>) -> Option<Bound<'py, PyArray2<T>>> {
    // NumPy calls any array without items aligned, wherever it points to.
    let readable = array.is_aligned() && !array.is_empty();
    readable.then(|| array.cast::<PyArray2<T>>().ok().cloned()).flatten()
}

/// The array as float64, copied where it is anything else.
fn as_f64<'py>(array: &Bound<'py, PyUntypedArray>) -> PyResult<Bound<'py, PyArray2<f64>>> {
    match in_place(array) {
        Some(array) => Ok(array),
        None => Ok(array.call_method1("astype", ("float64", "C"))?.cast_into()?),
    }
}

/// A shape as Python writes it.
struct Shape<'a>(&'a [usize]);

impl Display for Shape<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            [one] => write!(f, "({one},)"),
            all => write!(f, "({})", all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")),
        }
    }
}

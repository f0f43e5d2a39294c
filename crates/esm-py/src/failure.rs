//! The crates' errors as Python's exceptions, one class a variant (`esm_py/errors.py`).

use std::io::ErrorKind;
use std::path::Path;

use pyo3::prelude::*;
use pyo3::types::PyType;

/// An error of one of the crates on its way to Python.
#[derive(Debug)]
pub(crate) enum Failure {
    Core(esm_core::Error),
    Io(esm_io::Error),
    Sim(esm_sim::Error),
    Learn(esm_learn::Error),
    /// Made here already.
    Python(PyErr),
}

impl From<esm_core::Error> for Failure {
    fn from(error: esm_core::Error) -> Self {
        Self::Core(error)
    }
}

impl From<esm_io::Error> for Failure {
    fn from(error: esm_io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<esm_sim::Error> for Failure {
    fn from(error: esm_sim::Error) -> Self {
        Self::Sim(error)
    }
}

impl From<esm_learn::Error> for Failure {
    fn from(error: esm_learn::Error) -> Self {
        Self::Learn(error)
    }
}

impl From<PyErr> for Failure {
    fn from(error: PyErr) -> Self {
        Self::Python(error)
    }
}

impl From<std::convert::Infallible> for Failure {
    fn from(never: std::convert::Infallible) -> Self {
        match never {}
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        Python::attach(|py| match failure {
            Failure::Core(error) => core(py, &error),
            Failure::Io(error) => io(py, &error),
            Failure::Sim(error) => sim(py, &error),
            Failure::Learn(error) => learn(py, &error),
            Failure::Python(error) => error,
        })
    }
}

/// An exception of a class of `esm_py.errors`, being made.
struct Raised<'py>(PyResult<Bound<'py, PyAny>>);

impl<'py> Raised<'py> {
    fn new(py: Python<'py>, class: &str, message: String) -> Self {
        let class = py
            .import("esm_py.errors")
            .and_then(|errors| errors.getattr(class)?.cast_into::<PyType>().map_err(PyErr::from));
        Self(class.and_then(|class| class.call1((message,))))
    }

    fn with(self, name: &str, value: impl IntoPyObject<'py>) -> Self {
        Self(self.0.and_then(|error| error.setattr(name, value).map(|()| error)))
    }

    fn at(self, path: &Path) -> Self {
        self.with("path", path.as_os_str())
    }

    fn end(self) -> PyErr {
        self.0.map_or_else(|failed| failed, PyErr::from_value)
    }
}

/// An exception without attributes but its words.
pub(crate) fn raise(class: &str, message: impl Into<String>) -> PyErr {
    Python::attach(|py| Raised::new(py, class, message.into()).end())
}

/// The core's error about a point, which names the argument here.
pub(crate) fn not_finite(argument: &str, index: usize) -> PyErr {
    let hint = "drop invalid returns first (esm_py.finite does)";
    let message = format!("{argument}: point {index} is not finite\nhint: {hint}");
    Python::attach(|py| Raised::new(py, "NonFinitePointError", message).with("index", index).end())
}

fn core(py: Python<'_>, error: &esm_core::Error) -> PyErr {
    use esm_core::Error as E;
    let new = |class| Raised::new(py, class, error.to_string());
    match error {
        E::NonFinitePoint { index } => new("NonFinitePointError").with("index", *index),
        E::Config { field, value, allowed } => {
            new("ConfigError").with("field", *field).with("value", value).with("allowed", *allowed)
        }
        E::DescriptorMismatch { .. } => new("DescriptorMismatchError"),
        E::EmptyMap { .. } => new("EmptyMapError"),
        E::MapData { .. } => new("MapDataError"),
        E::MapFile { path, .. } if matches!(path.try_exists(), Ok(false)) => {
            new("MissingMapError").with("filename", path.as_os_str()).at(path)
        }
        E::MapFile { path, .. } => new("MapFileError").at(path),
        E::WeightsFile { path, .. } => new("WeightsFileError").at(path),
        E::Io { path, source, .. } => return system(py, error.to_string(), path, source),
        _ => new("EsmError"),
    }
    .end()
}

fn io(py: Python<'_>, error: &esm_io::Error) -> PyErr {
    use esm_io::Error as E;
    let new = |class| Raised::new(py, class, error.to_string()).at(error.path());
    match error {
        E::Io { path, source, .. } => return system(py, error.to_string(), path, source),
        E::Malformed { place, .. } => new("MalformedError").with("place", place),
        E::Unsupported { .. } => new("UnsupportedError"),
        E::Topic { candidates, .. } => new("TopicError").with("candidates", candidates),
        E::Empty { .. } => new("EmptyError"),
        _ => new("EsmError"),
    }
    .end()
}

fn sim(py: Python<'_>, error: &esm_sim::Error) -> PyErr {
    use esm_sim::Error as E;
    let new = |class| Raised::new(py, class, error.to_string());
    match error {
        E::UnknownPreset { .. } => new("UnknownPresetError"),
        E::Scale { .. } => new("ScaleError"),
        E::Offset { .. } | E::Changed { .. } => new("SettingError"),
        E::Directory { path, source, .. } => return system(py, error.to_string(), path, source),
        E::Busy { path } => new("BusyError").at(path),
        E::Output(error) => return io(py, error),
        E::Interrupted => new("InterruptedSimulationError"),
        _ => new("EsmError"),
    }
    .end()
}

fn learn(py: Python<'_>, error: &esm_learn::Error) -> PyErr {
    use esm_learn::Error as E;
    let new = |class| Raised::new(py, class, error.to_string());
    match error {
        E::Io { path, source, .. } => return system(py, error.to_string(), path, source),
        E::Exists { path } => new("ExistsError").with("filename", path.as_os_str()).at(path),
        E::Setting { .. } => new("SettingError"),
        E::Core(error) => return core(py, error),
        _ => new("EsmError"),
    }
    .end()
}

/// What the operating system refused: also Python's own class for it.
fn system(py: Python<'_>, message: String, path: &Path, source: &std::io::Error) -> PyErr {
    let class = match source.kind() {
        ErrorKind::NotFound => "MissingFileError",
        ErrorKind::PermissionDenied => "ForbiddenFileError",
        _ => "FileError",
    };
    let mut raised = Raised::new(py, class, message).at(path).with("filename", path.as_os_str());
    if let Some(number) = source.raw_os_error() {
        raised = raised.with("errno", number);
    }
    raised.with("strerror", source.to_string()).end()
}

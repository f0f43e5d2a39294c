//! [`Config`]: the core's configuration from TOML text, a file, or a dictionary.

use std::fs::File;
use std::io::Read;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use toml::{Table, Value};

use crate::failure::{Failure, raise};

/// Most bytes of a configuration file, as for `esm-cli --config`.
const MAX_BYTES: u64 = 1 << 20;
/// Tables within tables: a configuration has three levels.
const MAX_DEPTH: usize = 8;
const HINT: &str = "`esm-cli config` prints every key there is";

/// Everything that can be set, a table for each step, with the keys of `esm-cli config`.
///
/// `Config({"accumulate": {"distance_m": 6.0}})` changes what is given and leaves the rest at its default. Unknown keys and
/// values outside their range raise `ConfigError`.
#[pyclass(frozen, eq, module = "esm_py")]
#[derive(PartialEq)]
pub(crate) struct Config {
    pub(crate) inner: Arc<esm_core::Config>,
}

/// The given configuration, or the defaults.
pub(crate) fn or_default(config: Option<&Bound<'_, Config>>) -> Arc<esm_core::Config> {
    config.map_or_else(Arc::default, |c| Arc::clone(&c.get().inner))
}

#[pymethods]
impl Config {
    #[new]
    #[pyo3(signature = (settings=None))]
    fn new(settings: Option<&Bound<'_, PyMapping>>) -> PyResult<Self> {
        let table = settings.map(|s| table(s, 0)).transpose()?.unwrap_or_default();
        Self::from_table(table)
    }

    /// Make one from TOML text.
    #[staticmethod]
    fn from_toml(text: &str) -> PyResult<Self> {
        Self::parse(text, "the configuration")
    }

    /// Read a TOML file, as `--config FILE` does.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        let io =
            |source| esm_io::Error::Io { path: path.clone(), doing: "reading the configuration", source };
        let mut text = Vec::new();
        let file = File::open(&path).map_err(io).map_err(Failure::from)?;
        file.take(MAX_BYTES + 1).read_to_end(&mut text).map_err(io).map_err(Failure::from)?;
        let name = path.display();
        if text.len() as u64 > MAX_BYTES {
            let what = format!("{name}: this is larger than a configuration can be (1 MiB)\nhint: {HINT}");
            return Err(raise("ConfigError", what));
        }
        match std::str::from_utf8(&text) {
            Ok(text) => Self::parse(text, &name.to_string()),
            Err(e) => {
                let line = 1 + text[..e.valid_up_to()].iter().filter(|b| **b == b'\n').count();
                Err(raise("ConfigError", format!("{name}:{line}: this is not UTF-8 text\nhint: {HINT}")))
            }
        }
    }

    /// Make another one that differs in what is given, key by key.
    fn replace(&self, settings: &Bound<'_, PyMapping>) -> PyResult<Self> {
        let mut all: Table = toml::from_str(&self.to_toml()?).map_err(refused)?;
        merge(&mut all, table(settings, 0)?);
        Self::from_table(all)
    }

    /// Write all of it as TOML.
    fn to_toml(&self) -> PyResult<String> {
        toml::to_string(&*self.inner).map_err(|e| PyValueError::new_err(e.to_string()))
    }

    /// Give all of it as dictionaries.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        py.import("tomllib")?.call_method1("loads", (self.to_toml()?,))
    }

    /// Name of the descriptor, one of `DESCRIPTORS`.
    #[getter]
    fn descriptor(&self) -> &str {
        &self.inner.descriptor
    }

    /// Seed of everything random.
    #[getter]
    fn seed(&self) -> u64 {
        self.inner.seed
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.get_type().getattr("from_toml")?, (slf.get().to_toml()?,)))
    }

    fn __hash__(&self) -> PyResult<u64> {
        use std::hash::{DefaultHasher, Hash, Hasher};
        let mut hasher = DefaultHasher::new();
        self.to_toml()?.hash(&mut hasher);
        Ok(hasher.finish())
    }

    /// Only what differs from the defaults.
    fn __repr__(&self) -> PyResult<String> {
        let all: Table = toml::from_str(&self.to_toml()?).map_err(refused)?;
        let defaults = Self { inner: Arc::default() };
        let defaults: Table = toml::from_str(&defaults.to_toml()?).map_err(refused)?;
        let other = difference(&all, &defaults);
        Ok(if other.is_empty() {
            "Config()".to_owned()
        } else {
            format!("Config({})", python(&Value::Table(other)))
        })
    }
}

impl Config {
    fn parse(text: &str, name: &str) -> PyResult<Self> {
        let config = toml::from_str(text).map_err(|e: toml::de::Error| {
            let line = e.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let place = line.map(|n| format!(":{n}")).unwrap_or_default();
            let what = e.message().trim_end().replace('\n', " ");
            raise("ConfigError", format!("{name}{place}: {what}\nhint: {HINT}"))
        })?;
        Self::checked(config)
    }

    fn from_table(table: Table) -> PyResult<Self> {
        Self::checked(table.try_into().map_err(refused)?)
    }

    fn checked(config: esm_core::Config) -> PyResult<Self> {
        config.check().map_err(Failure::from)?;
        Ok(Self { inner: Arc::new(config) })
    }
}

fn refused(error: toml::de::Error) -> PyErr {
    // The message of a table tells the key on a line of its own.
    let what = error.to_string().trim_end().replace('\n', " ");
    raise("ConfigError", format!("configuration: {what}\nhint: {HINT}"))
}

fn table(mapping: &Bound<'_, PyMapping>, depth: usize) -> PyResult<Table> {
    let mut table = Table::new();
    for item in mapping.items()? {
        let (key, value): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let Ok(key) = key.extract::<String>() else {
            return Err(PyTypeError::new_err(format!("settings: keys are strings, not {}", key.get_type())));
        };
        let value = self::value(&value, &key, depth)?;
        table.insert(key, value);
    }
    Ok(table)
}

fn value(given: &Bound<'_, PyAny>, key: &str, depth: usize) -> PyResult<Value> {
    if depth > MAX_DEPTH {
        return Err(PyValueError::new_err(format!("settings: {key} lies too deep")));
    }
    if given.is_instance_of::<PyBool>() {
        return Ok(Value::Boolean(given.extract()?));
    }
    if given.is_instance_of::<PyInt>() {
        let number = given.extract::<i64>();
        return number.map(Value::Integer).map_err(|_| {
            PyValueError::new_err(format!("settings: {key} = {given} does not fit 64 bits with a sign"))
        });
    }
    if given.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(given.extract()?));
    }
    if given.is_instance_of::<PyString>() {
        return Ok(Value::String(given.extract()?));
    }
    if let Ok(mapping) = given.cast::<PyMapping>() {
        return Ok(Value::Table(table(mapping, depth + 1)?));
    }
    if given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>() {
        let items = given.try_iter()?.map(|item| value(&item?, key, depth + 1));
        return Ok(Value::Array(items.collect::<PyResult<_>>()?));
    }
    // NumPy's scalars.
    if let Ok(item) = given.call_method0("item")
        && !item.get_type().is(given.get_type())
    {
        return value(&item, key, depth + 1);
    }
    Err(PyTypeError::new_err(format!(
        "settings: {key} is of {}, which no configuration holds",
        given.get_type()
    )))
}

fn merge(into: &mut Table, new: Table) {
    for (key, value) in new {
        match (into.get_mut(&key), value) {
            (Some(Value::Table(old)), Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

fn difference(all: &Table, defaults: &Table) -> Table {
    let mut other = Table::new();
    for (key, value) in all {
        match (value, defaults.get(key)) {
            (Value::Table(all), Some(Value::Table(defaults))) => {
                let inner = difference(all, defaults);
                if !inner.is_empty() {
                    other.insert(key.clone(), Value::Table(inner));
                }
            }
            (value, default) if Some(value) != default => {
                other.insert(key.clone(), value.clone());
            }
            _ => {}
        }
    }
    other
}

/// A value as Python writes it.
fn python(value: &Value) -> String {
    match value {
        Value::Boolean(true) => "True".to_owned(),
        Value::Boolean(false) => "False".to_owned(),
        Value::String(text) => format!("{text:?}"),
        Value::Table(table) => {
            let items: Vec<String> = table.iter().map(|(k, v)| format!("{k:?}: {}", python(v))).collect();
            format!("{{{}}}", items.join(", "))
        }
        other => other.to_string(),
    }
}

//! [`SequenceLocalizer`]: cloud after cloud of one robot, held together by its odometry.

use std::sync::{Arc, Mutex, PoisonError};

use esm_core as core;
use pyo3::prelude::*;

use crate::accumulate::LiveCloud;
use crate::localize::{Localization, Localizer};
use crate::threads::Threads;
use crate::work::run;

/// Localizes the clouds of one robot in the order they were taken.
///
/// Every cloud is looked for in the whole map; where a believed place must be by now, by the odometry, is verified too, and
/// of places that look alike the one that agrees with the motion stays. This is what `esm-cli localize` does without
/// `--single`.
#[pyclass(frozen, module = "esm_py")]
pub(crate) struct SequenceLocalizer {
    inner: Arc<Mutex<core::SequenceLocalizer>>,
    threads: Threads,
}

#[pymethods]
impl SequenceLocalizer {
    #[new]
    #[pyo3(signature = (localizer, *, threads=None))]
    fn new(localizer: &Bound<'_, Localizer>, threads: Option<usize>) -> PyResult<Self> {
        let inner = core::SequenceLocalizer::new(localizer.get().core());
        Ok(Self { inner: Arc::new(Mutex::new(inner)), threads: Threads::new(threads)? })
    }

    /// Find the cloud in the map in the light of those before it.
    fn localize(&self, py: Python<'_>, live: &Bound<'_, LiveCloud>) -> PyResult<Localization> {
        let (inner, live) = (Arc::clone(&self.inner), Arc::clone(&live.get().inner));
        run(py, self.threads, move || inner.lock().unwrap_or_else(PoisonError::into_inner).localize(&live))
            .map(Localization::new)
    }

    /// Forget where the robot was: after a gap, or when it was carried elsewhere.
    fn forget(&self) {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).forget();
    }

    fn __repr__(&self) -> &'static str {
        "SequenceLocalizer()"
    }
}

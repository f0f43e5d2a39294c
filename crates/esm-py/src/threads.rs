//! How many threads a piece of work may use.

use std::collections::BTreeMap;
use std::process;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Most worker threads that can be asked for, as for `esm-cli --threads`.
const MAX_THREADS: usize = 1024;

/// The argument `threads`: a number, or as many as there are processors. The results are the same.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Threads(Option<usize>);

/// Threads are started once for each number that was asked for.
static POOLS: Mutex<BTreeMap<(u32, usize), Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());
/// The process that this module was loaded by.
static HOME: OnceLock<u32> = OnceLock::new();

impl Threads {
    /// Checks the argument.
    pub(crate) fn new(threads: Option<usize>) -> PyResult<Self> {
        match threads {
            Some(n) if !(1..=MAX_THREADS).contains(&n) => {
                Err(PyValueError::new_err(format!("threads must be 1 to {MAX_THREADS} or None, got {n}")))
            }
            _ => Ok(Self(threads)),
        }
    }

    /// The threads to work on; `None` for the ones that everybody shares.
    pub(crate) fn pool(self) -> PyResult<Option<Arc<ThreadPool>>> {
        let process = process::id();
        let count = match self.0 {
            Some(n) => n,
            None if *HOME.get_or_init(process::id) == process => return Ok(None),
            // The shared threads stayed behind in the process that this one was forked from.
            None => std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
        };
        let mut pools = POOLS.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(pool) = pools.get(&(process, count)) {
            return Ok(Some(Arc::clone(pool)));
        }
        let pool = ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(|n| format!("esm_py {n}"))
            .build()
            .map_err(|e| PyRuntimeError::new_err(format!("threads={count}: {e}")))?;
        let pool = Arc::new(pool);
        pools.insert((process, count), Arc::clone(&pool));
        Ok(Some(pool))
    }
}

/// To be called when the module is loaded.
pub(crate) fn remember_process() {
    HOME.get_or_init(process::id);
}

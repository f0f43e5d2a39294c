//! Heavy work off the interpreter: it runs on a thread of its own, detached from Python, while the calling thread waits
//! and looks for Ctrl-C.

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;

use crate::failure::Failure;
use crate::threads::Threads;

/// How often signals are looked for.
const CHECK_EVERY: Duration = Duration::from_millis(50);
/// As much as a main thread has.
const STACK_BYTES: usize = 8 << 20;

/// What the working thread tells.
enum Told<P, T> {
    Progress(P),
    Done(thread::Result<T>),
}

/// Runs `work` and gives what it returns. After Ctrl-C it returns at once: the work goes on unseen until it ends, and
/// what it returns is dropped.
pub(crate) fn run<T, E>(
    py: Python<'_>,
    threads: Threads,
    work: impl FnOnce() -> Result<T, E> + Send + 'static,
) -> PyResult<T>
where
    T: Send + 'static,
    E: Into<Failure> + Send + 'static,
{
    let (_, told) = start::<(), _>(threads, |_| work())?;
    Waiting { told, heard: |(): ()| Ok(true), stop: None }.end(py)
}

/// The same for work that tells how far it has come and stops when it is asked to: `progress` hears it on the calling
/// thread and answers whether to go on. After Ctrl-C, or an exception in `progress`, the work is waited for: what it leaves
/// behind is as it should be. (Another Ctrl-C does not wait.)
pub(crate) fn run_telling<P, T, E>(
    py: Python<'_>,
    threads: Threads,
    progress: impl FnMut(P) -> PyResult<bool>,
    work: impl FnOnce(&mut dyn FnMut(P) -> bool) -> Result<T, E> + Send + 'static,
) -> PyResult<T>
where
    P: Send + 'static,
    T: Send + 'static,
    E: Into<Failure> + Send + 'static,
{
    let (stop, told) = start(threads, work)?;
    Waiting { told, heard: progress, stop: Some(stop) }.end(py)
}

type Started<P, T> = (Arc<AtomicBool>, Receiver<Told<P, T>>);

fn start<P: Send + 'static, T: Send + 'static>(
    threads: Threads,
    work: impl FnOnce(&mut dyn FnMut(P) -> bool) -> T + Send + 'static,
) -> PyResult<Started<P, T>> {
    let pool = threads.pool()?;
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = Arc::clone(&stop);
    let (tell, told): (Sender<Told<P, T>>, _) = channel();
    let body = move || {
        let teller = tell.clone();
        let mut progress =
            move |p| teller.send(Told::Progress(p)).is_ok() && !stopped.load(Ordering::Relaxed);
        let result = catch_unwind(AssertUnwindSafe(|| match pool {
            Some(pool) => pool.install(|| work(&mut progress)),
            None => work(&mut progress),
        }));
        // Nobody listens after a Ctrl-C.
        let _ = tell.send(Told::Done(result));
    };
    thread::Builder::new()
        .name("esm_py".to_owned())
        .stack_size(STACK_BYTES)
        .spawn(body)
        .map_err(|e| PyRuntimeError::new_err(format!("no thread can be started: {e}")))?;
    Ok((stop, told))
}

/// The calling thread's side.
struct Waiting<P, T, F> {
    told: Receiver<Told<P, T>>,
    heard: F,
    /// For work that can be asked to stop.
    stop: Option<Arc<AtomicBool>>,
}

impl<P, T, E, F> Waiting<P, Result<T, E>, F>
where
    P: Send,
    T: Send,
    E: Into<Failure> + Send,
    F: FnMut(P) -> PyResult<bool>,
{
    fn end(self, py: Python<'_>) -> PyResult<T> {
        let Self { mut told, mut heard, stop } = self;
        let mut stopping: Option<PyErr> = None;
        loop {
            let (back, news) = py.detach(move || {
                let news = told.recv_timeout(CHECK_EVERY);
                (told, news)
            });
            told = back;
            let asked = match news {
                Ok(Told::Done(result)) => {
                    let result = result.unwrap_or_else(|panic| resume_unwind(panic));
                    return match stopping {
                        Some(reason) => Err(reason),
                        None => result.map_err(|e| e.into().into()),
                    };
                }
                Ok(Told::Progress(_)) if stopping.is_some() => Ok(true),
                Ok(Told::Progress(p)) => heard(p),
                Err(RecvTimeoutError::Timeout) => Ok(true),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(PyRuntimeError::new_err("the working thread has ended without a result"));
                }
            };
            let asked = asked.and_then(|go_on| py.check_signals().map(|()| go_on));
            match (asked, &stop) {
                (Ok(true), _) => {}
                // The work itself says that it was stopped.
                (Ok(false), Some(stop)) => stop.store(true, Ordering::Relaxed),
                (Ok(false), None) => {}
                (Err(reason), Some(stop)) if stopping.is_none() => {
                    stop.store(true, Ordering::Relaxed);
                    stopping = Some(reason);
                }
                (Err(reason), _) => return Err(reason),
            }
        }
    }
}

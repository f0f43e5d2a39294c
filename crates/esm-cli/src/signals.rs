//! Ctrl-C and termination: the run stops, and no half-written file stays behind.

use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::console;

/// 128 + SIGINT, as shells report it.
pub(crate) const CODE_INTERRUPTED: u8 = 130;

/// How many unfinished files there may be. Locked for good by a process that is about to exit, so that no new one
/// appears meanwhile.
static UNFINISHED: Mutex<usize> = Mutex::new(0);
static STOP: AtomicBool = AtomicBool::new(false);
/// Who wants to know of the first signal, instead of being ended by it.
static WAITING: Mutex<Option<Box<dyn FnOnce() + Send>>> = Mutex::new(None);

/// Takes over the signals. The first one stops the run at once where no file is unfinished, else at the next
/// [`check`]; the second one stops it wherever it is.
pub(crate) fn install() {
    let handled = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(CODE_INTERRUPTED));
        }
        let waiting = WAITING.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).take();
        if let Some(tell) = waiting {
            return tell();
        }
        let unfinished = UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if *unfinished == 0 {
            console::say("interrupted");
            std::process::exit(i32::from(CODE_INTERRUPTED));
        }
    });
    if let Err(error) = handled {
        tracing::debug!("signals are not handled: {error}");
    }
}

/// Has the first signal call `tell` instead of ending the run: for what runs until it is told to stop. The second one ends
/// it all the same.
pub(crate) fn on_first(tell: impl FnOnce() + Send + 'static) {
    *WAITING.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) = Some(Box::new(tell));
}

/// The run was stopped by a signal.
#[derive(Debug)]
pub(crate) struct Interrupted;

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("interrupted")
    }
}

impl std::error::Error for Interrupted {}

/// Asked between two clouds.
pub(crate) fn check() -> Result<(), Interrupted> {
    if STOP.load(Ordering::SeqCst) { Err(Interrupted) } else { Ok(()) }
}

/// To be held while files are unfinished: a signal then waits for [`check`], and whoever is told cleans up.
pub(crate) struct Unfinished(());

impl Unfinished {
    pub(crate) fn begin() -> Self {
        *UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) += 1;
        Self(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        *UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner()) -= 1;
    }
}

//! Ctrl-C and termination: the run stops at once and leaves no half-written file behind.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use crate::console;

/// 128 + SIGINT, as shells report it.
const CODE_INTERRUPTED: i32 = 130;

/// Temporary files to be removed.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());
/// Held while a library writes a file under a temporary name of its own choice: short, and not to be interrupted.
static WRITING: Mutex<()> = Mutex::new(());

/// Takes over the signals.
pub(crate) fn install() {
    let handled = ctrlc::set_handler(|| {
        let _finished = WRITING.lock();
        // Never unlocked again: no new temporary file may appear between here and the exit.
        if let Ok(files) = UNFINISHED.lock() {
            for file in files.iter() {
                // What cannot be removed is hidden and never read.
                let _ = std::fs::remove_file(file);
            }
            console::say("interrupted");
            std::process::exit(CODE_INTERRUPTED);
        }
        std::process::exit(CODE_INTERRUPTED);
    });
    if let Err(error) = handled {
        tracing::debug!("signals are not handled: {error}");
    }
}

/// Runs a short write that must be finished before the process may stop.
pub(crate) fn uninterrupted<R>(write: impl FnOnce() -> R) -> R {
    let _writing = WRITING.lock();
    write()
}

/// Remembers a temporary file that `create` makes, until it is [`forget`]ed.
pub(crate) fn remember<E>(
    create: impl FnOnce() -> Result<tempfile::NamedTempFile, E>,
) -> Result<tempfile::NamedTempFile, E> {
    let mut files = UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let file = create()?;
    files.push(file.path().to_owned());
    Ok(file)
}

/// The file has its final name, or is gone.
pub(crate) fn forget(path: &Path) {
    let mut files = UNFINISHED.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    files.retain(|file| file != path);
}

//! Data on stdout. A reader that leaves (`| head`) is not an error.

use std::fmt;
use std::io::{self, Write};

use crate::console;

/// Whoever read our stdout has gone.
#[derive(Debug)]
pub struct StdoutClosed;

impl fmt::Display for StdoutClosed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("nobody reads stdout any more")
    }
}

impl std::error::Error for StdoutClosed {}

/// Writes to stdout, whole.
///
/// # Errors
/// [`StdoutClosed`] where nobody reads; the system's error otherwise.
pub(crate) fn data(bytes: &[u8]) -> anyhow::Result<()> {
    let written = console::without_bars(|| {
        let mut out = io::stdout().lock();
        out.write_all(bytes).and_then(|()| out.flush())
    });
    match written {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == io::ErrorKind::BrokenPipe => Err(StdoutClosed.into()),
        Err(e) => Err(anyhow::Error::new(e).context("writing to stdout")),
    }
}

/// A stream of lines for stdout.
pub(crate) struct Lines {
    needed: bool,
    open: bool,
}

impl Lines {
    /// `needed` says whether the run is pointless once nobody reads: false where it writes files too.
    pub(crate) fn new(needed: bool) -> Self {
        Self { needed, open: true }
    }

    /// Writes nothing, and says nothing about it.
    pub(crate) fn silent() -> Self {
        Self { needed: false, open: false }
    }

    /// Whether nothing is written from the start.
    pub(crate) fn is_silent(&self) -> bool {
        !self.open
    }

    /// Writes a line.
    ///
    /// # Errors
    /// As [`data`]; where lines are not needed, a closed stdout only silences the rest.
    pub(crate) fn line(&mut self, line: &str) -> anyhow::Result<()> {
        if !self.open {
            return Ok(());
        }
        match data(format!("{line}\n").as_bytes()) {
            Err(error) if !self.needed && error.is::<StdoutClosed>() => {
                self.open = false;
                Ok(())
            }
            other => other,
        }
    }
}

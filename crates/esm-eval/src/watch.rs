//! Who is told how far the work has come, and may stop it.

use crate::error::Error;

/// How far the work has come.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// So many of the results are there.
    Results {
        /// Those that are there.
        done: usize,
        /// All of them.
        total: usize,
    },
    /// Something longer begins.
    Begins {
        /// In words.
        what: String,
        /// How many steps it has, where that is known.
        steps: Option<u64>,
    },
    /// One more step of it is done.
    Step,
    /// So many steps of it are done.
    At(u64),
}

/// Hears of every [`Event`]; where it answers `false` the evaluation stops with [`Error::Interrupted`].
pub type Watch<'a> = dyn FnMut(Event) -> bool + Send + 'a;

/// Tells, and gives up where that is asked for.
pub(crate) struct Teller<'a, 'b>(pub(crate) &'a mut Watch<'b>);

impl Teller<'_, '_> {
    pub(crate) fn tell(&mut self, event: Event) -> Result<(), Error> {
        if (self.0)(event) { Ok(()) } else { Err(Error::Interrupted) }
    }

    pub(crate) fn begins(&mut self, what: impl Into<String>, steps: Option<usize>) -> Result<(), Error> {
        self.tell(Event::Begins { what: what.into(), steps: steps.map(|n| n as u64) })
    }

    pub(crate) fn step(&mut self) -> Result<(), Error> {
        self.tell(Event::Step)
    }
}

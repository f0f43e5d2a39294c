//! Judging segment matching: the same places, several methods, one protocol.
//!
//! A [`Plan`] names datasets (recordings, or worlds to simulate), methods (descriptors with their settings) and modes (how live
//! clouds are made). [`evaluate`] follows it: every method maps every place and localizes its second visit in every mode,
//! judged by the [`truth`] protocol; and every descriptor tells pairs of segments apart ([`Roc`]). Each result is kept in
//! a cache by the digest of all that goes into it, so nothing is computed twice and a run that was stopped goes on. A
//! [`Report`] adds it up and writes tables, JSON and CSV.
//!
//! ```
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use esm_eval::{Options, Plan, Report, evaluate};
//! # let dir = tempfile::tempdir()?;
//! # let dir = dir.path();
//! std::fs::write(dir.join("plan.toml"), r#"
//!     datasets = [{ name = "wood", preset = "cornbury", seeds = [200], scale = 0.01, accumulate = 4 }]
//!     methods = [{ name = "shape" }]
//! "#)?;
//! let plan = Plan::read(&dir.join("plan.toml"))?;
//! let options = Options { work: dir.join("work"), program: "example".to_owned(), reuse_older: false };
//! let first = evaluate(&plan, &options, &mut |_| true)?;
//! assert_eq!((first.computed, first.kept), (1, 0));
//! let again = evaluate(&plan, &options, &mut |_| true)?;
//! assert_eq!((again.computed, again.kept), (0, 1));
//! assert_eq!(again.outcomes, first.outcomes);
//! println!("{}", Report::of(&again).table());
//! # Ok(())
//! # }
//! ```

mod cache;
mod digest;
mod error;
mod maps;
pub mod memory;
mod method;
mod objects;
mod plan;
mod report;
mod roc;
mod run;
mod site;
mod stats;
mod trial;
pub mod truth;
mod watch;

pub use error::Error;
pub use objects::object_of;
pub use plan::{Dataset, Files, Method, Mode, Plan, RocPlan, Simulated, Source};
pub use report::{Pooled, Report};
pub use roc::{Curve, RANKS, Roc};
pub use run::{Apart, Evaluation, Job, Options, Outcome, RocOutcome, evaluate, evaluate_apart};
pub use stats::Share;
pub use trial::{Cloud, Counts, STAGES, Trial};
pub use watch::{Event, Watch};

/// The digest of a file's content, or of the names and contents of a directory's files, in hexadecimal digits.
///
/// # Errors
/// [`Error::Io`].
pub fn digest_of(path: &std::path::Path) -> Result<String, Error> {
    digest::of_input(path)
}

//! From candidate matches to a verified pose.

mod candidate;
mod clique;
mod consistency;
pub mod prosac;
mod rigid;

pub use candidate::{Candidate, sort_by_quality};
pub use clique::{Clique, max_clique};
pub use consistency::{Agreement, ConsistencyGraph};
pub use rigid::{Estimator, FourDof, Pair, SixDof};

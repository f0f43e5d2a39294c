//! From candidate matches to a verified pose.
//!
//! The search is Sampler x Estimator x Consensus ([`best_sample`]), so that each varies alone, or the maximum clique
//! of the consistency graph; [`search`] is the door that the localizer uses.

mod candidate;
mod clique;
mod consensus;
mod consistency;
pub mod prosac;
mod rigid;
mod sampler;
mod search;

pub use candidate::{Candidate, sort_by_quality};
pub use clique::{Clique, max_clique};
pub use consensus::{Consensus, NearCentroids, Support};
pub use consistency::{Agreement, ConsistencyGraph, Cores};
pub use rigid::{Estimator, FourDof, Pair, SixDof};
pub use sampler::{Prosac, Ransac, Sampler};
pub use search::{Hypothesis, Method, PoseConfig, best_sample, same_place, search};

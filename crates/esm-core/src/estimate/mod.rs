//! From candidate matches to a verified pose.
//!
//! [`search`] is the door that the localizer uses: by default the maximum clique of the consistency graph; by sampling,
//! it is Sampler x Estimator x Consensus ([`best_sample`]), so that each varies alone.

mod agreement;
mod beta;
mod bins;
mod branch;
mod candidate;
mod clique;
mod config;
mod consensus;
mod consistency;
mod extents;
mod groups;
mod incremental;
mod pairs;
pub mod prosac;
mod rigid;
mod sampled;
mod sampler;
mod search;
mod settle;
mod stats;
mod turns;

pub use agreement::Agreement;
pub use beta::measured_beta;
pub use candidate::{ANY_TURN, Candidate, sort_by_quality};
pub use clique::{Clique, max_clique};
pub use config::{Method, Order, PoseConfig};
pub use consensus::{Consensus, NearCentroids, Support};
pub use consistency::ConsistencyGraph;
pub use extents::{Widths, compare_extents};
pub use incremental::{IncrementalRecognizer, Reuse};
pub use rigid::{Estimator, FourDof, Pair, SixDof};
pub use sampled::best_sample;
pub use sampler::{Prosac, Ransac, Sampler};
pub use search::{Found, search, search_in};
pub use settle::{Hypothesis, same_place};
pub use stats::SearchStats;

//! What a pose search took.

/// What a pose search took: the effort, counted and not timed, so that it is the same on every machine.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SearchStats {
    /// Pairs of candidates that were tested for agreement.
    pub pair_tests: u64,
    /// Pairs that agree.
    pub edges: usize,
    /// Candidates left after those that no group of the least size can hold.
    pub kept: usize,
    /// Groups that were looked for; each gives a place at most.
    pub groups: usize,
    /// Samples drawn for the first group. (PROSAC and RANSAC)
    pub first_samples: usize,
    /// Samples drawn for all of them.
    pub samples: usize,
    /// Branches visited for the first group. (clique)
    pub first_branches: usize,
    /// Branches visited for all of them.
    pub branches: usize,
    /// Groups that may not be the largest: the effort ran out. (clique)
    pub unproven: usize,
    /// Chance that a candidate agrees with a wrong pose, as used. (PROSAC)
    pub beta: f64,
}

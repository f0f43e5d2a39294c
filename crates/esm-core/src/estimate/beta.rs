//! PROSAC's beta, measured: the chance that a candidate agrees with a wrong pose.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::candidate::Candidate;
use super::config::PoseConfig;
use super::consensus::{Consensus, NearCentroids};
use super::rigid::Pair;
use super::sampled::estimator;

/// Wrong poses that are counted on.
const POSES: usize = 50;
/// Samples drawn to find them.
const MOST_DRAWS: usize = 20_000;
/// As if one agreement in a hundred had been seen before anything is measured: what beta is commonly taken to be.
const PRIOR: f64 = 0.01;
const PRIOR_COUNT: f64 = 100.0;

/// The chance that a candidate agrees with a wrong pose, by counting: each list of candidates is given to another live
/// segment, at random, so that no match is right; poses are fitted to samples that agree all the same, as the search
/// would, and the other candidates that agree with them are counted.
///
/// The same seed gives the same figure. Costs about `POSES` counts of the support.
pub fn measured_beta(candidates: &[Candidate], config: &PoseConfig, seed: u64) -> f64 {
    let (agreement, estimator) = (config.agreement(), estimator(config));
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut below = |n: usize| ((u64::from(random.next_u32()) * n as u64) >> 32) as usize;
    let shuffled = shuffled(candidates, &mut below);
    let m = estimator.sample_size();
    let (mut agreeing, mut asked, mut poses) = (0usize, 0usize, 0);
    if shuffled.len() > m {
        let mut consensus = NearCentroids::new(&shuffled, config.inlier_m as f32, config.tilt_rad());
        for _ in 0..MOST_DRAWS {
            let sample: Vec<Candidate> = (0..m).map(|_| shuffled[below(shuffled.len())]).collect();
            let possible = (0..m).all(|i| (0..i).all(|j| agreement.holds(&sample[i], &sample[j])));
            let pairs: Vec<Pair> = sample.iter().map(|c| c.pair).collect();
            let Some(pose) = possible.then(|| estimator.estimate(&pairs)).flatten() else { continue };
            agreeing += consensus.support(&pose).inliers.len().saturating_sub(m);
            asked += shuffled.len() - m;
            poses += 1;
            if poses == POSES {
                break;
            }
        }
    }
    (agreeing as f64 + PRIOR * PRIOR_COUNT) / (asked as f64 + PRIOR_COUNT)
}

/// The candidates with their lists moved round among the live segments.
fn shuffled(candidates: &[Candidate], below: &mut dyn FnMut(usize) -> usize) -> Vec<Candidate> {
    let mut at: Vec<(u32, [f32; 3])> = candidates.iter().map(|c| (c.live, c.pair.live)).collect();
    at.sort_by_key(|a| a.0);
    at.dedup_by_key(|a| a.0);
    // Sattolo's shuffle: one cycle, so that none keeps its own list.
    let mut to: Vec<usize> = (0..at.len()).collect();
    for i in (1..to.len()).rev() {
        to.swap(i, below(i));
    }
    candidates
        .iter()
        .map(|c| {
            let own = at.partition_point(|a| a.0 < c.live);
            let (live, centroid) = at[to[own]];
            Candidate { live, pair: Pair { live: centroid, ..c.pair }, ..*c }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `live` segments with `k` candidates each, spread over a square of `side` metres.
    fn scattered(live: u32, k: u32, side: f32) -> Vec<Candidate> {
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let mut up_to = |most: f32| (random.next_u32() >> 8) as f32 / (1 << 24) as f32 * most;
        let mut all = Vec::new();
        for l in 0..live {
            let at = [up_to(80.0), up_to(80.0), 0.0];
            for i in 0..k {
                let pair = Pair { live: at, map: [up_to(side), up_to(side), 0.0] };
                let (map, turns) = (l * k + i, u64::MAX);
                all.push(Candidate { live: l, map, distance: 0.0, quality: 1.0, pair, turns });
            }
        }
        all
    }

    fn measured(candidates: &[Candidate], seed: u64) -> f64 {
        let config = PoseConfig { resolution_m: 0.5, inlier_m: 0.8, max_tilt_deg: 0.0, ..Default::default() };
        measured_beta(candidates, &config, seed)
    }

    #[test]
    fn it_is_the_share_of_the_map_that_one_inlier_takes() {
        // Candidates spread evenly over a square: one falls within 0.8 m of where it should with this chance; the pose's
        // own cloud may reach beyond the square's edge, so it is somewhat less.
        for side in [100.0f32, 200.0] {
            let candidates = scattered(46, 25, side);
            let want = f64::from(std::f32::consts::PI * 0.8 * 0.8 / side / side);
            let found = measured(&candidates, 1);
            assert!(found > 0.3 * want && found < 2.0 * want, "{side} m: {found:.6}, {want:.6}");
        }
    }

    #[test]
    fn the_same_seed_measures_the_same_and_nothing_gives_the_prior() {
        let candidates = scattered(30, 20, 150.0);
        assert_eq!(measured(&candidates, 5).to_bits(), measured(&candidates, 5).to_bits());
        assert_eq!(measured(&[], 5), PRIOR);
        assert_eq!(measured(&candidates[..1], 5), PRIOR);
    }
}

//! Groups by sampling: Sampler x Estimator x Consensus.

use std::cell::Cell;

use super::candidate::Candidate;
use super::config::{Method, Order, PoseConfig};
use super::consensus::{Consensus, NearCentroids, Support};
use super::rigid::{Estimator, FourDof, SixDof};
use super::sampler::{Prosac, Ransac, Sampler};

/// Two matches fix a pose where gravity is known, three otherwise.
pub(super) fn estimator(config: &PoseConfig) -> &'static dyn Estimator {
    if config.gravity { &FourDof } else { &SixDof }
}

/// Puts candidate indices, best first by quality as they ascend, into the configured order.
pub(super) fn put_in_order(pool: &mut [u32], candidates: &[Candidate], order: Order) {
    match order {
        Order::Quality => {}
        Order::Distance => pool.sort_by(|a, b| {
            let [x, y] = [a, b].map(|i| &candidates[*i as usize]);
            x.distance.total_cmp(&y.distance).then((x.live, x.map).cmp(&(y.live, y.map)))
        }),
    }
}

/// The best of all samples drawn.
pub(super) struct Sampled {
    /// By index into the candidates given.
    pub(super) support: Support,
    pub(super) samples: usize,
    pub(super) pair_tests: u64,
}

/// Draws samples of candidates, which stand in the order they are to be tried in. Samples that disagree among themselves
/// are rejected at once.
pub(super) fn sampled_group(candidates: &[Candidate], config: &PoseConfig, beta: f64, seed: u64) -> Sampled {
    let estimator = estimator(config);
    let m = estimator.sample_size();
    let mut sampler: Box<dyn Sampler> = match config.method {
        Method::Ransac => Box::new(Ransac::new(candidates.len(), m, config.max_draws, seed)),
        _ => Box::new(Prosac::new(candidates.len(), m, beta, config.max_draws, seed)),
    };
    let mut consensus = NearCentroids::new(candidates, config.inlier_m as f32, config.tilt_rad());
    let (agreement, pair_tests) = (config.agreement(), Cell::new(0));
    let holds = |a: usize, b: usize| {
        pair_tests.set(pair_tests.get() + 1);
        agreement.holds(&candidates[a], &candidates[b])
    };
    let possible =
        |sample: &[usize]| sample.iter().enumerate().all(|(i, a)| sample[..i].iter().all(|b| holds(*a, *b)));
    let support = best_sample(&mut *sampler, estimator, &mut consensus, candidates, &possible);
    Sampled { support, samples: sampler.draws(), pair_tests: pair_tests.get() }
}

/// Draws, rejects what is impossible, fits, counts, and keeps the best: Sampler x Estimator x Consensus.
pub fn best_sample(
    sampler: &mut dyn Sampler,
    estimator: &dyn Estimator,
    consensus: &mut dyn Consensus,
    candidates: &[Candidate],
    possible: &dyn Fn(&[usize]) -> bool,
) -> Support {
    let mut sample = vec![0; estimator.sample_size()];
    let mut pairs = Vec::with_capacity(sample.len());
    let mut best = Support::default();
    while sampler.draw(&mut sample) {
        if !possible(&sample) {
            continue;
        }
        pairs.clear();
        pairs.extend(sample.iter().map(|i| candidates[*i].pair));
        let Some(pose) = estimator.estimate(&pairs) else { continue };
        let support = consensus.support(&pose);
        if support.beats(&best) {
            let mut inlier = vec![false; candidates.len()];
            support.inliers.iter().for_each(|i| inlier[*i as usize] = true);
            sampler.observe(&inlier);
            best = support;
        }
    }
    best
}

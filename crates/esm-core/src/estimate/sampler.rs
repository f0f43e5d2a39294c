//! Which candidates to try together next: the `Sampler` of the pose search.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::prosac::{growth, maximality_draws, non_random_support};

/// Proposes minimal samples out of candidates sorted best first.
pub trait Sampler {
    /// Fills `sample` with distinct candidate indices; `false` when sampling is over.
    fn draw(&mut self, sample: &mut [usize]) -> bool;
    /// Learns of the best support so far: for each candidate, best first, whether it agrees.
    fn observe(&mut self, inlier: &[bool]);
    /// Samples drawn so far.
    fn draws(&self) -> usize;
}

/// PROSAC (Chum and Matas, CVPR 2005): the pool grows from the best candidates to all of them.
pub struct Prosac {
    rng: ChaCha8Rng,
    growth: Vec<f64>,
    non_random: Vec<usize>,
    /// Sample size.
    m: usize,
    /// Pool size.
    n: usize,
    /// Termination length.
    n_star: usize,
    t: usize,
    /// Draw at which the search may stop.
    stop_at: f64,
    most_draws: usize,
}

impl Prosac {
    /// A sampler over `total` candidates, samples of `m`. `beta`: the chance that a candidate agrees with a wrong
    /// pose by accident. The same seed gives the same samples.
    pub fn new(total: usize, m: usize, beta: f64, most_draws: usize, seed: u64) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            growth: growth(total, m),
            non_random: non_random_support(total, m, beta),
            m,
            n: m,
            n_star: total,
            t: 0,
            stop_at: f64::INFINITY,
            most_draws,
        }
    }
}

impl Sampler for Prosac {
    fn draw(&mut self, sample: &mut [usize]) -> bool {
        let total = self.growth.len() - 1;
        if total < self.m || self.t >= self.most_draws || self.t as f64 >= self.stop_at {
            return false;
        }
        self.t += 1;
        if self.t as f64 > self.growth[self.n] && self.n < self.n_star {
            self.n += 1;
        }
        if self.t as f64 > self.growth[self.n] {
            // Finishing: the pool is at its final size, draw from all of it.
            distinct(&mut self.rng, self.n, sample);
        } else {
            let last = sample.len() - 1;
            distinct(&mut self.rng, self.n - 1, &mut sample[..last]);
            sample[last] = self.n - 1;
        }
        true
    }

    fn observe(&mut self, inlier: &[bool]) {
        // The termination length n* is the one that lets the search stop soonest, among those where the support is
        // no accident (section 2.2).
        let mut support = 0;
        for (i, agrees) in inlier.iter().enumerate() {
            support += usize::from(*agrees);
            let n = i + 1;
            if *agrees && n >= self.m && support >= self.non_random[n] {
                let draws = maximality_draws(support, n, self.m);
                if draws < self.stop_at {
                    (self.stop_at, self.n_star) = (draws, n.max(self.n));
                }
            }
        }
    }

    fn draws(&self) -> usize {
        self.t
    }
}

/// RANSAC with uniform samples, for comparison: order and quality mean nothing to it.
pub struct Ransac {
    rng: ChaCha8Rng,
    total: usize,
    m: usize,
    t: usize,
    stop_at: f64,
    most_draws: usize,
}

impl Ransac {
    /// A sampler over `total` candidates, samples of `m`.
    pub fn new(total: usize, m: usize, most_draws: usize, seed: u64) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(seed), total, m, t: 0, stop_at: f64::INFINITY, most_draws }
    }
}

impl Sampler for Ransac {
    fn draw(&mut self, sample: &mut [usize]) -> bool {
        if self.total < self.m || self.t >= self.most_draws || self.t as f64 >= self.stop_at {
            return false;
        }
        self.t += 1;
        distinct(&mut self.rng, self.total, sample);
        true
    }

    fn observe(&mut self, inlier: &[bool]) {
        let support = inlier.iter().filter(|i| **i).count();
        self.stop_at = self.stop_at.min(maximality_draws(support, self.total, self.m));
    }

    fn draws(&self) -> usize {
        self.t
    }
}

/// Fills `sample` with distinct indices below `n`, which must be at least the sample's length.
fn distinct(rng: &mut ChaCha8Rng, n: usize, sample: &mut [usize]) {
    for i in 0..sample.len() {
        loop {
            // Lemire's multiplication instead of a remainder; the bias of 2^-32 * n is beyond notice.
            let index = ((u64::from(rng.next_u32()) * n as u64) >> 32) as usize;
            if !sample[..i].contains(&index) {
                sample[i] = index;
                break;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prosac_begins_with_the_best_and_grows_by_its_table() {
        let (mut sampler, table) = (Prosac::new(100, 3, 0.01, 400, 1), growth(100, 3));
        let mut sample = [0; 3];
        let mut t = 0;
        while sampler.draw(&mut sample) {
            t += 1;
            let newest = *sample.iter().max().unwrap();
            let pool = (3..=100).find(|n| table[*n] >= t as f64).unwrap_or(100);
            assert!(newest < pool, "draw {t}: {sample:?}, pool {pool}");
            assert!(sample[0] != sample[1] && sample[1] != sample[2] && sample[0] != sample[2]);
        }
        assert_eq!(t, 400);
    }

    #[test]
    fn strong_support_among_the_best_stops_the_search_soon() {
        let mut sampler = Prosac::new(1000, 3, 0.01, 200_000, 1);
        let mut sample = [0; 3];
        sampler.draw(&mut sample);
        let inlier: Vec<bool> = (0..1000).map(|i| i < 20).collect();
        sampler.observe(&inlier);
        while sampler.draw(&mut sample) {}
        assert!(sampler.draws() < 20, "{}", sampler.draws());
    }

    #[test]
    fn support_that_may_be_an_accident_does_not_stop_the_search() {
        let mut sampler = Prosac::new(1000, 3, 0.1, 5_000, 1);
        let mut sample = [0; 3];
        sampler.draw(&mut sample);
        let inlier: Vec<bool> = (0..1000).map(|i| i % 20 == 0).collect();
        sampler.observe(&inlier);
        while sampler.draw(&mut sample) {}
        assert_eq!(sampler.draws(), 5_000);
    }

    #[test]
    fn the_same_seed_draws_the_same() {
        let run = |seed| {
            let (mut sampler, mut sample) = (Ransac::new(50, 2, 100, seed), [0; 2]);
            std::iter::from_fn(|| sampler.draw(&mut sample).then_some(sample)).collect::<Vec<_>>()
        };
        assert_eq!(run(7), run(7));
        assert_ne!(run(7), run(8));
    }

    #[test]
    fn too_few_candidates_give_no_sample() {
        assert!(!Prosac::new(2, 3, 0.01, 10, 1).draw(&mut [0; 3]));
        assert!(!Ransac::new(1, 2, 10, 1).draw(&mut [0; 2]));
    }
}

//! [`Pairs`]: which segments are compared.

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::views::Views;

/// A negative lies at least this far away (SegMap's protocol), metres.
const FAR_M: f64 = 20.0;
/// Height and both extents of a hard negative differ by less than this share of the live segment's.
const ALIKE: f64 = 0.2;
/// Draws after which a live segment goes without a random negative.
const TRIES: usize = 64;

/// Pairs of a live and a map segment, by their places in the views.
pub(crate) struct Pairs {
    /// Live segments that have a counterpart.
    pub(crate) judged: Vec<usize>,
    /// One counterpart of each.
    pub(crate) positive: Vec<(usize, usize)>,
    /// Others, anywhere.
    pub(crate) random: Vec<(usize, usize)>,
    /// Others that look alike by size.
    pub(crate) hard: Vec<(usize, usize)>,
}

impl Pairs {
    pub(super) fn draw(map: &Views, live: &Views, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut views_of: BTreeMap<i64, Vec<usize>> = BTreeMap::new();
        for (i, object) in map.objects.iter().enumerate().filter(|(_, o)| **o >= 0) {
            views_of.entry(*object).or_default().push(i);
        }
        let judged: Vec<usize> =
            (0..live.objects.len()).filter(|&i| views_of.contains_key(&live.objects[i])).collect();
        let mut pairs = Self { judged, positive: Vec::new(), random: Vec::new(), hard: Vec::new() };
        for &i in &pairs.judged {
            let counterparts = &views_of[&live.objects[i]];
            pairs.positive.push((i, counterparts[rng.random_range(0..counterparts.len())]));
            let far = |m: usize| distance(&live.centroids[i], &map.centroids[m]) >= FAR_M;
            let mut draws = (0..TRIES).map(|_| rng.random_range(0..map.objects.len()));
            pairs.random.extend(draws.find(|&m| far(m)).map(|m| (i, m)));
            let alike = |m: usize| {
                let (own, other) = (&live.sizes[i], &map.sizes[m]);
                own.iter().zip(other).all(|(a, b)| (a - b).abs() < ALIKE * a)
            };
            let candidates: Vec<usize> = (0..map.objects.len()).filter(|&m| alike(m) && far(m)).collect();
            if !candidates.is_empty() {
                pairs.hard.push((i, candidates[rng.random_range(0..candidates.len())]));
            }
        }
        pairs
    }
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views(rows: &[(i64, f64, [f64; 3])]) -> Views {
        Views {
            segments: Vec::new(),
            centroids: rows.iter().map(|r| [r.1, 0.0, 0.0]).collect(),
            objects: rows.iter().map(|r| r.0).collect(),
            sizes: rows.iter().map(|r| r.2).collect(),
        }
    }

    #[test]
    fn pairs_are_what_they_are_called() {
        let (small, large) = ([1.0, 2.0, 2.0], [5.0, 9.0, 4.0]);
        let map =
            views(&[(0, 0.0, small), (1, 50.0, large), (2, 90.0, small), (-1, 10.0, small), (0, 0.4, small)]);
        let live = views(&[(0, 0.2, [1.1, 2.1, 2.0]), (7, 3.0, small), (-1, 0.0, small), (1, 50.1, large)]);
        for seed in 0..20 {
            let pairs = Pairs::draw(&map, &live, seed);
            assert_eq!(pairs.judged, [0, 3], "others have no counterpart, or no name");
            assert!(pairs.positive.iter().all(|(l, m)| live.objects[*l] == map.objects[*m]));
            assert!(
                pairs
                    .random
                    .iter()
                    .all(|(l, m)| (live.centroids[*l][0] - map.centroids[*m][0]).abs() >= 20.0)
            );
            assert_eq!(pairs.hard, [(0, 2)], "of the large one there is no likeness");
        }
    }
}

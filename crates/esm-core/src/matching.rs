//! Matching: for every live segment its K nearest map segments, as candidates sorted by quality.

use std::borrow::Cow;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::describe::{Descriptions, Descriptor, PairJudge};
use crate::error::{Error, require};
use crate::estimate::{ANY_TURN, Candidate, Pair, sort_by_quality};
use crate::index::{Index, Search};
use crate::map::Map;
use crate::segment::Segment;

/// Configuration of matching.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct MatchConfig {
    /// Candidates a live segment; 0: as many as the descriptor asks for ([`Descriptions::candidates`]), or
    /// 60. (The paper's networks use 25, SegMatch's hand-made features 200.)
    pub k: usize,
    /// Most candidates of a cloud: clouds of very many segments, as in a dense wood, take fewer than `k` a segment, but
    /// never fewer than 5. The pose search's effort grows with the square of it: 12 ms where 5000 lie on one spot.
    pub max_candidates: usize,
    /// How the nearest are searched; the answers are the same.
    pub search: Search,
    /// Live segments whose descriptor is less likely than this to be good for matching are left out, 0 to 1.
    pub min_quality: f64,
    /// Candidates farther than this in descriptor space (L2) are dropped; 0 keeps all.
    pub max_distance: f64,
    /// The same by the descriptor's own ROC: the distance under which this share of the pairs of different objects
    /// falls; 0 keeps all. (The paper: 0.1 in towns, 0.2 in woods; networks bring these two.)
    pub max_false_positive_rate: f64,
}

impl Default for MatchConfig {
    fn default() -> Self {
        Self {
            k: 0,
            max_candidates: 5000,
            search: Search::Auto,
            min_quality: 0.0,
            max_distance: 0.0,
            max_false_positive_rate: 0.0,
        }
    }
}

impl MatchConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require(self.k <= 10_000, "match.k", self.k, "0 to 10000")?;
        require(
            (100..=1_000_000).contains(&self.max_candidates),
            "match.max_candidates",
            self.max_candidates,
            "100 to 1000000",
        )?;
        require((0.0..=1.0).contains(&self.min_quality), "match.min_quality", self.min_quality, "0 to 1")?;
        require(self.max_distance >= 0.0, "match.max_distance", self.max_distance, "0 or more")?;
        let rate = self.max_false_positive_rate;
        require((0.0..1.0).contains(&rate), "match.max_false_positive_rate", rate, "0 to 1")
    }

    /// With the distance that `max_false_positive_rate` stands for, of the two limits the stricter one.
    ///
    /// # Errors
    /// [`Error::Config`] where the descriptor's ROC was not measured at that rate.
    pub fn of(&self, descriptor: &dyn Descriptor) -> Result<Self, Error> {
        let rate = self.max_false_positive_rate;
        if rate == 0.0 {
            return Ok(self.clone());
        }
        let at_rate = descriptor.distance_at_rate(rate);
        require(at_rate.is_some(), "match.max_false_positive_rate", rate, "0, or with a network 0.1 or 0.2")?;
        let limits = [self.max_distance, at_rate.unwrap_or_default()];
        let strictest = limits.into_iter().filter(|d| *d > 0.0).fold(f64::INFINITY, f64::min);
        Ok(Self { max_distance: strictest, ..self.clone() })
    }
}

/// Candidates a segment where nothing else is said.
const DEFAULT_K: usize = 60;
/// Candidates a segment that no limit takes away.
const LEAST_K: usize = 5;

/// The leading `searched` numbers of row-major rows of `dim`.
pub fn leading(rows: &[f32], dim: usize, searched: usize) -> Cow<'_, [f32]> {
    if searched >= dim {
        return Cow::Borrowed(rows);
    }
    Cow::Owned(rows.chunks_exact(dim).flat_map(|row| &row[..searched]).copied().collect())
}

/// Lets a judge go through the candidates: those it finds less probable than its limit are dropped, of the others the
/// `most` most probable stay, best first, and that is their quality.
pub fn judged(
    mut candidates: Vec<Candidate>,
    judge: &dyn PairJudge,
    described: &Descriptions,
    map: &Map,
    most: usize,
) -> Vec<Candidate> {
    let (dim, least) = (described.dim, judge.least());
    let (live, mapped) = (&described.values, map.descriptors());
    candidates.par_iter_mut().for_each(|c| {
        let (l, m) = (c.live as usize * dim, c.map as usize * dim);
        c.quality = judge.probability(&live[l..l + dim], &mapped[m..m + dim]);
    });
    candidates.retain(|c| c.quality >= least);
    sort_by_quality(&mut candidates);
    candidates.truncate(most);
    candidates
}

/// The candidates of a cloud, best first: `config.k` a segment at most. `described` must be on the map's scale already.
/// The index is over the numbers that are searched by.
pub fn candidates(
    segments: &[Segment],
    described: &Descriptions,
    map: &Map,
    index: &Index,
    config: &MatchConfig,
) -> Vec<Candidate> {
    let max_squared =
        if config.max_distance > 0.0 { config.max_distance.powi(2) as f32 } else { f32::INFINITY };
    let share = config.max_candidates / segments.len().max(1);
    let wanted =
        [config.k, described.candidates, DEFAULT_K].into_iter().find(|k| *k > 0).unwrap_or(DEFAULT_K);
    let k = wanted.min(share.max(LEAST_K));
    let neighbours = index.nearest(&leading(&described.values, described.dim, index.dim()), k);
    let mut all = Vec::with_capacity(segments.len() * k);
    for (live, (segment, nearest)) in segments.iter().zip(neighbours).enumerate() {
        if f64::from(described.quality[live]) < config.min_quality {
            continue;
        }
        for n in nearest.into_iter().filter(|n| n.distance <= max_squared) {
            let row = n.row as usize;
            all.push(Candidate {
                live: live as u32,
                map: n.row,
                distance: n.distance,
                quality: described.quality[live] * map.quality()[row],
                pair: Pair { live: segment.centroid, map: map.segments()[row].centroid },
                turns: ANY_TURN,
            });
        }
    }
    sort_by_quality(&mut all);
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::describe::by_name;
    use crate::map::{DescriptorInfo, MapData};

    /// Rows that differ little are probably of one object.
    struct Alike;

    impl PairJudge for Alike {
        fn probability(&self, live: &[f32], map: &[f32]) -> f32 {
            1.0 - (live[1] - map[1]).abs()
        }

        fn least(&self) -> f32 {
            0.5
        }
    }

    #[test]
    fn the_search_goes_by_the_leading_numbers_and_the_judge_by_the_others() {
        let segment = Segment::from_points(vec![[0.0; 3]]).unwrap();
        let info = DescriptorInfo { name: "two".into(), version: 1, dim: 2 };
        let mut data = MapData::new([0.0; 3], info);
        for row in [[0.0, 0.9], [1.0, 0.3], [2.0, 0.2], [3.0, 0.0]] {
            data.push_segment(&segment, 1).unwrap();
            data.descriptors.extend(row);
            data.quality.push(1.0);
        }
        let map = Map::from_data(data).unwrap();
        let described =
            Descriptions { dim: 2, values: vec![0.1, 0.1], quality: vec![1.0], ..Default::default() };
        let index = Index::new(&leading(map.descriptors(), 2, 1), 1, Search::Auto);
        let config = MatchConfig { k: 3, ..Default::default() };
        let found = candidates(&[segment], &described, &map, &index, &config);
        // By the first number alone: the last row is the farthest.
        assert_eq!(found.iter().map(|c| c.map).collect::<Vec<_>>(), [0, 1, 2]);
        let kept = judged(found.clone(), &Alike, &described, &map, 5);
        // Row 0 is the nearest, and none of it to the judge.
        assert_eq!(kept.iter().map(|c| c.map).collect::<Vec<_>>(), [2, 1]);
        assert!((kept[0].quality - 0.9).abs() < 1e-6 && (kept[1].quality - 0.8).abs() < 1e-6);
        assert_eq!(judged(found, &Alike, &described, &map, 1), kept[..1]);
    }

    #[test]
    fn a_rate_is_a_distance_that_the_weights_bring() {
        let network = by_name("esm-swift").unwrap();
        let config = |rate, max_distance| MatchConfig {
            max_false_positive_rate: rate,
            max_distance,
            ..Default::default()
        };
        assert_eq!(config(0.0, 0.0).of(&*network).unwrap().max_distance, 0.0);
        let [urban, forest] = [0.1, 0.2].map(|rate| config(rate, 0.0).of(&*network).unwrap().max_distance);
        assert!(0.0 < urban && urban < forest, "{urban} {forest}");
        assert_eq!(config(0.1, urban / 2.0).of(&*network).unwrap().max_distance, urban / 2.0);
        assert_eq!(config(0.1, urban * 2.0).of(&*network).unwrap().max_distance, urban);
        for (rate, name) in [(0.15, "esm-swift"), (0.1, "shape")] {
            let refused = config(rate, 0.0).of(&*by_name(name).unwrap()).unwrap_err();
            assert!(refused.to_string().contains("match.max_false_positive_rate"), "{refused}");
        }
    }

    /// A map of three segments whose descriptors are 0, 1 and 3.
    fn map() -> Map {
        let mut data = MapData::new([0.0; 3], DescriptorInfo { name: "one".to_owned(), version: 1, dim: 1 });
        for (i, value) in [0.0, 1.0, 3.0].into_iter().enumerate() {
            data.push_segment(&segment(10.0 * i as f32), 1).unwrap();
            data.descriptors.push(value);
            data.quality.push(0.5);
        }
        Map::from_data(data).unwrap()
    }

    fn segment(x: f32) -> Segment {
        Segment::from_points(vec![[x, 0.0, 0.0], [x, 1.0, 0.0], [x, 0.0, 2.0]]).unwrap()
    }

    /// The pairs (live, map) found for two live segments, whose descriptors are 0 and 2.9.
    fn found(config: &MatchConfig) -> Vec<(u32, u32)> {
        let map = map();
        let index = Index::new(map.descriptors(), 1, config.search);
        let described =
            Descriptions { dim: 1, values: vec![0.0, 2.9], quality: vec![0.9, 0.2], ..Default::default() };
        let segments = [segment(1.0), segment(2.0)];
        let all = candidates(&segments, &described, &map, &index, config);
        all.iter().map(|c| (c.live, c.map)).collect()
    }

    #[test]
    fn best_quality_first_then_the_nearest() {
        let all = found(&MatchConfig::default());
        assert_eq!(all, [(0, 0), (0, 1), (0, 2), (1, 2), (1, 1), (1, 0)]);
        assert_eq!(found(&MatchConfig { k: 1, ..Default::default() }), [(0, 0), (1, 2)]);
    }

    #[test]
    fn far_descriptors_are_dropped() {
        let near = found(&MatchConfig { max_distance: 0.5, ..Default::default() });
        assert_eq!(near, [(0, 0), (1, 2)]);
        // The limit is a length and not its square, and belongs to what is kept.
        let nearer = found(&MatchConfig { max_distance: 1.0, ..Default::default() });
        assert_eq!(nearer, [(0, 0), (0, 1), (1, 2)]);
        assert_eq!(found(&MatchConfig { max_distance: 2.0, ..Default::default() }).len(), 4);
    }

    #[test]
    fn segments_of_poor_quality_are_dropped() {
        let good = found(&MatchConfig { min_quality: 0.5, ..Default::default() });
        assert_eq!(good, [(0, 0), (0, 1), (0, 2)]);
        assert!(found(&MatchConfig { min_quality: 0.95, ..Default::default() }).is_empty());
    }
}

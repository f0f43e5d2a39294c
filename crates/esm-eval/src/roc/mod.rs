//! How well a descriptor tells objects apart, and finds them again in the whole map (the paper's figure 3).
//!
//! What the second visit saw against what the first one saw: windows of the mapped drive against live clouds, unmerged, both
//! every few metres. A positive pair is one object, named by the simulator's numbers where points carry them, else by the
//! paper's rule (section IV). A random negative lies at least 20 m away; a hard one besides is alike in height and both
//! extents, within 20 %.

mod curve;
mod pairs;
mod views;

use esm_core::index::{Index, Search};
use esm_core::map::Standardizer;
use esm_core::matching::leading;
use esm_core::segment::Segment;
use esm_core::{Config, Descriptions};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

pub use curve::Curve;
pub(crate) use pairs::Pairs;

use crate::error::Error;
use crate::method::Model;
use crate::plan::RocPlan;
use crate::site::Site;
use crate::watch::Teller;
use views::Views;

/// Ranks at which retrieval is told.
pub const RANKS: [usize; 3] = [1, 25, 100];
/// Segments described between two looks at whether to stop.
const BATCH: usize = 128;

/// One descriptor on one site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Roc {
    /// Segments of the map's windows.
    pub map_segments: usize,
    /// Segments of the live clouds.
    pub live_segments: usize,
    /// Live ones that have a counterpart: each is a positive.
    pub judged: usize,
    /// How many of them have a random negative, and a hard one.
    pub negatives: [usize; 2],
    /// Share of the judged ones whose counterpart is among the nearest 1, 25, 100 of the whole map.
    pub recall_at: [f64; 3],
    /// By distance, against random negatives.
    pub random: Option<Curve>,
    /// By distance, against hard negatives.
    pub hard: Option<Curve>,
    /// The same without the third of the pairs whose joint quality is worst; `None` where the descriptor has no quality.
    pub random_best: Option<Curve>,
    /// Likewise against hard negatives.
    pub hard_best: Option<Curve>,
    /// By the forest that judges candidates, against random negatives; `None` where there is none.
    pub random_judged: Option<Curve>,
    /// Likewise against hard negatives.
    pub hard_judged: Option<Curve>,
}

/// What a curve is made from.
pub(crate) fn key(site: &Site, plan: &RocPlan, config: &Config, model: &Model) -> Value {
    json!({
        "kind": "roc",
        "inputs": [site.map_digest, site.live_digest, site.truth_digest],
        "accumulate": config.accumulate,
        "segment": config.segment,
        "step_m": plan.step_m,
        "seed": plan.seed,
        "descriptor": model.digest,
    })
}

/// Segments of both visits and the pairs that all descriptors are judged by.
pub(crate) struct Ground {
    views: [Views; 2],
    pairs: Pairs,
}

impl Ground {
    /// Cuts both recordings of a site.
    pub(crate) fn survey(
        site: &Site,
        plan: &RocPlan,
        config: &Config,
        words: &str,
        teller: &mut Teller<'_, '_>,
    ) -> Result<Self, Error> {
        let views = views::both(site, plan, config, words, teller)?;
        let pairs = Pairs::draw(&views[0], &views[1], plan.seed);
        if pairs.judged.is_empty() {
            let hint = "is the truth in the frame of the map, and do the visits overlap?";
            return Err(Error::input(&site.files.live, "no live segment has a counterpart in the map", hint));
        }
        Ok(Self { views, pairs })
    }

    /// Judges one descriptor.
    pub(crate) fn judge(
        &self,
        model: &Model,
        words: &str,
        teller: &mut Teller<'_, '_>,
    ) -> Result<Roc, Error> {
        let [map, live] = &self.views;
        let steps = (map.segments.len() + live.segments.len()).div_ceil(BATCH);
        teller.begins(format!("describing {words}"), Some(steps))?;
        let mut mapped = described(&map.segments, model, teller)?;
        let mut seen = described(&live.segments, model, teller)?;
        let (dim, searched) = (model.descriptor.dim(), model.descriptor.searched());
        if model.descriptor.standardized() {
            let mut scale = Standardizer::fit(&mapped.values, dim);
            // What only the judge looks at stays as it is.
            scale.mean[searched..].fill(0.0);
            scale.inv_std[searched..].fill(1.0);
            scale.apply(&mut mapped.values);
            scale.apply(&mut seen.values);
        }
        let row = |of: &'_ Descriptions, i: usize| -> Vec<f32> { of.values[i * dim..(i + 1) * dim].to_vec() };
        let distance = |(l, m): (usize, usize)| -> f64 {
            let (a, b) = (row(&seen, l), row(&mapped, m));
            let squares = a[..searched].iter().zip(&b[..searched]).map(|(a, b)| f64::from(a - b).powi(2));
            -squares.sum::<f64>()
        };
        let p = &self.pairs;
        let by = |score: &dyn Fn((usize, usize)) -> f64, pairs: &[(usize, usize)]| -> Vec<f64> {
            pairs.iter().map(|pair| score(*pair)).collect()
        };
        let [positive, random, hard] = [&p.positive, &p.random, &p.hard].map(|pairs| by(&distance, pairs));
        let quality = |(l, m): (usize, usize)| f64::from(seen.quality[l]) * f64::from(mapped.quality[m]);
        let [good, good_random, good_hard] =
            [&p.positive, &p.random, &p.hard].map(|pairs| by(&quality, pairs));
        let (mut random_judged, mut hard_judged) = (None, None);
        if let Some(judge) = model.descriptor.judge() {
            let probability =
                |(l, m): (usize, usize)| f64::from(judge.probability(&row(&seen, l), &row(&mapped, m)));
            let right = by(&probability, &p.positive);
            random_judged = Curve::of(&right, &by(&probability, &p.random));
            hard_judged = Curve::of(&right, &by(&probability, &p.hard));
        }
        Ok(Roc {
            map_segments: map.segments.len(),
            live_segments: live.segments.len(),
            judged: p.judged.len(),
            negatives: [random.len(), hard.len()],
            recall_at: self.recall(&mapped, &seen, dim, searched),
            random_best: curve::without_worst_third((&positive, &good), (&random, &good_random)),
            hard_best: curve::without_worst_third((&positive, &good), (&hard, &good_hard)),
            random: Curve::of(&positive, &random),
            hard: Curve::of(&positive, &hard),
            random_judged,
            hard_judged,
        })
    }

    fn recall(&self, mapped: &Descriptions, seen: &Descriptions, dim: usize, searched: usize) -> [f64; 3] {
        let [map, live] = &self.views;
        let index = Index::new(&leading(&mapped.values, dim, searched), searched, Search::Product);
        let queries: Vec<f32> = self
            .pairs
            .judged
            .iter()
            .flat_map(|&i| &seen.values[i * dim..i * dim + searched])
            .copied()
            .collect();
        let mut hits = [0usize; 3];
        let most = RANKS[RANKS.len() - 1];
        for (&i, near) in self.pairs.judged.iter().zip(index.nearest(&queries, most)) {
            let rank = near.iter().position(|n| map.objects[n.row as usize] == live.objects[i]);
            for (hits, k) in hits.iter_mut().zip(RANKS) {
                *hits += usize::from(rank.is_some_and(|r| r < k));
            }
        }
        hits.map(|n| n as f64 / self.pairs.judged.len() as f64)
    }
}

fn described(
    segments: &[Segment],
    model: &Model,
    teller: &mut Teller<'_, '_>,
) -> Result<Descriptions, Error> {
    let mut all = Descriptions { dim: model.descriptor.dim(), ..Descriptions::default() };
    for batch in segments.chunks(BATCH) {
        let part = model.descriptor.describe(batch);
        all.values.extend(part.values);
        all.quality.extend(part.quality);
        teller.step()?;
    }
    Ok(all)
}

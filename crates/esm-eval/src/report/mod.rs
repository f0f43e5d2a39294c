//! [`Report`]: what an [`Evaluation`] adds up to, and how it is written.

mod csv;
mod json;
mod markdown;
mod table;

use std::path::Path;

use crate::error::Error;
use crate::run::{Evaluation, Outcome};
use crate::stats::{Share, median};
use crate::trial::Counts;

/// The results of one dataset, mode and method, over all its seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// The dataset's name.
    pub dataset: String,
    /// The mode's name.
    pub mode: String,
    /// The method's name.
    pub method: String,
    /// The worlds that were added; empty of recordings.
    pub seeds: Vec<u64>,
    /// Sums over them.
    pub counts: Counts,
    /// Located rightly of the localizable clouds of all worlds, with Wilson's interval.
    pub recall: Option<Share>,
    /// The mean over the worlds with Student's interval, where there are several.
    pub recall_over_seeds: Option<Share>,
    /// Median error of the clouds that were located rightly, metres.
    pub error_m: Option<f64>,
    /// The same in degrees.
    pub error_deg: Option<f64>,
    /// Medians of the stages over all clouds, milliseconds, in the order of [`STAGES`](crate::STAGES).
    pub stage_p50: [Option<f64>; 9],
    /// Segments of a cloud, median.
    pub segments_p50: Option<f64>,
    /// Highest memory while localizing, MiB.
    pub peak_mib: Option<f64>,
    /// Segments of the map, the mean over the worlds.
    pub map_segments: f64,
    /// Size of the map's file, the mean over the worlds.
    pub map_bytes: f64,
    /// Size of the descriptor's weights.
    pub model_bytes: u64,
}

impl Pooled {
    /// Adds up; `None` of nothing.
    fn of(outcomes: &[&Outcome]) -> Option<Self> {
        let first = outcomes.first()?;
        let trials = || outcomes.iter().map(|o| &o.trial);
        let clouds = || trials().flat_map(|t| &t.clouds);
        let mut counts = Counts::default();
        trials().for_each(|t| counts += t.counts);
        let shares: Vec<f64> = trials().filter_map(|t| t.counts.recall().map(|s| s.value)).collect();
        let (metres, degrees): (Vec<_>, Vec<_>) = trials().map(|t| t.errors()).unzip();
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
        Some(Self {
            dataset: first.dataset.clone(),
            mode: first.mode.clone(),
            method: first.method.clone(),
            seeds: outcomes.iter().filter_map(|o| o.seed).collect(),
            counts,
            recall: counts.recall(),
            recall_over_seeds: Share::over(&shares),
            error_m: median(metres.concat()),
            error_deg: median(degrees.concat()),
            stage_p50: std::array::from_fn(|i| median(clouds().map(|c| c.ms[i]).collect())),
            segments_p50: median(clouds().map(|c| c.segments as f64).collect()),
            peak_mib: trials().filter_map(|t| t.peak_mib).max_by(f64::total_cmp),
            map_segments: mean(trials().map(|t| t.map_segments as f64).collect()),
            map_bytes: mean(trials().map(|t| t.map_bytes as f64).collect()),
            model_bytes: first.trial.model_bytes,
        })
    }
}

/// What an evaluation adds up to.
#[derive(Clone, Copy)]
pub struct Report<'a> {
    of: &'a Evaluation,
}

impl<'a> Report<'a> {
    /// Of an evaluation.
    pub fn of(evaluation: &'a Evaluation) -> Self {
        Self { of: evaluation }
    }

    /// Every dataset, mode and method that there is, in the plan's order, its seeds added up.
    pub fn pooled(&self) -> Vec<Pooled> {
        let plan = &self.of.plan;
        let mut all = Vec::new();
        for mode in &plan.modes {
            for dataset in &plan.datasets {
                for method in &plan.methods {
                    let is = |o: &&Outcome| {
                        o.dataset == dataset.name && o.mode == mode.name && o.method == method.name
                    };
                    let outcomes: Vec<&Outcome> = self.of.outcomes.iter().filter(is).collect();
                    all.extend(Pooled::of(&outcomes));
                }
            }
        }
        all
    }

    /// The table for a terminal.
    pub fn table(&self) -> String {
        table::text(self)
    }

    /// `results.json`.
    pub fn json(&self) -> String {
        json::text(self)
    }

    /// `results.csv`: a line a dataset, seed, mode and method, and a line with seed `all` for their sum.
    pub fn csv(&self) -> String {
        csv::text(self)
    }

    /// `report.md`; `figures` are pictures that lie beside it, with their captions.
    pub fn markdown(&self, figures: &[(String, String)]) -> String {
        markdown::text(self, figures)
    }

    /// Writes `results.json`, `results.csv` and `report.md`, each whole or not at all.
    ///
    /// # Errors
    /// [`Error::Files`].
    pub fn write(&self, dir: &Path, figures: &[(String, String)]) -> Result<(), Error> {
        std::fs::create_dir_all(dir).map_err(|e| Error::io(dir, "creating the directory", e))?;
        esm_io::write_file(dir.join("results.json"), self.json().as_bytes())?;
        esm_io::write_file(dir.join("results.csv"), self.csv().as_bytes())?;
        Ok(esm_io::write_file(dir.join("report.md"), self.markdown(figures).as_bytes())?)
    }
}

//! [`evaluate`]: the plan, followed.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use esm_core::Map;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::cache::Cache;
use crate::error::Error;
use crate::maps;
use crate::method::Model;
use crate::plan::{Dataset, Method, Mode, Plan};
use crate::roc::{self, Ground, Roc};
use crate::site::{Site, sites};
use crate::trial::{self, Trial};
use crate::watch::{Event, Teller, Watch};

/// How to follow a plan.
#[derive(Clone, Debug)]
pub struct Options {
    /// Directory for what is kept between runs: simulated recordings, maps, results. Made where it is missing.
    pub work: PathBuf,
    /// Names the build of the program that computes; results of another one are computed again.
    pub program: String,
    /// Take results of other builds too.
    pub reuse_older: bool,
}

/// One trial, by its names in the plan.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The dataset's name.
    pub dataset: &'a str,
    /// Of the simulated world; `None` of recordings.
    pub seed: Option<u64>,
    /// The mode's name.
    pub mode: &'a str,
    /// The method's name.
    pub method: &'a str,
}

/// Runs a trial in a process of its own, which evaluates [`Plan::alone`] with the same [`Options`]: its memory is then that of
/// localizing and of nothing else. Asks every now and then whether to go on, and ends with [`Error::Interrupted`] where not.
pub type Apart<'a> = dyn Fn(&Job<'_>, &mut dyn FnMut() -> bool) -> Result<(), Error> + 'a;

/// What one method did in one mode on one site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// The dataset's name.
    pub dataset: String,
    /// Of the simulated world; `None` of recordings.
    pub seed: Option<u64>,
    /// The mode's name.
    pub mode: String,
    /// The method's name.
    pub method: String,
    /// What came of it.
    pub trial: Trial,
    /// Where the map lies.
    #[serde(skip)]
    pub map: PathBuf,
}

/// How one descriptor told objects apart on one site.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RocOutcome {
    /// The dataset's name.
    pub dataset: String,
    /// Of the simulated world; `None` of recordings.
    pub seed: Option<u64>,
    /// The method's name.
    pub method: String,
    /// What came of it.
    pub roc: Roc,
}

/// All that came of a plan.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// What it is headed with.
    pub name: String,
    /// The plan that was followed.
    pub plan: Plan,
    /// In the order of the plan: datasets, seeds, modes, methods.
    pub outcomes: Vec<Outcome>,
    /// In the order of the plan: datasets, seeds, methods.
    pub rocs: Vec<RocOutcome>,
    /// Results that were computed by this run.
    pub computed: usize,
    /// Results that were there.
    pub kept: usize,
}

/// Follows a plan. What an earlier run has computed from the same inputs, weights and settings is taken from the cache;
/// a run that was stopped, by whatever, goes on where it was. Localization is timed in one thread; everything else takes all
/// there are.
///
/// # Errors
/// [`Error::Interrupted`] where `watch` asks for it; the inputs' errors, with their files.
pub fn evaluate(plan: &Plan, options: &Options, watch: &mut Watch<'_>) -> Result<Evaluation, Error> {
    follow(plan, options, None, watch)
}

/// The same with every trial in a process of its own.
///
/// # Errors
/// As [`evaluate`], and those of `apart`.
pub fn evaluate_apart(
    plan: &Plan,
    options: &Options,
    apart: &Apart<'_>,
    watch: &mut Watch<'_>,
) -> Result<Evaluation, Error> {
    follow(plan, options, Some(apart), watch)
}

fn follow(
    plan: &Plan,
    options: &Options,
    apart: Option<&Apart<'_>>,
    watch: &mut Watch<'_>,
) -> Result<Evaluation, Error> {
    let mut teller = Teller(watch);
    let cache = Cache::open(&options.work.join("results"), &options.program, options.reuse_older)?;
    let models = plan.methods.iter().map(Model::open).collect::<Result<Vec<_>, _>>()?;
    let mut run = Run { plan, apart, cache, models, done: 0, total: 0, computed: 0 };
    let mut places = Vec::new();
    for dataset in &plan.datasets {
        let sites = sites(dataset, &options.work.join("simulated"), &mut teller)?;
        run.total += sites.len() * (run.trials(dataset).len() + run.curves(dataset).len());
        places.push((dataset, sites));
    }
    let (mut outcomes, mut rocs) = (Vec::new(), Vec::new());
    for (dataset, sites) in &places {
        for (i, site) in sites.iter().enumerate() {
            outcomes.extend(run.site(dataset, (site, i == 0), &mut teller)?);
            rocs.extend(run.rocs(dataset, site, &mut teller)?);
        }
    }
    let computed = run.computed;
    let kept = run.total - computed;
    Ok(Evaluation { name: plan.name.clone(), plan: plan.clone(), outcomes, rocs, computed, kept })
}

/// The thread in which localization is timed.
fn one_thread() -> Result<rayon::ThreadPool, Error> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .map_err(|e| Error::io(Path::new("a thread"), "starting it", std::io::Error::other(e)))
}

struct Run<'a> {
    plan: &'a Plan,
    apart: Option<&'a Apart<'a>>,
    cache: Cache,
    /// As many as methods.
    models: Vec<Model>,
    done: usize,
    total: usize,
    computed: usize,
}

impl<'a> Run<'a> {
    /// Modes and methods that a dataset is tried in, in the order of the report.
    fn trials(&self, dataset: &Dataset) -> Vec<(&'a Mode, usize)> {
        let all =
            self.plan.modes.iter().flat_map(|mode| (0..self.plan.methods.len()).map(move |i| (mode, i)));
        all.filter(|(mode, i)| mode.is_for(&dataset.name, &self.plan.methods[*i].name)).collect()
    }

    /// The methods whose descriptors are judged on a dataset.
    fn curves(&self, dataset: &Dataset) -> Vec<usize> {
        let Some(roc) = &self.plan.roc else { return Vec::new() };
        let wanted = roc.datasets.as_ref().is_none_or(|names| names.contains(&dataset.name));
        (0..self.plan.methods.len()).filter(|_| wanted).collect()
    }

    /// All trials of a site. They are made method by method, so that each map is opened once, and told in the plan's order.
    fn site(
        &mut self,
        dataset: &Dataset,
        (site, first): (&Site, bool),
        teller: &mut Teller<'_, '_>,
    ) -> Result<Vec<Outcome>, Error> {
        let trials = self.trials(dataset);
        let mut outcomes: Vec<Option<Outcome>> = vec![None; trials.len()];
        let plan = self.plan;
        for (m, method) in plan.methods.iter().enumerate() {
            let mut whole = None;
            let mut pictured = first;
            for (slot, (mode, _)) in trials.iter().enumerate().filter(|(_, t)| t.1 == m) {
                let pictured = std::mem::take(&mut pictured);
                let outcome = self.trial(dataset, site, (mode, method, m), &mut whole, pictured, teller)?;
                outcomes[slot] = Some(outcome);
                self.tick(teller)?;
            }
        }
        Ok(outcomes.into_iter().flatten().collect())
    }

    fn trial(
        &mut self,
        dataset: &Dataset,
        site: &Site,
        (mode, method, m): (&Mode, &Method, usize),
        whole: &mut Option<maps::Built>,
        pictured: bool,
        teller: &mut Teller<'_, '_>,
    ) -> Result<Outcome, Error> {
        let (cache, model) = (&self.cache, &self.models[m]);
        let words = format!("{}, {}", site.words(&dataset.name), method.name);
        let map_config = self.plan.map_config(dataset, method)?;
        let config = self.plan.live_config(dataset, method, mode)?;
        let whole_key = maps::key(site, &map_config, model);
        let map_key = match mode.map_deleted > 0.0 {
            true => maps::thinned_key(&whole_key, mode.map_deleted, mode.map_deleted_seed),
            false => whole_key.clone(),
        };
        let mut map = |teller: &mut Teller<'_, '_>| {
            let built = match whole {
                Some(built) => built,
                None => {
                    let make = || maps::build(site, &map_config, model, &words, teller);
                    whole.insert(maps::get(cache, &whole_key, make)?)
                }
            };
            let map = match mode.map_deleted > 0.0 {
                true => {
                    let make = || maps::thinned(&built.map, mode.map_deleted, mode.map_deleted_seed);
                    maps::get(cache, &map_key, make)?.map
                }
                false => Arc::clone(&built.map),
            };
            Ok::<_, Error>((map, built.built_s, built.peak_mib))
        };
        let key = trial::key(&map_key, site, &config, mode);
        let words_of_mode = format!("{words}, {}", mode.name);
        let mut alone = |teller: &mut Teller<'_, '_>| {
            let (map, map_built_s, map_built_peak_mib) = map(teller)?;
            let trial = one_thread()?
                .install(|| trial::run(&map, site, (&config, mode, model), &words_of_mode, teller))?;
            Ok(Trial { map_built_s, map_built_peak_mib, ..trial })
        };
        let (trial, was_there) = match self.apart {
            None => cache.get_or(&key, || alone(teller))?,
            Some(apart) => match cache.get(&key) {
                Some(kept) => (kept, true),
                None => {
                    let job = Job {
                        dataset: &dataset.name,
                        seed: site.seed,
                        mode: &mode.name,
                        method: &method.name,
                    };
                    map(teller)?;
                    teller.begins(format!("localizing {words_of_mode}"), None)?;
                    apart(&job, &mut || teller.step().is_ok())?;
                    let none = || Error::Apart {
                        what: format!("{words_of_mode}: the process that localized has left no result"),
                        hint: "was the program replaced while it ran? The same command goes on".to_owned(),
                    };
                    (cache.get(&key).ok_or_else(none)?, false)
                }
            },
        };
        // A picture is drawn over the map, which somebody may have taken away meanwhile.
        if was_there && pictured {
            map(teller)?;
        }
        self.computed += usize::from(!was_there);
        Ok(Outcome {
            dataset: dataset.name.clone(),
            seed: site.seed,
            mode: mode.name.clone(),
            method: method.name.clone(),
            trial,
            map: maps::path(&self.cache, &map_key),
        })
    }

    /// All curves of a site; its recordings are cut only where one is missing.
    fn rocs(
        &mut self,
        dataset: &Dataset,
        site: &Site,
        teller: &mut Teller<'_, '_>,
    ) -> Result<Vec<RocOutcome>, Error> {
        let plan = self.plan;
        let Some(roc) = &plan.roc else { return Ok(Vec::new()) };
        let mut outcomes = Vec::new();
        // Segments depend on the method only where its settings say so.
        let mut ground: Option<(Value, Ground)> = None;
        for m in self.curves(dataset) {
            let (method, model) = (&plan.methods[m], &self.models[m]);
            let config = plan.map_config(dataset, method)?;
            let key = roc::key(site, roc, &config, model);
            let words = site.words(&dataset.name);
            let (found, was_there) = self.cache.get_or(&key, || {
                let cut = serde_json::json!([config.accumulate, config.segment]);
                let (_, ground) = match ground.take_if(|(of, _)| *of == cut) {
                    Some(same) => ground.insert(same),
                    None => ground.insert((cut, Ground::survey(site, roc, &config, &words, teller)?)),
                };
                ground.judge(model, &format!("{words}, {}", method.name), teller)
            })?;
            self.computed += usize::from(!was_there);
            outcomes.push(RocOutcome {
                dataset: dataset.name.clone(),
                seed: site.seed,
                method: method.name.clone(),
                roc: found,
            });
            self.tick(teller)?;
        }
        Ok(outcomes)
    }

    fn tick(&mut self, teller: &mut Teller<'_, '_>) -> Result<(), Error> {
        self.done += 1;
        teller.tell(Event::Results { done: self.done, total: self.total })
    }
}

impl Evaluation {
    /// The outcomes that stand for others in pictures: of each dataset and method the first site in its first mode. Their maps
    /// are there.
    pub fn pictured(&self) -> Vec<&Outcome> {
        let mut pictured: Vec<&Outcome> = Vec::new();
        for outcome in &self.outcomes {
            if !pictured.iter().any(|o| o.dataset == outcome.dataset && o.method == outcome.method) {
                pictured.push(outcome);
            }
        }
        pictured
    }
}

impl Outcome {
    /// Opens the map.
    ///
    /// # Errors
    /// [`Error::Core`] where it is no longer in the cache.
    pub fn open_map(&self) -> Result<Map, Error> {
        Map::open(&self.map).map_err(Error::core(format!("{}, {}", self.dataset, self.method)))
    }
}

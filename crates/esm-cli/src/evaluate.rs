//! `esm-cli evaluate`.

use std::path::Path;

use esm_eval::{Evaluation, Event, Options, Plan, Report, digest_of, evaluate, evaluate_apart};
use indicatif::ProgressBar;

use crate::args::EvaluateArgs;
use crate::outcome::{Failure, Outcome};
use crate::output::data;
use crate::plot::{self, Caption};
use crate::signals::{self, Interrupted, Unfinished};
use crate::{console, settings};

mod apart;

pub(crate) fn run(args: &EvaluateArgs) -> anyhow::Result<Outcome> {
    settings::start_threads(args.threads)?;
    let plan = Plan::read(&args.plan)?.only(&args.dataset, &args.method, &args.mode)?;
    if args.output.exists() && !args.output.is_dir() {
        let what = format!("{}: this is not a directory", args.output.display());
        return Err(Failure::new(what, "give the directory that the report is to be written into").into());
    }
    let work = args.work.clone().unwrap_or_else(|| args.output.join("work"));
    let options = Options { work, program: program()?, reuse_older: args.reuse_older };
    let evaluation = {
        // A signal waits until the file in hand is whole.
        let _unfinished = Unfinished::begin();
        let mut bars = Bars::new();
        let mut watch = |event| bars.hear(event);
        let followed = match &args.alone {
            Some(seed) => evaluate(&plan.alone(seed.parse().ok()), &options, &mut watch),
            None => evaluate_apart(&plan, &options, &apart::runner(args, &options), &mut watch),
        };
        followed.map_err(|e| match e {
            esm_eval::Error::Interrupted => anyhow::Error::new(Interrupted)
                .context("interrupted\nhint: the same command goes on where it was"),
            other => other.into(),
        })?
    };
    if args.alone.is_some() {
        return Ok(Outcome::Done);
    }
    let figures = figures(&evaluation, &args.output)?;
    let report = Report::of(&evaluation);
    report.write(&args.output, &figures)?;
    let text = match args.json {
        true => report.json(),
        false => format!(
            "{}\n{} results computed, {} taken from an earlier run; all in {}\n",
            report.table(),
            evaluation.computed,
            evaluation.kept,
            args.output.join("report.md").display()
        ),
    };
    data(text.as_bytes())?;
    let located = evaluation.outcomes.iter().any(|o| o.trial.counts.located > 0);
    Ok(if located || evaluation.outcomes.is_empty() { Outcome::Done } else { Outcome::NothingLocalized })
}

/// Names this build: another one may compute something else, whatever it calls its version.
fn program() -> anyhow::Result<String> {
    let digest = std::env::current_exe().map(|path| digest_of(&path));
    let digest = digest.unwrap_or_else(|e| Ok(format!("unknown: {e}")))?;
    Ok(format!("esm-cli {} {digest}", env!("CARGO_PKG_VERSION")))
}

/// One bar for all results, one below it for what is in hand.
struct Bars {
    results: Option<ProgressBar>,
    now: Option<ProgressBar>,
}

impl Bars {
    fn new() -> Self {
        Self { results: None, now: None }
    }

    /// Shows it; `false` once a signal has come.
    fn hear(&mut self, event: Event) -> bool {
        match event {
            Event::Results { done, total } => {
                let bar = self.results.get_or_insert_with(|| console::bar("evaluating", Some(total as u64)));
                bar.set_position(done as u64);
            }
            Event::Begins { what, steps } => {
                if let Some(old) = self.now.take() {
                    old.finish_and_clear();
                }
                tracing::info!("{what}");
                let bar = console::bar("", steps);
                bar.set_message(what);
                self.now = Some(bar);
            }
            Event::Step => self.now.iter().for_each(|bar| bar.inc(1)),
            Event::At(position) => self.now.iter().for_each(|bar| bar.set_position(position)),
            _ => {}
        }
        signals::check().is_ok()
    }
}

impl Drop for Bars {
    fn drop(&mut self) {
        self.now.iter().chain(&self.results).for_each(ProgressBar::finish_and_clear);
    }
}

/// Draws the curves of every site, and the recognised places of each dataset's first site in its first mode. Gives the names of
/// the files with their captions.
fn figures(evaluation: &Evaluation, dir: &Path) -> anyhow::Result<Vec<(String, String)>> {
    std::fs::create_dir_all(dir)?;
    let mut all = Vec::new();
    let mut sites: Vec<(&str, Option<u64>)> = Vec::new();
    for roc in &evaluation.rocs {
        if !sites.contains(&(&roc.dataset, roc.seed)) {
            sites.push((&roc.dataset, roc.seed));
        }
    }
    let bar = console::bar("drawing", None);
    for (dataset, seed) in sites {
        signals::check()?;
        let here = evaluation.rocs.iter().filter(|r| r.dataset == dataset && r.seed == seed);
        let curves: Vec<_> = here.map(|r| (r.method.as_str(), &r.roc)).collect();
        let name = file_name("roc", &[&site(dataset, seed)]);
        let caption = Caption {
            title: format!("{}: which segments are one object", site(dataset, seed)),
            figures: format!(
                "{} positives; the area under each curve stands beside its name",
                curves.first().map_or(0, |(_, roc)| roc.judged)
            ),
        };
        plot::roc(&dir.join(&name), &curves, &caption)?;
        all.push((name, format!("{}: true against false positives", site(dataset, seed))));
    }
    for outcome in evaluation.pictured().into_iter().filter(|o| !o.trial.clouds.is_empty()) {
        signals::check()?;
        let map = outcome.open_map()?;
        let (c, place) = (&outcome.trial.counts, site(&outcome.dataset, outcome.seed));
        let name = file_name("places", &[&place, &outcome.method]);
        let caption = Caption {
            title: format!("{place}, {}: recognised places", outcome.method),
            figures: format!(
                "{} of {} localizable clouds located rightly, {} false  \u{b7}  {}",
                c.found, c.localizable, c.wrong, outcome.mode
            ),
        };
        plot::recognised(&dir.join(&name), &map, &outcome.trial.clouds, &caption)?;
        all.push((name, format!("{place}, {}, {}: recognised places by time", outcome.method, outcome.mode)));
    }
    bar.finish_and_clear();
    Ok(all)
}

fn site(dataset: &str, seed: Option<u64>) -> String {
    seed.map_or_else(|| dataset.to_owned(), |seed| format!("{dataset} {seed}"))
}

/// A name without what file systems and Markdown do not like in one.
fn file_name(kind: &str, parts: &[&str]) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "._+-".contains(c) { c } else { '-' };
    format!("{kind}-{}.png", parts.join("-").chars().map(plain).collect::<String>())
}

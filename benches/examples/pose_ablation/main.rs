//! What each part of the back end brings: every way of searching on the same candidates, with and without verification, as a
//! Markdown table.
//!
//! `pose_ablation MAP.esm LIVE.mcap TRUTH.tum [--accumulate D] [--swathes] [--every N] [--min-quality P]
//! [--max-distance D] [--max-false-positive-rate R] [--max-extent-change S] [--only WAY] [--tune FILE | --frozen FILE]`
//!
//! Clouds stand for themselves. Without verification the best place is believed when it has enough matches, as the paper's
//! pipeline does: `--tune` finds, for every way, the fewest with which nothing false is accepted, and notes them in FILE (the
//! largest of all runs that note there); `--frozen` takes them from there. With `--min-quality` every way runs
//! once more on the candidates that are left by it, with `--max-distance` or `--max-false-positive-rate` and `--max-extent-change`
//! likewise.

mod recording;
mod remembered;
mod table;
mod ways;

use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;

use esm_core::describe::{self, Descriptor};
use esm_core::matching::MatchConfig;
use esm_core::{Config, Map};

use crate::recording::Recorded;
use crate::remembered::Remembered;
use crate::table::Frozen;

struct Args {
    paths: Vec<PathBuf>,
    config: Config,
    every: usize,
    pruned: MatchConfig,
    max_extent_change: f64,
    only: String,
    tune: Option<PathBuf>,
    frozen: Option<PathBuf>,
}

fn args() -> Result<Args, Box<dyn std::error::Error>> {
    let mut args = Args {
        paths: Vec::new(),
        config: Config::default(),
        every: 1,
        pruned: MatchConfig::default(),
        max_extent_change: 1.0,
        only: String::new(),
        tune: None,
        frozen: None,
    };
    let mut given = std::env::args().skip(1);
    while let Some(arg) = given.next() {
        let mut value = || given.next().ok_or_else(|| format!("{arg} wants a value"));
        match arg.as_str() {
            "--accumulate" => args.config.accumulate.distance_m = value()?.parse()?,
            "--swathes" => args.config.accumulate.swathes = true,
            "--every" => args.every = value()?.parse()?,
            "--min-quality" => args.pruned.min_quality = value()?.parse()?,
            "--max-distance" => args.pruned.max_distance = value()?.parse()?,
            "--max-false-positive-rate" => args.pruned.max_false_positive_rate = value()?.parse()?,
            "--max-extent-change" => args.max_extent_change = value()?.parse()?,
            "--only" => args.only = value()?,
            "--tune" => args.tune = Some(value()?.into()),
            "--frozen" => args.frozen = Some(value()?.into()),
            path => args.paths.push(path.into()),
        }
    }
    Ok(args)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut args = args()?;
    let [map, live, truth] = args.paths.as_slice() else {
        return Err("usage: pose_ablation MAP.esm LIVE.mcap TRUTH.tum [options]".into());
    };
    let map = Arc::new(Map::open(map)?);
    args.config.descriptor.clone_from(&map.descriptor_info().name);
    let descriptor: Arc<dyn Descriptor> =
        Arc::new(Remembered::new(describe::by_name(&args.config.descriptor)?));
    let clouds = Recorded::read(live, truth, &map, &args.config, args.every)?;
    let mut candidates = vec![("all", args.config.clone())];
    let MatchConfig { min_quality, max_distance, max_false_positive_rate, .. } = args.pruned;
    for (name, pruned) in [
        ("of good quality", MatchConfig { min_quality, ..MatchConfig::default() }),
        ("near", MatchConfig { max_distance, max_false_positive_rate, ..MatchConfig::default() }),
    ] {
        if pruned != MatchConfig::default() {
            candidates.push((name, Config { matching: pruned.of(&*descriptor)?, ..args.config.clone() }));
        }
    }
    if args.max_extent_change < 1.0 {
        let mut config = args.config.clone();
        config.pose.max_extent_change = args.max_extent_change;
        candidates.push(("of like extents", config));
    }
    let mut frozen = Frozen::read(args.frozen.as_deref().or(args.tune.as_deref()))?;
    let mut rows = Vec::new();
    for (name, config) in candidates {
        for way in ways::all().into_iter().filter(|way| way.name.contains(&args.only)) {
            rows.push(ways::run(name, &way, &config, &map, &descriptor, &clouds)?);
        }
    }
    if let Some(path) = &args.tune {
        rows.iter().for_each(|row| frozen.learn(row));
        frozen.write(path)?;
    }
    std::io::stdout().write_all(table::markdown(&rows, &clouds, &frozen).as_bytes())?;
    Ok(())
}

//! Real beside simulated: `realism SHARED_DATA WORK_DIR [--seed N] [--scale F] [--report FILE.md] [--json FILE.json]`.
//!
//! SHARED_DATA holds `kitti00`, `kitti_scans` and `forest`. The simulator's recordings are made in WORK_DIR, where they are
//! not there yet, and segments of both sides are left there for `python/eval/realism_segments.py`. The tables go to stdout;
//! `--report` puts them between the marks of a Markdown file.

#![allow(clippy::print_stdout, clippy::print_stderr)] // A program for people.

mod dump;
mod figures;
mod forest;
mod report;
mod scans;
mod segments;
mod stems;
mod street;
mod trail;

use std::path::{Path, PathBuf};

/// What a run is told.
struct Options {
    shared: PathBuf,
    work: PathBuf,
    seed: u64,
    scale: f64,
    report: Option<PathBuf>,
    json: Option<PathBuf>,
    only: Option<String>,
}

const USAGE: &str = "usage: realism SHARED_DATA WORK_DIR [--seed N] [--scale F] [--report FILE.md] [--json FILE.json] [--only TABLE]";

fn options() -> Result<Options, Box<dyn std::error::Error>> {
    let mut args = std::env::args().skip(1);
    let mut next = || args.next();
    let (Some(shared), Some(work)) = (next(), next()) else { return Err(USAGE.into()) };
    let (shared, work) = (shared.into(), work.into());
    let mut options = Options { shared, work, seed: 100, scale: 0.5, report: None, json: None, only: None };
    while let Some(flag) = next() {
        let value = next().ok_or(USAGE)?;
        match flag.as_str() {
            "--seed" => options.seed = value.parse()?,
            "--scale" => options.scale = value.parse()?,
            "--report" => options.report = Some(value.into()),
            "--json" => options.json = Some(value.into()),
            "--only" => options.only = Some(value),
            _ => return Err(USAGE.into()),
        }
    }
    Ok(options)
}

/// Both visits of a preset, made where they are missing.
fn simulated(name: &str, work: &Path, seed: u64, scale: f64) -> Result<PathBuf, Box<dyn std::error::Error>> {
    let dir = work.join(format!("{name}_{seed}_{scale}"));
    if !dir.join("preset.toml").is_file() {
        eprintln!("simulating {}", dir.display());
        esm_sim::simulate(&esm_sim::preset(name)?, seed, scale, &dir, &mut |_| true)?;
    }
    Ok(dir)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let options = options()?;
    std::fs::create_dir_all(&options.work)?;
    let wanted = |name: &str| options.only.as_deref().is_none_or(|only| only == name);
    let mut tables = Vec::new();
    if wanted("street") {
        let sim = simulated("kitti", &options.work, options.seed, options.scale)?;
        tables.push(street::table(&options.shared, &sim, &options.work)?);
    }
    if wanted("scans") {
        tables.push(scans::table(&options.shared, options.seed)?);
    }
    if wanted("forest") {
        tables.push(forest::table(&options.shared, options.seed, &options.work)?);
    }
    if wanted("trail") {
        let sim = simulated("burgess", &options.work, options.seed, 0.5 * options.scale)?;
        tables.push(trail::table(&sim)?);
    }
    print!("{}", report::markdown(&tables));
    if let Some(path) = &options.report {
        report::insert(path, &report::markdown(&tables))?;
    }
    if let Some(path) = &options.json {
        esm_io::write_file(path, report::json(&tables).as_bytes())?;
    }
    Ok(())
}

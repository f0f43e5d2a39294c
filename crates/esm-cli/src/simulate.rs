//! `esm-cli simulate`.

use std::path::Path;
use std::time::Instant;

use esm_sim::{Drive, Preset, Progress, State, Summary};
use serde_json::json;

use crate::args::SimulateArgs;
use crate::outcome::{Failure, Outcome};
use crate::output::{check_target, data};
use crate::signals::{self, Interrupted, Unfinished};
use crate::{console, memory, plot, settings};

/// The recordings of a simulation.
pub(crate) const RECORDINGS: [&str; 2] = ["map.mcap", "live.mcap"];

pub(crate) fn run(args: &SimulateArgs) -> anyhow::Result<Outcome> {
    esm_sim::check_scale(args.scale)?;
    let drive =
        Drive { reversed: args.live_reversed, offset_m: args.live_offset, changed: args.live_changed };
    let preset = drive.of(&esm_sim::preset(&args.preset)?)?;
    if let Some(path) = &args.plot {
        plot::check_format(path)?;
        // It may lie in the directory that is about to be made.
        if path.parent() != Some(args.output.as_path()) {
            check_target(path, &[])?;
        }
    }
    settings::start_threads(args.threads)?;
    let made = make(&preset, args.seed, args.scale, &args.output, args.force)?;
    let report = if args.json { json_report(args, &made) } else { table(args, &preset, &made) };
    if let Some(path) = &args.plot {
        let bar = console::bar("drawing the world", None);
        plot::world(path, &preset, args.seed, args.scale)?;
        bar.finish_and_clear();
    }
    data(report.as_bytes())?;
    Ok(Outcome::Done)
}

/// A simulation that is there now.
pub(crate) struct Made {
    pub(crate) summary: Summary,
    /// How long it took; `None` where it was there before.
    seconds: Option<f64>,
}

impl Made {
    /// Whether it was complete before.
    pub(crate) fn was_there(&self) -> bool {
        self.seconds.is_none()
    }
}

/// Simulates into a directory, going on where an interrupted run was. What is complete already is left as it is, unless
/// `force`.
pub(crate) fn make(preset: &Preset, seed: u64, scale: f64, dir: &Path, force: bool) -> anyhow::Result<Made> {
    match esm_sim::state(preset, seed, scale, dir) {
        State::Complete(summary) if !force => return Ok(Made { summary, seconds: None }),
        State::Other(words) if !force => {
            let what = format!("{}: this directory holds another simulation: {words}", dir.display());
            return Err(Failure::new(
                what,
                "choose another directory, or remove this one; simulate --force replaces it",
            )
            .into());
        }
        State::OtherUnfinished(words) if !force => {
            let what =
                format!("{}: this directory holds a part of another simulation: {words}", dir.display());
            let hint = "give its arguments to go on with it, or choose another directory; simulate --force discards it";
            return Err(Failure::new(what, hint).into());
        }
        State::Foreign(name) if !force => {
            let what = format!("{}: it exists, and no simulation has made it", dir.join(name).display());
            return Err(Failure::new(what, "choose another directory; simulate --force replaces it").into());
        }
        _ => {}
    }
    let started = Instant::now();
    let mut bar = None;
    let mut progress = |p: Progress| {
        let doing = if p.visit == "map" { "simulating, map visit" } else { "simulating, live visit" };
        let (_, bar) = match bar.take() {
            Some((visit, old)) if visit == p.visit => bar.insert((visit, old)),
            _ => bar.insert((p.visit, console::bar(doing, Some(p.total as u64)))),
        };
        bar.set_position(p.done as u64);
        signals::check().is_ok()
    };
    let unfinished = Unfinished::begin();
    let summary = esm_sim::simulate(preset, seed, scale, dir, &mut progress).map_err(|e| match e {
        esm_sim::Error::Interrupted => anyhow::Error::new(Interrupted)
            .context("interrupted\nhint: the same command goes on where it was"),
        other => other.into(),
    })?;
    drop(unfinished);
    if let Some((_, bar)) = bar {
        bar.finish_and_clear();
    }
    if summary.discarded > 0 {
        tracing::warn!(
            "{} sweeps of an interrupted run were made again: this program makes other ones than the one before",
            summary.discarded
        );
    }
    Ok(Made { summary, seconds: Some(started.elapsed().as_secs_f64()) })
}

/// Rays cast in this run.
fn cast_now(summary: &Summary) -> f64 {
    summary.rays as f64 * (summary.sweeps - summary.kept) as f64 / summary.sweeps.max(1) as f64
}

fn table(args: &SimulateArgs, preset: &Preset, made: &Made) -> String {
    let s = &made.summary;
    let kept = match s.kept {
        0 => String::new(),
        kept => format!(", {kept} of them by the interrupted run"),
    };
    let took = match made.seconds {
        None => "nothing: all of it was there already; --force makes it again".to_owned(),
        Some(seconds) => {
            let memory = memory::peak_mib().map_or_else(|| "unknown".to_owned(), |m| format!("{m:.0} MiB"));
            let rate = cast_now(s) / seconds * 1e-6;
            format!("{seconds:.1} s, {rate:.2} M rays/s, peak memory {memory}")
        }
    };
    let rows = [
        ("simulated", format!("{}, seed {}, scale {}", preset.name, args.seed, args.scale)),
        ("which is", preset.about.to_owned()),
        ("sensor", preset.sensor.sensor().name.to_owned()),
        ("live visit", live_words(args)),
        ("into", args.output.display().to_string()),
        ("files", files(&args.output)),
        ("sweeps", format!("{}{kept}", s.sweeps)),
        ("rays", millions(s.rays)),
        ("points", millions(s.points)),
        ("travel", format!("{:.2} km, both visits together", s.travel_m / 1000.0)),
        ("it took", took),
    ];
    rows.iter().map(|(name, value)| format!("{name:<18} {value}\n")).collect()
}

/// How the live visit is driven.
fn live_words(args: &SimulateArgs) -> String {
    let way = if args.live_reversed { "the other way round" } else { "as the preset has it" };
    let beside = if args.live_offset == 0.0 {
        String::new()
    } else {
        format!(
            ", {} m to the {}",
            args.live_offset.abs(),
            if args.live_offset > 0.0 { "left" } else { "right" }
        )
    };
    let changed = args.live_changed.map_or_else(String::new, |s| format!(", {:.0} % changed", 100.0 * s));
    format!("{way}{beside}{changed}")
}

fn millions(n: u64) -> String {
    format!("{:.1} M", n as f64 * 1e-6)
}

fn files(dir: &Path) -> String {
    let size = |name: &str| {
        let bytes = std::fs::metadata(dir.join(name)).map_or(0, |m| m.len());
        format!("{name} {:.1} MB", bytes as f64 * 1e-6)
    };
    RECORDINGS.iter().map(|n| size(n)).collect::<Vec<_>>().join(", ")
}

fn json_report(args: &SimulateArgs, made: &Made) -> String {
    let s = &made.summary;
    let report = json!({
        "preset": args.preset,
        "seed": args.seed,
        "scale": args.scale,
        "live_reversed": args.live_reversed,
        "live_offset_m": args.live_offset,
        "live_changed": args.live_changed,
        "directory": args.output.display().to_string(),
        "sweeps": s.sweeps,
        "sweeps_kept": s.kept,
        "rays": s.rays,
        "points": s.points,
        "travel_m": s.travel_m,
        "was_complete": made.was_there(),
        "elapsed_s": made.seconds,
        "rays_per_s": made.seconds.map(|seconds| cast_now(s) / seconds),
        "peak_memory_mib": memory::peak_mib(),
    });
    format!("{report}\n")
}

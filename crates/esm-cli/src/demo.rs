//! `esm-cli demo`: two small places are simulated, mapped at the first visit, and the second visit is localized. Everything
//! goes the ways of `simulate`, `map build` and `localize`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context;

use crate::args::{BuildArgs, DemoArgs, LiveArgs, LocalizeArgs, ReadArgs, TuneArgs};
use crate::localize::{self, Found};
use crate::outcome::Outcome;
use crate::output::{Lines, check_target};
use crate::{build, console, memory, plot, settings, simulate};

/// One place of the demo.
struct Place {
    name: &'static str,
    preset: &'static str,
    /// Among those for tuning: a demo is no judgement.
    seed: u64,
    scale: f64,
    /// What `localize` is configured with.
    config: &'static str,
}

/// Hundreds of segments a cloud, most of them trunks: with the default of 60 candidates each, searching for the place takes
/// seconds a cloud; with 5 it finds the same in milliseconds.
const FOREST_CONFIG: &str = "[match]\nk = 5\n";

const PLACES: [Place; 2] = [
    Place { name: "forest", preset: "train-forest", seed: 100, scale: 0.1, config: FOREST_CONFIG },
    Place { name: "street", preset: "kitti", seed: 100, scale: 0.1, config: "" },
];

pub(crate) fn run(args: &DemoArgs) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    for place in &PLACES {
        esm_sim::check_scale(place.scale * args.scale)?;
    }
    settings::start_threads(args.threads)?;
    std::fs::create_dir_all(&args.output)
        .with_context(|| format!("{}: creating the directory", args.output.display()))?;
    let picture = args.output.join("demo.png");
    check_target(&picture, &[])?;
    let mut lines = Lines::new(false);
    let mut all = Vec::new();
    for place in &PLACES {
        all.push(visit(place, args, &mut lines)?);
    }
    let bar = console::bar("drawing the picture", None);
    let panels: Vec<_> = all.iter().filter_map(|f| Some((&*f.map, f.drive.as_ref()?, &f.caption))).collect();
    plot::places(&picture, &panels)?;
    bar.finish_and_clear();
    lines.line(&format!("\n{}\n", table(&all)))?;
    let memory = memory::peak_mib().map_or_else(|| "unknown".to_owned(), |m| format!("{m:.0} MiB"));
    lines.line(&format!("All in {:.1} s, peak memory {memory}.\n", started.elapsed().as_secs_f64()))?;
    lines.line(&next_steps(&args.output, &picture))?;
    Ok(if all.iter().all(|f| f.tally.located == 0) { Outcome::NothingLocalized } else { Outcome::Done })
}

/// Simulates a place, maps its first visit and localizes the second.
fn visit(place: &Place, args: &DemoArgs, lines: &mut Lines) -> anyhow::Result<Found> {
    let dir = args.output.join(place.name);
    let file = |name: &str| dir.join(name);
    let preset = esm_sim::preset(place.preset)?;
    let began = Instant::now();
    let made = simulate::make(&preset, place.seed, place.scale * args.scale, &dir, false)?;
    let s = made.summary;
    lines.line(&format!(
        "{:<8} simulated  {:5.1} s   two visits, {:.0} m in all, {} sweeps, {:.1} M points{}",
        place.name,
        began.elapsed().as_secs_f64(),
        s.travel_m,
        s.sweeps,
        s.points as f64 * 1e-6,
        if made.was_there() { " (there already)" } else { "" }
    ))?;
    let began = Instant::now();
    let map = build::build(&BuildArgs {
        inputs: vec![file("map.mcap")],
        output: file("map.esm"),
        accumulate: None,
        // The truth of the map visit: the map then stands in the frame of the live visit's truth.
        read: ReadArgs { poses: Some(file("map_truth.tum")), ..ReadArgs::default() },
        tune: TuneArgs::default(),
    })?;
    lines.line(&format!(
        "{:<8} mapped     {:5.1} s   {} segments along {:.0} m, {:.1} MB",
        place.name,
        began.elapsed().as_secs_f64(),
        map.len(),
        map.path_length_m(),
        map.file_size() as f64 * 1e-6
    ))?;
    esm_io::write_file(file("localize.toml"), place.config.as_bytes())?;
    let began = Instant::now();
    let mut found = localize::localize(
        &LocalizeArgs {
            inputs: vec![file("live.mcap")],
            map: file("map.esm"),
            single: false,
            budget_ms: None,
            truth: Some(file("live_truth.tum")),
            json: false,
            output: Some(file("poses.tum")),
            plot: None,
            live: LiveArgs::default(),
            read: ReadArgs::default(),
            tune: TuneArgs { config: Some(file("localize.toml")), ..TuneArgs::default() },
        },
        Lines::silent(),
    )?;
    let t = &found.tally;
    lines.line(&format!(
        "{:<8} localized  {:5.1} s   {} of {} clouds located, {} false",
        place.name,
        began.elapsed().as_secs_f64(),
        t.located,
        t.clouds,
        t.wrong
    ))?;
    let seasons = [preset.map, preset.live].map(|tour| format!("{:?}", tour.visit.season));
    found.caption.title =
        format!("{}, mapped in {} and found again in {}", place.name, seasons[0], seasons[1]);
    Ok(found)
}

/// A row a place.
fn table(all: &[Found]) -> String {
    let stages: Vec<&str> =
        all.first().map(|f| f.times.medians().iter().map(|m| m.0).collect()).unwrap_or_default();
    let number =
        |v: Option<f64>, digits: usize| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"));
    let mut rows = vec![
        vec!["place", "clouds", "localizable", "located", "correct", "false", "median error"]
            .into_iter()
            .map(str::to_owned)
            .collect::<Vec<_>>(),
    ];
    let mut times = vec![std::iter::once("ms a cloud").chain(stages).map(str::to_owned).collect::<Vec<_>>()];
    for (found, place) in all.iter().zip(&PLACES) {
        let t = &found.tally;
        let error = match (t.errors_m.at(0.5), t.errors_deg.at(0.5)) {
            (Some(m), Some(deg)) => format!("{m:.2} m, {deg:.2}°"),
            _ => "-".to_owned(),
        };
        let counts =
            [t.clouds, t.localizable + t.too_short, t.located, t.correct, t.wrong].map(|n| n.to_string());
        rows.push(std::iter::once(place.name.to_owned()).chain(counts).chain([error]).collect());
        let medians = found.times.medians();
        let medians = medians.iter().map(|m| number(m.1, 1));
        times.push(std::iter::once(place.name.to_owned()).chain(medians).collect());
    }
    let note = "localizable: within 10 m of the mapped path; correct: within 2 m and 5° of the\n\
                truth; false: located and not correct; ms: medians.";
    format!("{}\n{}\n{note}", columns(&rows), columns(&times))
}

/// Rows as lines, the columns after the first to the right.
fn columns(rows: &[Vec<String>]) -> String {
    let width = |i: usize| rows.iter().filter_map(|r| r.get(i)).map(|c| c.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().enumerate().map(|(i, cell)| match i {
            0 => format!("{cell:<w$}", w = width(0)),
            _ => format!("{cell:>w$}", w = width(i)),
        });
        text.push_str(cells.collect::<Vec<_>>().join("   ").trim_end());
        text.push('\n');
    }
    text
}

fn next_steps(dir: &Path, picture: &Path) -> String {
    let at = |name: &str| -> PathBuf { dir.join(name) };
    let (forest, street) = (at("forest"), at("street"));
    let (forest, street) = (forest.display(), street.display());
    format!(
        "Left behind:\n\
         \x20 {}   both maps from above, and where the second visits were found\n\
         \x20 {forest}, {street}   recordings, truth, map.esm, localize.toml, poses.tum\n\n\
         To go on:\n\
         \x20 esm-cli map info {forest}/map.esm\n\
         \x20 esm-cli localize --map {forest}/map.esm {forest}/live.mcap --truth {forest}/live_truth.tum \\\n\
         \x20   --config {forest}/localize.toml --plot forest.png\n\
         \x20 esm-cli localize --map {street}/map.esm {forest}/live.mcap --config {forest}/localize.toml   # a wrong map: nothing must be located\n\
         \x20 esm-cli simulate kitti --seed 100 --scale 0.1 -o {street} --plot world.png",
        picture.display()
    )
}

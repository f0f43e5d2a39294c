//! `esm-cli map build`.

use std::path::Path;

use esm_core::{Config, Map, MapBuilder};
use esm_io::InputKind;

use crate::args::{BuildArgs, LiveArgs};
use crate::inputs::{Frames, check_distinct, paths};
use crate::outcome::{Failure, Outcome};
use crate::output::{Format, check_target, data};
use crate::signals::Unfinished;
use crate::{console, info, memory, settings};

const FORMATS: &[Format] = &[Format { extension: ".esm" }];

pub(crate) fn run(args: &BuildArgs) -> anyhow::Result<Outcome> {
    let started = std::time::Instant::now();
    let map = build(args)?;
    report(&args.output, &map, started)
}

/// Builds the map and writes it.
pub(crate) fn build(args: &BuildArgs) -> anyhow::Result<Map> {
    Format::of(&args.output, FORMATS)?;
    check_distinct(&args.inputs)?;
    check_target(&args.output, &args.inputs)?;
    let live = LiveArgs { accumulate: args.accumulate, swathes: false };
    let config = settings::configure(&args.tune, &live)?.config;
    let kinds = args.inputs.iter().map(esm_io::classify).collect::<Result<Vec<_>, _>>()?;
    let builder = match (&args.inputs[..], kinds.contains(&InputKind::PriorCloud)) {
        ([cloud], true) => from_prior_cloud(cloud, args, &config)?,
        (_, false) => from_recordings(args, &config)?,
        (_, true) => {
            return Err(Failure::new(
                format!(
                    "a map is built from recordings, or from one prior cloud: {}",
                    kinds_of(args, &kinds)
                ),
                "put scans into a directory and give it with --poses, or give the one cloud alone",
            )
            .into());
        }
    };
    let bar = console::bar("describing the map", None);
    let map = builder.finish().map_err(|e| anyhow::Error::new(e).context(paths(&args.inputs)))?;
    bar.set_message("writing the map");
    {
        let _unfinished = Unfinished::begin();
        map.write(&args.output)?;
    }
    bar.finish_and_clear();
    Ok(map)
}

/// Segments of overlapping windows along the recorded path.
fn from_recordings(args: &BuildArgs, config: &Config) -> anyhow::Result<MapBuilder> {
    let mut builder = MapBuilder::new(config)?;
    builder.set_source(&names(args));
    let mut frames = Frames::open(&args.inputs, &args.read, "building the map")?;
    if let Some(silent) = frames.silent() {
        return Err(Failure::new(
            format!("{silent}: nothing tells where the scans were taken"),
            "give their poses with --poses FILE (TUM or KITTI), or name the topic with --odometry-topic",
        )
        .into());
    }
    let (mut stretch, mut posed) = (0, 0);
    while let Some(frame) = frames.next()? {
        if std::mem::replace(&mut stretch, frame.stretch) != frame.stretch {
            builder.interrupt()?;
        }
        // The reader tells how many have none.
        let Some(pose_map_sensor) = frame.sweep.pose_odom_sensor else { continue };
        posed += 1;
        builder.push_sweep(frame.sweep.stamp, &frame.sweep.cloud, &pose_map_sensor)?;
    }
    if posed == 0 {
        return Err(Failure::new(
            format!("{}: no scan has a pose", paths(&args.inputs)),
            "the poses must cover the time of the scans; compare their stamps",
        )
        .into());
    }
    Ok(builder)
}

/// One survey, already in the map frame.
fn from_prior_cloud(path: &Path, args: &BuildArgs, config: &Config) -> anyhow::Result<MapBuilder> {
    if args.read.poses.is_some()
        || !args.read.frames.is_empty()
        || args.read.from.is_some()
        || args.read.to.is_some()
    {
        return Err(Failure::new(
            format!("{}: one prior cloud has neither poses nor frames", path.display()),
            "leave out --poses, --frames, --from and --to, or give a directory of scans",
        )
        .into());
    }
    let bar = console::bar("reading the cloud", None);
    let prior = esm_io::read_prior_cloud(path)?;
    if prior.dropped > 0 {
        tracing::warn!("{}: {} invalid points were left out", path.display(), prior.dropped);
    }
    let mut builder = MapBuilder::new(config)?;
    builder.set_source(&names(args));
    bar.set_message("cutting it into segments");
    builder.push_prior_cloud(prior.origin, &prior.cloud)?;
    bar.finish_and_clear();
    Ok(builder)
}

/// The first prior cloud and the first other input, as what they are.
fn kinds_of(args: &BuildArgs, kinds: &[InputKind]) -> String {
    let word = |kind: &InputKind| match kind {
        InputKind::Recording => "a recording",
        InputKind::ScanDirectory => "a directory of scans",
        InputKind::PriorCloud => "a prior cloud",
    };
    let is_cloud = |i: &usize| kinds[*i] == InputKind::PriorCloud;
    let cloud = (0..kinds.len()).find(is_cloud);
    let other = (0..kinds.len()).find(|i| !is_cloud(i)).or_else(|| (0..kinds.len()).filter(is_cloud).nth(1));
    let both = cloud.into_iter().chain(other);
    let words: Vec<String> =
        both.map(|i| format!("{} is {}", args.inputs[i].display(), word(&kinds[i]))).collect();
    words.join(", ")
}

/// File names without their folders, as the map remembers them.
fn names(args: &BuildArgs) -> String {
    let name = |p: &std::path::PathBuf| {
        p.file_name().map_or_else(|| p.display().to_string(), |n| n.to_string_lossy().into_owned())
    };
    args.inputs.iter().map(name).collect::<Vec<_>>().join(", ")
}

fn report(path: &Path, map: &Map, started: std::time::Instant) -> anyhow::Result<Outcome> {
    let memory = memory::peak_mib().map_or_else(|| "unknown".to_owned(), |m| format!("{m:.0} MiB"));
    let elapsed = started.elapsed().as_secs_f64();
    let text =
        format!("{}\nbuilt in           {elapsed:.1} s, peak memory {memory}\n", info::table(path, map));
    data(text.as_bytes())?;
    Ok(Outcome::Done)
}

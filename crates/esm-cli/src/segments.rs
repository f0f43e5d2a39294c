//! `esm-cli segments`.

use std::path::PathBuf;

use esm_core::AccumulateConfig;
use esm_eval::object_of;
use esm_learn::{Found, Identities, IdentityRule, Row, SegmentSetWriter, SetInfo, Surveyor, UNKNOWN_CLASS};
use esm_sim::Class;
use serde_json::json;

use crate::args::{LiveArgs, SegmentsArgs};
use crate::inputs::{Frames, check_distinct, read_truth};
use crate::outcome::{Failure, Outcome};
use crate::output::data;
use crate::settings;
use crate::signals::Unfinished;

/// A recording with its truth.
struct Drive {
    recording: PathBuf,
    /// Without one the recording's own odometry is the truth.
    truth: Option<PathBuf>,
}

/// Drives through one place, in one map frame; the first is the mapping one.
struct Place {
    name: String,
    drives: Vec<Drive>,
}

pub(crate) fn run(args: &SegmentsArgs) -> anyhow::Result<Outcome> {
    check_distinct(&args.inputs)?;
    let config = settings::configure(&args.tune, &LiveArgs::default())?.config;
    let places = places(args)?;
    // An interrupt then ends the loop below, and the unfinished set goes.
    let _unfinished = Unfinished::begin();
    let info = SetInfo {
        places: places.iter().map(|p| p.name.clone()).collect(),
        classes: class_names(),
        voxel_m: config.segment.voxel,
        source: source(args),
    };
    let mut set = Set {
        writer: SegmentSetWriter::create(&args.output, info)?,
        clouds: 0,
        segments: 0,
        named: 0,
        identities: 0,
    };
    for (number, place) in places.iter().enumerate() {
        // Objects are numbered by the simulator or not at all: the first cloud of the place tells.
        let mut identities: Option<Identities> = None;
        for (visit, drive) in place.drives.iter().enumerate() {
            let truth = drive.truth.as_deref().map(read_truth).transpose()?;
            let mut surveyors = Vec::new();
            for distance_m in &args.accumulate {
                let accumulate = AccumulateConfig { distance_m: *distance_m, ..config.accumulate.clone() };
                let surveyor = Surveyor::new(&accumulate, &config.segment, args.step)
                    .map_err(|e| Failure::new(e.to_string(), "--accumulate and --step are in metres"))?;
                surveyors.push(surveyor);
            }
            let mut frames = Frames::open_labelled(&drive.recording, &args.read)?;
            if let Some(silent) = frames.silent() {
                let what = format!("{silent}: this recording does not tell how the sensor moved");
                return Err(Failure::new(what, "give --poses, or a recording with odometry").into());
            }
            while let Some(frame) = frames.next()? {
                let sweep = &frame.sweep;
                let Some(pose_odom_sensor) = sweep.pose_odom_sensor else { continue };
                let pose_map_sensor = match &truth {
                    Some(truth) => truth.at(sweep.stamp),
                    None => Some(pose_odom_sensor),
                };
                let numbered = !sweep.labels.is_empty();
                for surveyor in &mut surveyors {
                    let found = surveyor.push(
                        sweep.stamp,
                        &sweep.cloud,
                        &sweep.labels,
                        pose_odom_sensor,
                        pose_map_sensor,
                    );
                    let Some(found) = found else { continue };
                    let rule = if numbered { IdentityRule::NUMBERED } else { IdentityRule::PAPER };
                    let identities = identities.get_or_insert_with(|| Identities::new(rule));
                    set.push(found, numbered, identities, [number as u16, visit as u16])?;
                }
            }
        }
        set.identities += identities.map_or(0, |i| i.len());
    }
    let Set { writer, clouds, segments, named, identities } = set;
    if segments == 0 {
        let what = format!("no segment was found in {clouds} clouds");
        return Err(Failure::new(what, "is --accumulate longer than the recordings?").into());
    }
    writer.finish()?;
    let text = if args.json {
        let output = args.output.display().to_string();
        json!({ "output": output, "clouds": clouds, "segments": segments, "named": named, "objects": identities })
            .to_string()
            + "\n"
    } else {
        format!(
            "{}: {segments} segments of {clouds} clouds; {named} of them show one of {identities} objects\n",
            args.output.display()
        )
    };
    data(text.as_bytes())?;
    Ok(Outcome::Done)
}

/// The set in hand.
struct Set {
    writer: SegmentSetWriter,
    clouds: u32,
    segments: u64,
    named: u64,
    identities: usize,
}

impl Set {
    fn push(
        &mut self,
        found: Vec<Found>,
        numbered: bool,
        identities: &mut Identities,
        [place, visit]: [u16; 2],
    ) -> anyhow::Result<()> {
        for f in found {
            let object = object_of(&f, numbered, identities);
            let class = f.label.map_or(UNKNOWN_CLASS, |l| l.class);
            self.writer.push(&Row {
                points: f.points,
                centroid_map: f.centroid_map,
                object,
                observation: self.clouds,
                visit,
                place,
                class,
                context: f.context,
            })?;
            self.segments += 1;
            self.named += u64::from(object >= 0);
        }
        self.clouds += 1;
        Ok(())
    }
}

/// Names by number, empty where there is no class of it.
fn class_names() -> Vec<String> {
    let most = Class::ALL.iter().map(|c| *c as u8).max().unwrap_or(0);
    (0..=most).map(|n| Class::from_number(n).map(Class::name).unwrap_or_default()).collect()
}

/// A directory that `simulate` has made is a place with its two visits; recordings together are one place.
fn places(args: &SegmentsArgs) -> anyhow::Result<Vec<Place>> {
    let name = |path: &std::path::Path| {
        path.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
    };
    let (simulated, recorded): (Vec<&PathBuf>, Vec<&PathBuf>) =
        args.inputs.iter().partition(|p| p.join("map.mcap").is_file() && p.join("map_truth.tum").is_file());
    if let Some(first) = simulated.first() {
        if !recorded.is_empty() {
            let what = "directories of the simulator and other recordings cannot be mixed".to_owned();
            return Err(
                Failure::new(what, "the simulator's directories hold their truth; make two sets").into()
            );
        }
        let given = [
            ("--truth", !args.truth.is_empty()),
            ("--poses", args.read.poses.is_some()),
            ("--place", args.place.is_some()),
        ];
        if let Some((flag, _)) = given.into_iter().find(|(_, given)| *given) {
            let what = format!("{flag}: {} is a directory of the simulator", first.display());
            return Err(Failure::new(
                what,
                "it holds the truth of its visits and its name: leave the flag away",
            )
            .into());
        }
        let visit = |dir: &std::path::Path, name: &str| Drive {
            recording: dir.join(format!("{name}.mcap")),
            truth: Some(dir.join(format!("{name}_truth.tum"))),
        };
        let mut places = Vec::new();
        for dir in simulated {
            let Some(name) = esm_sim::made_in(dir) else {
                let what = format!("{}: its preset.toml is missing or damaged", dir.display());
                return Err(Failure::new(what, "simulate it again: the same command repairs it").into());
            };
            if places.iter().any(|p: &Place| p.name == name) {
                let what = format!("{}: {name} is given twice", dir.display());
                return Err(Failure::new(what, "the same simulation is the same place: give it once").into());
            }
            places.push(Place { name, drives: vec![visit(dir, "map"), visit(dir, "live")] });
        }
        return Ok(places);
    }
    if !args.truth.is_empty() && args.truth.len() != recorded.len() {
        let what = format!("{} truths for {} recordings", args.truth.len(), recorded.len());
        return Err(Failure::new(what, "give one --truth a recording, in their order, or none").into());
    }
    let drives = recorded
        .iter()
        .enumerate()
        .map(|(n, path)| Drive { recording: (*path).clone(), truth: args.truth.get(n).cloned() });
    let place = args.place.clone().unwrap_or_else(|| recorded.first().map_or_else(String::new, |p| name(p)));
    Ok(vec![Place { name: place, drives: drives.collect() }])
}

fn source(args: &SegmentsArgs) -> String {
    let lengths: Vec<String> = args.accumulate.iter().map(f64::to_string).collect();
    let frames = if args.read.frames.is_empty() {
        String::new()
    } else {
        let ranges: Vec<String> = args.read.frames.iter().map(ToString::to_string).collect();
        format!(" --frames {}", ranges.join(","))
    };
    let inputs: Vec<String> = args.inputs.iter().map(|p| p.display().to_string()).collect();
    format!(
        "esm-cli {} segments {} --accumulate {} --step {}{frames}",
        env!("CARGO_PKG_VERSION"),
        inputs.join(" "),
        lengths.join(","),
        args.step
    )
}

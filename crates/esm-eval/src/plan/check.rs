//! From what was written to a plan that can be followed.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use esm_core::{Config, describe};
use esm_sim::Drive;
use toml::Spanned;

use super::text::{DatasetText, MethodText, ModeText, PlanText, RocText, line_of};
use super::{Dataset, Files, Method, Mode, Plan, RocPlan, Simulated, Source};
use crate::error::Error;

/// Most characters of a name.
const LONGEST_NAME: usize = 60;
/// Metres between two clouds whose segments are judged, where the plan does not say.
const ROC_STEP_M: f64 = 5.0;

/// The file in hand.
struct Reader<'a> {
    path: &'a Path,
    text: &'a str,
}

impl Reader<'_> {
    /// An error at what was written.
    fn at<T>(&self, place: &Spanned<T>, what: impl Into<String>, hint: impl Into<String>) -> Error {
        self.error(Some(line_of(self.text, place.span().start)), what, hint)
    }

    fn error(&self, line: Option<usize>, what: impl Into<String>, hint: impl Into<String>) -> Error {
        Error::Plan { path: self.path.to_owned(), line, what: what.into(), hint: hint.into() }
    }

    /// A path as the plan means it.
    fn resolve(&self, path: &str) -> PathBuf {
        self.path.parent().unwrap_or(Path::new("")).join(path)
    }

    /// A file or directory that must be there.
    fn existing(&self, of: &str, path: &Spanned<String>) -> Result<PathBuf, Error> {
        let full = self.resolve(path.get_ref());
        let hint = "paths start at the folder of the plan";
        match std::fs::metadata(&full) {
            Ok(meta) if meta.is_file() || meta.is_dir() => Ok(full),
            Ok(_) => Err(self.at(
                path,
                format!("{of}: {} is neither a file nor a directory", full.display()),
                hint,
            )),
            Err(e) => Err(self.at(path, format!("{of}: {}: {e}", full.display()), hint)),
        }
    }

    /// Names that can be told apart and written into a table.
    fn names<'n>(&self, kind: &str, names: impl Iterator<Item = &'n Spanned<String>>) -> Result<(), Error> {
        let mut seen = BTreeSet::new();
        for name in names {
            let text = name.get_ref();
            let plain = |c: char| c.is_alphanumeric() || " -_.+'%".contains(c);
            if text.trim().is_empty() || text.chars().count() > LONGEST_NAME || !text.chars().all(plain) {
                let hint = format!("take 1 to {LONGEST_NAME} letters, digits, spaces and any of - _ . + ' %");
                return Err(self.at(name, format!("{kind} {text:?}: this cannot be a name"), hint));
            }
            if !seen.insert(text) {
                return Err(self.at(
                    name,
                    format!("{kind} '{text}': there are two of this name"),
                    "rename one",
                ));
            }
        }
        Ok(())
    }
}

/// Checks everything that can be checked before any work.
pub(super) fn checked(path: &Path, written: &PlanText) -> Result<Plan, Error> {
    let reader = Reader { path, text: &written.text };
    if written.datasets.is_empty() {
        return Err(reader.error(None, "there is no dataset", "add a table [[datasets]]"));
    }
    if written.methods.is_empty() {
        return Err(reader.error(None, "there is no method", "add [[methods]] with `name = \"esm-swift\"`"));
    }
    reader.names("dataset", written.datasets.iter().map(|d| &d.name))?;
    reader.names("method", written.methods.iter().map(|m| &m.name))?;
    let modes = match written.modes.as_deref() {
        None => vec![Mode::default()],
        Some([]) => {
            return Err(reader.error(None, "there is no mode", "leave `modes` out for single clouds"));
        }
        Some(modes) => {
            reader.names("mode", modes.iter().map(|m| &m.name))?;
            modes.iter().map(|m| mode(&reader, m, written)).collect::<Result<_, _>>()?
        }
    };
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let plan = Plan {
        path: path.to_owned(),
        name: written.name.clone().unwrap_or(name),
        datasets: written.datasets.iter().map(|d| dataset(&reader, d)).collect::<Result<_, _>>()?,
        methods: written.methods.iter().map(|m| method(&reader, m)).collect::<Result<_, _>>()?,
        modes,
        roc: written.roc.as_ref().map(|r| roc(&reader, r, written)).transpose()?,
        config: written.config.clone(),
    };
    // Settings that fit only together are checked together.
    for dataset in &plan.datasets {
        for (method, text) in plan.methods.iter().zip(&written.methods) {
            plan.map_config(dataset, method).map_err(|e| with_line(e, &reader, &text.name))?;
            for mode in plan.modes.iter().filter(|m| m.is_for(&dataset.name, &method.name)) {
                plan.live_config(dataset, method, mode).map_err(|e| with_line(e, &reader, &text.name))?;
            }
        }
    }
    Ok(plan)
}

fn with_line(error: Error, reader: &Reader<'_>, place: &Spanned<String>) -> Error {
    match error {
        Error::Plan { what, hint, .. } => reader.at(place, what, hint),
        other => other,
    }
}

fn dataset(reader: &Reader<'_>, d: &DatasetText) -> Result<Dataset, Error> {
    let name = d.name.get_ref();
    let of = |what: &str| format!("dataset '{name}', {what}");
    let source = match (&d.preset, &d.map) {
        (Some(preset), None) => {
            let files = [&d.map_poses, &d.live, &d.live_poses, &d.truth];
            if let Some(file) = files.into_iter().flatten().next() {
                let what = format!("dataset '{name}': a simulated one brings its own files");
                return Err(reader.at(file, what, "leave out `preset`, or the files"));
            }
            Source::Simulated(simulated(reader, d, preset)?)
        }
        (None, Some(map)) => {
            let simulator = [d.seeds.is_some(), d.scale.is_some(), d.live_reversed.is_some()];
            if simulator.contains(&true) || d.live_offset.is_some() || d.live_changed.is_some() {
                let what = format!("dataset '{name}': seeds, scale and live_... are for the simulator");
                return Err(reader.at(&d.name, what, "give `preset` instead of files, or leave them out"));
            }
            let needed = |path: &Option<Spanned<String>>, key: &str| match path {
                Some(path) => reader.existing(&of(key), path),
                None => {
                    Err(reader.at(&d.name, format!("dataset '{name}': `{key}` is missing"), "name the file"))
                }
            };
            let optional = |path: &Option<Spanned<String>>, key: &str| {
                path.as_ref().map(|p| reader.existing(&of(key), p)).transpose()
            };
            Source::Files(Box::new(Files {
                map: reader.existing(&of("map"), map)?,
                map_poses: optional(&d.map_poses, "map_poses")?,
                live: needed(&d.live, "live")?,
                live_poses: optional(&d.live_poses, "live_poses")?,
                truth: needed(&d.truth, "truth")?,
                cloud_topic: d.cloud_topic.clone(),
                odometry_topic: d.odometry_topic.clone(),
            }))
        }
        _ => {
            let what = format!("dataset '{name}': either `preset` or `map` is needed");
            return Err(reader.at(&d.name, what, "a simulator's preset with seeds, or map, live and truth"));
        }
    };
    let accumulate_m = d.accumulate.unwrap_or(Config::default().accumulate.distance_m);
    Ok(Dataset { name: name.clone(), source, accumulate_m, swathes: d.swathes, config: d.config.clone() })
}

fn simulated(reader: &Reader<'_>, d: &DatasetText, preset: &Spanned<String>) -> Result<Simulated, Error> {
    let name = d.name.get_ref();
    let refused = |error: esm_sim::Error| {
        let text = error.to_string();
        let (what, hint) = text.split_once("\nhint: ").unwrap_or((&text, "see `esm-cli simulate --help`"));
        reader.at(preset, format!("dataset '{name}': {what}"), hint)
    };
    let seeds = d.seeds.clone().unwrap_or_default();
    let distinct: BTreeSet<u64> = seeds.iter().copied().collect();
    if seeds.is_empty() || distinct.len() < seeds.len() {
        let what = format!("dataset '{name}': `seeds` must name each world once");
        return Err(reader.at(&d.name, what, "such as `seeds = [200, 201, 202]`"));
    }
    let drive = Drive {
        reversed: d.live_reversed.unwrap_or(false),
        offset_m: d.live_offset.unwrap_or(0.0),
        changed: d.live_changed,
    };
    let scale = d.scale.unwrap_or(1.0);
    esm_sim::check_scale(scale).map_err(refused)?;
    drive.of(&esm_sim::preset(preset.get_ref()).map_err(refused)?).map_err(refused)?;
    Ok(Simulated { preset: preset.get_ref().clone(), seeds, scale, drive })
}

fn method(reader: &Reader<'_>, m: &MethodText) -> Result<Method, Error> {
    let place = m.descriptor.as_ref().unwrap_or(&m.name);
    let asked = place.get_ref();
    let descriptor = match describe::NAMES.contains(&asked.as_str()) || !asked.ends_with(".safetensors") {
        true => asked.clone(),
        false => reader.resolve(asked).to_string_lossy().into_owned(),
    };
    describe::by_name(&descriptor).map_err(|e| {
        let (what, hint) = match &e {
            esm_core::Error::Config { .. } => (
                format!("there is no descriptor '{asked}'"),
                format!("there are {}, and weights files (*.safetensors)", describe::NAMES.join(", ")),
            ),
            e => {
                let text = e.to_string();
                let (what, hint) =
                    text.split_once("\nhint: ").unwrap_or((&text, "paths start at the folder of the plan"));
                (what.to_owned(), hint.to_owned())
            }
        };
        reader.at(place, format!("method '{}': {what}", m.name.get_ref()), hint)
    })?;
    Ok(Method { name: m.name.get_ref().clone(), descriptor, config: m.config.clone() })
}

fn mode(reader: &Reader<'_>, m: &ModeText, written: &PlanText) -> Result<Mode, Error> {
    let refuse = |what: String, hint: &str| {
        Err(reader.at(&m.name, format!("mode '{}': {what}", m.name.get_ref()), hint))
    };
    if m.every == 0 || m.beams == 0 {
        return refuse("`every` and `beams` count from 1".to_owned(), "1 takes all of them");
    }
    if !(0.0..1.0).contains(&m.map_deleted) {
        return refuse(
            format!("map_deleted = {} is no share", m.map_deleted),
            "0.5 deletes half of the segments",
        );
    }
    Ok(Mode {
        name: m.name.get_ref().clone(),
        accumulate_m: m.accumulate,
        odometry: m.odometry,
        every: m.every,
        beams: m.beams,
        map_deleted: m.map_deleted,
        map_deleted_seed: m.map_deleted_seed,
        datasets: named(reader, "dataset", &m.datasets, written.datasets.iter().map(|d| d.name.get_ref()))?,
        methods: named(reader, "method", &m.methods, written.methods.iter().map(|d| d.name.get_ref()))?,
    })
}

fn roc(reader: &Reader<'_>, r: &RocText, written: &PlanText) -> Result<RocPlan, Error> {
    let step_m = r.step.unwrap_or(ROC_STEP_M);
    if !(0.0..=10_000.0).contains(&step_m) {
        let what = format!("roc: step = {step_m} m is not possible");
        return Err(reader.error(None, what, "give 0 to 10000 m, such as 5"));
    }
    let datasets = named(reader, "dataset", &r.datasets, written.datasets.iter().map(|d| d.name.get_ref()))?;
    Ok(RocPlan { step_m, seed: r.seed, datasets })
}

/// Names that must be among the plan's own.
fn named<'a>(
    reader: &Reader<'_>,
    kind: &str,
    names: &Option<Vec<Spanned<String>>>,
    there: impl Iterator<Item = &'a String>,
) -> Result<Option<Vec<String>>, Error> {
    let there: Vec<&String> = there.collect();
    let Some(names) = names else { return Ok(None) };
    for name in names {
        if !there.contains(&name.get_ref()) {
            let what = format!("there is no {kind} '{}'", name.get_ref());
            return Err(reader.at(name, what, list(kind, &there)));
        }
    }
    Ok(Some(names.iter().map(|n| n.get_ref().clone()).collect()))
}

/// Refuses a name that was asked for and is not in the plan.
pub(super) fn known<'a>(
    path: &Path,
    kind: &str,
    asked: &[String],
    there: impl Iterator<Item = &'a String>,
) -> Result<(), Error> {
    let there: Vec<&String> = there.collect();
    match asked.iter().find(|name| !there.contains(name)) {
        None => Ok(()),
        Some(name) => Err(Error::Plan {
            path: path.to_owned(),
            line: None,
            what: format!("there is no {kind} '{name}'"),
            hint: list(kind, &there),
        }),
    }
}

fn list(kind: &str, there: &[&String]) -> String {
    let names: Vec<&str> = there.iter().map(|n| n.as_str()).collect();
    format!("the plan's {kind}s are {}", names.join(", "))
}

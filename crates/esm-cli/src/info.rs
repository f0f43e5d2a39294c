//! `esm-cli map info`.

use std::path::Path;

use esm_core::Map;
use esm_core::map::FORMAT_VERSION;
use serde_json::{Value, json};

use crate::args::InfoArgs;
use crate::outcome::Outcome;
use crate::output::data;

pub(crate) fn run(args: &InfoArgs) -> anyhow::Result<Outcome> {
    let map = Map::open(&args.map)?;
    if args.check {
        map.verify_points()?;
    }
    let text = match args.json {
        true => format!("{}\n", summary(&map, args.check)),
        false => {
            let checked = if args.check { "\nchecked            every byte" } else { "" };
            let settings = match args.settings {
                true => format!("\n\n{}", map.settings().trim_end()),
                false => String::new(),
            };
            format!("{}{checked}{settings}\n", table(&args.map, &map))
        }
    };
    data(text.as_bytes())?;
    Ok(Outcome::Done)
}

fn summary(map: &Map, checked: bool) -> Value {
    let (descriptor, (min, max)) = (map.descriptor_info(), map.bounds());
    json!({
        "format": format!("{}.{}", FORMAT_VERSION.0, FORMAT_VERSION.1),
        "bytes": map.file_size(),
        "source": map.source(),
        "frame_id": map.frame_id(),
        "descriptor": {"name": descriptor.name, "version": descriptor.version, "dim": descriptor.dim},
        "segments": map.len(),
        "points": map.point_count(),
        "ground_tiles": map.ground_tiles().len(),
        "structure_tiles": map.structure_tiles().len(),
        "path": {"positions": map.path().len(), "length_m": map.path_length_m()},
        "coverage_cells": map.coverage().len(),
        "origin": map.origin(),
        "bounds": {"min": min, "max": max},
        "sections": map.sections().iter().map(section).collect::<Vec<_>>(),
        "settings": map.settings(),
        "points_checked": checked,
    })
}

fn section(s: &esm_core::map::SectionInfo) -> Value {
    json!({"id": s.id, "offset": s.offset, "bytes": s.len})
}

/// What a map holds, a line each.
pub(crate) fn table(path: &Path, map: &Map) -> String {
    let (descriptor, (min, max)) = (map.descriptor_info(), map.bounds());
    let size = [0, 1, 2].map(|a| max[a] - min[a]);
    let place = match map.path() {
        [] => format!("no path; {} cells of 5 m hold points", map.coverage().len()),
        path => format!("path of {:.0} m, {} positions", map.path_length_m(), path.len()),
    };
    let rows = [
        ("map", path.display().to_string()),
        ("built from", map.source().to_owned()),
        (
            "size on disk",
            format!(
                "{:.1} MB, format {}.{}",
                map.file_size() as f64 / 1e6,
                FORMAT_VERSION.0,
                FORMAT_VERSION.1
            ),
        ),
        ("segments", map.len().to_string()),
        (
            "tiles",
            format!("{} of ground, {} of structure", map.ground_tiles().len(), map.structure_tiles().len()),
        ),
        ("points", map.point_count().to_string()),
        (
            "descriptor",
            format!("{} (version {}, {} numbers)", descriptor.name, descriptor.version, descriptor.dim),
        ),
        ("covers", place),
        ("extent", format!("{:.0} x {:.0} x {:.0} m", size[0], size[1], size[2])),
        ("frame", map.frame_id().to_owned()),
    ];
    let rows: Vec<String> = rows.iter().map(|(name, value)| format!("{name:<18} {value}")).collect();
    rows.join("\n")
}

//! The picture of a run: the map from above, the drive coloured by what was found, and lines to the matched places.
//!
//! One drawing, made as SVG; the PNG is the same drawing, rendered with a font that is part of the program.

mod backdrop;
mod draw;
mod drive;
mod png;
mod recognised;
mod roc;
mod style;
mod view;
mod world;

use std::io::Write;
use std::path::Path;

use esm_core::map::Map;
use esm_eval::{Cloud, Roc};
use esm_sim::Preset;

use crate::outcome::Failure;
use crate::output::{Format, Target};

pub(crate) use drive::Drive;

const FORMATS: &[Format] = &[Format { extension: ".png" }, Format { extension: ".svg" }];

/// Lowest and highest drawing area of a picture of several, pixels.
const PANEL_HEIGHT: (f64, f64) = (420.0, 640.0);

/// Checks the extension before any work is done.
pub(crate) fn check_format(path: &Path) -> Result<(), Failure> {
    Format::of(path, FORMATS).map(drop)
}

/// What stands above the picture.
pub(crate) struct Caption {
    pub(crate) title: String,
    pub(crate) figures: String,
}

fn render(path: &Path, svg: &str) -> Result<Vec<u8>, Failure> {
    png::render(svg).map_err(|e| {
        Failure::new(format!("{}: {e:#}", path.display()), "a .svg needs no rendering: plot that")
    })
}

/// Draws and writes the picture.
pub(crate) fn write(path: &Path, map: &Map, drive: &Drive, caption: &Caption) -> anyhow::Result<()> {
    put(path, &draw::svg(map, &drive.places(), drive.unplaced(), caption)?.to_string())
}

/// Draws several maps with their drives into one picture, and writes it.
pub(crate) fn places(path: &Path, panels: &[(&Map, &Drive, &Caption)]) -> anyhow::Result<()> {
    let panels: Vec<_> = panels
        .iter()
        .map(|(map, drive, caption)| (*map, drive.places(), drive.unplaced(), *caption))
        .collect();
    put(path, &draw::stacked(&panels, PANEL_HEIGHT)?.to_string())
}

/// Draws a simulated world, and writes the picture.
pub(crate) fn world(path: &Path, preset: &Preset, seed: u64, scale: f64) -> anyhow::Result<()> {
    put(path, &world::svg(preset, seed, scale)?)
}

/// Draws the curves of descriptors, by the names of the methods.
pub(crate) fn roc(path: &Path, curves: &[(&str, &Roc)], caption: &Caption) -> anyhow::Result<()> {
    put(path, &roc::svg(curves, caption).to_string())
}

/// Draws the map with the places that were recognised.
pub(crate) fn recognised(path: &Path, map: &Map, clouds: &[Cloud], caption: &Caption) -> anyhow::Result<()> {
    put(path, &recognised::svg(map, clouds, caption)?.to_string())
}

fn put(path: &Path, svg: &str) -> anyhow::Result<()> {
    let format = Format::of(path, FORMATS)?;
    let bytes = if format.extension == ".png" { render(path, svg)? } else { svg.as_bytes().to_vec() };
    let mut target = Target::create(path)?;
    target.write_all(&bytes)?;
    target.finish()
}

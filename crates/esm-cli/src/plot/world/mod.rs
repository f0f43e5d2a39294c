//! A simulated world for people: from above with the paths of both visits, and a sweep in perspective.

mod above;
mod kinds;
mod raster;
mod sweep;

use esm_core::Pose;
use esm_sim::{Plan, Preset, Tiles};
use nalgebra::Vector3;
use svg::Document;
use svg::node::element::{ClipPath, Definitions, Group, Path, Rectangle};

use super::Caption;
use super::draw::{circle, fitting, heading, line, scale_bar, text, text_width};
use super::style::*;
use super::view::View;
use kinds::KINDS;

/// Lowest and highest picture from above, pixels.
const ABOVE_HEIGHT: (f64, f64) = (480.0, 980.0);
/// Height of the picture of the sweep, pixels.
const SWEEP_HEIGHT: f64 = 640.0;
/// What is shown around the paths, metres.
const AROUND_M: f64 = 35.0;
/// Share of a picture that a kind must make up to be in the legend.
const LEGEND_SHARE: f64 = 1e-4;
/// Paths are drawn through poses this far apart, metres.
const PATH_STEP_M: f64 = 1.0;

const MAP_PATH: &str = "#0b5fb4";
const LIVE_PATH: &str = "#ffd23f";
const CASING: &str = "#1b1f24";

/// The whole picture.
pub(super) fn svg(preset: &Preset, seed: u64, scale: f64) -> anyhow::Result<String> {
    let worlds = [preset.map, preset.live].map(|tour| Plan::world(preset, seed, scale, &tour));
    let map = Plan::new(preset, seed, scale, &preset.map, &worlds[0]);
    let live = Plan::new(preset, seed, scale, &preset.live, &worlds[1]);
    let view = view(&[&map.truth, &live.truth]);
    let (above, seen) = above::draw(&worlds[0], &view);
    let [left, top] = view.pixel([view.min[0], view.max[1]]);
    let bottom = top + view.area[1];
    let sweep_top = bottom + 74.0;
    let sweep = sweep::draw(&map, &mut Tiles::new(&worlds[0]), [view.area[0].floor(), SWEEP_HEIGHT]);
    let legend_top = sweep_top + SWEEP_HEIGHT + 44.0;
    let shown: Vec<usize> = (0..KINDS.len())
        .filter(|k| {
            let share =
                |counts: &[u64; KINDS.len()]| counts[*k] as f64 / counts.iter().sum::<u64>().max(1) as f64;
            share(&seen) > LEGEND_SHARE || share(&sweep.counts) > LEGEND_SHARE
        })
        .collect();
    let (legend, height) = legend(&shown, legend_top);
    let clip = |id: &str, y: f64, height: f64| {
        ClipPath::new().set("id", id).add(frame([left, y], [view.area[0], height]))
    };
    let paths = Group::new()
        .set("clip-path", "url(#above)")
        .add(path(&flat(&map.truth, &view), MAP_PATH, 6.0))
        .add(path(&flat(&live.truth, &view), LIVE_PATH, 2.4))
        .add(here(view.pixel(xy(&map.truth[sweep.sweep]))));
    let way = way(&map, preset, &sweep);
    let way = Group::new()
        .set("clip-path", "url(#sweep)")
        .set("transform", format!("translate({left} {sweep_top})"))
        .add(way);
    let document = Document::new()
        .set("width", WIDTH)
        .set("height", height)
        .set("viewBox", (0, 0, WIDTH, height))
        .set("font-family", FONT)
        .add(
            Definitions::new()
                .add(clip("above", top, view.area[1]))
                .add(ClipPath::new().set("id", "sweep").add(frame([0.0; 2], [view.area[0], SWEEP_HEIGHT]))),
        )
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", PAPER))
        .add(heading(&caption(preset, seed, scale, &map)))
        .add(above.image([left, top])?)
        .add(paths)
        .add(scale_bar(&view))
        .add(frame([left, top], view.area).set("fill", "none").set("stroke", FRAME).set("stroke-width", 1.5))
        .add(title(sweep_title(&map, &sweep), [left, sweep_top - 22.0]))
        .add(sweep.raster.image([left, sweep_top])?)
        .add(way)
        .add(legend);
    Ok(document.to_string())
}

fn view(truths: &[&[Pose]]) -> View {
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for p in truths.iter().flat_map(|t| t.iter()).map(xy) {
        for i in 0..2 {
            bounds[0][i] = bounds[0][i].min(p[i] - AROUND_M);
            bounds[1][i] = bounds[1][i].max(p[i] + AROUND_M);
        }
    }
    View::within(bounds[0], bounds[1], ABOVE_HEIGHT)
}

fn xy(pose: &Pose) -> [f64; 2] {
    [pose.translation.x, pose.translation.y]
}

fn caption(preset: &Preset, seed: u64, scale: f64, map: &Plan<'_>) -> Caption {
    let scale = if scale == 1.0 { String::new() } else { format!(", scale {scale}") };
    Caption {
        title: format!("{}, seed {seed}{scale}: the world from above", preset.name),
        figures: format!(
            "{}  \u{b7}  {:.0} m on the map visit, {:?} and {:?}  \u{b7}  {}",
            preset.about,
            map.travel_m(),
            preset.map.visit.season,
            preset.live.visit.season,
            preset.sensor.sensor().name
        ),
    }
}

fn sweep_title(map: &Plan<'_>, sweep: &sweep::View3) -> String {
    let what = match sweep.swath_m {
        Some(metres) => format!("{metres:.0} m of lines of the {}", map.sensor.name),
        None => format!("One sweep of the {}", map.sensor.name),
    };
    format!("{what} at the white mark, from behind: {} points", thousands(sweep.points))
}

fn thousands(n: usize) -> String {
    if n < 1000 { n.to_string() } else { format!("{},{:03}", n / 1000, n % 1000) }
}

fn title(words: String, at: [f64; 2]) -> svg::node::element::Text {
    let px = fitting(&words, 24.0);
    text(words, at).set("font-size", px).set("font-weight", "bold").set("fill", INK)
}

fn frame([x, y]: [f64; 2], [width, height]: [f64; 2]) -> Rectangle {
    Rectangle::new().set("x", x).set("y", y).set("width", width).set("height", height)
}

/// Pixels of the path, thinned.
fn flat(truth: &[Pose], view: &View) -> Vec<[f64; 2]> {
    let mut last: Option<Vector3<f64>> = None;
    let mut out = Vec::new();
    for pose in truth {
        let at = pose.translation.vector;
        if last.is_none_or(|l| (at - l).norm() >= PATH_STEP_M) {
            last = Some(at);
            out.push(view.pixel(xy(pose)));
        }
    }
    out
}

/// A line with a dark edge, to be seen on anything.
fn path(pixels: &[[f64; 2]], colour: &str, width: f64) -> Group {
    let mut d = String::new();
    for (i, [x, y]) in pixels.iter().enumerate() {
        d.push_str(&format!("{}{x:.1} {y:.1}", if i == 0 { 'M' } else { 'L' }));
    }
    let stroke = |colour: &str, width: f64| {
        Path::new()
            .set("d", d.clone())
            .set("fill", "none")
            .set("stroke", colour.to_owned())
            .set("stroke-width", width)
            .set("stroke-linecap", "round")
            .set("stroke-linejoin", "round")
    };
    Group::new().add(stroke(CASING, width + 1.8).set("stroke-opacity", 0.55)).add(stroke(colour, width))
}

/// Where the sweep was taken.
fn here(at: [f64; 2]) -> Group {
    Group::new().add(circle(at, 8.0).set("fill", PAPER).set("stroke", CASING).set("stroke-width", 3))
}

/// The way on, on the ground in the picture of the sweep.
fn way(map: &Plan<'_>, preset: &Preset, sweep: &sweep::View3) -> Group {
    let ground = |p: &Pose| p.translation.vector - Vector3::z() * preset.sensor_height_m;
    let start = ground(&map.truth[sweep.sweep]);
    let ahead = map.truth[sweep.sweep..].iter().map(ground).take_while(|p| (p - start).norm() < 60.0);
    let pixels: Vec<[f64; 2]> = ahead.filter_map(|p| sweep.camera.pixel(p)).map(|(px, _)| px).collect();
    let line = path(&pixels, MAP_PATH, 3.2).set("opacity", 0.75);
    match sweep.camera.pixel(map.truth[sweep.sweep].translation.vector) {
        Some((at, _)) => Group::new().add(line).add(here(at)),
        None => Group::new().add(line),
    }
}

/// The legend, and the height of the picture that ends with it.
fn legend(shown: &[usize], top: f64) -> (Group, f64) {
    let (mut x, mut y) = (MARGIN[0], top);
    let mut group = Group::new().set("font-size", TICK_PX).set("fill", INK);
    let mut place = |label: &str| {
        let width = 56.0 + 0.92 * text_width(label, TICK_PX);
        if x + width > WIDTH - MARGIN[2] && x > MARGIN[0] {
            (x, y) = (MARGIN[0], y + 32.0);
        }
        let at = [x, y];
        x += width;
        at
    };
    for (label, colour) in [("path of the map visit", MAP_PATH), ("path of the live visit", LIVE_PATH)] {
        let [x, y] = place(label);
        let key = line([x + 2.0, y - 6.0], [x + 30.0, y - 6.0])
            .set("stroke-width", 4)
            .set("stroke-linecap", "round");
        let casing = key.clone().set("stroke", CASING).set("stroke-width", 6).set("stroke-opacity", 0.55);
        group = group.add(casing).add(key.set("stroke", colour)).add(text(label, [x + 42.0, y]));
    }
    for kind in shown.iter().map(|k| KINDS[*k]) {
        let [x, y] = place(kind.label);
        let [r, g, b] = kind.rgb;
        let square =
            frame([x + 6.0, y - 16.0], [22.0, 18.0]).set("rx", 3).set("fill", format!("rgb({r},{g},{b})"));
        group = group.add(square).add(text(kind.label, [x + 42.0, y]));
    }
    (group, y + 34.0)
}

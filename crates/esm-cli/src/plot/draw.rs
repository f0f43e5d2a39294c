//! The drawing: backdrop, mapped path, matches, drive, frame, legend, from bottom to top.

use esm_core::map::Map;
use svg::Document;
use svg::node::element::path::Data;
use svg::node::element::{Circle, ClipPath, Definitions, Group, Line, Path, Rectangle, Text};

use super::drive::{Found, Place};
use super::style::*;
use super::view::{View, round_length};
use super::{Caption, backdrop};

/// Match lines are drawn for clouds at least this far apart, pixels and metres: more would be one green smear.
const MATCHES_APART: (f64, f64) = (56.0, 28.0);
/// Markers of one kind at least this far apart, pixels.
const MARKERS_APART_PX: f64 = 5.0;
/// Positions of the mapped path farther apart are not joined, metres.
const PATH_GAP_M: f64 = 20.0;
/// The view leaves out the outermost segments, this share on each side: stray points must not shrink the rest.
const STRAY_SHARE: f64 = 0.005;

/// The whole picture. `unplaced` clouds are only counted.
pub(crate) fn svg(
    map: &Map,
    places: &[Place],
    unplaced: usize,
    caption: &Caption,
) -> anyhow::Result<Document> {
    let bounds = bounds(map, &at(places));
    panel(map, places, unplaced, caption, &View::of(bounds[0], bounds[1]), "area")
}

/// Several pictures, one above the other, each with the drawing areas of these lowest and highest heights in pixels.
pub(super) fn stacked(
    panels: &[(&Map, Vec<Place>, usize, &Caption)],
    heights: (f64, f64),
) -> anyhow::Result<Document> {
    let (mut document, mut top) = (Document::new(), 0.0);
    for (i, (map, places, unplaced, caption)) in panels.iter().enumerate() {
        let bounds = bounds(map, &at(places));
        let view = View::within(bounds[0], bounds[1], heights);
        let panel = panel(map, places, *unplaced, caption, &view, &format!("area{i}"))?;
        document = document.add(panel.set("y", top));
        top += view.height();
    }
    Ok(document.set("width", WIDTH).set("height", top).set("viewBox", (0, 0, WIDTH, top)))
}

/// One picture; `id` is unique in the document.
fn panel(
    map: &Map,
    places: &[Place],
    unplaced: usize,
    caption: &Caption,
    view: &View,
    id: &str,
) -> anyhow::Result<Document> {
    let clip = Definitions::new().add(ClipPath::new().set("id", id).add(area(view)));
    let inside = Group::new()
        .set("clip-path", format!("url(#{id})"))
        .add(grid(view))
        .add(backdrop::draw(map, view)?)
        .add(mapped_path(map, view))
        .add(matches(places, view))
        .add(drive(places, view));
    let document = Document::new()
        .set("width", WIDTH)
        .set("height", view.height())
        .set("viewBox", (0, 0, WIDTH, view.height()))
        .set("font-family", FONT)
        .add(clip)
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", PAPER))
        .add(inside)
        .add(area(view).set("fill", "none").set("stroke", FRAME).set("stroke-width", 1.5))
        .add(axes(view))
        .add(scale_bar(view))
        .add(heading(caption))
        .add(legend(map, places, unplaced, view));
    Ok(document)
}

fn at(places: &[Place]) -> Vec<[f64; 2]> {
    places.iter().map(|p| p.at).collect()
}

/// Lower left and upper right corner of all that is shown, metres.
pub(super) fn bounds(map: &Map, places: &[[f64; 2]]) -> [[f64; 2]; 2] {
    let origin = map.origin();
    let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    let mut widen = |p: [f64; 2]| {
        for i in 0..2 {
            bounds[0][i] = bounds[0][i].min(p[i]);
            bounds[1][i] = bounds[1][i].max(p[i]);
        }
    };
    let mut along: [Vec<f64>; 2] = Default::default();
    for segment in map.segments() {
        for (i, values) in along.iter_mut().enumerate() {
            values.push(origin[i] + f64::from(segment.centroid[i]));
        }
    }
    let [xs, ys] = along.map(|mut values| {
        values.sort_by(f64::total_cmp);
        let stray = (STRAY_SHARE * values.len() as f64) as usize;
        [values[stray], values[values.len() - 1 - stray]]
    });
    widen([xs[0], ys[0]]);
    widen([xs[1], ys[1]]);
    map.path().iter().for_each(|p| widen([p[0], p[1]]));
    places.iter().for_each(|p| widen(*p));
    bounds
}

fn area(view: &View) -> Rectangle {
    let [x, y] = view.pixel([view.min[0], view.max[1]]);
    Rectangle::new()
        .set("x", x)
        .set("y", y)
        .set("width", view.area[0])
        .set("height", view.area[1])
        .set("fill", PAPER)
}

fn grid(view: &View) -> Group {
    let mut group = Group::new().set("stroke", GRID).set("stroke-width", 1);
    for (axis, x, y) in lines(view) {
        let (from, to) = match axis {
            0 => ([x, view.min[1]], [x, view.max[1]]),
            _ => ([view.min[0], y], [view.max[0], y]),
        };
        group = group.add(line(view.pixel(from), view.pixel(to)));
    }
    group
}

/// Every tick as (axis, x, y); the other coordinate is the lower border's.
fn lines(view: &View) -> Vec<(usize, f64, f64)> {
    let xs = view.ticks(0, 190.0).into_iter().map(|x| (0, x, view.min[1]));
    xs.chain(view.ticks(1, 150.0).into_iter().map(|y| (1, view.min[0], y))).collect()
}

fn axes(view: &View) -> Group {
    let mut group = Group::new().set("fill", FAINT_INK).set("font-size", TICK_PX);
    for (axis, x, y) in lines(view) {
        let [px, py] = view.pixel([x, y]);
        let label = |value: f64| format!("{value}").replace('-', "\u{2212}");
        group = match axis {
            0 => group.add(text(label(x), [px, py + 26.0]).set("text-anchor", "middle")),
            _ => group.add(text(label(y), [px - 12.0, py + 6.0]).set("text-anchor", "end")),
        };
    }
    let [left, bottom] = view.pixel(view.min);
    let (middle_x, middle_y) = (left + 0.5 * view.area[0], bottom - 0.5 * view.area[1]);
    let upright = format!("rotate(-90 26 {middle_y})");
    group.add(text("x in the map [m]", [middle_x, bottom + 52.0]).set("text-anchor", "middle")).add(
        text("y in the map [m]", [26.0, middle_y]).set("text-anchor", "middle").set("transform", upright),
    )
}

pub(super) fn scale_bar(view: &View) -> Group {
    let metres = round_length(0.16 * view.area[0] / view.scale);
    let length = metres * view.scale;
    let [left, bottom] = view.pixel(view.min);
    let (x, y) = (left + 28.0, bottom - 28.0);
    let plate = Rectangle::new()
        .set("x", x - 14.0)
        .set("y", y - 36.0)
        .set("width", length + 28.0)
        .set("height", 50.0)
        .set("rx", 5)
        .set("fill", PAPER)
        .set("fill-opacity", 0.88);
    let bar = Path::new()
        .set("d", format!("M{x} {}v12M{x} {y}h{length}M{} {}v12", y - 6.0, x + length, y - 6.0))
        .set("stroke", INK)
        .set("stroke-width", 3)
        .set("fill", "none");
    let label = text(format!("{metres} m"), [x + 0.5 * length, y - 13.0])
        .set("text-anchor", "middle")
        .set("font-size", TICK_PX)
        .set("fill", INK);
    Group::new().add(plate).add(bar).add(label)
}

pub(super) fn heading(caption: &Caption) -> Group {
    let title = text(&caption.title, [MARGIN[0], 52.0])
        .set("font-size", fitting(&caption.title, TITLE_PX))
        .set("font-weight", "bold")
        .set("fill", INK);
    let figures = text(&caption.figures, [MARGIN[0], 92.0])
        .set("font-size", fitting(&caption.figures, TEXT_PX))
        .set("fill", FAINT_INK);
    Group::new().add(title).add(figures)
}

/// The wanted size, or the largest at which the line fits.
pub(super) fn fitting(line: &str, wanted_px: f64) -> f64 {
    wanted_px.min((WIDTH - MARGIN[0] - MARGIN[2]) / text_width(line, 1.0))
}

/// At least as wide as the font draws it: DejaVu Sans is 0.6 em a character on average, its bold 0.68.
pub(super) fn text_width(line: &str, px: f64) -> f64 {
    0.66 * px * line.chars().count() as f64
}

pub(super) fn mapped_path(map: &Map, view: &View) -> Path {
    let mut data = String::new();
    let mut previous: Option<[f64; 3]> = None;
    for p in map.path() {
        let gap = previous.map(|a| (0..3).map(|i| (a[i] - p[i]).powi(2)).sum::<f64>().sqrt());
        let joined = gap.is_some_and(|gap| gap <= PATH_GAP_M);
        let [x, y] = view.pixel([p[0], p[1]]);
        data.push_str(&format!("{}{x:.1} {y:.1}", if joined { 'L' } else { 'M' }));
        previous = Some(*p);
    }
    Path::new()
        .set("d", data)
        .set("fill", "none")
        .set("stroke", MAPPED_PATH)
        .set("stroke-width", MAPPED_PATH_PX)
        .set("stroke-linecap", "round")
        .set("stroke-linejoin", "round")
}

/// Thin lines from some of the located clouds to the map segments that place them.
fn matches(places: &[Place], view: &View) -> Group {
    let mut lines = Data::new();
    let mut dots = Group::new().set("fill", MATCH);
    let least_px = MATCHES_APART.0.max(MATCHES_APART.1 * view.scale);
    let mut last: Option<[f64; 2]> = None;
    for place in places.iter().filter(|p| !p.matched.is_empty()) {
        let from = view.pixel(place.at);
        if last.is_some_and(|l| apart(l, from) < least_px) {
            continue;
        }
        last = Some(from);
        for matched in &place.matched {
            let to = view.pixel(*matched);
            lines = lines.move_to((from[0], from[1])).line_to((to[0], to[1]));
            dots = dots.add(circle(to, 2.6));
        }
    }
    let lines =
        Path::new().set("d", lines).set("stroke", MATCH).set("stroke-width", 1.1).set("stroke-opacity", 0.6);
    Group::new().add(lines).add(dots)
}

fn drive(places: &[Place], view: &View) -> Group {
    let mut driven = Data::new();
    for place in places {
        let [x, y] = view.pixel(place.at);
        driven = if place.starts { driven.move_to((x, y)) } else { driven.line_to((x, y)) };
    }
    let mut group = Group::new()
        .add(Path::new().set("d", driven).set("fill", "none").set("stroke", DRIVE).set("stroke-width", 1.4));
    // The rarer and the graver on top.
    for found in [Found::Located, Found::NotLocated, Found::Ambiguous, Found::False] {
        let mut last: Option<[f64; 2]> = None;
        for place in places.iter().filter(|p| p.found == found) {
            let at = view.pixel(place.at);
            if found != Found::False && last.is_some_and(|l| apart(l, at) < MARKERS_APART_PX) {
                continue;
            }
            last = Some(at);
            if let Some(claimed) = place.claimed {
                let to = view.pixel(claimed);
                group = group.add(line(at, to).set("stroke", FALSE).set("stroke-width", 2.2));
            }
            group = group.add(marker(found, at));
        }
    }
    group
}

/// Every state has its own shape.
fn marker(found: Found, [x, y]: [f64; 2]) -> Group {
    let group = Group::new();
    match found {
        Found::Located => {
            group.add(circle([x, y], 5.2).set("fill", LOCATED).set("stroke", PAPER).set("stroke-width", 1.2))
        }
        Found::NotLocated => group
            .add(circle([x, y], 4.6).set("fill", PAPER).set("stroke", NOT_LOCATED).set("stroke-width", 2.4)),
        Found::Ambiguous => {
            let d = format!("M{x} {}l6.5 6.5l-6.5 6.5l-6.5-6.5z", y - 6.5);
            group.add(
                Path::new().set("d", d).set("fill", AMBIGUOUS).set("stroke", PAPER).set("stroke-width", 1.2),
            )
        }
        Found::False => {
            let d = format!("M{} {}l14 14m0-14l-14 14", x - 7.0, y - 7.0);
            let cross = |colour: &str, width: f64| {
                Path::new().set("d", d.clone()).set("stroke", colour.to_owned()).set("stroke-width", width)
            };
            group.add(cross(PAPER, 7.0)).add(cross(FALSE, 4.0))
        }
    }
}

/// What the legend shows beside a label.
enum Key {
    Marker(Found),
    MappedPath,
    Matches,
    Structure,
}

fn legend(map: &Map, places: &[Place], unplaced: usize, view: &View) -> Group {
    let count = |found: Found| places.iter().filter(|p| p.found == found).count();
    let mut items = vec![(Key::Structure, "map from above".to_owned())];
    if !map.path().is_empty() {
        items.push((Key::MappedPath, "mapped path".to_owned()));
    }
    let states = [
        (Found::Located, "located"),
        (Found::Ambiguous, "ambiguous"),
        (Found::NotLocated, "not located"),
        (Found::False, "false"),
    ];
    for (found, word) in states {
        let n = count(found);
        if n > 0 || found == Found::Located {
            items.push((Key::Marker(found), format!("{word} ({n})")));
        }
    }
    if places.iter().any(|p| !p.matched.is_empty()) {
        items.push((Key::Matches, "matched segments (of some clouds)".to_owned()));
    }
    let top = MARGIN[1] + view.area[1] + 88.0;
    let (mut x, mut y) = (MARGIN[0], top);
    let mut group = Group::new().set("font-size", TEXT_PX).set("fill", INK);
    for (key, label) in items {
        let width = 52.0 + text_width(&label, TEXT_PX);
        if x + width > WIDTH - MARGIN[2] && x > MARGIN[0] {
            (x, y) = (MARGIN[0], y + 34.0);
        }
        group = group.add(symbol(&key, [x, y - 7.0])).add(text(label, [x + 44.0, y]));
        x += width;
    }
    if unplaced > 0 {
        let note = format!("{unplaced} clouds have no known place and are not drawn");
        group =
            group.add(text(note, [WIDTH - MARGIN[2], 92.0]).set("text-anchor", "end").set("fill", FAINT_INK));
    }
    group
}

fn symbol(key: &Key, [x, y]: [f64; 2]) -> Group {
    let group = Group::new();
    match key {
        Key::Marker(found) => group.add(marker(*found, [x + 18.0, y])),
        Key::MappedPath => group.add(
            line([x + 4.0, y], [x + 32.0, y])
                .set("stroke", MAPPED_PATH)
                .set("stroke-width", MAPPED_PATH_PX)
                .set("stroke-linecap", "round"),
        ),
        Key::Matches => group
            .add(line([x + 3.0, y + 5.0], [x + 32.0, y - 5.0]).set("stroke", MATCH).set("stroke-width", 1.6))
            .add(circle([x + 32.0, y - 5.0], 3.4).set("fill", MATCH)),
        Key::Structure => STRUCTURE.into_iter().enumerate().fold(group, |group, (i, colour)| {
            let square = Rectangle::new().set("width", 10).set("height", 16).set("fill", colour);
            group.add(square.set("x", x + 3.0 + 10.0 * i as f64).set("y", y - 8.0))
        }),
    }
}

fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

pub(super) fn line(from: [f64; 2], to: [f64; 2]) -> Line {
    Line::new().set("x1", from[0]).set("y1", from[1]).set("x2", to[0]).set("y2", to[1])
}

pub(super) fn circle([x, y]: [f64; 2], radius: f64) -> Circle {
    Circle::new().set("cx", x).set("cy", y).set("r", radius)
}

pub(super) fn text(content: impl Into<String>, [x, y]: [f64; 2]) -> Text {
    Text::new(content).set("x", x).set("y", y)
}

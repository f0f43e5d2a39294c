//! The paper's figure 3: how well descriptors tell objects apart, against random and against hard negatives.

use esm_eval::{Curve, Roc};
use svg::Document;
use svg::node::element::path::Data;
use svg::node::element::{Group, Path, Rectangle};

use super::Caption;
use super::draw::{heading, line, text};
use super::style::*;

/// Edge of a panel, and where the left edges are, pixels.
const EDGE: f64 = 640.0;
const LEFT: [f64; 2] = [MARGIN[0], MARGIN[0] + EDGE + 116.0];
/// Height of a line of the legend, pixels.
const ROW: f64 = 32.0;
/// Okabe and Ito's colours; more methods than these come with them anew.
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#1b1f24"];

/// How a curve is drawn, and what for.
struct Drawn<'a> {
    curve: &'a Curve,
    colour: &'static str,
    dashes: &'static str,
    label: String,
}

/// Both panels; the curves are by name of the method.
pub(super) fn svg(curves: &[(&str, &Roc)], caption: &Caption) -> Document {
    let panels = [
        ("against random negatives", panel(curves, |r| [&r.random, &r.random_best, &r.random_judged])),
        (
            "against hard negatives (alike in size)",
            panel(curves, |r| [&r.hard, &r.hard_best, &r.hard_judged]),
        ),
    ];
    let rows = panels.iter().map(|(_, drawn)| drawn.len()).max().unwrap_or(0);
    let bottom = MARGIN[1] + 30.0 + EDGE;
    let height = bottom + 90.0 + ROW * rows as f64 + 20.0;
    let mut document = Document::new()
        .set("width", WIDTH)
        .set("height", height)
        .set("viewBox", (0, 0, WIDTH, height))
        .set("font-family", FONT)
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", PAPER))
        .add(heading(caption));
    for ((title, drawn), left) in panels.iter().zip(LEFT) {
        document = document.add(axes(title, left, bottom));
        for (i, d) in drawn.iter().enumerate() {
            let y = bottom + 96.0 + ROW * i as f64;
            let mark = line([left, y - 7.0], [left + 48.0, y - 7.0]);
            document = document
                .add(stroke(d, left, bottom))
                .add(mark.set("stroke", d.colour).set("stroke-width", 4).set("stroke-dasharray", d.dashes))
                .add(text(&d.label, [left + 62.0, y]).set("font-size", TEXT_PX).set("fill", INK));
        }
    }
    document
}

/// The curves of one panel: by distance, without the worst third by quality, and judged.
fn panel<'a>(curves: &[(&str, &'a Roc)], of: impl Fn(&'a Roc) -> [&'a Option<Curve>; 3]) -> Vec<Drawn<'a>> {
    let kinds = [("none", ""), ("10 6", ", best two thirds by quality"), ("3 5", ", judged by its forest")];
    let all = curves.iter().zip(COLOURS.iter().cycle()).flat_map(|((name, roc), colour)| {
        of(roc).into_iter().zip(kinds).filter_map(move |(curve, (dashes, words))| {
            let curve = curve.as_ref()?;
            Some(Drawn { curve, colour, dashes, label: format!("{name}{words}: {:.3}", curve.auc) })
        })
    });
    all.collect()
}

fn stroke(drawn: &Drawn<'_>, left: f64, bottom: f64) -> Path {
    let mut data = Data::new();
    for (i, [x, y]) in drawn.curve.points().enumerate() {
        let at = (left + EDGE * x, bottom - EDGE * y);
        data = if i == 0 { data.move_to(at) } else { data.line_to(at) };
    }
    Path::new()
        .set("d", data)
        .set("fill", "none")
        .set("stroke", drawn.colour)
        .set("stroke-width", 3)
        .set("stroke-dasharray", drawn.dashes)
}

fn axes(title: &str, left: f64, bottom: f64) -> Group {
    let top = bottom - EDGE;
    let frame = Rectangle::new()
        .set("x", left)
        .set("y", top)
        .set("width", EDGE)
        .set("height", EDGE)
        .set("fill", "none")
        .set("stroke", FRAME)
        .set("stroke-width", 1.5);
    let mut group = Group::new().set("fill", FAINT_INK).set("font-size", TICK_PX);
    for i in 0..=5 {
        let share = f64::from(i) / 5.0;
        let (x, y) = (left + EDGE * share, bottom - EDGE * share);
        let grid = |from, to| line(from, to).set("stroke", GRID).set("stroke-width", 1);
        group = group.add(grid([x, top], [x, bottom])).add(grid([left, y], [left + EDGE, y]));
        group = group.add(text(format!("{share:.1}"), [x, bottom + 26.0]).set("text-anchor", "middle"));
        group = group.add(text(format!("{share:.1}"), [left - 12.0, y + 6.0]).set("text-anchor", "end"));
    }
    let (middle, upright) = (bottom - 0.5 * EDGE, left - 62.0);
    let chance = line([left, bottom], [left + EDGE, top]).set("stroke", FRAME).set("stroke-dasharray", "2 6");
    group
        .add(chance)
        .add(frame)
        .add(text(title, [left + 0.5 * EDGE, top - 14.0]).set("text-anchor", "middle").set("fill", INK))
        .add(text("false positive rate", [left + 0.5 * EDGE, bottom + 54.0]).set("text-anchor", "middle"))
        .add(
            text("true positive rate", [upright, middle])
                .set("text-anchor", "middle")
                .set("transform", format!("rotate(-90 {upright} {middle})")),
        )
}

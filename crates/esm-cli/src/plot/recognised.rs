//! The paper's figures 1, 4 and 5: the map seen at a slant, the second visit floating above it, and from every cloud that was
//! recognised a line down to its place, coloured by time.

use esm_core::map::Map;
use esm_eval::Cloud;
use svg::Document;
use svg::node::element::path::Data;
use svg::node::element::{Definitions, Group, LinearGradient, Path, Rectangle, Stop};

use super::draw::{bounds, circle, fitting, heading, line, mapped_path, text, text_width};
use super::style::*;
use super::view::View;
use super::{Caption, backdrop};

/// The map's y axis is shortened to this share, as seen from a third of a right angle above the ground.
const SLANT: f64 = 0.5;
/// How high the second visit floats, pixels.
const LIFT_PX: f64 = 240.0;
/// Lines of places that are recognised rightly stand at least this far apart, pixels: more would be one smear.
const LINES_APART_PX: f64 = 4.0;
/// Clouds farther apart are not joined, metres.
const PATH_GAP_M: f64 = 60.0;
/// Colours from the first cloud to the last: viridis, which grows lighter all the way for every kind of colour vision.
const TIME: [[u8; 3]; 6] =
    [[68, 1, 84], [65, 68, 135], [42, 120, 142], [34, 168, 132], [122, 209, 81], [216, 200, 30]];

/// The whole picture. Clouds outside the truth are not drawn.
pub(super) fn svg(map: &Map, clouds: &[Cloud], caption: &Caption) -> anyhow::Result<Document> {
    let at: Vec<[f64; 2]> = clouds.iter().filter_map(|c| c.at).map(|[x, y, _]| [x, y]).collect();
    let [low, high] = bounds(map, &at);
    let view = View::of(low, high);
    let slanted = Slanted { view: &view, top: MARGIN[1] + LIFT_PX };
    let height = slanted.top + SLANT * view.area[1] + MARGIN[3];
    let ground = Group::new()
        .set("transform", format!("translate(0 {:.3}) scale(1 {SLANT})", slanted.top - SLANT * MARGIN[1]))
        .add(backdrop::draw(map, &view)?)
        .add(mapped_path(map, &view));
    let (clip, inside) = clipped(&view, &slanted, ground);
    Ok(Document::new()
        .set("width", WIDTH)
        .set("height", height)
        .set("viewBox", (0, 0, WIDTH, height))
        .set("font-family", FONT)
        .add(clip)
        .add(Rectangle::new().set("width", "100%").set("height", "100%").set("fill", PAPER))
        .add(inside)
        .add(visit(clouds, &slanted))
        .add(heading(caption))
        .add(legend(clouds, height - 44.0)))
}

/// From metres on the ground to pixels.
struct Slanted<'a> {
    view: &'a View,
    /// Where the farthest ground is, pixels.
    top: f64,
}

impl Slanted<'_> {
    fn ground(&self, [x, y, _]: [f64; 3]) -> [f64; 2] {
        let [px, py] = self.view.pixel([x, y]);
        [px, self.top + SLANT * (py - MARGIN[1])]
    }

    fn above(&self, at: [f64; 3]) -> [f64; 2] {
        let [x, y] = self.ground(at);
        [x, y - LIFT_PX]
    }
}

/// The ground without what lies outside of the view.
fn clipped(view: &View, slanted: &Slanted<'_>, ground: Group) -> (Definitions, Group) {
    let area = Rectangle::new()
        .set("x", MARGIN[0])
        .set("y", slanted.top)
        .set("width", view.area[0])
        .set("height", SLANT * view.area[1]);
    let clip = svg::node::element::ClipPath::new().set("id", "ground").add(area);
    let inside = Group::new().set("clip-path", "url(#ground)").add(ground);
    (Definitions::new().add(clip).add(gradient()), inside)
}

fn visit(clouds: &[Cloud], slanted: &Slanted<'_>) -> Group {
    let span = |c: &Cloud| {
        let (first, last) = (clouds[0].stamp, clouds[clouds.len() - 1].stamp);
        (c.stamp - first) / (last - first).max(1e-9)
    };
    let mut driven = Data::new();
    let mut last: Option<[f64; 3]> = None;
    for at in clouds.iter().filter_map(|c| c.at) {
        let [x, y] = slanted.above(at);
        let joined = last.is_some_and(|l| (l[0] - at[0]).hypot(l[1] - at[1]) <= PATH_GAP_M);
        driven = if joined { driven.line_to((x, y)) } else { driven.move_to((x, y)) };
        last = Some(at);
    }
    let path = Path::new().set("d", driven).set("fill", "none").set("stroke", DRIVE).set("stroke-width", 1.6);
    let (mut lines, mut marks) = (Group::new().set("stroke-width", 1.6), Group::new());
    let mut wrong = Group::new().set("stroke", FALSE).set("stroke-width", 2.4);
    let mut drawn: Option<[f64; 2]> = None;
    for cloud in clouds {
        let Some(at) = cloud.at else { continue };
        let from = slanted.above(at);
        match (cloud.correct, cloud.claimed) {
            (Some(true), Some(claimed)) => {
                if drawn.is_some_and(|d| (d[0] - from[0]).hypot(d[1] - from[1]) < LINES_APART_PX) {
                    continue;
                }
                drawn = Some(from);
                let (to, colour) = (slanted.ground(claimed), colour(span(cloud)));
                lines = lines.add(line(from, to).set("stroke", colour.clone()));
                marks = marks.add(circle(from, 3.4).set("fill", colour.clone()));
                marks = marks.add(circle(to, 2.6).set("fill", colour));
            }
            (Some(false), Some(claimed)) => {
                wrong = wrong.add(line(from, slanted.ground(claimed)));
                wrong = wrong.add(circle(from, 4.4).set("fill", FALSE));
            }
            _ => {
                let missed = circle(from, 3.2).set("fill", PAPER).set("stroke", NOT_LOCATED);
                marks = marks.add(missed.set("stroke-width", 1.6));
            }
        }
    }
    Group::new().add(lines).add(path).add(marks).add(wrong)
}

fn colour(share: f64) -> String {
    // What is no number is the first.
    let share = if share > 0.0 { share.min(1.0) } else { 0.0 };
    let at = share * (TIME.len() - 1) as f64;
    let i = (at as usize).min(TIME.len() - 2);
    let mix = |c: usize| {
        let (a, b) = (f64::from(TIME[i][c]), f64::from(TIME[i + 1][c]));
        (a + (at - i as f64) * (b - a)).round() as u8
    };
    format!("#{:02x}{:02x}{:02x}", mix(0), mix(1), mix(2))
}

fn gradient() -> LinearGradient {
    (0..TIME.len()).fold(LinearGradient::new().set("id", "time"), |gradient, i| {
        let share = i as f64 / (TIME.len() - 1) as f64;
        gradient.add(Stop::new().set("offset", share).set("stop-color", colour(share)))
    })
}

/// The bar of time, and what the marks are.
fn legend(clouds: &[Cloud], y: f64) -> Group {
    let seconds = match (clouds.first(), clouds.last()) {
        (Some(first), Some(last)) => last.stamp - first.stamp,
        _ => 0.0,
    };
    let took = if seconds < 180.0 { format!("{seconds:.0} s") } else { format!("{:.0} min", seconds / 60.0) };
    let count = |correct| clouds.iter().filter(|c| c.at.is_some() && c.correct == correct).count();
    let bar = Rectangle::new().set("width", 200).set("height", 16).set("y", y - 14.0);
    let mut group = Group::new().set("font-size", TEXT_PX).set("fill", INK);
    let mut x = MARGIN[0];
    let recognised = format!("recognised ({}): from the first cloud", count(Some(true)));
    group = group.add(text(&recognised, [x, y]).set("font-size", fitting(&recognised, TEXT_PX)));
    x += text_width(&recognised, TEXT_PX) * 0.92;
    group = group
        .add(bar.set("x", x).set("fill", "url(#time)"))
        .add(text(format!("to {took} later"), [x + 212.0, y]));
    x += 212.0 + text_width("to 000 min later", TEXT_PX);
    let missed = count(None);
    if missed > 0 {
        let ring = circle([x, y - 6.0], 4.4).set("fill", PAPER).set("stroke", NOT_LOCATED);
        group = group.add(ring.set("stroke-width", 2));
        group = group.add(text(format!("not located ({missed})"), [x + 16.0, y]));
        x += 24.0 + text_width("not located (0000)", TEXT_PX);
    }
    let wrong = count(Some(false));
    if wrong > 0 {
        group = group.add(circle([x, y - 6.0], 5.0).set("fill", FALSE));
        group = group.add(text(format!("false ({wrong})"), [x + 16.0, y]));
    }
    group
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_run_from_the_first_to_the_last() {
        assert_eq!((colour(0.0).as_str(), colour(1.0).as_str()), ("#440154", "#d8c81e"));
        assert_eq!(colour(0.2), "#414487");
        assert_eq!(colour(f64::NAN), colour(0.0));
    }
}

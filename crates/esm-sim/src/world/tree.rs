//! Trees: tapered, bent trunks with root flares, branches that bend to the light, foliage at their ends.

use nalgebra::Vector3;

use super::visit::Season;
use crate::cast::Shape;
use crate::hash::Draw;

type V = Vector3<f32>;

/// A species' habit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Species {
    Oak,
    Beech,
    Birch,
    Pine,
    Spruce,
    /// A clone of plantations: straight, narrow, pruned.
    Poplar,
}

/// Numbers of a habit; heights are shares of the tree's height, angles in radians.
struct Habit {
    /// Height over diameter at breast height.
    slenderness: f32,
    /// Where the crown begins.
    crown_base: f32,
    /// Reach of the longest branches.
    reach: f32,
    /// Branches above the horizon.
    rise: f32,
    branches: (usize, usize),
    /// Deviation of the trunk's axis.
    lean: f32,
    bend: f32,
    /// Hits a metre in full leaf.
    density: f32,
    evergreen: bool,
}

impl Species {
    fn habit(self) -> Habit {
        let h = |slenderness, crown_base, reach, rise, branches, lean, bend, density, evergreen| Habit {
            slenderness,
            crown_base,
            reach,
            rise,
            branches,
            lean,
            bend,
            density,
            evergreen,
        };
        match self {
            Self::Oak => h(42.0, 0.22, 0.34, 0.45, (9, 16), 0.06, 0.035, 1.0, false),
            Self::Beech => h(60.0, 0.35, 0.24, 0.75, (10, 16), 0.03, 0.012, 1.1, false),
            Self::Birch => h(85.0, 0.4, 0.16, 0.9, (9, 14), 0.07, 0.03, 0.7, false),
            Self::Pine => h(65.0, 0.58, 0.17, 0.3, (9, 15), 0.04, 0.015, 1.1, true),
            Self::Spruce => h(75.0, 0.12, 0.17, -0.15, (20, 32), 0.015, 0.006, 1.6, true),
            Self::Poplar => h(68.0, 0.24, 0.15, 0.95, (12, 18), 0.008, 0.003, 1.0, false),
        }
    }

    /// Its height in metres for a diameter at breast height in metres.
    pub(super) fn height(self, dbh: f32) -> f32 {
        // Slenderness falls with thickness.
        (self.habit().slenderness * dbh * (0.25 / dbh).powf(0.45)).clamp(2.0, 32.0)
    }
}

/// How much room a tree has had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Room {
    /// It stands alone: green far down.
    Open,
    /// Others stand about: what was in their shade has died, and of conifers still sticks out.
    Stand,
}

/// A tree about its foot. `structure` draws what stays, `now` what is of this visit: wind in the crown.
pub(super) fn tree(
    species: Species,
    dbh: f32,
    height: f32,
    room: Room,
    season: Season,
    structure: &mut Draw,
    now: &mut Draw,
) -> Vec<Shape> {
    let mut habit = species.habit();
    if room == Room::Stand {
        habit.crown_base += 0.25 * (0.9 - habit.crown_base) * structure.range(0.5, 1.5);
        habit.density *= 0.55;
        habit.branches = (habit.branches.0 * 4 / 5, habit.branches.1 * 4 / 5);
    }
    let mut shapes = Vec::new();
    let lean_to = structure.range(0.0, std::f32::consts::TAU);
    let lean = habit.lean * structure.normal().abs().min(2.5);
    let bend_to = structure.range(0.0, std::f32::consts::TAU);
    let bend = habit.bend * height * structure.range(0.4, 1.6);
    let waves = structure.range(0.6, 1.7);
    // The axis of the trunk at a share of the height.
    let axis = |t: f32| {
        let sway = bend * (waves * std::f32::consts::PI * t).sin();
        V::new(
            lean * height * t * lean_to.cos() + sway * bend_to.cos(),
            lean * height * t * lean_to.sin() + sway * bend_to.sin(),
            height * t,
        )
    };
    let radius = |t: f32| 0.5 * dbh * (1.0 - t).powf(0.75).max(0.04) * (1.0 + 0.06 * (1.3 / height));
    // Root flare, then the stem in pieces that get longer upwards.
    shapes.push(Shape::frustum(V::new(0.0, 0.0, -0.5), V::new(0.0, 0.0, 0.06), 0.75 * dbh, 0.68 * dbh));
    let steps: &[f32] = &[0.0, 0.03, 0.1, 0.2, 0.32, 0.46, 0.62, 0.8, 1.0];
    for w in steps.windows(2) {
        let flare = if w[0] == 0.0 { 1.3 } else { 1.0 };
        shapes.push(Shape::frustum(axis(w[0]), axis(w[1]), flare * radius(w[0]), radius(w[1])));
    }
    // Short dead stubs below the crown.
    let conifer = habit.evergreen && room == Room::Stand;
    for _ in 0..if conifer { structure.count(2, 6) } else { structure.count(0, 4) } {
        let t = structure.range(0.08, habit.crown_base.max(0.1));
        let turn = structure.range(0.0, std::f32::consts::TAU);
        let length = structure.range(0.15, if conifer { 1.5 } else { 0.8 });
        let end = axis(t) + V::new(turn.cos(), turn.sin(), structure.range(-0.2, 0.6)) * length;
        shapes.push(Shape::frustum(axis(t), end, 0.12 * radius(t) + 0.008, 0.006));
    }
    let leaf = if habit.evergreen { 1.0 } else { season.broadleaf() } * habit.density;
    let wind = V::new(now.normal(), now.normal(), 0.0) * 0.05;
    let branches = structure.count(habit.branches.0, habit.branches.1);
    let spiral = structure.range(0.0, std::f32::consts::TAU);
    for n in 0..branches {
        let u = (n as f32 + structure.range(0.1, 0.9)) / branches as f32;
        let t = habit.crown_base + (0.97 - habit.crown_base) * u;
        // Spruces taper to the top; the others are widest in the middle of the crown.
        let profile = match species {
            Species::Spruce => 1.02 - u,
            _ => (0.55 + 1.8 * u * (1.0 - u)).min(1.0) * if u > 0.85 { 0.6 } else { 1.0 },
        };
        let length = habit.reach * height * profile * structure.range(0.6, 1.15);
        let turn = spiral + 2.4 * n as f32 + structure.range(-0.6, 0.6);
        let rise = habit.rise + structure.range(-0.25, 0.25) + 0.5 * u * habit.rise.max(0.0);
        let out = V::new(turn.cos() * rise.cos(), turn.sin() * rise.cos(), rise.sin());
        let from = axis(t);
        let elbow = from + out * (0.55 * length);
        let curl = if species == Species::Spruce { -0.12 } else { 0.22 };
        let side = V::new(-turn.sin(), turn.cos(), 0.0) * structure.range(-0.25, 0.25);
        let tip = elbow + (out + V::new(0.0, 0.0, curl) + side) * (0.45 * length);
        let thick = (0.45 * radius(t)).min(0.022 * length + 0.01).max(0.008);
        shapes.push(Shape::frustum(from, elbow, thick, 0.6 * thick));
        shapes.push(Shape::frustum(elbow, tip, 0.6 * thick, 0.008));
        // Twigs along the outer part of the branch, each in its own foliage, long rather than round: branches stay visible
        // as the crown's structure and no ball shows.
        let spruce = species == Species::Spruce;
        let twigs = structure.count(if spruce { 3 } else { 2 }, 3 + (length * 0.9).min(3.0) as usize);
        for k in 0..twigs {
            let u_twig = structure.range(0.3, 1.1);
            let start = if u_twig < 0.55 {
                from + (elbow - from) * (u_twig / 0.55)
            } else {
                elbow + (tip - elbow) * ((u_twig - 0.55) / 0.45).min(1.0)
            };
            let spread = V::new(
                structure.normal(),
                structure.normal(),
                structure.normal() * if spruce { 0.25 } else { 0.8 },
            );
            let reach = length * structure.range(0.16, 0.34) + 0.15;
            let twig = (out + spread * 0.8 + V::z() * if spruce { -0.1 } else { 0.25 }).normalize() * reach;
            if k == 0 {
                shapes.push(Shape::frustum(start, start + twig, 0.35 * thick, 0.005));
            }
            let middle = start + twig * 0.6 + wind * (0.5 + u);
            let across = reach * structure.range(0.28, 0.5) * if spruce { 0.7 } else { 1.0 } + 0.06;
            shapes.push(Shape::clump(
                middle,
                twig,
                0.65 * reach + 0.1,
                across,
                leaf * structure.range(0.5, 1.6),
            ));
        }
    }
    shapes
}

/// A tree of streets and yards, pruned: grown, but lower than in woods.
pub(super) fn street_tree(season: Season, structure: &mut Draw, now: &mut Draw) -> Vec<Shape> {
    let species =
        [Species::Oak, Species::Beech, Species::Beech, Species::Birch, Species::Pine][structure.index(5)];
    let dbh = structure.range(0.12, 0.42);
    let height = (species.height(dbh) * structure.range(0.6, 0.9)).min(14.0);
    tree(species, dbh, height, Room::Open, season, structure, now)
}

/// A fruit tree, a young birch, a spruce that was once a Christmas tree.
pub(super) fn garden_tree(season: Season, structure: &mut Draw, now: &mut Draw) -> Vec<Shape> {
    let species =
        [Species::Oak, Species::Oak, Species::Beech, Species::Birch, Species::Spruce][structure.index(5)];
    let dbh = structure.range(0.06, 0.2);
    let height = (species.height(dbh) * structure.range(0.45, 0.85)).clamp(1.8, 8.0);
    tree(species, dbh, height, Room::Open, season, structure, now)
}

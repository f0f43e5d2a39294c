//! The map's points from above, as a drawing of the pixels they fall into.

use esm_core::map::Map;
use svg::node::element::{Group, Path};

use super::style::{GROUND, STRUCTURE};
use super::view::View;

/// Edge of a drawn cell: at least this many pixels, and this many metres. Maps are thinned to voxels of 0.2 m; smaller
/// cells would show the gaps between.
const CELL: (f64, f64) = (1.25, 0.28);
/// The same for the ground, which is thinned more.
const GROUND_CELL: (f64, f64) = (1.25, 0.9);
/// Shares of the cells with points above which the second and the third shade of [`STRUCTURE`] are used.
const DARKER: [f64; 2] = [0.5, 0.85];

/// Draws ground and structures.
pub(crate) fn draw(map: &Map, view: &View) -> anyhow::Result<Group> {
    let mut ground = Cells::new(view, GROUND_CELL);
    let mut structure = Cells::new(view, CELL);
    let mut points = Vec::new();
    for tile in 0..map.ground_tiles().len() {
        map.ground_tile_points_into(tile, &mut points)?;
        ground.count(map, &points);
    }
    for segment in 0..map.len() {
        map.segment_points_into(segment, &mut points)?;
        structure.count(map, &points);
    }
    let mut group = Group::new().set("shape-rendering", "crispEdges");
    group = group.add(ground.shade(GROUND, |n| n > 0));
    let [middle, dark] = DARKER.map(|share| structure.quantile(share));
    let shades = [1..=middle, middle + 1..=dark.max(middle), dark.max(middle) + 1..=u32::MAX];
    for (colour, counts) in STRUCTURE.into_iter().zip(shades) {
        group = group.add(structure.shade(colour, |n| counts.contains(&n)));
    }
    Ok(group)
}

struct Cells<'a> {
    view: &'a View,
    /// Edge, pixels.
    edge: f64,
    columns: usize,
    counts: Vec<u32>,
}

impl<'a> Cells<'a> {
    fn new(view: &'a View, (least_px, least_m): (f64, f64)) -> Self {
        let edge = least_px.max(least_m * view.scale);
        let [columns, rows] = view.area.map(|px| (px / edge).ceil() as usize);
        Self { view, edge, columns, counts: vec![0; columns * rows] }
    }

    /// Counts points given relative to the map's origin.
    fn count(&mut self, map: &Map, points: &[[f32; 3]]) {
        let (origin, view) = (map.origin(), self.view);
        let cells_a_metre = view.scale / self.edge;
        for p in points {
            let column = (origin[0] + f64::from(p[0]) - view.min[0]) * cells_a_metre;
            let row = (view.max[1] - origin[1] - f64::from(p[1])) * cells_a_metre;
            if column >= 0.0
                && row >= 0.0
                && (column as usize) < self.columns
                && let Some(n) = self.counts.get_mut(row as usize * self.columns + column as usize)
            {
                *n += 1;
            }
        }
    }

    /// The count that a share of the cells with points does not exceed.
    fn quantile(&self, share: f64) -> u32 {
        let mut filled: Vec<u32> = self.counts.iter().copied().filter(|n| *n > 0).collect();
        filled.sort_unstable();
        filled.get((share * filled.len() as f64) as usize).copied().unwrap_or(1)
    }

    /// One path of the runs of cells that are chosen.
    fn shade(&self, colour: &str, chosen: impl Fn(u32) -> bool) -> Path {
        let [left, top] = self.view.pixel([self.view.min[0], self.view.max[1]]);
        let edge = self.edge;
        let mut data = String::new();
        for (row, counts) in self.counts.chunks(self.columns).enumerate() {
            let mut column = 0;
            while column < counts.len() {
                let run = counts[column..].iter().take_while(|n| chosen(**n)).count();
                if run > 0 {
                    let (x, y) = (left + column as f64 * edge, top + row as f64 * edge);
                    let width = run as f64 * edge;
                    data.push_str(&format!("M{x:.2} {y:.2}h{width:.2}v{edge:.2}h-{width:.2}z"));
                }
                column += run.max(1);
            }
        }
        Path::new().set("d", data).set("fill", colour)
    }
}

//! [`Places`]: where a map can be expected to localize.

use std::collections::{HashMap, HashSet};

use super::LOCALIZABLE_M;

/// Positions of the mapped path up to this far apart are joined by a straight line, metres; farther apart the
/// recording was interrupted.
const JOINED_M: f64 = 20.0;
/// Between joined positions the path is sampled this closely, metres.
const SAMPLE_M: f64 = 5.0;

/// Positions by the cell of [`LOCALIZABLE_M`] edge they lie in.
type PathCells = HashMap<[i64; 2], Vec<[f64; 3]>>;

/// The places a map covers.
#[derive(Clone, Debug)]
pub enum Places {
    /// Positions of the mapped path, by the cell they lie in.
    Path(PathCells),
    /// The cells of this edge in metres that hold points of a prior cloud.
    Cells(f64, HashSet<[i32; 2]>),
}

impl Places {
    /// Around the path a map was recorded along, positions in the map frame.
    pub fn along(path: &[[f64; 3]]) -> Self {
        let mut cells: PathCells = HashMap::new();
        let mut previous: Option<[f64; 3]> = None;
        for &p in path {
            if let Some(a) = previous {
                let gap = distance(&a, &p);
                let parts = if gap <= JOINED_M { (gap / SAMPLE_M).ceil() as usize } else { 1 };
                for part in 1..parts {
                    let share = part as f64 / parts as f64;
                    let between = [0, 1, 2].map(|i| a[i] + share * (p[i] - a[i]));
                    cells.entry(cell(&between, LOCALIZABLE_M)).or_default().push(between);
                }
            }
            cells.entry(cell(&p, LOCALIZABLE_M)).or_default().push(p);
            previous = Some(p);
        }
        Self::Path(cells)
    }

    /// One more position of the mapped path; cells of a prior cloud stay as they are.
    pub fn add(&mut self, position: [f64; 3]) {
        if let Self::Path(cells) = self {
            cells.entry(cell(&position, LOCALIZABLE_M)).or_default().push(position);
        }
    }

    /// In the cells `(floor(x / edge), floor(y / edge))` of the map frame.
    pub fn in_cells(edge_m: f64, cells: &[[i32; 2]]) -> Self {
        Self::Cells(edge_m, cells.iter().copied().collect())
    }

    /// Whether a true position in the map frame is localizable.
    pub fn holds(&self, position: &[f64; 3]) -> bool {
        match self {
            Self::Path(cells) => {
                let [x, y] = cell(position, LOCALIZABLE_M);
                (x - 1..=x + 1).flat_map(|x| (y - 1..=y + 1).map(move |y| [x, y])).any(|c| {
                    let near = |p: &[f64; 3]| distance(p, position) <= LOCALIZABLE_M;
                    cells.get(&c).is_some_and(|path| path.iter().any(near))
                })
            }
            Self::Cells(edge, cells) => {
                let [x, y] = cell(position, *edge);
                match (i32::try_from(x), i32::try_from(y)) {
                    (Ok(x), Ok(y)) => cells.contains(&[x, y]),
                    _ => false,
                }
            }
        }
    }
}

fn cell(p: &[f64; 3], edge: f64) -> [i64; 2] {
    [(p[0] / edge).floor() as i64, (p[1] / edge).floor() as i64]
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    #[test]
    fn ten_metres_from_a_path_in_three_dimensions() {
        let places = Places::along(&[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
        assert!(places.holds(&[-10.0, 0.0, 0.0]));
        assert!(!places.holds(&[-10.01, 0.0, 0.0]));
        assert!(!places.holds(&[0.0, 8.0, 7.0]), "a bridge over the path is another place");
    }

    #[test]
    fn gaps_are_joined_up_to_a_limit() {
        let places = Places::along(&[[0.0, 0.0, 0.0], [18.0, 0.0, 0.0], [100.0, 0.0, 0.0]]);
        assert!(places.holds(&[9.0, 9.0, 0.0]));
        assert!(!places.holds(&[59.0, 0.0, 0.0]));
    }

    #[test]
    fn the_grid_finds_what_a_full_search_finds() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let path: Vec<[f64; 3]> = (0..200)
            .map(|_| {
                [rng.random_range(-60.0..60.0), rng.random_range(-60.0..60.0), rng.random_range(-3.0..3.0)]
            })
            .collect();
        // Every position on its own: far apart in order, so that nothing is joined.
        let mut apart = Vec::new();
        for p in &path {
            apart.extend([*p, [1e6, 1e6, 0.0]]);
        }
        let places = Places::along(&apart);
        for _ in 0..2000 {
            let q =
                [rng.random_range(-80.0..80.0), rng.random_range(-80.0..80.0), rng.random_range(-9.0..9.0)];
            assert_eq!(places.holds(&q), path.iter().any(|p| distance(p, &q) <= LOCALIZABLE_M), "{q:?}");
        }
    }

    #[test]
    fn a_prior_cloud_covers_its_cells() {
        let places = Places::in_cells(5.0, &[[0, 0], [-1, 2]]);
        assert!(places.holds(&[4.9, 0.0, 99.0]) && places.holds(&[-0.1, 10.0, 0.0]));
        assert!(!places.holds(&[5.1, 0.0, 0.0]) && !places.holds(&[1e300, 0.0, 0.0]));
    }
}

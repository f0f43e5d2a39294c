//! Lines over the ground plane, found quickly from any point.

use rustc_hash::FxHashMap;

/// Side of the cells that segments are sorted into, metres.
const CELL: f64 = 8.0;

/// A polyline in the plane, metres, with its arc length.
#[derive(Clone, Debug, Default)]
pub struct Path {
    points: Vec<[f64; 2]>,
    lengths: Vec<f64>,
    /// Segments whose surroundings of [`CELL`] touch a cell; looked up, never iterated.
    near: FxHashMap<(i32, i32), Vec<u32>>,
}

impl Path {
    /// From corner points; repeated ones are left out.
    pub fn new(corners: impl IntoIterator<Item = [f64; 2]>) -> Self {
        let mut path = Self::default();
        for p in corners {
            match path.points.last().map(|q| (p[0] - q[0]).hypot(p[1] - q[1])) {
                Some(d) if d < 1e-6 => continue,
                Some(d) => path.lengths.push(path.length() + d),
                None => path.lengths.push(0.0),
            }
            path.points.push(p);
        }
        let cell = |v: f64| (v / CELL).floor() as i32;
        for (n, w) in path.points.windows(2).enumerate() {
            let (low, high) =
                ([w[0][0].min(w[1][0]), w[0][1].min(w[1][1])], [w[0][0].max(w[1][0]), w[0][1].max(w[1][1])]);
            for i in cell(low[0] - CELL)..=cell(high[0] + CELL) {
                for j in cell(low[1] - CELL)..=cell(high[1] + CELL) {
                    path.near.entry((i, j)).or_default().push(n as u32);
                }
            }
        }
        path
    }

    /// Its length, metres.
    pub fn length(&self) -> f64 {
        self.lengths.last().copied().unwrap_or(0.0)
    }

    /// Its corners.
    pub fn points(&self) -> &[[f64; 2]] {
        &self.points
    }

    /// The point `s` metres from the start; beyond the ends it stays there.
    pub fn at(&self, s: f64) -> [f64; 2] {
        let n = self.lengths.partition_point(|l| *l < s);
        match (n, self.points.get(n)) {
            (0, _) => self.points.first().copied().unwrap_or_default(),
            (_, None) => self.points.last().copied().unwrap_or_default(),
            (_, Some(b)) => {
                let a = self.points[n - 1];
                let t = (s - self.lengths[n - 1]) / (self.lengths[n] - self.lengths[n - 1]);
                [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]
            }
        }
    }

    /// Heading in radians, over a chord of `2 half` metres about `s`.
    pub fn heading(&self, s: f64, half: f64) -> f64 {
        let (a, b) = (self.at((s - half).max(0.0)), self.at((s + half).min(self.length())));
        (b[1] - a[1]).atan2(b[0] - a[0])
    }

    /// The same way the other way round.
    pub fn reversed(&self) -> Self {
        Self::new(self.points.iter().rev().copied())
    }

    /// The way `left` metres beside it, to the left as it runs, sampled every metre. Where it bends more sharply than that,
    /// the loops that would arise are cut off.
    ///
    /// ```
    /// use esm_sim::Path;
    /// let way = Path::new([[0.0, 0.0], [50.0, 0.0]]);
    /// assert_eq!(way.offset(2.0).at(10.0), [10.0, 2.0]);
    /// assert_eq!(way.reversed().offset(2.0).at(10.0), [40.0, -2.0]);
    /// ```
    pub fn offset(&self, left: f64) -> Self {
        let n = self.length().round().max(1.0) as usize;
        let step = self.length() / n as f64;
        let base: Vec<[f64; 2]> = (0..=n).map(|k| self.at(k as f64 * step)).collect();
        let beside = |k: usize| {
            let h = self.heading(k as f64 * step, 1.5);
            [base[k][0] - left * h.sin(), base[k][1] + left * h.cos()]
        };
        // Nearer to a neighbouring piece of the way than to its own: inside of a bend too sharp for it.
        let reach = (4.0 * left.abs()).ceil() as usize;
        let clear = |k: usize, p: [f64; 2]| {
            let near = &base[k.saturating_sub(reach)..=(k + reach).min(n)];
            near.iter().all(|b| (b[0] - p[0]).hypot(b[1] - p[1]) > 0.98 * left.abs() - 0.02)
        };
        Self::new((0..=n).map(|k| (k, beside(k))).filter(|(k, p)| clear(*k, *p)).map(|(_, p)| p))
    }

    /// The part from `a` to `b` metres.
    pub fn part(&self, a: f64, b: f64) -> Self {
        let inner = self.lengths.iter().zip(&self.points).filter(|(l, _)| (a..b).contains(*l));
        let inner: Vec<[f64; 2]> = inner.map(|(_, p)| *p).collect();
        Self::new(std::iter::once(self.at(a)).chain(inner).chain([self.at(b)]))
    }

    /// Distance of a point to the path; infinite beyond 8 m.
    pub fn distance(&self, x: f64, y: f64) -> f64 {
        let key = ((x / CELL).floor() as i32, (y / CELL).floor() as i32);
        let Some(segments) = self.near.get(&key) else { return f64::INFINITY };
        let nearest = segments
            .iter()
            .map(|n| {
                let (a, b) = (self.points[*n as usize], self.points[*n as usize + 1]);
                let (d, w) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
                let t = ((w[0] * d[0] + w[1] * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
                (w[0] - t * d[0]).hypot(w[1] - t * d[1])
            })
            .fold(f64::INFINITY, f64::min);
        if nearest <= CELL { nearest } else { f64::INFINITY }
    }

    /// The part from `a` to `b` metres, corners cut: sampled every metre and smoothed over `radius` metres.
    pub fn smoothed(&self, a: f64, b: f64, radius: f64) -> Self {
        let n = ((b - a).max(1.0)).round() as usize;
        let reach = radius.round() as i64;
        Self::new((0..=n).map(|i| {
            let (mut sum, mut weights) = ([0.0; 2], 0.0);
            for k in -reach..=reach {
                let w = 1.0 - (k as f64 / (reach as f64 + 1.0)).powi(2);
                let p = self.at(a + (b - a) * i as f64 / n as f64 + k as f64);
                sum = [sum[0] + w * p[0], sum[1] + w * p[1]];
                weights += w;
            }
            [sum[0] / weights, sum[1] / weights]
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_and_place() {
        let path = Path::new([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]]);
        assert_eq!((path.length(), path.at(12.0)), (20.0, [10.0, 2.0]));
        assert_eq!(path.distance(5.0, 3.0), 3.0);
        assert_eq!(path.distance(5.0, -20.0), f64::INFINITY);
        assert!((path.heading(15.0, 1.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}

//! Terrains made up of a height function, with objects of which it is known what they are.

use super::*;

/// Uniform numbers in [0, 1): a fixed sequence, so that bounds can be tight.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 40) as f64 / (1u64 << 24) as f64
    }

    fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

type Height<'a> = &'a dyn Fn(f64, f64) -> f64;

struct Scene<'a> {
    height: Height<'a>,
    numbers: Numbers,
    points: Vec<[f32; 3]>,
    is_ground: Vec<bool>,
}

impl<'a> Scene<'a> {
    /// `n` ground points over a square of 2 `half` m, 3 cm of noise.
    fn terrain(half: f64, n: usize, height: Height<'a>) -> Self {
        let mut scene = Self { height, numbers: Numbers(1), points: Vec::new(), is_ground: Vec::new() };
        for _ in 0..n {
            let (x, y) = (scene.numbers.within(-half, half), scene.numbers.within(-half, half));
            let z = height(x, y) + scene.numbers.within(-0.03, 0.03);
            scene.push([x, y, z], true);
        }
        scene
    }

    fn push(&mut self, p: [f64; 3], is_ground: bool) {
        self.points.push(p.map(|v| v as f32));
        self.is_ground.push(is_ground);
    }

    fn remove_ground(&mut self, where_: impl Fn(&[f32; 3]) -> bool) {
        let all = std::mem::take(&mut self.points).into_iter().zip(std::mem::take(&mut self.is_ground));
        (self.points, self.is_ground) = all.filter(|(p, g)| !(*g && where_(p))).unzip();
    }

    /// The four walls and the top of a box that stands `z` above the ground at its middle, as `n` points but for those
    /// below the ground; no ground remains inside.
    fn stand_box(&mut self, [x, y, z]: [f64; 3], size: [f64; 3], n: usize) {
        self.remove_ground(|p| {
            (f64::from(p[0]) - x).abs() < size[0] / 2.0 && (f64::from(p[1]) - y).abs() < size[1] / 2.0
        });
        for i in 0..n {
            let mut u: [f64; 3] = std::array::from_fn(|_| self.numbers.within(-0.5, 0.5));
            match i % 5 {
                0 => u[0] = -0.5,
                1 => u[0] = 0.5,
                2 => u[1] = -0.5,
                3 => u[1] = 0.5,
                _ => u[2] = 0.5,
            }
            let (px, py) = (x + u[0] * size[0], y + u[1] * size[1]);
            let pz = (self.height)(x, y) + z + (u[2] + 0.5) * size[2];
            if pz >= (self.height)(px, py) {
                self.push([px, py, pz], false);
            }
        }
    }

    /// Share of the ground that is found, and of the object points that pass for ground.
    fn judge(&self) -> (f64, f64) {
        let flags = ground_flags(&self.points, &GroundConfig::default());
        let share = |of_ground: bool| {
            let of = self.is_ground.iter().filter(|g| **g == of_ground).count();
            let hit = flags.iter().zip(&self.is_ground).filter(|(f, g)| **f && **g == of_ground).count();
            hit as f64 / of.max(1) as f64
        };
        (share(true), share(false))
    }

    /// The share of flagged points among those that satisfy a condition.
    fn flagged(&self, condition: impl Fn(&[f32; 3]) -> bool) -> f64 {
        let flags = ground_flags(&self.points, &GroundConfig::default());
        let of: Vec<bool> =
            self.points.iter().zip(flags).filter(|(p, _)| condition(p)).map(|(_, f)| f).collect();
        of.iter().filter(|f| **f).count() as f64 / of.len() as f64
    }
}

#[test]
fn slopes_up_to_35_degrees_with_cars_and_trunks() {
    for degrees in [0.0f64, 5.0, 20.0, 30.0, 35.0] {
        let k = degrees.to_radians().tan();
        let height = |x: f64, y: f64| k * (0.8 * x + 0.6 * y);
        let mut scene = Scene::terrain(30.0, 20_000, &height);
        for i in 0..30 {
            let (x, y) = (scene.numbers.within(-25.0, 25.0), scene.numbers.within(-25.0, 25.0));
            let size = if i % 2 == 0 { [1.8, 4.5, 1.5] } else { [0.4, 0.4, 5.0] };
            scene.stand_box([x, y, 0.0], size, 400);
        }
        let (found, false_ground) = scene.judge();
        assert!(found > 0.99, "{degrees} degrees: {found} of the ground found");
        assert!(false_ground < 0.08, "{degrees} degrees: {false_ground} of the objects flagged");
    }
}

#[test]
fn hills_and_a_gully() {
    let hills = |x: f64, y: f64| 3.0 * (x / 8.0).cos() + 2.0 * (y / 7.0).sin();
    let mut scene = Scene::terrain(40.0, 30_000, &hills);
    for _ in 0..40 {
        let (x, y) = (scene.numbers.within(-35.0, 35.0), scene.numbers.within(-35.0, 35.0));
        scene.stand_box([x, y, 0.0], [0.4, 0.4, 8.0], 300);
    }
    let (found, false_ground) = scene.judge();
    assert!(found > 0.99 && false_ground < 0.05, "{found} {false_ground}");
    let (found, _) = Scene::terrain(30.0, 30_000, &|x, _| 0.6 * x.abs()).judge();
    assert!(found > 0.99, "{found}");
}

#[test]
fn both_sides_of_kerbs_stairs_and_retaining_walls() {
    let kerb = Scene::terrain(30.0, 20_000, &|x, _| if x > 3.3 { 0.15 } else { 0.0 }).judge().0;
    assert!(kerb > 0.999, "{kerb}");
    let stairs = Scene::terrain(20.0, 30_000, &|x, _| (x.clamp(0.0, 6.0) / 0.3).floor() * 0.17).judge().0;
    assert!(stairs > 0.97, "{stairs}");
    for step in [1.0, 2.0, 4.0] {
        let height = |x: f64, _: f64| if x > 3.3 { step } else { 0.0 };
        let scene = Scene::terrain(30.0, 20_000, &height);
        let (lower, upper) = (scene.flagged(|p| p[0] < 3.3), scene.flagged(|p| p[0] > 3.3));
        assert!(lower > 0.97 && upper > 0.95, "{step} m: {lower} below, {upper} above");
    }
}

#[test]
fn flat_roofs_are_no_ground() {
    for size in [[10.0, 10.0, 4.0], [20.0, 20.0, 5.0], [40.0, 40.0, 6.0]] {
        let mut scene = Scene::terrain(60.0, 60_000, &|_, _| 0.0);
        scene.stand_box([5.0, -3.0, 0.0], size, 9_000);
        let (found, false_ground) = scene.judge();
        assert!(found > 0.999 && false_ground < 0.05, "{size:?}: {found} {false_ground}");
        assert_eq!(scene.flagged(|p| p[2] > 1.0), 0.0, "{size:?}");
    }
}

#[test]
fn strays_below_the_ground_change_nothing() {
    let mut scene = Scene::terrain(30.0, 20_000, &|x, _| 0.05 * x);
    for i in 0..600 {
        // Half of them alone, half in six clumps of fifty.
        let mut numbers = Numbers(if i % 2 == 0 { i * 7919 } else { i / 100 * 7919 });
        let (_, x, y) = (numbers.next(), numbers.within(-28.0, 28.0), numbers.within(-28.0, 28.0));
        let (dx, dy) = (scene.numbers.within(-0.5, 0.5), scene.numbers.within(-0.5, 0.5));
        let z = scene.numbers.within(-25.0, -2.5);
        scene.push([x + dx, y + dy, if i % 2 == 0 { z } else { -3.5 + dx }], false);
    }
    let (found, false_ground) = scene.judge();
    assert!(found > 0.999, "{found}");
    assert_eq!(false_ground, 0.0);
}

#[test]
fn low_objects_stay_objects() {
    let mut scene = Scene::terrain(20.0, 30_000, &|_, _| 0.0);
    for _ in 0..30 {
        let (x, y) = (scene.numbers.within(-18.0, 18.0), scene.numbers.within(-18.0, 18.0));
        scene.stand_box([x, y, 0.0], [0.5, 0.5, 0.5], 300);
        let (x, y) = (scene.numbers.within(-18.0, 18.0), scene.numbers.within(-18.0, 18.0));
        scene.stand_box([x, y, 0.0], [1.2, 1.2, 0.6], 400);
    }
    assert_eq!(scene.flagged(|p| p[2] > 0.35), 0.0);
    let (found, false_ground) = scene.judge();
    assert!(found > 0.99 && false_ground < 0.3, "{found} {false_ground}");
}

#[test]
fn a_row_of_parked_cars_hides_the_ground_behind() {
    let mut scene = Scene::terrain(20.0, 30_000, &|_, _| 0.0);
    scene.remove_ground(|p| p[0] > 6.0);
    for i in 0..6 {
        scene.stand_box([5.0, -12.0 + 4.9 * f64::from(i), 0.3], [2.0, 4.6, 1.2], 900);
    }
    let flagged = scene.flagged(|p| p[2] > 0.5);
    assert!(flagged < 0.002, "{flagged}");
}

#[test]
fn clouds_without_ground() {
    let config = GroundConfig::default();
    let mut numbers = Numbers(3);
    let wall: Vec<[f32; 3]> = (0..3_000)
        .map(|_| [numbers.within(-10.0, 10.0) as f32, 5.0, numbers.within(1.0, 6.0) as f32])
        .collect();
    let flagged = ground_flags(&wall, &config).into_iter().filter(|f| *f).count();
    assert!(flagged < wall.len() / 10, "{flagged}: at most the foot of the wall");
    assert!(ground_flags(&[], &config).is_empty());
    assert_eq!(ground_flags(&[[1.0, 2.0, 3.0]], &config).len(), 1);
    let column: Vec<[f32; 3]> = (0..50).map(|i| [0.0, 0.0, i as f32 * 0.1]).collect();
    assert!(ground_flags(&column, &config)[5..].iter().all(|f| !f));
}

#[test]
fn the_order_of_the_points_does_not_matter() {
    let mut scene = Scene::terrain(20.0, 8_000, &|x, y| 0.1 * x + (y / 3.0).sin());
    scene.stand_box([3.0, 4.0, 0.0], [2.0, 4.0, 2.0], 500);
    let flags = ground_flags(&scene.points, &GroundConfig::default());
    let mut order: Vec<usize> = (0..scene.points.len()).collect();
    for i in (1..order.len()).rev() {
        order.swap(i, (scene.numbers.next() * (i + 1) as f64) as usize);
    }
    let shuffled: Vec<_> = order.iter().map(|&i| scene.points[i]).collect();
    let shuffled_flags = ground_flags(&shuffled, &GroundConfig::default());
    assert!(order.iter().zip(shuffled_flags).all(|(&i, f)| f == flags[i]));
}

#[test]
fn a_cloud_scattered_over_the_earth_takes_no_more_than_its_points() {
    let mut numbers = Numbers(5);
    let mut points: Vec<[f32; 3]> = (0..50_000)
        .map(|_| [numbers.within(-1e7, 1e7) as f32, numbers.within(-1e7, 1e7) as f32, 0.0])
        .collect();
    points.extend([[f32::MAX, f32::MIN, 0.0], [1e30, 0.0, f32::MAX]]);
    // A grid over the earth would not fit into memory.
    let flags = ground_flags(&points, &GroundConfig::default());
    assert!(!flags[50_000] && !flags[50_001], "beyond the grid");
    assert!(flags[..50_000].iter().all(|f| *f));
}

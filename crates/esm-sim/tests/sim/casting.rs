//! Rays against oracles: every shape one by one, and shapes against the equations they stand for.

use esm_sim::{Draw, Key, Ray, Scene, Season, Shape, Tiles, Trajectory, Visit, World, WorldKind, preset};
use nalgebra::Vector3;

const VISIT: Visit = Visit { number: 1, season: Season::May, change: 0.05, changed: None };

fn direction(draw: &mut Draw) -> Vector3<f32> {
    Vector3::new(draw.normal(), draw.normal(), 0.4 * draw.normal())
}

/// The BVHs find exactly what looking at every shape finds, to the bit, foliage included.
#[test]
fn bvh_agrees_with_brute_force() {
    for kind in [WorldKind::Forest, WorldKind::Park, WorldKind::Urban] {
        let world = World::new(kind, 3, 200.0, VISIT);
        let ride = preset("train-urban").unwrap().ride();
        let trajectory = Trajectory::new(world.route().clone(), ride, Key::new(3), |x, y| world.height(x, y));
        let at = trajectory.pose(9.0).translation.vector;
        let scene = Tiles::new(&world).scene(&[at], 40.0);
        let (mut hits, mut media) = (0, 0);
        for n in 0..400 {
            let key = Key::new(9).with(n);
            let mut draw = key.draw();
            let start = (at - scene.origin()).cast::<f32>() + direction(&mut draw) * 2.0 + Vector3::z();
            let ray = Ray::try_new(start, direction(&mut draw), key).unwrap();
            let (found, oracle) = (scene.cast(&ray, 60.0), scene.cast_brute_force(&ray, 60.0));
            match (found, oracle) {
                (Some(a), Some(b)) => {
                    // Two surfaces at one distance may swap; the distance may not change.
                    assert_eq!(a.distance, b.distance, "{kind:?}, ray {n}: {a:?} {b:?}");
                    hits += 1;
                    media += usize::from(a.in_medium);
                }
                (a, b) => assert_eq!(a, b, "{kind:?}, ray {n}"),
            }
        }
        assert!(hits > 150, "{kind:?}: {hits} hits");
        assert!(media > 0, "{kind:?}: no foliage was hit");
    }
}

fn cast_at(shape: Shape, origin: Vector3<f32>, dir: Vector3<f32>) -> Option<f32> {
    let ray = Ray::try_new(origin, dir, Key::new(1)).unwrap();
    Scene::of_shapes(&[shape]).cast(&ray, 1000.0).map(|h| h.distance)
}

#[test]
fn known_distances() {
    let (x, z) = (Vector3::x(), Vector3::z());
    let cylinder = Shape::frustum(-z, z, 0.5, 0.5);
    let near = |a: Option<f32>, b: f32| a.is_some_and(|t| (t - b).abs() < 1e-4);
    assert!(near(cast_at(cylinder, x * -10.0, x), 9.5));
    assert!(near(cast_at(cylinder, z * 5.0, -z), 4.0), "its flat end");
    assert!(cast_at(cylinder, x * -10.0 + z * 1.01, x).is_none(), "over its end");
    let cone = Shape::frustum(-z, z, 1.0, 0.5);
    assert!(near(cast_at(cone, x * -10.0, x), 9.25), "the radius half way up is 0.75");
    let ball = Shape::spheroid(x * 3.0, z, 2.0, 1.0);
    assert!(near(cast_at(ball, Vector3::zeros(), x), 2.0));
    assert!(near(cast_at(ball, x * 3.0 + z * 7.0, -z), 5.0));
    let cube = Shape::cuboid(Vector3::zeros(), Vector3::new(1.0, 1.0, 1.0), std::f32::consts::FRAC_PI_4);
    assert!(near(cast_at(cube, x * -10.0, x), 10.0 - 2f32.sqrt()), "its edge looks at the ray");
    assert!(cast_at(cube, x * -10.0 + z * 1.5, x).is_none());
}

/// A thin frustum 80 m away is met where its equation says: f32 keeps to 0.2 mm.
#[test]
fn far_thin_shapes_are_met_exactly() {
    let mut draw = Key::new(5).draw();
    let (mut met, mut worst) = (0, 0f32);
    for _ in 0..2000 {
        let centre = Vector3::new(80.0, draw.range(-5.0, 5.0), draw.range(-5.0, 5.0));
        let axis = direction(&mut draw).normalize();
        let (a, b, ra, rb) = (centre - axis, centre + axis, 0.06f32, 0.03f32);
        let aim = centre + direction(&mut draw) * 0.04;
        let Some(t) = cast_at(Shape::frustum(a, b, ra, rb), Vector3::zeros(), aim) else { continue };
        let p = aim.normalize() * t;
        let h = (p - a).dot(&axis);
        if !(0.001..1.999).contains(&h) {
            continue;
        }
        let off = (p - a - axis * h).norm() - (ra + (rb - ra) * h / 2.0);
        (met, worst) = (met + 1, worst.max(off.abs()));
    }
    assert!(met > 500, "{met}");
    assert!(worst < 2e-4, "{worst} m off the surface");
}

/// Beer and Lambert: the share of rays that come through is exp(-density * length).
#[test]
fn foliage_lets_the_right_share_through() {
    let shape = Shape::hedge(Vector3::x() * 5.0, Vector3::new(1.0, 1.0, 1.0), 0.0, 0.7);
    let scene = Scene::of_shapes(&[shape]);
    let n = 20_000;
    let ray = |k| Ray::try_new(Vector3::zeros(), Vector3::x(), Key::new(k)).unwrap();
    let through = (0..n).filter(|k| scene.cast(&ray(*k), 50.0).is_none()).count();
    let (share, law) = (through as f64 / n as f64, (-1.4f64).exp());
    assert!((share - law).abs() < 0.01, "{share}, by the law {law}");
}

/// Clumps stop the share that the integral of their density over the chord says: 1.5 d (1 - rho^2). One clump has leaves where
/// it has them; the law is that of the mean over many.
#[test]
fn clumps_follow_their_density() {
    let clumps: Vec<Scene> = (0..400u16)
        .map(|n| {
            let across = 2.0 + 1e-5 * f32::from(n);
            Scene::of_shapes(&[Shape::clump(Vector3::x() * 5.0, Vector3::z(), 1.0, across, 0.5)])
        })
        .collect();
    for (height, share) in [0.0f64, 0.6].map(|h| {
        // At this height the chord reaches `half` to both sides; the density is 0.75 (1 - h^2 - (x / 2)^2).
        let half = 2.0 * (1.0 - h * h).sqrt();
        let depth = 0.75 * 2.0 * ((1.0 - h * h) * half - half.powi(3) / 12.0);
        (h, (-depth).exp())
    }) {
        let eye = Vector3::new(0.0, 0.0, height as f32);
        let ray = |k| Ray::try_new(eye, Vector3::x(), Key::new(k)).unwrap();
        let through: usize = clumps
            .iter()
            .map(|clump| (0..100).filter(|k| clump.cast(&ray(*k), 50.0).is_none()).count())
            .sum();
        let through = through as f64 / (100.0 * clumps.len() as f64);
        // Gaps that stay let a little more through than leaves everywhere (Jensen): 1.0 to 1.1 times as much.
        assert!((0.97..1.12).contains(&(through / share)), "at {height}: {through}, by the law {share}");
    }
}

/// The gaps of a clump stay: what many rays from one side find of it, many from another time find again.
#[test]
fn foliage_keeps_its_gaps() {
    let scene = Scene::of_shapes(&[Shape::clump(Vector3::x() * 5.0, Vector3::z(), 0.6, 0.5, 3.0)]);
    let occupied = |seed: u64| {
        let mut cells = std::collections::BTreeSet::new();
        for k in 0..20_000 {
            let key = Key::new(seed).with(k);
            let mut draw = key.draw();
            let aim = Vector3::new(5.0, draw.range(-0.5, 0.5), draw.range(-0.6, 0.6));
            let ray = Ray::try_new(Vector3::zeros(), aim, key).unwrap();
            if let Some(hit) = scene.cast(&ray, 50.0) {
                let p = (aim.normalize() * hit.distance - Vector3::x() * 5.0) / 0.07;
                cells.insert([p.x.floor() as i32, p.y.floor() as i32, p.z.floor() as i32]);
            }
        }
        cells
    };
    let (first, second) = (occupied(1), occupied(2));
    let both = first.intersection(&second).count() as f64 / first.union(&second).count() as f64;
    assert!(first.len() > 200 && both > 0.8, "{both} of {} cells", first.len());
    // Half cells of tufts: of those in the box around the clump a good part is never hit.
    let all = (14.0 * 14.0 * 17.0) * std::f64::consts::PI / 6.0;
    assert!((first.len() as f64) < 0.7 * all, "{} of {all} cells are hit", first.len());
}

#[test]
fn rays_without_direction_are_refused() {
    let zero = Vector3::zeros();
    assert!(Ray::try_new(zero, zero, Key::new(1)).is_none());
    assert!(Ray::try_new(Vector3::new(f32::NAN, 0.0, 0.0), Vector3::x(), Key::new(1)).is_none());
}

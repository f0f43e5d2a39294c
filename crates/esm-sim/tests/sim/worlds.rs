//! Objects, their numbers, what changes between visits, and sweeps against the truth.

use std::collections::BTreeMap;

use esm_sim::{
    Class, Key, Object, Ray, Season, SensorModel, SweepSpec, Tiles, Trajectory, Visit, World, WorldKind,
    preset, sweep, tile_of,
};
use nalgebra::Vector3;

const KINDS: [WorldKind; 6] = [
    WorldKind::Forest,
    WorldKind::Park,
    WorldKind::Urban,
    WorldKind::Plantation,
    WorldKind::CarPark,
    WorldKind::Terraces,
];

fn visit(number: u8, change: f32) -> Visit {
    Visit { number, season: Season::May, change, changed: None }
}

/// All objects around the origin by number; a number that occurs twice fails.
fn objects(world: &World) -> BTreeMap<u32, Object> {
    let mut all = BTreeMap::new();
    for tile in (-4..4).flat_map(|i| (-4..4).map(move |j| (i, j))) {
        for object in world.objects(tile) {
            assert_eq!(tile_of(object.anchor.x, object.anchor.y), tile);
            assert_ne!(object.id, 0);
            let (id, class) = (object.id, object.class);
            let twin = all.insert(id, object);
            assert!(twin.is_none(), "{id:#x} is {class:?} and {:?}", twin.map(|o| o.class));
        }
    }
    all
}

/// Every number is one thing, and the same thing at every visit.
#[test]
fn numbers_are_unique_and_last() {
    for kind in KINDS {
        let [first, second] = [visit(0, 0.1), visit(1, 0.1)].map(|v| objects(&World::new(kind, 5, 400.0, v)));
        assert!(first.len() > 300, "{kind:?}: {}", first.len());
        let mut same = 0;
        for (id, a) in &first {
            let Some(b) = second.get(id) else { continue };
            assert_eq!((a.class, a.anchor), (b.class, b.anchor), "{kind:?} {id:#x}");
            same += 1;
        }
        // Of what stands in a car park most moves easily.
        let least = if kind == WorldKind::CarPark { first.len() / 4 } else { first.len() / 2 };
        assert!(same > least, "{kind:?}: {same} of {}", first.len());
    }
}

/// The knob: the share of lasting things that are gone is the one asked for; people and cars move more.
#[test]
fn change_is_what_was_asked_for() {
    let lasting = |c: Class| matches!(c, Class::Tree);
    for (kind, change) in [(WorldKind::Forest, 0.05), (WorldKind::Forest, 0.3), (WorldKind::Park, 0.2)] {
        let [first, second] =
            [visit(0, change), visit(1, change)].map(|v| objects(&World::new(kind, 6, 900.0, v)));
        let (mut all, mut gone) = (0.0, 0.0);
        for (id, _) in first.iter().filter(|(_, o)| lasting(o.class)) {
            all += 1.0;
            gone += f64::from(u8::from(!second.contains_key(id)));
        }
        let (share, asked) = (gone / all, f64::from(change));
        let sigma = (asked * (1.0 - asked) / all).sqrt();
        assert!(
            (share - asked).abs() < 3.0 * sigma + 1e-9,
            "{kind:?}: {share} of {all} are gone, not {asked}"
        );
    }
    let cars = |v| {
        let world = World::new(WorldKind::Urban, 6, 900.0, v);
        objects(&world)
            .into_iter()
            .filter(|(_, o)| o.class == Class::Car)
            .map(|(id, _)| id)
            .collect::<Vec<_>>()
    };
    let (before, after) = (cars(visit(0, 0.05)), cars(visit(1, 0.05)));
    let stayed = before.iter().filter(|id| after.contains(id)).count() as f64 / before.len() as f64;
    assert!((0.5..0.7).contains(&stayed), "{stayed} of {} cars stayed, 0.6 should", before.len());
}

/// Points of sweeps, told in the map frame by the true poses, lie on the static world: looked at again from where they were
/// measured, without noise, a surface is there. Foliage is chance and left out; mixed edges and glancing rays may differ.
#[test]
fn points_lie_on_the_world_by_the_truth() {
    for (kind, model, undistorted) in [
        (WorldKind::Urban, SensorModel::Hdl32e, true),
        (WorldKind::Forest, SensorModel::Vlp16, true),
        (WorldKind::Park, SensorModel::Os1_64, true),
        (WorldKind::Plantation, SensorModel::Vlp16, true),
        (WorldKind::CarPark, SensorModel::Hdl32e, true),
        (WorldKind::Terraces, SensorModel::Hdl32e, true),
    ] {
        let world = World::new(kind, 8, 300.0, visit(0, 0.0));
        let ride = preset("train-urban").unwrap().ride();
        let trajectory = Trajectory::new(world.route().clone(), ride, Key::new(8), |x, y| world.height(x, y));
        let sensor = model.sensor();
        let mut tiles = Tiles::new(&world);
        let (mut checked, mut agreeing, mut ids) = (0, 0, BTreeMap::new());
        for n in 0..2u64 {
            let stamp_s = 6.0 + n as f64;
            let place = trajectory.pose(stamp_s).translation.vector;
            let scene = tiles.scene(&[place], f64::from(sensor.max_range_m));
            let spec = SweepSpec { sensor: &sensor, stamp_s, undistorted, key: Key::new(n) };
            let points = sweep(&spec, &scene, |t| trajectory.pose(t));
            assert!(points.len() > sensor.rays() / 4, "{kind:?}: {} points", points.len());
            for p in points.iter().step_by(97) {
                // Objects keep their class over the sweeps.
                if p.object_id != 0 {
                    assert_eq!(*ids.entry(p.object_id).or_insert(p.class), p.class);
                }
                let at = (trajectory.pose(stamp_s) * nalgebra::Point3::from(p.xyz.map(f64::from))).coords;
                let agrees = match p.class {
                    Class::Tree | Class::Bush | Class::Hedge | Class::Undergrowth => continue,
                    // Grass and litter stop beams above the soil; cells of 1 to 2 m cut its bumps.
                    _ if p.object_id == 0 => (at.z - world.height(at.x, at.y)).abs() < 0.2,
                    _ => {
                        // From 0.3 m before the point: what lies between may be foliage, which is chance.
                        let eye = trajectory.pose(stamp_s + f64::from(p.time)).translation.vector;
                        let dir = (at - eye).normalize();
                        let start = at - dir * 0.3 - scene.origin();
                        let ray = Ray::try_new(start.cast(), dir.cast(), Key::new(1)).unwrap();
                        scene.cast(&ray, 1.0).is_some_and(|h| (h.distance - 0.3).abs() < 0.12)
                    }
                };
                checked += 1;
                agreeing += u32::from(agrees);
            }
        }
        let share = f64::from(agreeing) / f64::from(checked);
        assert!(checked > 100 && share > 0.9, "{kind:?}: {share} of {checked}");
    }
}

/// The ground is where the world says, and vehicles stand on it.
#[test]
fn the_sensor_rides_over_the_ground() {
    for kind in KINDS {
        let world = World::new(kind, 9, 300.0, visit(0, 0.0));
        let ride = preset("cornbury").unwrap().ride();
        let trajectory = Trajectory::new(world.route().clone(), ride, Key::new(2), |x, y| world.height(x, y));
        assert!(world.route().length() > 299.0, "{kind:?}: {}", world.route().length());
        let mut last: Option<Vector3<f64>> = None;
        for k in 0..400 {
            let pose = trajectory.pose(f64::from(k) * 0.5);
            let p = pose.translation.vector;
            let above = p.z - world.height(p.x, p.y);
            assert!((above - ride.sensor_height_m).abs() < 0.4, "{kind:?} at {k}: {above}");
            let up = pose.rotation * Vector3::z();
            assert!(up.z > 0.85, "{kind:?} at {k}: tilted to {up:?}");
            if let Some(last) = last {
                let speed = (p - last).norm() / 0.5;
                assert!(speed < 2.0 * ride.speed_mps, "{kind:?} at {k}: {speed} m/s");
            }
            last = Some(p);
        }
    }
}

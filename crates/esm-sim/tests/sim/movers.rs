//! What moves within a visit: where it is, that beams meet it there, its numbers, and that it keeps clear of the sensor.

use std::sync::Arc;

use std::collections::BTreeMap;

use esm_sim::{
    Class, Key, Movers, Ray, Season, Sensor, SensorModel, SweepSpec, Tiles, Trajectory, Visit, World,
    WorldKind, preset, sweep, sweep_among,
};
use nalgebra::{Point3, Vector3};

const VISIT: Visit = Visit { number: 1, season: Season::May, change: 0.02, changed: None };

/// A ride through a world of a preset, with what moves about it.
fn ride<T>(
    name: &str,
    density: f64,
    seed: u64,
    of: impl FnOnce(&World, &Trajectory<'_>, &Movers<'_>, f64) -> T,
) -> T {
    let preset = preset(name).unwrap();
    let world = World::new(preset.world, seed, 400.0, VISIT);
    let height = |x, y| world.height(x, y);
    let trajectory = Arc::new(Trajectory::new(world.route().clone(), preset.ride(), Key::new(seed), height));
    let end = trajectory.time_at(390.0);
    let movers = Movers::new(&world, Arc::clone(&trajectory), (0.0, end), density, Key::new(seed).with(1));
    of(&world, &trajectory, &movers, end)
}

/// Points of movers: told in the map frame by the true pose at their own time, they lie on the surface of the mover that
/// their number names, where it is at that time. With the place at the sweep's stamp instead, those of fast ones do not.
#[test]
fn points_lie_on_the_moved_surface() {
    let spinning = SensorModel::Hdl32e.sensor();
    // Slow turns: a car is 2 m farther at the end of one than at its start.
    let slow = Sensor { period_s: 0.2, active_s: 0.2, ..spinning };
    for (name, least) in [("kitti", 40), ("george-square", 40), ("cornbury", 10)] {
        ride(name, 3.0, 11, |world, trajectory, movers, end| {
            let mut tiles = Tiles::new(world);
            let (mut checked, mut on, mut late) = (0, 0, (0, 0));
            for n in 0..40 {
                let stamp_s = 1.0 + f64::from(n) * (end - 2.0) / 40.0;
                let scene = tiles.scene(&[trajectory.pose(stamp_s).translation.vector], 60.0);
                let spec = SweepSpec { sensor: &slow, stamp_s, undistorted: false, key: Key::new(n as u64) };
                for p in sweep_among(&spec, &scene, movers, |t| trajectory.pose(t)) {
                    if !p.class.moves() {
                        assert!(p.object_id == 0 || p.object_id & 0xFFFF != 0, "{:#x}", p.object_id);
                        continue;
                    }
                    let mover = movers.list().iter().find(|m| m.id == p.object_id).unwrap();
                    assert_eq!(mover.class, p.class);
                    let time = stamp_s + f64::from(p.time);
                    let eye = trajectory.pose(time);
                    let at = eye * Point3::from(p.xyz.map(f64::from));
                    let off = |seconds: f64| {
                        let pose = movers.pose(mover, seconds).unwrap();
                        let eye = pose.inverse() * Point3::from(eye.translation.vector);
                        let dir = (pose.inverse() * at - eye).cast::<f32>();
                        let ray = Ray::try_new(eye.coords.cast(), dir, Key::new(1)).unwrap();
                        let hit = movers.surface(mover, seconds).unwrap().cast(&ray, 200.0);
                        hit.map_or(f32::INFINITY, |h| (h.distance - dir.norm()).abs())
                    };
                    checked += 1;
                    // Four deviations of the ranges; mixed edges lie between mover and background.
                    on += u32::from(off(time) < 0.08);
                    if p.class == Class::MovingCar && p.time < -0.15 {
                        late.0 += 1;
                        late.1 += u32::from(off(stamp_s) < 0.08);
                    }
                }
            }
            let share = f64::from(on) / f64::from(checked);
            assert!(checked > least, "{name}: {checked} points of movers");
            assert!(share > 0.9, "{name}: {share} of {checked}");
            if name == "kitti" {
                assert!(late.0 > 20 && late.1 < late.0 / 2, "smear: {late:?}");
            }
        });
    }
}

/// A mover's place is a function of time, its speed that of its kind, and it stands on the ground; the same seed gives the
/// same crowd, another seed another one, twice the density about twice as many.
#[test]
fn the_crowd_is_what_was_asked_for() {
    for name in ["kitti", "george-square", "cornbury"] {
        let places = |seed: u64, density: f64| {
            ride(name, density, seed, |world, _, movers, end| {
                let mut all = BTreeMap::new();
                for m in movers.list() {
                    assert!(m.class.moves() && m.id != 0 && m.id & 0xFFFF == 0, "{:#x}", m.id);
                    let mut track = Vec::new();
                    for k in 0..200 {
                        let t = end * f64::from(k) / 200.0;
                        let (Some(a), Some(b)) = (movers.pose(m, t), movers.pose(m, t + 0.05)) else {
                            continue;
                        };
                        let speed = (b.translation.vector - a.translation.vector).norm() / 0.05;
                        let most = match m.class {
                            Class::MovingCar | Class::MovingVan => 25.0,
                            Class::Cyclist => 9.0,
                            _ => 4.5,
                        };
                        assert!(speed < most, "{name}: {:?} at {speed} m/s", m.class);
                        let p = a.translation.vector;
                        assert!((p.z - world.height(p.x, p.y)).abs() < 1e-9);
                        track.push([p.x, p.y]);
                    }
                    assert!(all.insert(m.id, track).is_none(), "{:#x} twice", m.id);
                }
                all
            })
        };
        let few = places(11, 2.0);
        assert_eq!(few, places(11, 2.0), "{name}");
        assert_ne!(few, places(12, 2.0), "{name}");
        assert!(places(11, 0.0).is_empty());
        let ratio = places(11, 8.0).len() as f64 / few.len() as f64;
        assert!((2.0..8.0).contains(&ratio), "{name}: {ratio} times {}", few.len());
    }
}

/// Nobody walks or drives through the sensor, and cars drive on roads, people beside them.
#[test]
fn movers_keep_clear_and_to_their_ground() {
    for name in ["kitti", "george-square", "cornbury"] {
        ride(name, 6.0, 13, |world, trajectory, movers, end| {
            let mut nearest = f64::INFINITY;
            let (mut looks, mut right) = (0, 0);
            let steps = (end / 0.1) as u32;
            for m in movers.list() {
                for k in 0..steps {
                    let t = 0.1 * f64::from(k);
                    let Some(pose) = movers.pose(m, t) else { continue };
                    let p = pose.translation.vector;
                    let off: Vector3<f64> = p - trajectory.pose(t).translation.vector;
                    let least =
                        if matches!(m.class, Class::MovingCar | Class::MovingVan) { 1.8 } else { 0.2 };
                    assert!(off.xy().norm() > least, "{name}: {:?} {:.2} m off", m.class, off.xy().norm());
                    nearest = nearest.min(off.xy().norm());
                    if k % 20 == 0 && name != "cornbury" {
                        looks += 1;
                        let road = world.ground(p.x, p.y) == Class::Road;
                        let drives = m.class != Class::Walker;
                        right += u32::from(road == drives);
                    }
                }
            }
            assert!(nearest < 15.0, "{name}: nobody came nearer than {nearest} m");
            if looks > 0 {
                let share = f64::from(right) / f64::from(looks);
                assert!(share > 0.95, "{name}: {share} of {looks} on their ground");
            }
        });
    }
}

/// Without movers the sweep is the plain one, to the bit; with them, what stands is where it was.
#[test]
fn movers_change_nothing_else() {
    let sensor = SensorModel::Vlp16.sensor();
    for kind in [WorldKind::Urban, WorldKind::Forest] {
        let name = if kind == WorldKind::Urban { "kitti" } else { "cornbury" };
        for density in [0.0, 6.0] {
            ride(name, density, 14, |world, trajectory, movers, _| {
                let stamp_s = 12.0;
                let scene = Tiles::new(world).scene(&[trajectory.pose(stamp_s).translation.vector], 60.0);
                let spec = SweepSpec { sensor: &sensor, stamp_s, undistorted: true, key: Key::new(3) };
                let plain = sweep(&spec, &scene, |t| trajectory.pose(t));
                let among = sweep_among(&spec, &scene, movers, |t| trajectory.pose(t));
                let gone = plain.iter().filter(|p| !among.contains(p)).count();
                if density == 0.0 {
                    assert_eq!(plain, among);
                } else {
                    let new = among.iter().filter(|p| !plain.contains(p)).count();
                    assert!(gone < plain.len() / 3 && new < plain.len() / 3, "{gone} gone, {new} new");
                }
            });
        }
    }
}

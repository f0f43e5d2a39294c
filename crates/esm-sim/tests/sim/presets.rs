//! The presets mirror what they are named after, at full length (ways and worlds alone) and at small scales.

use std::collections::BTreeMap;

use esm_sim::{Class, Key, PRESETS, Path, Preset, Ray, Tiles, Tour, World, WorldKind, preset, tile_of};
use nalgebra::Vector3;

/// The way of a tour at full length.
fn driven(preset: &Preset, tour: &Tour, seed: u64) -> Path {
    let world = World::new(preset.world, seed, preset.length_m, tour.visit);
    let way = tour.way(&world, preset.length_m);
    let end = preset.length_m.min(way.length());
    way.part(tour.part.0 * end, tour.part.1 * end)
}

/// Share of a way's metres within 10 m of another, and of those how many are driven the other way.
fn over(way: &Path, map: &Path) -> (f64, f64) {
    let places = |p: &Path| {
        (0..p.length() as usize).map(|s| (p.at(s as f64), p.heading(s as f64, 2.0))).collect::<Vec<_>>()
    };
    let (way, map) = (places(way), places(map));
    let (mut near, mut against) = (0.0, 0.0);
    for (p, h) in &way {
        let nearest = map
            .iter()
            .map(|(q, g)| ((p[0] - q[0]).hypot(p[1] - q[1]), g))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap();
        if nearest.0 < 10.0 {
            near += 1.0;
            against += f64::from(u8::from((h - nearest.1).cos() < -0.5));
        }
    }
    (near / way.len() as f64, against / near)
}

#[test]
fn kitti_drives_mapped_streets_again() {
    let kitti = preset("kitti").unwrap();
    let mut against = 0;
    for seed in [3, 100, 101, 200, 201, 202] {
        let (map, live) = (driven(&kitti, &kitti.map, seed), driven(&kitti, &kitti.live, seed));
        assert!((2900.0..3100.0).contains(&map.length()), "{}", map.length());
        assert!((700.0..780.0).contains(&live.length()), "{}", live.length());
        let (again, other_way) = over(&live, &map);
        assert!(again * live.length() > 560.0, "seed {seed}: {again} of {} m", live.length());
        against += u32::from(other_way * again * live.length() > 60.0);
    }
    assert!(against >= 2, "{against} of 6 drives have a stretch in the other direction");
}

/// At a tenth and less of its length the second visit still sees what was mapped.
#[test]
fn small_kitti_overlaps_too() {
    let kitti = preset("kitti").unwrap();
    for (seed, scale) in [(1, 0.05), (2, 0.1), (100, 0.1), (200, 0.2)] {
        let small = Preset { length_m: kitti.length_m * scale, ..kitti };
        let (map, live) = (driven(&small, &small.map, seed), driven(&small, &small.live, seed));
        let (again, _) = over(&live, &map);
        assert!(again > 0.8, "seed {seed}, scale {scale}: {again} of {} m", live.length());
    }
}

#[test]
fn lengths_and_clouds_are_those_of_the_data_sets() {
    for (name, length, clouds) in
        [("burgess", 2800.0, 120..=135), ("george-square", 500.0, 27..=32), ("cornbury", 700.0, 1100..=1150)]
    {
        let p = preset(name).unwrap();
        let live = driven(&p, &p.live, 200);
        assert!((live.length() - length).abs() < 0.03 * length, "{name}: {}", live.length());
        let each = if p.accumulate_m > 0.0 { p.accumulate_m } else { p.spacing_m };
        let n = (live.length() / each) as usize;
        assert!(clouds.contains(&n), "{name}: {n} clouds");
        // Loops: the end is near where the way has been.
        let start = live.part(0.0, 0.5 * live.length()).at(0.0);
        let end = live.at(live.length());
        if p.world == WorldKind::Forest {
            assert!((start[0] - end[0]).hypot(start[1] - end[1]) < 25.0, "{name}: {start:?} {end:?}");
        }
    }
    for p in PRESETS {
        assert_eq!(preset(p.name).unwrap(), p);
    }
}

/// How far a point is from a way about `s` metres along it, whatever passes the same place at another time.
fn off(way: &Path, s: f64, q: [f64; 2]) -> f64 {
    let places = (-80..=80).map(|k| way.at(s + f64::from(k)));
    places.map(|c| (c[0] - q[0]).hypot(c[1] - q[1])).fold(f64::INFINITY, f64::min)
}

/// Backwards and beside: the ways of changed tours are where they were asked to be.
#[test]
fn tours_backwards_and_beside() {
    for p in PRESETS {
        let length = 1500.0;
        let world = World::new(p.world, 4, length, p.live.visit);
        let plain = Tour { part: (0.0, 1.0), ..p.live };
        let there = plain.way(&world, length);
        let back = Tour { reversed: true, ..plain }.way(&world, length);
        let lanes = matches!(p.world, WorldKind::Urban | WorldKind::CarPark | WorldKind::Terraces);
        let lane = if lanes { 3.2 } else { 0.0 };
        assert!((back.length() - length).abs() < 0.05 * length, "{}: {}", p.name, back.length());
        let (mut right, mut n) = (0, 0);
        for s in (50..1450).step_by(5) {
            let q = back.at(f64::from(s));
            let nearest = off(&there, length - f64::from(s), q);
            n += 1;
            right += u32::from((nearest - lane).abs() < 0.5);
        }
        assert!(f64::from(right) > 0.9 * f64::from(n), "{}: {right} of {n} in their lane", p.name);
        let (a, b) = (back.at(0.0), there.at(length));
        assert!((a[0] - b[0]).hypot(a[1] - b[1]) < 4.0, "{}: starts at the end", p.name);
        for offset_m in [2.0, -5.0, 10.0] {
            let beside = Tour { offset_m, ..plain }.way(&world, length);
            let share = there.length() / beside.length();
            let offs: Vec<f64> = (50..1450)
                .map(|s| {
                    let at = beside.at(f64::from(s));
                    let shift = if lanes { world.ground(at[0], at[1]) == Class::Road } else { true };
                    assert!(shift, "{} {offset_m}: off the road at {s} m", p.name);
                    off(&there, f64::from(s) * share, at)
                })
                .collect();
            let (most, mean) =
                (offs.iter().copied().fold(0.0, f64::max), offs.iter().sum::<f64>() / offs.len() as f64);
            assert!(most < f64::abs(offset_m) + 0.8, "{} {offset_m}: {most} m off", p.name);
            // To the right of their lane, streets have 1.5 to 3.5 m of road; between trees there is room, if not everywhere.
            let least = match p.world {
                _ if lanes && offset_m < 0.0 => 0.0,
                _ if lanes => 1.5,
                _ => 0.5 * f64::abs(offset_m),
            };
            assert!(mean > least, "{} {offset_m}: {mean} m off", p.name);
        }
    }
}

/// Beside the route nobody drives through what stands: rays along the way, at the height of knee, hip and head, meet nothing
/// solid as wide as the vehicle.
#[test]
fn ways_beside_are_clear() {
    for name in ["cornbury", "george-square", "kitti", "plantation", "car-park", "terraces"] {
        let p = preset(name).unwrap();
        let length = 300.0;
        let world = World::new(p.world, 12, length, p.live.visit);
        for offset_m in [2.0, -5.0, 10.0] {
            let way = Tour { offset_m, ..p.live }.way(&world, length);
            let plain = Tour { offset_m: 0.0, ..p.live }.way(&world, length);
            let (mut met, mut rays) = (0, 0);
            for s in 0..(way.length() as u32 - 1).min(250) {
                let (a, b, h) =
                    (way.at(f64::from(s)), way.at(f64::from(s) + 1.0), way.heading(f64::from(s), 1.0));
                if off(&plain, f64::from(s), a) < 0.3 {
                    continue;
                }
                let scene = Tiles::new(&world).scene(&[Vector3::new(a[0], a[1], 0.0)], 4.0);
                for (up, left) in [0.5, 1.0, 1.7].into_iter().flat_map(|z| [-0.3, 0.0, 0.3].map(|l| (z, l))) {
                    let z = world.height(a[0], a[1]) + up;
                    let from = Vector3::new(a[0] - left * h.sin(), a[1] + left * h.cos(), z);
                    let dir = Vector3::new(b[0] - a[0], b[1] - a[1], 0.0);
                    let ray = Ray::try_new((from - scene.origin()).cast(), dir.cast(), Key::new(1)).unwrap();
                    let hit = scene.cast(&ray, dir.norm() as f32);
                    rays += 1;
                    // Leaves of trees and ferns give way, and so do twigs.
                    met += u32::from(hit.is_some_and(|h| !h.in_medium));
                }
            }
            assert!(rays > 200, "{name} {offset_m}: {rays} rays beside the way");
            assert!(met * 200 < rays, "{name} {offset_m}: {met} of {rays} rays meet something");
        }
    }
}

/// However small its scale, a park holds what a park holds.
#[test]
fn a_small_park_is_a_park() {
    let p = preset("george-square").unwrap();
    for seed in 0..8 {
        let world = World::new(p.world, seed, 150.0, p.map.visit);
        let mut count: BTreeMap<Class, usize> = BTreeMap::new();
        for tile in (-6..6).flat_map(|i| (-6..6).map(move |j| (i, j))) {
            for object in world.objects(tile) {
                assert_eq!(tile_of(object.anchor.x, object.anchor.y), tile);
                *count.entry(object.class).or_default() += 1;
            }
        }
        let of = |c: Class| count.get(&c).copied().unwrap_or(0);
        for (class, least) in [
            (Class::Tree, 20),
            (Class::Bush, 10),
            (Class::Bench, 4),
            (Class::Pole, 5),
            (Class::Building, 12),
            (Class::Car, 8),
            (Class::Fence, 3),
        ] {
            assert!(of(class) >= least, "seed {seed}: {} {class:?}", of(class));
        }
        assert!(of(Class::Statue) + of(Class::Hedge) > 0, "seed {seed}: {count:?}");
    }
}

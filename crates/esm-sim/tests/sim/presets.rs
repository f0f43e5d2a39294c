//! The presets mirror what they are named after, at full length (ways and worlds alone) and at small scales.

use std::collections::BTreeMap;

use esm_sim::{Class, PRESETS, Path, Preset, Tour, World, WorldKind, preset, tile_of};

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
        let lane = if p.world == WorldKind::Urban { 3.2 } else { 0.0 };
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
            let good = (50..1450)
                .filter(|s| {
                    let s = f64::from(*s);
                    (off(&there, s * share, beside.at(s)) - f64::abs(offset_m)).abs() < 0.8
                })
                .count();
            assert!(good > 1100, "{} {offset_m}: {good} of 1400", p.name);
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

//! The worlds that look alike: that they are, by the figures, and where they are not.

use std::collections::{BTreeMap, BTreeSet};

use esm_sim::{Class, Object, Visit, World, preset, tile_of};

const SEED: u64 = 104;

/// All objects of a world about its route.
fn objects(name: &str, seed: u64, visit: Option<Visit>) -> (World, Vec<Object>) {
    let p = preset(name).unwrap();
    let world = World::new(p.world, seed, p.length_m, visit.unwrap_or(p.map.visit));
    let all = (-12..12).flat_map(|i| (-12..12).map(move |j| (i, j))).flat_map(|t| world.objects(t)).collect();
    (world, all)
}

fn of(all: &[Object], class: Class) -> Vec<&Object> {
    all.iter().filter(|o| o.class == class).collect()
}

/// To the nearest other of some places.
fn nearest(places: &[[f64; 2]]) -> Vec<f64> {
    let off = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    places
        .iter()
        .map(|a| places.iter().filter(|b| *b != a).map(|b| off(a, b)).fold(f64::INFINITY, f64::min))
        .collect()
}

fn places(of: &[&Object]) -> Vec<[f64; 2]> {
    of.iter().map(|o| [o.anchor.x, o.anchor.y]).collect()
}

/// Mean and deviation.
fn spread(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// Share of some places that, moved by a step, lie on others within a tolerance; those whose image is far off all others (it
/// lies beyond the edge) are left out.
fn repeats(places: &[[f64; 2]], step: [f64; 2], within: f64, beyond: f64) -> (usize, f64) {
    let (mut all, mut good) = (0, 0.0);
    for p in places {
        let q = [p[0] + step[0], p[1] + step[1]];
        let off = places.iter().map(|o| (o[0] - q[0]).hypot(o[1] - q[1])).fold(f64::INFINITY, f64::min);
        if off < beyond {
            all += 1;
            good += f64::from(u8::from(off < within));
        }
    }
    (all, good / all.max(1) as f64)
}

/// The direction from a place to its nearest neighbour, that most pairs have, as a unit vector.
fn along(places: &[[f64; 2]], spacing: f64) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for a in places {
        for b in places {
            let d = [b[0] - a[0], b[1] - a[1]];
            if (d[0].hypot(d[1]) - spacing).abs() < 0.05 * spacing {
                // Twice the angle: both directions count alike.
                let turn = 2.0 * d[1].atan2(d[0]);
                sums = [sums[0] + turn.cos(), sums[1] + turn.sin()];
            }
        }
    }
    let turn = 0.5 * sums[1].atan2(sums[0]);
    [turn.cos(), turn.sin()]
}

/// Trees stand where they were planted: 4 m from the next, 5 m between rows, centimetres off; nearly all are of one clone in
/// few forms. Young woods beside: the neighbours of `train-forest` are at all distances.
#[test]
fn a_plantation_is_planted() {
    let (_, all) = objects("plantation", SEED, None);
    let trees = of(&all, Class::Tree);
    assert!(trees.len() > 1200, "{} trees", trees.len());
    let gaps = nearest(&places(&trees));
    let planted: Vec<f64> = gaps.iter().copied().filter(|g| (g - 4.0).abs() < 0.4).collect();
    let (mean, deviation) = spread(&planted);
    assert!(planted.len() as f64 > 0.93 * gaps.len() as f64, "{} of {}", planted.len(), gaps.len());
    assert!((mean - 3.97).abs() < 0.03 && deviation < 0.05, "{mean} m, {deviation} m");
    // A step along or across a row leads to the next tree.
    let at = places(&trees);
    let [x, y] = along(&at, 4.0);
    for step in [[4.0 * x, 4.0 * y], [-5.0 * y, 5.0 * x], [20.0 * x, 20.0 * y], [-20.0 * y, 20.0 * x]] {
        let (n, share) = repeats(&at, step, 0.2, 2.0);
        assert!(n > 900 && share > 0.97, "{step:?}: {share} of {n}");
    }
    // Boles alike: the wood's are not.
    let (_, wood) = objects("train-forest", SEED, None);
    let (mean, deviation) = spread(&nearest(&places(&of(&wood, Class::Tree))));
    assert!(deviation > 0.2 * mean, "{mean} m, {deviation} m");
    // Some odd things, and few.
    let odd = [Class::Rock, Class::Log, Class::Bush, Class::Building].map(|c| of(&all, c).len());
    assert!(odd.iter().sum::<usize>() > 20, "{odd:?}");
}

/// Cars of few models on a lattice of bays, lamp posts every 20 m in the rows and every 16.4 m across.
#[test]
fn a_car_park_is_marked_out() {
    let (_, all) = objects("car-park", SEED, None);
    let lamps = places(&of(&all, Class::Pole));
    let (mean, deviation) = spread(&nearest(&lamps));
    assert!(lamps.len() > 60 && (mean - 16.4).abs() < 0.02 && deviation < 0.02, "{mean} m, {deviation} m");
    let [x, y] = along(&lamps, 20.0);
    let cars: Vec<&Object> = all.iter().filter(|o| matches!(o.class, Class::Car | Class::Van)).collect();
    assert!(cars.len() > 900, "{} cars", cars.len());
    let at = places(&cars);
    for step in [[2.5 * x, 2.5 * y], [-16.4 * y, 16.4 * x]] {
        // Of a bay's neighbours 72 of 100 are taken; beyond 1.6 m is another bay.
        let (n, share) = repeats(&at, step, 0.8, f64::INFINITY);
        assert!((0.6..0.76).contains(&share), "{step:?}: {share} of {n}");
    }
    // Few models: bodies that differ by where they stand and how they are turned alone.
    let mut counts: Vec<usize> = cars.iter().map(|c| c.shapes.len()).collect();
    counts.sort_unstable();
    counts.dedup();
    assert!(counts.len() <= 5, "{counts:?}");
    let odd = of(&all, Class::Bin).len();
    assert!((2..30).contains(&odd), "{odd} odd things");
}

/// One house over and over: fronts every 5.5 m, as wide as that, with the same pieces; walls and bins and lamp posts repeat too.
#[test]
fn terraces_repeat_their_house() {
    let (_, all) = objects("terraces", SEED, None);
    let panes = of(&all, Class::Window);
    let same: Vec<&Object> = {
        // Those beyond the ends are others.
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        panes.iter().for_each(|w| *counts.entry(w.shapes.len()).or_default() += 1);
        let usual = counts.into_iter().max_by_key(|(_, n)| *n).unwrap().0;
        panes.iter().copied().filter(|w| w.shapes.len() == usual).collect()
    };
    assert!(same.len() > 400, "{} houses", same.len());
    let gaps = nearest(&places(&same));
    let next = gaps.iter().filter(|g| (*g - 5.5).abs() < 0.001).count() as f64 / gaps.len() as f64;
    assert!(next > 0.97, "{next} of the fronts are 5.5 m from the next, to the millimetre");
    let at = places(&same);
    let [x, y] = along(&at, 5.5);
    for step in [[5.5 * x, 5.5 * y], [33.0 * x, 33.0 * y], [-52.0 * y, 52.0 * x]] {
        let (n, share) = repeats(&at, step, 0.01, 4.0);
        assert!(n > 300 && share > 0.97, "{step:?}: {share} of {n}");
    }
    // Anchored where they are, and turned to either side: the shapes of all but the odd ones are the same.
    let same_walls = |class: Class| {
        let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
        for o in of(&all, class) {
            *kinds.entry(format!("{:?}", o.shapes)).or_default() += 1;
        }
        let mut counts: Vec<usize> = kinds.into_values().collect();
        counts.sort_unstable_by(|a, b| b.cmp(a));
        counts
    };
    let houses = same_walls(Class::Building);
    assert!(houses[0] > 200 && houses[1] > 200, "both sides of the streets: {:?}", &houses[..4]);
    let odd: usize = houses[2..].iter().sum();
    assert!(odd > 10 && odd * 4 < houses[0] + houses[1], "{odd} others");
    assert!(same_walls(Class::Pole)[0] > 30, "lamp posts of one kind");
    let bins = of(&all, Class::Bin).len();
    assert!(bins as f64 > 0.95 * same.len() as f64, "{bins} bins");
}

/// Each place in the middle looks like the one a step on, and the edges do not: the trees about a place on the route, laid over
/// those about the place moved by one step of the pattern.
#[test]
fn places_repeat_in_the_middle_and_not_at_the_edge() {
    let (world, all) = objects("plantation", SEED, None);
    let at = places(&of(&all, Class::Tree));
    let [x, y] = along(&at, 4.0);
    let route = world.route();
    let alike = |s: f64| {
        let p = route.at(s);
        let about: Vec<_> = at.iter().filter(|q| (p[0] - q[0]).hypot(p[1] - q[1]) < 25.0).copied().collect();
        let moved = |q: &[f64; 2]| [q[0] + 8.0 * x, q[1] + 8.0 * y];
        let met = about.iter().filter(|q| {
            let m = moved(q);
            at.iter().any(|o| (o[0] - m[0]).hypot(o[1] - m[1]) < 0.25)
        });
        met.count() as f64 / about.len().max(1) as f64
    };
    let shares: Vec<f64> = (0..(route.length() / 5.0) as usize).map(|k| alike(5.0 * k as f64)).collect();
    let full = shares.iter().filter(|s| **s > 0.95).count() as f64 / shares.len() as f64;
    let poor = shares.iter().filter(|s| **s < 0.8).count() as f64 / shares.len() as f64;
    assert!(full > 0.3 && poor > 0.1, "{full} of the places repeat, {poor} do not");
}

/// The second visit: as many cars have changed as were asked for, trees are gone, houses are not.
#[test]
fn what_changes_and_what_does_not() {
    for (name, class, share) in [
        ("plantation", Class::Tree, 0.3),
        ("car-park", Class::Car, 0.3),
        ("terraces", Class::Bin, 0.5),
        ("kitti", Class::Tree, 0.6),
    ] {
        let live = preset(name).unwrap().live.visit;
        let (_, before) = objects(name, SEED, None);
        let (_, after) = objects(name, SEED, Some(Visit { changed: Some(share), ..live }));
        let mut after: Vec<&Object> = after.iter().collect();
        after.sort_by_key(|o| o.id);
        let kept = |o: &Object| after.binary_search_by_key(&o.id, |a| a.id).is_ok();
        let things = of(&before, class);
        let gone = things.iter().filter(|o| !kept(o)).count() as f64 / things.len() as f64;
        let sigma = (share * (1.0 - share) / things.len() as f64).sqrt();
        assert!((gone - share).abs() < 4.0 * sigma, "{name}: {gone} of {} {class:?}", things.len());
        assert!(of(&before, Class::Window).iter().all(|o| kept(o)), "{name}: houses last");
    }
}

/// What has changed at one share has changed at every higher one, and at share 0 nothing that can stay is gone.
#[test]
fn changes_grow() {
    for name in ["plantation", "car-park", "terraces", "kitti"] {
        let live = preset(name).unwrap().live.visit;
        let ids = |changed: f64| {
            let (_, all) = objects(name, SEED, Some(Visit { changed: Some(changed), ..live }));
            all.iter().map(|o| o.id).collect::<BTreeSet<_>>()
        };
        let before: BTreeSet<_> = objects(name, SEED, None).1.iter().map(|o| o.id).collect();
        let stayed = |changed| ids(changed).intersection(&before).copied().collect::<BTreeSet<_>>();
        let [none, some, many] = [0.0, 0.2, 0.6].map(stayed);
        assert!(many.is_subset(&some) && some.is_subset(&none), "{name}");
        assert!(many.len() < some.len() && some.len() < none.len(), "{name}");
    }
}

/// Every tile owns what is anchored in it, and no number is given twice, at either visit.
#[test]
fn numbers_are_unique_over_the_whole_world() {
    for name in ["plantation", "car-park", "terraces"] {
        let p = preset(name).unwrap();
        for visit in [p.map.visit, p.live.visit] {
            let world = World::new(p.world, SEED, 4.0 * p.length_m, visit);
            let mut ids = BTreeSet::new();
            let mut n = 0;
            for tile in (-30..30).flat_map(|i| (-30..30).map(move |j| (i, j))) {
                for o in world.objects(tile) {
                    assert_eq!(tile_of(o.anchor.x, o.anchor.y), tile);
                    assert!(o.id != 0 && ids.insert(o.id), "{name}: {:#x} twice", o.id);
                    n += 1;
                }
            }
            assert!(n > 4000, "{name}: {n}");
        }
    }
}

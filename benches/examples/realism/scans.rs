//! Sweeps of the `kitti` preset's sensor at full density beside the full-density scans, with SemanticKITTI's classes.

use std::path::Path;

use esm_io::read_scan;
use esm_sim::{Class, Key, SweepSpec, Tiles, Trajectory, World, preset, sweep};

use crate::figures::{Side, Table, range, roughness, rows, spacing};

/// Scans in towns and villages; 01 and 04 are motorway and country road, 03 is a forest road.
const SCANS: [&str; 8] = ["00", "02", "05", "06", "07", "08", "09", "10"];
/// Sweeps simulated, and worlds they are spread over.
const SWEEPS: u64 = 24;
const WORLDS: u64 = 4;

/// A cloud with the group of each point.
struct Labelled {
    points: Vec<[f32; 3]>,
    groups: Vec<usize>,
}

const GROUPS: [&str; 7] = [
    "ground",
    "vegetation and trunks",
    "buildings",
    "walls and fences",
    "vehicles",
    "poles and signs",
    "other",
];

/// The group of a SemanticKITTI label.
fn group_of_label(label: u16) -> usize {
    match label {
        40 | 44 | 48 | 49 | 60 | 72 => 0,
        70 | 71 => 1,
        50 => 2,
        51 => 3,
        10 | 13 | 15 | 18 | 20 | 252..=259 => 4,
        80 | 81 => 5,
        _ => 6,
    }
}

fn group_of_class(class: Class) -> usize {
    match class {
        Class::Grass | Class::Litter | Class::Track | Class::Road | Class::Pavement => 0,
        Class::Tree | Class::Bush | Class::Hedge | Class::Undergrowth | Class::Log | Class::Stump => 1,
        Class::Building | Class::Window => 2,
        Class::Wall | Class::Fence => 3,
        Class::Car | Class::Van => 4,
        Class::Pole | Class::Sign => 5,
        _ => 6,
    }
}

pub(crate) fn table(shared: &Path, seed: u64) -> Result<Table, Box<dyn std::error::Error>> {
    let real = SCANS
        .iter()
        .map(|n| real_scan(&shared.join("kitti_scans").join(n)))
        .collect::<Result<Vec<_>, _>>()?;
    let sim = simulated(seed)?;
    Ok(Table {
        title: format!(
            "Single sweeps at full density: the first scans of KITTI {} and {SWEEPS} sweeps of the preset `kitti` in {WORLDS} worlds",
            SCANS.join(", ")
        ),
        name: "scans",
        rows: rows(side(&real), side(&sim)),
    })
}

fn real_scan(dir: &Path) -> Result<Labelled, Box<dyn std::error::Error>> {
    let points = read_scan(dir.join("000000.bin"))?.cloud.points().to_vec();
    let bytes = std::fs::read(dir.join("000000.label"))?;
    let groups: Vec<usize> =
        bytes.chunks_exact(4).map(|b| group_of_label(u16::from_le_bytes([b[0], b[1]]))).collect();
    if groups.len() != points.len() {
        return Err(format!("{}: {} labels for {} points", dir.display(), groups.len(), points.len()).into());
    }
    Ok(Labelled { points, groups })
}

fn simulated(seed: u64) -> Result<Vec<Labelled>, Box<dyn std::error::Error>> {
    let preset = preset("kitti")?;
    let sensor = preset.sensor.sensor();
    let mut all = Vec::new();
    for n in 0..WORLDS {
        let world = World::new(preset.world, seed + n, 600.0, preset.map.visit);
        let trajectory =
            Trajectory::new(world.route().clone(), preset.ride(), Key::new(seed), |x, y| world.height(x, y));
        let mut tiles = Tiles::new(&world);
        for k in 0..SWEEPS / WORLDS {
            let stamp_s = 6.0 + 9.0 * k as f64;
            let place = trajectory.pose(stamp_s).translation.vector;
            let scene = tiles.scene(&[place], f64::from(sensor.max_range_m));
            let spec = SweepSpec { sensor: &sensor, stamp_s, undistorted: true, key: Key::new(n).with(k) };
            let points = sweep(&spec, &scene, |t| trajectory.pose(t));
            all.push(Labelled {
                points: points.iter().map(|p| p.xyz).collect(),
                groups: points.iter().map(|p| group_of_class(p.class)).collect(),
            });
        }
    }
    Ok(all)
}

fn side(clouds: &[Labelled]) -> Side {
    let mut side = Side::default();
    side.quantiles(
        "points of a sweep",
        "",
        clouds.iter().map(|c| c.points.len() as f64).collect(),
        &[0.1, 0.5, 0.9],
    );
    let ranges: Vec<f64> = clouds.iter().flat_map(|c| c.points.iter().map(range)).collect();
    side.shares("range", &ranges, &[0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 120.0]);
    side.quantiles("range", "m", ranges, &[0.25, 0.5, 0.75]);
    side.quantiles(
        "spacing",
        "m",
        clouds.iter().flat_map(|c| spacing(&c.points, 29)).collect(),
        &[0.1, 0.5, 0.9],
    );
    let total: usize = clouds.iter().map(|c| c.points.len()).sum();
    for (n, group) in GROUPS.iter().enumerate() {
        let points = clouds.iter().flat_map(|c| &c.groups).filter(|g| **g == n).count();
        side.put(format!("share of {group}"), "%", 100.0 * points as f64 / total as f64);
    }
    for (n, group) in GROUPS.iter().enumerate().take(6) {
        let of = |c: &Labelled| {
            c.points.iter().zip(&c.groups).filter(|(_, g)| **g == n).map(|(p, _)| *p).collect::<Vec<_>>()
        };
        let ranges = clouds.iter().flat_map(|c| of(c).iter().map(range).collect::<Vec<_>>()).collect();
        side.quantiles(&format!("range of {group}"), "m", ranges, &[0.5]);
        let rough = clouds.iter().flat_map(|c| {
            let points = of(c);
            let near: Vec<[f32; 3]> =
                points.iter().filter(|p| range(p) < 25.0).step_by(23).copied().collect();
            roughness(&points, &near, 0.5)
        });
        side.quantiles(
            &format!("roughness of {group} within 0.5 m"),
            "m",
            rough.collect(),
            &[0.25, 0.5, 0.75],
        );
    }
    side
}

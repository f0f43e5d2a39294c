//! Simulated plots beside a real one that a mobile scanner walked through.

use std::path::Path;

use esm_core::segment::{SegmentConfig, ground_flags, segment, voxel_filter};
use esm_core::{PointCloud, Pose};
use esm_io::read_prior_cloud;
use esm_sim::{Class, Key, Scan, Season, Sensor, SweepSpec, Tiles, Visit, World, WorldKind, sweep, tile_of};

use crate::dump;
use crate::figures::{Side, Table, quantile, roughness, rows, spacing, spread};
use crate::stems::{SLICE_M, stems};

/// Half sides of the real plot, metres; simulated ones are as large.
const HALF_M: [f64; 2] = [13.5, 12.9];
/// Simulated plots.
const PLOTS: usize = 4;
/// Only closed stands, as the real one: trees that a plot has at least.
const LEAST_TREES: usize = 25;
/// Both sides are thinned to this first, metres: about the mobile scanner's spacing.
const COMMON_VOXEL_M: f32 = 0.08;
/// Segments are cut from what lies below this, metres above the ground: above, crowns join all.
const LOW_M: f64 = 3.0;

/// Plots of one side, about their middles, with heights above the ground.
struct Plot {
    points: Vec<[f32; 3]>,
    heights: Vec<f64>,
}

pub(crate) fn table(shared: &Path, seed: u64, work: &Path) -> Result<Table, Box<dyn std::error::Error>> {
    let cloud = read_prior_cloud(shared.join("forest/plot_mls.laz"))?.cloud;
    let mut middle = [0.0f64; 3];
    for p in cloud.points() {
        (0..3).for_each(|a| middle[a] += f64::from(p[a]) / cloud.len() as f64);
    }
    let about = |p: &[f32; 3]| std::array::from_fn(|a| p[a] - middle[a] as f32);
    let real = [Plot::new(cloud.points().iter().map(about).collect())];
    let visit = Visit { number: 0, season: Season::May, change: 0.0, changed: None };
    let world = World::new(WorldKind::Forest, seed, 900.0, visit);
    let sim: Vec<Plot> = (0..40)
        .map(|n| plot_middle(&world, n))
        .filter(|at| trees(&world, *at) >= LEAST_TREES)
        .take(PLOTS)
        .enumerate()
        .map(|(n, at)| simulated(&world, at, Key::new(seed).with(n as u64)))
        .collect();
    let ((real, real_segments), (sim, sim_segments)) = (side(&real), side(&sim));
    dump::segments(&work.join("forest_real.bin"), &real_segments)?;
    dump::segments(&work.join("forest_sim.bin"), &sim_segments)?;
    Ok(Table {
        title: format!(
            "A wood: the conifer plot of 27 x 26 m as a mobile scanner saw it (`plot_mls.laz`) and {PLOTS} simulated plots of that \
             size, scanned from 9 places each"
        ),
        name: "forest",
        rows: rows(real, sim),
    })
}

/// A scanner that sees almost all around: 0.36 degrees a step.
fn scanner() -> Sensor {
    Sensor {
        name: "plot scanner",
        turn: nalgebra::Rotation3::identity(),
        scan: Scan::Spinning {
            elevations: |n| (-60.0 + 0.36 * n as f64).to_radians(),
            lasers: 416,
            steps: 1000,
        },
        period_s: 1.0,
        active_s: 1.0,
        min_range_m: 0.5,
        max_range_m: 50.0,
        range_10_percent_m: 40.0,
        noise_m: 0.02,
        offset_m: 0.0,
        unit: 0,
        divergence_rad: 0.002,
        source: "after the mobile scanner of the plot",
    }
}

/// A place 40 m off the trail.
fn plot_middle(world: &World, n: u32) -> [f64; 2] {
    let s = 20.0 + 31.0 * f64::from(n);
    let (p, heading) = (world.route().at(s), world.route().heading(s, 5.0));
    [p[0] - 40.0 * heading.sin(), p[1] + 40.0 * heading.cos()]
}

/// Trees that stand on a plot.
fn trees(world: &World, [x, y]: [f64; 2]) -> usize {
    let on_it = |o: &esm_sim::Object| {
        o.class == Class::Tree && (o.anchor.x - x).abs() < HALF_M[0] && (o.anchor.y - y).abs() < HALF_M[1]
    };
    tiles_of(x, y).into_iter().flat_map(|t| world.objects(t)).filter(on_it).count()
}

fn simulated(world: &World, [x, y]: [f64; 2], key: Key) -> Plot {
    let (sensor, mut tiles, mut points) = (scanner(), Tiles::new(world), Vec::new());
    for k in 0..9 {
        let (dx, dy) = (f64::from(k % 3 - 1) * 9.0, f64::from(k / 3 - 1) * 9.0);
        let at = Pose::translation(x + dx, y + dy, world.height(x + dx, y + dy) + 1.5);
        let scene = tiles.scene(&[at.translation.vector], f64::from(sensor.max_range_m));
        let spec = SweepSpec { sensor: &sensor, stamp_s: 0.0, undistorted: true, key: key.with(k as u64) };
        let z = (at.translation.z - world.height(x, y)) as f32;
        points.extend(
            sweep(&spec, &scene, |_| at)
                .iter()
                .map(|p| [p.xyz[0] + dx as f32, p.xyz[1] + dy as f32, p.xyz[2] + z])
                .filter(|p| f64::from(p[0]).abs() < HALF_M[0] && f64::from(p[1]).abs() < HALF_M[1]),
        );
    }
    eprintln!("plot at {x:.0} {y:.0}: {} points, {} trees stand on it", points.len(), trees(world, [x, y]));
    Plot::new(points)
}

fn tiles_of(x: f64, y: f64) -> Vec<(i32, i32)> {
    let (low, high) = (tile_of(x - HALF_M[0], y - HALF_M[1]), tile_of(x + HALF_M[0], y + HALF_M[1]));
    (low.0..=high.0).flat_map(|i| (low.1..=high.1).map(move |j| (i, j))).collect()
}

impl Plot {
    /// Thinned, with heights above a ground of 1 m cells.
    fn new(points: Vec<[f32; 3]>) -> Self {
        let points = voxel_filter(&points, COMMON_VOXEL_M);
        let coarse = voxel_filter(&points, 0.2);
        let flags = ground_flags(&coarse, &SegmentConfig::default().ground);
        const CELLS: i32 = 32;
        let cell = |p: &[f32; 3]| {
            let at = |v: f32| (v.floor() as i32 + CELLS / 2).clamp(0, CELLS - 1);
            (at(p[0]), at(p[1]))
        };
        let mut found: Vec<Vec<f64>> = vec![Vec::new(); (CELLS * CELLS) as usize];
        for p in coarse.iter().zip(flags).filter(|(_, ground)| *ground).map(|(p, _)| p) {
            let (i, j) = cell(p);
            found[(j * CELLS + i) as usize].push(f64::from(p[2]));
        }
        // The median of the ground points around: a few metres where trees hide them.
        let level = |i: i32, j: i32| {
            (1..CELLS).find_map(|reach| {
                let mut near: Vec<f64> = (j - reach..=j + reach)
                    .flat_map(|q| (i - reach..=i + reach).map(move |p| (p, q)))
                    .filter(|(p, q)| (0..CELLS).contains(p) && (0..CELLS).contains(q))
                    .flat_map(|(p, q)| found[(q * CELLS + p) as usize].iter().copied())
                    .collect();
                near.sort_by(f64::total_cmp);
                (!near.is_empty()).then(|| quantile(&near, 0.5))
            })
        };
        let levels: Vec<f64> =
            (0..CELLS * CELLS).map(|n| level(n % CELLS, n / CELLS).unwrap_or(0.0)).collect();
        let heights = points
            .iter()
            .map(|p| {
                let (i, j) = cell(p);
                f64::from(p[2]) - levels[(j * CELLS + i) as usize]
            })
            .collect();
        Self { points, heights }
    }

    /// Heights of the occupied voxels of 0.2 m: how densely a scanner samples does not count, only what it reached.
    fn occupied(&self) -> Vec<f64> {
        let voxel = |p: &[f32; 3]| p.map(|v| (v / 0.2).floor() as i32);
        let mut all: Vec<_> = self.points.iter().map(voxel).zip(self.heights.iter().copied()).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        all.dedup_by_key(|(v, _)| *v);
        all.into_iter().map(|(_, h)| h).collect()
    }

    fn between(&self, low: f64, high: f64) -> Vec<[f32; 3]> {
        let inside = self.points.iter().zip(&self.heights).filter(|(_, h)| (low..high).contains(*h));
        inside.map(|(p, _)| *p).collect()
    }
}

fn side(plots: &[Plot]) -> (Side, Vec<Vec<[f32; 3]>>) {
    let mut side = Side::default();
    let hectares = plots.len() as f64 * 4.0 * HALF_M[0] * HALF_M[1] / 1e4;
    // Stems, their size and room.
    let found: Vec<Vec<_>> = plots.iter().map(|p| stems(&p.between(SLICE_M.start, SLICE_M.end))).collect();
    let all = || found.iter().flatten();
    side.put("stems found at breast height", "per ha", all().count() as f64 / hectares);
    side.quantiles("diameter at breast height", "m", all().map(|s| s.diameter).collect(), &[0.25, 0.5, 0.75]);
    let nearest = found.iter().flat_map(|stems| {
        stems.iter().enumerate().filter_map(|(n, a)| {
            let others = stems.iter().enumerate().filter(|(k, _)| *k != n);
            others.map(|(_, b)| (a.x - b.x).hypot(a.y - b.y)).min_by(f64::total_cmp)
        })
    });
    side.quantiles("to the next stem", "m", nearest.collect(), &[0.25, 0.5, 0.75]);
    // Where the returns are.
    let mut heights: Vec<f64> = plots.iter().flat_map(|p| p.heights.clone()).collect();
    heights.sort_by(f64::total_cmp);
    let top = quantile(&heights, 0.99);
    side.put("height, 99 % of the points", "m", top);
    let coarse: Vec<Vec<[f32; 3]>> =
        plots.iter().map(|p| voxel_filter(&p.between(0.3, f64::MAX), 0.2)).collect();
    let area = hectares * 1e4;
    side.put(
        "voxels of 0.2 m on a square metre",
        "",
        coarse.iter().map(Vec::len).sum::<usize>() as f64 / area,
    );
    let shares = [0.0, 0.1, 0.25, 0.5, 0.75, 1.2];
    // Of what stands: the survey holds hardly any ground.
    let standing: Vec<f64> = plots.iter().flat_map(Plot::occupied).filter(|h| *h >= 0.3).collect();
    let relative: Vec<f64> = standing.iter().map(|h| h / top).collect();
    for e in shares.windows(2) {
        let inside = relative.iter().filter(|h| (e[0]..e[1]).contains(*h)).count();
        let name = format!("voxels at {:.0} to {:.0} % of the height", 100.0 * e[0], 100.0 * e[1].min(1.0));
        side.put(name, "%", 100.0 * inside as f64 / standing.len() as f64);
    }
    side.shares("voxels at", &standing, &[0.3, 1.0, 2.0, 4.0, 8.0]);
    side.quantiles(
        "spacing after 0.2 m voxels",
        "m",
        coarse.iter().flat_map(|c| spacing(c, 17)).collect(),
        &[0.1, 0.5, 0.9],
    );
    // Texture of trunks and of crowns.
    for (name, low, high) in [("1 to 3 m up", 1.0, 3.0), ("in the crowns", 0.4 * top, 0.8 * top)] {
        let rough = plots.iter().flat_map(|p| {
            let points = p.between(low, high);
            let asked: Vec<[f32; 3]> = points.iter().step_by(41).copied().collect();
            roughness(&points, &asked, 0.4)
        });
        side.quantiles(&format!("roughness {name}"), "m", rough.collect(), &[0.25, 0.5, 0.75]);
    }
    // What segmentation makes of the lowest metres.
    let config = SegmentConfig::default();
    let mut segments = Vec::new();
    for plot in plots {
        let low = PointCloud::from_finite(plot.between(-1.0, LOW_M)).0;
        segments.extend(segment(&low, &config).segments);
    }
    side.put("segments below 3 m", "per ha", segments.len() as f64 / hectares);
    side.quantiles(
        "points of a segment",
        "",
        segments.iter().map(|s| s.points.len() as f64).collect(),
        &[0.25, 0.5, 0.75],
    );
    let radius = segments.iter().map(|s| {
        let l = spread(&s.points.iter().map(|p| [p[0], p[1], 0.0]).collect::<Vec<_>>());
        (l[0] + l[1]).sqrt()
    });
    side.quantiles("radius of a segment", "m", radius.collect(), &[0.25, 0.5, 0.75]);
    side.quantiles(
        "height of a segment",
        "m",
        segments.iter().map(|s| f64::from(s.max[2] - s.min[2])).collect(),
        &[0.25, 0.5, 0.75],
    );
    (side, segments.into_iter().map(|s| s.points).collect())
}

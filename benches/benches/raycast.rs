//! Rays a second on one core: whole sweeps of an HDL-64E (133,312 rays) in each world, foliage, noise and mixed pixels
//! included, and the making of a tile. No thread pool takes part: criterion calls on one thread. Rates are of rays fired.

#![allow(missing_docs)] // Criterion's macros.

use std::sync::Arc;
use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use esm_sim::{
    Key, Movers, Season, SensorModel, SweepSpec, Tiles, Trajectory, Visit, World, WorldKind, preset, sweep,
    sweep_among,
};

fn raycast(c: &mut Criterion) {
    let sensor = SensorModel::Hdl64e.sensor();
    let visit = Visit { number: 0, season: Season::May, change: 0.0, changed: None };
    for (name, kind) in
        [("forest", WorldKind::Forest), ("park", WorldKind::Park), ("urban", WorldKind::Urban)]
    {
        let world = World::new(kind, 100, 500.0, visit);
        let ride = preset("train-urban").expect("a preset").ride();
        let height = |x, y| world.height(x, y);
        let trajectory = Arc::new(Trajectory::new(world.route().clone(), ride, Key::new(1), height));
        let places: Vec<_> =
            (1..=4).map(|n| trajectory.pose(f64::from(n) * 12.0).translation.vector).collect();
        let scene = Tiles::new(&world).scene(&places, f64::from(sensor.max_range_m));
        let mut group = c.benchmark_group(format!("raycast, {name}, {} shapes", scene.leaves()));
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(300))
            .measurement_time(Duration::from_secs(3));
        group.throughput(Throughput::Elements(4 * sensor.rays() as u64));
        group.bench_function("4 sweeps HDL-64E", |b| {
            b.iter(|| {
                (1..=4)
                    .map(|n| {
                        let stamp_s = f64::from(n) * 12.0;
                        let spec = SweepSpec {
                            sensor: &sensor,
                            stamp_s,
                            undistorted: true,
                            key: Key::new(n as u64),
                        };
                        sweep(&spec, &scene, |t| trajectory.pose(t)).len()
                    })
                    .sum::<usize>()
            });
        });
        let movers = Movers::new(&world, Arc::clone(&trajectory), (0.0, 60.0), 1.0, Key::new(2));
        group.bench_function("4 sweeps HDL-64E, people and cars about", |b| {
            b.iter(|| {
                (1..=4)
                    .map(|n| {
                        let stamp_s = f64::from(n) * 12.0;
                        let spec = SweepSpec {
                            sensor: &sensor,
                            stamp_s,
                            undistorted: true,
                            key: Key::new(n as u64),
                        };
                        sweep_among(&spec, &scene, &movers, |t| trajectory.pose(t)).len()
                    })
                    .sum::<usize>()
            });
        });
        group.throughput(Throughput::Elements(1));
        group.bench_function("a tile of 32 m", |b| b.iter(|| world.tile((1, 1)).leaves()));
        group.finish();
    }
}

criterion_group!(benches, raycast);
criterion_main!(benches);

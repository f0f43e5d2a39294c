use esm_sim::*;
use std::time::Instant;
fn main() {
    let sensor = SensorModel::Hdl64e.sensor();
    let visit = Visit { number: 0, season: Season::May, change: 0.0 };
    for (name, kind) in [("forest", WorldKind::Forest), ("urban", WorldKind::Urban)] {
        let world = World::new(kind, 100, 500.0, visit);
        let ride = preset("train-urban").unwrap().ride();
        let trajectory = Trajectory::new(world.route().clone(), ride, Key::new(1), |x, y| world.height(x, y));
        let places: Vec<_> =
            (1..=1).map(|n| trajectory.pose(f64::from(n) * 12.0).translation.vector).collect();
        let t = Instant::now();
        let scene = Tiles::new(&world).scene(&places, f64::from(sensor.max_range_m));
        println!("{name} {} leaves, scene {:?}", scene.leaves(), t.elapsed());
        for _ in 0..2 {
            let cpu = cpu();
            let spec = SweepSpec { sensor: &sensor, stamp_s: 12.0, undistorted: true, key: Key::new(1) };
            let n = sweep(&spec, &scene, |t| trajectory.pose(t)).len();
            let c = cpu_since(cpu);
            println!("{n} points, cpu {c:.3} s, {:.2} M rays/s", sensor.rays() as f64 / c * 1e-6);
        }
    }
}
fn cpu() -> f64 {
    let s = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    s.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}
fn cpu_since(a: f64) -> f64 {
    cpu() - a
}

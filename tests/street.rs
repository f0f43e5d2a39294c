//! A block of streets: houses, walls, parked cars, poles and trees on gently rolling ground, as points.

use esm_core::{PointCloud, Pose, transform_point};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Spacing of points on surfaces, metres.
const SPACING_M: f64 = 0.22;
/// The block's corners, metres; the street runs around it.
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [90.0, 0.0], [90.0, 60.0], [0.0, 60.0]];
/// How far a sweep sees, metres.
const RANGE_M: f64 = 28.0;
/// Share of the points in range that a sweep returns.
const RETURNED: f64 = 0.4;
/// Range noise, metres.
const NOISE_M: f64 = 0.02;
/// Height of the sensor above the ground, metres.
const SENSOR_HEIGHT_M: f64 = 1.8;

/// The points of the world, in the world's frame.
pub struct Street {
    points: Vec<[f64; 3]>,
}

/// One sweep of a drive.
pub struct Sweep {
    /// Seconds.
    pub stamp: f64,
    /// In the sensor frame.
    pub cloud: PointCloud,
    /// Where the sensor truly is.
    pub pose_world_sensor: Pose,
}

impl Street {
    /// The world of a seed.
    pub fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut street = Self { points: Vec::new() };
        street.ground(&mut rng);
        for side in 0..4 {
            let (a, b) = (CORNERS[side], CORNERS[(side + 1) % 4]);
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
            let right = [along[1], -along[0]];
            for sign in [-1.0, 1.0] {
                let mut s = 6.0;
                while s < length - 6.0 {
                    let off = sign * rng.random_range(5.5..9.0);
                    let at = [a[0] + s * along[0] + off * right[0], a[1] + s * along[1] + off * right[1]];
                    s += street.object(at, along, &mut rng);
                }
            }
        }
        street
    }

    /// Drives around the block and on: `metres` of travel from the first corner, a sweep every 2 m and half second,
    /// `lane_m` to the right of the middle.
    pub fn drive(&self, metres: f64, lane_m: f64, start_stamp: f64, seed: u64) -> Vec<Sweep> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        (0..=(metres / 2.0) as usize)
            .map(|i| {
                let pose_world_sensor = pose_along(2.0 * i as f64, lane_m);
                let cloud = self.sweep(&pose_world_sensor, &mut rng);
                Sweep { stamp: start_stamp + 0.5 * i as f64, cloud, pose_world_sensor }
            })
            .collect()
    }

    fn sweep(&self, pose_world_sensor: &Pose, rng: &mut ChaCha8Rng) -> PointCloud {
        let at = pose_world_sensor.translation.vector;
        let pose_sensor_world = pose_world_sensor.inverse();
        let mut points = Vec::new();
        for p in &self.points {
            let near = (p[0] - at.x).hypot(p[1] - at.y) < RANGE_M;
            if near && rng.random_bool(RETURNED) {
                let noisy = p.map(|v| v + rng.random_range(-NOISE_M..NOISE_M));
                let p = pose_sensor_world * nalgebra::Point3::from(noisy);
                points.push([p.x as f32, p.y as f32, p.z as f32]);
            }
        }
        PointCloud::from_finite(points).0
    }

    fn ground(&mut self, rng: &mut ChaCha8Rng) {
        let step = 0.45;
        for i in -70..=300 {
            for j in -70..=230 {
                let [x, y] = [i, j].map(|n| f64::from(n) * step + rng.random_range(-0.1..0.1));
                // Nothing is seen of the ground inside the block.
                let inside = (14.0..76.0).contains(&x) && (14.0..46.0).contains(&y);
                if !inside {
                    self.points.push([x, y, ground_height(x, y)]);
                }
            }
        }
    }

    /// Puts something up and says how much room it takes along the street, metres.
    fn object(&mut self, at: [f64; 2], along: [f64; 2], rng: &mut ChaCha8Rng) -> f64 {
        match rng.random_range(0..6) {
            0 => {
                let size =
                    [rng.random_range(5.0..11.0), rng.random_range(3.0..6.0), rng.random_range(3.0..7.0)];
                self.block(at, along, size);
                size[0] + rng.random_range(3.0..6.0)
            }
            1 => {
                let size = [rng.random_range(3.6..4.8), 1.8, rng.random_range(1.3..1.9)];
                self.block(at, along, size);
                size[0] + rng.random_range(2.0..5.0)
            }
            2 => {
                self.block(at, along, [rng.random_range(3.0..9.0), 0.3, rng.random_range(1.2..2.2)]);
                rng.random_range(9.0..12.0)
            }
            3 => {
                self.block(at, along, [0.35, 0.35, rng.random_range(4.0..7.0)]);
                rng.random_range(3.0..5.0)
            }
            _ => {
                self.tree(at, rng);
                rng.random_range(5.0..8.0)
            }
        }
    }

    /// The sides and the top of a box that stands on the ground: length along the street, width, height.
    fn block(&mut self, at: [f64; 2], along: [f64; 2], [length, width, height]: [f64; 3]) {
        let base = ground_height(at[0], at[1]);
        let steps = |size: f64| (size / SPACING_M).ceil().max(1.0) as usize;
        let (nl, nw, nh) = (steps(length), steps(width), steps(height));
        for i in 0..=nl {
            for j in 0..=nw {
                for k in 0..=nh {
                    let shell = i == 0 || i == nl || j == 0 || j == nw || k == nh;
                    if !shell {
                        continue;
                    }
                    let u = length * (i as f64 / nl as f64 - 0.5);
                    let v = width * (j as f64 / nw as f64 - 0.5);
                    let x = at[0] + u * along[0] - v * along[1];
                    let y = at[1] + u * along[1] + v * along[0];
                    self.points.push([x, y, base + height * k as f64 / nh as f64]);
                }
            }
        }
    }

    fn tree(&mut self, at: [f64; 2], rng: &mut ChaCha8Rng) {
        let base = ground_height(at[0], at[1]);
        let (trunk, radius) = (rng.random_range(1.5..3.0), rng.random_range(0.9..2.2));
        let stretch = rng.random_range(0.8..1.6);
        for i in 0..(trunk / 0.1) as usize {
            let angle = 2.4 * i as f64;
            self.points.push([at[0] + 0.18 * angle.cos(), at[1] + 0.18 * angle.sin(), base + 0.1 * i as f64]);
        }
        // A crown of leaves on a lumpy ball, no two alike.
        let lumps: Vec<f64> = (0..6).map(|_| rng.random_range(0.7..1.3)).collect();
        for i in 0..(260.0 * radius * radius) as usize {
            let z: f64 = rng.random_range(-1.0..1.0);
            let turn: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let lump = lumps[((turn / std::f64::consts::TAU * 6.0) as usize).min(5)];
            let r = radius * lump * (1.0 - z * z).sqrt();
            let height = base + trunk + radius * stretch * (1.0 + z);
            self.points.push([at[0] + r * turn.cos(), at[1] + r * turn.sin(), height + 0.1 * (i % 3) as f64]);
        }
    }
}

fn ground_height(x: f64, y: f64) -> f64 {
    0.4 * (0.05 * x).sin() + 0.3 * (0.07 * y).cos()
}

/// The sensor's pose after some metres around the block, counter-clockwise, `lane_m` right of the middle.
fn pose_along(metres: f64, lane_m: f64) -> Pose {
    let lengths: Vec<f64> =
        (0..4).map(|i| (0..2).map(|a| (CORNERS[(i + 1) % 4][a] - CORNERS[i][a]).abs()).sum()).collect();
    let mut s = metres.rem_euclid(lengths.iter().sum());
    let mut side = 0;
    while s > lengths[side] {
        s -= lengths[side];
        side = (side + 1) % 4;
    }
    let (a, b) = (CORNERS[side], CORNERS[(side + 1) % 4]);
    let heading = (b[1] - a[1]).atan2(b[0] - a[0]);
    // Corners are turned over 12 m, to the next side's heading.
    let to_corner = lengths[side] - s;
    let turning = |d: f64| 0.5 * (1.0 - (d / 6.0).min(1.0));
    let turn = std::f64::consts::FRAC_PI_2 * (turning(to_corner) - turning(s));
    let (sin, cos) = heading.sin_cos();
    let x = a[0] + s * cos + lane_m * sin;
    let y = a[1] + s * sin - lane_m * cos;
    let z = ground_height(x, y) + SENSOR_HEIGHT_M;
    Pose::new(Vector3::new(x, y, z), Vector3::z() * (heading + turn))
}

/// All points of a drive in the world's frame: a prior cloud of it.
pub fn prior_cloud(drive: &[Sweep]) -> Vec<[f32; 3]> {
    drive
        .iter()
        .flat_map(|s| s.cloud.points().iter().map(|p| transform_point(&s.pose_world_sensor, *p)))
        .collect()
}

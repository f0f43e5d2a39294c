//! Poses of the sensor in time: a vehicle that follows a path over the terrain.

use esm_core::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::path::Path;
use crate::hash::Key;
use crate::noise::value;

/// How a vehicle rides and where its sensor sits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ride {
    /// Mean speed, m/s.
    pub speed_mps: f64,
    /// Wheel base, metres: the slope it feels is that between its wheels.
    pub wheel_base_m: f64,
    /// Height of the sensor above the ground, metres.
    pub sensor_height_m: f64,
    /// Standard deviation of the ride's own pitch and roll, radians: suspension and small stones.
    pub shake_rad: f64,
    /// How far it wanders off the path, metres (standard deviation about).
    pub wander_m: f64,
    /// The sensor's mounting on the level vehicle (x forward, z up).
    pub rotation_body_sensor: UnitQuaternion<f64>,
}

/// The exact motion of a sensor. Times are seconds from the start.
pub struct Trajectory<'a> {
    path: Path,
    lane: Option<Path>,
    ride: Ride,
    key: Key,
    height: Box<dyn Fn(f64, f64) -> f64 + Send + Sync + 'a>,
}

impl<'a> Trajectory<'a> {
    /// A ride along a path over a terrain.
    pub fn new(
        path: Path,
        ride: Ride,
        key: Key,
        height: impl Fn(f64, f64) -> f64 + Send + Sync + 'a,
    ) -> Self {
        Self { path, lane: None, ride, key, height: Box::new(height) }
    }

    /// The same ride where all others keep to `lane`, beside which it goes.
    pub fn beside(self, lane: Path) -> Self {
        Self { lane: Some(lane), ..self }
    }

    /// The way that others take who go where this ride goes, where it is not this one's own.
    pub fn lane(&self) -> Option<&Path> {
        self.lane.as_ref()
    }

    /// The way over the ground that is followed.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Length of the ride in metres of the path.
    pub fn length(&self) -> f64 {
        self.path.length()
    }

    /// Arc length along the path at a time: the mean speed, varied smoothly by up to a fifth over some seconds.
    pub fn travelled(&self, seconds: f64) -> f64 {
        let (period, share) = (17.0, 0.2);
        let phase = std::f64::consts::TAU * f64::from(self.key.with(1).unit());
        let omega = std::f64::consts::TAU / period;
        let vary = |t: f64| share / omega * (phase - omega * t).cos();
        self.ride.speed_mps * (seconds + vary(seconds) - vary(0.0))
    }

    /// The time at which an arc length is reached, by bisection: the speed is always positive.
    pub fn time_at(&self, metres: f64) -> f64 {
        let (mut low, mut high) = (0.0, metres / self.ride.speed_mps * 1.3 + 10.0);
        for _ in 0..60 {
            let mid = 0.5 * (low + high);
            if self.travelled(mid) < metres { low = mid } else { high = mid }
        }
        0.5 * (low + high)
    }

    /// Position over the ground: the path with the driver's wandering.
    fn ground(&self, s: f64) -> [f64; 2] {
        let (p, heading) = (self.path.at(s), self.path.heading(s, 1.5));
        let off = self.ride.wander_m * 1.7 * value(self.key.with(2), s / 23.0, 0.5);
        [p[0] - off * heading.sin(), p[1] + off * heading.cos()]
    }

    /// `pose_map_sensor` at a time.
    pub fn pose(&self, seconds: f64) -> Pose {
        let s = self.travelled(seconds);
        let half = 0.5 * self.ride.wheel_base_m;
        let (rear, front) = (self.ground(s - half), self.ground(s + half));
        let (dx, dy) = (front[0] - rear[0], front[1] - rear[1]);
        // At the ends of the path the wheels meet: the path's heading serves.
        let yaw = if dx.hypot(dy) > 0.2 * half { dy.atan2(dx) } else { self.path.heading(s, 1.5) };
        let at = self.ground(s);
        let (c, sn) = (yaw.cos(), yaw.sin());
        // Wheels average over their own size.
        let z = |forward: f64, left: f64| {
            (self.height)(at[0] + forward * c - left * sn, at[1] + forward * sn + left * c)
        };
        let track = 0.35 * self.ride.wheel_base_m;
        let wheels = [z(half, track), z(half, -track), z(-half, track), z(-half, -track)];
        let pitch = -((wheels[0] + wheels[1] - wheels[2] - wheels[3]) / (4.0 * half)).atan();
        let roll = ((wheels[0] + wheels[2] - wheels[1] - wheels[3]) / (4.0 * track)).atan();
        let shake = |n: u64| {
            let t = seconds * 2.0;
            self.ride.shake_rad
                * (value(self.key.with(n), t, 0.0) + 0.6 * value(self.key.with(n), 4.0 * t, 9.0))
                * 1.6
        };
        let rotation = UnitQuaternion::from_euler_angles(roll + shake(3), pitch + shake(4), yaw);
        let ground = Vector3::new(at[0], at[1], wheels.iter().sum::<f64>() / 4.0);
        let position = ground + rotation * Vector3::new(0.0, 0.0, self.ride.sensor_height_m);
        Pose::from_parts(Translation3::from(position), rotation * self.ride.rotation_body_sensor)
    }
}

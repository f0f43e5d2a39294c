//! One sweep: rays cast along the motion, with noise, lost returns and mixed edges.

use esm_core::Pose;
use nalgebra::Vector3;

use super::models::Sensor;
use crate::cast::{Hit, Ray, Scene};
use crate::hash::Key;
use crate::movers::{Crowd, Movers, Present};
use crate::world::Class;

/// Returns lost whatever they hit: interference, calibration, packets.
const LOST: f32 = 0.004;
/// Share of the rays that hit objects whose cone is looked at twice.
const MIXED_SHARE: f32 = 0.15;
/// Two surfaces nearer to each other than this are one pulse to the receiver, metres: about half of a 5 ns pulse's length.
const PULSE_M: f32 = 0.6;
/// Steps a metre that coordinates are rounded to: the 2 mm step of Velodyne's packets. It halves the recordings.
const STEPS_PER_M: f32 = 512.0;

/// One measured point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Metres, sensor frame.
    pub xyz: [f32; 3],
    /// Strength of the return, 0 to 255.
    pub intensity: f32,
    /// Seconds from the sweep's stamp, 0 or before.
    pub time: f32,
    /// The object that was hit, 0 for the ground.
    pub object_id: u32,
    /// The laser, from the lowest up.
    pub ring: u16,
    /// What was hit.
    pub class: Class,
}

/// What a sweep is made with.
pub struct SweepSpec<'a> {
    /// The sensor.
    pub sensor: &'a Sensor,
    /// Time of the sweep's end, which is its stamp, seconds from the start.
    pub stamp_s: f64,
    /// Whether points are told in the sensor frame at the stamp, as if perfectly undistorted (KITTI's are), or each in the
    /// sensor frame at its own time, as they leave the sensor.
    pub undistorted: bool,
    /// The sweep's random stream.
    pub key: Key,
}

/// Casts the rays of one sweep in firing order. `pose_map_sensor` is asked at times from the start of the sweep to its
/// stamp. The same arguments give the same bits.
pub fn sweep(spec: &SweepSpec<'_>, scene: &Scene, pose_map_sensor: impl Fn(f64) -> Pose) -> Vec<Point> {
    sweep_with(spec, scene, None, pose_map_sensor)
}

/// The same with things that move: every beam meets them where they are when it is fired.
pub fn sweep_among(
    spec: &SweepSpec<'_>,
    scene: &Scene,
    movers: &Movers<'_>,
    pose_map_sensor: impl Fn(f64) -> Pose,
) -> Vec<Point> {
    sweep_with(spec, scene, Some(movers), pose_map_sensor)
}

fn sweep_with(
    spec: &SweepSpec<'_>,
    scene: &Scene,
    movers: Option<&Movers<'_>>,
    pose_map_sensor: impl Fn(f64) -> Pose,
) -> Vec<Point> {
    let sensor = spec.sensor;
    let at_stamp = pose_map_sensor(spec.stamp_s);
    let range = f64::from(sensor.max_range_m);
    let crowd = movers.map_or_else(Crowd::default, |movers| {
        Crowd::new(movers, spec.stamp_s, sensor.active_s, at_stamp.translation.vector, range, scene.origin())
    });
    let mut present = Vec::new();
    let offsets = sensor.offsets();
    // The motion within a sweep in 64 pieces: 1.6 ms each at 10 Hz.
    const PIECES: usize = 64;
    let poses: Vec<Pose> = (0..=PIECES)
        .map(|n| pose_map_sensor(spec.stamp_s - sensor.active_s * (1.0 - n as f64 / PIECES as f64)))
        .collect();
    let mut points = Vec::with_capacity(sensor.rays() / 2);
    let mut ray = 0;
    for firing in sensor.firings() {
        let piece = firing.share * PIECES as f64;
        let k = (piece as usize).min(PIECES - 1);
        let (a, b, t) = (&poses[k], &poses[k + 1], piece - k as f64);
        let at = a.translation.vector + (b.translation.vector - a.translation.vector) * t;
        let rotation = a.rotation.nlerp(&b.rotation, t).to_rotation_matrix();
        let origin = (at - scene.origin()).cast::<f32>();
        let time = (-(1.0 - firing.share) * sensor.active_s) as f32;
        if !crowd.is_empty()
            && let (Some(first), Some(last)) = (firing.dirs.first(), firing.dirs.last())
        {
            let ends = [*first, *last].map(|d| (rotation * Vector3::from(d)).cast::<f32>());
            crowd.firing(firing.share, origin, (ends[0], ends[1]), &mut present);
        }
        let surroundings = Surroundings { sensor, scene, present: &present, origin };
        for (ring, dir) in firing.dirs.iter().enumerate() {
            let dir = Vector3::from(*dir);
            let key = spec.key.with(ray);
            ray += 1;
            let along = (rotation * dir).cast::<f32>();
            let Some((hit, range)) = surroundings.measure(along, offsets[ring], key) else { continue };
            let local = dir * f64::from(range);
            let local = if spec.undistorted {
                at_stamp.inverse_transform_vector(&(rotation * local + at - at_stamp.translation.vector))
            } else {
                local
            };
            let strength = hit.class.reflectivity() * hit.cos_incidence.max(0.1);
            points.push(Point {
                xyz: local.map(|v| (v as f32 * STEPS_PER_M).round() / STEPS_PER_M).into(),
                intensity: (255.0 * strength * (0.85 + 0.3 * key.with(7).unit())).clamp(0.0, 255.0).round(),
                time,
                object_id: hit.object_id,
                ring: ring as u16,
                class: hit.class,
            });
        }
    }
    points
}

/// What the beams of one firing meet.
struct Surroundings<'a> {
    sensor: &'a Sensor,
    scene: &'a Scene,
    present: &'a [Present<'a>],
    /// The sensor about the scene's origin.
    origin: Vector3<f32>,
}

impl Surroundings<'_> {
    /// One pulse of a laser whose ranges are off by `offset`: what it hits and the range that is measured.
    fn measure(&self, along: Vector3<f32>, offset: f32, key: Key) -> Option<(Hit, f32)> {
        let sensor = self.sensor;
        let mut draw = key.draw();
        let (lost, mixed, detected) = (draw.unit(), draw.unit(), draw.unit());
        if lost < LOST {
            return None;
        }
        // Within the beam's cone: the strongest part of the spot is at a random place near its middle.
        let side = along.cross(&Vector3::z()).try_normalize(1e-3).unwrap_or_else(Vector3::x);
        let up = side.cross(&along);
        let spot = |u: f32, v: f32| along + (side * u + up * v) * (0.5 * sensor.divergence_rad);
        let dir = spot(draw.range(-0.6, 0.6), draw.range(-0.6, 0.6));
        let mut hit = self.cast(dir, sensor.max_range_m + 1.0, key.with(1))?;
        let mut range = hit.distance;
        // Open ground has no edges, and what lies farther behind than a pulse changes nothing: looking there would cost much.
        if mixed < MIXED_SHARE
            && hit.object_id != 0
            && let dir = spot(draw.range(-1.0, 1.0), draw.range(-1.0, 1.0))
            && let Some(other) = self.cast(dir, range + PULSE_M, key.with(2))
        {
            let (near, far) = if other.distance < range { (other, hit) } else { (hit, other) };
            // Apart, the nearer return wins or loses as a whole; together they melt into one in between.
            let share = draw.unit();
            let gap = far.distance - near.distance;
            if gap < PULSE_M {
                range = near.distance + share * gap;
                hit = if share < 0.5 { near } else { far };
            } else if share < 0.5 {
                (range, hit) = (near.distance, near);
            }
        }
        // The range up to which a surface is seen grows with the root of what it reflects.
        let strength = hit.class.reflectivity() * hit.cos_incidence;
        let sight = sensor.range_10_percent_m * (strength / 0.1).sqrt();
        let chance = 1.0 / (1.0 + ((range - sight) / (0.07 * sight + 0.1)).exp());
        range += offset + sensor.noise_m * draw.normal();
        let valid = range >= sensor.min_range_m && range <= sensor.max_range_m && detected < chance;
        valid.then_some((hit, range))
    }

    fn cast(&self, dir: Vector3<f32>, limit: f32, key: Key) -> Option<Hit> {
        let ray = Ray::try_new(self.origin, dir, key)?;
        // What moves hides what stands behind it.
        let moving = self.present.iter().fold(None, |best: Option<Hit>, mover| {
            mover.cast(self.origin, dir, key, best.map_or(limit, |b| b.distance)).or(best)
        });
        let standing = self.scene.cast(&ray, moving.map_or(limit, |m| m.distance));
        let mut hit = standing.or(moving)?;
        let cover = hit.class.cover();
        if hit.object_id == 0 && cover > 0.0 {
            // Blades and leaves stop the beam a little before the soil, farther before it where it grazes.
            let height = -key.with(3).unit().ln() * cover;
            hit.distance = (hit.distance - (height / hit.cos_incidence.max(0.06)).min(1.2)).max(0.0);
            // What the beam meets is a blade, not the plane: it returns light at grazing angles too.
            hit.cos_incidence = hit.cos_incidence.max(0.3);
        }
        Some(hit)
    }
}

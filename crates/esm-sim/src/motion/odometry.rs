//! Odometry with drift like that of LiDAR or visual odometry.

use esm_core::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::hash::{Draw, Key};

/// Distance over which the errors of odometry stay alike, metres.
const CORRELATION_M: f64 = 30.0;
/// The same of the jitter: sweeps that lie nearer to each other see nearly the same, and are matched with nearly the same error.
const JITTER_CORRELATION_M: f64 = 1.0;
/// Distance the drift is told for, metres.
const REFERENCE_M: f64 = 100.0;

/// Drift of odometry: the root mean square error after 100 m.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Drift {
    /// Share of the distance travelled: 0.01 is 1 m in 100 m.
    pub translation: f64,
    /// Heading, degrees per 100 m; roll and pitch, which gravity holds, take a fifth of it.
    pub rotation_deg_per_100m: f64,
    /// Standard deviation of the error that does not grow, along each axis, metres: matching one sweep to the next leaves it.
    pub jitter_m: f64,
    /// The same about each axis, degrees.
    pub jitter_deg: f64,
}

impl Default for Drift {
    fn default() -> Self {
        Self::LIDAR
    }
}

impl Drift {
    /// 1 % and 0.5 degrees per 100 m; every pose is off by 2 cm and 0.05 degrees besides.
    pub const LIDAR: Self =
        Self { translation: 0.01, rotation_deg_per_100m: 0.5, jitter_m: 0.02, jitter_deg: 0.05 };
    /// The same drift, with the jitter that KITTI's GNSS/INS poses have between key frames (measured: the flattest tenth of
    /// the accumulated segments is 5 cm thick, see `docs/realism.md`).
    pub const GNSS_INS: Self = Self { jitter_m: 0.04, jitter_deg: 0.1, ..Self::LIDAR };
    /// None at all.
    pub const NONE: Self =
        Self { translation: 0.0, rotation_deg_per_100m: 0.0, jitter_m: 0.0, jitter_deg: 0.0 };
}

/// What odometry makes of true poses: it starts at identity, and every step's length and turn are off by a rate that
/// follows a Gauss-Markov process over the distance. The RMS after 100 m is that of [`Drift`]: the integral of
/// such a rate of deviation s over D has the variance 2 s^2 L (D - L (1 - exp(-D / L))).
///
/// On top of that every pose but the first is off by a little that does not add up: a Gauss-Markov process of its own.
pub fn drifted(poses_map_sensor: &[Pose], drift: Drift, key: Key) -> Vec<Pose> {
    let (l, d) = (CORRELATION_M, REFERENCE_M);
    let gain = (2.0 * l * (d - l * (1.0 - (-d / l).exp()))).sqrt();
    let forward = drift.translation * d / gain;
    let turn = drift.rotation_deg_per_100m.to_radians() / gain;
    let deviations = [forward, 0.3 * forward, 0.3 * forward, 0.2 * turn, 0.2 * turn, turn];
    let turn = drift.jitter_deg.to_radians();
    let jitters = [drift.jitter_m, drift.jitter_m, drift.jitter_m, turn, turn, turn];
    let mut jitter = [0.0; 6];
    let mut draw = key.draw();
    let mut shake = key.with(1).draw();
    let mut rates = deviations.map(|s| s * f64::from(draw.normal()));
    let mut pose = Pose::identity();
    let mut out = Vec::with_capacity(poses_map_sensor.len());
    out.extend(poses_map_sensor.first().map(|_| pose));
    for w in poses_map_sensor.windows(2) {
        let step = w[0].inverse() * w[1];
        let ds = step.translation.vector.norm();
        let keep = (-ds / l).exp();
        walk(&mut rates, &deviations, keep, &mut draw);
        let along = step.translation.vector;
        // Length errors go along the step, the others across it.
        let shift = along * rates[0] + Vector3::new(0.0, rates[1], rates[2]) * ds;
        let error = Vector3::new(rates[3], rates[4], rates[5]) * ds;
        let wrong = Pose::from_parts(
            Translation3::from(along + shift),
            step.rotation * UnitQuaternion::from_scaled_axis(error),
        );
        pose *= wrong;
        // Thousands of products: keep the quaternion of length 1.
        pose.rotation.renormalize();
        walk(&mut jitter, &jitters, (-ds / JITTER_CORRELATION_M).exp(), &mut shake);
        let [x, y, z, roll, pitch, yaw] = jitter;
        out.push(pose * Pose::new(Vector3::new(x, y, z), Vector3::new(roll, pitch, yaw)));
    }
    out
}

/// A step of Gauss-Markov processes: what is kept of each state, and noise that holds its deviation.
fn walk(states: &mut [f64; 6], deviations: &[f64; 6], keep: f64, draw: &mut Draw) {
    for (state, s) in states.iter_mut().zip(deviations) {
        *state = keep * *state + s * (1.0 - keep * keep).sqrt() * f64::from(draw.normal());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over many seeds the RMS errors after 100 m of straight travel are the ones that were asked for.
    #[test]
    fn drift_is_what_was_asked_for() {
        let truth: Vec<Pose> = (0..=200).map(|i| Pose::translation(0.5 * f64::from(i), 0.0, 0.0)).collect();
        let drift = Drift::LIDAR;
        let (mut along, mut yaw, n) = (0.0, 0.0, 400u32);
        for seed in 0..n {
            let last = drifted(&truth, drift, Key::new(seed.into()))[200];
            along += (last.translation.x - 100.0).powi(2);
            yaw += last.rotation.euler_angles().2.to_degrees().powi(2);
        }
        let (along, yaw) = ((along / f64::from(n)).sqrt(), (yaw / f64::from(n)).sqrt());
        assert!((0.9..1.1).contains(&along), "{along} m");
        assert!((0.45..0.55).contains(&yaw), "{yaw} deg");
    }

    /// What does not grow has its deviation at every pose, is fresh after metres and nearly the same after centimetres.
    #[test]
    fn jitter_is_what_was_asked_for() {
        let jitter = Drift { jitter_m: 0.02, jitter_deg: 0.05, ..Drift::NONE };
        let spread = |step: f64| {
            let truth: Vec<Pose> =
                (0..4000).map(|i| Pose::translation(step * f64::from(i), 0.0, 0.0)).collect();
            let made = drifted(&truth, jitter, Key::new(5));
            let off: Vec<f64> =
                truth.iter().zip(&made).map(|(t, m)| m.translation.y - t.translation.y).collect();
            let n = off.len() as f64;
            let all = (off.iter().map(|y| y * y).sum::<f64>() / n).sqrt();
            let steps = (off.windows(2).map(|w| (w[1] - w[0]).powi(2)).sum::<f64>() / n).sqrt();
            (all, steps)
        };
        let (all, steps) = spread(2.0);
        assert!((0.018..0.022).contains(&all) && (0.022..0.030).contains(&steps), "{all} {steps}");
        let (_, steps) = spread(0.04);
        assert!((0.004..0.008).contains(&steps), "{steps}");
    }

    #[test]
    fn no_drift_is_the_truth() {
        let truth: Vec<Pose> = (0..50)
            .map(|i| {
                Pose::new(Vector3::new(f64::from(i), 2.0, 0.1), Vector3::new(0.0, 0.02, 0.05 * f64::from(i)))
            })
            .collect();
        for (a, b) in drifted(&truth, Drift::NONE, Key::new(1)).iter().zip(&truth) {
            let error = (truth[0] * a).inverse() * b;
            assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9);
        }
    }
}

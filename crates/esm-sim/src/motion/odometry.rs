//! Odometry with drift like that of LiDAR or visual odometry.

use esm_core::Pose;
use nalgebra::{Translation3, UnitQuaternion, Vector3};

use crate::hash::Key;

/// Distance over which the errors of odometry stay alike, metres.
const CORRELATION_M: f64 = 30.0;
/// Distance the drift is told for, metres.
const REFERENCE_M: f64 = 100.0;

/// Drift of odometry: the root mean square error after 100 m.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Drift {
    /// Share of the distance travelled: 0.01 is 1 m in 100 m.
    pub translation: f64,
    /// Heading, degrees per 100 m; roll and pitch, which gravity holds, take a fifth of it.
    pub rotation_deg_per_100m: f64,
}

impl Default for Drift {
    /// 1 % and 0.5 degrees per 100 m.
    fn default() -> Self {
        Self { translation: 0.01, rotation_deg_per_100m: 0.5 }
    }
}

/// What odometry makes of true poses: it starts at identity, and every step's length and turn are off by a rate that
/// follows a Gauss-Markov process over the distance. The RMS after 100 m is that of [`Drift`]: the integral of
/// such a rate of deviation s over D has the variance 2 s^2 L (D - L (1 - exp(-D / L))).
pub fn drifted(poses_map_sensor: &[Pose], drift: Drift, key: Key) -> Vec<Pose> {
    let (l, d) = (CORRELATION_M, REFERENCE_M);
    let gain = (2.0 * l * (d - l * (1.0 - (-d / l).exp()))).sqrt();
    let forward = drift.translation * d / gain;
    let turn = drift.rotation_deg_per_100m.to_radians() / gain;
    let deviations = [forward, 0.3 * forward, 0.3 * forward, 0.2 * turn, 0.2 * turn, turn];
    let mut draw = key.draw();
    let mut rates = deviations.map(|s| s * f64::from(draw.normal()));
    let mut pose = Pose::identity();
    let mut out = Vec::with_capacity(poses_map_sensor.len());
    out.extend(poses_map_sensor.first().map(|_| pose));
    for w in poses_map_sensor.windows(2) {
        let step = w[0].inverse() * w[1];
        let ds = step.translation.vector.norm();
        let keep = (-ds / l).exp();
        for (rate, s) in rates.iter_mut().zip(deviations) {
            *rate = keep * *rate + s * (1.0 - keep * keep).sqrt() * f64::from(draw.normal());
        }
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
        out.push(pose);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over many seeds the RMS errors after 100 m of straight travel are the ones that were asked for.
    #[test]
    fn drift_is_what_was_asked_for() {
        let truth: Vec<Pose> = (0..=200).map(|i| Pose::translation(0.5 * f64::from(i), 0.0, 0.0)).collect();
        let drift = Drift { translation: 0.01, rotation_deg_per_100m: 0.5 };
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

    #[test]
    fn no_drift_is_the_truth() {
        let truth: Vec<Pose> = (0..50)
            .map(|i| {
                Pose::new(Vector3::new(f64::from(i), 2.0, 0.1), Vector3::new(0.0, 0.02, 0.05 * f64::from(i)))
            })
            .collect();
        let still = Drift { translation: 0.0, rotation_deg_per_100m: 0.0 };
        for (a, b) in drifted(&truth, still, Key::new(1)).iter().zip(&truth) {
            let error = (truth[0] * a).inverse() * b;
            assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9);
        }
    }
}

//! [`OdometryConfig`]: how far the motion between the sweeps of a live cloud is off, and what that does to its pose.

use nalgebra::{Matrix3, Matrix6, Vector3};
use serde::{Deserialize, Serialize};

use crate::accumulate::LiveCloud;
use crate::error::{Error, require};

/// Share of the drift that an axis across the travel has: errors of the scale go along it.
const ACROSS: f64 = 0.3;
/// Points that tell how long a cloud is.
const SAMPLE: usize = 2000;

/// What is wrong with the motion inside a live cloud, as standard deviations.
///
/// The points of a cloud fix its middle; the pose that is asked for is the newest sweep's, half the travel further on, and
/// what the odometry got wrong in between is in no residual: neither a wrong scale, nor the slope of a cloud that drifted to
/// one side. The defaults are those of LiDAR odometry (about 1 % and 0.5 degrees in 100 m), fitted on simulated tuning worlds
/// (`python/eval/nees.py` tells how well they hold on others).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct OdometryConfig {
    /// Error along the travel, metres a metre; across it three tenths of that.
    pub drift: f64,
    /// Error of the heading, degrees a metre.
    pub turn_deg_per_m: f64,
    /// Error of every pose that does not add up, metres along each axis.
    pub jitter_m: f64,
    /// The same about each axis, degrees.
    pub jitter_deg: f64,
    /// The same of the heading, which gravity does not hold, degrees.
    pub jitter_heading_deg: f64,
    /// What the motion during a sweep does to it where its points are not put right for that, metres; 0 where they are.
    /// A cloud of many sweeps averages over it.
    pub distortion_m: f64,
    /// The same about each axis, degrees.
    pub distortion_deg: f64,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        Self {
            drift: 0.012,
            turn_deg_per_m: 0.007,
            jitter_m: 0.028,
            jitter_deg: 0.039,
            jitter_heading_deg: 0.115,
            distortion_m: 0.036,
            distortion_deg: 0.25,
        }
    }
}

impl OdometryConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require((0.0..=1.0).contains(&self.drift), "odometry.drift", self.drift, "0 to 1")?;
        for (name, value) in [
            ("odometry.turn_deg_per_m", self.turn_deg_per_m),
            ("odometry.jitter_deg", self.jitter_deg),
            ("odometry.jitter_heading_deg", self.jitter_heading_deg),
            ("odometry.distortion_deg", self.distortion_deg),
        ] {
            require((0.0..=45.0).contains(&value), name, value, "0 to 45 degrees")?;
        }
        for (name, value) in
            [("odometry.jitter_m", self.jitter_m), ("odometry.distortion_m", self.distortion_m)]
        {
            require((0.0..=10.0).contains(&value), name, value, "0 to 10 m")?;
        }
        Ok(())
    }

    /// What it adds to the covariance of the newest sweep's pose: order x y z rx ry rz in m and rad, a right perturbation in
    /// the sensor frame.
    ///
    /// ```
    /// use esm_core::{AccumulateConfig, Accumulator, OdometryConfig, PointCloud, Pose};
    /// let mut accumulator = Accumulator::new(AccumulateConfig { distance_m: 20.0, ..Default::default() })?;
    /// let sweep = PointCloud::try_new(vec![[30.0, 1.0, 0.0], [-30.0, 2.0, 0.0]])?;
    /// let pose_odom_sensor = |i: u8| Pose::translation(2.0 * f64::from(i), 0.0, 0.0);
    /// let clouds = (0..11).filter_map(|i| accumulator.push(0.0, &sweep, Some(pose_odom_sensor(i))));
    /// let covariance = OdometryConfig::default().covariance(&clouds.last().expect("a cloud a sweep"));
    /// assert!((0.11..0.13).contains(&covariance[(0, 0)].sqrt()), "twelve centimetres along the travel");
    /// assert!((0.04..0.05).contains(&covariance[(1, 1)].sqrt()), "and less than five across it");
    /// # Ok::<(), esm_core::Error>(())
    /// ```
    pub fn covariance(&self, live: &LiveCloud) -> Matrix6<f64> {
        let square = |v: f64| v * v;
        let sweeps = live.sweeps.max(1) as f64;
        let jitter = if live.sweeps > 1 { 1.0 } else { 0.0 };
        let shift = jitter * square(self.jitter_m) + square(self.distortion_m) / sweeps;
        let turn =
            jitter * square(self.jitter_deg.to_radians()) + square(self.distortion_deg.to_radians()) / sweeps;
        let Travel { lag_m, along, slope } = Travel::of(live);
        let across = Matrix3::identity() - along;
        let sideways = self.drift * ACROSS;
        // A cloud that drifted to one side is fitted as if it were turned: that much less is it beside its place.
        let drift = along * square(self.drift * lag_m) + across * square(sideways * lag_m * (1.0 - slope));
        let heading = jitter * square(self.jitter_heading_deg.to_radians())
            + square(self.turn_deg_per_m.to_radians() * lag_m);
        let turns =
            across * square(sideways * slope) + Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, heading));
        let mut covariance = Matrix6::zeros();
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(drift + Matrix3::identity() * shift));
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(turns + Matrix3::identity() * turn));
        covariance
    }
}

/// How a cloud lies along the travel that made it.
struct Travel {
    /// From the newest sweep back to the middle of those that made the cloud, metres.
    lag_m: f64,
    /// Projection onto the direction of travel.
    along: Matrix3<f64>,
    /// How much of a slope of the odometry is one of the whole cloud, 0 to 1: nearly all where every sweep is but a line across
    /// the travel, little where each sees as far ahead as the cloud is long.
    slope: f64,
}

impl Travel {
    fn of(live: &LiveCloud) -> Self {
        let Some(middle) = live.middle_sensor() else {
            // Nobody said where from: it may be anywhere.
            return Self { lag_m: live.travel_m / 2.0, along: Matrix3::identity(), slope: 0.0 };
        };
        let lag_m = middle.norm();
        if lag_m <= 0.0 {
            return Self { lag_m, along: Matrix3::zeros(), slope: 0.0 };
        }
        let direction = middle / lag_m;
        let place = |p: [f32; 3]| direction.dot(&Vector3::from(p).cast::<f64>());
        let views = live.viewpoints.iter().map(|v| (place(v.origin_sensor), v.points as f64));
        let points = live.cloud.points();
        let step = points.len().div_ceil(SAMPLE).max(1);
        let ends = points.iter().step_by(step).map(|p| (place(*p), 1.0));
        Self {
            lag_m,
            along: direction * direction.transpose(),
            slope: (variance(views) / variance(ends)).clamp(0.0, 1.0),
        }
    }
}

/// Of weighted values; at least a square centimetre, to be divided by.
fn variance(values: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (n, sum, squares) =
        values.fold((0.0, 0.0, 0.0), |(n, sum, squares), (v, w)| (n + w, sum + w * v, squares + w * v * v));
    if n > 0.0 { (squares / n - (sum / n) * (sum / n)).max(1e-4) } else { 1e-4 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::accumulate::{AccumulateConfig, Accumulator};
    use crate::cloud::{PointCloud, Pose};

    /// Sweeps that see `ahead_m` ahead and behind, a line across the way for 0.
    fn driven(step: [f64; 3], sweeps: usize, ahead_m: f32) -> LiveCloud {
        let config = AccumulateConfig { distance_m: 100.0, min_range_m: 0.0, ..Default::default() };
        let mut accumulator = Accumulator::new(config).unwrap();
        let along = Vector3::from(step).normalize().cast::<f32>();
        let ends = [1.0, -1.0].map(|s| (along * s * ahead_m + Vector3::new(0.0, 0.0, 3.0)).into());
        let sweep = PointCloud::try_new(ends.to_vec()).unwrap();
        let poses =
            (0..sweeps).map(|i| step.map(|s| s * i as f64)).map(|[x, y, z]| Pose::translation(x, y, z));
        poses.filter_map(|p| accumulator.push(0.0, &sweep, Some(p))).last().unwrap()
    }

    #[test]
    fn errors_grow_with_the_travel_along_it() {
        let config = OdometryConfig::default();
        let short = config.covariance(&driven([0.0, 1.0, 0.0], 5, 30.0));
        let long = config.covariance(&driven([0.0, 1.0, 0.0], 41, 30.0));
        assert!(long[(1, 1)] > 5.0 * short[(1, 1)], "along: {} {}", long[(1, 1)], short[(1, 1)]);
        assert!(long[(1, 1)] > 5.0 * long[(0, 0)], "across: {}", long[(0, 0)]);
        assert!(long.cholesky().is_some(), "positive definite");
    }

    #[test]
    fn a_cloud_of_lines_turns_where_one_of_wide_sweeps_is_moved() {
        let config = OdometryConfig::default();
        let (lines, wide) = (driven([1.0, 0.0, 0.0], 21, 0.0), driven([1.0, 0.0, 0.0], 21, 30.0));
        let (lines, wide) = (config.covariance(&lines), config.covariance(&wide));
        assert!(lines[(4, 4)] > 5.0 * wide[(4, 4)], "pitch: {} {}", lines[(4, 4)], wide[(4, 4)]);
        assert!(lines[(2, 2)] < 0.8 * wide[(2, 2)], "height: {} {}", lines[(2, 2)], wide[(2, 2)]);
        assert!((lines[(3, 3)] - wide[(3, 3)]).abs() < 1e-12, "roll");
    }

    #[test]
    fn a_single_sweep_has_no_drift_but_may_be_distorted() {
        let config = OdometryConfig::default();
        let covariance = config.covariance(&driven([1.0, 0.0, 0.0], 1, 30.0));
        assert!((covariance[(0, 0)].sqrt() - config.distortion_m).abs() < 1e-12);
        assert!((covariance[(5, 5)].sqrt() - config.distortion_deg.to_radians()).abs() < 1e-12);
        let none = OdometryConfig { distortion_m: 0.0, distortion_deg: 0.0, ..config };
        assert_eq!(none.covariance(&driven([1.0, 0.0, 0.0], 1, 30.0)), Matrix6::zeros());
    }

    #[test]
    fn without_viewpoints_every_direction_may_be_the_one_of_travel() {
        let mut live = driven([1.0, 0.0, 0.0], 21, 30.0);
        let known = OdometryConfig::default().covariance(&live);
        live.viewpoints.clear();
        let unknown = OdometryConfig::default().covariance(&live);
        assert!((unknown[(0, 0)] - known[(0, 0)]).abs() < 1e-9 && unknown[(1, 1)] > 2.0 * known[(1, 1)]);
    }
}

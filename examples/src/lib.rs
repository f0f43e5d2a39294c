//! What the examples share: a small street, simulated on the fly and visited twice.

use std::path::Path;
use std::sync::OnceLock;

use esm_core::{PointCloud, Pose};
use esm_io::{OpenOptions, Recording, Track, read_tum};

/// An error of anything.
pub type Error = Box<dyn std::error::Error + Send + Sync>;

/// One sweep of a visit.
pub struct Sweep {
    /// Seconds.
    pub stamp: f64,
    /// The points, metres, sensor frame.
    pub cloud: PointCloud,
    /// By the robot's odometry, which drifts.
    pub pose_odom_sensor: Option<Pose>,
    /// The simulator's truth, in the map's frame.
    pub pose_map_sensor: Pose,
}

/// The two visits.
pub struct Street {
    /// Of this one the map is made.
    pub first: Vec<Sweep>,
    /// Months later, with other cars: to be found in the map.
    pub second: Vec<Sweep>,
}

/// Simulates the street, once a process; a few seconds.
///
/// # Errors
/// Where the temporary directory cannot be written.
pub fn street() -> Result<&'static Street, Error> {
    static STREET: OnceLock<Street> = OnceLock::new();
    if let Some(street) = STREET.get() {
        return Ok(street);
    }
    let dir = tempfile::tempdir()?;
    esm_sim::simulate(&esm_sim::preset("train-urban")?, 100, 0.03, dir.path(), &mut |_| true)?;
    let street = Street { first: visit(dir.path(), "map")?, second: visit(dir.path(), "live")? };
    Ok(STREET.get_or_init(|| street))
}

/// How far a pose is off, metres and degrees.
pub fn off(found: &Pose, truth: &Pose) -> (f64, f64) {
    let error = found.inv_mul(truth);
    (error.translation.vector.norm(), error.rotation.angle().to_degrees())
}

fn visit(dir: &Path, name: &str) -> Result<Vec<Sweep>, Error> {
    let mut truth = Track::new(usize::MAX);
    for pose in read_tum(dir.join(format!("{name}_truth.tum")))? {
        truth.push(pose.stamp_ns, pose.pose);
    }
    let mut sweeps = Vec::new();
    for sweep in Recording::open(dir.join(format!("{name}.mcap")), &OpenOptions::default())?.sweeps()? {
        let sweep = sweep?;
        let Some(pose_map_sensor) = truth.at(sweep.stamp_ns) else { continue };
        let (stamp, cloud) = (sweep.stamp, sweep.cloud);
        sweeps.push(Sweep { stamp, cloud, pose_odom_sensor: sweep.pose_odom_sensor, pose_map_sensor });
    }
    Ok(sweeps)
}

//! One call: a map and sweeps in, the pose out.
//!
//! `cargo run --release -p esm-examples --example 01_one_call`

#![allow(clippy::print_stdout)] // An example for people.

use std::sync::Arc;

use esm_core::{Accumulator, Config, Localizer, MapBuilder, SequenceLocalizer, Verdict};
use esm_examples::{Error, off, street};

pub(crate) fn main() -> Result<(), Error> {
    let street = street()?;
    let mut config = Config::default();
    config.accumulate.distance_m = 10.0;

    // Yesterday: a drive with known poses becomes a map. `map.write(path)` and `Map::open(path)` keep it.
    let mut builder = MapBuilder::new(&config)?;
    for sweep in &street.first {
        builder.push_sweep(sweep.stamp, &sweep.cloud, &sweep.pose_map_sensor)?;
    }
    let map = Arc::new(builder.finish()?);

    // Today: sweep by sweep, wherever the robot may be. Without odometry, or for single clouds, ask the localizer itself.
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let mut robot = SequenceLocalizer::new(Localizer::new(map, &config)?);
    let (mut located, mut asked) = (0, 0);
    for sweep in street.second.iter().step_by(2) {
        let Some(cloud) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
            continue;
        };
        let answer = robot.localize(&cloud)?; // the one call
        asked += 1;
        match (answer.verdict, answer.pose_map_sensor) {
            (Verdict::Located, Some(pose_map_sensor)) => {
                located += 1;
                let (metres, degrees) = off(&pose_map_sensor, &sweep.pose_map_sensor);
                println!("{:8.2} s  located, off by {metres:.2} m and {degrees:.2}°", answer.stamp);
                assert!(metres < 2.0 && degrees < 5.0, "a false pose");
            }
            _ => {
                println!("{:8.2} s  {}: {}", answer.stamp, answer.verdict, answer.reason.unwrap_or_default())
            }
        }
    }
    println!("{located} of {asked} clouds located");
    assert!(2 * located > asked, "most are found");
    Ok(())
}

//! `esm-cli`: find a robot in a prior map from LiDAR recordings.
fn main() {}

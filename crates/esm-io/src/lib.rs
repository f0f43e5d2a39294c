//! Readers and writers for LiDAR recordings, point clouds and trajectories.

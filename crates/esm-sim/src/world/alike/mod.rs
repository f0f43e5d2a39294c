//! Worlds that look alike from place to place: what a confident wrong pose comes from.
//!
//! Each is a regular pattern with next to no natural variation, larger than a sensor sees, so that places a step of the pattern
//! apart can hardly be told from each other; and each has edges and a few odd things, near which they can.

mod car_park;
mod plantation;
mod site;
mod terrace;
mod terraces;

pub(super) use car_park::car_park;
pub(super) use plantation::plantation;
pub(super) use site::Site;
pub(super) use terraces::terraces;

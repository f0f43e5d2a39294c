//! The core for programs in C and C++: a map, a robot in it, clouds in and poses out. `include/esm.h` is made from this crate.
//!
//! [`robot`] is what happens, in safe Rust; [`ffi`] is the door to C, and the one place of `unsafe`.

pub mod ffi;
pub mod robot;

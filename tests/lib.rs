//! A small street world and recordings of drives through it, for the end-to-end tests. Everything is made from a seed:
//! nothing is read, nothing is anybody's.

pub mod recording;
pub mod street;

//! How long opening takes. Printed, not judged: the machine may be busy. `cargo bench --bench map` measures in earnest.

use std::time::Instant;

use esm_core::map::Map;

use crate::{Scratch, large_data};

#[test]
fn opening_a_hundred_thousand_segments() {
    let map = Map::from_data(large_data(100_000, 20, 13)).unwrap();
    let scratch = Scratch::new();
    let start = Instant::now();
    map.write(&scratch.path()).unwrap();
    let write = start.elapsed();
    let mut open = Vec::new();
    for _ in 0..5 {
        let start = Instant::now();
        let opened = Map::open(&scratch.path()).unwrap();
        open.push(start.elapsed().as_secs_f64() * 1e3);
        assert_eq!(opened.len(), 100_000);
        assert_eq!(opened.descriptors(), map.descriptors());
    }
    let opened = Map::open(&scratch.path()).unwrap();
    let start = Instant::now();
    opened.verify_points().unwrap();
    let verify = start.elapsed();
    println!(
        "{:.1} MB: written in {:.0} ms, opened in {open:.1?} ms, points verified in {:.1} ms",
        map.file_size() as f64 / 1e6,
        write.as_secs_f64() * 1e3,
        verify.as_secs_f64() * 1e3
    );
}

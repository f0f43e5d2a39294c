//! Simulates a preset: `simulate PRESET SEED SCALE DIR`. Says how long it took on stderr.

use std::path::Path;
use std::time::Instant;

#[allow(clippy::print_stderr)] // An example for people.
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [name, seed, scale, dir] = args.as_slice() else {
        return Err("usage: simulate PRESET SEED SCALE DIR".into());
    };
    let preset = esm_sim::preset(name)?;
    let start = Instant::now();
    let summary = esm_sim::simulate(&preset, seed.parse()?, scale.parse()?, Path::new(dir), &mut |_| true)?;
    let seconds = start.elapsed().as_secs_f64();
    eprintln!(
        "{name}: {summary:?} in {seconds:.1} s: {:.2} M rays/s, {:.1} s per km",
        summary.rays as f64 / seconds * 1e-6,
        seconds / summary.travel_m * 1000.0
    );
    Ok(())
}

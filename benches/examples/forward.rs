//! The network's forward pass against another program's: `forward WEIGHTS GOLDEN [--repeat N]`.
//!
//! GOLDEN (`esm-train golden`, `python/train/WEIGHTS.md`) holds inputs and what PyTorch makes of them. One JSON object goes to
//! stdout: the largest differences of descriptors and qualities, and the seconds that each of N passes over all segments
//! took, on as many threads as `RAYON_NUM_THREADS` says.

#![allow(clippy::print_stdout)] // A program for scripts.

use std::time::Instant;

use esm_core::Descriptor;
use esm_core::describe::XConv;
use safetensors::SafeTensors;

type Failure = Box<dyn std::error::Error>;

const USAGE: &str = "usage: forward WEIGHTS GOLDEN [--repeat N]";

fn numbers(file: &SafeTensors<'_>, name: &str) -> Result<Vec<f32>, Failure> {
    let view = file.tensor(name)?;
    if view.dtype() != safetensors::Dtype::F32 {
        return Err(format!("{name} is {:?}, must be F32", view.dtype()).into());
    }
    Ok(view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
}

/// The largest difference; NaN where one is no number.
fn worst(ours: &[f32], theirs: &[f32]) -> Result<f32, Failure> {
    if ours.len() != theirs.len() {
        return Err(format!("{} numbers beside {}", ours.len(), theirs.len()).into());
    }
    let off = ours.iter().zip(theirs).map(|(a, b)| (a - b).abs());
    Ok(off.fold(0.0, |worst, d| if d > worst || d.is_nan() { d } else { worst }))
}

fn main() -> Result<(), Failure> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (weights, golden, repeat) = match args.as_slice() {
        [weights, golden] => (weights, golden, 1),
        [weights, golden, flag, n] if flag == "--repeat" => (weights, golden, n.parse::<usize>()?.max(1)),
        _ => return Err(USAGE.into()),
    };
    let network = XConv::open(weights)?;
    let bytes = std::fs::read(golden)?;
    let file = SafeTensors::deserialize(&bytes)?;
    let points = numbers(&file, "points")?;
    let measures = if file.names().contains(&"measures") { numbers(&file, "measures")? } else { Vec::new() };
    let measures: Vec<f64> = measures.into_iter().map(f64::from).collect();
    let points = points.as_chunks::<3>().0;
    let mut described = network.describe_normalised(points, &measures);
    let mut seconds = Vec::new();
    for _ in 0..repeat {
        let start = Instant::now();
        described = network.describe_normalised(points, &measures);
        seconds.push(start.elapsed().as_secs_f64());
    }
    let report = serde_json::json!({
        "descriptor": network.name(),
        "segments": described.quality.len(),
        "descriptor_off": worst(&described.values, &numbers(&file, "descriptor")?)?,
        "quality_off": worst(&described.quality, &numbers(&file, "quality")?)?,
        "multiply_adds": network.multiply_adds(),
        "seconds": seconds,
    });
    println!("{report}");
    Ok(())
}

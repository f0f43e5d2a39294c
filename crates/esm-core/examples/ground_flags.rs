//! Ground flags of one cloud: `ground_flags IN OUT [FLOATS_PER_POINT]`.
//!
//! IN holds little-endian float32 values, x y z first in each point (KITTI: 4 values a point, the default). OUT gets
//! one byte a point, 1 for ground. Prints the milliseconds that the filter took and the number of ground points.

use std::time::Instant;

use esm_core::segment::{GroundConfig, ground_flags};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let usage = "usage: ground_flags IN OUT [FLOATS_PER_POINT]";
    let mut args = std::env::args().skip(1);
    let (input, output) = (args.next().ok_or(usage)?, args.next().ok_or(usage)?);
    let values: usize = args.next().map_or(Ok(4), |v| v.parse())?;
    if values < 3 {
        return Err(usage.into());
    }
    let bytes = std::fs::read(&input).map_err(|e| format!("{input}: {e}"))?;
    let value = |b: &[u8], i: usize| f32::from_le_bytes([b[4 * i], b[4 * i + 1], b[4 * i + 2], b[4 * i + 3]]);
    let points: Vec<[f32; 3]> =
        bytes.chunks_exact(4 * values).map(|b| [value(b, 0), value(b, 1), value(b, 2)]).collect();

    let start = Instant::now();
    let flags = ground_flags(&points, &GroundConfig::default());
    let elapsed = start.elapsed().as_secs_f64() * 1e3;

    let flags: Vec<u8> = flags.into_iter().map(u8::from).collect();
    std::fs::write(&output, &flags).map_err(|e| format!("{output}: {e}"))?;
    use std::io::Write;
    let ground = flags.iter().filter(|f| **f == 1).count();
    writeln!(std::io::stdout(), "{elapsed:.2} {ground}")?;
    Ok(())
}

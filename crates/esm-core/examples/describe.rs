//! Describes segments for other programs: `describe NAME < SEGMENTS > ROWS`.
//!
//! Standard input: how many segments (u32), how many points each has (u32), then all points (x y z as f32, metres, z up).
//! Standard output: numbers a row (u32), then the rows (f32). All little-endian. `python/train` trains the peers' forests on it.

use std::io::{Error, ErrorKind, Read, Write};

use esm_core::describe::by_name;
use esm_core::segment::Segment;

/// Segments that are described at once.
const BATCH: usize = 256;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let name = std::env::args().nth(1).ok_or("describe NAME < SEGMENTS > ROWS")?;
    let descriptor = by_name(&name)?;
    let mut bytes = Vec::new();
    std::io::stdin().lock().read_to_end(&mut bytes)?;
    let words = bytes.as_chunks::<4>().0;
    let short = || Error::new(ErrorKind::UnexpectedEof, "standard input ends before the segments do");
    let count = u32::from_le_bytes(*words.first().ok_or_else(short)?) as usize;
    let counts = words.get(1..=count).ok_or_else(short)?;
    let points: Vec<f32> = words[count + 1..].iter().map(|w| f32::from_le_bytes(*w)).collect();
    let mut points = points.as_chunks::<3>().0;
    let mut out = std::io::stdout().lock();
    out.write_all(&(descriptor.dim() as u32).to_le_bytes())?;
    for part in counts.chunks(BATCH) {
        let mut segments = Vec::with_capacity(part.len());
        for n in part {
            let (own, rest) = points.split_at_checked(u32::from_le_bytes(*n) as usize).ok_or_else(short)?;
            segments.push(Segment::from_points(own.to_vec()).ok_or("a segment without points")?);
            points = rest;
        }
        for value in descriptor.describe(&segments).values {
            out.write_all(&value.to_le_bytes())?;
        }
    }
    Ok(out.flush()?)
}

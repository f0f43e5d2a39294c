//! The points above the ground of one live cloud, and our clusters of them, for comparison with other programs:
//! `live_objects RECORDING SWEEP POINTS LABELS`.
//!
//! POINTS gets float32 x y z a point, LABELS one int32 a point: its cluster's number or -1. Prints the best of 30
//! times of the clustering in milliseconds and the number of clusters.

use std::io::Write;
use std::time::Instant;

use esm_benches::{live_cloud, objects};
use esm_core::segment::{SegmentConfig, euclidean_clusters};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [recording, sweep, points_path, labels_path] = args.as_slice() else {
        return Err("usage: live_objects RECORDING SWEEP POINTS LABELS".into());
    };
    let config = SegmentConfig::default();
    let points = objects(&live_cloud(recording.as_ref(), sweep.parse()?)?, &config);
    let mut best = f64::INFINITY;
    let mut clusters = Vec::new();
    for _ in 0..30 {
        let start = Instant::now();
        clusters = euclidean_clusters(&points, config.tolerance, config.min_points, config.max_points);
        best = best.min(start.elapsed().as_secs_f64() * 1e3);
    }
    let mut labels = vec![-1i32; points.len()];
    for (number, cluster) in clusters.iter().enumerate() {
        for &i in cluster {
            labels[i as usize] = number as i32;
        }
    }
    let bytes: Vec<u8> = points.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(points_path, bytes).map_err(|e| format!("{points_path}: {e}"))?;
    let bytes: Vec<u8> = labels.iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(labels_path, bytes).map_err(|e| format!("{labels_path}: {e}"))?;
    writeln!(std::io::stdout(), "{best:.2} {}", clusters.len())?;
    Ok(())
}

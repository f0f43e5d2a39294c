//! Ground removal judged by the SemanticKITTI labels of eleven full-density single scans.
//!
//! `python/eval/ground_vs_patchworkpp.py` measures Patchwork++ (pypatchworkpp 1.4.1, its defaults) on the same scans:
//! mean precision 0.9796, recall 0.9786, F1 0.9787.

#![allow(clippy::print_stdout)] // A skipped test says so, and a judged one what it found.

use std::path::PathBuf;

use esm_core::segment::{GroundConfig, ground_flags};

/// Road, parking, pavement, other ground, lane marking, terrain.
const GROUND: [u16; 6] = [40, 44, 48, 49, 60, 72];
/// Unlabelled, outlier, other structure, other object, and vegetation, which may be grass or a tree.
const NOT_COUNTED: [u16; 5] = [0, 1, 52, 99, 70];

const PATCHWORK_PP_MEAN_F1: f64 = 0.9787;

fn scans() -> Option<PathBuf> {
    let shared = std::env::var_os("ESM_SHARED_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    let folder = shared.join("kitti_scans");
    if folder.is_dir() {
        return Some(folder);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{}: missing, and CI needs it", folder.display());
    println!("skipped: no {}", folder.display());
    None
}

/// Precision, recall and F1 of one scan.
fn scores(points: &[[f32; 3]], labels: &[u16]) -> [f64; 3] {
    let flags = ground_flags(points, &GroundConfig::default());
    let (mut hits, mut flagged, mut truth) = (0.0, 0.0, 0.0);
    for (flag, label) in flags.into_iter().zip(labels) {
        if NOT_COUNTED.contains(label) {
            continue;
        }
        let is_ground = GROUND.contains(label);
        hits += f64::from(u8::from(flag && is_ground));
        flagged += f64::from(u8::from(flag));
        truth += f64::from(u8::from(is_ground));
    }
    let (precision, recall) = (hits / flagged, hits / truth);
    [precision, recall, 2.0 * precision * recall / (precision + recall)]
}

#[test]
fn f1_is_above_patchwork_pp() {
    let Some(folder) = scans() else { return };
    let mut sum = [0.0; 3];
    for scan in 0..11 {
        let path = folder.join(format!("{scan:02}/000000.bin"));
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let value =
            |c: &[u8], i: usize| f32::from_le_bytes([c[4 * i], c[4 * i + 1], c[4 * i + 2], c[4 * i + 3]]);
        let points: Vec<[f32; 3]> =
            bytes.chunks_exact(16).map(|c| [value(c, 0), value(c, 1), value(c, 2)]).collect();
        let path = path.with_extension("label");
        let bytes = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let labels: Vec<u16> = bytes.chunks_exact(4).map(|c| u16::from_le_bytes([c[0], c[1]])).collect();
        assert_eq!(points.len(), labels.len());
        let [precision, recall, f1] = scores(&points, &labels);
        println!("{scan:02}: precision {precision:.4} recall {recall:.4} F1 {f1:.4}");
        assert!(f1 > 0.94, "scan {scan:02}: F1 {f1}");
        sum = [sum[0] + precision, sum[1] + recall, sum[2] + f1];
    }
    let [precision, recall, f1] = sum.map(|s| s / 11.0);
    println!("mean: precision {precision:.4} recall {recall:.4} F1 {f1:.4}");
    assert!(f1 > PATCHWORK_PP_MEAN_F1, "mean F1 {f1}, Patchwork++ has {PATCHWORK_PP_MEAN_F1}");
    assert!(precision > 0.97 && recall > 0.985, "{precision} {recall}");
}

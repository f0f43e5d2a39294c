//! One loop closure a line.

use esm_core::{Localization, LoopClosure};
use esm_io::{PoseLine, StageMillis};
use serde_json::json;

use crate::truth::Judgement;

/// The line of one closure between two scans, numbered as by `--frames`; `judgement` where there is a truth.
pub(crate) fn loop_json(
    result: &Localization,
    closure: &LoopClosure,
    frames: [Option<usize>; 2],
    judgement: Option<&Judgement>,
) -> anyhow::Result<String> {
    let mut line = json!({
        "stamp_from": closure.stamp_from,
        "stamp_to": closure.stamp_to,
        "frame_from": frames[0],
        "frame_to": frames[1],
        "pose_from_to": PoseLine::from(&closure.pose_from_to),
        "covariance": closure.covariance.as_ref().map(|c| c.as_slice()),
        "travel_m": result.travel_m,
        "segments": result.segments,
        "described": result.described,
        "inliers": result.inliers,
        "score": result.score,
        "runner_up": result.runner_up,
        "timings_ms": StageMillis(&result.timings),
    });
    if let Some(judgement) = judgement {
        line["error_m"] = json!(judgement.error.map(|e| e.m));
        line["error_deg"] = json!(judgement.error.map(|e| e.deg));
        line["correct"] = json!(judgement.is_correct(result.verdict));
    }
    Ok(serde_json::to_string(&line)?)
}

/// The head of the table.
pub(crate) fn loop_header(with_truth: bool) -> String {
    let mut head = format!(
        "{:>20} {:>20} {:>8} {:>8} {:>8} {:>7} {:>5} {:>7} {:>7} {:>8}",
        "from [s]", "to [s]", "x [m]", "y [m]", "z [m]", "yaw [°]", "inl.", "score", "second", "ms"
    );
    if with_truth {
        head.push_str(&format!(" {:>9} {:>9}", "error [m]", "error [°]"));
    }
    head
}

/// A row of the table.
pub(crate) fn loop_row(
    result: &Localization,
    closure: &LoopClosure,
    judgement: Option<&Judgement>,
) -> String {
    let (t, yaw) = (
        closure.pose_from_to.translation.vector,
        closure.pose_from_to.rotation.euler_angles().2.to_degrees(),
    );
    let mut line = format!(
        "{:>20.6} {:>20.6} {:>8.2} {:>8.2} {:>8.2} {:>7.1} {:>5} {:>7.2} {:>7.2} {:>8.1}",
        closure.stamp_from,
        closure.stamp_to,
        t.x,
        t.y,
        t.z,
        yaw,
        result.inliers,
        result.score,
        result.runner_up,
        result.timings.total().as_secs_f64() * 1e3,
    );
    if let Some(judgement) = judgement {
        line.push_str(&match judgement.error {
            Some(e) => format!(" {:>9.2} {:>9.2}", e.m, e.deg),
            None => format!(" {:>9} {:>9}", "-", "-"),
        });
        if judgement.is_correct(result.verdict) == Some(false) {
            line.push_str("  FALSE");
        }
    }
    line
}

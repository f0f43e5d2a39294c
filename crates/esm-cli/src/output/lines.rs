//! One result a line: JSON for programs, a table for people.

use esm_core::{Localization, Timings};
use esm_io::{LocalizationLine, stage_micros};
use serde::Serialize;

use crate::truth::Judgement;

/// The contract's object, and how it was judged.
#[derive(Serialize)]
struct Line<'a> {
    #[serde(flatten)]
    result: LocalizationLine<'a>,
    #[serde(flatten)]
    judged: Option<Judged>,
}

#[derive(Serialize)]
struct Judged {
    error_m: Option<f64>,
    error_deg: Option<f64>,
    localizable: Option<bool>,
}

/// The line of one cloud; `judgement` where there is a truth.
pub(crate) fn json_line(result: &Localization, judgement: Option<&Judgement>) -> anyhow::Result<String> {
    let line = Line {
        result: result.into(),
        judged: judgement.map(|j| Judged {
            error_m: j.error.map(|e| e.m),
            error_deg: j.error.map(|e| e.deg),
            localizable: j.localizable,
        }),
    };
    Ok(serde_json::to_string(&line)?)
}

/// The stages and their sum on one line, for the log.
pub(crate) fn stages_text(timings: &Timings) -> String {
    let stages: Vec<String> =
        stage_micros(timings).map(|(name, us)| format!("{name} {:.3}", us as f64 / 1e3)).collect();
    format!("{} ms", stages.join(", "))
}

/// The head of the table.
pub(crate) fn table_header(with_truth: bool) -> String {
    let mut head = format!(
        "{:>20} {:<9} {:>11} {:>11} {:>8} {:>7} {:>7} {:>5} {:>5} {:>7} {:>7} {:>8}",
        "stamp [s]",
        "verdict",
        "x [m]",
        "y [m]",
        "z [m]",
        "yaw [°]",
        "held[m]",
        "segs",
        "inl.",
        "score",
        "second",
        "ms"
    );
    if with_truth {
        head.push_str(&format!(" {:>9} {:>9}", "error [m]", "error [°]"));
    }
    head
}

/// A row of the table.
pub(crate) fn table_line(result: &Localization, judgement: Option<&Judgement>) -> String {
    let place = match &result.pose_map_sensor {
        Some(pose) => {
            let (t, yaw) = (pose.translation.vector, pose.rotation.euler_angles().2.to_degrees());
            format!("{:>11.2} {:>11.2} {:>8.2} {:>7.1}", t.x, t.y, t.z, yaw)
        }
        None => format!("{:>11} {:>11} {:>8} {:>7}", "-", "-", "-", "-"),
    };
    let segments = match result.segments - result.described {
        0 => result.segments.to_string(),
        _ => format!("{}/{}", result.described, result.segments),
    };
    let mut line = format!(
        "{:>20.6} {:<9} {place} {:>7.1} {segments:>5} {:>5} {:>7.2} {:>7.2} {:>8.1}",
        result.stamp,
        result.verdict.as_str(),
        result.travel_m,
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
        } else if judgement.localizable == Some(false) {
            line.push_str("  off the map");
        }
    }
    if let Some(reason) = &result.reason {
        line.push_str("  ");
        line.push_str(reason);
    }
    line
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use esm_core::{Pose, Verdict};
    use serde_json::{Value, json};

    use super::*;
    use crate::truth::PoseError;

    fn result() -> Localization {
        Localization {
            stamp: 1317600335.25,
            verdict: Verdict::Located,
            reason: None,
            pose_map_sensor: Some(Pose::translation(1.0, 2.0, 3.0)),
            covariance: Some([0.25; 36]),
            travel_m: 20.5,
            segments: 40,
            described: 40,
            inliers: 12,
            score: 9.5,
            overlap: 0.0,
            seen: 0.0,
            free_space_violated: 0.0,
            runner_up: 1.0,
            runner_up_pose_map_sensor: None,
            matches: Vec::new(),
            timings: Timings { pose: Duration::from_micros(1500), ..Default::default() },
        }
    }

    #[test]
    fn the_line_is_the_contracts() {
        let value: Value = serde_json::from_str(&json_line(&result(), None).unwrap()).unwrap();
        let keys: Vec<&str> = value.as_object().unwrap().keys().map(String::as_str).collect();
        let want = [
            "stamp",
            "verdict",
            "reason",
            "pose",
            "covariance",
            "travel_m",
            "segments",
            "described",
            "inliers",
            "score",
            "runner_up",
            "timings_ms",
        ];
        assert_eq!(keys, want);
        assert_eq!(value["pose"], json!({"t": [1.0, 2.0, 3.0], "q": [0.0, 0.0, 0.0, 1.0]}));
        assert_eq!(value["covariance"].as_array().unwrap().len(), 36);
        assert_eq!(value["reason"], Value::Null);
        assert_eq!(value["timings_ms"]["pose"], json!(1.5));
        assert_eq!(value["timings_ms"]["total"], json!(1.5));
        assert_eq!(value["timings_ms"].as_object().unwrap().len(), 8);
    }

    #[test]
    fn with_a_truth_the_line_tells_the_error_or_null() {
        let judgement = Judgement {
            truth: Some(Pose::identity()),
            localizable: Some(true),
            error: Some(PoseError { m: 0.5, deg: 0.25 }),
        };
        let line: Value = serde_json::from_str(&json_line(&result(), Some(&judgement)).unwrap()).unwrap();
        assert_eq!((&line["error_m"], &line["error_deg"]), (&json!(0.5), &json!(0.25)));
        assert_eq!(line["localizable"], json!(true));
        let outside = json_line(&result(), Some(&Judgement::default())).unwrap();
        let line: Value = serde_json::from_str(&outside).unwrap();
        assert_eq!((&line["error_m"], &line["localizable"]), (&Value::Null, &Value::Null));
    }

    #[test]
    fn rows_stand_under_their_heads() {
        let head = table_header(false);
        assert_eq!(table_line(&result(), None).chars().count(), head.chars().count());
        let lost = Localization { pose_map_sensor: None, verdict: Verdict::NotFound, ..result() };
        assert_eq!(table_line(&lost, None).chars().count(), head.chars().count());
    }
}

//! `results.json`, for programs.

use serde_json::{Map, Value, json};

use super::Report;
use crate::roc::RANKS;
use crate::stats::{Share, median};
use crate::trial::{Counts, STAGES};

fn counts(c: &Counts, recall: Option<Share>) -> Value {
    json!({
        "clouds": c.clouds,
        "localizable": c.localizable,
        "localizable_too_short": c.too_short,
        "located": c.located,
        "ambiguous": c.ambiguous,
        "found": c.found,
        "correct": c.correct,
        "false": c.wrong,
        "outside_truth": c.outside_truth,
        "recall": recall.map(|s| s.value),
        "recall_95": recall.map(|s| [s.low, s.high]),
    })
}

fn stages(p50: [Option<f64>; 9]) -> Value {
    Value::Object(STAGES.iter().map(|s| (*s).to_owned()).zip(p50.map(|v| json!(v))).collect::<Map<_, _>>())
}

pub(super) fn text(report: &Report<'_>) -> String {
    let pooled = report.pooled().into_iter().map(|p| {
        json!({
            "dataset": p.dataset,
            "mode": p.mode,
            "method": p.method,
            "seeds": p.seeds,
            "counts": counts(&p.counts, p.recall),
            "recall_over_seeds": p.recall_over_seeds.map(|s| s.value),
            "recall_over_seeds_95": p.recall_over_seeds.map(|s| [s.low, s.high]),
            "median_error_m": p.error_m,
            "median_error_deg": p.error_deg,
            "p50_ms": stages(p.stage_p50),
            "segments_p50": p.segments_p50,
            "peak_mib": p.peak_mib,
            "map_segments": p.map_segments,
            "map_bytes": p.map_bytes,
            "model_bytes": p.model_bytes,
        })
    });
    let results = report.of.outcomes.iter().map(|o| {
        let t = &o.trial;
        let (metres, degrees) = t.errors();
        json!({
            "dataset": o.dataset,
            "seed": o.seed,
            "mode": o.mode,
            "method": o.method,
            "accumulate_m": t.accumulate_m,
            "counts": counts(&t.counts, t.counts.recall()),
            "median_error_m": median(metres),
            "median_error_deg": median(degrees),
            "p50_ms": stages(t.stage_p50()),
            "segments_p50": median(t.clouds.iter().map(|c| c.segments as f64).collect()),
            "peak_mib": t.peak_mib,
            "map_segments": t.map_segments,
            "map_bytes": t.map_bytes,
            "map_built_s": t.map_built_s,
            "map_built_peak_mib": t.map_built_peak_mib,
            "model_bytes": t.model_bytes,
        })
    });
    let rocs = report.of.rocs.iter().map(|o| {
        let r = &o.roc;
        let recall: Map<String, Value> =
            RANKS.iter().zip(r.recall_at).map(|(k, v)| (k.to_string(), json!(v))).collect();
        json!({
            "dataset": o.dataset,
            "seed": o.seed,
            "method": o.method,
            "map_segments": r.map_segments,
            "live_segments": r.live_segments,
            "judged": r.judged,
            "negatives_random": r.negatives[0],
            "negatives_hard": r.negatives[1],
            "recall_at": recall,
            "random": r.random,
            "hard": r.hard,
            "random_best_two_thirds": r.random_best,
            "hard_best_two_thirds": r.hard_best,
            "random_judged": r.random_judged,
            "hard_judged": r.hard_judged,
        })
    });
    let all = json!({
        "plan": report.of.name,
        "pooled": pooled.collect::<Vec<_>>(),
        "results": results.collect::<Vec<_>>(),
        "roc": rocs.collect::<Vec<_>>(),
    });
    format!("{all:#}\n")
}

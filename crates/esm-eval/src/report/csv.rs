//! `results.csv`, for spreadsheets and scripts.

use super::Report;
use crate::stats::{Share, median};
use crate::trial::{Counts, STAGES};

/// Numbers as text, nothing where there is none.
fn cell(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(String::new, |v| format!("{v:.digits$}"))
}

fn counts(c: &Counts, recall: Option<Share>) -> Vec<String> {
    let numbers = [
        c.clouds,
        c.localizable,
        c.too_short,
        c.located,
        c.ambiguous,
        c.found,
        c.correct,
        c.wrong,
        c.outside_truth,
    ];
    let share = [recall.map(|s| s.value), recall.map(|s| s.low), recall.map(|s| s.high)];
    numbers.map(|n| n.to_string()).into_iter().chain(share.map(|s| cell(s, 6))).collect()
}

pub(super) fn text(report: &Report<'_>) -> String {
    let mut head: Vec<String> =
        "dataset,seed,mode,method,clouds,localizable,localizable_too_short,located,ambiguous,\
         found,correct,false,outside_truth,recall,recall_low,recall_high,median_error_m,median_error_deg"
            .split(',')
            .map(str::to_owned)
            .collect();
    head.extend(STAGES.map(|s| format!("{s}_p50_ms")));
    head.extend(["segments_p50", "peak_mib", "map_segments", "map_bytes", "model_bytes"].map(str::to_owned));
    let mut lines = vec![head.join(",")];
    for pooled in report.pooled() {
        let is = |o: &&crate::Outcome| {
            o.dataset == pooled.dataset && o.mode == pooled.mode && o.method == pooled.method
        };
        for o in report.of.outcomes.iter().filter(is) {
            let t = &o.trial;
            let seed = o.seed.map_or_else(String::new, |s| s.to_string());
            let mut line = vec![o.dataset.clone(), seed, o.mode.clone(), o.method.clone()];
            line.extend(counts(&t.counts, t.counts.recall()));
            let (metres, degrees) = t.errors();
            line.extend([cell(median(metres), 6), cell(median(degrees), 6)]);
            line.extend(t.stage_p50().map(|v| cell(v, 3)));
            line.push(cell(median(t.clouds.iter().map(|c| c.segments as f64).collect()), 1));
            line.push(cell(t.peak_mib, 1));
            line.extend([t.map_segments as u64, t.map_bytes, t.model_bytes].map(|n| n.to_string()));
            lines.push(line.join(","));
        }
        let p = &pooled;
        let mut line = vec![p.dataset.clone(), "all".to_owned(), p.mode.clone(), p.method.clone()];
        line.extend(counts(&p.counts, p.recall));
        line.extend([cell(p.error_m, 6), cell(p.error_deg, 6)]);
        line.extend(p.stage_p50.map(|v| cell(v, 3)));
        line.extend([cell(p.segments_p50, 1), cell(p.peak_mib, 1)]);
        line.extend([p.map_segments, p.map_bytes].map(|v| format!("{v:.0}")));
        line.push(p.model_bytes.to_string());
        lines.push(line.join(","));
    }
    lines.join("\n") + "\n"
}

//! The table for a terminal.

use super::Report;
use crate::stats::Share;

/// Columns under each other: texts to the left, numbers to the right.
fn aligned(rows: &[Vec<String>], texts: usize) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |i: usize| rows.iter().filter_map(|r| r.get(i)).map(|c| c.chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        let cells = row.iter().zip(&widths).enumerate().map(|(i, (cell, width))| match i < texts {
            true => format!("{cell:<width$}"),
            false => format!("{cell:>width$}"),
        });
        text.push_str(cells.collect::<Vec<_>>().join("  ").trim_end());
        text.push('\n');
    }
    text
}

fn row<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

pub(super) fn percent(share: Option<f64>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1} %", 100.0 * s))
}

pub(super) fn interval(share: Option<Share>) -> String {
    share.map_or_else(|| "-".to_owned(), |s| format!("{:.1} - {:.1}", 100.0 * s.low, 100.0 * s.high))
}

pub(super) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |v| format!("{v:.digits$}"))
}

pub(super) fn text(report: &Report<'_>) -> String {
    let mut rows = vec![row([
        "dataset",
        "mode",
        "method",
        "clouds",
        "localizable",
        "rightly",
        "recall",
        "95 %",
        "false",
        "error [m]",
        "ms a cloud",
        "peak MiB",
    ])];
    for p in report.pooled() {
        rows.push(vec![
            p.dataset.clone(),
            p.mode.clone(),
            p.method.clone(),
            p.counts.clouds.to_string(),
            p.counts.localizable.to_string(),
            p.counts.found.to_string(),
            percent(p.recall.map(|s| s.value)),
            interval(p.recall),
            p.counts.wrong.to_string(),
            number(p.error_m, 2),
            number(p.stage_p50[8], 1),
            number(p.peak_mib, 0),
        ]);
    }
    let mut text = aligned(&rows, 3);
    if !report.of.rocs.is_empty() {
        let mut rows = vec![row([
            "dataset",
            "seed",
            "method",
            "judged",
            "recall@1",
            "recall@25",
            "AUC",
            "by quality",
            "hard",
            "by quality",
            "judged",
            "hard",
        ])];
        for o in &report.of.rocs {
            let r = &o.roc;
            let auc = |c: &Option<crate::Curve>| number(c.as_ref().map(|c| c.auc), 3);
            rows.push(vec![
                o.dataset.clone(),
                o.seed.map_or_else(String::new, |s| s.to_string()),
                o.method.clone(),
                r.judged.to_string(),
                number(Some(r.recall_at[0]), 3),
                number(Some(r.recall_at[1]), 3),
                auc(&r.random),
                auc(&r.random_best),
                auc(&r.hard),
                auc(&r.hard_best),
                auc(&r.random_judged),
                auc(&r.hard_judged),
            ]);
        }
        text.push('\n');
        text.push_str(&aligned(&rows, 3));
    }
    text
}

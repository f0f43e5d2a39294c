//! `report.md`: tables shaped like the paper's.

use super::table::{interval, number, percent};
use super::{Pooled, Report};
use crate::plan::Source;
use crate::run::RocOutcome;
use crate::trial::STAGES;

/// Seeds below this are for training and tuning.
const FIRST_JUDGING_SEED: u64 = 200;

const PROTOCOL: &str = "\
A cloud is located *rightly* within 2 m and 5° of the truth, *falsely* when it was located and is not; *localizable* when its
true position is within 10 m of the mapped path. Recall is counted over the localizable clouds that hold at least 95 % of the
asked travel, false ones over all clouds. Intervals are Wilson's, 95 %, over clouds; *over worlds* is the mean over the seeds
with Student's.\n";

/// A table of Markdown; the first `texts` columns stand to the left.
fn table(head: &[String], texts: usize, rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let rule: Vec<String> =
        (0..head.len()).map(|i| if i < texts { "---".to_owned() } else { "--:".to_owned() }).collect();
    let mut text = line(head) + &line(&rule);
    rows.iter().for_each(|row| text.push_str(&line(row)));
    text
}

fn words(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|c| (*c).to_owned()).collect()
}

pub(super) fn text(report: &Report<'_>, figures: &[(String, String)]) -> String {
    let plan = &report.of.plan;
    let all = report.pooled();
    let mut text = format!("# {}\n\n{PROTOCOL}", report.of.name);
    let seeds = |s: &Source| match s {
        Source::Simulated(worlds) => worlds.seeds.clone(),
        Source::Files(_) => Vec::new(),
    };
    if plan.datasets.iter().flat_map(|d| seeds(&d.source)).any(|s| s < FIRST_JUDGING_SEED) {
        text.push_str(&format!(
            "\nSeeds below {FIRST_JUDGING_SEED} are for training and tuning: what follows is no judgement.\n"
        ));
    }
    text.push_str("\n## Localizations\n");
    for mode in &plan.modes {
        let of_mode: Vec<&Pooled> = all.iter().filter(|p| p.mode == mode.name).collect();
        if !of_mode.is_empty() {
            text.push_str(&format!("\n### {}\n\n{}\n", mode.name, localizations(report, &of_mode)));
        }
    }
    text.push_str(&format!("\n## In detail\n\n{}", details(&all)));
    text.push_str(&format!(
        "\n## Time\n\nMedian milliseconds a cloud, in one thread. *Judging* is the forest's (*pruning RF* in the paper).\n\n{}",
        times(&all)
    ));
    if !report.of.rocs.is_empty() {
        text.push_str(&format!("\n## Descriptors\n\n{}\n{}", CURVES, curves(&report.of.rocs)));
    }
    if !figures.is_empty() {
        text.push_str("\n## Figures\n");
        for (file, caption) in figures {
            text.push_str(&format!("\n![{caption}]({file})\n\n{caption}\n"));
        }
    }
    text
}

const CURVES: &str = "\
Segments of the second visit against those of the first, unmerged; positives are the same object, random negatives lie at least
20 m away, hard ones besides are alike in height and both extents within 20 %. *Best* is without the third of the pairs whose
joint quality is worst; *judged* is by the method's forest instead of its distance.\n";

/// The paper's table I: located rightly, a row a dataset and a column a method; the best bold.
fn localizations(report: &Report<'_>, of_mode: &[&Pooled]) -> String {
    let methods: Vec<&str> = report
        .of
        .plan
        .methods
        .iter()
        .map(|m| m.name.as_str())
        .filter(|m| of_mode.iter().any(|p| p.method == *m))
        .collect();
    let mut head = words(&["dataset", "clouds", "localizable"]);
    head.extend(methods.iter().map(|m| (*m).to_owned()));
    let mut rows = Vec::new();
    for dataset in &report.of.plan.datasets {
        let here: Vec<&&Pooled> = of_mode.iter().filter(|p| p.dataset == dataset.name).collect();
        let Some(first) = here.first() else { continue };
        let best = here.iter().map(|p| p.counts.found).max().unwrap_or(0);
        let mut row =
            vec![dataset.name.clone(), first.counts.clouds.to_string(), first.counts.localizable.to_string()];
        row.extend(methods.iter().map(|m| match here.iter().find(|p| p.method == *m) {
            None => String::new(),
            Some(p) => {
                let n = p.counts.found;
                let mark = if n == best && best > 0 { "**" } else { "" };
                let wrong = match p.counts.wrong {
                    0 => String::new(),
                    wrong => format!(", {wrong} false"),
                };
                format!("{mark}{n}{mark} ({}){wrong}", percent(p.recall.map(|s| s.value)))
            }
        }));
        rows.push(row);
    }
    table(&head, 1, &rows)
}

fn details(all: &[Pooled]) -> String {
    let head = words(&[
        "mode",
        "dataset",
        "method",
        "worlds",
        "rightly",
        "recall, 95 %",
        "over worlds, 95 %",
        "false",
        "ambiguous",
        "median error",
        "segments a cloud",
        "peak memory, MiB",
        "map segments",
        "map, MB",
        "weights, MB",
    ]);
    let row = |p: &Pooled| {
        let error = match (p.error_m, p.error_deg) {
            (Some(m), Some(deg)) => format!("{m:.2} m, {deg:.2}°"),
            _ => "-".to_owned(),
        };
        let over = p.recall_over_seeds.map_or_else(
            || "-".to_owned(),
            |s| format!("{} ({})", percent(Some(s.value)), interval(Some(s))),
        );
        vec![
            p.mode.clone(),
            p.dataset.clone(),
            p.method.clone(),
            p.seeds.len().max(1).to_string(),
            format!("{} of {}", p.counts.found, p.counts.localizable),
            format!("{} ({})", percent(p.recall.map(|s| s.value)), interval(p.recall)),
            over,
            p.counts.wrong.to_string(),
            p.counts.ambiguous.to_string(),
            error,
            number(p.segments_p50, 0),
            number(p.peak_mib, 0),
            format!("{:.0}", p.map_segments),
            format!("{:.1}", p.map_bytes * 1e-6),
            if p.model_bytes == 0 { "-".to_owned() } else { format!("{:.1}", p.model_bytes as f64 * 1e-6) },
        ]
    };
    table(&head, 3, &all.iter().map(row).collect::<Vec<_>>())
}

/// The paper's table II: a row a method, a column a stage.
fn times(all: &[Pooled]) -> String {
    let mut head = words(&["mode", "dataset", "method"]);
    head.extend(STAGES.map(str::to_owned));
    let row = |p: &Pooled| {
        let mut cells = vec![p.mode.clone(), p.dataset.clone(), p.method.clone()];
        cells.extend(p.stage_p50.map(|v| number(v, if v.is_some_and(|v| v < 10.0) { 1 } else { 0 })));
        cells
    };
    table(&head, 3, &all.iter().map(row).collect::<Vec<_>>())
}

fn curves(rocs: &[RocOutcome]) -> String {
    let head = words(&[
        "dataset",
        "seed",
        "method",
        "judged, of live, among map",
        "recall@1",
        "recall@25",
        "recall@100",
        "AUC, random",
        "best",
        "judged",
        "AUC, hard",
        "best",
        "judged",
    ]);
    let auc = |c: &Option<crate::Curve>| c.as_ref().map_or_else(String::new, |c| format!("{:.3}", c.auc));
    let row = |o: &RocOutcome| {
        let r = &o.roc;
        let mut cells = vec![
            o.dataset.clone(),
            o.seed.map_or_else(String::new, |s| s.to_string()),
            o.method.clone(),
            format!("{} of {}, {}", r.judged, r.live_segments, r.map_segments),
        ];
        cells.extend(r.recall_at.map(|v| format!("{v:.3}")));
        cells.extend([&r.random, &r.random_best, &r.random_judged].map(auc));
        cells.extend([&r.hard, &r.hard_best, &r.hard_judged].map(auc));
        cells
    };
    table(&head, 3, &rocs.iter().map(row).collect::<Vec<_>>())
}

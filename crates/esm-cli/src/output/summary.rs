//! The last word of a run: counts, errors, times and memory.

use std::time::Instant;

use esm_core::Timings;
use esm_io::stage_micros;
use serde_json::{Map, Value, json};

use crate::memory;
use crate::truth::{Quantiles, Tally};

/// Percentiles of every stage.
pub(crate) struct StageTimes {
    /// The stages in order, the total last; milliseconds.
    stages: Vec<(&'static str, Quantiles)>,
    started: Instant,
}

impl StageTimes {
    pub(crate) fn start() -> Self {
        let names = Timings::default().stages().map(|s| s.0);
        let stages = names.into_iter().chain(["total"]).map(|name| (name, Quantiles::default())).collect();
        Self { stages, started: Instant::now() }
    }

    pub(crate) fn add(&mut self, timings: &Timings) {
        for ((_, quantiles), (_, us)) in self.stages.iter_mut().zip(stage_micros(timings)) {
            quantiles.add(us as f64 / 1e3);
        }
    }

    /// Median of the total, milliseconds.
    pub(crate) fn total_p50(&self) -> Option<f64> {
        self.stages.last().and_then(|(_, q)| q.at(0.5))
    }

    /// Every stage with its median, the total last; milliseconds.
    pub(crate) fn medians(&self) -> Vec<(&'static str, Option<f64>)> {
        self.stages.iter().map(|(name, q)| (*name, q.at(0.5))).collect()
    }

    /// `{"total": {"p50":..,"p95":..,"max":..}, ...}`, milliseconds.
    pub(crate) fn json(&self) -> Value {
        let of = |q: &Quantiles| json!({"p50": micro(q.at(0.5)), "p95": micro(q.at(0.95)), "p99": micro(q.at(0.99)), "max": micro(q.max())});
        Value::Object(self.stages.iter().map(|(name, q)| ((*name).to_owned(), of(q))).collect())
    }

    /// A line a stage.
    pub(crate) fn table(&self) -> String {
        let mut text = format!("{:<16} {:>9} {:>9} {:>9} {:>9}\n", "ms a cloud", "p50", "p95", "p99", "max");
        for (name, q) in &self.stages {
            let cell = |v: Option<f64>| v.map_or_else(|| "-".to_owned(), |v| format!("{v:.2}"));
            let row = [q.at(0.5), q.at(0.95), q.at(0.99), q.max()].map(cell);
            text.push_str(&format!("{name:<16} {:>9} {:>9} {:>9} {:>9}\n", row[0], row[1], row[2], row[3]));
        }
        text
    }
}

/// What a run adds up to, as `localize` and `loops` print it.
pub(crate) struct Summary<'a> {
    pub(crate) tally: &'a Tally,
    pub(crate) times: &'a StageTimes,
    pub(crate) with_truth: bool,
    /// Metres of travel a full cloud holds.
    pub(crate) accumulate_m: f64,
}

impl Summary<'_> {
    /// The object under `"summary"`.
    pub(crate) fn json(&self) -> Map<String, Value> {
        let t = self.tally;
        let mut all = Map::new();
        let mut put = |key: &str, value: Value| all.insert(key.to_owned(), value);
        put("clouds", json!(t.clouds));
        put("located", json!(t.located));
        put("ambiguous", json!(t.ambiguous));
        put("not_found", json!(t.not_found));
        if self.with_truth {
            put("localizable", json!(t.localizable));
            put("localizable_too_short", json!(t.too_short));
            put("found", json!(t.found));
            put("correct", json!(t.correct));
            put("false", json!(t.wrong));
            put("recall", json!(t.recall()));
            put("median_error_m", json!(micro(t.errors_m.at(0.5))));
            put("median_error_deg", json!(micro(t.errors_deg.at(0.5))));
            put("outside_truth", json!(t.outside_truth));
        }
        if t.shed.0 > 0 {
            put("shed", json!({"clouds": t.shed.0, "segments": t.shed.1}));
        }
        put("accumulate_m", json!(self.accumulate_m));
        put("timings_ms", self.times.json());
        put("elapsed_s", json!(micro(Some(self.times.started.elapsed().as_secs_f64()))));
        put("peak_memory_mib", json!(memory::peak_mib()));
        all
    }

    /// The same for people.
    pub(crate) fn table(&self) -> String {
        let t = self.tally;
        let mut text = format!(
            "clouds {}   located {}   ambiguous {}   not found {}\n",
            t.clouds, t.located, t.ambiguous, t.not_found
        );
        if self.with_truth {
            let percent = t.recall().map_or_else(|| "-".to_owned(), |r| format!("{:.1} %", 100.0 * r));
            text.push_str(&format!(
                "recall {percent} ({} of {} localizable clouds)   correct {}   false {}\n",
                t.found, t.localizable, t.correct, t.wrong
            ));
            if t.too_short > 0 {
                text.push_str(&format!(
                    "({} more localizable clouds hold less than {:.0} % of {} m and do not count for recall)\n",
                    t.too_short,
                    100.0 * crate::truth::TRAVEL_SHARE,
                    self.accumulate_m
                ));
            }
            if t.outside_truth > 0 {
                text.push_str(&format!(
                    "({} clouds outside the truth, or in a gap of it, are not counted)\n",
                    t.outside_truth
                ));
            }
            if let (Some(m), Some(deg)) = (t.errors_m.at(0.5), t.errors_deg.at(0.5)) {
                text.push_str(&format!("median error {m:.3} m, {deg:.3}°\n"));
            }
        }
        if t.shed.0 > 0 {
            text.push_str(&format!(
                "({} segments of {} clouds were left out for want of time: --budget-ms)\n",
                t.shed.1, t.shed.0
            ));
        }
        text.push('\n');
        text.push_str(&self.times.table());
        let memory = memory::peak_mib().map_or_else(|| "unknown".to_owned(), |m| format!("{m:.0} MiB"));
        let elapsed = self.times.started.elapsed().as_secs_f64();
        text.push_str(&format!("\npeak memory {memory}   elapsed {elapsed:.1} s"));
        text
    }
}

/// Rounded to six decimals.
fn micro(value: Option<f64>) -> Option<f64> {
    value.map(|v| (v * 1e6).round() / 1e6)
}

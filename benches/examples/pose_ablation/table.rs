//! Outcomes as a Markdown table.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use esm_core::Verdict;

use crate::recording::Recorded;
use crate::ways::Row;

/// Matches that a place must have to be believed without verification, for every way.
#[derive(Default)]
pub(crate) struct Frozen(BTreeMap<String, usize>);

impl Frozen {
    /// From a file of an earlier run; empty where there is none.
    pub(crate) fn read(path: Option<&Path>) -> Result<Self, Box<dyn std::error::Error>> {
        match path {
            Some(path) if path.exists() => Ok(Self(serde_json::from_slice(&std::fs::read(path)?)?)),
            _ => Ok(Self::default()),
        }
    }

    pub(crate) fn write(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        Ok(esm_io::write_file(path, &serde_json::to_vec_pretty(&self.0)?)?)
    }

    /// Raises a way's number to where nothing false is accepted.
    pub(crate) fn learn(&mut self, row: &Row) {
        let least = fewest_without_false(row).max(self.0.get(&key(row)).copied().unwrap_or(0));
        self.0.insert(key(row), least);
    }

    fn of(&self, row: &Row) -> usize {
        self.0.get(&key(row)).copied().unwrap_or_else(|| fewest_without_false(row))
    }
}

fn key(row: &Row) -> String {
    format!("{}, {}", row.way, row.candidates)
}

fn fewest_without_false(row: &Row) -> usize {
    row.outcomes.iter().filter(|o| !o.first_right).map(|o| o.inliers + 1).max().unwrap_or(0)
}

/// One line a way. Right ones are counted among localizable clouds, false ones among all.
pub(crate) fn markdown(rows: &[Row], clouds: &[Recorded], frozen: &Frozen) -> String {
    let localizable = clouds.iter().filter(|c| c.localizable).count();
    let mut text = format!(
        "{} clouds, {localizable} localizable\n\n\
         | candidates | way | right place first | among all places | matches wanted | right without verification | false \
         | right with verification | ambiguous | false | samples or branches, median | 90 % | matches | pair tests, median | pairs that agree | matches left | ms, median | 90 % |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
        clouds.len()
    );
    for row in rows {
        let counted = || row.outcomes.iter().zip(clouds).filter(|(_, c)| c.localizable).map(|(o, _)| o);
        let wanted = frozen.of(row);
        let right = counted().filter(|o| o.first_right && o.inliers >= wanted).count();
        let wrong = row.outcomes.iter().filter(|o| !o.first_right && o.inliers >= wanted.max(1)).count();
        let located = |o: &&crate::ways::Outcome| o.verdict == Verdict::Located;
        let mut line = vec![
            row.candidates.to_owned(),
            row.way.to_owned(),
            counted().filter(|o| o.first_right).count().to_string(),
            counted().filter(|o| o.any_right).count().to_string(),
            wanted.to_string(),
            right.to_string(),
            wrong.to_string(),
            counted().filter(located).filter(|o| o.verified_right).count().to_string(),
            counted().filter(|o| o.verdict == Verdict::Ambiguous).count().to_string(),
            row.outcomes.iter().filter(located).filter(|o| !o.verified_right).count().to_string(),
        ];
        let quantile = |of: &dyn Fn(&crate::ways::Outcome) -> f64, q: f64| {
            let mut values: Vec<f64> = row.outcomes.iter().map(of).collect();
            values.sort_by(f64::total_cmp);
            values.get(((values.len().max(1) - 1) as f64 * q).round() as usize).copied().unwrap_or(0.0)
        };
        line.push(format!("{:.0}", quantile(&|o| o.effort as f64, 0.5)));
        line.push(format!("{:.0}", quantile(&|o| o.effort as f64, 0.9)));
        line.push(format!("{:.0}", quantile(&|o| o.matches as f64, 0.5)));
        line.push(format!("{:.0}", quantile(&|o| o.pair_tests as f64, 0.5)));
        line.push(format!("{:.0}", quantile(&|o| o.edges as f64, 0.5)));
        line.push(format!("{:.0}", quantile(&|o| o.kept as f64, 0.5)));
        line.push(format!("{:.2}", quantile(&|o| o.ms, 0.5)));
        line.push(format!("{:.2}", quantile(&|o| o.ms, 0.9)));
        let _ = writeln!(text, "| {} |", line.join(" | "));
    }
    text
}

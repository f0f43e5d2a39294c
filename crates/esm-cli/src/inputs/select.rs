//! `--frames`, `--from` and `--to`.

use std::str::FromStr;

use crate::args::ReadArgs;
use crate::outcome::Failure;

/// Scans `first` to `last`, counted from 1, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    /// First scan.
    pub first: usize,
    /// Last scan.
    pub last: usize,
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (first, last) = text.split_once('-').unwrap_or((text, text));
        let number =
            |s: &str| s.trim().parse::<usize>().map_err(|_| format!("'{text}' is not of the form A-B"));
        let range = Self { first: number(first)?, last: number(last)? };
        if range.first == 0 {
            return Err("scans are counted from 1".to_owned());
        }
        if range.last < range.first {
            return Err(format!("{text} ends before it begins"));
        }
        Ok(range)
    }
}

impl std::fmt::Display for FrameRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}-{}", self.first, self.last)
    }
}

/// Which scans are used.
#[derive(Clone, Debug, Default)]
pub(crate) struct Selection {
    /// Ascending and apart; empty for all.
    ranges: Vec<FrameRange>,
    from_s: f64,
    to_s: f64,
}

impl Selection {
    /// Checks the flags.
    pub(crate) fn new(args: &ReadArgs) -> Result<Self, Failure> {
        let mut ranges = args.frames.clone();
        ranges.sort_by_key(|r| r.first);
        if let Some(pair) = ranges.windows(2).find(|p| p[1].first <= p[0].last) {
            let what = format!("--frames: {} and {} overlap", pair[0], pair[1]);
            return Err(Failure::new(what, "give every scan once"));
        }
        for (flag, value) in [("--from", args.from), ("--to", args.to)] {
            if value.is_some_and(|s| !(s.is_finite() && s >= 0.0)) {
                let what = format!("{flag} {}: not a time since the first scan", value.unwrap_or_default());
                return Err(Failure::new(what, "give seconds, 0 or more"));
            }
        }
        let (from_s, to_s) = (args.from.unwrap_or(0.0), args.to.unwrap_or(f64::INFINITY));
        if to_s < from_s {
            return Err(Failure::new(
                format!("--from {} --to {} ends before it begins", seconds(from_s), seconds(to_s)),
                "swap them",
            ));
        }
        Ok(Self { ranges, from_s, to_s })
    }

    /// Whether a scan is used: its number, and its time since the first one.
    pub(crate) fn holds(&self, number: usize, elapsed_s: f64) -> bool {
        let numbered =
            self.ranges.is_empty() || self.ranges.iter().any(|r| (r.first..=r.last).contains(&number));
        // Stamps out of order may lie before the first one.
        numbered && elapsed_s <= self.to_s && (elapsed_s >= self.from_s || self.from_s == 0.0)
    }

    /// Whether no scan with this number or a later one is used.
    pub(crate) fn is_past(&self, number: usize) -> bool {
        self.ranges.last().is_some_and(|r| number > r.last)
    }

    /// At the end of the input: whether all that was asked for was there.
    ///
    /// # Errors
    /// [`Failure`] for a range of which there was nothing, or a time in which there was nothing; a warning where a range
    /// was cut off.
    pub(crate) fn check(&self, scans: usize, duration_s: f64, used: usize) -> Result<(), Failure> {
        for range in &self.ranges {
            if range.first > scans {
                let what = format!("--frames {range}: the input holds {scans} scans");
                return Err(Failure::new(what, format!("give numbers from 1 to {scans}")));
            }
            if range.last > scans {
                tracing::warn!("--frames {range}: the input ends with scan {scans}");
            }
        }
        if used == 0 && scans > 0 {
            let what = format!("{}: no scan was taken then", self.asked());
            return Err(Failure::new(what, format!("the scans span {duration_s:.3} s")));
        }
        Ok(())
    }

    /// The flags that were given.
    fn asked(&self) -> String {
        let mut flags: Vec<String> = Vec::new();
        if !self.ranges.is_empty() {
            let ranges: Vec<String> = self.ranges.iter().map(ToString::to_string).collect();
            flags.push(format!("--frames {}", ranges.join(",")));
        }
        if self.from_s > 0.0 {
            flags.push(format!("--from {}", seconds(self.from_s)));
        }
        if self.to_s.is_finite() {
            flags.push(format!("--to {}", seconds(self.to_s)));
        }
        flags.join(" ")
    }
}

/// Seconds as people type them: `1e9`, not a row of zeros.
fn seconds(s: f64) -> String {
    let (plain, short) = (s.to_string(), format!("{s:e}"));
    if plain.len() > 7 && short.len() < plain.len() { short } else { plain }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn selection(frames: &[&str], from: Option<f64>, to: Option<f64>) -> Result<Selection, String> {
        let frames = frames.iter().map(|f| f.parse().unwrap()).collect();
        Selection::new(&ReadArgs { frames, from, to, ..Default::default() }).map_err(|e| e.to_string())
    }

    #[test]
    fn ranges_are_read() {
        assert_eq!("3-7".parse(), Ok(FrameRange { first: 3, last: 7 }));
        assert_eq!("3".parse(), Ok(FrameRange { first: 3, last: 3 }));
        for (bad, words) in [
            ("0-3", "counted from 1"),
            ("7-3", "ends before it begins"),
            ("a-b", "form A-B"),
            ("-3", "form A-B"),
            ("3-", "form A-B"),
            ("", "form A-B"),
            ("99999999999999999999999", "form A-B"),
        ] {
            let error = bad.parse::<FrameRange>().unwrap_err();
            assert!(error.contains(words), "{bad}: {error}");
        }
    }

    #[test]
    fn scans_are_chosen_by_number_and_by_time() {
        let s = selection(&["5-6", "2-3"], None, None).unwrap();
        assert_eq!((1..8).filter(|&n| s.holds(n, 0.0)).collect::<Vec<_>>(), [2, 3, 5, 6]);
        assert!(s.is_past(7) && !s.is_past(4));
        let s = selection(&[], Some(1.0), Some(2.0)).unwrap();
        assert_eq!([0.9, 1.0, 2.0, 2.1].map(|t| s.holds(1, t)), [false, true, true, false]);
        let all = selection(&[], None, None).unwrap();
        assert!(all.holds(1, -5.0) && !all.is_past(usize::MAX));
    }

    #[test]
    fn impossible_choices_are_refused() {
        assert!(selection(&["1-5", "5-6"], None, None).unwrap_err().contains("1-5 and 5-6 overlap"));
        assert!(selection(&[], Some(2.0), Some(1.0)).unwrap_err().contains("ends before it begins"));
        assert!(selection(&[], Some(-1.0), None).unwrap_err().contains("--from -1"));
        assert!(selection(&[], None, Some(f64::NAN)).unwrap_err().contains("--to NaN"));
        let s = selection(&["3-4", "9-12"], None, None).unwrap();
        assert!(
            s.check(8, 1.0, 2).unwrap_err().to_string().contains("--frames 9-12: the input holds 8 scans")
        );
        assert!(s.check(10, 1.0, 4).is_ok());
        let s = selection(&[], Some(50.0), None).unwrap();
        assert_eq!(
            s.check(8, 1.5, 0).unwrap_err().to_string(),
            "--from 50: no scan was taken then\nhint: the scans span 1.500 s"
        );
        for (from, to, words) in [
            (Some(1e9), None, "--frames 3-4 --from 1e9: no scan"),
            (Some(20.5), Some(30.0), "--frames 3-4 --from 20.5 --to 30: no scan"),
            (None, Some(0.25), "--frames 3-4 --to 0.25: no scan"),
        ] {
            let error = selection(&["3-4"], from, to).unwrap().check(8, 1.5, 0).unwrap_err().to_string();
            assert!(error.starts_with(words), "{error}");
        }
    }
}

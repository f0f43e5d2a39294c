//! [`Tally`]: counts and percentiles over the clouds of a run, in memory that does not grow with them.

use esm_core::{Localization, Pose, Verdict};

use super::{Places, PoseError, TRAVEL_SHARE, Trajectory};

/// What the truth says about one cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Judgement {
    /// Where the sensor truly was, where the truth says so.
    pub truth: Option<Pose>,
    /// Whether the map can be expected to localize there; `None` outside the truth.
    pub localizable: Option<bool>,
    /// Of the given pose, where there are both.
    pub error: Option<PoseError>,
}

impl Judgement {
    /// Judges one result.
    pub fn of(result: &Localization, truth: &Trajectory, places: &Places) -> Self {
        let Some(truth) = truth.at(result.stamp) else { return Self::default() };
        Self {
            truth: Some(truth),
            localizable: Some(places.holds(&truth.translation.vector.into())),
            error: result.pose_map_sensor.map(|pose| PoseError::between(&pose, &truth)),
        }
    }

    /// Whether a located result is correct; `None` where nothing can be said.
    pub fn is_correct(&self, verdict: Verdict) -> Option<bool> {
        match (verdict, self.truth) {
            (Verdict::Located, Some(_)) => Some(self.error.is_some_and(PoseError::is_correct)),
            _ => None,
        }
    }
}

/// Counts over a run.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Clouds that were localized or not; with a truth only those inside it.
    pub clouds: usize,
    /// Clouds outside the truth or in a gap of it, which nothing else counts.
    pub outside_truth: usize,
    /// Verdict `located`.
    pub located: usize,
    /// Verdict `ambiguous`.
    pub ambiguous: usize,
    /// Verdict `not_found`.
    pub not_found: usize,
    /// Localizable clouds that hold enough travel.
    pub localizable: usize,
    /// Localizable clouds that hold too little travel to count for recall.
    pub too_short: usize,
    /// Correct among `localizable`.
    pub found: usize,
    /// Located correctly, anywhere.
    pub correct: usize,
    /// Located and not correct, anywhere.
    pub wrong: usize,
    /// Clouds of which some segments were not described, and how many in all, for want of time.
    pub shed: (usize, usize),
    /// Of the correct ones, metres.
    pub errors_m: Quantiles,
    /// Of the correct ones, degrees.
    pub errors_deg: Quantiles,
}

impl Tally {
    /// Counts one cloud. `judgement` where there is a truth; `asked_travel_m` is the travel a full cloud holds.
    pub fn add(&mut self, result: &Localization, judgement: Option<&Judgement>, asked_travel_m: f64) {
        if judgement.is_some_and(|j| j.truth.is_none()) {
            self.outside_truth += 1;
            return;
        }
        self.clouds += 1;
        match result.verdict {
            Verdict::Located => self.located += 1,
            Verdict::Ambiguous => self.ambiguous += 1,
            Verdict::NotFound => self.not_found += 1,
        }
        let shed = result.segments - result.described;
        self.shed = (self.shed.0 + usize::from(shed > 0), self.shed.1 + shed);
        let Some(judgement) = judgement else { return };
        let correct = judgement.is_correct(result.verdict);
        if judgement.localizable == Some(true) {
            if result.travel_m >= TRAVEL_SHARE * asked_travel_m {
                self.localizable += 1;
                self.found += usize::from(correct == Some(true));
            } else {
                self.too_short += 1;
            }
        }
        match correct {
            Some(true) => {
                self.correct += 1;
                if let Some(error) = judgement.error {
                    self.errors_m.add(error.m);
                    self.errors_deg.add(error.deg);
                }
            }
            Some(false) => self.wrong += 1,
            None => {}
        }
    }

    /// Share of the localizable clouds that were located correctly; `None` where none is localizable.
    pub fn recall(&self) -> Option<f64> {
        (self.localizable > 0).then(|| self.found as f64 / self.localizable as f64)
    }
}

/// Percentiles of any number of values, to half a percent of the value, in 33 kB.
#[derive(Clone, Debug, Default)]
pub struct Quantiles {
    /// Bucket i > 0 counts values in `LEAST * GROWTH^(i-1) .. LEAST * GROWTH^i`; bucket 0 those below `LEAST`.
    buckets: Vec<u64>,
    count: u64,
    max: f64,
}

/// Values below this count as 0.
const LEAST: f64 = 1e-6;
const GROWTH: f64 = 1.01;
/// The last bucket begins at 8e11.
const BUCKETS: usize = 4200;

impl Quantiles {
    /// Adds a value that is not negative.
    pub fn add(&mut self, value: f64) {
        if self.buckets.is_empty() {
            self.buckets = vec![0; BUCKETS];
        }
        let bucket = match value > LEAST {
            true => (((value / LEAST).ln() / GROWTH.ln()).floor() as usize + 1).min(BUCKETS - 1),
            false => 0,
        };
        self.buckets[bucket] += 1;
        self.count += 1;
        self.max = self.max.max(value);
    }

    /// The value that a share of all values does not exceed; `None` without values.
    pub fn at(&self, share: f64) -> Option<f64> {
        let rank = ((share * self.count as f64).ceil() as u64).clamp(1, self.count.max(1));
        let mut below = 0;
        let bucket = self.buckets.iter().position(|n| {
            below += n;
            below >= rank
        })?;
        let middle = LEAST * GROWTH.powf(bucket as f64 - 0.5);
        Some(if bucket == 0 { 0.0 } else { middle.min(self.max) })
    }

    /// The largest value, exactly.
    pub fn max(&self) -> Option<f64> {
        (self.count > 0).then_some(self.max)
    }
}

#[cfg(test)]
mod tests {
    use esm_core::Timings;

    use super::*;

    fn result(stamp: f64, verdict: Verdict, x: Option<f64>, travel_m: f64) -> Localization {
        Localization {
            stamp,
            verdict,
            reason: None,
            pose_map_sensor: x.map(|x| Pose::translation(x, 0.0, 0.0)),
            covariance: None,
            travel_m,
            segments: 0,
            described: 0,
            inliers: 0,
            score: 0.0,
            overlap: 0.0,
            seen: 0.0,
            free_space_violated: 0.0,
            runner_up: 0.0,
            runner_up_pose_map_sensor: None,
            matches: Vec::new(),
            timings: Timings::default(),
        }
    }

    /// A robot that drives along x, a metre a second, in a map of its first 50 m.
    fn tally(results: &[Localization]) -> Tally {
        let truth =
            Trajectory::new((0..=100).map(|i| (i as f64, Pose::translation(i as f64, 0.0, 0.0))).collect());
        let path: Vec<[f64; 3]> = (0..=50).map(|i| [i as f64, 0.0, 0.0]).collect();
        let places = Places::along(&path);
        let mut tally = Tally::default();
        for r in results {
            tally.add(r, Some(&Judgement::of(r, &truth, &places)), 20.0);
        }
        tally
    }

    #[test]
    fn recall_counts_full_clouds_only_and_false_counts_all() {
        use Verdict::{Ambiguous, Located, NotFound};
        let t = tally(&[
            result(5.0, Located, Some(5.0), 5.0),      // correct, too short for recall
            result(6.0, Located, Some(9.0), 6.0),      // false, too short for recall
            result(30.0, Located, Some(30.5), 20.0),   // found
            result(31.0, NotFound, None, 19.0),        // missed: 95 % of 20 m count as full
            result(32.0, Ambiguous, Some(99.0), 20.0), // missed, and nothing false was claimed
            result(59.0, Located, Some(59.0), 20.0),   // found: 9 m from the path's end
            result(80.0, Located, Some(80.0), 20.0),   // correct where nothing was expected
            result(81.0, Located, Some(10.0), 20.0),   // false there
            result(200.0, Located, Some(0.0), 20.0),   // outside the truth
        ]);
        assert_eq!((t.clouds, t.outside_truth), (8, 1));
        assert_eq!((t.located, t.ambiguous, t.not_found), (6, 1, 1));
        assert_eq!((t.localizable, t.too_short, t.found), (4, 2, 2));
        assert_eq!((t.correct, t.wrong), (4, 2));
        assert_eq!(t.recall(), Some(0.5));
        assert_eq!(t.errors_m.max(), Some(0.5));
    }

    #[test]
    fn without_a_truth_verdicts_are_counted_and_nothing_is_judged() {
        let mut t = Tally::default();
        t.add(&result(0.0, Verdict::Located, Some(0.0), 0.0), None, 20.0);
        assert_eq!((t.clouds, t.located, t.correct, t.wrong), (1, 1, 0, 0));
        assert_eq!(t.recall(), None);
    }

    #[test]
    fn quantiles_are_within_half_a_percent_of_a_sort() {
        let values: Vec<f64> = (1..=1000).map(|i| 0.003 * (i as f64).powf(1.7)).collect();
        let mut q = Quantiles::default();
        values.iter().rev().for_each(|v| q.add(*v));
        for (share, index) in [(0.5, 499), (0.95, 949), (1.0, 999)] {
            let (got, want) = (q.at(share).unwrap(), values[index]);
            assert!((got / want - 1.0).abs() <= 0.0051, "{share}: {got} instead of {want}");
        }
        assert_eq!(q.max(), values.last().copied());
    }

    #[test]
    fn quantiles_of_little() {
        let mut q = Quantiles::default();
        assert_eq!((q.at(0.5), q.max()), (None, None));
        q.add(0.0);
        assert_eq!((q.at(0.5), q.max()), (Some(0.0), Some(0.0)));
        q.add(1e300);
        assert!(q.at(1.0).unwrap() > 1e11);
    }
}

//! [`BudgetConfig`]: how long a cloud may take, and which segments it goes without then.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::describe::{Descriptions, Descriptor};
use crate::error::{Error, require};
use crate::segment::Segment;

/// Segments that are described whatever the time: fewer are no place.
const LEAST: usize = 12;
/// Segments a thread describes between two looks at the clock.
const BATCH: usize = 4;
/// What stays of the time kept for the stages that follow, from one cloud to the next.
const FADING: f64 = 0.9;

/// How long a cloud may take.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(default, deny_unknown_fields)]
pub struct BudgetConfig {
    /// Milliseconds from the newest sweep to the answer; 0: as long as it takes. Where they would not do, the segments of
    /// fewest points are not described ([`Localization::described`](crate::Localization::described) tells how many were).
    /// The one setting with which the same input does not give the same bits.
    pub ms: f64,
}

impl BudgetConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] for the first field outside its range.
    pub fn check(&self) -> Result<(), Error> {
        require((0.0..=1e6).contains(&self.ms), "budget.ms", self.ms, "0 to 1000000")
    }
}

/// Keeps to a budget, cloud after cloud.
pub(crate) struct Budget {
    limit: Option<Duration>,
    /// Nanoseconds that matching, pose and verification took lately: what has to be left for them.
    rest: AtomicU64,
}

impl Budget {
    pub(crate) fn new(config: &BudgetConfig) -> Self {
        let limit = (config.ms > 0.0).then(|| Duration::from_secs_f64(config.ms / 1e3));
        Self { limit, rest: AtomicU64::new(0) }
    }

    /// Describes as many of the segments as there is time for, in their order, which becomes that of their use where there is
    /// a limit; the first rows of all.
    pub(crate) fn describe(
        &self,
        descriptor: &dyn Descriptor,
        segments: &mut [Segment],
        elapsed: impl Fn() -> Duration,
    ) -> Descriptions {
        let Some(limit) = self.limit else { return descriptor.describe(segments) };
        // Many points make a steady descriptor; a few are the first to look otherwise the next time.
        segments.sort_by_key(|s| std::cmp::Reverse(s.points.len()));
        let limit = limit.saturating_sub(Duration::from_nanos(self.rest.load(Ordering::Relaxed)));
        let batch = BATCH * rayon::current_num_threads();
        let (first, others) = segments.split_at(LEAST.max(batch).min(segments.len()));
        let mut described = descriptor.describe(first);
        let mut longest = Duration::ZERO;
        for more in others.chunks(batch) {
            let start = elapsed();
            if start + longest > limit {
                break;
            }
            append(&mut described, descriptor.describe(more));
            longest = longest.max(elapsed().saturating_sub(start));
        }
        described
    }

    /// Learns what the stages after the description took.
    pub(crate) fn note(&self, rest: Duration) {
        let faded = self.rest.load(Ordering::Relaxed) as f64 * FADING;
        self.rest.store((rest.as_nanos() as u64).max(faded as u64), Ordering::Relaxed);
    }
}

fn append(all: &mut Descriptions, more: Descriptions) {
    all.values.extend(more.values);
    all.quality.extend(more.quality);
    all.preprocessing += more.preprocessing;
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;
    use crate::describe::Shape;

    /// Segments of 10, 20, ... points in a column.
    fn segments(count: usize) -> Vec<Segment> {
        let column = |n: usize| (0..n).map(|i| [0.01 * (i % 7) as f32, 0.0, 0.05 * i as f32]).collect();
        (1..=count).map(|n| Segment::from_points(column(10 * n)).unwrap()).collect()
    }

    /// A clock on which every look takes `step`.
    fn ticking(step: Duration) -> impl Fn() -> Duration {
        let looks = Cell::new(0);
        move || {
            looks.set(looks.get() + 1);
            step * looks.get()
        }
    }

    #[test]
    fn without_a_limit_all_are_described_in_their_order() {
        let mut given = segments(100);
        let described = Budget::new(&BudgetConfig::default()).describe(&Shape, &mut given, || Duration::MAX);
        assert_eq!(described, Shape.describe(&segments(100)));
    }

    #[test]
    fn the_smallest_are_left_out_when_time_runs_out() {
        let budget = Budget::new(&BudgetConfig { ms: 10.0 });
        let mut given = segments(400);
        let described = budget.describe(&Shape, &mut given, ticking(Duration::from_millis(1)));
        let count = described.quality.len();
        assert!((LEAST..400).contains(&count), "{count}");
        // What was described are the largest, row for row.
        let largest: Vec<Segment> = segments(400).into_iter().rev().take(count).collect();
        let batches = Shape.describe(&largest);
        assert_eq!(described.values, batches.values);
        assert_eq!(given[0].points.len(), 4000);
    }

    #[test]
    fn what_follows_is_left_time_for() {
        let budget = Budget::new(&BudgetConfig { ms: 50.0 });
        let count = |budget: &Budget| {
            let mut given = segments(400);
            budget.describe(&Shape, &mut given, ticking(Duration::from_millis(1))).quality.len()
        };
        let before = count(&budget);
        budget.note(Duration::from_millis(30));
        let after = count(&budget);
        assert!(after < before, "{before} {after}");
        // A quick cloud is not believed at once.
        budget.note(Duration::ZERO);
        assert!((after..before).contains(&count(&budget)));
        // However short, a cloud is tried.
        budget.note(Duration::from_secs(1));
        assert!(count(&budget) >= LEAST);
    }
}

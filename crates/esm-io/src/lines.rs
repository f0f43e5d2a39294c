//! One result as the JSON object that programs read: the same from the command line and from the service.

use esm_core::{Localization, Pose, Timings};
use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

/// A pose as written in results: position in metres, quaternion x y z w.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseLine {
    /// Position, metres.
    pub t: [f64; 3],
    /// Attitude, x y z w.
    pub q: [f64; 4],
}

impl From<&Pose> for PoseLine {
    fn from(pose: &Pose) -> Self {
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        Self { t: t.into(), q: [q.x, q.y, q.z, q.w] }
    }
}

/// The object of one cloud, keys in the order of the contract. Flatten it into an object that says more.
///
/// ```
/// use esm_core::{Localization, Pose, Timings, Verdict};
/// use esm_io::LocalizationLine;
///
/// # let result = Localization { stamp: 1.5, verdict: Verdict::Located, reason: None,
/// #     pose_map_sensor: Some(Pose::translation(1.0, 2.0, 3.0)), covariance: None, travel_m: 0.0, segments: 4,
/// #     described: 4, inliers: 3, score: 2.5, overlap: 0.9, seen: 1.0, free_space_violated: 0.0, runner_up: 0.0, runner_up_pose_map_sensor: None, matches: Vec::new(),
/// #     timings: Timings::default() };
/// let line = serde_json::to_string(&LocalizationLine::from(&result))?;
/// assert!(line.starts_with(r#"{"stamp":1.5,"verdict":"located","reason":null,"pose":{"t":[1.0,2.0,3.0],"#));
/// # Ok::<(), serde_json::Error>(())
/// ```
#[derive(Clone, Debug, Serialize)]
pub struct LocalizationLine<'a> {
    stamp: f64,
    verdict: &'static str,
    reason: Option<&'a str>,
    pose: Option<PoseLine>,
    covariance: Option<&'a [f64]>,
    travel_m: f64,
    segments: usize,
    described: usize,
    inliers: usize,
    score: f64,
    runner_up: f64,
    timings_ms: StageMillis<'a>,
}

impl<'a> From<&'a Localization> for LocalizationLine<'a> {
    fn from(result: &'a Localization) -> Self {
        Self {
            stamp: result.stamp,
            verdict: result.verdict.as_str(),
            reason: result.reason.as_deref(),
            pose: result.pose_map_sensor.as_ref().map(PoseLine::from),
            covariance: result.covariance.as_ref().map(|c| c.as_slice()),
            travel_m: result.travel_m,
            segments: result.segments,
            described: result.described,
            inliers: result.inliers,
            score: result.score,
            runner_up: result.runner_up,
            timings_ms: StageMillis(&result.timings),
        }
    }
}

/// The stages in the pipeline's order and `total`, their sum, as an object of milliseconds.
#[derive(Clone, Copy, Debug)]
pub struct StageMillis<'a>(pub &'a Timings);

impl Serialize for StageMillis<'_> {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        let mut map = to.serialize_map(None)?;
        for (name, us) in stage_micros(self.0) {
            map.serialize_entry(name, &(us as f64 / 1e3))?;
        }
        map.end()
    }
}

/// The stages in the pipeline's order and `total`, in whole microseconds: the clock knows no more, and the total is
/// the sum of what is printed.
pub fn stage_micros(timings: &Timings) -> impl Iterator<Item = (&'static str, u64)> {
    let stages = timings.stages().map(|(name, time)| (name, (time.as_secs_f64() * 1e6).round() as u64));
    let total = stages.iter().map(|(_, us)| us).sum();
    stages.into_iter().chain([("total", total)])
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_total_is_the_sum_of_what_is_printed() {
        // Each stage is rounded up by 0.4 microseconds.
        let odd = Duration::from_nanos(1_000_600);
        let timings = Timings {
            accumulation: odd,
            segmentation: odd,
            preprocessing: odd,
            descriptor: odd,
            matching: odd,
            judging: Duration::ZERO,
            pose: odd,
            verification: odd,
        };
        let text = serde_json::to_string(&StageMillis(&timings)).unwrap();
        assert_eq!(text.matches(":1.001,").count(), 7, "{text}");
        assert!(text.ends_with("\"total\":7.007}"), "{text}");
    }
}

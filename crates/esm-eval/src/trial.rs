//! [`Trial`]: one method looks for the clouds of one visit in one mode, in one thread.

use std::sync::Arc;

use esm_core::{Accumulator, Config, Localization, Localizer, Map, PointCloud, SequenceLocalizer, Verdict};
use esm_io::Sweep;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::digest;
use crate::error::Error;
use crate::memory;
use crate::method::Model;
use crate::plan::Mode;
use crate::site::Site;
use crate::stats::{Share, median};
use crate::truth::{self, Judgement, Places, Tally};
use crate::watch::Teller;

/// The stages of a cloud's time as they are told: those of [`Timings`](esm_core::Timings), but that judging the candidates
/// (SegMatch's and NSM's forest) is a stage of its own; the total last.
pub const STAGES: [&str; 9] = [
    "accumulation",
    "segmentation",
    "preprocessing",
    "descriptor",
    "matching",
    "judging",
    "pose",
    "verification",
    "total",
];

/// One cloud that was looked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cloud {
    /// Seconds, of its newest sweep.
    pub stamp: f64,
    /// `located`, `ambiguous` or `not_found`.
    pub verdict: String,
    /// Where the sensor truly was, map frame, metres; `None` outside the truth.
    pub at: Option<[f64; 3]>,
    /// Whether that is within 10 m of the mapped path.
    pub localizable: Option<bool>,
    /// Where a located pose says it was, map frame, metres.
    pub claimed: Option<[f64; 3]>,
    /// Of the pose that was given, metres.
    pub error_m: Option<f64>,
    /// Of the pose that was given, degrees.
    pub error_deg: Option<f64>,
    /// Whether a located pose is right; `None` where there is none or nothing can be said.
    pub correct: Option<bool>,
    /// Metres of travel it holds.
    pub travel_m: f64,
    /// Segments cut from it.
    pub segments: usize,
    /// Matched ones that agree with the pose.
    pub inliers: usize,
    /// Milliseconds of every stage, in the order of [`STAGES`].
    pub ms: [f64; 9],
}

/// Counts as `localize --truth` tells them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Clouds inside the truth.
    pub clouds: usize,
    /// Localizable ones that hold enough travel.
    pub localizable: usize,
    /// Localizable ones that do not.
    pub too_short: usize,
    /// Verdict `located`.
    pub located: usize,
    /// Verdict `ambiguous`.
    pub ambiguous: usize,
    /// Located rightly among `localizable`.
    pub found: usize,
    /// Located rightly, anywhere.
    pub correct: usize,
    /// Located and not right, anywhere.
    pub wrong: usize,
    /// Clouds outside the truth, which nothing else counts.
    pub outside_truth: usize,
}

impl std::ops::AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.clouds += other.clouds;
        self.localizable += other.localizable;
        self.too_short += other.too_short;
        self.located += other.located;
        self.ambiguous += other.ambiguous;
        self.found += other.found;
        self.correct += other.correct;
        self.wrong += other.wrong;
        self.outside_truth += other.outside_truth;
    }
}

impl Counts {
    /// Located rightly of the localizable ones, with Wilson's interval.
    pub fn recall(&self) -> Option<Share> {
        Share::wilson(self.found, self.localizable)
    }
}

impl From<&Tally> for Counts {
    fn from(t: &Tally) -> Self {
        Self {
            clouds: t.clouds,
            localizable: t.localizable,
            too_short: t.too_short,
            located: t.located,
            ambiguous: t.ambiguous,
            found: t.found,
            correct: t.correct,
            wrong: t.wrong,
            outside_truth: t.outside_truth,
        }
    }
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trial {
    /// In the order of the recording.
    pub clouds: Vec<Cloud>,
    /// How many of what.
    pub counts: Counts,
    /// Metres of travel that a full cloud holds.
    pub accumulate_m: f64,
    /// Highest memory of the process meanwhile, MiB.
    pub peak_mib: Option<f64>,
    /// Segments of the map.
    pub map_segments: usize,
    /// Size of its file.
    pub map_bytes: u64,
    /// How long it took to build, with all threads, seconds.
    pub map_built_s: f64,
    /// Highest memory while it was built, MiB.
    pub map_built_peak_mib: Option<f64>,
    /// Size of the descriptor's weights; 0 of a formula.
    pub model_bytes: u64,
}

impl Trial {
    /// Errors of the clouds that were located rightly, metres and degrees.
    pub(crate) fn errors(&self) -> (Vec<f64>, Vec<f64>) {
        let right = self.clouds.iter().filter(|c| c.correct == Some(true));
        right.filter_map(|c| Some((c.error_m?, c.error_deg?))).unzip()
    }

    /// The median of every stage, milliseconds, in the order of [`STAGES`].
    pub fn stage_p50(&self) -> [Option<f64>; 9] {
        std::array::from_fn(|i| median(self.clouds.iter().map(|c| c.ms[i]).collect()))
    }
}

/// What a trial is made from.
pub(crate) fn key(map_key: &Value, site: &Site, config: &Config, mode: &Mode) -> Value {
    let settings = Config { descriptor: String::new(), ..config.clone() };
    json!({
        "kind": "trial",
        "map": digest::of_bytes(map_key.to_string().as_bytes()),
        "live": site.live_digest,
        "truth": site.truth_digest,
        "config": settings,
        "odometry": mode.odometry,
        "every": mode.every,
        "beams": mode.beams,
    })
}

/// Runs it. The worker threads are those of the pool that it is called in.
pub(crate) fn run(
    map: &Arc<Map>,
    site: &Site,
    (config, mode, model): (&Config, &Mode, &Model),
    words: &str,
    teller: &mut Teller<'_, '_>,
) -> Result<Trial, Error> {
    let failed = || Error::core(words);
    memory::reset_peak();
    let truth = truth::read(&site.files.truth)?;
    let places = match map.path() {
        [] => Places::in_cells(esm_core::map::COVERAGE_CELL_M, map.coverage()),
        path => Places::along(path),
    };
    let recording = site.open_live(false, mode.beams > 1)?;
    let mut accumulate = config.accumulate.clone();
    let mut odometry = mode.odometry;
    if !recording.has_motion() {
        let live = site.files.live.display();
        tracing::warn!("{live}: it does not tell how the sensor moved: every scan is localized by itself");
        (accumulate.distance_m, accumulate.swathes, odometry) = (0.0, false, false);
    }
    let accumulate_m = accumulate.distance_m;
    let localizer = Localizer::with_descriptor(Arc::clone(map), config, Arc::clone(&model.descriptor));
    let mut robot = SequenceLocalizer::new(localizer.map_err(failed())?);
    let mut accumulator = Accumulator::new(accumulate).map_err(failed())?;
    let (mut tally, mut clouds, mut seen) = (Tally::default(), Vec::new(), 0);
    teller.begins(format!("localizing {words}"), recording.sweep_count_hint())?;
    for sweep in recording.sweeps()? {
        let sweep = sweep?;
        teller.step()?;
        let cloud = thinned(&sweep, mode, site)?;
        let Some(live) = accumulator.push(sweep.stamp, &cloud, sweep.pose_odom_sensor) else { continue };
        seen += 1;
        if (seen - 1) % mode.every != 0 {
            continue;
        }
        let answer = match odometry {
            true => robot.localize(&live),
            false => robot.localizer().localize(&live),
        };
        let answer = answer.map_err(failed())?;
        let judgement = Judgement::of(&answer, &truth, &places);
        tally.add(&answer, Some(&judgement), accumulate_m);
        clouds.push(told(&answer, &judgement));
    }
    Ok(Trial {
        clouds,
        counts: Counts::from(&tally),
        accumulate_m,
        peak_mib: memory::peak_mib(),
        map_segments: map.len(),
        map_bytes: map.file_size(),
        map_built_s: 0.0,
        map_built_peak_mib: None,
        model_bytes: model.bytes,
    })
}

/// The sweep with the lasers that the mode leaves.
fn thinned(sweep: &Sweep, mode: &Mode, site: &Site) -> Result<PointCloud, Error> {
    if mode.beams == 1 || sweep.cloud.is_empty() {
        return Ok(sweep.cloud.clone());
    }
    let refuse = |what: String| {
        let hint = format!("leave this dataset out of mode '{}' (`datasets = [...]`)", mode.name);
        Err(Error::input(&site.files.live, what, hint))
    };
    if sweep.rings.len() != sweep.cloud.len() {
        return refuse("its clouds have no field `ring`, so no lasers can be left out".to_owned());
    }
    if sweep.rings.iter().all(|r| *r == sweep.rings[0]) && sweep.cloud.len() > 1 {
        return refuse(format!(
            "all points of cloud {} are of one laser: none can be left out",
            sweep.number
        ));
    }
    let points = sweep.cloud.points().iter().zip(&sweep.rings);
    let kept = points.filter(|(_, ring)| usize::from(**ring) % mode.beams == 0).map(|(p, _)| *p).collect();
    PointCloud::try_new(kept).map_err(Error::core("a sweep"))
}

fn told(answer: &Localization, judgement: &Judgement) -> Cloud {
    let t = &answer.timings;
    let stages = [
        t.accumulation,
        t.segmentation,
        t.preprocessing,
        t.descriptor,
        t.matching.saturating_sub(t.judging),
        t.judging,
        t.pose,
        t.verification,
        t.total(),
    ];
    let position = |pose: &esm_core::Pose| -> [f64; 3] { pose.translation.vector.into() };
    let located = answer.verdict == Verdict::Located;
    Cloud {
        stamp: answer.stamp,
        verdict: answer.verdict.as_str().to_owned(),
        at: judgement.truth.as_ref().map(position),
        localizable: judgement.localizable,
        claimed: answer.pose_map_sensor.as_ref().filter(|_| located).map(position),
        error_m: judgement.error.map(|e| e.m),
        error_deg: judgement.error.map(|e| e.deg),
        correct: judgement.is_correct(answer.verdict),
        travel_m: answer.travel_m,
        segments: answer.segments,
        inliers: answer.inliers,
        ms: stages.map(|s| (s.as_secs_f64() * 1e6).round() / 1e3),
    }
}

//! `esm-cli loops`.

use std::collections::VecDeque;

use esm_core::loops::{MIN_AGE_S, MIN_TRAVEL_M};
use esm_core::{Accumulator, Localization, LoopAnswer, LoopClosure, LoopFinder, Pose};
use nalgebra::Matrix6;
use serde_json::json;

use crate::args::LoopsArgs;
use crate::inputs::{Frames, check_distinct, read_truth};
use crate::outcome::{Failure, Outcome};
use crate::output::summary::{StageTimes, Summary};
use crate::output::{
    Format, G2o, Lines, Target, check_target, loop_header, loop_json, loop_row, stages_text,
};
use crate::settings;
use crate::truth::{Judgement, Places, PoseError, Tally, Trajectory};

const FORMATS: &[Format] = &[Format { extension: ".g2o" }];

pub(crate) fn run(args: &LoopsArgs) -> anyhow::Result<Outcome> {
    check_distinct(&args.inputs)?;
    if let Some(path) = &args.output {
        Format::of(path, FORMATS)?;
        check_target(path, &args.inputs)?;
    }
    let config = settings::configure(&args.tune, &args.live)?.config;
    let mut past = args.truth.as_deref().map(read_truth).transpose()?.map(Past::new);
    let mut frames = Frames::open(&args.inputs, &args.read, "looking for loops")?;
    if let Some(silent) = frames.silent() {
        return Err(Failure::new(
            format!(
                "{silent}: this input does not tell how the sensor moved, and loops are found against what was \
                 passed before"
            ),
            "give the poses of the scans with --poses FILE, or name the topic with --odometry-topic",
        )
        .into());
    }
    let mut graph = args.output.as_deref().map(Graph::create).transpose()?;
    let mut lines = Lines::new(graph.is_none());
    // Before the first row: an error that comes first stands alone.
    let mut header = (!args.json).then(|| loop_header(past.is_some()));
    let (mut tally, mut times) = (Tally::default(), StageTimes::start());
    let mut finder = LoopFinder::new(&config)?;
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let mut stretch = 0;
    // The finder speaks of stamps; people and truth files of scans.
    let mut numbers: Vec<(f64, usize)> = Vec::new();
    while let Some(frame) = frames.next()? {
        if std::mem::replace(&mut stretch, frame.stretch) != frame.stretch {
            accumulator = Accumulator::new(config.accumulate.clone())?;
        }
        let sweep = &frame.sweep;
        let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) else {
            continue;
        };
        let (stamp, pose_odom_sensor) = (live.stamp, live.pose_odom_sensor);
        numbers.push((stamp, frame.number));
        if let (Some(graph), Some(pose)) = (&mut graph, &pose_odom_sensor) {
            graph.vertex(stamp, pose)?;
        }
        if let Some(past) = &mut past {
            past.advance(stamp);
        }
        let Some(LoopAnswer { localization, closure }) = finder.push(live)? else { continue };
        let judgement = past.as_ref().map(|p| p.judge(&localization, closure.as_ref()));
        tally.add(&localization, judgement.as_ref(), config.accumulate.distance_m);
        times.add(&localization.timings);
        tracing::debug!("{stamp:.6}: {}", stages_text(&localization.timings));
        let Some(closure) = closure else { continue };
        if let Some(graph) = &mut graph {
            graph.closure(&closure)?;
        }
        if let Some(header) = header.take() {
            lines.line(&header)?;
        }
        lines.line(&match args.json {
            true => {
                let from = numbers.iter().rfind(|n| n.0 == closure.stamp_from).map(|n| n.1);
                loop_json(&localization, &closure, [from, Some(frame.number)], judgement.as_ref())?
            }
            false => loop_row(&localization, &closure, judgement.as_ref()),
        })?;
    }
    if let Some(graph) = graph {
        graph.finish()?;
    }
    let with_truth = past.is_some();
    let summary =
        Summary { tally: &tally, times: &times, with_truth, accumulate_m: config.accumulate.distance_m };
    lines.line(&match args.json {
        true => json!({ "summary": summary.json() }).to_string(),
        false => format!("\n{}", summary.table()),
    })?;
    Ok(if tally.located > 0 { Outcome::Done } else { Outcome::NothingLocalized })
}

/// The truth, and the true positions that are old enough to be recognised: what [`LoopFinder`] may find.
struct Past {
    truth: Trajectory,
    places: Places,
    /// Stamp, travel and position of what is still too young.
    young: VecDeque<(f64, f64, [f64; 3])>,
    travel_m: f64,
}

impl Past {
    fn new(truth: Trajectory) -> Self {
        Self { truth, places: Places::along(&[]), young: VecDeque::new(), travel_m: 0.0 }
    }

    fn advance(&mut self, stamp: f64) {
        let Some(pose) = self.truth.at(stamp) else { return };
        let position: [f64; 3] = pose.translation.vector.into();
        if let Some((.., last)) = self.young.back() {
            self.travel_m += (0..3).map(|a| (position[a] - last[a]).powi(2)).sum::<f64>().sqrt();
        }
        self.young.push_back((stamp, self.travel_m, position));
        while let Some(&(then, travel_m, old)) = self.young.front()
            && stamp - then > MIN_AGE_S
            && self.travel_m - travel_m > MIN_TRAVEL_M
        {
            self.places.add(old);
            self.young.pop_front();
        }
    }

    /// A closure is judged by the relative pose it claims.
    fn judge(&self, result: &Localization, closure: Option<&LoopClosure>) -> Judgement {
        let Some(to) = self.truth.at(result.stamp) else { return Judgement::default() };
        let localizable = Some(self.places.holds(&to.translation.vector.into()));
        let Some(closure) = closure else {
            return Judgement { truth: Some(to), localizable, error: None };
        };
        let Some(from) = self.truth.at(closure.stamp_from) else { return Judgement::default() };
        let error = PoseError::between(&closure.pose_from_to, &from.inv_mul(&to));
        Judgement { truth: Some(to), localizable, error: Some(error) }
    }
}

/// The pose graph on its way into a file.
struct Graph {
    g2o: G2o<Target>,
    /// Stamps of the vertices, ascending as they come.
    stamps: Vec<f64>,
}

impl Graph {
    fn create(path: &std::path::Path) -> anyhow::Result<Self> {
        Ok(Self { g2o: G2o::new(Target::create(path)?), stamps: Vec::new() })
    }

    fn vertex(&mut self, stamp: f64, pose_odom_sensor: &Pose) -> anyhow::Result<()> {
        self.g2o.vertex(pose_odom_sensor)?;
        self.stamps.push(stamp);
        Ok(())
    }

    fn closure(&mut self, closure: &LoopClosure) -> anyhow::Result<()> {
        let vertex = |stamp: f64| self.stamps.iter().rposition(|s| *s == stamp);
        let ends = (vertex(closure.stamp_from), vertex(closure.stamp_to));
        // A closure without covariance says nothing about its weight.
        if let ((Some(from), Some(to)), Some(covariance)) = (ends, &closure.covariance) {
            self.g2o.edge(from, to, &closure.pose_from_to, &Matrix6::from_row_slice(covariance))?;
        }
        Ok(())
    }

    fn finish(self) -> anyhow::Result<()> {
        self.g2o.into_inner().finish()
    }
}

//! `esm-cli localize`.

use std::sync::Arc;

use anyhow::Context;
use esm_core::map::COVERAGE_CELL_M;
use esm_core::{
    Accumulator, Config, LiveCloud, Localization, Localizer, Map, SequenceLocalizer, Verdict, describe,
};
use serde_json::json;

use crate::args::LocalizeArgs;
use crate::inputs::{Frames, check_distinct, read_truth};
use crate::outcome::Outcome;
use crate::output::summary::{StageTimes, Summary};
use crate::output::{Lines, PoseWriter, check_target, json_line, stages_text, table_header, table_line};
use crate::plot::{self, Caption, Drive};
use crate::settings::{self, Settings};
use crate::truth::{Judgement, Places, Tally, Trajectory};

pub(crate) fn run(args: &LocalizeArgs) -> anyhow::Result<Outcome> {
    let found = localize(args, Lines::new(args.output.is_none() && args.plot.is_none()))?;
    Ok(if found.tally.located > 0 { Outcome::Done } else { Outcome::NothingLocalized })
}

/// What a run adds up to.
pub(crate) struct Found {
    pub(crate) map: Arc<Map>,
    /// Every cloud, where it was asked for.
    pub(crate) drive: Option<Drive>,
    pub(crate) tally: Tally,
    pub(crate) times: StageTimes,
    /// What stands above the picture.
    pub(crate) caption: Caption,
}

/// Localizes all clouds, and tells about them in `lines`.
pub(crate) fn localize(args: &LocalizeArgs, lines: Lines) -> anyhow::Result<Found> {
    check_distinct(&args.inputs)?;
    check_outputs(args)?;
    let Settings { mut config, descriptor_given } =
        settings::configure(&args.tune, &args.live)?.within(args.budget_ms)?;
    let map = Arc::new(Map::open(&args.map)?);
    if !descriptor_given && describe::NAMES.contains(&map.descriptor_info().name.as_str()) {
        config.descriptor.clone_from(&map.descriptor_info().name);
    }
    warn_of_other_segments(&map, &config);
    let truth = args.truth.as_deref().map(read_truth).transpose()?;
    let mut frames = Frames::open(&args.inputs, &args.read, "localizing")?;
    if let Some(silent) = frames.silent()
        && config.accumulate.distance_m > 0.0
    {
        tracing::warn!(
            "{silent}: this input does not tell how the sensor moved: every scan is localized by itself"
        );
        config.accumulate.distance_m = 0.0;
        config.accumulate.swathes = false;
    }
    let mut run = Run::start(args, &config, &map, truth, lines)?;
    let mut accumulator = Accumulator::new(config.accumulate.clone())?;
    let mut stretch = 0;
    while let Some(frame) = frames.next()? {
        if std::mem::replace(&mut stretch, frame.stretch) != frame.stretch {
            accumulator = Accumulator::new(config.accumulate.clone())?;
            run.robot.forget();
        }
        let sweep = &frame.sweep;
        if let Some(live) = accumulator.push(sweep.stamp, &sweep.cloud, sweep.pose_odom_sensor) {
            let result = run.localize(&live)?;
            run.take(&result, sweep.stamp_ns, stretch, live.pose_odom_sensor)?;
        }
    }
    // A damaged block that no cloud needed is damage all the same.
    map.verify_points()?;
    run.finish()
}

/// Refuses, before any work, outputs that cannot be written.
fn check_outputs(args: &LocalizeArgs) -> anyhow::Result<()> {
    let mut read = args.inputs.clone();
    read.push(args.map.clone());
    read.extend(args.truth.iter().chain(&args.read.poses).chain(&args.tune.config).cloned());
    if let Some(path) = &args.output {
        PoseWriter::check_format(path)?;
        check_target(path, &read)?;
    }
    if let Some(path) = &args.plot {
        plot::check_format(path)?;
        check_target(path, &read)?;
    }
    Ok(())
}

/// Segments that are cut in another way do not match.
fn warn_of_other_segments(map: &Map, config: &Config) {
    // Settings of another version may not be readable; the descriptor's version is what must agree.
    let Ok(built) = toml::from_str::<Config>(map.settings()) else { return };
    if built.segment != config.segment {
        tracing::warn!(
            "the map was built with another [segment] configuration: expect fewer clouds to be located"
        );
    }
}

/// Everything that results go into.
struct Run<'a> {
    args: &'a LocalizeArgs,
    map: Arc<Map>,
    robot: SequenceLocalizer,
    truth: Option<(Trajectory, Places)>,
    accumulate_m: f64,
    lines: Lines,
    /// To be printed before the first row: an error that comes first stands alone.
    header: Option<String>,
    poses: Option<PoseWriter>,
    drive: Option<Drive>,
    tally: Tally,
    times: StageTimes,
}

impl<'a> Run<'a> {
    fn start(
        args: &'a LocalizeArgs,
        config: &Config,
        map: &Arc<Map>,
        truth: Option<Trajectory>,
        lines: Lines,
    ) -> anyhow::Result<Self> {
        let places = match map.path() {
            [] => Places::in_cells(COVERAGE_CELL_M, map.coverage()),
            path => Places::along(path),
        };
        let truth = truth.map(|t| (t, places));
        Ok(Self {
            args,
            map: Arc::clone(map),
            robot: SequenceLocalizer::new(
                Localizer::new(Arc::clone(map), config).with_context(|| args.map.display().to_string())?,
            ),
            header: (!args.json).then(|| table_header(truth.is_some())),
            truth,
            accumulate_m: config.accumulate.distance_m,
            drive: (args.plot.is_some() || lines.is_silent()).then(Drive::default),
            lines,
            poses: args.output.as_deref().map(|p| PoseWriter::create(p, map.frame_id())).transpose()?,
            tally: Tally::default(),
            times: StageTimes::start(),
        })
    }

    fn localize(&mut self, live: &LiveCloud) -> Result<Localization, esm_core::Error> {
        if self.args.single { self.robot.localizer().localize(live) } else { self.robot.localize(live) }
    }

    fn take(
        &mut self,
        result: &Localization,
        stamp_ns: i64,
        stretch: usize,
        pose_odom_sensor: Option<esm_core::Pose>,
    ) -> anyhow::Result<()> {
        let judgement = self.truth.as_ref().map(|(truth, places)| Judgement::of(result, truth, places));
        let judgement = judgement.as_ref();
        self.tally.add(result, judgement, self.accumulate_m);
        self.times.add(&result.timings);
        if let Some(drive) = &mut self.drive {
            drive.push(result, stretch, pose_odom_sensor, judgement);
        }
        if let (Some(writer), Verdict::Located, Some(pose)) =
            (&mut self.poses, result.verdict, &result.pose_map_sensor)
        {
            writer.write(stamp_ns, pose, result.covariance.as_ref())?;
        }
        tracing::debug!("{:.6}: {}", result.stamp, stages_text(&result.timings));
        if let Some(header) = self.header.take() {
            self.lines.line(&header)?;
        }
        let line = match self.args.json {
            true => json_line(result, judgement)?,
            false => table_line(result, judgement),
        };
        self.lines.line(&line)
    }

    fn finish(mut self) -> anyhow::Result<Found> {
        if let Some(writer) = self.poses.take() {
            writer.finish()?;
        }
        if let (Some(drive), Some(path)) = (&self.drive, &self.args.plot) {
            plot::write(path, &self.map, drive, &self.caption())?;
        }
        let summary = Summary {
            tally: &self.tally,
            times: &self.times,
            with_truth: self.truth.is_some(),
            accumulate_m: self.accumulate_m,
        };
        self.lines.line(&match self.args.json {
            true => json!({ "summary": summary.json() }).to_string(),
            false => format!("\n{}", summary.table()),
        })?;
        let caption = self.caption();
        Ok(Found { map: self.map, drive: self.drive, tally: self.tally, times: self.times, caption })
    }

    fn caption(&self) -> Caption {
        let name = |p: &std::path::Path| {
            p.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
        };
        let inputs: Vec<String> = self.args.inputs.iter().map(|p| name(p)).collect();
        let t = &self.tally;
        let mut figures = vec![format!("{} of {} clouds located", t.located, t.clouds)];
        if let Some(recall) = t.recall() {
            figures.push(format!("recall {:.1} %", 100.0 * recall));
            figures.push(format!("{} false", t.wrong));
        }
        if let (Some(m), Some(deg)) = (t.errors_m.at(0.5), t.errors_deg.at(0.5)) {
            figures.push(format!("median error {m:.3} m, {deg:.3}°"));
        }
        if self.accumulate_m > 0.0 {
            figures.push(format!("{} m a cloud", self.accumulate_m));
        } else {
            figures.push("single sweeps".to_owned());
        }
        if let Some(ms) = self.times.total_p50() {
            figures.push(format!("{ms:.0} ms a cloud"));
        }
        Caption {
            title: format!("{} in {}", inputs.join(", "), name(&self.args.map)),
            figures: figures.join("  \u{b7}  "),
        }
    }
}

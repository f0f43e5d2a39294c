//! [`Frames`]: the selected scans of all inputs, with a progress bar.

use std::path::{Path, PathBuf};

use esm_io::{OpenOptions, Recording, Sweep, Sweeps};
use indicatif::ProgressBar;

use super::{Selection, paths};
use crate::args::ReadArgs;
use crate::{console, signals};

/// One scan.
pub(crate) struct Frame {
    /// Its number over all inputs, from 1.
    pub(crate) number: usize,
    /// Changes where a scan does not follow the one before: another input, or scans left out between.
    pub(crate) stretch: usize,
    /// What was read.
    pub(crate) sweep: Sweep,
}

/// Reads inputs one after the other.
pub(crate) struct Frames {
    recordings: std::vec::IntoIter<Recording>,
    current: Option<Sweeps>,
    selection: Selection,
    bar: ProgressBar,
    /// The inputs that do not tell their motion.
    silent: Vec<PathBuf>,
    number: usize,
    used: usize,
    first_stamp: Option<f64>,
    last_stamp: f64,
    stretch: usize,
    broken: bool,
}

impl Frames {
    /// Opens all inputs, so that a bad one is known before any work is done.
    pub(crate) fn open(inputs: &[PathBuf], args: &ReadArgs, doing: &'static str) -> anyhow::Result<Self> {
        Self::open_with(inputs, args, doing, false)
    }

    /// One input with the labels of its points, where it has them.
    pub(crate) fn open_labelled(input: &Path, args: &ReadArgs) -> anyhow::Result<Self> {
        Self::open_with(&[input.to_owned()], args, "cutting", true)
    }

    fn open_with(
        inputs: &[PathBuf],
        args: &ReadArgs,
        doing: &'static str,
        labels: bool,
    ) -> anyhow::Result<Self> {
        let selection = Selection::new(args)?;
        let options = OpenOptions {
            cloud_topic: args.cloud_topic.clone(),
            motion_topic: args.odometry_topic.clone(),
            poses: args.poses.clone(),
            labels,
            rings: false,
        };
        let recordings =
            inputs.iter().map(|path| Recording::open(path, &options)).collect::<Result<Vec<_>, _>>()?;
        for recording in &recordings {
            if let Some(topic) = recording.cloud_topic() {
                let motion = recording.motion_topic().unwrap_or("no topic");
                tracing::info!("{}: clouds from {topic}, motion from {motion}", recording.path().display());
            }
        }
        let count = recordings.iter().map(|r| r.sweep_count_hint().map(|n| n as u64)).sum();
        Ok(Self {
            silent: recordings.iter().filter(|r| !r.has_motion()).map(|r| r.path().to_owned()).collect(),
            recordings: recordings.into_iter(),
            current: None,
            selection,
            bar: console::bar(doing, count),
            number: 0,
            used: 0,
            first_stamp: None,
            last_stamp: f64::NEG_INFINITY,
            stretch: 0,
            broken: false,
        })
    }

    /// The names of the inputs that do not tell their motion; `None` where all do.
    pub(crate) fn silent(&self) -> Option<String> {
        (!self.silent.is_empty()).then(|| paths(&self.silent))
    }

    /// The next selected scan.
    ///
    /// # Errors
    /// The reader's, an interrupt, and at the end a selection that selected nothing.
    pub(crate) fn next(&mut self) -> anyhow::Result<Option<Frame>> {
        loop {
            signals::check()?;
            let Some(sweeps) = &mut self.current else {
                let Some(recording) = self.recordings.next() else { return self.finish() };
                self.current = Some(recording.sweeps()?);
                self.broken = true;
                continue;
            };
            let Some(sweep) = sweeps.next() else {
                sweeps.warnings().iter().for_each(|w| tracing::warn!("{w}"));
                self.current = None;
                continue;
            };
            let sweep = sweep?;
            self.number += 1;
            self.bar.inc(1);
            let elapsed_s = sweep.stamp - *self.first_stamp.get_or_insert(sweep.stamp);
            self.last_stamp = self.last_stamp.max(sweep.stamp);
            if self.selection.holds(self.number, elapsed_s) {
                self.used += 1;
                self.stretch += usize::from(std::mem::take(&mut self.broken));
                return Ok(Some(Frame { number: self.number, stretch: self.stretch, sweep }));
            }
            self.broken = true;
            if self.selection.is_past(self.number) {
                return self.finish();
            }
        }
    }

    fn finish(&mut self) -> anyhow::Result<Option<Frame>> {
        self.recordings = Vec::new().into_iter();
        if let Some(sweeps) = self.current.take() {
            sweeps.warnings().iter().for_each(|w| tracing::warn!("{w}"));
        }
        self.bar.finish_and_clear();
        let duration_s = self.first_stamp.map_or(0.0, |first| self.last_stamp - first);
        self.selection.check(self.number, duration_s, self.used)?;
        Ok(None)
    }
}
